"""Hard stops: impacts where and when they happen, rest, release, and never beyond an end."""

import itertools
import json
import math

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs import algebra
from redundant_envs.evaluators.binding import bind
from redundant_envs.integrators import contacts

e = rde.effects
ARM = rde.RPRP((1.0,) * 4, (0.5, 0.5))
UNEQUAL = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))
START = ((0.3, 0.1, -0.4, 0.2), (1.0, 0.8, -2.0, -0.6))
"""Five impacts in half a second, with travel 0 to 0.3 m."""


def scene(arm=ARM, restitution=1.0, lower=(0.0, 0.0), upper=(0.3, 0.3), gravity=9.81, **kwargs):
    effects = (e.Gravity(gravity), e.PrismaticStop(lower, upper, restitution))
    return rde.Scene(arm, effects, **{"control_dt": 0.02, **kwargs})


def energy(arm, q, qd, g=9.81):
    return arm.kinetic_energy(q, qd) + arm.potential_energy(q, g)


def motion(made, q, qd, seconds):
    """End state, evaluations and impacts of one motion; its sliders never leave their travel."""
    batch = rde.BatchSimulator(made, 1)
    batch.set_state(q, qd)
    evaluations = impacts = 0
    stop = made.effects[-1]
    for _ in range(round(seconds / made.control_dt)):
        status = batch.advance()
        evaluations += status.evaluations[0]
        impacts += status.events[0]
        assert not status.numerics[0]
        assert (batch.q[0, [1, 3]] >= stop.lower).all()
        assert (batch.q[0, [1, 3]] <= stop.upper).all()
    return batch.q[0], batch.qd[0], evaluations, impacts


# ---- impacts -------------------------------------------------------------------------------------


def test_rk4_keeps_its_order_across_five_impacts():
    reference, _, _, impacts = motion(scene(integrator="dop853"), *START, 0.5)
    assert impacts == 5
    errors = []
    for h in (1e-2, 5e-3, 2.5e-3, 1e-3):
        q, _, _, impacts = motion(scene(integrator="rk4", control_dt=h), *START, 0.5)
        assert impacts == 5
        errors.append(np.linalg.norm(ARM.forward_kinematics(q) - ARM.forward_kinematics(reference)))
    orders = [math.log(errors[k] / errors[k + 1]) / math.log(r) for k, r in enumerate((2.0, 2.0, 2.5))]
    assert min(orders) >= 3.9
    assert errors[-1] <= 1e-9


def test_five_impacts_cost_few_evaluations_and_no_energy():
    made = scene(integrator="rk4", control_dt=1e-3)
    q, qd, with_stops, _ = motion(made, *START, 0.5)
    assert with_stops <= 1.05 * 4 * 500
    before = energy(ARM, np.array(START[0]), np.array(START[1]))
    assert abs(energy(ARM, q, qd) - before) <= 1e-8
    q, qd, _, _ = motion(scene(tolerance=1e-12), *START, 0.5)
    assert abs(energy(ARM, q, qd) - before) <= 1e-10


@pytest.mark.parametrize("tolerance", [1e-6, 1e-9])
def test_impact_times_are_those_of_exact(tolerance):
    q, qd = START
    exact = rde.simulate(scene(tolerance=1e-12), q, qd, [0.5]).events
    got = rde.simulate(scene(tolerance=tolerance), q, qd, [0.5]).events
    finest = rde.simulate(scene(integrator="dop853"), q, qd, [0.5]).events
    assert [x.kind for x in got] == [x.kind for x in exact] == [x.kind for x in finest]
    for a, b, c in zip(got, exact, finest, strict=True):
        assert a.joint == b.joint
        if b.speed > 0.1:
            assert abs(a.time - b.time) <= 1e-10
            assert abs(b.time - c.time) <= 1e-12


