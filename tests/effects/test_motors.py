"""Motors of the package follow their equations: on one joint, whose motion is known, and on whole arms."""

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, advanced
from one_joint import INERTIA, METHODS, WITH, moved

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects.gear_backlash import contacts, teeth

LOCATED = pytest.mark.parametrize("how", list(METHODS.values())[2:], ids=list(METHODS)[2:])


# ---- lag -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", ["euler", "rk4", "rk8"])
def test_a_lag_is_exact_at_fixed_steps_however_short_its_time_constant(integrator):
    for constant in (1e-9, 1e-4, 0.02, 3.0):
        batch = moved((e.Lag(constant),), 5.0, integrator=integrator, control_dt=0.02)
        assert batch.z[0, 0] == pytest.approx(-5.0 * np.expm1(-0.02 / constant), rel=1e-14)


@WITH
def test_a_joint_behind_a_lag_moves_as_the_lag_says(how):
    lag, t, u = 0.05, 0.06, 5.0
    batch = moved((e.Lag(lag),), u, intervals=3, **how)
    rate = u / INERTIA * (t + lag * np.expm1(-t / lag))
    assert batch.qd[0, 0] == pytest.approx(rate, rel=1e-9)


# ---- direct-current motors ---------------------------------------------------------------------------------

R, L, K, N, U = 1.5, 0.003, 0.2, 5.0, 12.0
MOTOR = e.DCMotor(R, L, K, N, 24.0)


def driven(t, inertia=INERTIA):
    """Rate and current at a time after the voltage U is switched on, from the eigenvalues of both."""
    a = np.array([[0.0, N * K / inertia], [-N * K / L, -R / L]])
    steady = np.array([U / (N * K), 0.0])
    values, vectors = np.linalg.eig(a)
    weights = np.linalg.solve(vectors, -steady.astype(complex))
    return steady + (vectors * np.exp(values * t)) @ weights


@LOCATED
def test_a_dc_motor_speeds_up_as_its_two_equations_say(how):
    batch = moved((MOTOR,), U, intervals=3, **how)
    rate, current = driven(0.06).real
    assert batch.qd[0, 0] == pytest.approx(rate, rel=1e-7)
    assert batch.z[0, 0] == pytest.approx(current, rel=1e-6)


def test_the_current_of_a_heavy_joint_grows_with_the_electrical_time_constant():
    heavy = rde.Chain("R", (1e9,), (1.0,))
    for integrator in ("euler", "rk4", "rk8"):
        for dt in (1e-4, L / R, 0.02):
            current = moved((MOTOR,), U, arm=heavy, integrator=integrator, control_dt=dt).z[0, 0]
            assert current == pytest.approx(-U / R * np.expm1(-R / L * dt), rel=1e-9)


def test_fixed_steps_of_a_dc_motor_converge_with_the_second_order():
    exact = driven(0.1).real[0]
    wrong = [abs(moved((MOTOR,), U, control_dt=0.1, substeps=n).qd[0, 0] - exact) for n in (200, 400)]
    assert np.log2(wrong[0] / wrong[1]) == pytest.approx(2.0, abs=0.2)


def test_the_supply_limits_the_voltage():
    full, more = (moved((MOTOR,), u, intervals=3).qd for u in (24.0, 1e6))
    assert np.array_equal(full, more)
    assert moved((MOTOR,), -1e6, intervals=3).qd[0, 0] == -full[0, 0]


def test_actions_are_shares_of_the_supply_whatever_limits_follow():
    for effects in ((e.EffortLimits(3.0), MOTOR), (MOTOR, e.EffortLimits(3.0))):
        scene = rde.Scene(FOUR_R, effects)
        assert scene.action_units() == tuple(f"dc_motor.voltage[{k}]" for k in range(4))
        assert scene.command_units() == ("V",) * 4
    units = rde.Scene(RPRP, (e.Play(0.1), e.DeadZone(0.1), MOTOR)).units()
    assert units["dead_zone.widths[1]"] == units["play.gaps[0]"] == "V"
    assert rde.Scene(RPRP, (e.DeadZone(0.1),)).units()["dead_zone.widths[1]"] == "N"
    with pytest.raises(ValueError, match="'dc_motor' gives 'N m', and 'second' behind it takes 'V'"):
        rde.Scene(FOUR_R, (MOTOR, type("Second", (e.DCMotor,), {"key": "second"})(R, L, K)))


# ---- curves, zones, play ---------------------------------------------------------------------------------


@WITH
def test_a_motor_on_its_torque_speed_line_approaches_the_free_speed(how):
    stall, free, t = 8.0, 10.0, 0.1
    batch = moved((e.TorqueSpeed(stall, free),), 100.0, intervals=5, **how)
    assert batch.qd[0, 0] == pytest.approx(-free * np.expm1(-stall * t / (INERTIA * free)), rel=1e-9)


