"""verify finds what leaks, forgets or differs in the machinery of lanes, evaluators and environments."""

import copy

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs import algebra
from redundant_envs.effects import Actuation, Effect, State
from redundant_envs.envs.core import Core
from redundant_envs.envs.env import ArmEnv
from redundant_envs.envs.vector_env import ArmVectorEnv
from redundant_envs.events import contacts
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.model.memory import Memory
from redundant_envs.verify import Subject, bits, environments, evaluators, impacts, recorded_bits, verify
from redundant_envs.verify.checks import Mode, Trial, Verdict, checks_of
from redundant_envs.verify.subjects import subject_of

e = rde.effects
BITS = tuple(c for c in checks_of(bits) if c is not bits.record)
STATES = 80


@algebra.physics
def renewed(command):
    return command


@algebra.physics
def effort_of(waiting):
    return waiting


class Late(Effect):
    """The command of the previous interval acts: a state of the first motor."""

    def hooks(self, arm):
        kept = State("waiting", "N m", update=renewed, bind={"command": "command1"})
        return (Actuation(0, effort_of, {"waiting": ".waiting"}, states=(kept,)),)


SCENE = rde.Scene(rde.FourR((2.0, 1.5, 1.0, 0.5), (0.3, 0.5, 0.4, 0.6)), (e.Gravity(), Late()), "rk4", 0.01)


def red(thing, checks):
    report = verify(thing, STATES, Mode.FULL, checks=checks)
    assert all(np.isfinite(o.finding.found) for o in report.outcomes if o.verdict is Verdict.MISSED)
    return {o.check for o in report.outcomes if o.verdict is Verdict.MISSED}


def shown(change):
    """``batch.q`` with coordinates that are modified by a function of the batch and of the coordinates."""
    read = BatchSimulator.q.fget
    return "q", property(lambda batch: change(batch, read(batch)))


def forgetful(self, snapshot):
    check = RESTORE(self, snapshot)
    self._memory.write(tuple(self.simulator.dynamics.effect_states), 0.0)
    return check


def rounded(self):
    arrays = {name: array.astype(np.float32).astype(float) for name, array in self.arrays.items()}
    return {**self.__dict__, "arrays": arrays}


RESTORE = BatchSimulator.restore
LEAKS = {
    "place": (
        BatchSimulator, shown(lambda b, q: q + 1e-15 * np.arange(len(q))[:, None]), {"bits: batch and place"},
    ),
    "neighbours": (
        BatchSimulator,
        shown(lambda b, q: q + 1e-199 * np.abs(b.qd).max(initial=0.0)),
        {"bits: neighbours"},
    ),
    "threads": (
        BatchSimulator, shown(lambda b, q: q + 1e-12 * (b.threads > 1)), {"bits: threads"},
    ),
    "parameters": (
        BatchSimulator,
        shown(lambda b, q: q + 1e-12 * (not b._memory.shared)),
        {"bits: parameters of lanes"},
    ),
    "a copy that is the original": (
        BatchSimulator, ("__deepcopy__", lambda self, memo: self), {"bits: copies"},
    ),
    "copies that are rounded": (Memory, ("__getstate__", rounded), {"bits: copies", "bits: pickles"}),
    "a snapshot that forgets the states of effects": (
        BatchSimulator, ("restore", forgetful), {"bits: snapshots"},
    ),
}  # fmt: skip


def test_bits_of_a_scene_are_green():
    assert red(SCENE, BITS) == set()


@pytest.mark.parametrize(("kind", "change", "names"), LEAKS.values(), ids=LEAKS)
def test_a_leak_is_red_and_named(kind, change, names, monkeypatch):
    monkeypatch.setattr(kind, *change)
    assert red(SCENE, BITS) == names


def test_every_check_of_bits_is_seen_red():
    assert {c.name for c in BITS} == set().union(*(names for *_, names in LEAKS.values()))


def test_another_record_is_red(monkeypatch):
    trial = Trial(Subject("this machine", SCENE), 1, Mode.QUICK)
    assert bits.record.run(trial).verdict is Verdict.KEPT
    monkeypatch.setattr(recorded_bits, "recorded", lambda: dict.fromkeys(recorded_bits.RECORDED, "0"))
    outcome = bits.record.run(trial)
    assert outcome.verdict is Verdict.MISSED
    assert "4R all rk8" in outcome.finding.words


# ---- evaluators ----------------------------------------------------------------------------------------


def test_an_evaluator_that_differs_is_red(monkeypatch):
    checks = evaluators.arrays, evaluators.singles
    assert red(SCENE, checks) == set()
    arrays = algebra._registered[np.ndarray]
    off = arrays._replace(sincos=lambda x: (np.sin(x), np.cos(x) + 1e-7))
    monkeypatch.setitem(algebra._registered, np.ndarray, off)
    algebra._found.clear()
    assert red(SCENE, checks) == {"evaluators: NumPy"}
    monkeypatch.undo()
    algebra._found.clear()
    fields = evaluators.fields_of
    monkeypatch.setattr(
        evaluators, "fields_of", lambda dynamics: {n: 1.001 * v for n, v in fields(dynamics).items()}
    )
    assert red(SCENE, checks) == {"evaluators: NumPy", "evaluators: single numbers"}


