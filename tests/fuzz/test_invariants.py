"""Each promise sees the fault that it is there for; the checks of ``verify`` have tests of their own."""

import functools
from collections import Counter

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.envs.core import Core
from redundant_envs.envs.vector_env import ArmVectorEnv
from redundant_envs.verify import conservation

from . import judging
from .cases import plain
from .drawing import step
from .invariants import NAMES, violations
from .judging import FLAGS, OF_VERIFY

pytestmark = pytest.mark.long

RNG = np.random.default_rng(0)
SCENE = {**rde.load_scene("rprp_reach").to_dict(), "tolerance": 1e-7}
Q = np.tile([0.3, 0.1, -0.4, 0.2], (10, 1)) + 0.02 * RNG.uniform(size=(10, 4))
QD, EFFORTS = RNG.normal(size=(10, 4)), RNG.uniform(-15.0, 15.0, (3, 10, 4))


def case_at(qd, scene=SCENE):
    calls = [{"call": "set_state", "rows": {"q": Q, "qd": qd}}]
    calls += [{"call": "advance", "rows": {"efforts": efforts}} for efforts in EFFORTS]
    return plain({"face": "simulator", "scene": scene, "num_envs": 10, "threads": 1, "calls": calls})


def random_step():
    return step(RNG.uniform(-1.0, 1.0, (4, 4)))


EPISODES = plain({
    "face": "vector", "goal": False, "scene": SCENE, "num_envs": 4, "threads": 1, "task": {},
    "autoreset_mode": "next_step", "on_bad_action": "terminate", "max_episode_steps": 3, "calls": [
    {"call": "reset", "rows": {"seed": [5, 6, 7, 8]}},
    *(random_step() for _ in range(3)),
    {"call": "save"},
    {"call": "reset", "options": {"unknown": 1.0}, "refused": "unknown"},
    {"call": "reset"},
    step([[np.nan, 0.0, 0.0, 0.0], *[[0.1] * 4] * 3]),
    random_step(),
    random_step(),
    {"call": "restore"},
    {"call": "reset"},
    step([[0.5] * 4] * 4),
]})  # fmt: skip


def broken(case, only):
    return {v.invariant for v in violations(case, only=only)}


def test_without_a_fault_no_promise_is_broken():
    tally = Counter()
    for case in (case_at(QD), EPISODES, {**EPISODES, "goal": True}):
        assert violations(case, tally) == []
    assert tally["refused"] == 2
    assert tally["torch_step_agrees not applicable"] == 1  # because of its stops
    assert all(tally[f"{name} kept"] == 1 for name in OF_VERIFY.keys() - {"torch_step_agrees"})


def then(change):
    """A method, and after it a change of its object and of what it returned."""

    def both(self, method, *args):
        told = method(*args)
        change(self, told)
        return told

    return both


def with_part(k, at, value):
    """Another number in a part of what a method returns."""
    return then(lambda self, found: found[k].__setitem__(at, value))


def raises(self, method, *args):
    raise RuntimeError("not documented")


def loses_a_lane(batch, told):
    batch._memory.write(("theta2",), np.nan, np.array([2]))


def knows_the_first(batch, told):
    if batch.scene.effects[0].key == "gravity":
        batch._memory.write(("theta1",), batch.q[:, :1] + 1e-8)


def numbers_its_lanes(batch, told):
    """The last digit of a lane follows from its number, far from the first."""
    late = np.arange(1000, batch.num_envs)
    batch._memory.write(("theta1",), np.nextafter(batch.q[late, :1], 9.0), late)


def shows_its_number(env, found):
    found[0][500:, 0] = np.nextafter(found[0][500:, 0], np.float32(9.0))


def mixes_lanes(env, found):
    if len(found[0]) > 1:
        found[0][0, 0] += 1e-6 * np.sign(found[0][1, 0])


def keeps_its_generators(core, set_state, state):
    kept = core.generators
    set_state(state)
    core._episode_keys.generators = kept


def draws_before_it_refuses(core, checked, options, lanes):
    core.waiting[lanes] = False
    core.provide_keys(lanes)
    return checked(options, lanes)


BATCH, VECTOR = rde.BatchSimulator, ArmVectorEnv
FAULTS = [
    (BATCH, "advance", then(loses_a_lane), FLAGS),
    (BATCH, "advance", with_part(1, 4, 840_000), FLAGS),
    (BATCH, "advance", with_part(4, 4, rde.Numerics.EVENT_BUDGET), FLAGS),
    (BATCH, "advance_partly", then(knows_the_first), "effects_commute"),
    (BATCH, "advance", then(numbers_its_lanes), "thousands_have_the_same_bits"),
    (VECTOR, "step", then(shows_its_number), "thousands_have_the_same_bits"),
    (VECTOR, "step", raises, "only_documented_exceptions"),
    (Core, "checked", lambda core, checked, options, lanes: checked({}, lanes), "only_documented_exceptions"),
    (Core, "checked", draws_before_it_refuses, "a_refused_call_changes_nothing"),
    (Core, "set_state", keeps_its_generators, "what_is_saved_continues"),
    (VECTOR, "step", then(mixes_lanes), "no_lane_depends_on_others"),
    (VECTOR, "step", with_part(0, (-1, 2), np.nan), "observations_lie_in_their_space"),
    (VECTOR, "step", with_part(0, (-1, 2), 1.0001), "observations_lie_in_their_space"),
]
"""What is changed in a method of a class, and the promise that is broken then."""


@pytest.mark.parametrize(("kind", "method", "change", "name"), FAULTS)
def test_a_fault_is_seen(monkeypatch, kind, method, change, name):
    right = getattr(kind, method)
    monkeypatch.setattr(kind, method, lambda self, *args: change(self, functools.partial(right, self), *args))
    assert broken(case_at(QD) if kind is BATCH else EPISODES, (name,)) == {name}


def test_another_motion_by_torch_step_is_seen(monkeypatch):
    case, own, tally = case_at(QD, rde.load_scene("four_r_reach").to_dict()), judging.torch_step, Counter()
    assert violations(case, tally, ("torch_step_agrees",)) == []
    assert tally["torch_step_agrees kept"] == 1
    monkeypatch.setattr(judging, "torch_step", lambda scene: lambda *x: [1e-7 + y for y in own(scene)(*x)])
    assert broken(case, ("torch_step_agrees",)) == {"torch_step_agrees"}


def test_every_promise_but_those_of_verify_is_seen_broken():
    more = {"effects_commute", "thousands_have_the_same_bits"}
    assert {name for *_, name in FAULTS} == NAMES - set(OF_VERIFY) | more


def test_verify_judges_the_states_of_a_case(monkeypatch):
    """A tip that is off at high rates alone breaks the tolerance of a case that has them."""

    def off_at_high_rates(trial):
        end = conservation.own_interval(trial)
        return end._replace(q=end.q + 1e-5 * (np.abs(trial.states[1]) > 50.0).any(axis=1, keepdims=True))

    monkeypatch.setattr("redundant_envs.verify.accuracy.own_interval", off_at_high_rates)
    assert broken(case_at(QD), ("tolerance_kept",)) == set()
    assert broken(case_at(60.0 * QD), ("tolerance_kept",)) == {"tolerance_kept"}
