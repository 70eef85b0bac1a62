"""Sliders between hard stops at 0 and 0.3 m."""

import numpy as np

import redundant_envs as rde
from redundant_envs import effects as e

ARM = rde.RPRP((1.0,) * 4, (0.5, 0.5))
UNEQUAL = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))
HEAVY = rde.RPRP((1e6, 1.0, 1e-6, 1e-6), (1.0, 1.0))
"""Slider 1 carries 1 kg and nothing else moves."""


def stopped(arm=ARM, restitution=1.0, gravity=9.81, **kwargs):
    """A scene of such an arm."""
    stop = e.PrismaticStop((0.0, 0.0), (0.3, 0.3), restitution)
    field = (e.Gravity(gravity),) if gravity else ()
    return rde.Scene(arm, (*field, stop), **{"control_dt": 0.02, **kwargs})


def penetration(motion):
    """Largest penetration of a stop at the end of an interval, m."""
    sliders = motion.q[..., [1, 3]]
    return float(np.maximum(np.maximum(sliders - 0.3, 0.0 - sliders).max(), 0.0))
