"""Playing cases: every call of a simulator or an environment, its results, and the lanes before and after."""

import copy
import io
import pickle
from dataclasses import dataclass, field

import gymnasium as gym
import numpy as np

import redundant_envs as rde
from redundant_envs.model.batch import draws_of

from .cases import ENVIRONMENTS, lanes_of, taken


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
        return self.told | {name: self.after[name] for name in LANES if name in self.after}


LANES = ("q", "qd", "z", "work", "values")
"""Numbers of lanes: in simulators all, ``values`` in the order of ``Scene.parameters()``; in others q."""


class Player:
    """A simulator or an environment of a case, and what its calls need; its methods are the calls."""

    def __init__(self, case, make=rde.BatchSimulator):
        self.case, self.make, self.scene = case, make, rde.Scene.from_dict(case["scene"])
        self.subject, self.saved = self.made(), None

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

    def refusal(self, call):
        """Whether a call may be refused, and the pattern of the message if it must be."""
        return bool(call.get("refusable")), call.get("refused")

    def save(self, call):
        self.saved = self.kept()

    def restore(self, call):
        if self.saved is not None:
            self.put(self.saved)

    def copy(self, call):
        self.subject = copy.deepcopy(self.subject)

    def pickle(self, call):
        self.subject = pickle.loads(pickle.dumps(self.subject))


class SimulatorPlayer(Player):
    def made(self):
        batch = self.make(self.scene, self.case["num_envs"], self.case["threads"], track_work=True)
        if batch.draws.size and "draws" in self.case:
            batch.set_draws(draws_of(0, np.array(self.case["draws"])))
        return batch

    def now(self):
        return lanes_now(self.subject)

    def kept(self):
        return self.subject.save()

    def put(self, snapshot):
        self.subject.restore(snapshot)

    def advance(self, call):
        return told(self.subject.advance(call["efforts"]))

    def advance_partly(self, call):
        return told(self.subject.advance_partly(call["efforts"], call["duration"]))

    def set_state(self, call):
        self.subject.set_state(call["q"], call["qd"], call.get("lanes"))

    def set_parameters(self, call):
        self.subject.set_parameters(call["parameters"], call.get("lanes"))

    def anew(self, call):
        """Another simulator, restored from a file."""
        file, other = io.BytesIO(), self.made()
        np.savez(file, **self.kept())
        file.seek(0)
        with np.load(file) as snapshot:
            other.restore(dict(snapshot))
        self.subject = other


def told(status):
    return {name: np.array(value) for name, value in status._asdict().items()}


def lanes_now(batch):
    names = tuple(batch.simulator.dynamics.parameters.field_of(p) for p in batch.scene.parameters())
    values = batch._memory.read(names)
    found = {"q": batch.q, "qd": batch.qd, "z": batch.z, "work": batch.work, "values": values}
    return found | {"draws": batch.draws}