@pytest.mark.parametrize("substeps", [1, 2, 3, 4])
@pytest.mark.parametrize("integrator", ["euler", "rk4", "rk8"])
def test_the_time_of_an_impact_does_not_depend_on_the_substep_it_falls_in(integrator, substeps):
    made = scene(upper=(0.4, 0.4), gravity=0.0, integrator=integrator, substeps=substeps)
    speed = 1.003  # the arm lies still and straight: slider 2 glides alone
    events = rde.simulate(made, [0.0, 0.2, 0.0, 0.2], [0.0, 0.0, 0.0, speed], [0.3]).events
    assert events[0].joint == "r2"
    assert events[0].time == pytest.approx(0.2 / speed, abs=1e-12)


def test_an_impact_loses_what_restitution_says_and_moves_the_whole_arm():
    """The energy lost is (1 - e^2) v_j^2 / (2 W_jj); all of M qd but component j is unchanged."""
    rng = np.random.default_rng(3)
    count = 1000
    q = np.column_stack(
        [
            rng.uniform(-3, 3, count),
            np.full(count, 0.3),
            rng.uniform(-3, 3, count),
            rng.uniform(0.05, 0.25, count),
        ]
    )
    qd = rng.normal(0, 2, (count, 4))
    qd[:, 1] = np.abs(qd[:, 1]) + 0.05
    for restitution in (0.0, 0.5, 1.0):
        made = scene(UNEQUAL, restitution, gravity=0.0, control_dt=1e-9, integrator="rk4")
        batch = rde.BatchSimulator(made, count)
        batch.set_state(q, qd)
        status = batch.advance()
        assert (status.events == 1).all()
        M = UNEQUAL.mass_matrix(q)
        Wjj = np.linalg.inv(M)[:, 1, 1]
        lost = (1.0 - restitution**2) * qd[:, 1] ** 2 / (2.0 * Wjj)
        before = UNEQUAL.kinetic_energy(q, qd)
        after = UNEQUAL.kinetic_energy(q, batch.qd)
        # Over 1e-9 s the motion itself changes the velocities by some 1e-7.
        np.testing.assert_allclose(before - after, lost, atol=1e-6 * before.max())
        jump = np.einsum("nij,nj->ni", M, batch.qd - qd)
        assert np.abs(jump[:, [0, 2, 3]]).max() <= 1e-5
        np.testing.assert_allclose(batch.qd[:, 1], -restitution * qd[:, 1], atol=1e-6)


def test_the_energy_of_an_impact_to_rounding():
    """The same on the equation itself, without any motion."""
    rng = np.random.default_rng(4)
    plain = bind(contacts.touch, {p: getattr(algebra, p) for p in algebra.PRIMITIVES})
    names = algebra.gives_of(contacts.touch)
    for _ in range(1000):
        q, qd, restitution = rng.uniform(-3, 3, 4), rng.normal(0, 2, 4), rng.uniform(0, 1)
        qd[1] = abs(qd[1]) + 0.01
        M = UNEQUAL.mass_matrix(q)
        W = np.linalg.inv(M)
        got = dict(
            zip(
                names,
                plain(
                    1.0, 0.0, 0.0, 0.3, 0.1, qd[1], qd[3], 0.0, 0.0, 0.0, 0.0, 0.3, 0.3, restitution,
                    0.0, 0.0, 0.0, 0.0, 0.0, 0.0, W[1, 1], W[1, 3], W[3, 3],
                ),
                strict=True,
            )
        )  # fmt: skip
        after = qd + W[:, 1] * got["impulse_a"] + W[:, 3] * got["impulse_b"]
        assert got["struck_a"] == pytest.approx(after[1], abs=1e-12 * np.abs(qd).max())
        before = 0.5 * qd @ M @ qd
        lost = (1.0 - restitution**2) * qd[1] ** 2 / (2.0 * W[1, 1])
        assert abs(before - 0.5 * after @ M @ after - lost) <= 1e-12 * before


def test_work_books_what_impacts_take():
    trajectory = rde.simulate(scene(restitution=0.4, tolerance=1e-10), *START, np.linspace(0.02, 1.0, 50))
    balance = trajectory.kinetic_energy + trajectory.potential_energy - trajectory.work
    assert sum("impact" in x.kind for x in trajectory.events) >= 5
    assert trajectory.work[-1] < -0.1
    assert np.ptp(balance) <= 1e-8


