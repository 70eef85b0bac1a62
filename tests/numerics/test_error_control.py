"""Local steps for every lane: enough for the tolerance, and decided by that lane alone."""

import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.effects.hooks import Effect, Force
from redundant_envs.language.algebra import maximum, physics
from redundant_envs.simulator.lane import attempts
from redundant_envs.simulator.lane.bounces import Bounces
from redundant_envs.simulator.lane.engine_fields import engine
from redundant_envs.simulator.lane.faults import Control, Fault
from redundant_envs.simulator.lane.fields import Layout
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.lane.pieces import Whole
from redundant_envs.simulator.lane.step_control import End, EqualSteps
from redundant_envs.simulator.numerics.error_control import (
    Crossed,
    blended_error,
    confirmed,
    judge_adaptive,
    steps_allowed,
    steps_for_error,
    tip_error,
)
from redundant_envs.verify.checks import random_states
from studies.interval_families import FAMILIES
from studies.intervals import tips_after

e = rde.effects
LAB = rde.FourR((1.0,) * 4, (0.5,) * 4)
FREE = (e.Gravity(), e.ViscousFriction(0.1))


def lab_states(n=4096, seed=0):
    """Angles uniform, rates normal with 4 rad/s, half of the lanes with random efforts."""
    rng = np.random.default_rng(seed)
    q, qd = rng.uniform(-np.pi, np.pi, (n, 4)), rng.normal(0.0, 4.0, (n, 4))
    efforts = rng.uniform(-1.0, 1.0, (n, 4)) * (20.0, 12.0, 8.0, 4.0)
    efforts[::2] = 0.0
    return q, qd, efforts


def advance(scene, q, qd, efforts=None, **kwargs):
    batch = rde.BatchSimulator(scene, len(q), **kwargs)
    batch.set_state(q, qd)
    status = batch.advance(efforts)
    return np.concatenate([batch.q, batch.qd], axis=1), status


def tip_errors(arm, states, reference):
    tip, other = (arm.forward_kinematics(x[:, :4]) for x in (states, reference))
    return np.linalg.norm(tip - other, axis=1)


@pytest.mark.parametrize(("tolerance", "most"), [(1e-6, 13), (1e-12, 50)])
def test_true_error_is_within_the_tolerance(tolerance, most):
    q, qd, efforts = lab_states()
    got, status = advance(rde.Scene(LAB, FREE, tolerance=tolerance), q, qd, efforts)
    reference, _ = advance(rde.Scene(LAB, FREE, substeps=64), q, qd, efforts)
    assert np.mean(tip_errors(LAB, got, reference) < tolerance) >= 0.999
    assert status.evaluations.mean() <= most
    assert (status.error_estimate <= tolerance).all()
    assert not status.numerics.any()


@pytest.mark.long
def test_a_motion_that_depends_on_the_last_digit_of_its_start_is_flagged():
    """Hundreds of rad/s for 0.2 s; a hostile review saw a last digit move unflagged tips by up to 1.4 m."""
    arm, n = rde.FourR((0.2,) * 4, (0.25,) * 4), 200
    rng = np.random.default_rng(0)
    q, efforts = rng.uniform(-3.0, 3.0, (n, 4)), rng.uniform(-60.0, 60.0, (n, 4))
    scene = rde.Scene(arm, (e.Gravity(),), control_dt=0.2, tolerance=1e-3)
    (one, first), (other, second) = (
        advance(scene, start, np.zeros((n, 4)), efforts) for start in (q, np.nextafter(q, 9.0))
    )
    sure = (first.numerics | second.numerics) == 0
    assert 0.5 < sure.mean() < 1.0
    assert tip_errors(arm, one, other)[sure].max() < 2e-3


