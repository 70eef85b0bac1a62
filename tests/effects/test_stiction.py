"""Dry friction: joints that stick do so to the last bit, and stick and slip are located in time, also beside
hard stops and walls, with which friction decides at once which joints stay at rest."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, advanced, stops

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects.hooks import Effect, Friction
from redundant_envs.language.algebra import exp, physics

CASES = {
    f"{name} {k}": case
    for name in ("four_r", "rprp")
    for k, case in enumerate(
        json.loads((Path(__file__).parents[1] / "oracles" / f"stiction_{name}.json").read_text())
    )
}
"""Motions of 1 s of 4R, and of RPRP between inelastic stops, by other programs: up to 77 events each."""
EXACT = {"1e-12": {"tolerance": 1e-12}, "dop853": {"integrator": "dop853"}}
METHODS = {"euler": {"integrator": "euler"}, "rk8": {}, "1e-6": {"tolerance": 1e-6}, **EXACT}
WITH = pytest.mark.parametrize("how", METHODS.values(), ids=METHODS)
EXACTLY = pytest.mark.parametrize("how", EXACT.values(), ids=EXACT)
ARMS = pytest.mark.parametrize("arm", [FOUR_R, RPRP], ids=["4R", "RPRP with stops"])
HELD = 1e6
"""A level that no motor here overcomes."""


def with_stops(arm, *effects, **how):
    return rde.Scene(arm, (*effects, stops(arm)) if arm.sliders() else effects, **how)


def energy(batch, g=9.81):
    arm = batch.scene.robot
    return arm.kinetic_energy(batch.q, batch.qd) + arm.potential_energy(batch.q, g)


@pytest.mark.long
@EXACTLY
@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_motions_of_another_program(case, how):
    kind, g = rde.RPRP if "restitution" in case else rde.FourR, case["gravity"]
    arm = kind(tuple(case["masses"]), tuple(case["lengths"]))
    effects = e.Gravity(g), e.CoulombFriction(tuple(case["limits"]))
    if arm.sliders():
        effects = *effects, stops(arm, case["restitution"], case["lower"], case["upper"])
    q, qd = np.array([case["phi"], case["phid"]]) @ np.linalg.inv(arm.motor_map)
    scene = rde.Scene(arm, effects, control_dt=0.02, **how)
    batch, _ = advanced(scene, q, qd, intervals=0, track_work=True)
    begun = energy(batch, g)
    for efforts in case["efforts"]:
        assert not batch.advance(efforts).numerics.any()
    np.testing.assert_allclose(arm.forward_kinematics(batch.q)[0], case["tip"], rtol=0.0, atol=1e-10)
    modes = np.sign(batch.qd @ arm.motor_map)[0]
    assert (modes == case.get("modes", modes)).all()
    largest = max(abs(begun[0]), abs(energy(batch, g)[0]), abs(batch.work[0]), 1.0)
    assert abs(energy(batch, g) - begun - batch.work)[0] < 1e-11 * largest


# ---- rest ---------------------------------------------------------------------------------------------


@pytest.mark.long
@WITH
@ARMS
def test_an_arm_below_its_limits_keeps_every_bit_for_ten_seconds(arm, how):
    """A smooth law creeps, and sign(v) and a dead band of rates jitter. Friction holds the joints by 0.999 of
    its limits; sliders that are pressed onto a stop have a hundredth of it."""
    rng = np.random.default_rng(5)
    q, efforts = rng.uniform(-1.0, 1.0, (16, 4)), rng.uniform(-5.0, 5.0, (16, 4))
    sliders = list(arm.sliders())
    q[:, sliders] = rng.choice([0.0, 0.3, 1e-9, np.nextafter(0.3, 0.0), 0.1], (16, len(sliders)))
    load = efforts - arm.gravity_forces(q) @ np.linalg.inv(arm.motor_map).T
    pressed = np.array(arm.prismatic) & (((q == 0.0) & (load < 0.0)) | ((q == 0.3) & (load > 0.0)))
    assert pressed.any() == bool(sliders)
    level = np.abs(load) / 0.999 * np.where(pressed, 0.01, 1.0)
    made = with_stops(arm, e.Gravity(), e.CoulombFriction(1.0), **how)
    batch, _ = advanced(made, q, 0.0 * q, efforts, {"coulomb_friction.level": level}, intervals=500)
    assert np.array_equal(batch.q, q)
    assert not batch.qd.any()


@pytest.mark.quick("4R-euler")
@WITH
@ARMS
def test_modes_of_all_joints_and_stops_are_decided_at_once(arm, how):
    """From rest, each joint accelerates against its friction, or has the rate 0; a stop adds any force that
    pushes its slider away."""
    rng, n, slides = np.random.default_rng(12), 512, np.array(arm.prismatic)
    q, level = rng.uniform(-3.0, 3.0, (n, 4)), rng.uniform(0.0, 6.0, (n, 4))
    q[:, slides] = rng.choice([0.0, 0.3, 0.1], (n, slides.sum()))
    level[rng.random((n, 4)) < 0.1] = 0.0
    efforts = rng.uniform(-1.0, 1.0, (n, 4)) * (12.0, 8.0, 6.0, 4.0)
    made = with_stops(arm, e.CoulombFriction(1.0), control_dt=1e-6, **how)
    batch, _ = advanced(made, q, 0.0 * q, efforts, {"coulomb_friction.level": level})
    rates, inverse = batch.qd @ arm.motor_map, np.linalg.inv(arm.motor_map)
    M = inverse @ arm.mass_matrix(q) @ inverse.T
    needed = np.einsum("nij,nj->ni", M, rates) / 1e-6 - efforts  # the mean force of friction and stops
    side = slides * np.where(q == 0.0, -1.0, np.where(q == 0.3, 1.0, 0.0))
    moves = rates != 0.0
    assert (side * rates <= 0.0).all()
    np.testing.assert_allclose(needed[moves], (-np.sign(rates) * level)[moves], rtol=0.0, atol=1e-7)
    least, most = (np.where(side == s, np.inf, level) for s in (1.0, -1.0))
    assert (needed[~moves] >= -least[~moves] - 1e-7).all()
    assert (needed[~moves] <= most[~moves] + 1e-7).all()
    assert 0.2 < moves.mean() < 0.8


@pytest.mark.long
def test_a_joint_that_sticks_in_a_moving_arm_stays_where_it_is():
    arm, rng = FOUR_R, np.random.default_rng(8)
    made = rde.Scene(arm, (e.CoulombFriction((0.5, HELD, 0.3, HELD)), e.ViscousFriction(0.5)))
    batch, _ = advanced(made, rng.uniform(-1.0, 1.0, (8, 4)), np.zeros((8, 4)), intervals=0)
    start = batch.q @ arm.motor_map
    for _ in range(20_000):
        batch.advance(rng.uniform(-1.0, 1.0, (8, 4)) * (20.0, 5.0, 10.0, 2.0))
    rates, moved = batch.qd @ arm.motor_map, np.abs(batch.q @ arm.motor_map - start)
    assert not rates[:, [1, 3]].any()
    assert rates[:, [0, 2]].any()
    assert (moved[:, [1, 3]] <= 4.0 * np.spacing(np.abs(batch.q).max())).all()


@pytest.mark.long
@pytest.mark.parametrize(
    "level", [None, (0.0,) * 4, (0.2, 0.0, 0.0, 0.0)], ids=["stops alone", "none", "of one joint"]
)
@ARMS
def test_an_arm_without_friction_falls_from_rest_in_any_pose(arm, level):
    """Stretched out its joints have no acceleration but for rounding, which must not decide who slips."""
    upper = tuple(0.2 if slides else 4.0 for slides in arm.prismatic)
    own = (e.JointStop(tuple(0.0 if slides else -4.0 for slides in arm.prismatic), upper, 0.0),)
    if level is not None:
        own = e.CoulombFriction(level), *(own if arm.sliders() else ())
    q = np.random.default_rng(0).choice([0.0, np.pi, np.pi / 2], (8, 4))
    q[0] = 0.0
    q[:, arm.sliders()] = 0.0
    scene = rde.Scene(arm, (e.Gravity(), *own), tolerance=1e-6)
    batch, status = advanced(scene, q, 0.0 * q, intervals=3)
    assert not status.numerics.any()
    assert batch.qd[0].any()


@pytest.mark.quick("4R-1e-6")
@WITH
@ARMS
def test_joints_whose_limit_is_0_move_as_without_friction(arm, how):
    """Their rates pass 0 without an event, which would cut a step; from rest, stretched out, and at stops
    under error control: fixed steps depend on where impacts cut them."""
    rng = np.random.default_rng(3)
    q, qd = rng.uniform(-1.0, 1.0, (2, 8, 4))
    q[0], qd[:3] = 0.0, 0.0
    q[:, arm.sliders()] = rng.choice([0.0, 0.3, 0.1], (8, len(arm.sliders())))
    controlled, motions = how in (METHODS["1e-6"], *EXACT.values()), []
    for friction in ((), (e.CoulombFriction(0.0),)):
        effects = e.Gravity(), *friction
        scene = with_stops(arm, *effects, **how) if controlled else rde.Scene(arm, effects, **how)
        batch, _ = advanced(scene, q, qd, intervals=0)
        status = [batch.advance((-1.0) ** k * np.array([9.0, -5.0, 3.0, -1.0])) for k in range(8)]
        motions.append((batch.q, [s.numerics for s in status], [s.evaluations for s in status]))
    (free, *_, fewest), (slipping, faults, evaluations) = motions
    assert not np.any(faults)
    np.testing.assert_allclose(slipping, free, rtol=0.0, atol=1e-6 if how.get("tolerance") else 1e-9)
    if not (arm.sliders() and controlled):
        np.testing.assert_array_equal(evaluations, fewest)


# ---- one joint, whose motion is known -----------------------------------------------------------------

INERTIA = 0.5 * 0.25**2
SINGLE = rde.FourR((0.5,) * 4, (0.25,) * 4)
"""An arm of whose joints all but the last are held; its inertia is 1/32 kg m^2."""
SLIDER = rde.Chain("P", (2.0,), ())


def alone(restitution=0.5, **how):
    """A mass of 2 kg between stops at 0 and 0.3 m, with dry friction."""
    return rde.Scene(SLIDER, (e.CoulombFriction(1.0), stops(SLIDER, restitution)), **how)


@pytest.mark.parametrize("at_stop", [False, True])
def test_a_joint_is_torn_loose_at_the_time_at_which_its_limit_is_passed(at_stop):
    """A lagged pull passes friction, also that of a slider at its stop; the later motion tells the time."""
    T, t = 0.05, 1e-4
    if at_stop:
        scene, f, u, m, q, efforts = alone(), 1.0, 1.6, 2.0, [0.3], [-1.6]
    else:
        scene, f, u, m = rde.Scene(SINGLE, (e.CoulombFriction((HELD, HELD, HELD, 0.7)),)), 0.7, 1.1, INERTIA
        q, efforts = [0.0] * 4, [0.0, 0.0, 0.0, 1.1]
    release = -T * np.log(1.0 - f / u)
    made = rde.Scene(scene.robot, (*scene.effects, e.Lag(T)), integrator="dop853", control_dt=release + t)
    batch, _ = advanced(made, q, np.zeros(len(q)), efforts)
    rate = ((u - f) * t - (u - f) * T * -np.expm1(-t / T)) / m
    slope = (u - f) * -np.expm1(-t / T) / m
    assert abs(abs(batch.qd[0, -1]) - rate) / slope < 1e-11


@dataclass(frozen=True)
class Falling(Effect):
    """A user's friction of the last joint whose limit is larger at rest, and then grows with the speed."""

    level: float = 0.5
    drop: float = 0.4
    slope: float = 0.0
    width: float = 0.1

    def hooks(self, arm):
        own = {name: f".{name}" for name in ("level", "drop", "slope", "width")}
        return (*(Friction(k, still, {}) for k in range(3)), Friction(3, falling, own))