def test_grazing_in_and_out_within_one_step():
    """2 mm from the stop at 1 m/s, turned back at 200 m/s^2: after the step it is far away again."""
    arm = rde.RPRP((1e6, 1.0, 1e-6, 1e-6), (1.0, 1.0))
    made = scene(arm, 1.0, gravity=0.0)
    for integrator, tolerance in (("rk4", None), ("rk8", None), ("rk8", 1e-6), ("dop853", None)):
        batch = rde.BatchSimulator(scene(arm, gravity=0.0, integrator=integrator, tolerance=tolerance), 1)
        batch.set_state([0.0, 0.298, 0.0, 0.1], [0.0, 1.0, 0.0, 0.0])
        force = -200.0 * (1.0 + 1e-6)
        status = batch.advance([[0.0, force, 0.0, 0.0]])
        assert status.events[0] == 1
        # It meets the stop after t, v = sqrt(1 - 2 200 0.002), and comes back with -v.
        v = math.sqrt(1.0 - 2.0 * 200.0 * 0.002)
        t = (1.0 - v) / 200.0
        expected = 0.3 - v * (0.02 - t) - 100.0 * (0.02 - t) ** 2
        if expected >= 0.0:
            assert batch.q[0, 1] == pytest.approx(expected, abs=1e-7)
    assert made.effects[-1].restitution == 1.0


def test_an_apex_at_the_stop_changes_no_energy():
    arm = rde.RPRP((1e6, 1.0, 1e-6, 1e-6), (1.0, 1.0))
    for gap in (0.0025, 0.0025 * (1 + 1e-14), 0.0025 * (1 - 1e-14), 0.0025 + 1e-9, 0.0025 - 1e-9):
        batch = rde.BatchSimulator(scene(arm, gravity=0.0, tolerance=1e-6), 1)
        batch.set_state([0.0, 0.3 - gap, 0.0, 0.1], [0.0, 1.0, 0.0, 0.0])
        status = batch.advance([[0.0, -200.0 * (1.0 + 1e-6), 0.0, 0.0]])
        assert status.events[0] in (0, 1)
        # v^2 / 2 + a x is conserved.
        x, v = batch.q[0, 1], batch.qd[0, 1]
        if x > 0.0 and status.events[0] == 0:
            assert 0.5 * v * v + 200.0 * x == pytest.approx(0.5 + 200.0 * (0.3 - gap), abs=1e-9)


def test_both_sliders_at_once_do_not_know_their_order():
    """th1 = th2, both 1e-15 s from their stops: no penetration, no gain of energy, symmetric."""
    arm = rde.RPRP((1.0,) * 4, (0.5, 0.5))
    made = scene(arm, 0.7, gravity=0.0, tolerance=1e-9)
    results = []
    for early in (0, 1):
        batch = rde.BatchSimulator(made, 1)
        q = np.array([0.4, 0.299, 0.4, 0.299])
        q[1 if early == 0 else 3] += 1e-15
        batch.set_state(q, [0.0, 1.0, 0.0, 1.0])
        before = arm.kinetic_energy(batch.q, batch.qd)
        status = batch.advance()
        assert not status.numerics[0]
        assert status.events[0] >= 2
        assert (batch.q[0, [1, 3]] <= 0.3).all()
        assert (batch.qd[0, [1, 3]] < 0.0).all()
        assert arm.kinetic_energy(batch.q, batch.qd) <= before
        results.append(np.r_[batch.q[0], batch.qd[0]])
    np.testing.assert_allclose(results[0], results[1], atol=1e-9)


def test_many_bounces_in_one_step():
    """50 m/s between stops 0.3 m apart: three bounces and more in 20 ms, no energy lost."""
    for integrator, tolerance in (("rk4", None), ("rk8", None), ("rk8", 1e-6)):
        arm = rde.RPRP((1.0,) * 4, (0.5, 0.5))
        made = scene(arm, 1.0, gravity=0.0, integrator=integrator, tolerance=tolerance)
        batch = rde.BatchSimulator(made, 1)
        batch.set_state([0.3, 0.1, 0.3, 0.1], [0.0, 50.0, 0.0, 0.0])
        before = arm.kinetic_energy(batch.q, batch.qd)[0]
        status = batch.advance()
        assert not status.numerics[0]
        assert status.events[0] >= 3
        assert arm.kinetic_energy(batch.q, batch.qd)[0] == pytest.approx(before, rel=1e-9)
        assert (np.abs(batch.q[0, [1, 3]] - 0.15) <= 0.15).all()


