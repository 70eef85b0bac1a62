"""Long motions: how energy drifts, how exactly an arm turns, and whether the clock counts."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.effects import CentringSpring, Gravity, PrismaticStop
from redundant_envs.model.energy import kinetic_energy, potential_energy

RPRP, FOUR_R = rde.RPRP((1.0,) * 4, (0.5,) * 2), rde.FourR((1.0,) * 4, (0.5,) * 4)
FREE = rde.Scene(FOUR_R, (Gravity(),))
SPRUNG = rde.Scene(RPRP, (Gravity(), CentringSpring((200.0, 200.0), (0.0, 0.0), (0.3, 0.3))))
STOPPED = rde.Scene(RPRP, (Gravity(), PrismaticStop((0.0, 0.0), (0.3, 0.3), 1.0)))


def drift(scene, lanes, steps):
    """Median over random releases from rest of |E - E0| [J] after half of the steps, and after all."""
    rng = np.random.default_rng(11)
    q = rng.uniform(-np.pi, np.pi, (lanes, 4))
    if scene.robot is RPRP:
        q[:, [1, 3]] = 0.15 + 0.1 / np.pi * q[:, [1, 3]]
    batch = rde.BatchSimulator(scene, lanes)
    batch.set_state(q, np.zeros((lanes, 4)))
    change = []
    for _ in range(2):
        for _ in range(steps // 2 // scene.substeps):
            assert not batch.advance().numerics.any()
        energy = kinetic_energy(scene, batch.q, batch.qd) + potential_energy(scene, batch.q)
        change.append(float(np.median(np.abs(energy - potential_energy(scene, q)))))
    return change


def chained(scene, integrator, step, substeps=10_000):
    """The scene in steps of a length [s], many of them in one call."""
    return replace(scene, integrator=integrator, control_dt=step * substeps, substeps=substeps)


@pytest.mark.parametrize(
    ("lanes", "steps"), [(16, 200_000), pytest.param(64, 10_000_000, marks=pytest.mark.long)]
)
@pytest.mark.parametrize(("scene", "rate"), [(FREE, 5e-10), (SPRUNG, 1.2e-10)], ids=["FourR", "RPRP"])
def test_rk4_of_1_ms_loses_energy_in_proportion_to_time(scene, rate, lanes, steps):
    """At most ``rate`` joules a step: 5 mJ of the 4R arm in 1e7 steps; half of it in half the time."""
    half, whole = drift(chained(scene, "rk4", 1e-3), lanes, steps)
    assert whole <= rate * steps
    assert 1.6 <= whole / half <= 2.5


@pytest.mark.parametrize(
    ("lanes", "steps"), [(16, 40_000), pytest.param(64, 400_000, marks=pytest.mark.long)]
)
@pytest.mark.parametrize(("scene", "most"), [(FREE, 1e-7), (SPRUNG, 1e-10)], ids=["FourR", "RPRP"])
def test_rk8_of_2_5_ms_keeps_energy_for_1000_s(scene, most, lanes, steps):
    """The 4R arm's drift is that of the method, in proportion to time; that of the other is rounding."""
    _, whole = drift(chained(scene, "rk8", 2.5e-3), lanes, steps)
    assert whole <= most * (steps / 400_000 if scene is FREE else 1.0)


@pytest.mark.parametrize(
    ("steps", "most"), [(20_000, 1.5e-7), pytest.param(10_000_000, 1.5e-6, marks=pytest.mark.long)]
)
def test_rk4_of_1_ms_keeps_energy_across_elastic_impacts(steps, most):
    """An impact in 60 steps of a lane or so; the drift has no direction and grows more slowly than time."""
    _, whole = drift(chained(STOPPED, "rk4", 1e-3, 20), 16, steps)
    assert whole <= most


@pytest.mark.parametrize(
    "revolutions", [10_000, pytest.param(1_000_000, marks=pytest.mark.long)], ids="{:.0e}".format
)
@pytest.mark.parametrize("arm", [RPRP, FOUR_R], ids=["RPRP", "FourR"])
def test_a_straight_arm_turns_a_million_times(arm, revolutions):
    """No gravity, RK4 of 5 ms: rates stay to the last bit, angles are n h omega.

    At +-100 rad/s, whose half a radian a step is a float, to 1e-9 rad. At other rates every step rounds an
    angle to a float, in the same direction while its exponent stays: within half an ulp
    each. Sliders rest at their stops.
    """
    rates = np.array([100.0, -100.0, 99.7, 100.0 / 3.0, 12.5, 50.0, 1.0, 0.1])
    stops = (PrismaticStop((0.0, 0.0), (0.25, 0.25), 0.0),) if arm is RPRP else ()
    scene = chained(rde.Scene(arm, (Gravity(0.0), *stops)), "rk4", 5e-3)
    turning = np.array([True, arm is FOUR_R] * 2)
    q0 = np.where(turning, 0.0, np.full((8, 1), 0.25))
    qd0 = np.where(turning, rates[:, None], 0.0)
    batch = rde.BatchSimulator(scene, 8)
    batch.set_state(q0, qd0)
    calls = round(revolutions * 2.0 * np.pi / 100.0 / scene.control_dt)
    for _ in range(calls):
        batch.advance()
    seconds = calls * scene.control_dt
    error = np.abs(batch.q - (q0 + qd0 * seconds)).max(axis=1)
    assert (batch.qd == qd0).all()
    assert error[:2].max() <= 1e-9
    assert (error <= calls * scene.substeps * 0.5 * np.spacing(np.abs(rates) * seconds)).all()


@pytest.mark.parametrize("intervals", [2_000, pytest.param(1_000_000, marks=pytest.mark.long)])
def test_control_instants_are_whole_multiples_of_the_interval(intervals):
    """The n-th call for efforts is at n h to the last bit, and there are as many as intervals."""
    scene = rde.Scene(FOUR_R, (Gravity(0.0),), "euler", control_dt=1e-3)
    calls, early_or_late = 0, 0

    def efforts(t, q, qd):
        nonlocal calls, early_or_late
        early_or_late += t != calls * 1e-3
        calls += 1
        return 0.0, 0.0, 0.0, 0.0

    motion = rde.simulate(scene, (0.3,) * 4, (1.0,) * 4, [intervals * 1e-3], efforts)
    assert early_or_late == 0
    assert calls == intervals
    assert motion.t[0] == intervals * 1e-3


@pytest.mark.parametrize("steps", [20_000, pytest.param(10_000_000, marks=pytest.mark.long)])
def test_an_environment_counts_its_control_steps(steps):
    """One after another, in one episode without a limit."""
    env = gym.make("redundant_envs/RPRPReach-v0", max_episode_steps=-1)
    env.reset(seed=0)
    action, miscounted = np.zeros(4, np.float32), 0
    for n in range(1, steps + 1):
        miscounted += env.step(action)[4]["episode_steps"] != n
    assert miscounted == 0


@pytest.mark.parametrize("limit", [100, 10**7, 2**53])
def test_an_episode_is_truncated_at_its_limit_exactly(limit):
    """Its count set to two steps before: float64 counts exactly that far."""
    env = gym.make_vec("redundant_envs/RPRPReach-v0", num_envs=2, max_episode_steps=limit)
    env.reset(seed=0)
    env.unwrapped.core.memory.write(("steps",), float(limit - 2))
    truncated = [env.step(np.zeros((2, 4), np.float32))[3].tolist() for _ in range(2)]
    assert truncated == [[False, False], [True, True]]