def test_the_tolerance_is_kept_where_sliders_are_thrown_far_away():
    """Found by fuzzing: a tip of 5e-5 kg goes from 14 m to 90 km, where an early error of an angle counts."""
    arm = rde.RPRP((500.0, 5000.0, 700.0, 5e-5), (60.0, 80.0))
    rng, n = np.random.default_rng(0), 512
    q = np.array([-0.54, -27.0, 1.7, -66.0]) + rng.normal(0.0, 1.0, (n, 4)) * (1.0, 2.0, 1.0, 2.0)
    qd = rng.normal(0.0, 1.0, (n, 4)) * (0.5, 20.0, 0.5, 5.0)
    efforts = np.array([7.6e6, 3e3, 3.5e6, 2.3e4]) * rng.uniform(-2.0, 2.0, (n, 4))
    got, status = advance(rde.Scene(arm, tolerance=1e-8), q, qd, efforts)
    reference, _ = advance(rde.Scene(arm, substeps=256), q, qd, efforts)
    assert not status.numerics.any()
    assert tip_errors(arm, got, reference).max() <= 2e-8


@pytest.mark.long
def test_a_lane_is_that_many_fixed_steps_bit_for_bit():
    arm, (q, qd, efforts) = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5)), lab_states(200, 1)
    q[:, [1, 3]] *= 0.05
    got, status = advance(rde.Scene(arm, FREE, tolerance=1e-11), q, qd, efforts)
    used = np.zeros(200)
    for n in (1, 2, 4, 8, 16, 32, 64):
        fixed, _ = advance(rde.Scene(arm, FREE, substeps=n), q, qd, efforts)
        used[(got == fixed).all(axis=1)] = n
    assert (used > 0).all()
    assert len(np.unique(used)) >= 3
    assert (status.evaluations >= 12 * used).all()


def test_a_lane_that_is_not_finite_costs_one_step():
    q, qd, efforts = lab_states(24, 3)
    qd[3, 1] = np.nan
    efforts[9, 0] = np.inf
    _, status = advance(rde.Scene(LAB, FREE, tolerance=1e-12), q, qd, efforts)
    bad = np.isin(np.arange(24), (3, 9))
    np.testing.assert_array_equal(status.finite, ~bad)
    np.testing.assert_array_equal(status.numerics, bad * rde.Numerics.NON_FINITE)
    assert (status.evaluations[bad] <= 12).all()


def test_fast_links_get_their_steps_before_any_estimate():
    """Half a radian in a step: a straight arm that spins freely has no error to see."""
    scene = rde.Scene(LAB, (), tolerance=1e-2)
    qd = np.array([[1.0], [24.0], [26.0], [99.0], [101.0]]) * np.ones(4)
    _, status = advance(scene, np.zeros((5, 4)), qd)
    np.testing.assert_array_equal(status.evaluations, 12 * np.array([1, 1, 2, 4, 8]))


@pytest.mark.quick("effect0-0.45-1")
@pytest.mark.parametrize(
    ("effect", "least", "steps"),
    [
        (e.LimitSpring("joint2", -2.0, 2.0, 1e2), 0.45, 1),
        (e.LimitSpring("joint2", -2.0, 2.0, 1e3), 1.41, 2),
        (e.LimitSpring("joint2", -2.0, 2.0, 1e5), 14.1, 16),
        (e.LimitSpring("joint2", -2.0, 2.0, 1e6), 44.7, 64),
        (e.ViscousFriction((0.0, 60.0, 0.0, 0.0)), 12.0, 16),
    ],
)
def test_stiff_springs_and_dampers_get_their_steps_before_they_act(effect, least, steps):
    """The power of two from 0.02 s sqrt(k W) / 2 or 0.02 s d W / 2 on, with the mobility W = 20 1/kg m^2."""
    assert least <= steps < 2.0 * max(least, 1.0)
    _, status = advance(rde.Scene(LAB, (effect,), tolerance=1e-6), np.zeros((1, 4)), np.zeros((1, 4)))
    assert status.evaluations[0] == 12 * steps


@physics
def untold(position):
    return -1e5 * maximum(position - 0.5, 0.0)


class UntoldSpring(Effect):
    """A one-sided spring that does not declare where its law changes: no order is kept there."""

    def hooks(self, arm):
        return (Force(1, untold, {"position": "phi2"}),)


