"""Dry friction together with hard stops and walls: both decide at once which joints stay at rest."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from catalogue import RPRP, advanced, stops

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects.hooks import Effect
from redundant_envs.language.algebra import physics
from redundant_envs.simulator.lane.direct import cross_interval, fields_of
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.interval import Interval

CASES = json.loads((Path(__file__).parents[1] / "oracles" / "stiction_rprp.json").read_text())
"""Motions of 1 s between inelastic stops by another program, up to 49 events each."""
EXACT = {"1e-12": {"tolerance": 1e-12}, "dop853": {"integrator": "dop853"}}
METHODS = {
    "euler": {"integrator": "euler"},
    "rk4": {"integrator": "rk4"},
    "rk8": {},
    "1e-6": {"tolerance": 1e-6},
    **EXACT,
}


def joints_at(arm, phi):
    return np.asarray(phi) @ np.linalg.inv(arm.motor_map)


def energy(batch, g):
    arm = batch.scene.robot
    return arm.kinetic_energy(batch.q, batch.qd) + arm.potential_energy(batch.q, g)


@pytest.mark.long
@pytest.mark.parametrize("how", EXACT.values(), ids=EXACT)
@pytest.mark.parametrize("case", CASES, ids=range(len(CASES)))
def test_motions_of_another_program(case, how):
    arm, g = rde.RPRP(tuple(case["masses"]), tuple(case["lengths"])), case["gravity"]
    ends = stops(arm, case["restitution"], case["lower"], case["upper"])
    effects = (e.Gravity(g), e.CoulombFriction(tuple(case["limits"])), ends)
    batch = rde.BatchSimulator(rde.Scene(arm, effects, control_dt=0.02, **how), track_work=True)
    batch.set_state(joints_at(arm, case["phi"]), joints_at(arm, case["phid"]))
    begun = energy(batch, g)
    for efforts in case["efforts"]:
        assert not batch.advance(efforts).numerics.any()
    np.testing.assert_allclose(arm.forward_kinematics(batch.q)[0], case["tip"], rtol=0.0, atol=1e-10)
    rates = (batch.qd @ arm.motor_map)[0]
    assert (np.sign(rates) == case["modes"]).all()
    largest = max(abs(begun[0]), abs(energy(batch, g)[0]), abs(batch.work[0]), 1.0)
    assert abs(energy(batch, g) - begun - batch.work)[0] < 1e-11 * largest


@pytest.mark.long
@pytest.mark.parametrize("how", METHODS.values(), ids=METHODS)
def test_arms_below_their_limits_at_and_near_stops_keep_every_bit_for_ten_seconds(how):
    """Friction alone holds most joints, by 0.999 of its limits; sliders that are pressed onto a stop have a
    hundredth of it."""
    rng = np.random.default_rng(5)
    q, efforts = rng.uniform(-1.0, 1.0, (16, 4)), rng.uniform(-5.0, 5.0, (16, 4))
    q[:, [1, 3]] = rng.choice([0.0, 0.3, 1e-9, np.nextafter(0.3, 0.0), 0.1], (16, 2))
    load = efforts - RPRP.gravity_forces(q) @ np.linalg.inv(RPRP.motor_map).T
    level = np.abs(load) / 0.999
    pressed = ((q == 0.0) & (load < 0.0)) | ((q == 0.3) & (load > 0.0))
    assert 4 < pressed.sum() < 16
    level[pressed] *= 0.01
    batch, _ = advanced(
        rde.Scene(RPRP, (e.Gravity(), e.CoulombFriction(1.0), stops(RPRP)), **how), q, 0.0 * q,
        change={"coulomb_friction.level": level}, intervals=0,
    )  # fmt: skip
    for _ in range(500):
        batch.advance(efforts)
    assert np.array_equal(batch.q, q)
    assert not batch.qd.any()


@pytest.mark.long
def test_modes_of_all_joints_and_stops_are_decided_at_once():
    """From rest, each joint accelerates against its friction, or has the rate 0; a stop adds any force that
    pushes its slider away."""
    rng, n = np.random.default_rng(12), 512
    q, level = rng.uniform(-3.0, 3.0, (n, 4)), rng.uniform(0.0, 4.0, (n, 4))
    q[:, [1, 3]] = rng.choice([0.0, 0.3, 0.1], (n, 2))
    level[rng.random((n, 4)) < 0.2] = 0.0
    efforts = rng.uniform(-1.0, 1.0, (n, 4)) * 8.0
    batch, _ = advanced(
        rde.Scene(RPRP, (e.CoulombFriction(1.0), stops(RPRP)), control_dt=1e-6), q, 0.0 * q, efforts,
        {"coulomb_friction.level": level},
    )  # fmt: skip
    rates, inverse = batch.qd @ RPRP.motor_map, np.linalg.inv(RPRP.motor_map)
    M = inverse @ RPRP.mass_matrix(q) @ inverse.T
    needed = np.einsum("nij,nj->ni", M, rates) / 1e-6 - efforts  # the mean force of friction and stops
    side = np.where(np.array(RPRP.prismatic), np.where(q == 0.0, -1.0, np.where(q == 0.3, 1.0, 0.0)), 0.0)
    moves = rates != 0.0
    assert (side * rates <= 0.0).all()
    np.testing.assert_allclose(needed[moves], (-np.sign(rates) * level)[moves], rtol=0.0, atol=1e-7)
    least, most = (np.where(side == s, np.inf, level) for s in (1.0, -1.0))
    assert (needed[~moves] >= -least[~moves] - 1e-7).all()
    assert (needed[~moves] <= most[~moves] + 1e-7).all()
    assert 0.2 < moves.mean() < 0.8


# ---- a slider alone -------------------------------------------------------------------------------------

SLIDER = rde.Chain("P", (2.0,), ())


def alone(restitution=0.5, level=1.0, **how):
    """A mass of 2 kg between stops at 0 and 0.3 m, with dry friction."""
    return rde.Scene(SLIDER, (e.CoulombFriction(level), stops(SLIDER, restitution)), **how)


@pytest.mark.quick("0.5-1e-12")
@pytest.mark.parametrize("how", EXACT.values(), ids=EXACT)
@pytest.mark.parametrize("restitution", [0.5, 1.0])
def test_bounces_under_friction_fade_as_they_should(restitution, how):
    """From rest 3 N push it to the upper stop against 1 N: it gains (3 - 1)/2 m/s^2 on its way there, and
    loses (3 + 1)/2 on its way back."""
    towards, away, rates, time = 1.0, 2.0, [np.sqrt(2.0 * 0.3)], np.sqrt(2.0 * 0.3)
    for _ in range(2):
        bounce = restitution * rates[-1]
        rates.append(bounce * np.sqrt(towards / away))
        time += bounce / away + rates[-1] / towards
    bounce, after = restitution * rates[-1], 0.02
    made = alone(restitution, control_dt=time + after, **how)
    batch, _ = advanced(made, [0.0], [0.0], [3.0])
    assert batch.q[0, 0] == pytest.approx(0.3 - bounce * after + 0.5 * away * after**2, abs=1e-11)
    assert batch.qd[0, 0] == pytest.approx(-bounce + away * after, abs=1e-10)
    for _ in range(12):
        status = batch.advance([3.0])
        assert not status.numerics.any()
    assert batch.q[0, 0] == 0.3
    assert batch.qd[0, 0] == 0.0


@pytest.mark.quick("0.5")
@pytest.mark.parametrize("rate", [0.5, 1e-5])
def test_friction_that_exceeds_the_push_ends_a_bounce_where_it_is(rate):
    """Even a bounce of less than 1e-9 m, which would otherwise count as none."""
    batch, _ = advanced(alone(integrator="dop853"), [0.3], [rate], [0.5], intervals=20)
    rise = (0.5 * rate) ** 2 / (2.0 * (1.0 + 0.5) / 2.0)
    assert batch.q[0, 0] == pytest.approx(0.3 - rise, abs=1e-15)
    assert batch.qd[0, 0] == 0.0


def test_an_elastic_slider_with_friction_comes_to_rest_within_the_impacts_of_an_interval():
    """From 1e-7 m it would bounce hundreds of times until its bounces are lost in rounding."""
    batch, _ = advanced(alone(1.0, 0.05), [0.3 - 1e-7], [0.0], [3.0], intervals=0)
    for _ in range(10):
        assert not batch.advance([3.0]).numerics.any()
    assert batch.q[0, 0] == 0.3
    assert batch.qd[0, 0] == 0.0


@pytest.mark.long
def test_many_turns_in_an_interval_keep_its_tolerance():
    """An elastic slider at its stop bounces 25 times, and each turn is found a little late: with a millionth
    of the step for each, the tip was off by 2.3 tolerances."""
    change = {
        "masses": (0.69920851, 0.33612694, 0.73525264, 0.31453977), "lengths": (0.32852193, 0.28218189),
        "coulomb_friction.level": (2.02688593, 0.01797826, 0.02962466, 0.62351981),
        "prismatic_stop.restitution": 1.0, "prismatic_stop.upper": (0.25, 0.25),
    }  # fmt: skip
    q = joints_at(RPRP, (1.71024203, 0.24997825, 1.03931679, 0.0))
    efforts, ends = (-3.99983506, 9.99523802, 3.99960581, -9.99959417), []
    for how in ({"tolerance": 1e-6}, {"integrator": "dop853"}):
        made = rde.Scene(RPRP, (e.Gravity(), e.CoulombFriction(1.0), stops(RPRP)), **how)
        batch, status = advanced(made, q, 0.0 * q, efforts, change)
        assert status.events[0] == 25
        ends.append(batch.q)
    assert np.abs(ends[0] - ends[1]).max() < 0.5e-6


def test_a_slider_leaves_its_stop_when_the_pull_passes_its_friction():
    """Friction 1 N and a lagged pull of 1.6 N, from 0: the time of the release tells the later motion."""
    f, u, T, t, m = 1.0, 1.6, 0.05, 1e-4, 2.0
    release = -T * np.log(1.0 - f / u)
    made = rde.Scene(SLIDER, (*alone().effects, e.Lag(T)), integrator="dop853", control_dt=release + t)
    batch, _ = advanced(made, [0.3], [0.0], [-u])
    rate = ((u - f) * t - (u - f) * T * -np.expm1(-t / T)) / m
    slope = (u - f) * -np.expm1(-t / T) / m
    assert abs(batch.qd[0, 0] + rate) / slope < 1e-11
    pressed, _ = advanced(made, [0.3], [0.0], [1000.0 * u], intervals=20)
    assert pressed.q[0, 0] == 0.3
    assert pressed.qd[0, 0] == 0.0


# ---- all together ---------------------------------------------------------------------------------------


@physics
def gap_right(tip_x, place):
    return place - tip_x


@dataclass(frozen=True)
class Wall(Effect):
    """A wall to the right of the tip."""

    place: float
    restitution: float

    def hooks(self, arm):
        return (e.Gap(gap_right, ".restitution", {"place": ".place"}),)


EVERYTHING = e.Gravity(), e.CoulombFriction((0.6, 0.5, 0.4, 0.3)), stops(RPRP, 0.4), Wall(0.3, 0.4)


def started(**how):
    """Arms with friction, stops and a wall, at rest or not, some sliders at their stops."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-3.0, 3.0, (400, 4))
    q[:, [1, 3]] = rng.choice([0.0, 0.3, 0.1, 0.2], (400, 2))
    q = q[RPRP.forward_kinematics(q)[:, 0] < 0.25][:48]
    qd = rng.choice([0.0, 0.0, 1.0, -1.0], q.shape)
    batch, _ = advanced(rde.Scene(RPRP, EVERYTHING, **how), q, qd, intervals=0)
    return batch


