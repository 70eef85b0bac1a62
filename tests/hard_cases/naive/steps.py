"""Mistakes in stepping: a plain simulator of equal steps in NumPy, and variants of it."""

import math

import numpy as np
import places  # noqa: F401
from actuator_lag import ActuatorLag
from subject import Subject, commands, started, unfilled

from redundant_envs.effects import CentringSpring, Gravity, LimitSpring, PrismaticStop, ViscousFriction


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
        lag = next((x.time_constant for x in scene.effects if isinstance(x, ActuatorLag)), 0.0)
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
        """Gravity, springs and friction of a scene; nothing else is known here."""
        arm, g = scene.robot, 0.0
        B = arm.motor_map
        phi, rates, t = q @ B, qd @ B, np.array(efforts)
        for effect in scene.effects:
            if isinstance(effect, Gravity):
                g = effect.g
            elif isinstance(effect, ViscousFriction):
                t = t - np.asarray(effect.coefficients) * rates
            elif isinstance(effect, LimitSpring):
                k = arm.joint_index(effect.coordinate)
                depth = phi[:, k] - np.clip(phi[:, k], effect.lower, effect.upper)
                inwards = np.sign(depth) * rates[:, k]
                t[:, k] -= depth * np.maximum(effect.stiffness + effect.damping * inwards, 0.0)
            elif isinstance(effect, CentringSpring):
                for i, k in enumerate(arm.sliders()):
                    middle = 0.5 * (effect.lower[i] + effect.upper[i])
                    t[:, k] -= 2.0 * effect.stiffness[i] * (phi[:, k] - middle)
            else:
                assert isinstance(effect, PrismaticStop | ActuatorLag), f"no naive variant knows {effect}"
        Q = t if scene.actuation == "generalized" else t @ B.T
        return self.accelerations(arm, q, qd, Q, g)

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


class EstimateWithoutFloor(EqualSteps):
    """Takes twice the steps until two results agree, and trusts them from the first step on: what neither
    has touched, no estimate sees."""

    name = "estimate without a floor"
    longest = 1e3
    tolerance = 1e-6

    def step(self, acceleration, q, qd, h):
        coarse = super().step(acceleration, q, qd, h)
        for doublings in range(1, 11):
            fine, count = (q, qd), 2**doublings
            for _ in range(count):
                fine = super().step(acceleration, *fine, h / count)
            if np.abs(fine[0] - coarse[0]).max() <= self.tolerance:
                break
            coarse = fine
        return fine
