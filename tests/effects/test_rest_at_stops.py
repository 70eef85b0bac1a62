"""Sliders at rest at their stops: when they come to rest, how long they stay, and their release."""

import itertools
import math

import numpy as np
import pytest
from stopped_scenes import UNEQUAL, scene

import redundant_envs as rde

REACH = rde.load_scene("rprp_reach")


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


def test_sliders_that_meet_their_stops_together_and_turn_back_are_found():
    """Both are beyond their stops at the end of the step and began inwards: no piece is repeated."""
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


def test_a_stop_that_is_moved_away_lets_go():
    batch = rde.BatchSimulator(scene(restitution=0.0, tolerance=1e-6), 1)
    batch.set_state([-np.pi / 2, 0.3, -np.pi / 2, 0.3], [0.0] * 4)
    batch.advance()
    batch.set_parameters({"prismatic_stop.upper": [0.5, 0.5]})
    for _ in range(5):
        batch.advance()
    assert batch.q[0, 1] == pytest.approx(0.3 + 0.5 * 9.81 * 0.1**2, abs=1e-9)


def test_an_elastic_slider_rests_only_where_it_does_not_bounce():
    made = scene(restitution=1.0, upper=(0.3, 0.3), tolerance=1e-9)
    hanging = [-math.pi / 2, 0.3, -math.pi / 2, 0.3]
    trajectory = rde.simulate(made, hanging, [0.0] * 4, [1.0])
    assert {x.kind for x in trajectory.events} == {"rest"}
    np.testing.assert_allclose(trajectory.q[0], hanging, atol=1e-15)
    dropped = rde.simulate(made, [-math.pi / 2, 0.29, -math.pi / 2, 0.3], [0.0] * 4, [1.0])
    assert sum("impact" in x.kind and x.joint == "r1" for x in dropped.events) > 5


def test_pressed_held_and_let_go_within_an_interval():
    """The arm turns and gravity pulls them back: they are released when the holding force vanishes."""
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