@pytest.mark.long
def test_a_tolerance_out_of_reach_is_flagged_not_hidden():
    scene = rde.Scene(LAB, (e.LimitSpring("joint2", -2.0, 2.0, 1e12),), tolerance=1e-6)
    _, status = advance(scene, np.zeros((1, 4)), np.zeros((1, 4)))
    assert status.numerics[0] == rde.Numerics.TOLERANCE_NOT_REACHED
    assert status.finite[0]
    hit = rde.Scene(LAB, (UntoldSpring(),), tolerance=1e-13)
    _, status = advance(hit, [[0.0, 0.499, 0.0, 0.0]], [[0.0, 5.0, 0.0, 0.0]])
    assert status.numerics[0] == rde.Numerics.TOLERANCE_NOT_REACHED
    assert status.error_estimate[0] > 1e-13
    assert status.evaluations[0] > 12 * 16384


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"tolerance": 1e-15}, "tolerance.*1e-15.*1e-13"),
        ({"tolerance": 1.0}, r"tolerance.*1\.0.*0\.01"),
        ({"tolerance": float("nan")}, "tolerance.*nan"),
        ({"tolerance": "exact"}, "tolerance.*'exact'"),
        ({"tolerance": 1e-6, "integrator": "rk4"}, "tolerance.*rk4.*rk8"),
        ({"tolerance": 1e-6, "substeps": 2}, "tolerance.*2 substeps.*1"),
        ({"tolerance": 1e-6, "integrator": "dop853"}, "tolerance is 1e-06"),
        ({"substeps": 3, "integrator": "dop853"}, "substeps is 3"),
    ],
)
def test_a_tolerance_or_a_method_that_cannot_be_is_refused(changes, said):
    with pytest.raises(ValueError, match=said):
        dataclasses.replace(rde.Scene(LAB, FREE), **changes)


@pytest.mark.long
@pytest.mark.parametrize(("short", "tolerance"), [(1e-6, 1e-6), (1e-6, 1e-9), (1e-5, 1e-9)])
def test_tolerance_is_kept_with_nearly_vanishing_links(short, tolerance):
    """Hard case 44 with others: the error of the angle of such a link grows with it."""
    arm = rde.FourR((1.0,) * 4, (1.0, short, 1.0, short))
    scene = rde.Scene(arm, (e.Gravity(),), tolerance=tolerance)
    q, qd, _ = random_states(scene, 2048, 0)
    got, status = advance(scene, q, qd)
    # Which way such a link points may be chance, and two references agree by chance now and then.
    *others, finer = (
        advance(rde.Scene(arm, scene.effects, substeps=n), q, qd)[0] for n in (2048, 4096, 5801, 8192)
    )
    judged = np.max([tip_errors(arm, x, finer) for x in others], axis=0) <= 0.1 * tolerance
    assert judged.sum() > 1200
    assert (tip_errors(arm, got, finer) <= tolerance)[judged & (status.numerics == 0)].all()
    assert np.mean(status.numerics[judged] != 0) <= 1e-3


def test_an_estimate_that_overflows_does_not_pass():
    """The third-order estimate may be so large that its square is infinite: a blend of 0 would pass."""
    assert blended_error(1e100, 1e200) > 1e100
    assert blended_error(0.0, 0.0) == 0.0
    assert blended_error(1e-200, 1e-200) == 0.0
    assert blended_error(3e-7, 4e-6) == pytest.approx(3e-7**2 / np.hypot(3e-7, 4e-7), rel=1e-12)
    for huge in (1e160, 1e200, np.inf):
        for estimates in itertools.product((0.0, 1e-9, huge), repeat=3):
            assert (tip_error(*estimates) <= 1e-6) == (huge not in estimates), estimates
    for e6, e5 in itertools.product((0.0, 1e-9, np.nan), repeat=2):  # a stage that e3 uses, e5 uses, too
        assert (tip_error(e6, e5, 0.0) <= 1e-6) == bool(e6 + e5 < 1.0)


def test_the_next_step_of_dop853_is_no_longer_than_springs_and_rates_allow():
    for least, longest in ((0.0, 6e-3), (3.0, 6e-3), (8.0, 2.5e-3)):  # six times as long as the last
        verdict = judge_adaptive(1e-12, 1e-3, 1e-3, least, 0.02, 1.0)
        assert verdict.following == pytest.approx(longest, rel=1e-12)