def test_too_many_impacts_end_the_lane_and_leave_its_neighbours():
    arm = rde.RPRP((1.0,) * 4, (0.5, 0.5))
    made = scene(arm, 1.0, gravity=0.0, tolerance=1e-6)
    batch = rde.BatchSimulator(made, 3)
    q = np.tile([0.3, 0.1, 0.3, 0.1], (3, 1))
    qd = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 1e5, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
    batch.set_state(q, qd)
    status = batch.advance()
    np.testing.assert_array_equal(status.numerics, [0, rde.Numerics.EVENT_BUDGET, 0])
    np.testing.assert_array_equal(batch.q[1], q[1])  # back where its interval began
    np.testing.assert_array_equal(batch.qd[1], qd[1])
    np.testing.assert_array_equal(batch.q[0], batch.q[2])


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_every_start_at_both_stops_goes_on(restitution):
    """All signs of speed and force, down to rounding: no lane bounces without end."""
    made = scene(restitution=restitution, tolerance=1e-6)
    choices = itertools.product(
        (0.0, 0.3), (0.0, 0.3), (-1.0, -1e-12, -1e-15, 0.0, 1e-15, 1e-12, 1.0), (-1.0, 0.0, 1e-14, 1.0),
        (-30.0, 0.0, 30.0), (-30.0, 0.0, 30.0),
    )  # fmt: skip
    a, b, va, vb, fa, fb = np.array(list(choices)).T
    zero = np.zeros_like(a)
    batch = rde.BatchSimulator(made, len(a))
    batch.set_state(np.column_stack([zero + 0.7, a, zero - 0.4, b]), np.column_stack([zero, va, zero, vb]))
    for _ in range(3):
        status = batch.advance(np.column_stack([zero, fa, zero, fb]))
        assert not status.numerics.any()
        assert (np.abs(batch.q[:, [1, 3]] - 0.15) <= 0.15).all()


@pytest.mark.parametrize(
    "kwargs", [{"integrator": "rk8"}, {"integrator": "rk4"}, {"tolerance": 1e-6}], ids=str
)
@pytest.mark.parametrize("speed", [50.0, 1e3, 1e8])
def test_steps_far_too_long_end_lanes_but_never_hang(kwargs, speed):
    """Radians per step, impacts that no search finds: flagged, between the stops, and over."""
    rng = np.random.default_rng(0)
    q = np.column_stack([rng.uniform(-3, 3, 512), rng.uniform(0, 0.3, 512)] * 2)
    batch = rde.BatchSimulator(scene(restitution=0.5, **kwargs), 512)
    batch.set_state(q, rng.normal(0, speed, (512, 4)))
    status = batch.advance(rng.normal(0, 20, (512, 4)))
    finite = np.isfinite(np.column_stack([batch.q, batch.qd])).all(axis=1)
    np.testing.assert_array_equal(finite, status.numerics & rde.Numerics.NON_FINITE == 0)
    np.testing.assert_array_equal(finite, status.finite)
    sliders = batch.q[status.finite][:, [1, 3]]
    assert (sliders >= 0.0).all()
    assert (sliders <= 0.3).all()


REACH = rde.load_scene("rprp_reach")


def test_sliders_that_meet_their_stops_together_and_turn_back_are_found():
    """Both are beyond their stops at the end of the step and began inwards: no piece is made twice."""
    batch = rde.BatchSimulator(REACH, 1)
    batch.set_state(
        [-1.5713146444638297, 0.0, -1.2969997173756138, 0.0],
        [0.23692911649314546, 2.1348563896103114e-05, -0.9254754272155492, 4.398584186074587e-06],
    )
    status = batch.advance([[14.570766490420826, -4.643575696458498, -6.314069605314101, -1.105005150928406]])
    assert not status.numerics[0]
    assert status.evaluations[0] < 1000


