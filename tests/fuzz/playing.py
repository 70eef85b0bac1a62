"""Playing cases: every call of a simulator or an environment, its results, and the lanes before and after."""

import copy
import io
import pickle
from dataclasses import dataclass, field
from types import SimpleNamespace

import gymnasium as gym
import numpy as np

import redundant_envs as rde

from .cases import ENVIRONMENTS, lanes_of, numbers


@dataclass
class Step:
    """A call that was played."""

    call: dict
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

    copied = staticmethod(copy.deepcopy)

    def __init__(self, case, make=rde.BatchSimulator):
        self.case, self.make, self.scene = case, make, rde.Scene.from_dict(case["scene"])
        self.subject, self.saved = self.made(), None

    def play(self, call):
        """Make a call; any exception is kept."""
        step = Step(call, self.now(), *self.refusal(call))
        try:
            step.told = getattr(self, call["call"])(call) or {}
        except Exception as raised:  # judged by the invariants
            step.error = raised
        step.after = self.now()
        return step

    def refusal(self, call):
        """Whether a call may be refused, and the pattern of the message if it must be."""
        refused = call.get("refused", False)
        return bool(call.get("refusable")), {True: "", False: None}.get(refused, refused)

    def save(self, call):
        self.saved = self.kept()

    def restore(self, call):
        if self.saved is not None:
            self.put(self.saved)

    def copy(self, call):
        self.subject = self.copied(self.subject)

    def pickle(self, call):
        self.subject = pickle.loads(pickle.dumps(self.subject))


class SimulatorPlayer(Player):
    copied = staticmethod(copy.copy)

    def made(self):
        return self.make(self.scene, self.case["num_envs"], self.case["threads"], track_work=True)

    def now(self):
        return lanes_now(self.subject)

    def kept(self):
        return self.subject.save()

    def put(self, snapshot):
        self.subject.restore(snapshot)

    def advance(self, call):
        told = self.subject.advance(numbers(call["efforts"]))
        return {name: np.array(value) for name, value in told._asdict().items()}

    def advance_partly(self, call):
        told = self.subject.advance_partly(numbers(call["efforts"]), call["duration"])
        return {name: np.array(value) for name, value in told._asdict().items()}

    def set_state(self, call):
        q = call["q"] if call.get("text") else numbers(call["q"])
        self.subject.set_state(q, numbers(call["qd"]), call.get("lanes"))

    def set_parameters(self, call):
        values = {name: numbers(value) for name, value in call["parameters"].items()}
        self.subject.set_parameters(values, lanes_of(self.case, call))

    def anew(self, call):
        """Another simulator, restored from a file."""
        file, other = io.BytesIO(), self.made()
        np.savez(file, **self.kept())
        file.seek(0)
        with np.load(file) as snapshot:
            other.restore(dict(snapshot))
        self.subject = other


def lanes_now(batch):
    names = tuple(batch.simulator.dynamics.field_of(p) for p in batch.scene.parameters())
    values = batch._memory.read(names)
    return {"q": batch.q, "qd": batch.qd, "z": batch.z, "work": batch.work, "values": values}


