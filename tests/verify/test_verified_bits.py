"""verify finds what leaks, forgets or differs in the machinery of lanes, evaluators and environments."""

import copy

import numpy as np
import pytest
from catalogue import FOUR_R

import redundant_envs as rde
from redundant_envs.envs.core import Core
from redundant_envs.envs.env import ArmEnv
from redundant_envs.envs.vector_env import ArmVectorEnv
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.model.memory import Memory
from redundant_envs.verify import bits, environments, evaluators, impacts, verify
from redundant_envs.verify.checks import checks_of
from redundant_envs.verify.promises import Mode, Verdict
from redundant_envs.verify.subjects import subject_of

e = rde.effects
BITS = checks_of(bits)
STATES = 80
SCENE = rde.Scene(FOUR_R, (e.Gravity(), e.Lag(0.05)), "rk4", 0.01)


def red(thing, checks):
    report = verify(thing, STATES, Mode.FULL, checks=checks)
    missed = [o for o in report.outcomes if o.verdict is Verdict.MISSED]
    assert all(np.isfinite(o.finding.found) for o in missed)
    return {o.check for o in missed}


def shown(change):
    """``batch.q`` with coordinates that are modified by a function of the batch and of the coordinates."""
    read = BatchSimulator.q.fget
    return "q", property(lambda batch: change(batch, read(batch)))


def forgetful(self, snapshot, restore=BatchSimulator.restore):
    restore(self, snapshot)
    self._memory.write(tuple(self.simulator.dynamics.effect_states), 0.0)


def rounded(self, state=Memory.__getstate__):
    arrays = {name: array.astype(np.float32).astype(float) for name, array in self.arrays.items()}
    return {**state(self), "arrays": arrays}


def itself(self, memo):
    return self


LEAKS = {
    "batch, place and threads": (BatchSimulator, *shown(lambda b, q: q + 1e-15 * np.arange(len(q))[:, None])),
    "neighbours": (BatchSimulator, *shown(lambda b, q: q + 1e-199 * np.abs(b.qd).max(initial=0.0))),
    "batch, place and threads, again": (BatchSimulator, *shown(lambda b, q: q + 1e-12 * (b.threads > 1))),
    "parameters of lanes": (BatchSimulator, *shown(lambda b, q: q + 1e-12 * (not b._memory.shared))),
    "copies": (BatchSimulator, "__deepcopy__", itself),
    "copies, again": (Memory, "__getstate__", rounded),
    "snapshots": (BatchSimulator, "restore", forgetful),
}
"""Faults by the checks that they break."""


@pytest.mark.quick("batch, place and threads")
@pytest.mark.parametrize("names", LEAKS)
def test_a_leak_is_red_and_named(names, monkeypatch):
    monkeypatch.setattr(*LEAKS[names])
    assert red(SCENE, BITS) == {f"bits: {names.removesuffix(', again')}"}


def test_every_check_of_bits_and_environments_is_seen_red():
    assert {c.name for c in BITS} == {f"bits: {name.removesuffix(', again')}" for name in LEAKS}
    broken = {f"environment: {name}" for name, *_ in BROKEN.values()}
    assert {c.name for c in checks_of(environments)} == broken


@pytest.mark.parametrize(
    "checks",
    [(evaluators.arrays, evaluators.singles), pytest.param((evaluators.tensors,), marks=pytest.mark.long)],
)
def test_evaluators_that_differ_are_red(checks, monkeypatch):
    fields = evaluators.fields_of
    if evaluators.tensors in checks:
        pytest.importorskip("torch", reason="torch is in the extra 'train'")
    assert red(SCENE, checks) == set()

    def off(dynamics):
        return {name: 1.001 * x for name, x in fields(dynamics).items()}

    monkeypatch.setattr(evaluators, "fields_of", off)
    assert red(SCENE, checks) == {one.name for one in checks}


def test_a_slider_beyond_its_stop_is_red(monkeypatch):
    monkeypatch.setattr(BatchSimulator, *shown(lambda batch, q: q + np.array([0.0, 1e-15, 0.0, 0.0])))
    assert red(rde.load_scene("rprp_stops"), (impacts.inside,)) == {"impacts: no joint beyond its stop"}


def stepping(kind, place, change):
    """``step`` of environments with one of its results (obs, reward, terminated, truncated, infos) that is
    changed by a function of the environment, actions and results."""
    right = kind.step

    def step(self, actions):
        results = list(right(self, actions))
        with np.errstate(all="ignore"):
            results[place] = change(self, actions, results)
        return tuple(results)

    return kind, "step", step


def late(results, wrong, right, at=40):
    """Something wrong in lanes beyond the range of short episodes."""
    steps = results[4]["episode_steps"] == at
    return np.where(steps.reshape(-1, *[1] * (np.ndim(right) - 1)), wrong, right)


def without_generators(self, state, right=Core.set_state):
    return right(self, {**state, "generators": copy.deepcopy(self.generators)})


VECTOR = ArmVectorEnv
BROKEN = {
    "rewards of a vector": ("rules of vectors", *stepping(VECTOR, 1, lambda env, a, r: r[1].tolist())),
    "reward of a single environment": (
        "single and vector", *stepping(ArmEnv, 1, lambda env, a, r: r[1] + 1e-9),
    ),
    "observations outside their space": (
        "ranges", *stepping(VECTOR, 0, lambda env, a, r: late(r, np.float32(1.001), r[0])),
    ),
    "metrics that are no number": (
        "ranges", *stepping(VECTOR, 4, lambda env, a, r: r[4] | {"distance": late(r, np.nan, r[1])}),
    ),
    "threads": (
        "seeds, threads and neighbours",
        *stepping(VECTOR, 1, lambda env, a, r: r[1] + 1e-9 * (env.core.threads > 1)),
    ),
    "a state without its generators": ("states", Core, "set_state", without_generators),
    "a copy that is the original": ("copies", VECTOR, "__deepcopy__", itself),
}  # fmt: skip


@pytest.mark.quick("rewards of a vector")
@pytest.mark.parametrize("fault", BROKEN)
def test_a_broken_environment_is_red_and_named(fault, monkeypatch):
    name, *change = BROKEN[fault]
    monkeypatch.setattr(*change, raising=False)
    assert red(subject_of("FourRReach-v0"), checks_of(environments)) == {f"environment: {name}"}
