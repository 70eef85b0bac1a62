"""Frictions of the package follow their equations, and LuGre friction is passive where it should be."""

from pathlib import Path

import numpy as np
import pytest
from one_joint import INERTIA, ONE, WITH, moved

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects import lu_gre

ROOT = Path(__file__).parents[2]


@WITH
@pytest.mark.parametrize("rate", [30.0, -30.0])
def test_quadratic_friction_slows_a_joint_down_as_one_over_time(how, rate):
    c, t = 0.4, 0.1
    batch = moved((e.QuadraticFriction(c),), rate=rate, intervals=5, **how)
    assert batch.qd[0, 0] == pytest.approx(rate / (1.0 + c * abs(rate) * t / INERTIA), rel=1e-9)


# ---- smooth Coulomb friction -----------------------------------------------------------------------------


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
    batch = rde.BatchSimulator(
        rde.Scene(ONE, (e.SmoothCoulombFriction(1.0),), tolerance=tolerance, control_dt=dt), lanes
    )
    batch.set_parameters(
        {f"smooth_coulomb_friction.{n}": x[:, None] for n, x in (("levels", level), ("speed", speed))}
    )
    batch.set_state(q[:, None], rate[:, None])
    assert not batch.advance(load[:, None]).numerics.any()

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


# ---- LuGre -------------------------------------------------------------------------------------------------

CASE_34 = e.LuGre(1e5, 0.0, 0.4, 1.0, 1.5, 0.01)
"""Bristles that forget in a microsecond at 10 rad/s."""
STEADY = 1.0 + 0.4 * 10.0
FLYWHEEL = rde.Chain("R", (1e12,), (1.0,))


def friction(effect, batch):
    """Friction of the joint in the present state, N m."""
    numbers = (getattr(effect, name) for name in lu_gre.NUMBERS)
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
    numbers = {name: getattr(effect, name) for name in lu_gre.NUMBERS}
    own = [numbers[name] for name in lu_gre.OF_BRISTLES]
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
    size, frequency, phase = (
        rng.normal(size=(5, 5)),
        rng.uniform(1.0, 60.0, (5, 5)),
        rng.uniform(0, 6, (5, 5)),
    )
    rates = 0.3 * (size * np.sin(frequency * times[:, None, None] + phase)).sum(axis=2)
    least, taken = stored_and_taken(e.LuGre(500.0, 2.0, 1.0, 1.0, 1.5, 0.1), rates)
    assert least.min() > -1e-6
    assert taken.min() > 0.0


@pytest.mark.long
def test_the_page_of_smooth_coulomb_friction_has_what_it_costs():
    """Evaluations of a control interval at a tolerance of 1e-6 m; they are the same on every machine."""
    page = (ROOT / "docs/effects/smooth_coulomb_friction.md").read_text()
    arm = rde.FourR((0.5,) * 4, (0.25,) * 4)
    for speed in (0.1, 0.01, 0.001):
        effects = e.Gravity(), e.ViscousFriction(0.05), e.SmoothCoulombFriction(0.3, speed)
        batch, rng = rde.BatchSimulator(rde.Scene(arm, effects, tolerance=1e-6), 64), np.random.default_rng(0)
        batch.set_state(rng.uniform(-1.5, 1.5, (64, 4)), rng.normal(size=(64, 4)))
        efforts = (rng.uniform(-1.0, 1.0, (64, 4)) * (4.0, 3.0, 2.0, 1.0) for _ in range(5))
        evaluations = np.mean([batch.advance(u).evaluations.mean() for u in efforts])
        assert f"| {speed} | {evaluations:.0f} |" in page
