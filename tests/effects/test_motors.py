"""Motors and frictions follow their equations: on one joint, whose motion is known, and on whole arms."""

import dataclasses
import itertools
from pathlib import Path

import numpy as np
import pytest
from catalogue import ARMS, FOUR_R, RPRP, advanced
from one_joint import INERTIA, METHODS, ONE, WITH, moved

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.control.computed_torque import ComputedTorque
from redundant_envs.effects import Actuation, Effect, EffortLimits, Link, lu_gre
from redundant_envs.effects.gear_backlash import contacts, teeth
from redundant_envs.effects.hooks import effort_unit
from redundant_envs.envs.named import action_table
from redundant_envs.envs.registration import check_motors
from redundant_envs.language.algebra import arguments_of, physics

LOCATED = pytest.mark.parametrize("how", list(METHODS.values())[2:], ids=list(METHODS)[2:])


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


# ---- direct-current motors ---------------------------------------------------------------------------

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


# ---- curves, zones, play -----------------------------------------------------------------------------


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
    start = np.zeros((2, 1, 4))
    for arm in (FOUR_R, RPRP):
        dead, _ = advanced(rde.Scene(arm, (e.DeadZone(0.25),)), *start, [[0.3, -0.2, 0.5, -3.0]])
        plain, _ = advanced(rde.Scene(arm), *start, [[0.3 - 0.25, 0.0, 0.25, -2.75]])
        assert np.array_equal(dead.qd, plain.qd)


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


# ---- gears with backlash -----------------------------------------------------------------------------

GAP, STIFFNESS, J, EFFORT = 0.04, 200.0, 0.02, 3.0
GEAR = e.GearBacklash(GAP, STIFFNESS, J)
WALL = rde.Chain("R", (1e12,), (1.0,))
"""A joint so heavy that it stays where it is."""
STEP = 0.005


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
        batch = moved((GEAR,), EFFORT, intervals=intervals, arm=WALL, control_dt=STEP, **how)
        assert tuple(batch.z[0]) == pytest.approx(turned, rel=1e-8)  # angle and rate of the motor
        assert batch.q[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert 0 < met < 5


@LOCATED
def test_a_gear_under_load_winds_up_by_half_its_gap_and_its_torque_by_its_stiffness(how):
    damped = e.GearBacklash(GAP, STIFFNESS, J, 150.0)
    for u in (EFFORT, -EFFORT):
        angle, rate = moved((damped,), u, intervals=200, arm=WALL, control_dt=STEP, **how).z[0]
        assert angle == pytest.approx(np.sign(u) * 0.5 * GAP + u / STIFFNESS, rel=1e-9)
        assert rate == pytest.approx(0.0, abs=1e-9)


def test_teeth_never_pull_however_fast_they_part():
    for side, (closing, torque) in itertools.product((1.0, -1.0), ((1.0, 120.0), (-1.0, 0.0))):
        lead, rate = 0.1 * side, closing * side
        sides = [1.0 if x >= 0.0 else -1.0 for x in contacts(lead, 0.0, 0.0)]
        assert teeth(lead, rate, 0.0, 0.0, 0.0, STIFFNESS, 1e3, *sides) == pytest.approx(torque * side)


# ---- chains: the order of links, their units, and the unit of actions --------------------------------

TIMES = physics(lambda command, factor: factor * command)


@dataclasses.dataclass(frozen=True)
class Converter(Effect):
    """A link of every motor that multiplies its command; it names its units."""

    link: Link = Link.LAG
    takes: str = "V"
    gives: str = ""
    factor: float = 0.5
    named: str = "converter"
    size: float = 12.0
    asked: bool = True

    static = ("link", "takes", "gives", "named", "asked")

    @property
    def key(self):
        return self.named

    def hooks(self, arm):
        joints = range(len(arm.joints))
        binds = ({"command": f"command{k + 1}", "factor": ".factor"} for k in joints)
        how = {"takes": self.takes, "gives": self.gives}
        return tuple(Actuation(k, TIMES, bind, self.link, **how) for k, bind in enumerate(binds))

    def action_units(self, arm):
        return ("size",) * len(arm.joints) if self.asked else ()

    def units(self, arm):
        return {"size": self.takes}


SERVO, DELAY = Converter(Link.CONTROL, "rad/s", "V", named="servo"), rde.effects.CommandDelay(0.01, 0.1)
MOTOR_LINK, LIMITS = Converter(factor=0.25, named="motor"), EffortLimits(5.0)


@pytest.mark.parametrize("arm", [ARMS[kind] for kind in ("4R", "PPR")], ids=["4R", "PPR"])
def test_the_command_has_the_unit_that_the_first_link_with_a_unit_takes(arm):
    for effects, unit in (((MOTOR_LINK,), "V"), ((DELAY, SERVO, MOTOR_LINK, LIMITS), "rad/s")):
        for order in itertools.permutations(effects):
            assert rde.Scene(arm, order).command_units() == (unit,) * len(arm.joints)
    efforts = tuple(effort_unit(arm, k) for k in range(len(arm.joints)))
    for effects in ((), (DELAY,), (LIMITS, DELAY)):
        assert rde.Scene(arm, effects).command_units() == efforts


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        ((SERVO,), "'servo' gives 'V', not 'N m'; add a motor"),
        ((MOTOR_LINK, Converter(named="other")), "'motor' gives 'N m', and 'other' behind it takes 'V'"),
        ((LIMITS, Converter(Link.LIMITS)), "'effort_limits' gives 'N m', and 'converter' behind"),
        ((SERVO, DELAY, LIMITS), "'servo' gives 'V', and 'effort_limits' behind it takes 'N m'"),
    ],
)
def test_a_chain_whose_units_do_not_meet_is_refused(effects, said):
    with pytest.raises(ValueError, match=said):
        rde.Scene(FOUR_R, effects)


