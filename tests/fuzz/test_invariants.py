"""Each invariant of the simulator and of the environments sees the fault that it is there for."""

import functools
import operator
from collections import Counter

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.envs.core import Core
from redundant_envs.envs.vector_env import ArmVectorEnv

from . import composition, motions
from .cases import plain, with_lanes
from .drawing_calls import step
from .invariants import GIVEN_UP, SHORT, violations

pytestmark = pytest.mark.long

LANES = 10
RNG = np.random.default_rng(0)
SCENE = {**rde.load_scene("rprp_reach").to_dict(), "tolerance": 1e-7}
STARTS = {
    "q": np.tile([0.3, 0.1, -0.4, 0.2], (LANES, 1)) + 0.02 * RNG.uniform(size=(LANES, 4)),
    "qd": RNG.normal(size=(LANES, 4)),
}


def advance():
    return {"call": "advance", "rows": {"efforts": RNG.uniform(-15.0, 15.0, (LANES, 4))}}


def random_step():
    return step(RNG.uniform(-1.0, 1.0, (4, 4)))


CASE = plain({"face": "simulator", "scene": SCENE, "num_envs": LANES, "threads": 1, "calls": [
    {"call": "set_state", "rows": STARTS},
    advance(),
    {"call": "set_parameters", "parameters": {"masses": -1.0}, "refused": "masses"},
    {"call": "save"},
    advance(),
    {"call": "restore"},
    {"call": "copy"},
    advance(),
]})  # fmt: skip
ONE_INTERVAL = {**with_lanes(CASE, [0, 1]), "calls": with_lanes(CASE, [0, 1])["calls"][:2]}
"""An energy balance that does not close is computed again with 400 000 steps, which take a second each."""
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


def broken(make=rde.BatchSimulator, case=CASE, only=()):
    return {v.invariant for v in violations(case, make, only=only)}


def test_the_simulator_breaks_no_promise():
    tally = Counter()
    assert violations(CASE, tally=tally) == []
    assert tally["judged"] == tally["books"] == tally["intervals"] == 3 * LANES
    assert tally["refused"] == 1


@pytest.mark.parametrize(("face", "goal"), [("env", False), ("vector", False), ("sb3", True)])
def test_the_environments_break_no_promise(face, goal):
    case = {**(with_lanes(EPISODES, [0]) if face == "env" else EPISODES), "face": face, "goal": goal}
    tally = Counter()
    assert violations(case, tally=tally, only=SHORT) == []
    assert tally["episodes"] >= 2
    assert tally["early_ends"] == 1


# ---- faults -------------------------------------------------------------------------------------------


def tampered(kind, name, change):
    """A method of a class with ``change(self, method, ...)`` in its place."""
    method = getattr(kind, name)
    return lambda self, *args: change(self, functools.partial(method, self), *args)


def then(change):
    """The method, and a change of its object and of what it returned."""

    def both(self, method, *args):
        told = method(*args)
        change(self, told)
        return told

    return both


def field(name, value, lane):
    """A number of a lane becomes another."""
    return then(lambda batch, _: batch._memory.write((name,), value, np.array([lane])))


def result(name, value):
    """So does one of the results of a lane."""
    return then(lambda _, status: operator.setitem(getattr(status, name), 4, value))


def part(k, at, value):
    """A number of a part of what a step returns becomes another."""
    return then(lambda _, found: operator.setitem(found[k], at, value))


def raises(self, method, *args):
    raise RuntimeError("not documented")


def changes_what_it_refuses(batch, set_parameters, *args):
    batch._memory.write(("theta1",), batch.q[:, :1] + 1e-3)
    set_parameters(*args)


def refuses_without_a_name(batch, set_parameters, *args):
    raise ValueError("something is wrong")


def books_work_twice(batch, advance, efforts):
    before, status = batch.work, advance(efforts)
    batch._memory.write(("work",), (2.0 * batch.work - before)[:, None])
    return status


def is_off(batch, told):
    batch._memory.write(("theta1",), batch.q[:, :1] + 1e-5)


def leaks(batch, told):
    """The last digit of one lane is that of its neighbour."""
    if batch.num_envs > 1 and batch.qd[0, 0] > batch.qd[1, 0]:
        batch._memory.write(("theta1",), np.nextafter(batch.q[0, 0], 9.0), np.array([0]))


def numbers_its_lanes(batch, told):
    """The last digit of a lane follows from its number, far from the first."""
    late = np.arange(1000, batch.num_envs)
    batch._memory.write(("theta1",), np.nextafter(batch.q[late, :1], 9.0), late)


def forgets_a_digit(batch, told=None):
    batch._memory.write((batch.scene.robot.rates[0],), np.float32(batch.qd[:, :1]))