def test_one_estimate_that_is_0_by_chance_hides_no_error():
    """Usual estimates of a step that is off by 1e-8 m; each in turn is 0."""
    e6, e5, e3 = 3e-8, 1e-6, 3e-4
    assert tip_error(e6, e5, e3) == pytest.approx(45.0 * e6 * np.sqrt(e5 / e3))
    assert tip_error(0.0, e5, e3) == pytest.approx(e5**2 / e3)
    assert tip_error(e6, 0.0, e3) == pytest.approx(45.0 * e6 * np.sqrt(e6 / e3))
    assert tip_error(e6, e5, 0.0) == 45.0 * e6
    assert tip_error(0.0, 0.0, 0.0) == 0.0


STEPS = ("4R, smooth", "4R, masses over five decades", "RPRP, lengths over six decades",
         "RPRP, 50 ms, generalized forces")  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("name", STEPS)
def test_random_steps_are_off_by_at_most_their_estimate(name):
    """Of 65 536 single steps of smooth motions. By a blend of e5 and e3 alone some are off by hundreds of
    estimates."""
    (family,) = (f for f in FAMILIES if f.name == name)
    drawn = family.draw(65_536, np.random.default_rng(17))
    with np.errstate(all="ignore"):  # some steps of 20 ms are far too long
        (tip, step), (best, how) = (
            tips_after(family, family.scene(integrator=method), drawn) for method in ("rk8", "dop853")
        )
        error = np.linalg.norm(tip - best, axis=1)
    judged = (how.numerics == 0) & (step.error_estimate < 1e-3) & (error > 1e-12)
    assert judged.sum() > 10_000
    assert (error <= step.error_estimate)[judged].all()


@pytest.mark.parametrize(
    ("least", "steps"), [(0.0, 1), (1.0, 1), (1.1, 2), (2.0, 2), (2.1, 4), (9e3, 16384), (1e9, 16384)]
)
def test_steps_are_the_next_power_of_two_and_no_more_than_there_may_be(least, steps):
    assert steps_allowed(least) == steps


def test_a_piece_that_is_crossed_again_has_twice_as_many_steps():
    for h, k in zip(np.random.default_rng(0).uniform(1e-4, 0.2, 13), range(1, 14), strict=True):
        longest = attempts.SHORTER * (h / 2.0**k)
        assert steps_allowed(h * (1.0 / longest)) == 2.0 ** (k + 1)


def test_an_error_as_large_as_the_tolerance_allows_for_some_steps_calls_for_no_more():
    """The estimate of one step falls like the seventh power of their number."""
    assert [steps_for_error(False, 1.0, 1e-6), steps_for_error(True, 1.0, 1.0)] == [1.0, 2.0]
    for steps in (2.0, 4.0, 64.0):
        assert steps_for_error(True, steps**7 * 1e-6, 1e-6) == steps
        assert steps_for_error(True, 1.001 * steps**7 * 1e-6, 1e-6) == 2.0 * steps


# ---- the end of an interval, from numbers --------------------------------------------------------------


class KnownInterval(EqualSteps):
    """The control of a lane that has just made the last of its steps, from data of the interval."""

    def __init__(self, crossed):
        self.crossed = crossed
        arm = SimpleNamespace(coordinates=())
        self.dynamics = SimpleNamespace(arm=arm)
        self.features = SimpleNamespace(bounces=Bounces(Control.EQUAL), dynamics=self.dynamics)
        self.pieces = Whole(self.features)
        self.step = SimpleNamespace(least_steps=lambda lane: 0.0)

    def _crossed(self, lane):
        return self.crossed


def ended(error, change=0.0, steps=64.0, impacts=0.0, **doubts):
    """What follows an interval that has just been crossed, for a tolerance of 1; and the fault."""
    known = {"left": 0.0, "steps_left": 1.0, "min_steps": 0.0, "divisions": steps, "error": error,
             "tip_tolerance": 1.0, "impacts": impacts, "fault": 0.0, "interval": 1.0}  # fmt: skip
    lane = Lane(Layout(engine(*known)), lambda name: None)
    for name, value in known.items():
        lane[name] = np.float64(value)
    return KnownInterval(Crossed(steps, error, 1.0, change, impacts, **doubts)).end(lane), lane.fault


KINKED = {"change": 0.2, "kinked": True}
MANY = {"error": 1e-6, **KINKED, "impacts": 9.0}


