"""Whole motions against 12 trajectories known to 7 to 14 decimals, and how simulate keeps time."""

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.effects import Gravity, ViscousFriction

TIMES = [0.1, 0.5, 1.0, 2.0, 5.0]

ORACLES = Path(__file__).parents[1] / "oracles"
RUNS = {
    f"{arm.kind}-{run['id']}": (arm, run)
    for arm, name in ((rde.RPRP, "rprp"), (rde.FourR, "four_r"))
    for run in json.loads((ORACLES / f"traj_{name}.json").read_text(encoding="utf-8"))["trajectories"]
}


@pytest.mark.quick("RPRP-0-rk8")
@pytest.mark.parametrize(("method", "dt"), [("rk8", 0.002), ("dop853", 0.1)], ids=["rk8", "dop853"])
@pytest.mark.parametrize(("arm", "run"), RUNS.values(), ids=RUNS)
def test_known_motions_are_followed(arm, run, method, dt):
    """States to round-off and its growth, energy and work, at all five times."""
    robot = arm(run["m"], run["l"])
    scene = rde.Scene(robot, (Gravity(run["g"]),), method, dt, actuation="generalized")
    found = rde.simulate(scene, run["q0"], run["qd0"], TIMES, run["Q"])
    assert found.t.tolist() == [s["t"] for s in run["states"]] == TIMES
    for q, qd, state in zip(found.q, found.qd, run["states"], strict=True):
        reference = np.array([*state["q"], *state["qd"]])
        error = np.abs(np.concatenate([q, qd]) - reference).max()
        # ``decimals`` shows how fast neighbouring motions part: two solutions agree to so many.
        noise = 1e-13 * np.abs(reference).max() if method == "rk8" else 0.0
        assert error <= 100.0 * 10.0 ** -state["decimals"] + noise, state["t"]
        assert error <= 1e-9 or state["t"] > 1.0
    scale = 1e-9 * (found.kinetic_energy.max() + abs(run["E0"]))
    assert np.abs(found.kinetic_energy + found.potential_energy - found.work - run["E0"]).max() <= scale
    assert np.abs(found.work - (found.q - np.array(run["q0"])) @ np.array(run["Q"])).max() <= scale
    assert found.events == []


ARM = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))
SCENE = rde.Scene(ARM, (Gravity(9.81), ViscousFriction(0.1)), "rk8", 0.02, substeps=2)
Q0, QD0 = np.array([-1.2, -0.9, -1.8, -0.4]), np.array([0.5, -0.3, 0.2, 0.4])


def test_times_are_hit_exactly():
    """A time inside an interval is reached by a part of the interval, not by rounding to its ends."""
    times = [0.0, 0.013, 0.02, 0.033, 0.0601]
    trajectory = rde.simulate(SCENE, Q0, QD0, times)
    assert trajectory.t.tolist() == times
    assert (trajectory.q[0] == Q0).all()
    assert (trajectory.qd[0] == QD0).all()
    assert trajectory.work[0] == 0.0
    fine = rde.Scene(ARM, SCENE.effects, "rk8", 0.0001)
    reference = rde.simulate(fine, Q0, QD0, times)
    assert np.abs(trajectory.q - reference.q).max() <= 1e-12
    assert np.abs(trajectory.qd - reference.qd).max() <= 1e-11


def test_efforts_are_asked_once_per_control_instant():
    """At 0, dt, 2 dt, ...; however many times are wanted, with the state of that instant."""
    asked = []
    times = [0.001, 0.002, 0.0199, 0.02, 0.021, 0.05, 0.0599, 0.1]
    trajectory = rde.simulate(SCENE, Q0, QD0, times, lambda *now: asked.append(now) or (0.3, 0.2, 0.1, 0.0))
    assert [t for t, _, _ in asked] == pytest.approx([0.0, 0.02, 0.04, 0.06, 0.08], abs=1e-15)
    np.testing.assert_array_equal(asked[0][1:], (Q0, QD0))
    np.testing.assert_array_equal(asked[1][1:], (trajectory.q[3], trajectory.qd[3]))


@pytest.mark.parametrize("shape", [(), (2, 5)])
def test_motions_of_a_batch_of_any_shape_are_those_of_each_alone(shape):
    """(T, ..., 4) from (..., 4), for a function of the time, too; to the last bit."""
    rng = np.random.default_rng(3)
    q, efforts = Q0 + rng.uniform(-0.1, 0.1, (*shape, 4)), rng.uniform(-1.0, 1.0, (*shape, 4))
    found = rde.simulate(SCENE, q, QD0, [0.05, 0.1], efforts)
    called = rde.simulate(SCENE, q, QD0, [0.05, 0.1], lambda t, q, qd: np.zeros_like(q + qd) + efforts)
    assert (called.q == found.q).all()
    np.testing.assert_array_equal(found.tip, ARM.forward_kinematics(found.q))
    assert found.q.shape == found.qd.shape == (2, *shape, 4)
    assert found.kinetic_energy.shape == found.potential_energy.shape == found.work.shape == (2, *shape)
    for i in np.ndindex(*shape):
        one = rde.simulate(SCENE, q[i], QD0, [0.05, 0.1], efforts[i])
        for name in ("q", "qd", "work"):
            assert (getattr(one, name) == getattr(found, name)[(slice(None), *i)]).all()