@pytest.mark.parametrize("speed", [1e-15, 1e-12, 1e-8, 1e-5, 1e-3])
def test_slow_sliders_at_both_stops_come_to_rest(speed):
    rng = np.random.default_rng(0)
    n = 5000
    turns, slow = rng.normal(0, 1, (n, 2)), speed * rng.normal(size=(n, 2))
    q = np.column_stack([rng.uniform(-3, 3, n), rng.choice([0, 0.25], n)] * 2)
    q[:, 3] = rng.choice([0, 0.25], n)
    batch = rde.BatchSimulator(REACH, n)
    batch.set_state(q, np.column_stack([turns[:, 0], slow[:, 0], turns[:, 1], slow[:, 1]]))
    status = batch.advance(rng.uniform(-1, 1, (n, 4)) * (20, 32, 8, 16))
    assert not status.numerics.any()
    assert status.evaluations.max() < 2000


def test_a_near_miss_of_one_slider_does_not_hide_the_graze_of_the_other():
    arm = rde.RPRP((1e6, 1.0, 1e-6, 1e-6), (1.0, 1.0))
    made = scene(arm, lower=(-0.9, -0.9), gravity=0.0, tolerance=1e-6)
    batch = rde.BatchSimulator(made, 2)
    q = [[0, 0.3 - 0.0025 * 1.02, np.pi / 2, 0.297], [0, 0.1, np.pi / 2, 0.297]]
    batch.set_state(q, [0, 1.0, 0, 1.2])
    status = batch.advance([[0, -200 * (1 + 2e-6), 0, -200e-6]] * 2)
    assert status.events.tolist() == [1, 1]
    assert batch.q[0, 3] == pytest.approx(batch.q[1, 3], abs=1e-9)


def test_a_stop_that_is_moved_away_lets_go():
    batch = rde.BatchSimulator(scene(restitution=0.0, tolerance=1e-6), 1)
    batch.set_state([-np.pi / 2, 0.3, -np.pi / 2, 0.3], [0.0] * 4)
    batch.advance()
    batch.set_parameters({"prismatic_stop.upper": [0.5, 0.5]})
    for _ in range(5):
        batch.advance()
    assert batch.q[0, 1] == pytest.approx(0.3 + 0.5 * 9.81 * 0.1**2, abs=1e-9)


@pytest.mark.parametrize("kwargs", [{"tolerance": 1e-6}, {"integrator": "rk4", "substeps": 4}], ids=str)
def test_a_lane_whose_events_are_given_up_has_not_moved(kwargs):
    batch = rde.BatchSimulator(scene(gravity=0.0, **kwargs), 2, track_work=True)
    q, qd = [[0.3, 0.1, 0.3, 0.1]] * 2, [[0.0, 1e5, 0.0, 0.0], [0.1, 0.5, 0.0, 0.0]]
    batch.set_state(q, qd)
    status = batch.advance()
    assert status.numerics.tolist() == [rde.Numerics.EVENT_BUDGET, 0]
    np.testing.assert_array_equal(batch.q[0], q[0])
    np.testing.assert_array_equal(batch.qd[0], qd[0])
    assert batch.work[0] == 0.0
    assert status.events[0] == 0
    assert not [x for x in batch.events() if x.lane == 0]


def test_a_lane_given_up_in_a_later_substep_is_back_where_its_interval_began():
    """Ever faster bounces: 25 in the first substep, too many in the second."""
    stop = e.PrismaticStop((0.0, None), (None, None), 0.97)
    made = rde.Scene(ARM, (stop,), integrator="rk4", substeps=4, control_dt=0.02, actuation="generalized")
    batch = rde.BatchSimulator(made, 1)
    batch.set_state([0.0, 0.2, 0.0, 0.2], [0.0] * 4)
    status = batch.advance([[0.0, -4e7, 0.0, 0.0]])
    assert status.numerics.tolist() == [rde.Numerics.EVENT_BUDGET]
    np.testing.assert_array_equal(batch.q, [[0.0, 0.2, 0.0, 0.2]])
    np.testing.assert_array_equal(batch.qd, np.zeros((1, 4)))


