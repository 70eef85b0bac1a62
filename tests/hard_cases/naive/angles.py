"""Mistakes in the stored state: wrapped angles, single precision, a clock that is a sum."""

import numpy as np
from subject import Subject, commands, started, unfilled

import redundant_envs as rde


class _Kept(Subject):
    """Moves as this package does, but keeps another state from one interval to the next."""

    def kept(self, arm, q, qd):
        raise NotImplementedError

    def motion(self, scene, q, qd, intervals, efforts=None, change=None):
        q, qd = self.kept(scene.robot, *started(q, qd))
        batch, command = rde.BatchSimulator(scene, len(q)), commands(efforts, *q.shape)
        motion = unfilled(q, qd, intervals)
        for k in range(intervals):
            batch.set_state(q, qd)
            status = batch.advance(command(k))
            q, qd = self.kept(scene.robot, batch.q, batch.qd)
            motion.q[k + 1], motion.qd[k + 1] = q, qd
            motion.numerics |= status.numerics
            motion.evaluations[k] = status.evaluations
        return motion


class WrappedAngles(_Kept):
    """Wraps every angle into -pi to pi: where one link is wrapped and the next is not, the joint between
    them has turned once around."""

    name = "wrapped angles"

    def kept(self, arm, q, qd):
        wrapped = np.mod(q + np.pi, 2.0 * np.pi) - np.pi
        wrapped[..., arm.sliders()] = q[..., arm.sliders()]
        return wrapped, qd


class SinglePrecision(_Kept):
    """Keeps states in float32."""

    name = "single precision"

    def kept(self, arm, q, qd):
        return tuple(np.float64(np.float32(x)) for x in (q, qd))


class SummedClock(Subject):
    """Adds dt to the time at every step: rounding adds up, too."""

    name = "clock by addition"

    def instants(self, count, dt):
        times, t = np.empty(count), 0.0
        for k in range(count):
            times[k] = t
            t += dt
        return times