still = physics(lambda: HELD)
falling = physics(
    lambda level, drop, slope, speed, width: (
        level * (1.0 + drop * exp(-((speed / width) ** 2))) + slope * speed
    )
)


@pytest.mark.parametrize(("effort", "moves"), [(0.69, False), (0.71, True)])
def test_the_limit_at_rest_is_that_of_static_friction(effort, moves):
    made = rde.Scene(SINGLE, (Falling(),), integrator="dop853")
    batch, _ = advanced(made, np.zeros(4), np.zeros(4), (0.0, 0.0, 0.0, effort))
    assert bool(batch.qd.any()) is moves


@dataclass(frozen=True)
class Dragging(Effect):
    """A user's friction in all joints that is 0 at rest alone: a quadratic one, by another hook."""

    def hooks(self, arm):
        return tuple(Friction(k, dragging) for k in range(4))


dragging = physics(lambda speed: 0.3 * speed * speed)


@EXACTLY
def test_friction_that_is_0_at_rest_alone_opposes_both_directions(how):
    q, qd, pull = [0.3, 1.0, -0.5, 0.2], [2.0, -1.0, 0.0, 0.0], np.array([4.0, -3.0, 2.0, -1.0])
    motions = []
    for friction in (Dragging(), e.QuadraticFriction(0.3)):
        batch, _ = advanced(rde.Scene(SINGLE, (e.Gravity(), friction), **how), q, qd, intervals=0)
        faults = [batch.advance((-1.0) ** k * pull).numerics.any() for k in range(10)]
        assert not any(faults)
        motions.append(batch.q)
    np.testing.assert_allclose(*motions, rtol=0.0, atol=1e-9)