def test_the_budget_of_impacts_is_that_of_the_interval_not_of_a_substep():
    batch = rde.BatchSimulator(scene(gravity=0.0, integrator="rk4", substeps=64), 1, track_work=True)
    q, qd = [0.3, 0.1, 0.3, 0.1], [0.0, 1.5e4, 0.0, 0.0]  # some thirteen in each substep
    batch.set_state(q, qd)
    assert batch.advance().numerics.tolist() == [rde.Numerics.EVENT_BUDGET]
    np.testing.assert_array_equal(batch.q[0], q)
    assert batch.events() == []


def test_a_log_of_events_that_is_full_says_so():
    batch = rde.BatchSimulator(scene(gravity=0.0, tolerance=1e-6), 2, track_work=True)
    batch.set_state([[0.3, 0.1, 0.3, 0.1]] * 2, np.zeros((2, 4)))
    batch.advance()
    batch._memory.write(("logged",), 256.0, np.array([1]))
    with pytest.raises(ValueError, match="environment 1 had 256 events or more"):
        batch.events()


@pytest.mark.long
def test_a_slider_thrown_off_its_stop_by_the_other_is_let_go_in_the_log():
    """Slider 1 rests at its upper stop until the impact of slider 2 throws it off."""
    arm = rde.RPRP((1.0,) * 4, (0.5, 0.5))
    made = scene(arm, 1.0, gravity=0.0, tolerance=1e-9, actuation="generalized")
    motion = rde.simulate(
        made, [0.0, 0.3, 0.0, 0.1], [0.0, 0.0, 0.0, -1.0], np.linspace(0.02, 0.2, 10), [0.0, 1.0, 0.0, 0.0]
    )
    kinds = [(x.kind, x.joint) for x in motion.events]
    hit = kinds.index(("lower impact", "r2"))
    assert ("rest", "r1") in kinds[:hit]
    assert ("release", "r1") in kinds[hit - 1 : hit + 2]  # at the same time
    assert all(str(x.speed) != "-0.0" for x in motion.events)


def test_simulate_refuses_a_motion_with_too_many_impacts():
    with pytest.raises(ValueError, match="more than 256 times in the control interval at t = 0 s"):
        rde.simulate(scene(gravity=0.0, tolerance=1e-6), [0.3, 0.1, 0.3, 0.1], [0, 1e5, 0, 0], [0.02, 0.04])


def test_a_hard_stop_decides_the_travel():
    springs = (e.LimitSpring("r1", -0.1, 0.5), e.LimitSpring("r2", -0.1, 0.5))
    stop = e.PrismaticStop((0.0, 0.0), (0.25, 0.25))
    for effects in ((stop, *springs), (*springs, stop)):
        assert rde.Scene(ARM, effects).travel()[1] == ("prismatic_stop.lower[0]", "prismatic_stop.upper[0]")


# ---- rest and release ----------------------------------------------------------------------------


@pytest.mark.parametrize(("restitution", "end"), [(0.5, 0.741929), (0.9, 4.6989)])
def test_bounces_come_to_rest_when_they_should(restitution, end):
    """A ball of 1e-12 kg falls 0.3 m: rest at sqrt(2 h / g) (1 + e) / (1 - e)."""
    arm = rde.RPRP((1.0, 1.0, 1.0, 1e-12), (0.5, 0.5))
    stop = e.PrismaticStop((None, None), (None, 0.3), restitution)
    made = rde.Scene(arm, (e.Gravity(9.81), stop), control_dt=0.02, tolerance=1e-9)
    start = [-math.pi / 2, 0.1, -math.pi / 2, 0.0]
    # The slider of link 1 falls with its link's end; keep it where it is: it hangs on its own stop.
    stop = e.PrismaticStop((None, None), (0.1, 0.3), restitution)
    made = rde.Scene(arm, (e.Gravity(9.81), stop), control_dt=0.02, tolerance=1e-9)
    trajectory = rde.simulate(made, start, [0.0] * 4, [end + 0.3, end + 10.0])
    rests = [x for x in trajectory.events if x.kind == "rest" and x.joint == "r2"]
    impacts = [x for x in trajectory.events if x.kind == "upper impact" and x.joint == "r2"]
    assert len(rests) == 1
    last = impacts[-1]
    recorded = last.time + 2.0 * restitution * last.speed / (9.81 * (1.0 - restitution))
    exact = math.sqrt(2.0 * 0.3 / 9.81) * (1.0 + restitution) / (1.0 - restitution)
    assert exact == pytest.approx(end, abs=1e-4)
    assert recorded == pytest.approx(exact, abs=1e-6)
    assert trajectory.q[-1, 3] == trajectory.q[0, 3] == 0.3
    assert trajectory.qd[-1, 3] == 0.0


