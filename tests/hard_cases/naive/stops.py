"""Mistakes at hard stops."""

import numpy as np

from naive.steps import EqualSteps
from redundant_envs.effects import PrismaticStop
from redundant_envs.model.batch import Event


def stops_of(scene):
    """Of each slider its coordinate, its ends, which may be infinite, and the restitution."""
    found = []
    for stop in (x for x in scene.effects if isinstance(x, PrismaticStop)):
        for i, k in enumerate(scene.robot.sliders()):
            lower = -np.inf if stop.lower[i] is None else stop.lower[i]
            upper = np.inf if stop.upper[i] is None else stop.upper[i]
            found.append((k, lower, upper, stop.restitution))
    return found


def tell(motion, scene, k, time, speed, lanes):
    """Add impacts to the events of a motion."""
    kind = "upper impact" if speed > 0.0 else "lower impact"
    motion.events += [Event(time, kind, scene.robot.joints[k], abs(speed), int(i)) for i in lanes]


def impulse(arm, q, qd, k, restitution):
    """Velocities after an impact of slider k: the impulse moves the whole arm."""
    along = np.linalg.inv(arm.mass_matrix(q))[..., k]
    return qd - (1.0 + restitution) * qd[..., [k]] / along[..., [k]] * along


class _ImpactAtStepEnd(EqualSteps):
    """Checks at the end of each step which sliders are outside and still move outwards."""

    def at_stops(self, scene, acceleration, start, end, h, time, motion):
        q, qd = (x.copy() for x in end)
        for stop in stops_of(scene):
            k, lower, upper, _ = stop
            outside = (q[:, k] > upper) & (qd[:, k] > 0.0) | (q[:, k] < lower) & (qd[:, k] < 0.0)
            for i in np.flatnonzero(outside):
                tell(motion, scene, k, time + h, qd[i, k], [i])
            self.strike(scene.robot, q, qd, stop, outside)
        return q, qd

    def strike(self, arm, q, qd, stop, outside):
        """Modify the given states."""
        raise NotImplementedError


class FlippedVelocity(_ImpactAtStepEnd):
    """At a stop the slider's own velocity changes its sign; nothing else is affected."""

    name = "flipped velocity"

    def strike(self, arm, q, qd, stop, outside):
        k, lower, upper, restitution = stop
        q[:, k] = np.clip(q[:, k], lower, upper)
        qd[outside, k] *= -restitution


class ImpulseAtStepEnd(_ImpactAtStepEnd):
    """The right impulse at the wrong time: at the end of the step in which the slider is found outside."""

    name = "impulse at the end of a step"

    def strike(self, arm, q, qd, stop, outside):
        k, *_, restitution = stop
        qd[outside] = impulse(arm, q[outside], qd[outside], k, restitution)


class CubicGuess(EqualSteps):
    """The cubic through positions and velocities at both ends of a step says when the slider meets its stop:
    its root is taken as the time, and a stop it does not reach as never met."""

    name = "cubic event guess taken as truth"
    longest = 2e-2

    def at_stops(self, scene, acceleration, start, end, h, time, motion):
        ends = [self.lane(scene, acceleration, start, end, h, time, motion, i) for i in range(len(end[0]))]
        return tuple(np.array(x) for x in zip(*ends, strict=True))

    def lane(self, scene, acceleration, start, end, h, time, motion, i):
        left = h
        (q0, v0), (q1, v1) = ([x[[i]] for x in state] for state in (start, end))
        for _ in range(100):
            if not np.isfinite([*q1[0], *v1[0]]).all():
                break
            guesses = [
                (tau, k, stop, restitution)
                for k, lower, upper, restitution in stops_of(scene)
                for side, stop in ((-1.0, lower), (1.0, upper))
                for tau in self.roots(q0[0, k], v0[0, k], q1[0, k], v1[0, k], left, side, stop)
            ]
            if not guesses:
                break
            tau, k, stop, restitution = min(guesses)
            q0, v0 = self.step(acceleration, q0, v0, tau)
            q0[0, k] = stop
            tell(motion, scene, k, time + h - left + tau, v0[0, k], [i])
            v0 = impulse(scene.robot, q0, v0, k, restitution)
            left -= tau
            q1, v1 = self.step(acceleration, q0, v0, left)
        return q1[0], v1[0]

    @staticmethod
    def roots(q0, v0, q1, v1, h, side, stop):
        """Times in (0, h] at which the cubic passes a stop outwards."""
        if not np.isfinite(stop):
            return []
        cubic = [2.0 * (q0 - q1) + h * (v0 + v1), 3.0 * (q1 - q0) - h * (2.0 * v0 + v1), h * v0, q0 - stop]
        found = np.roots(cubic)
        times = h * found.real[np.abs(found.imag) < 1e-9]
        slope = side * np.polyval(np.polyder(cubic), times / h)
        return [t for t, s in zip(times, slope, strict=True) if 1e-9 * h < t <= h and s > 0.0]
