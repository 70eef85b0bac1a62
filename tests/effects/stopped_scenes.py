"""Scenes of sliders between hard stops, 0 to 0.3 m."""

import numpy as np

import redundant_envs as rde

ARM = rde.RPRP((1.0,) * 4, (0.5, 0.5))
UNEQUAL = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))
START = ((0.3, 0.1, -0.4, 0.2), (1.0, 0.8, -2.0, -0.6))
"""Five impacts in half a second."""


def scene(arm=ARM, restitution=1.0, lower=(0.0, 0.0), upper=(0.3, 0.3), gravity=9.81, **kwargs):
    effects = (rde.effects.Gravity(gravity), rde.effects.PrismaticStop(lower, upper, restitution))
    return rde.Scene(arm, effects, **{"control_dt": 0.02, **kwargs})


def random_batch(count, seed=5):
    """States and efforts; every seventh r1 begins at its stop."""
    rng = np.random.default_rng(seed)
    q = np.column_stack([rng.uniform(-3, 3, count), rng.uniform(0, 0.3, count)] * 2)
    q[::7, 1] = 0.3
    return q, rng.normal(0, 2, (count, 4)), rng.uniform(-20, 20, (count, 4))