class EnvironmentPlayer(Player):
    """``ended``: lanes whose last step ended an episode; ``over``: a fault did in a single environment."""

    def __init__(self, case, make=None):
        super().__init__(case, make)
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
        env = self.subject
        return env.unwrapped if isinstance(env, gym.Env | gym.vector.VectorEnv) else env

    @property
    def counter(self):
        """The wrapper that counts the steps of a single environment."""
        env = self.subject
        while isinstance(env, gym.Wrapper):
            if isinstance(env, gym.wrappers.TimeLimit):
                return env
            env = env.env
        return SimpleNamespace(_elapsed_steps=None)

    def now(self):
        state = self.inner.core.get_state()
        told = {name: state[name] for name in ("states", "parameters", "keys", "mask", "waiting")}
        return told | {"q": np.array(self.inner.q).reshape(self.case["num_envs"], -1)}

    def kept(self):
        counted = self.counter._elapsed_steps
        return self.inner.get_state(), counted, self.ready, self.ended.copy(), self.over

    def put(self, kept):
        state, self.counter._elapsed_steps, self.ready, ended, self.over = kept
        self.inner.set_state(state)
        self.ended = ended.copy()

    def anew(self, call):
        """Another environment, set to the state."""
        kept = self.kept()
        self.subject = self.made()
        if self.ready:
            self.subject.reset()  # wrappers insist on it
            self.put(kept)

    def observe(self, call):
        assert np.array(self.inner.tip).shape == np.array(self.inner.goal).shape

    def refusal(self, call):
        may, must = super().refusal(call)
        if call["call"] != "step":
            return may, must
        case, reasons = self.case, [] if must is None else [must]
        bad = (
            not reasons
            and not np.isfinite(numbers(call["actions"])).all()
            and case["on_bad_action"] == "raise"
        )
        waits = case["face"] == "vector" and case["autoreset_mode"] == "disabled" and self.ended.any()
        single = case["face"] == "env"
        reasons += ["before reset"] * (not self.ready) + ["after the end"] * self.over
        reasons += ["have ended"] * bool(waits) + ["non-finite"] * (bad and single)
        return bad, None if not reasons else reasons[0] if len(reasons) == 1 else ""

    def step(self, call):
        actions = call["actions"]
        if not call.get("text"):
            actions = numbers(actions).astype(np.float64 if call.get("float64") else np.float32)
        if self.case["face"] == "sb3":
            obs, reward, dones, infos = self.subject.step(actions)
            truncated = np.array([info["TimeLimit.truncated"] for info in infos])
            terminated, self.ended[:] = dones & ~truncated, False
            last = {n: infos[n]["terminal_observation"] for n in np.flatnonzero(dones)}
        else:
            single = self.case["face"] == "env"
            obs, *ends, infos = self.subject.step(actions[0] if single else actions)
            reward, terminated, truncated = (np.atleast_1d(np.array(x)) for x in ends)
            last = {n: infos["final_obs"][n] for n in np.flatnonzero(infos.get("_final_obs", ()))}
            self.ended, self.over = terminated | truncated, single and bool(terminated[0])
        told = {"reward": reward, "terminated": terminated, "truncated": truncated}
        return told | self.tables(obs, "now") | self.last(self.tables(obs, "last"), last)

    def tables(self, obs, when):
        """The parts of an observation, with a row for each lane."""
        count = self.case["num_envs"]
        return {f"{when} {name}": np.array(x).reshape(count, -1) for name, x in named(obs).items()}

    def last(self, tables, last):
        """The last observations of lanes whose next episode has begun: which lanes, and NaN elsewhere."""
        told = {name: np.full_like(table, np.nan) for name, table in tables.items()}
        for lane, obs in last.items():
            for name, row in named(obs).items():
                told[f"last {name}"][lane] = row
        return told | {"begun": np.isin(np.arange(self.case["num_envs"]), list(last))}

    def reset(self, call):
        count, lanes, seeds = self.case["num_envs"], lanes_of(self.case, call), call.get("seed")
        options, face = given(call.get("options") or {}), self.case["face"]
        if face == "sb3":
            own = "of_lanes" in call
            self.subject.set_options([of_lane(options, k) if own else options for k in range(count)])
            if seeds is not None:
                self.subject._seeds = list(seeds)  # seed(s) gives s, s + 1, ...; here lanes are in any order
            obs = self.subject.reset()
        elif face == "env":
            obs, _ = self.subject.reset(seed=seeds and seeds[0], options=options)
        else:
            of_lanes = None if seeds is None else dict(zip(lanes, seeds, strict=True))
            wanted = None if of_lanes is None else [of_lanes.get(k) for k in range(count)]
            if len(lanes) < count:
                options["reset_mask"] = np.isin(np.arange(count), lanes)
            obs, _ = self.subject.reset(seed=wanted, options=options)
        self.ready, self.ended[lanes], self.over = True, False, False
        return self.tables(obs, "now")


def named(obs):
    return obs if isinstance(obs, dict) else {"": obs}


def given(options):
    """Options of a reset with arrays in place of lists."""
    return {
        name: given(x) if isinstance(x, dict) else numbers(x) if isinstance(x, list) else x
        for name, x in options.items()
    }


def of_lane(options, lane):
    """The rows of one lane of options."""
    return {name: of_lane(x, lane) if isinstance(x, dict) else x[lane] for name, x in options.items()}


def play(case, make=rde.BatchSimulator):
    """All calls of a case; a LookupError if its initial state is not accepted."""
    face = case["face"]
    player = (EnvironmentPlayer if face in ENVIRONMENTS else SimulatorPlayer)(case, make)
    steps = [player.play(call) for call in case["calls"]]
    first = steps[0]
    if face == "simulator" and (first.call["call"] != "set_state" or isinstance(first.error, ValueError)):
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
