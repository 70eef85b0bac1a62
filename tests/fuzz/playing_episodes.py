"""Playing cases of any kind of environment: every call, and its results for each lane."""

from __future__ import annotations

import copy
import pickle
from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorEnv

import redundant_envs as rde

from .cases import Array, Case, lanes_of, numbers
from .playing import Make


@dataclass
class Given:
    """Results of a call: arrays with a row for each lane; None for results that a call does not have."""

    obs: dict[str, Array] | None = None
    reward: Array | None = None
    terminated: Array | None = None
    truncated: Array | None = None
    last_obs: dict[int, dict[str, Array]] = field(default_factory=dict)
    """Lane -> the last observation of its episode, where the next one has begun."""


@dataclass
class EpisodeStep:
    """A call that was played."""

    call: dict[str, Any]
    before: dict[str, Any]
    after: dict[str, Any]
    """Everything that determines the continuation, from ``get_state``."""
    q: Array
    error: BaseException | None = None
    given: Given = field(default_factory=Given)
    may_refuse: bool = False


def made(case: Case) -> Any:
    """The environment of a case."""
    kind = case["scene"]["robot"]["type"]
    env_id = f"redundant_envs/{kind}{'Goal' if case['goal'] else ''}Reach-v0"
    arguments = {name: case[name] for name in ("scene", "on_bad_action", "max_episode_steps", "task")}
    if case["face"] == "env":
        return gym.make(env_id, disable_env_checker=True, **arguments)
    arguments |= {"num_envs": case["num_envs"], "threads": case["threads"]}
    if case["face"] == "sb3":
        return rde.make_sb3(env_id, **arguments)
    return gym.make_vec(env_id, autoreset_mode=case["autoreset_mode"], **arguments)


def parts(obs: Any, lines: bool) -> dict[str, Array]:
    """An observation as named tables; that of one environment as tables of one row."""
    named = obs if isinstance(obs, dict) else {"": obs}
    return {name: np.array(x if lines else [x]) for name, x in named.items()}