@pytest.mark.long
def test_torch_that_differs_is_red(monkeypatch):
    """Long because of the import of torch; NumPy and single numbers are checked in the same way."""
    pytest.importorskip("torch", reason="torch is in the extra 'train'")
    assert red(SCENE, (evaluators.tensors,)) == set()
    fields = evaluators.fields_of
    monkeypatch.setattr(
        evaluators, "fields_of", lambda dynamics: {n: 1.001 * v for n, v in fields(dynamics).items()}
    )
    assert red(SCENE, (evaluators.tensors,)) == {"evaluators: torch"}


# ---- impacts -------------------------------------------------------------------------------------------


def test_a_restitution_that_is_not_the_scenes_is_red(monkeypatch):
    class Stop(e.PrismaticStop):
        """Traced again each time."""

    arm = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))
    scene = rde.Scene(arm, (e.Gravity(), Stop((0.0, 0.0), (0.3, 0.3), 0.5)), tolerance=1e-6)
    checks = checks_of(impacts)
    assert red(scene, checks) == set()
    right = contacts.impulses

    def wrong(speeds, sides, w, restitution):
        return right(speeds, sides, w, [0.99 * x for x in restitution])

    monkeypatch.setattr(contacts, "impulses", wrong)
    assert red(scene, checks) == {"impacts: velocities", "impacts: momentum", "impacts: energy"}


def test_a_slider_beyond_its_stop_is_red(monkeypatch):
    monkeypatch.setattr(BatchSimulator, *shown(lambda batch, q: q + np.array([0.0, 1e-15, 0.0, 0.0])))
    assert red(rde.load_scene("rprp_stops"), (impacts.inside,)) == {"impacts: no slider beyond its stop"}


# ---- environments --------------------------------------------------------------------------------------


def _step(self, actions, right=ArmEnv.step):
    obs, reward, *rest = right(self, actions)
    return obs, reward + 1e-9, *rest


def _vector_step(self, actions, right=ArmVectorEnv.step):
    obs, reward, *rest = right(self, actions)
    return obs, reward.tolist(), *rest


def _threads(self, actions, right=ArmVectorEnv.step):
    obs, reward, *rest = right(self, actions)
    return obs, reward + 1e-9 * (self.core.threads > 1), *rest


def _late_nan(self, actions, right=ArmVectorEnv.step):
    """Beyond the range of short episodes."""
    obs, reward, terminated, truncated, infos = right(self, actions)
    return obs, np.where(infos["episode_steps"] == 40, np.nan, reward), terminated, truncated, infos


def _late_observation(self, actions, right=ArmVectorEnv.step):
    obs, reward, terminated, truncated, infos = right(self, actions)
    obs = np.where(infos["episode_steps"][:, None] == 40, np.float32(1.001), obs)
    return obs, reward, terminated, truncated, infos


def _late_metric(self, actions, right=ArmVectorEnv.step):
    *rest, infos = right(self, actions)
    distance = np.where(infos["episode_steps"] == 40, np.inf, infos["distance"])
    return *rest, {**infos, "distance": distance}


def _metric_of_no_action(self, actions, right=ArmVectorEnv.step):
    """A share of the actions, which is NaN without actions: a division that a task may contain."""
    *rest, infos = right(self, actions)
    with np.errstate(all="ignore"):
        share = np.abs(actions[:, 0]) / np.abs(actions).sum(axis=1) + 0.0 * infos["distance"]
    late = infos["episode_steps"] > 20
    return *rest, {**infos, "distance": np.where(late, share, infos["distance"])}


def _set_state(self, state, right=Core.set_state):
    return right(self, {**state, "generators": copy.deepcopy(self.generators)})


BROKEN = {
    "rewards of a vector": (ArmVectorEnv, "step", _vector_step, "environment: rules of vectors"),
    "reward of a single environment": (ArmEnv, "step", _step, "environment: single and vector"),
    "rewards without a number": (ArmVectorEnv, "step", _late_nan, "environment: ranges"),
    "observations outside their space": (ArmVectorEnv, "step", _late_observation, "environment: ranges"),
    "metrics without a number": (ArmVectorEnv, "step", _late_metric, "environment: ranges"),
    "metrics without an action": (ArmVectorEnv, "step", _metric_of_no_action, "environment: ranges"),
    "a state without its generators": (Core, "set_state", _set_state, "environment: states"),
    "a copy that is the original": (
        ArmVectorEnv, "__deepcopy__", lambda self, memo: self, "environment: copies",
    ),
    "threads": (ArmVectorEnv, "step", _threads, "environment: seeds, threads and neighbours"),
}  # fmt: skip


@pytest.mark.parametrize("word", ["FourRReach-v0", "RPRPGoalReach-v0"])
def test_environments_are_green(word):
    assert red(subject_of(word), checks_of(environments)) == set()


@pytest.mark.parametrize(("kind", "method", "wrong", "name"), BROKEN.values(), ids=BROKEN)
def test_a_broken_environment_is_red_and_named(kind, method, wrong, name, monkeypatch):
    monkeypatch.setattr(kind, method, wrong, raising=False)
    assert red(subject_of("FourRReach-v0"), checks_of(environments)) == {name}


def test_every_check_of_environments_is_seen_red():
    assert {c.name for c in checks_of(environments)} == {name for *_, name in BROKEN.values()}