@pytest.mark.parametrize(
    ("known", "again"),
    [
        ({"error": 0.9, "change": 9.0}, False),  # nothing makes the estimate doubtful
        ({"error": 0.9, "change": 9.0, "doubtful": True}, True),
        ({"error": 0.9, "change": 0.9, "doubtful": True}, False),
        ({"error": 0.05, "change": 0.9, "kinked": True}, True),
        ({"error": 0.05, **KINKED}, False),
        ({"error": 0.07, **KINKED}, True),
        ({"error": 1e-4, **KINKED, "impacts": 8.0}, True),
        ({"error": 1e-6, **KINKED, "impacts": 8.0}, False),
        (MANY, True),
        ({**MANY, "steps": 128.0}, False),
        ({"error": 1e-6, **KINKED, "steps": 8.0}, False),
        ({"error": 1e-6, **KINKED, "steps": 8.0, "hidden_kink": True}, True),
        ({"error": 1e-6, **KINKED, "steps": 16.0, "hidden_kink": True}, False),
        ({"error": 1e-6, "change": 0.9, "impacts": 8.0}, False),
        ({"error": 1e-6, "change": 1.1, "impacts": 8.0}, True),
        ({"error": 1e-6, "change": 1.1, "impacts": 7.0}, False),
        ({"error": 0.02, "change": 1.1, "impacts": 4.0}, True),
        ({"error": 0.009, "change": 1.1, "impacts": 4.0}, False),
    ],
)
def test_an_interval_has_to_come_out_the_same_where_its_estimate_is_doubtful(known, again):
    assert ended(**known) == ((End.REPEATED if again else End.CROSSED), 0.0)


def test_many_impacts_behind_a_kink_end_with_a_flag():
    found = ended(1e-9, change=0.3, steps=256.0, impacts=63.0, kinked=True)
    assert found == (End.CROSSED, Fault.TOLERANCE_NOT_REACHED)


@pytest.mark.parametrize(
    ("tolerance", "share"), [(1e-3, 1e-3), (1e-10, 1e-3), (1e-11, 1e-2), (1e-12, 0.1), (1e-13, 0.1)]
)
def test_after_32_impacts_a_thousandth_of_the_tolerance_is_compared_but_not_rounding(tolerance, share):
    def passes(impacts, change):
        return bool(confirmed(Crossed(64.0, 0.0, tolerance, change * tolerance, impacts)))

    assert (passes(31.0, 0.99), passes(31.0, 1.01)) == (True, False)
    assert (passes(32.0, 0.99 * share), passes(32.0, 1.01 * share)) == (True, False)


@pytest.mark.long
@pytest.mark.parametrize("tolerance", [1e-5, 1e-6, 1e-7, 1e-8])
def test_a_spring_that_brings_a_light_slider_back_to_its_stop_keeps_the_tolerance(tolerance):
    """It just touches the stop, which multiplies the error of a step: the tip was off by 17 tolerances."""
    arm = rde.RPRP((0.28, 0.9, 0.8, 0.00033), (0.14, 0.39))
    springs = e.CentringSpring((50.0, 30.0), (0.0, 0.0), (0.25, 0.25))
    effects = (e.Gravity(), springs, e.PrismaticStop((0.0, 0.0), (0.25, 0.25), 1.0))
    rng = np.random.default_rng(3)
    q = np.array([-0.23, 0.25, -1.42, 0.25]) + rng.normal(0.0, [0.1, 0.0, 0.1, 0.0], (256, 4))
    qd = np.array([-0.1, 0.0, -0.08, 0.0]) * rng.uniform(0.0, 2.0, (256, 1))
    q[0], qd[0] = [-0.23, 0.25, -1.42, 0.25], [-0.1, 0.0, -0.08, 0.0]
    got, status = advance(rde.Scene(arm, effects, tolerance=tolerance), q, qd)
    first, _ = advance(rde.Scene(arm, effects, "dop853"), q, qd)
    second, _ = advance(rde.Scene(arm, effects, substeps=2048), q, qd)
    judged = (tip_errors(arm, first, second) <= 0.1 * tolerance) & (status.numerics == 0)
    assert judged.mean() > 0.9
    assert (tip_errors(arm, got, first) <= tolerance)[judged].all()