class EpisodePlayer:
    """An environment of a case."""

    def __init__(self, case: Case, make: Make = made) -> None:
        self.case = case
        self.env = make(case)
        self.saved: Any = None
        self.ended = np.zeros(case["num_envs"], np.bool_)
        self.over = False
        """Whether a fault has ended the episode of a single environment, which then needs a reset."""

    @property
    def core(self) -> Any:
        return self.inner.core

    @property
    def inner(self) -> Any:
        env = self.env
        return env.unwrapped if isinstance(env, gym.Env | VectorEnv) else env

    def play(self, call: dict[str, Any]) -> EpisodeStep:
        """Make a call; any exception is kept."""
        before = self.core.get_state()
        may_refuse = self._may_refuse(call)
        error, given = None, Given()
        try:
            given = self._make(call)
        except Exception as raised:  # judged by the invariants
            error = raised
        q = self.inner.q.reshape(self.case["num_envs"], -1)
        return EpisodeStep(call, before, self.core.get_state(), q, error, given, may_refuse)

    def _may_refuse(self, call: dict[str, Any]) -> bool:
        """Whether a call may be refused because of the present lanes or actions."""
        if call["call"] == "step" and not call.get("refused"):
            bad = not np.isfinite(numbers(call["actions"])).all()
            waits = bool(self._waits_for_reset and self.ended.any())
            return waits or self.over or (bad and self.case["on_bad_action"] == "raise")
        return bool(call.get("refusable"))

    @property
    def _waits_for_reset(self) -> bool:
        return self.case["face"] == "vector" and self.case["autoreset_mode"] == "disabled"

    def _make(self, call: dict[str, Any]) -> Given:
        kind = call["call"]
        if kind == "step":
            return self._step(call)
        if kind == "reset":
            return self._reset(call)
        if kind == "save":
            ends = (self.ended.copy(), self.over)
            self.saved = (self.inner.get_state(), ends, copy.deepcopy(self._limit()))
        elif kind == "restore":
            if self.saved is not None:
                state, (ended, self.over), limit = self.saved
                self.inner.set_state(state)
                self.ended = ended.copy()
                self._limit().update(limit)
        elif kind == "copy":
            self.env = copy.deepcopy(self.env)
        elif kind == "pickle":
            self.env = pickle.loads(pickle.dumps(self.env))
        elif kind == "observe":
            assert np.array(self.inner.tip).shape == np.array(self.inner.goal).shape
        else:
            raise LookupError(f"no call {kind!r}")
        return Given()

    def _limit(self) -> dict[str, Any]:
        """State of the wrapper that counts the steps of a single environment."""
        wrapper = self.env
        while isinstance(wrapper, gym.Wrapper):
            if isinstance(wrapper, gym.wrappers.TimeLimit):
                found: dict[str, Any] = wrapper.__dict__
                return _Steps(found)
            wrapper = wrapper.env
        return {}

    def _step(self, call: dict[str, Any]) -> Given:
        actions: Any = call["actions"]
        if not call.get("text"):
            actions = numbers(actions)
            actions = actions if call.get("float64") else actions.astype(np.float32)
        single = self.case["face"] == "env"
        if single:
            actions = actions[0]
        if self.case["face"] == "sb3":
            obs, reward, dones, infos = self.env.step(actions)
            truncated = np.array([info["TimeLimit.truncated"] for info in infos])
            last = {n: parts(infos[n]["terminal_observation"], False) for n in np.flatnonzero(dones).tolist()}
            self.ended[:] = False
            return Given(parts(obs, True), reward, dones & ~truncated, truncated, last)
        obs, reward, terminated, truncated, infos = self.env.step(actions)
        row = [np.atleast_1d(np.array(x)) for x in (reward, terminated, truncated)]
        last = {}
        if "final_obs" in infos:
            for n in np.flatnonzero(infos["_final_obs"]).tolist():
                last[n] = parts(infos["final_obs"][n], False)
        self.ended, self.over = row[1] | row[2], single and bool(row[1][0])
        return Given(parts(obs, not single), row[0], row[1], row[2], last)

    def _reset(self, call: dict[str, Any]) -> Given:
        options = {name: self._option(name, x) for name, x in (call.get("options") or {}).items()}
        seeds, lanes = call.get("seed"), lanes_of(self.case, call)
        face = self.case["face"]
        if face == "sb3":
            per_lane = [self._of_lane(options, call, k) for k in range(self.case["num_envs"])]
            self.env.set_options(per_lane)
            if seeds is not None:
                self.env._seeds = list(seeds)  # seed(s) gives s, s + 1, ...; here lanes are in any order
            obs: Any = self.env.reset()
            return Given(parts(obs, True))
        if face == "env":
            obs, _ = self.env.reset(seed=seeds and seeds[0], options=options)
            self.ended[:], self.over = False, False
            return Given(parts(obs, False))
        mask = np.zeros(self.case["num_envs"], np.bool_)
        mask[lanes] = True
        wanted = None
        if seeds is not None:
            wanted = [None] * self.case["num_envs"]
            for lane, seed in zip(lanes, seeds, strict=True):
                wanted[lane] = seed
        if not mask.all():
            options["reset_mask"] = mask
        obs, _ = self.env.reset(seed=wanted, options=options)
        self.ended = self.ended & ~mask
        return Given(parts(obs, True))

    @staticmethod
    def _option(name: str, value: Any) -> Any:
        if name == "parameters" and isinstance(value, dict):
            return {key: numbers(x) for key, x in value.items()}
        return numbers(value) if isinstance(value, list) else value

    @staticmethod
    def _of_lane(options: dict[str, Any], call: dict[str, Any], lane: int) -> dict[str, Any]:
        """The options of one lane: its rows of tables."""
        own = dict(options)
        for name in call.get("of_lanes", ()):
            if name in own:
                own[name] = own[name][lane]
        if "parameters" in own and call.get("of_lanes") is not None:
            own["parameters"] = {k: x[lane] if x.ndim == 2 else x for k, x in own["parameters"].items()}
        return own


class _Steps(dict[str, Any]):
    """The counter of a wrapper, to be kept and put back."""

    def __init__(self, attributes: dict[str, Any]) -> None:
        super().__init__(_elapsed_steps=attributes["_elapsed_steps"])
        self.attributes = attributes

    def __deepcopy__(self, memo: dict[int, Any]) -> dict[str, Any]:
        return dict(self)

    def update(self, other: Any = (), **_: Any) -> None:
        self.attributes.update(other)


def play_episodes(case: Case, make: Make = made) -> list[EpisodeStep]:
    """All calls of a case."""
    player = EpisodePlayer(case, make)
    return [player.play(call) for call in case["calls"]]