@pytest.mark.quick("2.0-rk8")
@pytest.mark.parametrize("how", [{}, *EXACT.values()], ids=["rk8", *EXACT])
@pytest.mark.parametrize("rate", [2.0, -2.0])
def test_a_joint_that_slips_loses_what_the_limit_at_its_speed_takes(rate, how):
    """v' = -(f + c v) / J, until v is 0: v + f / c decays."""
    f, c, t = 0.5, 0.3, 0.02
    made = rde.Scene(SINGLE, (Falling(f, 0.0, c),), control_dt=t, **how)
    batch, _ = advanced(made, np.zeros(4), (0, 0, 0, rate))
    expected = (2.0 + f / c) * np.exp(-c * t / INERTIA) - f / c
    assert batch.qd[0, 3] == pytest.approx(np.sign(rate) * expected, rel=1e-11)
    for _ in range(10):  # it stops after J / c log(1 + 2 c / f), 0.08 s
        batch.advance()
    assert not batch.qd.any()


@pytest.mark.quick("0.5-1e-12")
@EXACTLY
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
    batch, _ = advanced(alone(restitution, control_dt=time + after, **how), [0.0], [0.0], [3.0])
    assert batch.q[0, 0] == pytest.approx(0.3 - bounce * after + 0.5 * away * after**2, abs=1e-11)
    assert batch.qd[0, 0] == pytest.approx(-bounce + away * after, abs=1e-10)
    for _ in range(12):
        assert not batch.advance([3.0]).numerics.any()
    assert (batch.q[0, 0], batch.qd[0, 0]) == (0.3, 0.0)


