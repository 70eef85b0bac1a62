"""Deliberately naive variants, each with one textbook mistake that the hard cases must find."""

import math

import numpy as np

from redundant_envs.effects import Lag
from redundant_envs.effects.hooks import Force, Impact
from redundant_envs.model.batch import Event
from redundant_envs.model.energy import at_joints, scene_quantities

from .subject import Subject, commands, started, unfilled

# ---- accelerations -----------------------------------------------------------------------------------


def solved(matrix, vector):
    """x of A x = b for a batch; NaN where A is singular."""
    try:
        return np.linalg.solve(matrix, vector[..., None])[..., 0]
    except np.linalg.LinAlgError:
        return np.full_like(vector, np.nan)


class DenseSolve(Subject):
    """Forms M and solves it by Gaussian elimination: loses as many digits as M is badly conditioned."""

    name = "dense solve"

    def accelerations(self, arm, q, qd, Q, g=0.0):
        return solved(arm.mass_matrix(q), Q - arm.bias_forces(q, qd) - arm.gravity_forces(q, g))


# ---- what is kept ------------------------------------------------------------------------------------


class SinglePrecision(Subject):
    """Keeps states in float32."""

    name = "single precision"

    def keep(self, batch):
        batch.set_state(*(np.float64(np.float32(x)) for x in (batch.q, batch.qd)))


# ---- steps -------------------------------------------------------------------------------------------


class EqualSteps(Subject):
    """Equal steps of RK4, without any check of their error."""

    name = "equal steps"
    longest = 1e-3
    """Of a step, s."""
    stages = 4

    def motion(self, scene, q, qd, intervals, efforts=None):
        q, qd = started(q, qd)
        command = commands(efforts, *q.shape)
        count = math.ceil(scene.control_dt / self.longest * (1.0 - 1e-12))
        h = scene.control_dt / count
        motion = unfilled(q, qd, intervals)
        motion.evaluations[:] = self.stages * count
        lag = next((x.time_constant[0] for x in scene.effects if isinstance(x, Lag)), 0.0)
        effort = np.zeros(q.shape)
        for k in range(intervals):
            for i in range(count):
                effort = effort + (command(k) - effort) * (-math.expm1(-h / lag) if lag else 1.0)

                def acceleration(q, qd, effort=effort):
                    return self.scene_accelerations(scene, q, qd, effort)

                end = self.step(acceleration, q, qd, h)
                start_time = k * scene.control_dt + i * h
                q, qd = self.at_stops(scene, acceleration, (q, qd), end, h, start_time, motion)
            motion.q[k + 1], motion.qd[k + 1] = q, qd
        return motion

    def scene_accelerations(self, scene, q, qd, efforts):
        """With gravity and the forces of effects; of actuators and stops nothing is known here."""
        arm, x = scene.robot, scene_quantities(scene, q, qd)
        t = sum((at_joints(scene, a, "function", x) for a in scene.attached.of(Force)), efforts)
        Q = t if scene.actuation == "generalized" else t @ arm.motor_map.T
        return self.accelerations(arm, q, qd, Q, x["ay"])

    def step(self, acceleration, q, qd, h):
        a1 = acceleration(q, qd)
        v2 = qd + 0.5 * h * a1
        a2 = acceleration(q + 0.5 * h * qd, v2)
        v3 = qd + 0.5 * h * a2
        a3 = acceleration(q + 0.5 * h * v2, v3)
        v4 = qd + h * a3
        a4 = acceleration(q + h * v3, v4)
        return q + h / 6.0 * (qd + 2.0 * v2 + 2.0 * v3 + v4), qd + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)

    def at_stops(self, scene, acceleration, start, end, h, time, motion):
        """Modify the end of a step; here there are no stops."""
        return end


class ExplicitEuler(EqualSteps):
    """Position and velocity by the slopes at the start of a step: energy grows without bound."""

    name = "explicit Euler"
    longest = 5e-3
    stages = 1

    def step(self, acceleration, q, qd, h):
        return q + h * qd, qd + h * acceleration(q, qd)


class FixedSteps(EqualSteps):
    """RK4 with 10 ms, because that was always enough: nothing checks whether it still is."""

    name = "fixed steps of 10 ms"
    longest = 1e-2


# ---- stops -------------------------------------------------------------------------------------------


def stops_of(scene):
    """Of each slider its coordinate, its ends, which may be infinite, and the restitution."""
    values, stops = scene.parameters(), scene.attached.of(Impact)
    names = ((x, x.hook.lower, x.hook.upper, x.hook.restitution) for x in stops)
    return [(x.hook.joint, *(values[x.parameter(name)] for name in own)) for x, *own in names]


def impulse(arm, q, qd, k, restitution):
    """Velocities after an impact of slider k: the impulse moves the whole arm."""
    along = np.linalg.inv(arm.mass_matrix(q))[..., k]
    return qd - (1.0 + restitution) * qd[..., [k]] / along[..., [k]] * along


class ImpulseAtStepEnd(EqualSteps):
    """The right impulse at the wrong time: at the end of the step in which a slider is found outside."""

    name = "impulse at the end of a step"

    def at_stops(self, scene, acceleration, start, end, h, time, motion):
        q, qd = (x.copy() for x in end)
        for stop in stops_of(scene):
            k, lower, upper, _ = stop
            outside = (q[:, k] > upper) & (qd[:, k] > 0.0) | (q[:, k] < lower) & (qd[:, k] < 0.0)
            for i in np.flatnonzero(outside):
                kind, joint = "upper impact" if qd[i, k] > 0.0 else "lower impact", scene.robot.joints[k]
                motion.events.append(Event(time + h, kind, joint, abs(qd[i, k]), int(i)))
            self.strike(scene.robot, q, qd, stop, outside)
        return q, qd

    def strike(self, arm, q, qd, stop, outside):
        """Modify the given states."""
        k, *_, restitution = stop
        qd[outside] = impulse(arm, q[outside], qd[outside], k, restitution)


class FlippedVelocity(ImpulseAtStepEnd):
    """At a stop the slider's own velocity changes its sign; nothing else is affected."""

    name = "flipped velocity"

    def strike(self, arm, q, qd, stop, outside):
        k, lower, upper, restitution = stop
        q[:, k] = np.clip(q[:, k], lower, upper)
        qd[outside, k] *= -restitution


# ---- friction ----------------------------------------------------------------------------------------
