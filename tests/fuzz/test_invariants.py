"""Each invariant of the simulator and of the environments sees the fault that it is there for."""

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.envs.core import Core
from redundant_envs.envs.vector_env import ArmVectorEnv

from . import invariants, motions
from .cases import plain, with_lanes
from .invariants import Played, Tally, violations
from .playing import Step, lanes_now

LANES = 10
RNG = np.random.default_rng(0)
SCENE = {**rde.load_scene("rprp_reach").to_dict(), "tolerance": 1e-7}
STARTS = {
    "q": np.tile([0.3, 0.1, -0.4, 0.2], (LANES, 1)) + 0.02 * RNG.uniform(size=(LANES, 4)),
    "qd": RNG.normal(size=(LANES, 4)),
}
EFFORTS = RNG.uniform(-15.0, 15.0, (3, LANES, 4))
CASE = plain({"face": "simulator", "scene": SCENE, "num_envs": LANES, "threads": 1, "calls": [
    {"call": "set_state", **STARTS},
    {"call": "advance", "efforts": EFFORTS[0]},
    {"call": "set_parameters", "parameters": {"masses": -1.0}, "refused": "masses"},
    {"call": "save"},
    {"call": "advance", "efforts": EFFORTS[1]},
    {"call": "restore"},
    {"call": "advance", "efforts": EFFORTS[2]},
]})  # fmt: skip
ONE_INTERVAL = {**with_lanes(CASE, [0, 1]), "calls": with_lanes(CASE, [0, 1])["calls"][:2]}
"""An energy balance that does not close is computed again with 400 000 steps, which take a second each."""
ACTIONS = iter(RNG.uniform(-1.0, 1.0, (5, 4, 4)))
EPISODES = plain({
    "face": "vector", "goal": False, "scene": SCENE, "num_envs": 4, "threads": 1, "task": {},
    "autoreset_mode": "next_step", "on_bad_action": "terminate", "max_episode_steps": 3, "calls": [
    {"call": "reset", "seed": [5, 6, 7, 8]},
    *({"call": "step", "actions": next(ACTIONS)} for _ in range(3)),
    {"call": "save"},
    {"call": "reset", "options": {"unknown": 1.0}, "refused": "unknown"},
    {"call": "reset", "seed": None},
    {"call": "step", "actions": [["nan", 0.0, 0.0, 0.0], *[[0.1] * 4] * 3]},
    *({"call": "step", "actions": next(ACTIONS)} for _ in range(2)),
    {"call": "restore"},
    {"call": "reset", "seed": None},
    {"call": "step", "actions": [[0.5] * 4] * 4},
]})  # fmt: skip


def broken(make=rde.BatchSimulator, case=CASE):
    return {v.invariant for v in violations(case, make)}


def test_the_simulator_breaks_no_promise():
    tally = Tally()
    assert violations(CASE, tally=tally) == []
    assert tally.judged == tally.books == tally.intervals == 3 * LANES
    assert tally.refused == 1


@pytest.mark.parametrize("face", ["env", "vector", "sb3"])
@pytest.mark.parametrize("goal", [False, True])
def test_the_environments_break_no_promise(face, goal):
    case = {**(with_lanes(EPISODES, [0]) if face == "env" else EPISODES), "face": face, "goal": goal}
    tally = Tally()
    assert violations(case, tally=tally) == []
    assert tally.episodes >= 2
    assert tally.early_ends == 1


# ---- faults of simulators -------------------------------------------------------------------------------


def tampered(name, change):
    """A class of simulators with ``change(batch, method, ...)`` in place of a method of the parent."""

    def method(self, *args):
        return change(self, lambda *given: getattr(rde.BatchSimulator, name)(self, *given), *args)

    return type("Tampered", (rde.BatchSimulator,), {name: method})


def then(name, change):
    """The same, after the method."""

    def both(batch, method, *args):
        told = method(*args)
        change(batch)
        return told

    return tampered(name, both)


def write(name, value, lane):
    return lambda batch: batch._memory.write((name,), value, np.array([lane]))


def raises(batch, advance, efforts):
    raise TypeError("not documented")


def changes_what_it_refuses(batch, set_parameters, *args):
    batch._memory.write(("theta1",), batch.q[:, :1] + 1e-3)
    set_parameters(*args)


def refuses_without_a_name(batch, set_parameters, *args):
    raise ValueError("something is wrong")


def books_work_twice(batch, advance, efforts):
    before, status = batch.work, advance(efforts)
    batch._memory.write(("work",), (2.0 * batch.work - before)[:, None])
    return status


def is_off(batch):
    batch._memory.write(("theta1",), batch.q[:, :1] + 1e-5)


def leaks(batch):
    """The last digit of one lane is that of its neighbour."""
    if batch.num_envs > 1 and batch.qd[0, 0] > batch.qd[1, 0]:
        write("theta1", np.nextafter(batch.q[0, 0], 9.0), 0)(batch)