def test_an_elastic_slider_rests_only_where_it_does_not_bounce():
    made = scene(restitution=1.0, upper=(0.3, 0.3), tolerance=1e-9)
    hanging = [-math.pi / 2, 0.3, -math.pi / 2, 0.3]
    trajectory = rde.simulate(made, hanging, [0.0] * 4, [1.0])
    assert {x.kind for x in trajectory.events} == {"rest"}
    np.testing.assert_allclose(trajectory.q[0], hanging, atol=1e-15)
    dropped = rde.simulate(made, [-math.pi / 2, 0.29, -math.pi / 2, 0.3], [0.0] * 4, [1.0])
    assert sum("impact" in x.kind and x.joint == "r1" for x in dropped.events) > 5


def test_pressed_held_and_let_go_within_an_interval():
    """The arm turns and gravity pulls them back: let go when the force that holds vanishes."""
    arm, q = UNEQUAL, [-1.2, 0.3, -1.2, 0.3]
    times = []
    for accuracy in (1e-6, 1e-12):
        made = scene(arm, 0.0, tolerance=accuracy)
        times_asked, efforts = np.linspace(0.02, 0.6, 30), [30.0, -20.0, 8.0, -3.0]
        trajectory = rde.simulate(made, q, [0.0] * 4, times_asked, efforts)
        released = [x for x in trajectory.events if x.kind == "release" and x.time > 0.0]
        times.append([x.time for x in released])
        held = trajectory.t < (released[0].time if released else 1.0)
        assert (trajectory.q[held, 1] <= 0.3).all()
    assert len(times[0]) == len(times[1]) >= 1
    assert abs(times[0][0] - times[1][0]) <= 1e-7


def test_a_force_reversed_at_an_instant_lets_go_at_once():
    arm = rde.RPRP((1.0,) * 4, (0.5, 0.5))
    made = scene(arm, 0.3, gravity=0.0, tolerance=1e-9)
    batch = rde.BatchSimulator(made, 1, track_work=True)
    batch.set_state([0.0, 0.0, 0.0, 0.1], np.zeros(4))
    for _ in range(250):
        batch.advance([[0.0, -10.0, 0.0, 0.0]])
    assert batch.q[0, 1] == 0.0
    assert batch.qd[0, 1] == 0.0
    batch.advance([[0.0, 10.0, 0.0, 0.0]])
    (event,) = batch.events(5.0)
    assert event.kind == "release"
    assert event.time == 5.0
    assert batch.q[0, 1] > 0.0


# ---- bits, snapshots, refusals -------------------------------------------------------------------


def random_batch(count, seed=5):
    rng = np.random.default_rng(seed)
    q = np.column_stack([rng.uniform(-3, 3, count), rng.uniform(0, 0.3, count)] * 2)
    q[::7, 1] = 0.3
    return q, rng.normal(0, 2, (count, 4)), rng.uniform(-20, 20, (count, 4))


@pytest.mark.parametrize(
    "kwargs",
    [{"integrator": "rk4", "substeps": 5}, {"integrator": "euler", "substeps": 20}, {"tolerance": 1e-6},
     {"integrator": "dop853"}],
    ids=str,
)  # fmt: skip
def test_bits_depend_on_the_lane_alone(kwargs):
    made = scene(UNEQUAL, 0.5, **kwargs)
    q, qd, efforts = random_batch(150)

    def run(index, **more):
        batch = rde.BatchSimulator(made, len(index), **more)
        batch.set_state(q[index], qd[index])
        events = np.zeros(len(index), dtype=int)
        for _ in range(8):
            status = batch.advance(efforts[index])
            events += status.events
            assert not status.numerics.any()
        assert (batch.q[:, [1, 3]] >= 0.0).all()
        assert (batch.q[:, [1, 3]] <= 0.3).all()
        return np.concatenate([batch.q, batch.qd], axis=1), events

    whole, events = run(np.arange(150))
    assert events.sum() > 100
    threaded, _ = run(np.arange(150), threads=3)
    np.testing.assert_array_equal(threaded, whole)
    order = np.random.default_rng(1).permutation(150)
    np.testing.assert_array_equal(run(order)[0], whole[order])
    for lane in (0, 7, 149):
        np.testing.assert_array_equal(run(np.array([lane]))[0][0], whole[lane])