def test_a_motor_brakes_with_its_stall_effort_and_passes_what_is_below_its_line():
    effects = (e.TorqueSpeed(8.0, 10.0),)
    for command, rate, effort in (
        (-100.0, 5.0, -8.0), (100.0, -5.0, 8.0), (100.0, 20.0, 0.0), (3.0, 5.0, 3.0), (-3.0, 50.0, -3.0),
    ):  # fmt: skip
        batch = moved(effects, command, rate, integrator="euler", control_dt=1e-3)
        assert (batch.qd[0, 0] - rate) / 1e-3 * INERTIA == pytest.approx(effort, abs=1e-9)


def test_a_dead_zone_takes_its_width_from_commands():
    for arm in (FOUR_R, RPRP):
        commands = np.array([[0.3, -0.2, 0.5, -3.0]])
        dead, plain = (
            advanced(rde.Scene(arm, effects), *np.zeros((2, 1, 4)), u)[0].qd
            for effects, u in (
                ((e.DeadZone(0.25),), commands),
                ((), np.array([[0.3 - 0.25, 0.0, 0.25, -2.75]])),
            )
        )
        assert np.array_equal(dead, plain)


def test_play_follows_its_command_by_the_ends_of_its_gap():
    rng, gap, kept = np.random.default_rng(0), 0.6, np.zeros(4)
    scene, plain = rde.Scene(RPRP, (e.Play(gap),)), rde.Scene(RPRP)
    one, other = rde.BatchSimulator(scene, 1), rde.BatchSimulator(plain, 1)
    for _ in range(40):
        command = rng.normal(size=4)
        kept = np.clip(kept, command - 0.5 * gap, command + 0.5 * gap)
        one.advance(command)
        other.advance(kept)
        assert np.array_equal(one.q, other.q)
        assert np.array_equal(one.z[0], kept)


def test_an_armature_adds_to_the_inertia_of_its_joint():
    assert moved((e.Armature(0.5),), 5.0).qd[0, 0] == pytest.approx(5.0 * 0.02 / (INERTIA + 0.5), rel=1e-14)


# ---- gears with backlash ---------------------------------------------------------------------------------

GAP, STIFFNESS, J, EFFORT = 0.04, 200.0, 0.02, 3.0
GEAR = e.GearBacklash(GAP, STIFFNESS, J)
WALL = rde.Chain("R", (1e12,), (1.0,))
"""A joint so heavy that it stays where it is."""
STEP = 0.005


def motor(effect, u, intervals, **how):
    """Angle and rate of the motor, and the angle of its joint, after intervals under a constant command."""
    batch = moved((effect,), u, intervals=intervals, arm=WALL, control_dt=STEP, **how)
    return *batch.z[0], batch.q[0, 0]


@LOCATED
def test_the_motor_crosses_half_the_gap_alone_and_then_oscillates_on_the_teeth(how):
    contact = np.sqrt(GAP * J / EFFORT)
    speed, w = EFFORT * contact / J, np.sqrt(STIFFNESS / J)
    met = 0
    for intervals in (1, 2, 3, 4, 6):
        t = intervals * STEP
        turned = (EFFORT * t**2 / (2.0 * J), EFFORT * t / J)
        if t > contact:
            met, s = met + 1, w * (t - contact)
            depth = EFFORT / STIFFNESS * (1.0 - np.cos(s)) + speed / w * np.sin(s)
            assert depth > 0.0
            turned = (0.5 * GAP + depth, EFFORT / STIFFNESS * w * np.sin(s) + speed * np.cos(s))
        angle, rate, joint = motor(GEAR, EFFORT, intervals, **how)
        assert (angle, rate) == pytest.approx(turned, rel=1e-8)
        assert joint == pytest.approx(0.0, abs=1e-12)
    assert 0 < met < 5


@LOCATED
def test_a_gear_under_load_winds_up_by_half_its_gap_and_its_torque_by_its_stiffness(how):
    damped = e.GearBacklash(GAP, STIFFNESS, J, 150.0)
    for u in (EFFORT, -EFFORT):
        angle, rate, _ = motor(damped, u, 200, **how)
        assert angle == pytest.approx(np.sign(u) * 0.5 * GAP + u / STIFFNESS, rel=1e-9)
        assert rate == pytest.approx(0.0, abs=1e-9)


def test_teeth_never_pull_however_fast_they_part():
    for lead, closing, torque in (
        (0.1, 1.0, 120.0),
        (0.1, -1.0, 0.0),
        (-0.1, -1.0, -120.0),
        (-0.1, 1.0, 0.0),
    ):
        sides = [1.0 if x >= 0.0 else -1.0 for x in contacts(lead, 0.0, 0.0)]
        assert teeth(lead, closing, 0.0, 0.0, 0.0, STIFFNESS, 1e3, *sides) == pytest.approx(torque)
