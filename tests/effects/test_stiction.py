"""Dry friction: joints that stick do so to the last bit, and stick and slip are located in time."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, advanced

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects.hooks import Actuation, Effect, Friction, Link, State
from redundant_envs.language.algebra import exp, physics

CASES = json.loads((Path(__file__).parents[1] / "oracles" / "stiction_four_r.json").read_text())
"""Motions of 1 s by two other programs, which agree to 2e-13 m: up to 77 events each."""
EXACT = {"1e-12": {"tolerance": 1e-12}, "dop853": {"integrator": "dop853"}}
METHODS = {
    "euler": {"integrator": "euler"},
    "rk4": {"integrator": "rk4"},
    "rk8": {},
    "1e-6": {"tolerance": 1e-6},
    **EXACT,
}
HELD = 1e6
"""A level that no motor here overcomes."""


def joints_at(arm, phi):
    return np.asarray(phi) @ np.linalg.inv(arm.motor_map)


@pytest.mark.long
@pytest.mark.parametrize("how", EXACT.values(), ids=EXACT)
@pytest.mark.parametrize("case", CASES, ids=range(len(CASES)))
def test_motions_of_another_program(case, how):
    arm = rde.FourR(tuple(case["masses"]), tuple(case["lengths"]))
    effects = (e.Gravity(case["gravity"]), e.CoulombFriction(tuple(case["limits"])))
    batch = rde.BatchSimulator(rde.Scene(arm, effects, control_dt=0.02, **how), track_work=True)
    batch.set_state(joints_at(arm, case["phi"]), joints_at(arm, case["phid"]))
    energies = [arm.kinetic_energy(batch.q, batch.qd) + arm.potential_energy(batch.q, case["gravity"])]
    for efforts in case["efforts"]:
        status = batch.advance(efforts)
        assert not status.numerics.any()
    np.testing.assert_allclose(arm.forward_kinematics(batch.q)[0], case["tip"], rtol=0.0, atol=1e-10)
    energies.append(arm.kinetic_energy(batch.q, batch.qd) + arm.potential_energy(batch.q, case["gravity"]))
    largest = max(abs(energies[0][0]), abs(energies[1][0]), abs(batch.work[0]), 1.0)
    assert abs(energies[1] - energies[0] - batch.work)[0] < 1e-11 * largest


@pytest.mark.long
@pytest.mark.parametrize("dt", [0.02, 0.005, 0.001])
@pytest.mark.parametrize("how", METHODS.values(), ids=METHODS)
@pytest.mark.parametrize("arm", [FOUR_R, RPRP], ids=["4R", "RPRP"])
def test_a_loaded_arm_below_its_limits_keeps_every_bit_for_ten_seconds(arm, how, dt):
    """A smooth law creeps, and sign(v) and a dead band of rates jitter."""
    rng = np.random.default_rng(5)
    q = rng.uniform(-1.0, 1.0, (8, 4))
    efforts = rng.uniform(-5.0, 5.0, (8, 4))
    load = np.abs(efforts - arm.gravity_forces(q) @ np.linalg.inv(arm.motor_map).T)
    batch, _ = advanced(
        rde.Scene(arm, (e.Gravity(), e.CoulombFriction(1.0)), control_dt=dt, **how), q, 0.0 * q,
        change={"coulomb_friction.level": load / 0.999}, intervals=0,
    )  # fmt: skip
    for _ in range(round(10.0 / dt)):
        batch.advance(efforts)
    assert np.array_equal(batch.q, q)
    assert not batch.qd.any()


@pytest.mark.long
def test_a_joint_that_sticks_in_a_moving_arm_stays_where_it_is():
    arm, rng = FOUR_R, np.random.default_rng(8)
    level = (0.5, HELD, 0.3, HELD)
    batch, _ = advanced(
        rde.Scene(arm, (e.CoulombFriction(level), e.ViscousFriction(0.5))), rng.uniform(-1.0, 1.0, (8, 4)),
        np.zeros((8, 4)), intervals=0,
    )  # fmt: skip
    start = batch.q @ arm.motor_map
    for _ in range(20_000):
        batch.advance(rng.uniform(-1.0, 1.0, (8, 4)) * (20.0, 5.0, 10.0, 2.0))
    rates, moved = batch.qd @ arm.motor_map, np.abs(batch.q @ arm.motor_map - start)
    assert not rates[:, [1, 3]].any()
    assert rates[:, [0, 2]].any()
    assert (moved[:, [1, 3]] <= 4.0 * np.spacing(np.abs(batch.q).max())).all()


@pytest.mark.long
def test_no_pose_of_an_arm_that_sticks_changes_by_rounding():
    q = np.random.default_rng(6).uniform(-10.0, 10.0, (4096, 4))
    batch, _ = advanced(rde.Scene(FOUR_R, (e.Gravity(), e.CoulombFriction(HELD))), q, 0.0 * q)
    assert np.array_equal(batch.q, q)


@pytest.mark.long
def test_events_of_friction_take_few_evaluations():
    """With limits of 5 % of the motors' efforts; smooth friction takes hundreds of times as many."""
    limits, rng = np.array((20.0, 12.0, 8.0, 4.0)), np.random.default_rng(9)
    made = rde.Scene(
        single().robot, (e.Gravity(), e.ViscousFriction(0.2), e.CoulombFriction(tuple(0.05 * limits))),
        tolerance=1e-6,
    )  # fmt: skip
    batch, _ = advanced(made, rng.uniform(-1.5, 1.5, (512, 4)), np.zeros((512, 4)), intervals=0)
    counts = [batch.advance(rng.uniform(-1.0, 1.0, (512, 4)) * limits).evaluations.mean() for _ in range(12)]
    assert np.mean(counts[4:]) <= 90.0


