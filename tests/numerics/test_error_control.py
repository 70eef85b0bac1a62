"""Local steps for every lane: enough for the tolerance, and decided by that lane alone. Known motions of
dop853, and that more times do not change one, are in ``model/test_trajectory.py``."""

import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from catalogue import EQUAL, RPRP, advanced

import redundant_envs as rde
from redundant_envs.simulator.lane.faults import Control, Fault
from redundant_envs.simulator.lane.fields import Layout, engine
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.lane.pieces import Whole
from redundant_envs.simulator.lane.step_control import End, EqualSteps
from redundant_envs.simulator.lane.stops import Bounces
from redundant_envs.simulator.numerics.error_control import Crossed, blended_error, tip_error

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


def tip_errors(one, other):
    return np.linalg.norm(np.subtract(*(x.scene.robot.forward_kinematics(x.q) for x in (one, other))), axis=1)


@pytest.mark.parametrize(("tolerance", "most"), [(1e-6, 13), (1e-12, 50)])
def test_true_error_is_within_the_tolerance(tolerance, most):
    q, qd, efforts = lab_states()
    got, status = advanced(rde.Scene(LAB, FREE, tolerance=tolerance), q, qd, efforts)
    reference, _ = advanced(rde.Scene(LAB, FREE, substeps=64), q, qd, efforts)
    assert np.mean(tip_errors(got, reference) < tolerance) >= 0.999
    assert status.evaluations.mean() <= most
    assert (status.error_estimate <= tolerance).all()
    assert not status.numerics.any()
    got, status = advanced(rde.Scene(LAB, FREE), q, qd, efforts)  # one step, without a tolerance
    errors = tip_errors(got, reference)
    assert (errors <= status.error_estimate)[errors > 1e-12].mean() > 0.999


@pytest.mark.long
def test_a_motion_that_depends_on_the_last_digit_of_its_start_is_flagged():
    """Hundreds of rad/s for 0.2 s; a hostile review saw a last digit move unflagged tips by up to 1.4 m."""
    arm, n = rde.FourR((0.2,) * 4, (0.25,) * 4), 200
    rng = np.random.default_rng(0)
    q, efforts = rng.uniform(-3.0, 3.0, (n, 4)), rng.uniform(-60.0, 60.0, (n, 4))
    scene = rde.Scene(arm, (e.Gravity(),), control_dt=0.2, tolerance=1e-3)
    (one, first), (other, second) = (
        advanced(scene, start, np.zeros((n, 4)), efforts) for start in (q, np.nextafter(q, 9.0))
    )
    sure = (first.numerics | second.numerics) == 0
    assert 0.5 < sure.mean() < 1.0
    assert tip_errors(one, other)[sure].max() < 2e-3


@pytest.mark.long
def test_a_lane_is_that_many_fixed_steps_bit_for_bit():
    arm, (q, qd, efforts) = RPRP, lab_states(200, 1)
    q[:, [1, 3]] *= 0.05
    got, status = advanced(rde.Scene(arm, FREE, tolerance=1e-11), q, qd, efforts)
    used = np.zeros(200)
    for n in (1, 2, 4, 8, 16, 32, 64):
        fixed, _ = advanced(rde.Scene(arm, FREE, substeps=n), q, qd, efforts)
        used[((got.q == fixed.q) & (got.qd == fixed.qd)).all(axis=1)] = n
    assert (used > 0).all()
    assert len(np.unique(used)) >= 3
    assert (status.evaluations >= 12 * used).all()


def test_fast_links_get_their_steps_before_any_estimate():
    """Half a radian in a step: a straight arm that spins freely has no error to see."""
    scene = rde.Scene(LAB, (), tolerance=1e-2)
    qd = np.array([[1.0], [24.0], [26.0], [99.0], [101.0]]) * np.ones(4)
    _, status = advanced(scene, np.zeros((5, 4)), qd)
    np.testing.assert_array_equal(status.evaluations, 12 * np.array([1, 1, 2, 4, 8]))


@pytest.mark.quick("effect0-0.45-1")
@pytest.mark.parametrize(
    ("effect", "least", "steps"),
    [
        (e.LimitSpring("joint2", -2.0, 2.0, 1e2), 0.45, 1),
        (e.LimitSpring("joint2", -2.0, 2.0, 1e5), 14.1, 16),
        (e.ViscousFriction((0.0, 60.0, 0.0, 0.0)), 12.0, 16),
    ],
)
def test_stiff_springs_and_dampers_get_their_steps_before_they_act(effect, least, steps):
    """The power of two from 0.02 s sqrt(k W) / 2 or 0.02 s d W / 2 on, with the mobility W = 20 1/kg m^2."""
    assert least <= steps < 2.0 * max(least, 1.0)
    _, status = advanced(rde.Scene(LAB, (effect,), tolerance=1e-6), np.zeros(4), np.zeros(4))
    assert status.evaluations[0] == 12 * steps