def test_two_substeps_are_two_intervals_bit_for_bit():
    q, qd, efforts = random_batch(64, 6)
    batches = [
        rde.BatchSimulator(scene(UNEQUAL, 0.5, integrator="rk4", substeps=s, control_dt=0.01 * s), 64)
        for s in (2, 1)
    ]
    for batch in batches:
        batch.set_state(q, qd)
    for _ in range(10):
        batches[0].advance(efforts)
        batches[1].advance(efforts)
        batches[1].advance(efforts)
    np.testing.assert_array_equal(batches[0].q, batches[1].q)
    np.testing.assert_array_equal(batches[0].qd, batches[1].qd)


def test_a_snapshot_holds_who_rests():
    made = scene(UNEQUAL, 0.0, tolerance=1e-6)
    q, qd, efforts = random_batch(40, 7)
    batch = rde.BatchSimulator(made, 40)
    batch.set_state(q, qd)
    for _ in range(20):
        batch.advance(efforts)
    snapshot = batch.save()
    ends = []
    for _ in range(2):
        batch.restore(snapshot)
        for _ in range(10):
            batch.advance(efforts)
        ends.append(batch.q)
    np.testing.assert_array_equal(*ends)


def test_a_slider_beyond_its_stop_is_refused():
    batch = rde.BatchSimulator(scene(), 3)
    q = np.tile([0.0, 0.1, 0.0, 0.1], (3, 1))
    batch.set_state(q, np.zeros(4))
    q[1, 3] = 0.31
    with pytest.raises(ValueError, match=r"r2 is 0.31 m; its stops are at 0 and 0.3 m"):
        batch.set_state(q, np.zeros(4))
    with pytest.raises(ValueError, match=r"r1 is 0.1 m; its stops are at 0 and 0.05"):
        batch.set_parameters({"prismatic_stop.upper": [0.05, 0.3]}, index=[2])
    np.testing.assert_array_equal(batch.q[:, [1, 3]], 0.1)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (((0.3, 0.0), (0.0, 0.3)), ("lower[0]", "0.3", "below")),
        (((0.0, 0.0), (0.3, math.nan)), ("upper[1]", "nan", "finite")),
        (((0.0,), (0.3, 0.3)), ("lower", "two")),
        (((0.0, 0.0), (0.3, 0.3), 1.5), ("restitution", "1.5", "0 to 1")),
    ],
)
def test_stops_that_cannot_be(arguments, words):
    with pytest.raises(ValueError, match="PrismaticStop") as error:
        e.PrismaticStop(*arguments)
    assert all(w in str(error.value) for w in words)


def test_stops_are_for_the_sliders_of_rprp():
    with pytest.raises(ValueError, match="FourR has 0"):
        rde.Scene(rde.FourR((1,) * 4, (1,) * 4), (e.PrismaticStop((0, 0), (1, 1)),))


def test_stops_survive_their_file():
    made = rde.Scene(ARM, (e.PrismaticStop((None, 0.0), (0.3, None), 0.5),))
    assert rde.Scene.from_dict(json.loads(json.dumps(made.to_dict()))) == made
    assert made.travel() == {}
    assert scene().travel()[1] == ("prismatic_stop.lower[0]", "prismatic_stop.upper[0]")


def test_a_scene_without_stops_has_no_trace_of_them():
    from redundant_envs.evaluators.assemble import assemble

    assert "stop" not in assemble(rde.Scene(ARM, (e.Gravity(),), tolerance=1e-6)).text