@pytest.mark.parametrize("rate", [0.5, 1e-5])
def test_friction_that_exceeds_the_push_ends_a_bounce_where_it_is(rate):
    """Even a bounce of less than 1e-9 m, which would otherwise count as none."""
    batch, _ = advanced(alone(integrator="dop853"), [0.3], [rate], [0.5], intervals=20)
    rise = (0.5 * rate) ** 2 / (2.0 * (1.0 + 0.5) / 2.0)
    assert batch.q[0, 0] == pytest.approx(0.3 - rise, abs=1e-15)
    assert batch.qd[0, 0] == 0.0


@pytest.mark.parametrize(("tolerance", "bounces"), [(1e-6, False), (1e-9, True)])
def test_how_low_a_bounce_ends_in_rest_follows_from_the_tolerance(tolerance, bounces):
    """A slider of 1 kg leaves its stop to a height of 1e-10 m, is back after 9 us, and is seen after 12."""
    effects = e.JointStop((0.0,), (1.0,), 0.9), e.CoulombFriction(1e-6)
    scene = rde.Scene(rde.Chain("P", (1.0,)), effects, control_dt=1.2e-5, tolerance=tolerance)
    batch, _ = advanced(scene, [[0.0]], [[np.sqrt(2.0 * 10.0 * 1e-10)]], [[-10.0]])
    assert bool(batch.qd[0, 0]) is bounces