def test_the_action_has_the_unit_of_the_earlier_link_in_any_order_of_the_effects():
    for effects, unit in (((SERVO, MOTOR_LINK, LIMITS), "servo.size"), ((MOTOR_LINK, LIMITS), "motor.size")):
        for order in itertools.permutations(effects):
            assert rde.Scene(FOUR_R, order).action_units() == (unit,) * 4


def test_an_environment_says_that_actions_are_shares_of_a_voltage():
    scene = rde.load_scene("four_r_reach")
    driven = dataclasses.replace(scene, effects=(*scene.effects, MOTOR_LINK))
    with pytest.raises(ValueError, match=r"shares of motor\.size; the expert knows efforts and joint"):
        ComputedTorque(driven)
    check_motors(driven)
    table = action_table(driven)
    assert "command at joint1 / 12 V" in table
    assert "Unit of the command" in table
    silent = dataclasses.replace(MOTOR_LINK, asked=False)
    with pytest.raises(ValueError, match=r"effort_limits\.limits\[0\], which is in 'N m', and .* is in 'V'"):
        check_motors(dataclasses.replace(driven, effects=(silent, LIMITS)))


# ---- frictions ---------------------------------------------------------------------------------------


@WITH
@pytest.mark.parametrize("rate", [30.0, -30.0])
def test_quadratic_friction_slows_a_joint_down_as_one_over_time(how, rate):
    c, t = 0.4, 0.1
    batch = moved((e.QuadraticFriction(c),), rate=rate, intervals=5, **how)
    assert batch.qd[0, 0] == pytest.approx(rate / (1.0 + c * abs(rate) * t / INERTIA), rel=1e-9)


@WITH
def test_smooth_coulomb_friction_creeps_under_a_load_below_its_level(how):
    """At the rate e u / sqrt(c^2 - u^2): a joint under 0.9 of the level moves on at twice the speed e."""
    level, load, speed = 2.0, 1.8, 0.05
    batch = moved((e.SmoothCoulombFriction(level, speed),), load, intervals=1000, **how)
    creep = speed * load / np.sqrt(level**2 - load**2)
    assert batch.qd[0, 0] == pytest.approx(creep, rel=1e-6)
    assert creep == pytest.approx(2.06 * speed, rel=0.01)


@pytest.mark.long
@pytest.mark.parametrize(("seed", "tolerance"), [(3, 1e-6), (4, 1e-9)])
def test_smooth_coulomb_friction_keeps_the_tolerance_where_a_joint_stops_or_turns(seed, tolerance):
    lanes, dt, steps = 4096, 0.02, 800
    rng = np.random.default_rng(seed)
    level, load = 10 ** rng.uniform(-1.0, 1.0, lanes), rng.normal(0.0, 10.0, lanes)
    speed, q, rate = 10 ** rng.uniform(-2.0, -0.5, lanes), rng.normal(size=lanes), rng.normal(size=lanes)
    rate[::4] = 0.0
    scene = rde.Scene(ONE, (e.SmoothCoulombFriction(1.0),), tolerance=tolerance, control_dt=dt)
    change = {f"smooth_coulomb_friction.{n}": x[:, None] for n, x in (("levels", level), ("speed", speed))}
    batch, status = advanced(scene, q[:, None], rate[:, None], load[:, None], change)
    assert not status.numerics.any()

    def slope(v):
        return (load - level * v / np.hypot(v, speed)) / INERTIA

    h, v = dt / steps, rate
    for _ in range(steps):
        k1 = slope(v)
        k2 = slope(v + 0.5 * h * k1)
        k3 = slope(v + 0.5 * h * k2)
        k4 = slope(v + h * k3)
        q = q + h * (v + h / 6.0 * (k1 + k2 + k3))
        v = v + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    assert abs(batch.q[:, 0] - q).max() <= tolerance


