"""The harness of hard cases: rows that simulate a motion of a subject and ask for figures of it.

Measured of this package every figure must keep its bound; measured of a naive variant, one must miss it.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import yaml

import redundant_envs as rde
from redundant_envs.control import pose_at
from redundant_envs.language.quantities import Quantities
from redundant_envs.verify.promises import Promise, at_most
from tests.exact_numbers import exactly

THEMES = yaml.safe_load(Path(__file__).with_name("cases.yaml").read_text(encoding="utf-8"))
"""Heading of the page -> its cases by their numbers, in the order of the page."""


@dataclass(frozen=True)
class Figure:
    """One number that a case measures, and the promise about it."""

    name: str  # the measured quantity, to be read before "is 3e-5"
    found: float
    promise: Promise

    @property
    def kept(self):
        return self.promise.holds(self.found)

    def __str__(self):
        return f"{self.name} is {self.found:.2g}, {self.promise} is promised"


@dataclass(frozen=True)
class Case:
    """A hard case: its words in ``cases.yaml``, and its rows, which are functions of a subject."""

    number: str
    theme: str
    title: str
    hard: str
    naive: str
    rows: tuple
    caught: tuple = ()  # naive variants that fail it: subclasses of Subject
    mujoco: str = ""
    compared: bool = False  # also measured of MuJoCo

    def figures(self, subject):
        """Figures of a subject; variants overflow and divide by zero, which shows in their figures."""
        with np.errstate(all="ignore"):
            for row in self.rows:
                yield from row(subject)


@dataclass
class Motion:
    """States at the ends of control intervals, and the status of the intervals."""

    q: np.ndarray  # (intervals + 1, lanes, joints), as qd
    qd: np.ndarray
    numerics: np.ndarray  # (lanes,): faults of all intervals
    evaluations: np.ndarray  # (intervals, lanes)
    events: list = field(default_factory=list)  # at stops, in the order in which they were reported

    @classmethod
    def begun(cls, q, qd, intervals):
        """A motion that contains only its start."""
        states = np.empty((2, intervals + 1, *q.shape))
        states[:, 0] = q, qd
        return cls(*states, np.zeros(len(q), int), np.zeros((intervals, len(q)), int))

    def impacts(self, joint=None, lane=0):
        return [x for x in self.events if "impact" in x.kind and x.lane == lane and joint in (None, x.joint)]


class Subject:
    """This package. A naive variant derives from it, and answers one thing its own way."""

    name = "this package"

    def accelerations(self, arm, q, qd, Q, g=0.0):
        """qdd, (..., joints), from generalized forces."""
        return arm.forward_dynamics(q, qd, Q, g)

    def pose_at(self, scene, start, goal):
        """A pose with the tip at a goal, by iteration from a start."""
        return pose_at(scene, np.array([start]), goal[None])[0]

    def motion(self, run):
        batch = run.batch(run.scene)
        self.keep(batch)
        motion = Motion.begun(batch.q, batch.qd, run.intervals)
        for k in range(run.intervals):
            status = batch.advance(run.command(k))
            motion.events += batch.events(k * run.scene.control_dt)
            self.keep(batch)
            motion.q[k + 1], motion.qd[k + 1] = batch.q, batch.qd
            motion.numerics |= status.numerics
            motion.evaluations[k] = status.evaluations
        return motion

    def keep(self, batch):
        """Set another state for the next interval: this package keeps its own."""


# ---- rows -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Asked:
    """A figure of a motion."""

    name: str
    number: Callable  # of the run and the motion
    promise: Promise


@dataclass(frozen=True)
class Run:
    """A motion over control intervals, and the figures that are asked of it."""

    scene: rde.Scene
    q: Any
    qd: Any
    intervals: int
    asked: tuple[Asked, ...] = ()
    efforts: Any = None  # or a function of the number of an interval
    name: str = ""  # before those of the figures
    longest: float | None = None  # step of variants with equal steps, s; None: their own

    def start(self):
        """States of lanes, (lanes, joints) each."""
        q, qd = np.broadcast_arrays(np.atleast_2d(np.asarray(self.q, float)), np.asarray(self.qd, float))
        return q.copy(), qd.copy()

    def command(self, k):
        """Efforts of an interval, (lanes, joints)."""
        efforts = self.efforts(k) if callable(self.efforts) else self.efforts
        return np.broadcast_to(0.0 if efforts is None else efforts, self.start()[0].shape)

    def batch(self, scene):
        """A simulator at the start, which tells events."""
        q, qd = self.start()
        batch = rde.BatchSimulator(scene, len(q), track_work=True)
        batch.set_state(q, qd)
        return batch

    def __call__(self, subject):
        motion = subject.motion(self)
        for one in self.asked:
            yield Figure(self.name + one.name, float(one.number(self, motion)), one.promise)

    def fine_end(self, substeps):
        """A simulator at the end of the motion in many equal steps."""
        batch = self.batch(dataclasses.replace(self.scene, tolerance=None, substeps=substeps))
        for k in range(self.intervals):
            batch.advance(self.command(k))
        return batch


@dataclass(frozen=True)
class Accelerations:
    """The accelerations of an arm in a state, against those solved densely in 60 digits."""

    arm: rde.Arm
    q: Any
    qd: Any
    Q: Any
    g: float = 0.0
    bound: float = 1e-14
    name: str = ""

    def __call__(self, subject):
        promise = at_most(self.bound, "of the largest acceleration")
        yield Figure(f"{self.name}the error of qdd", self.error(subject), promise)

    def error(self, subject):
        state = (np.array(x, float) for x in (self.q, self.qd, self.Q))
        found, exact = subject.accelerations(self.arm, *state, self.g), self.exact()
        if not np.isfinite(found).all():
            return math.nan
        with mpmath.workdps(60):
            worst = max(abs(mpmath.mpf(float(a)) - b) for a, b in zip(found, exact, strict=True))
            return float(worst / max(abs(b) for b in exact))

    def exact(self):
        """qdd from M qdd = Q - h - G."""
        arm, n = self.arm, len(self.arm.coordinates)
        with mpmath.workdps(60):
            state = dict(zip((*arm.coordinates, *arm.rates), (*self.q, *self.qd), strict=True))
            known = exactly({**arm.parameter_values(), **state, "ax": 0.0, "ay": self.g})
            values, rows = Quantities(known, arm.functions, arm.sincos), range(1, n + 1)
            mass = mpmath.matrix([[values[f"M{i}{j}"] for j in rows] for i in rows])
            forces = [mpmath.mpf(self.Q[i - 1]) - values[f"h{i}"] - values[f"G{i}"] for i in rows]
            return [mpmath.mpf(x) for x in mpmath.lu_solve(mass, mpmath.matrix(forces))]