Z = np.zeros
BAD = {
    **{f"times {t}": (Q0, QD0, t, None, "times must be")
       for t in ([-0.1, 0.1], [0.1, 0.1], [0.2, 0.1], [np.nan], [1e308], [[0.1, 0.2]])},
    "no number": ((0, np.nan, 0, 0), QD0, [0.1], None, "q is .*; give finite"),
    "no effort": (Q0, QD0, [0.1], (np.inf, 0, 0, 0), "efforts.* has non-finite"),
    "short": (Z(3), Z(3), [0.1], None, r"q is .* of shape \(3,\); .*4 along"),
    "two and three": (Z((2, 4)), Z((3, 4)), [0.1], None, "broadcast"),
    "none": (Z((0, 4)), Z((0, 4)), [0.1], None, r"q and qd have the shape \(0, 4\).*at least one"),
    "short efforts": (Q0, QD0, [0.1], Z(3), r"efforts has shape \(3,\)"),
    "short answer": (Z((3, 4)), QD0, [0.1], lambda t, q, qd: Z(2), r"efforts has shape \(2,\).*\(3, 4\)"),
}  # fmt: skip


@pytest.mark.parametrize(("q", "qd", "times", "efforts", "said"), BAD.values(), ids=BAD)
def test_bad_arguments_are_named(q, qd, times, efforts, said):
    with pytest.raises(ValueError, match=said):
        rde.simulate(SCENE, q, qd, times, efforts)


def test_the_floats_beside_a_control_instant_are_not_it():
    dt, asked = SCENE.control_dt, []
    for k in (3, 7, 29, 500):
        times = [np.nextafter(k * dt, 0.0), k * dt, np.nextafter(k * dt, np.inf)]
        for count, calls in ((1, k), (2, k), (3, k + 1)):  # no call for an interval that is not entered
            asked.clear()
            rde.simulate(SCENE, Q0, QD0, times[:count], lambda t, q, qd: asked.append(t) or np.zeros(4))
            assert asked == [j * dt for j in range(calls)]


def feedback(t, q, qd):
    """Efforts that depend on everything, and not smoothly."""
    return np.array([3.0 * np.sign(np.sin(9.0 * t)), 20.0, -1.0, -10.0]) - 0.5 * q - 0.1 * qd


@pytest.mark.long
@pytest.mark.parametrize(
    "kwargs",
    [{"integrator": "euler", "substeps": 4}, {"substeps": 2}, {"tolerance": 1e-6}, {"integrator": "dop853"}],
)
def test_asking_for_more_times_does_not_change_a_motion_with_stops(kwargs):
    effects = Gravity(), rde.effects.PrismaticStop((0.0, 0.0), (0.3, 0.2), 0.5)
    scene = rde.Scene(rde.RPRP((1.0, 0.8, 0.6, 0.4), (0.5, 0.4)), effects, **kwargs)
    few = np.array([0.05, 0.2, 0.2035, 0.31])
    rng = np.random.default_rng(0)
    near = np.add.outer(np.arange(1, 15) * 0.02, [-3e-11, -1e-17, 0.0, 1e-17, 2e-13, 1e-9]).ravel()
    many = np.unique(np.concatenate([few, near, rng.uniform(0.0, 0.31, 50), [1e-18]]))
    a = rde.simulate(scene, (0.2, 0.1, 0.4, 0.1), (1.0, 0.2, -0.5, 0.1), few, feedback)
    b = rde.simulate(scene, (0.2, 0.1, 0.4, 0.1), (1.0, 0.2, -0.5, 0.1), many, feedback)
    at = np.searchsorted(many, few)
    assert (many[at] == few).all()
    for name in ("q", "qd", "work", "kinetic_energy", "potential_energy"):
        assert (getattr(a, name) == getattr(b, name)[at]).all()
    assert a.events == b.events


def test_a_trajectory_has_the_efforts_applied_from_each_time_on():
    """Behind the motors."""
    limits = rde.effects.EffortLimits((1.0, 2.0, 3.0, 4.0))

    def called(t, q, qd):
        return np.full(4, 1.0 + round(t / 0.02))

    def applied(times, efforts, shape=(4,), *effects):
        limited = rde.Scene(ARM, effects)
        return rde.simulate(limited, np.zeros(shape), np.zeros(4), times, efforts).efforts.tolist()

    assert [e[0] for e in applied([0.0, 0.01, 0.02, 0.05, 0.06], called)] == [1, 1, 2, 3, 3]
    assert applied([0.0], (1, 2, 3, 4)) == [[1.0, 2, 3, 4]]
    behind_the_motors = [[[-1.0, 1.5, 3.0, 4.0]] * 2] * 2
    assert applied([0.0, 0.03], (-9.0, 1.5, 9.0, 9.0), (2, 4), limits) == behind_the_motors


def test_a_scene_without_a_tolerance_tells_its_error_once():
    """Scenes with a tolerance, and those whose steps are short enough, say nothing."""
    coarse = rde.Scene(ARM, SCENE.effects, "rk8", 0.05)
    start = np.zeros(4), np.array([8.0, -8.0, 8.0, -8.0]), [0.2]
    words = r"scene has no tolerance: with one step of rk8 .* off by up to (\S+) m after"
    with pytest.warns(UserWarning, match=words) as told:
        coarsely = rde.simulate(coarse, *start)
    assert len(told) == 1
    assert told[0].filename == __file__
    estimate = float(re.search(words, str(told[0].message))[1])
    exact = rde.simulate(dataclasses.replace(coarse, tolerance=1e-10), *start)
    off = np.linalg.norm(coarsely.tip - exact.tip, axis=-1).max()
    assert 1e-6 < off < 10.0 * estimate
    for changes in ({}, {"substeps": 20}, {"tolerance": 1e-6}):
        rde.simulate(dataclasses.replace(coarse, **changes), *start)