def single(spring=0.0, level=0.7, **how):
    """The last joint of a 4R alone: the others are held; its inertia is 1/32 kg m^2."""
    arm = rde.FourR((0.5,) * 4, (0.25,) * 4)
    joint = (e.CoulombFriction((HELD, HELD, HELD, level)), *((JointSpring(spring),) if spring else ()))
    return rde.Scene(arm, joint, **(how or {"integrator": "dop853"}))


@physics
def pull(position, stiffness):
    return -stiffness * position


@physics
def stretched(position, stiffness):
    return 0.5 * stiffness * position**2


@dataclass(frozen=True)
class JointSpring(Effect):
    stiffness: float

    def hooks(self, arm):
        bind = {"position": "phi4", "stiffness": ".stiffness"}
        return (e.Force(3, pull, bind, potential=stretched),)


@pytest.mark.long
@pytest.mark.parametrize("how", EXACT.values(), ids=EXACT)
def test_an_oscillator_loses_the_same_way_in_each_half_cycle(how):
    k, level, inertia = 20.0, 0.7, 0.5 * 0.25**2
    half = np.pi * np.sqrt(inertia / k)
    made, turns = single(k, level, control_dt=half, **how), 14
    batch, _ = advanced(made, joints_at(made.robot, (0.0, 0.0, 0.0, 1.0)), np.zeros(4), intervals=0)
    amplitude = 1.0
    for n in range(turns + 2):
        batch.advance()
        amplitude = amplitude - 2.0 * level / k if amplitude > level / k else amplitude
        position, rate = (x[0] @ made.robot.motor_map for x in (batch.q, batch.qd))
        assert position[3] == pytest.approx((-1.0) ** (n + 1 if n < turns else turns) * amplitude, abs=1e-12)
        assert abs(rate[3]) < 1e-10
    assert amplitude <= level / k
    assert rate[3] == 0.0


@physics
def lag(effort, command, time_constant):
    return (command - effort) / time_constant


@physics
def reached(effort):
    return effort


@dataclass(frozen=True)
class LaggedMotor(Effect):
    """The effort of the last motor follows its command with a lag."""

    time_constant: float = 0.05

    def hooks(self, arm):
        bind = {"effort": ".effort", "command": "command4", "time_constant": ".time_constant"}
        effort = State("effort", "N m", derivative=lag, bind=bind)
        return (Actuation(3, reached, {"effort": ".effort"}, Link.LAG, (effort,)),)


def test_a_joint_is_torn_loose_at_the_time_at_which_its_limit_is_passed():
    """The motion after the release tells its time."""
    f, u, T, inertia = 0.7, 1.1, 0.05, 0.5 * 0.25**2
    release = -T * np.log(1.0 - f / u)
    made = rde.Scene(
        single().robot, (*single().effects, LaggedMotor(T)), integrator="dop853", control_dt=release + 1e-4
    )
    batch, _ = advanced(made, np.zeros(4), np.zeros(4), (0.0, 0.0, 0.0, u))
    # v = ((u - f) t - (u - f) T (1 - exp(-t/T))) / J after the release.
    t = 1e-4
    rate = ((u - f) * t - (u - f) * T * -np.expm1(-t / T)) / inertia
    slope = (u - f) * -np.expm1(-t / T) / inertia
    assert abs(batch.qd[0, 3] - rate) / slope < 1e-11


