"""Hard cases of dry friction: joints that stick, and bristles that bend in no time."""

import math

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs import effects as e

from . import measured as m
from .hard_case import at_most, hard_case

START = np.array((0.3, -0.5, 1.0, 0.2))
LEVELS = np.array((4.0, 3.0, 2.0, 1.0))
"""Dry friction of the joints, N m."""
ALONE = np.array((1e6, 1e6, 1e6, 1.0))
"""The same where only the last joint can move: its inertia is 1/4 kg m^2."""


def dry(levels, **how):
    return rde.Scene(m.LAB, (e.CoulombFriction(tuple(levels)),), **how)


@pytest.mark.long
@hard_case
def test_33_true_stiction(subject):
    for dt in (0.02, 0.005, 0.001):
        motion = subject.motion(dry(LEVELS, control_dt=dt), START, 0.0, round(10.0 / dt), 0.9 * LEVELS)
        drift = np.abs(motion.q[-1] - motion.q[0]).max()
        yield at_most(
            f"in steps of {1e3 * dt:g} ms the drift in 10 s under 0.9 of the friction", drift, 0.0, "rad"
        )
    for load, travelled in ((1.01, 0.5 * 0.01 / 0.25), (1.0, 0.0)):
        effort = np.array((0.0, 0.0, 0.0, load))
        motion = subject.motion(dry(ALONE, control_dt=0.02), np.zeros(4), 0.0, 50, effort)
        off = abs(motion.q[-1, 0, 3] - travelled)
        yield at_most(f"under {load:g} of the friction the angle after 1 s", off, 1e-13, "rad off")
    flywheel = rde.Scene(rde.Chain("R", (1.0,), (0.5,)), (e.CoulombFriction(1.0),), control_dt=0.02)
    off = abs(subject.motion(flywheel, [0.0], 0.5, 50).q[-1, 0, 0] - 0.5 * 0.25 * 0.5**2)
    yield at_most("pushed to 0.5 rad/s, where a joint has stopped after 1 s", off, 1e-13, "rad off")


@hard_case
def test_34_bristles_that_bend_within_a_step(subject):
    """A flywheel of 1000 kg m^2 at 10 rad/s loses what friction takes: F_C + sigma2 v, once they are bent."""
    arm, level, viscous = rde.Chain("R", (1e3,), (1.0,)), 1.0, 0.4
    bristles = e.LuGre(1e5, 0.0, viscous, level, 1.5, 0.01)
    for integrator in ("euler", "rk4", "rk8"):
        scene = rde.Scene(arm, (bristles,), integrator, control_dt=0.01)
        rates = subject.motion(scene, [0.0], 10.0, 11).qd[1:, 0, 0]
        lost = -np.diff(rates[[0, -1]])[0]
        decay = (
            -math.expm1(-viscous * 0.1 / 1e3) if integrator != "euler" else 1.0 - (1.0 - viscous * 1e-5) ** 10
        )
        expected = (rates[0] + level / viscous) * decay
        yield at_most(f"with {integrator} the friction", abs(lost / expected - 1.0), 1e-9, "of itself off")
