"""Hard stops: impacts where and when they happen, never beyond an end, the same bits, and refusals."""

import json
import math

import numpy as np
import pytest
from stopped_scenes import ARM, START, UNEQUAL, random_batch, scene

import redundant_envs as rde

e = rde.effects


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


def test_a_near_miss_of_one_slider_does_not_hide_the_graze_of_the_other():
    arm = rde.RPRP((1e6, 1.0, 1e-6, 1e-6), (1.0, 1.0))
    made = scene(arm, lower=(-0.9, -0.9), gravity=0.0, tolerance=1e-6)
    batch = rde.BatchSimulator(made, 2)
    q = [[0, 0.3 - 0.0025 * 1.02, np.pi / 2, 0.297], [0, 0.1, np.pi / 2, 0.297]]
    batch.set_state(q, [0, 1.0, 0, 1.2])
    status = batch.advance([[0, -200 * (1 + 2e-6), 0, -200e-6]] * 2)
    assert status.events.tolist() == [1, 1]
    assert batch.q[0, 3] == pytest.approx(batch.q[1, 3], abs=1e-9)


def test_a_hard_stop_decides_the_travel():
    springs = (e.LimitSpring("r1", -0.1, 0.5), e.LimitSpring("r2", -0.1, 0.5))
    stop = e.PrismaticStop((0.0, 0.0), (0.25, 0.25))
    for effects in ((stop, *springs), (*springs, stop)):
        assert rde.Scene(ARM, effects).travel()[1] == ("prismatic_stop.lower[0]", "prismatic_stop.upper[0]")


# ---- bits, snapshots, refusals -------------------------------------------------------------------


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
        (((0.0,), (0.3, 0.3)), ("lower has 1 entries", "upper 2")),
        (((0.0, 0.0), (0.3, 0.3), 1.5), ("restitution", "1.5", "0 to 1")),
    ],
)
def test_stops_that_cannot_be(arguments, words):
    with pytest.raises(ValueError, match="PrismaticStop") as error:
        e.PrismaticStop(*arguments)
    assert all(w in str(error.value) for w in words)


def test_stops_are_for_arms_with_as_many_sliders():
    with pytest.raises(ValueError, match="RPRP has 2: give as many"):
        rde.Scene(ARM, (e.PrismaticStop((0,), (1,)),))
    with pytest.raises(ValueError, match="FourR has none"):
        rde.Scene(rde.FourR((1,) * 4, (1,) * 4), (e.PrismaticStop((0, 0), (1, 1)),))


def test_stops_survive_their_file():
    made = rde.Scene(ARM, (e.PrismaticStop((None, 0.0), (0.3, None), 0.5),))
    assert rde.Scene.from_dict(json.loads(json.dumps(made.to_dict()))) == made
    assert made.travel() == {}
    assert scene().travel()[1] == ("prismatic_stop.lower[0]", "prismatic_stop.upper[0]")


def test_a_scene_without_stops_has_no_trace_of_them():
    """No operation and no field, even where lanes take steps of their own."""
    bare = rde.Scene(ARM, (e.Gravity(),), tolerance=1e-6)
    without, with_stops = rde.listing(bare), rde.listing(scene(tolerance=1e-6))
    for word in ("prismatic_stop", "active_stop", "touching", "impacts", "released_r1", "contacts.py"):
        assert word in with_stops, word
        assert word not in without, word