@pytest.mark.parametrize(
    ("method", "change", "name"),
    [
        ("advance", raises, "only_documented_exceptions"),
        ("set_parameters", lambda *_: None, "only_documented_exceptions"),
        ("set_parameters", refuses_without_a_name, "only_documented_exceptions"),
        ("set_parameters", changes_what_it_refuses, "a_refused_call_changes_nothing"),
        ("advance", field("theta2", np.nan, 2), "what_is_not_finite_is_flagged"),
        ("advance", field("r1", np.nextafter(0.25, 1.0), 3), "no_joint_is_beyond_its_stop"),
        ("advance", then(is_off), "tolerance_is_kept_or_flagged"),
        ("advance", then(leaks), "no_lane_depends_on_others"),
        ("advance", result("evaluations", 840_000), "the_work_of_an_interval_is_bounded"),
        ("advance", result("numerics", GIVEN_UP), "a_given_up_interval_leaves_its_lane"),
        ("restore", then(forgets_a_digit), "what_is_saved_continues"),
        ("advance", then(numbers_its_lanes), "thousands_have_the_same_bits"),
        ("_take", then(forgets_a_digit), "what_is_saved_continues"),
        ("advance", books_work_twice, "the_energy_book_closes"),
    ],
)
def test_a_fault_of_a_simulator_is_seen(method, change, name):
    """References are computed by simulators without it."""
    faulty = {method: tampered(rde.BatchSimulator, method, change)}
    case = ONE_INTERVAL if change is books_work_twice else CASE
    assert broken(type("Tampered", (rde.BatchSimulator,), faulty), case, (name,)) == {name}


def test_a_potential_that_is_not_its_forces_is_seen(monkeypatch):
    """In the references, too: they share the wrong balance."""
    energies = motions.energies
    monkeypatch.setattr(motions, "energies", lambda *args: energies(*args) * np.array([[1.0], [1.01]]))
    name = "the_energy_book_closes"
    assert broken(case=ONE_INTERVAL, only=(name,)) == {name}


def test_a_motion_that_follows_from_the_order_of_effects_is_seen(monkeypatch):
    def knows_the_first(batch, told):
        if batch.scene.effects[0].key == "gravity":
            batch._memory.write(("theta1",), batch.q[:, :1] + 1e-8)

    faulty = tampered(rde.BatchSimulator, "advance", then(knows_the_first))
    monkeypatch.setattr(rde.BatchSimulator, "advance", faulty)
    assert broken(only=("effects_commute",)) == {"effects_commute"}


@pytest.mark.parametrize("evaluator", ["cross_interval", "torch_step"])
def test_another_evaluator_of_its_own_mind_is_seen(monkeypatch, evaluator):
    """Of a scene without stops, which tensors refuse."""
    case = {**CASE, "scene": {**SCENE, "effects": SCENE["effects"][:3]}}
    own, robot = getattr(composition, evaluator), rde.load_scene("rprp_reach").robot

    def off(*args):
        if evaluator == "cross_interval":
            found = own(*args)
            return {name: found[name] + 1e-7 for name in (*robot.coordinates, *robot.rates)}
        step = own(*args)
        return lambda *given: tuple(x + 1e-7 for x in step(*given))

    monkeypatch.setattr(composition, evaluator, off)
    assert broken(case=case, only=("evaluators_agree",)) == {"evaluators_agree"}


def test_episodes_that_know_how_they_begin_are_seen(monkeypatch):
    def pays_another_reward(env, found):
        if env.metadata["autoreset_mode"].name == "SAME_STEP":
            found[1][0] = np.nextafter(found[1][0], 9.0)

    name = "autoresets_begin_the_same_episodes"
    monkeypatch.setattr(ArmVectorEnv, "step", tampered(ArmVectorEnv, "step", then(pays_another_reward)))
    assert broken(case=EPISODES, only=(name,)) == {name}


def pays_at_an_end(env, found):
    found[1][found[2]] += 0.01


def mixes_lanes(env, found):
    if len(found[0]) > 1:
        found[0][0, 0] += 1e-6 * np.sign(found[0][1, 0])


def passes_a_stop(env, found):
    env.core.memory.write(("r2",), 0.2500001, np.array([0]))


def keeps_its_generators(core, set_state, state):
    kept = core.generators
    set_state(state)
    core._episode_keys.generators = kept


def draws_before_it_refuses(core, checked, options, lanes):
    core.waiting[lanes] = False
    core.provide_keys(lanes)
    return checked(options, lanes)


@pytest.mark.parametrize(
    ("kind", "method", "change", "name"),
    [
        (ArmVectorEnv, "step", part(0, (-1, 2), np.nan), "observations_lie_in_their_space"),
        (ArmVectorEnv, "step", part(0, (-1, 2), 1.0001), "observations_lie_in_their_space"),
        (ArmVectorEnv, "step", then(pays_at_an_end), "no_early_end_pays"),
        (ArmVectorEnv, "step", part(1, 0, 1.5), "no_early_end_pays"),
        (ArmVectorEnv, "step", then(mixes_lanes), "no_lane_depends_on_others"),
        (ArmVectorEnv, "step", then(passes_a_stop), "no_joint_is_beyond_its_stop"),
        (ArmVectorEnv, "step", raises, "only_documented_exceptions"),
        (Core, "set_state", keeps_its_generators, "what_is_saved_continues"),
        (Core, "checked", draws_before_it_refuses, "a_refused_call_changes_nothing"),
    ],
)
def test_a_fault_of_an_environment_is_seen(monkeypatch, kind, method, change, name):
    monkeypatch.setattr(kind, method, tampered(kind, method, change))
    assert broken(case=EPISODES, only=(name,)) == {name}