class EnvironmentPlayer(Player):
    """``ended``: lanes whose last step ended an episode; ``over``: a fault did in a single environment."""

    def __init__(self, case, make=None):
        super().__init__(case, make)
        self.single, self.mode = case["face"] == "env", case["autoreset_mode"]
        self.ready, self.ended, self.over = False, np.zeros(case["num_envs"], np.bool_), False

    def made(self):
        case = self.case
        env_id = f"redundant_envs/{case['scene']['robot']['type']}{'Goal' if case['goal'] else ''}Reach-v0"
        arguments = {name: case[name] for name in ("scene", "on_bad_action", "max_episode_steps", "task")}
        if case["face"] == "env":
            return gym.make(env_id, disable_env_checker=True, **arguments)
        arguments |= {"num_envs": case["num_envs"], "threads": case["threads"]}
        if case["face"] == "sb3":
            return rde.make_sb3(env_id, **arguments)
        return gym.make_vec(env_id, autoreset_mode=case["autoreset_mode"], **arguments)

    @property
    def inner(self):
        return getattr(self.subject, "unwrapped", self.subject)

    def now(self):
        state = self.inner.core.get_state()
        found = {name: state[name] for name in ("states", "parameters", "keys", "mask", "waiting")}
        memory = self.inner.core.memory
        if "evaluations_sum" in memory:
            found["evaluations"] = memory.read(("evaluations_sum",))
        return found | {"q": np.array(self.inner.q).reshape(self.case["num_envs"], -1)}

    def kept(self):
        counted = self.single and self.subject.get_wrapper_attr("_elapsed_steps")
        return self.inner.get_state(), counted, self.ready, self.ended.copy(), self.over

    def put(self, kept):
        state, counted, self.ready, ended, self.over = kept
        self.inner.set_state(state)
        self.ended = ended.copy()
        if self.single:
            self.subject.set_wrapper_attr("_elapsed_steps", counted)

    def anew(self, call):
        """Another environment, set to the state."""
        kept = self.kept()
        self.subject = self.made()
        if self.ready:
            self.subject.reset()  # wrappers insist on it
            self.put(kept)

    def refusal(self, call):
        may, must = super().refusal(call)
        if call["call"] != "step":
            return may, must
        bad = (
            must is None and self.case["on_bad_action"] == "raise" and not np.isfinite(call["actions"]).all()
        )
        waits = self.case["face"] == "vector" and self.mode == "disabled" and self.ended.any()
        reasons = {
            must or "": must is not None, "before reset": not self.ready, "after the end": self.over,
            "have ended": waits, "non-finite": bad and self.single,
        }  # fmt: skip
        found = [reason for reason, holds in reasons.items() if holds]
        return bad, None if not found else found[0] if len(found) == 1 else ""

    def step(self, call):
        actions = call["actions"]
        if actions.dtype.kind == "f" and not call.get("float64"):
            actions = actions.astype(np.float32)
        if self.case["face"] == "sb3":
            obs, reward, dones, infos = self.subject.step(actions)
            truncated = np.array([info["TimeLimit.truncated"] for info in infos])
            terminated, self.ended[:] = dones & ~truncated, False
            last = {n: infos[n]["terminal_observation"] for n in np.flatnonzero(dones)}
        else:
            obs, *ends, infos = self.subject.step(actions[0] if self.single else actions)
            reward, terminated, truncated = (np.atleast_1d(np.array(x)) for x in ends)
            last = {n: infos["final_obs"][n] for n in np.flatnonzero(infos.get("_final_obs", ()))}
            self.ended, self.over = terminated | truncated, self.single and bool(terminated[0])
        found = {"reward": reward, "terminated": terminated, "truncated": truncated}
        # Last observations of lanes whose next episode has begun: which lanes, and NaN elsewhere.
        found["begun"] = np.isin(np.arange(self.case["num_envs"]), list(last))
        for name, table in self.tables(obs).items():
            ends = found[f"last {name}"] = np.full_like(table, np.nan)
            for lane, one in last.items():
                ends[lane] = named(one)[name]
        return found | self.now_told(obs)

    def tables(self, obs):
        """The parts of an observation, with a row for each lane."""
        return {k: np.array(x).reshape(self.case["num_envs"], -1) for k, x in named(obs).items()}

    def now_told(self, obs):
        return {f"now {name}": table for name, table in self.tables(obs).items()}

    def reset(self, call):
        count, lanes, options = self.case["num_envs"], lanes_of(self.case, call), call.get("options", {})
        seeds = call["seed"].tolist() if "seed" in call else None
        if self.case["face"] == "sb3":
            own = "options" in call.get("rows", {})
            self.subject.set_options([of_lane(options, k) if own else options for k in range(count)])
            if seeds is not None:
                self.subject._seeds = seeds  # seed(s) gives s, s + 1, ...; here lanes are in any order
            obs = self.subject.reset()
        elif self.single:
            obs, _ = self.subject.reset(seed=seeds and seeds[0], options=options)
        else:
            of_lanes = dict(zip(lanes, seeds or (), strict=False))
            if len(lanes) < count:
                options = {**options, "reset_mask": np.isin(np.arange(count), lanes)}
            wanted = None if seeds is None else [of_lanes.get(k) for k in range(count)]
            obs, _ = self.subject.reset(seed=wanted, options=options)
        self.ready, self.ended[lanes], self.over = True, False, False
        return self.now_told(obs)


def named(obs):
    return obs if isinstance(obs, dict) else {"": obs}


def arrays(rows):
    return {name: arrays(x) if isinstance(x, dict) else np.array(x) for name, x in rows.items()}


def of_lane(options, lane):
    """The rows of one lane of options."""
    return {name: of_lane(x, lane) if isinstance(x, dict) else x[lane] for name, x in options.items()}


def play(case, make=rde.BatchSimulator):
    """All calls of a case; a LookupError if its initial state is not accepted."""
    player = (EnvironmentPlayer if case["face"] in ENVIRONMENTS else SimulatorPlayer)(case, make)
    steps = [player.play(call) for call in case["calls"]]
    first = steps[0]
    if case["face"] == "simulator" and (
        first.call["call"] != "set_state" or isinstance(first.error, ValueError)
    ):
        raise LookupError(f"the case does not begin with a state: {first.error}")
    return steps


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
