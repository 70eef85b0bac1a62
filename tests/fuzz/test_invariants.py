"""Each invariant of the simulator and of the environments sees the fault that it is there for."""

import dataclasses

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.envs.core import Core
from redundant_envs.envs.vector_env import ArmVectorEnv

from . import invariants, invariants_motion
from .cases import plain, with_lanes
from .invariants import INVARIANTS, violations
from .invariants_episodes import EPISODE_INVARIANTS, episode_violations, of_lanes
from .played import Played, Tally
from .playing import Step, lanes_now

LANES = 10
RNG = np.random.default_rng(0)
SCENE = {**rde.load_scene("rprp_reach").to_dict(), "tolerance": 1e-7}
STARTS = {
    "q": np.tile([0.3, 0.1, -0.4, 0.2], (LANES, 1)) + 0.02 * RNG.uniform(size=(LANES, 4)),
    "qd": RNG.normal(size=(LANES, 4)),
}
EFFORTS = RNG.uniform(-15.0, 15.0, (3, LANES, 4))
CASE = plain(
    {
        "face": "simulator",
        "scene": SCENE,
        "num_envs": LANES,
        "threads": 1,
        "calls": [
            {"call": "set_state", **STARTS},
            {"call": "advance", "efforts": EFFORTS[0]},
            {"call": "set_parameters", "parameters": {"masses": -1.0}, "refused": True},
            {"call": "save"},
            {"call": "advance", "efforts": EFFORTS[1]},
            {"call": "restore"},
            {"call": "advance", "efforts": EFFORTS[2]},
        ],
    }
)
ONE_INTERVAL = {**with_lanes(CASE, [0, 1]), "calls": with_lanes(CASE, [0, 1])["calls"][:2]}
"""An energy balance that does not close is computed again with 400 000 steps, which take a second each."""
EPISODES = plain(
    {
        "face": "vector",
        "goal": False,
        "scene": SCENE,
        "num_envs": 4,
        "threads": 1,
        "autoreset_mode": "next_step",
        "on_bad_action": "terminate",
        "max_episode_steps": 3,
        "task": {},
        "calls": [
            {"call": "reset", "seed": [5, 6, 7, 8]},
            *({"call": "step", "actions": RNG.uniform(-1.0, 1.0, (4, 4))} for _ in range(3)),
            {"call": "save"},
            {"call": "reset", "options": {"unknown": 1.0}, "refused": True},
            {"call": "reset", "seed": None},
            {"call": "step", "actions": [["nan", 0.0, 0.0, 0.0], *[[0.1] * 4] * 3], "refusable": True},
            *({"call": "step", "actions": RNG.uniform(-1.0, 1.0, (4, 4))} for _ in range(2)),
            {"call": "restore"},
            {"call": "reset", "seed": None},
            {"call": "step", "actions": [[0.5] * 4] * 4},
        ],
    }
)


def broken(make, case=CASE, chosen=INVARIANTS):
    return {v.invariant for v in violations(case, make, chosen=chosen)}


def test_the_simulator_breaks_no_promise():
    tally = Tally()
    assert violations(CASE, tally=tally) == []
    assert tally.judged == tally.books == tally.intervals == 3 * LANES
    assert tally.refused == 1


class Raises(rde.BatchSimulator):
    def advance(self, efforts=None):
        raise TypeError("not documented")


class AcceptsAll(rde.BatchSimulator):
    def set_parameters(self, values, index=None):
        pass


class ChangesWhatItRefuses(rde.BatchSimulator):
    def set_parameters(self, values, index=None):
        self._memory.write(("theta1",), self.q[:, :1] + 1e-3)
        super().set_parameters(values, index)


class HidesNumbersThatAreNone(rde.BatchSimulator):
    def advance(self, efforts=None):
        status = super().advance(efforts)
        self._memory.write(("theta2",), np.nan, np.array([2]))
        return status


class PassesStops(rde.BatchSimulator):
    def advance(self, efforts=None):
        status = super().advance(efforts)
        self._memory.write(("r1",), np.nextafter(0.25, 1.0), np.array([3]))
        return status


class IsOff(rde.BatchSimulator):
    def advance(self, efforts=None):
        status = super().advance(efforts)
        self._memory.write(("theta1",), self.q[:, :1] + 1e-5)
        return status


class BooksWorkTwice(rde.BatchSimulator):
    def advance(self, efforts=None):
        before = self.work
        status = super().advance(efforts)
        self._memory.write(("work",), (2.0 * self.work - before)[:, None])
        return status


