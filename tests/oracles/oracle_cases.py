"""Arms, states and motions that the oracles share, and how a residual is judged."""

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.effects import Gravity

G = 9.81
UNEQUAL = {
    "RPRP": rde.RPRP((2.3, 0.7, 1.9, 0.4), (1.1, 0.6)),
    "FourR": rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35)),
}
LAB = {"RPRP": rde.RPRP((1.0,) * 4, (0.5,) * 2), "FourR": rde.FourR((1.0,) * 4, (0.5,) * 4)}
"""Equal masses of 1 kg and links of 0.5 m."""
EVERY = pytest.mark.parametrize("robot", UNEQUAL.values(), ids=UNEQUAL)
ANGLES = {"RPRP": np.array([True, False, True, False]), "FourR": np.array([True] * 4)}


def assert_within(bounds, residuals):
    """Every residual is at most its bound; the message says which is not, and by what factor."""
    assert residuals.keys() == bounds.keys()
    misses = [
        f"{name}: {residuals[name]:.2e} where {bound:.2e} is allowed"
        + (f", {residuals[name] / bound:.3g} times" if bound else "")
        for name, bound in bounds.items()
        if not residuals[name] <= bound
    ]
    assert not misses, "; ".join(misses)


def exact(robot, g=G, **changes):
    """A scene of gravity at the preset "exact"."""
    return rde.Scene(robot, (Gravity(g),), **{"tolerance": 1e-12, "control_dt": 0.02, **changes})


def states(robot, count, seed=7, speed=2.0):
    """Random coordinates and velocities, (count, 4) each; sliders within 0.25 m of their middle."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-np.pi, np.pi, (count, 4))
    q[:, list(robot.prismatic)] *= 0.25 / np.pi
    return q, rng.uniform(-speed, speed, (count, 4))


def motion(scene, q, qd, seconds, efforts=None, parameters=None, duration=None):
    """Coordinates and velocities after some time, (count, 4) each; no lane reports a fault.

    ``duration`` [s] is the interval if it is not that of the scene.
    """
    q, qd = np.broadcast_arrays(np.atleast_2d(q), np.atleast_2d(qd))
    batch = rde.BatchSimulator(scene, len(q))
    if parameters:
        batch.set_parameters(parameters)
    batch.set_state(q, qd)
    if efforts is not None:
        efforts = np.broadcast_to(np.asarray(efforts, float), q.shape)
    for _ in range(round(seconds / (duration or scene.control_dt))):
        status = batch.advance_partly(efforts, duration) if duration else batch.advance(efforts)
        assert not status.numerics.any()
    return batch.q, batch.qd


def largest(difference, scale=1.0):
    """Largest absolute entry, in units of the scale."""
    return float((np.abs(difference) / scale).max())