@pytest.mark.long
def test_stops_walls_and_friction_go_together_and_the_energy_book_closes():
    """Fine steps without error control and dop853 agree."""
    ends = []
    for how in ({"integrator": "dop853"}, {"substeps": 32}):
        batch = started(**how)
        tracked = rde.BatchSimulator(batch.scene, batch.num_envs, track_work=True)
        tracked.set_state(batch.q, batch.qd)
        begun, impacts = energy(tracked, 9.81), 0
        for k in range(5):
            efforts = np.random.default_rng(k).uniform(-5.0, 5.0, batch.q.shape)
            status = tracked.advance(efforts)
            impacts += status.events.sum()
            assert not status.numerics.any()
        assert impacts > 20
        assert np.abs(energy(tracked, 9.81) - begun - tracked.work).max() < 1e-11 * np.abs(begun).max()
        ends.append(RPRP.forward_kinematics(tracked.q))
    assert np.abs(ends[0] - ends[1]).max() < 1e-10


@pytest.mark.long
def test_lanes_alone_have_the_bits_of_a_batch_and_numpy_agrees():
    batch = started(tolerance=1e-6)
    efforts = np.random.default_rng(1).uniform(-5.0, 5.0, batch.q.shape)
    dynamics = Dynamics(batch.scene)
    values = [*batch.q.T, *batch.qd.T, *efforts.T]
    states = dict(zip((*dynamics.states, *dynamics.commands), values, strict=True))
    alone, _ = advanced(batch.scene, batch.q[7:8], batch.qd[7:8], efforts[7:8])
    batch.advance(efforts)
    assert np.array_equal(alone.q[0], batch.q[7])
    several, one = (
        cross_interval(Interval(dynamics), fields_of(dynamics) | given)
        for given in (states, {name: x[7] for name, x in states.items()})
    )
    for name, q in zip(RPRP.coordinates, batch.q.T, strict=True):
        np.testing.assert_allclose(several[name], q, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(one[name], q[7], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(("tolerance", "bounces"), [(1e-6, False), (1e-9, True)])
def test_how_low_a_bounce_ends_in_rest_follows_from_the_tolerance(tolerance, bounces):
    """A slider of 1 kg leaves its stop to a height of 1e-10 m, is back after 9 us, and is seen after 12."""
    effects = e.JointStop((0.0,), (1.0,), 0.9), e.CoulombFriction(1e-6)
    scene = rde.Scene(rde.Chain("P", (1.0,)), effects, control_dt=1.2e-5, tolerance=tolerance)
    batch, _ = advanced(scene, [[0.0]], [[np.sqrt(2.0 * 10.0 * 1e-10)]], [[-10.0]])
    assert bool(batch.qd[0, 0]) is bounces