class Leaks(rde.BatchSimulator):
    """The last digit of one lane is that of its neighbour."""

    def advance(self, efforts=None):
        status = super().advance(efforts)
        if self.num_envs > 1 and self.qd[0, 0] > self.qd[1, 0]:
            self._memory.write(("theta1",), np.nextafter(self.q[:1, :1], 9.0), np.array([0]))
        return status


class ForgetsADigit(rde.BatchSimulator):
    def restore(self, snapshot):
        super().restore(snapshot)
        self._memory.write((self.scene.robot.rates[0],), np.float32(self.qd[:, :1]))


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (Raises, "only_documented_exceptions"),
        (AcceptsAll, "only_documented_exceptions"),
        (ChangesWhatItRefuses, "a_refused_call_changes_nothing"),
        (HidesNumbersThatAreNone, "what_is_not_finite_is_flagged"),
        (PassesStops, "no_slider_is_beyond_its_stop"),
        (IsOff, "tolerance_is_kept_or_flagged"),
        (Leaks, "no_lane_depends_on_others"),
        (ForgetsADigit, "what_is_saved_continues"),
    ],
)
def test_a_fault_of_a_simulator_is_seen(make, name):
    assert name in broken(make)


def test_work_that_is_booked_twice_is_seen():
    assert "the_energy_book_closes" in broken(BooksWorkTwice, ONE_INTERVAL)


def test_an_interval_that_takes_too_many_evaluations_is_seen():
    lanes = lanes_now(rde.BatchSimulator(rde.Scene.from_dict(SCENE), LANES, track_work=True))
    status = {"evaluations": np.array([*[12] * 9, 12 * 70_000])}
    played = Played(CASE, [Step(CASE["calls"][1], lanes, lanes, None, status)], rde.BatchSimulator, Tally())
    assert [v.lane for v in invariants.the_work_of_an_interval_is_bounded(played)] == [9]


def test_a_potential_that_is_not_its_forces_is_seen(monkeypatch):
    """In the references, too: they share the wrong balance."""
    energies = invariants_motion.energies

    def wrong(scene, lanes):
        kinetic, potential = energies(scene, lanes)
        return kinetic, 1.01 * potential

    monkeypatch.setattr(invariants_motion, "energies", wrong)
    assert "the_energy_book_closes" in broken(rde.BatchSimulator, ONE_INTERVAL)


def test_a_lane_that_moved_in_an_interval_it_gave_up_is_seen():
    batch = rde.BatchSimulator(rde.Scene.from_dict(SCENE), LANES, track_work=True)
    before = lanes_now(batch)
    moved = dataclasses.replace(before, qd=before.qd + 5e-324 * (np.arange(LANES) == 4)[:, None])
    status = {"numerics": np.full(LANES, int(rde.Numerics.EVENT_BUDGET))}
    played = Played(CASE, [Step(CASE["calls"][1], before, moved, None, status)], rde.BatchSimulator, Tally())
    assert [v.lane for v in invariants.a_given_up_interval_leaves_its_lane(played)] == [4]


# ---- environments --------------------------------------------------------------------------------------


def broken_episodes(case=EPISODES):
    return {v.invariant for v in episode_violations(case, chosen=EPISODE_INVARIANTS)}


@pytest.mark.parametrize("face", ["env", "vector", "sb3"])
@pytest.mark.parametrize("goal", [False, True])
def test_the_environments_break_no_promise(face, goal):
    case = {**EPISODES, "face": face, "goal": goal}
    if face == "env":
        case = {**of_lanes(case, [0]), "face": face}
    tally = Tally()
    assert episode_violations(case, tally=tally) == []
    assert tally.episodes >= 2
    assert tally.early_ends == 1


def tampered(monkeypatch, change):
    """Every step of a vector environment returns something else."""
    step = ArmVectorEnv.step

    def other(self, actions):
        found = list(step(self, actions))
        change(self, found)
        return tuple(found)

    monkeypatch.setattr(ArmVectorEnv, "step", other)


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
    tampered(monkeypatch, change)
    assert name in broken_episodes()


def test_a_state_without_its_generators_is_seen(monkeypatch):
    set_state = Core.set_state

    def other(self, state):
        kept = self.generators
        set_state(self, state)
        self._episode_keys.generators = kept

    monkeypatch.setattr(Core, "set_state", other)
    assert "what_is_saved_continues" in broken_episodes()


def test_a_refused_reset_that_draws_is_seen(monkeypatch):
    checked = Core.checked

    def other(self, options, lanes):
        self.waiting[lanes] = False
        self.provide_keys(lanes)
        return checked(self, options, lanes)

    monkeypatch.setattr(Core, "checked", other)
    assert "a_refused_call_changes_nothing" in broken_episodes()
