"""Long motions: how energy drifts, and how far control steps are counted.

Hard case 21 is a shorter form for the 4R arm.
"""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.effects import CentringSpring, Gravity, PrismaticStop
from redundant_envs.model.energy import kinetic_energy, potential_energy

pytestmark = pytest.mark.long

RPRP = rde.RPRP((1.0,) * 4, (0.5,) * 2)
SPRUNG = rde.Scene(RPRP, (Gravity(), CentringSpring((200.0, 200.0), (0.0, 0.0), (0.3, 0.3))))
STOPPED = rde.Scene(RPRP, (Gravity(), PrismaticStop((0.0, 0.0), (0.3, 0.3), 1.0)))


def chained(scene, integrator, step, substeps=10_000):
    """The scene in steps of a length [s], many of them in one call."""
    return replace(scene, integrator=integrator, control_dt=step * substeps, substeps=substeps)


@pytest.mark.parametrize(
    ("scene", "lanes", "steps", "most", "in_proportion"),
    [
        (chained(SPRUNG, "rk4", 1e-3), 16, 200_000, 2.4e-5, True),
        (chained(SPRUNG, "rk8", 2.5e-3), 64, 400_000, 1e-10, False),  # rounding
        (chained(STOPPED, "rk4", 1e-3, 20), 16, 20_000, 1.5e-7, False),
    ],
    ids=["springs, rk4", "springs, rk8", "stops, rk4"],
)
def test_energy_drifts_as_the_method_does(scene, lanes, steps, most, in_proportion):
    """Median over random releases from rest of |E - E0| [J]: of RK4 half of it in half of the time.

    With stops there is an impact in 60 steps of a lane or so; the drift has no direction then.
    """
    q = np.random.default_rng(11).uniform(-np.pi, np.pi, (lanes, 4))
    q[:, [1, 3]] = 0.15 + 0.1 / np.pi * q[:, [1, 3]]
    batch = rde.BatchSimulator(scene, lanes)
    batch.set_state(q, np.zeros((lanes, 4)))
    change = []
    for _ in range(2):
        for _ in range(steps // 2 // scene.substeps):
            assert not batch.advance().numerics.any()
        energy = kinetic_energy(scene, batch.q, batch.qd) + potential_energy(scene, batch.q)
        change.append(float(np.median(np.abs(energy - potential_energy(scene, q)))))
    assert change[1] <= most
    assert not in_proportion or 1.6 <= change[1] / change[0] <= 2.5


@pytest.mark.parametrize("limit", [100, 2**53])
def test_an_episode_is_truncated_at_its_limit_exactly(limit):
    """Its count set to two steps before: float64 counts exactly that far."""
    env = gym.make_vec("redundant_envs/RPRPReach-v0", num_envs=2, max_episode_steps=limit)
    env.reset(seed=0)
    env.unwrapped.core.memory.write(("steps",), float(limit - 2))
    truncated = [env.step(np.zeros((2, 4), np.float32))[3].tolist() for _ in range(2)]
    assert truncated == [[False, False], [True, True]]
