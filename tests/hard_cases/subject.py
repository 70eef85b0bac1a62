"""The interface between a case and an implementation, and this package's implementation.

A naive variant derives from :class:`Subject` and answers one thing its own way.
"""

from dataclasses import dataclass, field

import numpy as np

import redundant_envs as rde


@dataclass
class Motion:
    """States at the ends of control intervals, and the status of the intervals."""

    q: np.ndarray  # (intervals + 1, lanes, joints), as qd
    qd: np.ndarray
    numerics: np.ndarray  # (lanes,): faults of all intervals
    evaluations: np.ndarray  # (intervals, lanes)
    events: list = field(default_factory=list)  # at stops, in the order in which they were reported

    def impacts(self, joint=None, lane=0):
        return [x for x in self.events if "impact" in x.kind and x.lane == lane and joint in (None, x.joint)]


def commands(efforts, lanes, joints):
    """Efforts of an interval by its number, from None, an array, or such a function."""
    if callable(efforts):
        return lambda k: np.broadcast_to(efforts(k), (lanes, joints))
    table = np.broadcast_to(0.0 if efforts is None else efforts, (lanes, joints))
    return lambda k: table


def started(q, qd):
    """States of lanes, (lanes, joints) each, from numbers that broadcast to them."""
    q, qd = np.broadcast_arrays(np.atleast_2d(np.asarray(q, float)), np.asarray(qd, float))
    return q.copy(), qd.copy()


def unfilled(q, qd, intervals):
    """A motion that contains only its start."""
    states = np.empty((2, intervals + 1, *q.shape))
    motion = Motion(*states, np.zeros(len(q), int), np.zeros((intervals, len(q)), int))
    motion.q[0], motion.qd[0] = q, qd
    return motion


class Subject:
    """This package."""

    name = "this package"
    longest = np.inf
    """Longest step of a variant with equal steps, s; a case may change it."""

    def accelerations(self, arm, q, qd, Q, g=0.0):
        """qdd, (..., joints), from generalized forces."""
        return arm.forward_dynamics(q, qd, Q, g)

    def motion(self, scene, q, qd, intervals, efforts=None):
        """A motion over control intervals."""
        q, qd = started(q, qd)
        batch = rde.BatchSimulator(scene, len(q), track_work=True)  # it tells events
        batch.set_state(q, qd)
        self.keep(batch)
        command, motion = commands(efforts, *q.shape), unfilled(batch.q, batch.qd, intervals)
        for k in range(intervals):
            status = batch.advance(command(k))
            motion.events += batch.events(k * scene.control_dt)
            self.keep(batch)
            motion.q[k + 1], motion.qd[k + 1] = batch.q, batch.qd
            motion.numerics |= status.numerics
            motion.evaluations[k] = status.evaluations
        return motion

    def keep(self, batch):
        """Set another state for the next interval: this package keeps its own."""
