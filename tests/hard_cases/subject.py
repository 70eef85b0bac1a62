"""The interface between a case and an implementation, and this package's implementation.

A naive variant derives from :class:`Subject` and answers one thing its own way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

import redundant_envs as rde
from redundant_envs.control.computed_torque import pose_at


@dataclass
class Motion:
    """States at the ends of control intervals, and the status of the intervals.

    Attributes
    ----------
    q, qd : (intervals + 1, lanes, joints)
    numerics : (lanes,) int
        Faults of all intervals.
    evaluations : (intervals, lanes) int
    events : list of Event
        At stops, in the order in which they were reported.
    """

    q: np.ndarray
    qd: np.ndarray
    numerics: np.ndarray
    evaluations: np.ndarray
    events: list = field(default_factory=list)

    def impacts(self, joint=None, lane=0):
        return [x for x in self.events if "impact" in x.kind and x.lane == lane and joint in (None, x.joint)]

    @property
    def finite(self):
        return np.isfinite(self.q).all(axis=(0, 2)) & np.isfinite(self.qd).all(axis=(0, 2))


def commands(efforts: object, lanes: int, joints: int) -> Callable[[int], np.ndarray]:
    """Efforts of an interval by its number, from None, an array, or such a function."""
    if callable(efforts):
        return lambda k: np.broadcast_to(efforts(k), (lanes, joints))
    table = np.broadcast_to(0.0 if efforts is None else efforts, (lanes, joints))
    return lambda k: table


def started(q: object, qd: object) -> tuple[np.ndarray, np.ndarray]:
    """States of lanes, (lanes, joints) each, from numbers that broadcast to them."""
    q, qd = np.broadcast_arrays(np.atleast_2d(np.asarray(q, float)), np.asarray(qd, float))
    return q.copy(), qd.copy()


def unfilled(q: np.ndarray, qd: np.ndarray, intervals: int) -> Motion:
    """A motion that contains only its start."""
    shape = (intervals + 1, *q.shape)
    motion = Motion(
        np.empty(shape), np.empty(shape), np.zeros(len(q), int), np.zeros((intervals, len(q)), int)
    )
    motion.q[0], motion.qd[0] = q, qd
    return motion


class Subject:
    """This package."""

    name = "this package"
    longest = np.inf
    """Longest step of a variant with equal steps, s; a case may change it."""
    threads = 1
    """Threads of its simulators; a case may use more."""

    def arm(self, kind: str, masses: object, lengths: object) -> rde.Arm:
        """An arm, or a refusal."""
        return getattr(rde, kind)(masses, lengths)

    def accelerations(self, arm, q, qd, Q, g=0.0):
        """qdd, (..., joints), from generalized forces."""
        return arm.forward_dynamics(q, qd, Q, g)

    def pose_at(self, scene, start, goal):
        """A pose with the tip at a goal, by iteration from a start."""
        return pose_at(scene, np.array([start]), np.array([goal]))[0]

    def motion(self, scene, q, qd, intervals, efforts=None, change=None):
        """A motion over control intervals; ``change(k, batch)`` may set parameters before the k-th."""
        q, qd = started(q, qd)
        stops = any(type(x) is rde.effects.PrismaticStop for x in scene.effects)
        batch = rde.BatchSimulator(scene, len(q), threads=self.threads, track_work=stops)
        batch.set_state(q, qd)
        command = commands(efforts, *q.shape)
        motion = unfilled(q, qd, intervals)
        for k in range(intervals):
            if change is not None:
                change(k, batch)
            status = batch.advance(command(k))
            motion.q[k + 1], motion.qd[k + 1] = batch.q, batch.qd
            motion.numerics |= status.numerics
            motion.evaluations[k] = status.evaluations
            if stops:
                motion.events += batch.events(k * scene.control_dt)
        return motion

    def save(self, batch):
        """A snapshot of a simulator."""
        return batch.save()

    def restore(self, batch, snapshot):
        """Return to it."""
        batch.restore(snapshot)

    def instants(self, count, dt):
        """The times at which a controller is called, s: ``count`` of them."""
        scene = rde.Scene(rde.FourR((1.0,) * 4, (0.5,) * 4), (), integrator="euler", control_dt=dt)
        asked = []

        def controller(t, q, qd):
            asked.append(t)
            return np.zeros(4)

        rde.simulate(scene, np.zeros(4), np.zeros(4), [count * dt], controller)
        return np.array(asked[:count])