@pytest.mark.quick("euler")
@pytest.mark.parametrize("how", METHODS.values(), ids=METHODS)
def test_modes_are_decided_for_all_joints_at_once(how):
    """From rest, each joint accelerates against its friction, or has the rate 0."""
    rng = np.random.default_rng(12)
    arm, n = FOUR_R, 256
    q, level = rng.uniform(-3.0, 3.0, (n, 4)), rng.uniform(0.0, 6.0, (n, 4))
    efforts = rng.uniform(-1.0, 1.0, (n, 4)) * (12.0, 8.0, 6.0, 4.0)
    batch, _ = advanced(
        rde.Scene(arm, (e.CoulombFriction(1.0),), control_dt=1e-6, **how), q, 0.0 * q, efforts,
        {"coulomb_friction.level": level},
    )  # fmt: skip
    rates = batch.qd @ arm.motor_map
    M = np.linalg.inv(arm.motor_map) @ arm.mass_matrix(q) @ np.linalg.inv(arm.motor_map).T
    needed = np.einsum("nij,nj->ni", M, rates) / 1e-6 - efforts  # the mean force of friction
    moves = rates != 0.0
    np.testing.assert_allclose(needed[moves], (-np.sign(rates) * level)[moves], rtol=0.0, atol=1e-8)
    assert (np.abs(needed[~moves]) <= level[~moves] + 1e-8).all()
    assert 0.2 < moves.mean() < 0.8


@physics
def falling(level, drop, speed, width):
    return level * (1.0 + drop * exp(-((speed / width) ** 2)))


@dataclass(frozen=True)
class Stribeck(Effect):
    """A user's friction whose limit is larger at rest."""

    level: float = 0.5
    drop: float = 0.4
    width: float = 0.1

    def hooks(self, arm):
        own = {name: f".{name}" for name in ("level", "drop", "width")}
        return tuple(Friction(k, falling, own) for k in range(len(arm.joints)))


@pytest.mark.long
def test_the_limit_at_rest_is_that_of_static_friction_and_errors_stay_below_a_tolerance():
    arm, rng = single().robot, np.random.default_rng(3)
    scenes = [rde.Scene(arm, (Stribeck(),), **how) for how in ({"tolerance": 1e-6}, {"integrator": "dop853"})]
    q, efforts = rng.uniform(-1.0, 1.0, (128, 4)), rng.uniform(-1.5, 1.5, (128, 4))
    tips = [arm.forward_kinematics(advanced(made, q, 0.0 * q, efforts, intervals=1)[0].q) for made in scenes]
    assert np.linalg.norm(tips[0] - tips[1], axis=1).max() < 1e-6
    for effort, moves in ((0.69, False), (0.71, True)):
        batch, _ = advanced(scenes[1], np.zeros(4), np.zeros(4), (0.0, 0.0, 0.0, effort))
        assert bool(batch.qd.any()) is moves


