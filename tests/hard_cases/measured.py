"""Measurements of several cases: errors of accelerations, energies, orders."""

import dataclasses
import math

import mpmath
import numpy as np
from exact_numbers import exactly

import redundant_envs as rde
from redundant_envs.language.quantities import Quantities
from redundant_envs.model.energy import kinetic_energy, potential_energy

from .hard_case import at_most

LAB = rde.FourR((1.0,) * 4, (0.5,) * 4)
"""The 4R arm of 1 kg and 0.5 m each."""
SLIDING = rde.RPRP((1.0,) * 4, (0.5, 0.5))
UNEQUAL = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))
HEAVY = rde.RPRP((1e6, 1.0, 1e-6, 1e-6), (1.0, 1.0))
"""Slider 1 carries 1 kg and nothing else moves."""
GRAVITY = rde.effects.Gravity(9.81)
STATE_B = (0.2, 1.0, -0.5, 2.0), (6.0, -4.0, 8.0, -10.0)
"""98 J: chaotic, a Lyapunov time of 0.16 s."""
FIVE_IMPACTS = (0.3, 0.1, -0.4, 0.2), (1.0, 0.8, -2.0, -0.6)
"""In half a second between stops."""


def exact_accelerations(arm, q, qd, Q, g=0.0, digits=60):
    """qdd from M qdd = Q - h - G, solved densely in 60 digits."""
    n = len(arm.coordinates)
    with mpmath.workdps(digits):
        numbers = dict(zip((*arm.coordinates, *arm.rates), (*q, *qd), strict=True))
        known = exactly({**arm.parameter_values(), **numbers, "ax": 0.0, "ay": g})
        values = Quantities(known, arm.functions, arm.sincos)
        rows = range(1, n + 1)
        mass = mpmath.matrix([[values[f"M{i}{j}"] for j in rows] for i in rows])
        free = mpmath.matrix([mpmath.mpf(Q[i - 1]) - values[f"h{i}"] - values[f"G{i}"] for i in rows])
        return [mpmath.mpf(x) for x in mpmath.lu_solve(mass, free)]


def acceleration_error(subject, arm, q, qd, Q, g=0.0):
    """Largest error of qdd, relative to its largest entry."""
    exact = exact_accelerations(arm, q, qd, Q, g)
    found = subject.accelerations(arm, np.array(q, float), np.array(qd, float), np.array(Q, float), g)
    if not np.isfinite(found).all():
        return math.nan
    with mpmath.workdps(60):
        worst = max(abs(mpmath.mpf(float(a)) - b) for a, b in zip(found, exact, strict=True))
        return float(worst / max(abs(b) for b in exact))


def accelerations(subject, *state, prefix="", most=1e-14):
    """The figure of the same error."""
    error = acceleration_error(subject, *state)
    return at_most(f"{prefix}the error of qdd", error, most, "of the largest acceleration")


def energy(scene, q, qd):
    """Kinetic and potential energy, (...), J."""
    return kinetic_energy(scene, q, qd) + potential_energy(scene, q)


def energy_error(scene, motion):
    """Largest change of the energy of any lane since the start, J."""
    total = energy(scene, motion.q, motion.qd)
    change = np.abs(total - total[0])
    return float(change.max()) if np.isfinite(change).all() else math.nan


def tip_error(arm, q, reference):
    """Largest distance of tips, m."""
    off = np.linalg.norm(arm.forward_kinematics(q) - arm.forward_kinematics(np.asarray(reference)), axis=-1)
    return float(np.max(off))


def orders(errors, ratios):
    """Measured orders of successive errors."""
    return [math.log(a / b) / math.log(r) for a, b, r in zip(errors, errors[1:], ratios, strict=False)]


def stopped(arm=SLIDING, restitution=1.0, gravity=9.81, upper=(0.3, 0.3), **kwargs):
    """A scene of sliders between hard stops at 0 and ``upper``, m."""
    stop = rde.effects.PrismaticStop((0.0, 0.0), upper, restitution)
    return rde.Scene(arm, (rde.effects.Gravity(gravity), stop), **{"control_dt": 0.02, **kwargs})


def five_impacts(subject, steps):
    """Errors of the tip after half a second in steps of RK4, m, and the motion in the last of them."""
    reference, errors = rde.simulate(stopped(integrator="dop853"), *FIVE_IMPACTS, [0.5]).q[-1], []
    for h in steps:
        subject.longest = h
        motion = subject.motion(stopped(integrator="rk4", control_dt=h), *FIVE_IMPACTS, round(0.5 / h))
        errors.append(tip_error(SLIDING, motion.q[-1, 0], reference))
    return errors, motion


def fine_end(scene, q, qd, substeps, intervals=1, efforts=None):
    """A simulator at the end of a motion in many equal steps."""
    fine = dataclasses.replace(scene, tolerance=None, substeps=substeps)
    batch = rde.BatchSimulator(fine, len(np.atleast_2d(q)), track_work=True)
    batch.set_state(q, qd)
    for _ in range(intervals):
        batch.advance(efforts)
    return batch


def penetration(motion):
    """Largest penetration of a stop at the end of an interval, m."""
    sliders = motion.q[..., [1, 3]]
    return float(np.maximum(np.maximum(sliders - 0.3, 0.0 - sliders).max(), 0.0))
