"""Playing cases: every call of an environment, its results, and the lanes before and after."""

import copy
import pickle
from dataclasses import dataclass, field

import gymnasium as gym
import numpy as np

from .cases import lanes_of, taken


@dataclass
class Step:
    """A call that was played."""

    call: dict  # with arrays for its lanes in place of "rows"
    before: dict  # arrays with all that determines the continuation
    may_refuse: bool  # because of its arguments, the present lanes or actions
    must_refuse: str | None  # a pattern of the message; None: it need not be refused
    after: dict = field(default_factory=dict)
    told: dict = field(default_factory=dict)  # results: arrays with a row for each lane
    error: Exception | None = None

    def rows(self):
        """Everything that has a row for each lane."""
        return self.told | {"q": self.after["q"]}


class Player:
    """A vector of a case, and what its calls need; its methods are the calls."""

    def __init__(self, case):
        self.case = case
        self.id = f"redundant_envs/{case['scene']['robot']['type']}{'Goal' * case['goal']}Reach-v0"
        self.env, self.saved = self.made(), None
        self.ready, self.ended = False, np.zeros(case["num_envs"], np.bool_)  # lanes whose episode ended

    def made(self):
        names = "scene on_bad_action max_episode_steps task num_envs threads autoreset_mode"
        return gym.make_vec(self.id, **{name: self.case[name] for name in names.split()})

    def play(self, call):
        """Make a call; any exception is kept."""
        call = {**call, **arrays(taken(call.get("rows", {}), lanes_of(self.case, call)))}
        step = Step(call, self.now(), *self.refusal(call))
        try:
            step.told = getattr(self, call["call"])(call) or {}
        except Exception as raised:  # judged by the invariants
            step.error = raised
        step.after = self.now()
        return step

    def now(self):
        state = self.env.unwrapped.core.get_state()
        found = {name: state[name] for name in ("states", "parameters", "keys", "mask", "waiting")}
        return found | {"q": np.array(self.env.unwrapped.q)}

    def kept(self):
        return self.env.unwrapped.get_state(), self.ready, self.ended.copy()

    def put(self, kept):
        state, self.ready, ended = kept
        self.env.unwrapped.set_state(state)
        self.ended = ended.copy()

    def save(self, call):
        self.saved = self.kept()

    def restore(self, call):
        if self.saved is not None:
            self.put(self.saved)

    def copy(self, call):
        self.env = copy.deepcopy(self.env)

    def pickle(self, call):
        self.env = pickle.loads(pickle.dumps(self.env))

    def anew(self, call):
        """Another environment, set to the state."""
        kept = self.kept()
        self.env = self.made()
        if self.ready:
            self.env.reset()  # wrappers insist on it
            self.put(kept)

    def refusal(self, call):
        """Whether a call may be refused, and the pattern of the message if it must be."""
        may, must = bool(call.get("refusable")), call.get("refused")
        if call["call"] != "step":
            return may, must
        raises = must is None and self.case["on_bad_action"] == "raise"
        reasons = {
            must or "": must is not None,
            "before reset": not self.ready,
            "have ended": self.case["autoreset_mode"] == "disabled" and self.ended.any(),
            "non-finite": raises and not np.isfinite(call["actions"]).all(),
        }
        found = [reason for reason, holds in reasons.items() if holds]
        return may, None if not found else found[0] if len(found) == 1 else ""

    def step(self, call):
        actions = call["actions"]
        if actions.dtype.kind == "f" and not call.get("float64"):
            actions = actions.astype(np.float32)
        obs, reward, terminated, truncated, infos = self.env.step(actions)
        self.ended = terminated | truncated
        found = {"reward": np.array(reward), "terminated": terminated, "truncated": truncated}
        for name, table in named(obs).items():
            ends = found[f"last {name}"] = np.array(table)
            for lane in np.flatnonzero(infos.get("_final_obs", ())):
                ends[lane] = named(infos["final_obs"][lane])[name]
        return found | now_told(obs)

    def reset(self, call):
        count, lanes, options = self.case["num_envs"], lanes_of(self.case, call), call.get("options", {})
        of_lanes = dict(zip(lanes, call["seed"].tolist(), strict=True)) if "seed" in call else None
        if len(lanes) < count:
            options = {**options, "reset_mask": np.isin(np.arange(count), lanes)}
        seeds = None if of_lanes is None else [of_lanes.get(k) for k in range(count)]
        obs, _ = self.env.reset(seed=seeds, options=options)
        self.ready, self.ended[lanes] = True, False
        return now_told(obs)


def now_told(obs):
    return {f"now {name}": np.array(table) for name, table in named(obs).items()}


def named(obs):
    return obs if isinstance(obs, dict) else {"": obs}


def arrays(rows):
    return {name: arrays(x) if isinstance(x, dict) else np.array(x) for name, x in rows.items()}


def play(case):
    """All calls of a case."""
    player = Player(case)
    return [player.play(call) for call in case["calls"]]


def same(one, other):
    """Entries in which two arrays have the same bits; all NaN count as equal."""
    if one.dtype.kind != "f":
        return one == other
    whole = {8: np.int64, 4: np.int32}[one.dtype.itemsize]
    bits = np.ascontiguousarray(one).view(whole) == np.ascontiguousarray(other).view(whole)
    return bits | (np.isnan(one) & np.isnan(other))


def differing(one, other, order):
    """The lanes of an order whose rows in some tables are not those of others to the last bit."""
    apart = np.zeros(len(order), np.bool_)
    for name, table in one.items():
        apart |= ~same(table[order], other[name]).reshape(len(order), -1).all(axis=1)
    return [order[k] for k in np.flatnonzero(apart)]
