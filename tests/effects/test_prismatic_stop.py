"""Hard stops: impacts where and when they happen, never beyond an end, the same bits, and refusals."""

import json
import math

import numpy as np
import pytest
from stopped_scenes import ARM, START, UNEQUAL, random_batch, scene

import redundant_envs as rde

e = rde.effects


# ---- impacts -------------------------------------------------------------------------------------


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


def test_work_books_what_impacts_take():
    trajectory = rde.simulate(scene(restitution=0.4, tolerance=1e-10), *START, np.linspace(0.02, 1.0, 50))
    balance = trajectory.kinetic_energy + trajectory.potential_energy - trajectory.work
    assert sum("impact" in x.kind for x in trajectory.events) >= 5
    assert trajectory.work[-1] < -0.1
    assert np.ptp(balance) <= 1e-8


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
    """No operation and no field, even if lanes take local steps."""
    bare = rde.Scene(ARM, (e.Gravity(),), tolerance=1e-6)
    without, with_stops = rde.listing(bare), rde.listing(scene(tolerance=1e-6))
    for word in ("prismatic_stop", "active_stop", "touching", "impacts", "released_r1", "contacts.py"):
        assert word in with_stops, word
        assert word not in without, word


UNITS = {"tolerance": {"tolerance": 1e-9}, "rk4": {"integrator": "rk4", "substeps": 3}}


@pytest.mark.parametrize("how", UNITS.values(), ids=UNITS)
@pytest.mark.parametrize("doublings", [-24, -6, 10])
def test_the_unit_of_time_changes_no_bit_of_a_motion_with_impacts(how, doublings):
    """Found by fuzzing: a nanosecond was neglected, so fast sliders missed tolerances in short intervals."""
    arm, stop = rde.RPRP((0.33, 0.25, 0.28, 0.33), (0.14, 0.14)), ((0.0, 0.0), (0.02, 0.02), 0.9)
    rng, n = np.random.default_rng(0), 512
    q = rng.uniform((-3.0, 0.0, -3.0, 0.0), (3.0, 0.02, 3.0, 0.02), (n, 4))
    qd, efforts = rng.normal(0.0, (5.0, 0.5, 5.0, 0.5), (n, 4)), rng.normal(0.0, 1.0, (n, 4))
    found = []
    for unit in (1.0, 2.0**doublings):
        scene = rde.Scene(arm, (e.PrismaticStop(*stop),), control_dt=0.02 * unit, **how)
        batch = rde.BatchSimulator(scene, n)
        batch.set_state(q, qd / unit)
        status = batch.advance(efforts / unit**2)
        assert not status.numerics.any()
        assert status.events.sum() > 400
        found.append((batch.q, batch.qd * unit, status.evaluations))
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)