CASE_34 = e.LuGre(1e5, 0.0, 0.4, 1.0, 1.5, 0.01)
"""Bristles that forget in a microsecond at 10 rad/s."""
STEADY = 1.0 + 0.4 * 10.0
FLYWHEEL = rde.Chain("R", (1e12,), (1.0,))


def friction(effect, batch):
    """Friction of the joint in the present state, N m."""
    numbers = (getattr(effect, name) for name in arguments_of(lu_gre.force)[2:])
    return -lu_gre.force(batch.qd[0, 0], batch.z[0, 0], *numbers)


@pytest.mark.parametrize("integrator", ["euler", "rk4", "rk8"])
def test_stiff_bristles_have_their_steady_friction_after_a_long_step(integrator):
    batch = moved((CASE_34,), rate=10.0, arm=FLYWHEEL, integrator=integrator, control_dt=0.01)
    assert friction(CASE_34, batch) == pytest.approx(STEADY, rel=1e-9)


def test_bristles_hold_a_load_below_the_stiction_as_a_spring():
    bristles = e.LuGre(1e4, 100.0, 10.0, 1.0, 1.5, 0.01)
    batch = moved((bristles,), 0.5, intervals=500, substeps=4)
    assert abs(batch.qd[0, 0]) < 1e-6
    assert friction(bristles, batch) == pytest.approx(0.5, abs=1e-3)
    assert abs(batch.q[0, 0]) < 2e-4
    slips = moved((bristles,), 1.7, intervals=500, substeps=4)
    assert slips.qd[0, 0] > 0.05


def stored_and_taken(effect, rates, h=1e-4):
    """Energy that the bristles give back at most, and the work that friction takes, along given rates: a row
    for each time, a column for each motion."""
    numbers = {name: getattr(effect, name) for name in arguments_of(lu_gre.force)[2:]}
    own = [numbers[name] for name in arguments_of(lu_gre.bent)[2:-1]]
    z, taken, least = np.zeros((3, rates.shape[1]))
    for rate in rates:
        middle = lu_gre.bent(rate, z, *own, 0.5 * h)
        taken = taken - h * rate * lu_gre.force(rate, middle, *numbers.values())
        z = lu_gre.bent(rate, z, *own, h)
        least = np.minimum(least, taken - 0.5 * effect.stiffness * z**2)
    return least, taken


@pytest.mark.long
def test_lu_gre_friction_is_passive_with_enough_viscous_friction():
    """sigma2 >= sigma1 (F_S - F_C) / F_C (Barabanov and Ortega 2000)."""
    times, rng = np.arange(0.0, 1.0, 1e-4), np.random.default_rng(0)
    size, frequency = rng.normal(size=(5, 5)), rng.uniform(1.0, 60.0, (5, 5))
    phase = rng.uniform(0, 6, (5, 5))
    rates = 0.3 * (size * np.sin(frequency * times[:, None, None] + phase)).sum(axis=2)
    least, taken = stored_and_taken(e.LuGre(500.0, 2.0, 1.0, 1.0, 1.5, 0.1), rates)
    assert least.min() > -1e-6
    assert taken.min() > 0.0


@pytest.mark.long
def test_the_page_of_smooth_coulomb_friction_has_what_it_costs():
    """Evaluations of a control interval at a tolerance of 1e-6 m; they are the same on every machine."""
    page = (Path(__file__).parents[2] / "docs/effects/smooth_coulomb_friction.md").read_text()
    arm = rde.FourR((0.5,) * 4, (0.25,) * 4)
    for speed in (0.1, 0.01, 0.001):
        effects = e.Gravity(), e.ViscousFriction(0.05), e.SmoothCoulombFriction(0.3, speed)
        batch, rng = rde.BatchSimulator(rde.Scene(arm, effects, tolerance=1e-6), 64), np.random.default_rng(0)
        batch.set_state(rng.uniform(-1.5, 1.5, (64, 4)), rng.normal(size=(64, 4)))
        efforts = (rng.uniform(-1.0, 1.0, (64, 4)) * (4.0, 3.0, 2.0, 1.0) for _ in range(5))
        evaluations = np.mean([batch.advance(u).evaluations.mean() for u in efforts])
        assert f"| {speed} | {evaluations:.0f} |" in page