@pytest.mark.long
def test_a_tolerance_out_of_reach_is_flagged_not_hidden():
    scene = rde.Scene(LAB, (e.LimitSpring("joint2", -2.0, 2.0, 1e12),), tolerance=1e-6)
    _, status = advanced(scene, np.zeros(4), np.zeros(4))
    assert status.numerics[0] == rde.Numerics.TOLERANCE_NOT_REACHED
    assert status.finite[0]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"tolerance": 1e-15}, "tolerance.*1e-15.*1e-13"),
        ({"tolerance": 1.0}, r"tolerance.*1\.0.*0\.01"),
        ({"tolerance": "exact"}, "tolerance.*'exact'"),
        ({"tolerance": 1e-6, "integrator": "rk4"}, "with integrator 'rk4' and substeps 1; give it with"),
        ({"tolerance": 1e-6, "substeps": 2}, "tolerance is 1e-06 m .*substeps 2; .*1 substep alone"),
        ({"tolerance": 1e-6, "integrator": "dop853"}, "tolerance is 1e-06"),
        ({"substeps": 3, "integrator": "dop853"}, "substeps is 3"),
    ],
)
def test_a_tolerance_or_a_method_that_cannot_be_is_refused(changes, said):
    with pytest.raises(ValueError, match=said):
        dataclasses.replace(rde.Scene(LAB, FREE), **changes)


def test_an_estimate_that_overflows_does_not_pass():
    """The third-order estimate may be so large that its square is infinite: a blend of 0 would pass."""
    assert blended_error(1e100, 1e200) > 1e100
    assert blended_error(0.0, 0.0) == 0.0
    assert blended_error(3e-7, 4e-6) == pytest.approx(3e-7**2 / np.hypot(3e-7, 4e-7), rel=1e-12)
    for huge in (1e160, 1e200, np.inf):
        for estimates in itertools.product((0.0, 1e-9, huge), repeat=3):
            assert (tip_error(*estimates) <= 1e-6) == (huge not in estimates), estimates
    for e6, e5 in itertools.product((0.0, 1e-9, np.nan), repeat=2):  # a stage that e3 uses, e5 uses, too
        assert (tip_error(e6, e5, 0.0) <= 1e-6) == bool(e6 + e5 < 1.0)


def test_one_estimate_that_is_0_by_chance_hides_no_error():
    """Usual estimates of a step that is off by 1e-8 m; each in turn is 0."""
    e6, e5, e3 = 3e-8, 1e-6, 3e-4
    assert tip_error(e6, e5, e3) == pytest.approx(45.0 * e6 * np.sqrt(e5 / e3))
    assert tip_error(0.0, e5, e3) == pytest.approx(e5**2 / e3)
    assert tip_error(e6, 0.0, e3) == pytest.approx(45.0 * e6 * np.sqrt(e6 / e3))
    assert tip_error(e6, e5, 0.0) == 45.0 * e6
    assert tip_error(0.0, 0.0, 0.0) == 0.0


# ---- the end of an interval, from numbers --------------------------------------------------------------


class KnownInterval(EqualSteps):
    """The control of a lane that has just made the last of its steps, from data of the interval."""

    def __init__(self, crossed):
        self.crossed = crossed
        self.dynamics = SimpleNamespace(arm=SimpleNamespace(coordinates=()))
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
        ({"error": 1e-6, **KINKED, "impacts": 9.0}, True),
        ({"error": 1e-6, **KINKED, "steps": 8.0}, False),
        ({"error": 1e-6, **KINKED, "steps": 8.0, "hidden_kink": True}, True),
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


# ---- dop853: what SciPy's does in as many evaluations, and motions that it gives up --------------------


@pytest.mark.long
def test_scipy_agrees_and_needs_as_many_evaluations():
    integrate = pytest.importorskip("scipy.integrate", reason="SciPy is in the extra verify")
    arm = RPRP
    q, qd, efforts = (-1.2, 0.2, -0.4, 0.1), (0.5, -0.3, 0.2, 0.4), (1.5, -0.7, 0.4, 0.2)

    def slope(t, y):
        return np.r_[y[4:], arm.forward_dynamics(y[:4], y[4:], arm.motor_map @ efforts, 9.81)]

    peer = integrate.solve_ivp(slope, (0, 1), [*q, *qd], "DOP853", rtol=1e-13, atol=1e-14)
    batch = rde.BatchSimulator(rde.Scene(arm, (e.Gravity(),), "dop853", 1.0))
    batch.set_state(q, qd)
    assert batch.advance([efforts]).evaluations[0] <= 1.2 * peer.nfev
    np.testing.assert_allclose([*batch.q[0], *batch.qd[0]], peer.y[:, -1], rtol=0, atol=1e-10)


def test_a_motion_that_overflows_ends():
    batch = rde.BatchSimulator(rde.Scene(EQUAL["RPRP"], (e.Gravity(),), integrator="dop853"), 2)
    batch.set_state([0.3, 0.1, -0.4, 0.2], [[0, 1e200, 0, 0], [0, 0, 0, 0]])
    before = np.c_[batch.q, batch.qd]
    status = batch.advance()
    assert status.numerics[0] & rde.Numerics.TOLERANCE_NOT_REACHED
    assert status.numerics[0] & rde.Numerics.NO_STEP_FOUND
    assert status.numerics[1] == 0
    np.testing.assert_array_equal(np.c_[batch.q, batch.qd][0], before[0])
    with pytest.raises(ValueError, match=r"dop853 finds no step .* at t = 0 s"):
        rde.simulate(batch.scene, [0.3, 0.1, -0.4, 0.2], [0, 1e200, 0, 0], [1.0])