def forgets_a_digit(batch):
    batch._memory.write((batch.scene.robot.rates[0],), np.float32(batch.qd[:, :1]))


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (tampered("advance", raises), "only_documented_exceptions"),
        (tampered("set_parameters", lambda *_: None), "only_documented_exceptions"),
        (tampered("set_parameters", refuses_without_a_name), "only_documented_exceptions"),
        (tampered("set_parameters", changes_what_it_refuses), "a_refused_call_changes_nothing"),
        (then("advance", write("theta2", np.nan, 2)), "what_is_not_finite_is_flagged"),
        (then("advance", write("r1", np.nextafter(0.25, 1.0), 3)), "no_slider_is_beyond_its_stop"),
        (then("advance", is_off), "tolerance_is_kept_or_flagged"),
        (then("advance", leaks), "no_lane_depends_on_others"),
        (then("restore", forgets_a_digit), "what_is_saved_continues"),
    ],
)
def test_a_fault_of_a_simulator_is_seen(make, name):
    assert name in broken(make)


@pytest.mark.parametrize("call", ["copy", "pickle"])
def test_a_copy_that_forgets_a_digit_is_seen(monkeypatch, call):
    take = rde.BatchSimulator._take

    def other(self, *args):
        take(self, *args)
        forgets_a_digit(self)

    monkeypatch.setattr(rde.BatchSimulator, "_take", other)
    case = {**CASE, "calls": [*CASE["calls"][:2], {"call": call}, CASE["calls"][-1]]}
    assert "what_is_saved_continues" in broken(case=case)


def test_work_that_is_booked_twice_is_seen():
    assert "the_energy_book_closes" in broken(tampered("advance", books_work_twice), ONE_INTERVAL)


def test_a_potential_that_is_not_its_forces_is_seen(monkeypatch):
    """In the references, too: they share the wrong balance."""
    energies = motions.energies
    monkeypatch.setattr(motions, "energies", lambda *args: energies(*args) * np.array([[1.0], [1.01]]))
    assert "the_energy_book_closes" in broken(case=ONE_INTERVAL)


FIFTH, GIVEN_UP = np.arange(LANES) == 4, np.full(LANES, invariants.GIVEN_UP)


@pytest.mark.parametrize(
    ("invariant", "told", "moved"),
    [
        (invariants.the_work_of_an_interval_is_bounded, {"evaluations": 12 + 840_000 * FIFTH}, 0.0),
        (invariants.a_given_up_interval_leaves_its_lane, {"numerics": GIVEN_UP}, 5e-324),
    ],
)
def test_an_interval_of_a_lane_is_seen_that(invariant, told, moved):
    """Takes too many evaluations; moved, although it was given up."""
    lanes = lanes_now(rde.BatchSimulator(rde.Scene.from_dict(SCENE), LANES, track_work=True))
    after = lanes | {"qd": lanes["qd"] + moved * FIFTH[:, None]}
    steps = [Step(CASE["calls"][1], lanes, False, None, after, told)]
    assert [lane for _, lane, _ in invariant(Played(CASE, steps, None, Tally()))] == [4]


# ---- faults of environments -----------------------------------------------------------------------------


def set_nan(env, found):
    found[0][-1, 2] = np.nan


def set_beyond(env, found):
    found[0][-1, 2] = 1.0001


def set_paid(env, found):
    found[1][found[2]] += 0.01


def set_too_much(env, found):
    found[1][0] = 1.5


def set_leak(env, found):
    if len(found[0]) > 1:
        found[0][0, 0] += 1e-6 * np.sign(found[0][1, 0])


def set_stop(env, found):
    env.core.memory.write(("r2",), 0.2500001, np.array([0]))


def set_error(env, found):
    raise RuntimeError("not documented")


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (set_nan, "observations_are_finite"),
        (set_beyond, "observations_lie_in_their_space"),
        (set_paid, "no_early_end_pays"),
        (set_too_much, "no_early_end_pays"),
        (set_leak, "no_lane_depends_on_others"),
        (set_stop, "no_slider_is_beyond_its_stop"),
        (set_error, "only_documented_exceptions"),
    ],
)
def test_a_fault_of_an_environment_is_seen(monkeypatch, change, name):
    step = ArmVectorEnv.step

    def other(self, actions):
        found = list(step(self, actions))
        change(self, found)
        return tuple(found)

    monkeypatch.setattr(ArmVectorEnv, "step", other)
    assert name in broken(case=EPISODES)


def test_a_state_without_its_generators_is_seen(monkeypatch):
    set_state = Core.set_state

    def other(self, state):
        kept = self.generators
        set_state(self, state)
        self._episode_keys.generators = kept

    monkeypatch.setattr(Core, "set_state", other)
    assert "what_is_saved_continues" in broken(case=EPISODES)


def test_a_refused_reset_that_draws_is_seen(monkeypatch):
    checked = Core.checked

    def other(self, options, lanes):
        self.waiting[lanes] = False
        self.provide_keys(lanes)
        return checked(self, options, lanes)

    monkeypatch.setattr(Core, "checked", other)
    assert "a_refused_call_changes_nothing" in broken(case=EPISODES)