def test_how_late_a_rest_is_found_costs_no_accuracy():
    """A slider far out has a friction of 18 N: until its rest was found, the arm was pushed as if it slid.
    Another program found the tip."""
    masses = (1.2772558680633215, 0.5548617605105043, 0.6257547466951878, 1.673352399063898)
    levels = (0.2069690005405073, 0.27837445757698187, 18.12562398179966, 0.40379153177170973)
    q = (0.32169516416062327, -0.4074025178083903, -1.7915379719100903, 8.730343997802555)
    qd = (-0.03594581262447852, -0.0, 0.18908114944385543, 0.4204891821900181)
    efforts = (0.882947420728567, 1.9721354123439192, -3.254420578037593, 1.5828399664206532)
    arm = rde.Chain("RPRP", masses, (0.2954454083497294, 0.9937503258505889))
    made = rde.Scene(arm, (e.CoulombFriction(levels),), control_dt=0.1, tolerance=1e-6, actuation="joint")
    batch, _ = advanced(made, q, qd, efforts)
    tip = (-2.066342308202145, -9.607815077491992)
    np.testing.assert_allclose(arm.forward_kinematics(batch.q)[0], tip, rtol=0.0, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("level", [(0.0,) * 4, (0.2, 0.0, 0.0, 0.0)], ids=["none", "of one joint"])
@pytest.mark.parametrize("arm", [FOUR_R, RPRP], ids=["4R", "RPRP"])
def test_an_arm_without_friction_falls_from_rest_in_any_pose(arm, level):
    """Stretched out its joints have no acceleration but for rounding, which must not decide who slips."""
    stops = (e.PrismaticStop((0.0, 0.0), (0.2, 0.2), 0.0),) if arm.sliders() else ()
    q = np.random.default_rng(0).choice([0.0, np.pi, np.pi / 2], (8, 4))
    q[0] = 0.0
    q[:, arm.sliders()] = 0.0
    scene = rde.Scene(arm, (e.Gravity(), e.CoulombFriction(level), *stops), tolerance=1e-6)
    batch, status = advanced(scene, q, 0.0 * q, intervals=3)
    assert not status.numerics.any()
    assert batch.qd[0].any()


@pytest.mark.long
def test_rounding_of_large_forces_neither_holds_nor_tears_loose_a_joint_in_turn():
    """The last joint balances near its limit, which is a ten-thousandth of the load."""
    level, rng, n = 1e-4, np.random.default_rng(2), 512
    made = rde.Scene(FOUR_R, (e.Gravity(), e.CoulombFriction(level), LaggedMotor(0.05)), tolerance=1e-9)
    q = rng.uniform(-1.0, 1.0, (n, 4))
    held = FOUR_R.gravity_forces(q) @ np.linalg.inv(FOUR_R.motor_map).T
    batch, _ = advanced(made, q, 0.0 * q, held, {"coulomb_friction.level": HELD}, intervals=150)
    batch.set_parameters({"coulomb_friction.level": level})
    for _ in range(8):
        status = batch.advance(held + rng.uniform(-3.0, 3.0, (n, 1)) * (0.0, 0.0, 0.0, level))
        assert not status.numerics.any()


@physics
def growing(level, slope, speed):
    return level + slope * speed


@dataclass(frozen=True)
class GrowingFriction(Effect):
    """A user's friction whose limit grows with the speed."""

    level: float = 0.5
    slope: float = 0.3

    def hooks(self, arm):
        own = {name: f".{name}" for name in ("level", "slope")}
        return (*(Friction(k, still, {}) for k in range(3)), Friction(3, growing, own))


@physics
def still():
    return HELD


@pytest.mark.quick("2.0-rk8")
@pytest.mark.parametrize("how", [{}, *EXACT.values()], ids=["rk8", *EXACT])
@pytest.mark.parametrize("rate", [2.0, -2.0])
def test_a_joint_that_slips_loses_what_the_limit_at_its_speed_takes(rate, how):
    """v' = -(f + c v) / J, until v is 0: v + f / c decays."""
    f, c, inertia, t = 0.5, 0.3, 0.5 * 0.25**2, 0.02
    arm = single().robot
    batch, _ = advanced(
        rde.Scene(arm, (GrowingFriction(),), control_dt=t, **how), np.zeros(4), (0, 0, 0, rate)
    )
    expected = (2.0 + f / c) * np.exp(-c * t / inertia) - f / c
    assert batch.qd[0, 3] == pytest.approx(np.sign(rate) * expected, rel=1e-11)
    for _ in range(10):  # it stops after J / c log(1 + 2 c / f), 0.08 s
        batch.advance()
    assert not batch.qd.any()


def test_lanes_are_alike_alone_in_a_batch_after_a_snapshot_and_in_numpy():
    made, rng = (
        rde.Scene(FOUR_R, (e.Gravity(), e.CoulombFriction((2.0, 1.5, 1.0, 0.5))), tolerance=1e-6),
        None,
    )
    rng = np.random.default_rng(4)
    q, efforts = rng.uniform(-1.0, 1.0, (24, 4)), rng.uniform(-9.0, 9.0, (24, 4))
    whole, _ = advanced(made, q, 0.0 * q, efforts, intervals=3)
    alone, _ = advanced(made, q[7:8], 0.0 * q[7:8], efforts[7:8], intervals=2)
    kept = rde.BatchSimulator(made, 1)
    kept.restore(alone.save())
    kept.advance(efforts[7:8])
    assert np.array_equal(kept.q[0], whole.q[7])
    assert np.array_equal(kept.qd[0], whole.qd[7])


def test_what_friction_cannot_do_is_refused():
    with pytest.raises(ValueError, match="speed"):
        rde.Scene(FOUR_R, (type("Odd", (Effect,), {"hooks": odd_hooks})(),))
    pytest.importorskip("torch")
    with pytest.raises(ValueError, match="SmoothCoulombFriction"):
        rde.torch_step(rde.Scene(FOUR_R, (e.CoulombFriction(1.0),)))


def odd_hooks(self, arm):
    return (Friction(0, physics(lambda rate: rate), {"rate": "phid1"}),)
