"""The harness of hard cases: rows that simulate a motion and ask for figures of it, each with its bound."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import yaml

import redundant_envs as rde
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
    """A hard case: its words in ``cases.yaml``, and its rows, functions that give figures."""

    number: str
    theme: str
    title: str
    hard: str
    naive: str
    rows: tuple
    mujoco: str = ""

    def figures(self):
        return [figure for row in self.rows for figure in row()]


@dataclass
class Motion:
    """States at the ends of control intervals, and the status of the intervals."""

    q: np.ndarray  # (intervals + 1, lanes, joints), as qd
    qd: np.ndarray
    numerics: np.ndarray  # (lanes,): faults of all intervals
    evaluations: np.ndarray  # (intervals, lanes)
    events: list  # at stops, in the order in which they were reported

    def impacts(self, joint=None, lane=0):
        return [x for x in self.events if "impact" in x.kind and x.lane == lane and joint in (None, x.joint)]


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

    def started(self, scene):
        """A simulator at the start, which tells events."""
        q, qd = np.broadcast_arrays(np.atleast_2d(np.asarray(self.q, float)), np.asarray(self.qd, float))
        batch = rde.BatchSimulator(scene, len(q), track_work=True)
        batch.set_state(q, qd)
        return batch

    def advance(self, batch, k):
        efforts = self.efforts(k) if callable(self.efforts) else self.efforts
        return batch.advance(np.broadcast_to(0.0 if efforts is None else efforts, batch.q.shape))

    def motion(self):
        batch = self.started(self.scene)
        states, status, events = [(batch.q, batch.qd)], [], []
        for k in range(self.intervals):
            status.append(self.advance(batch, k))
            events += batch.events(k * self.scene.control_dt)
            states.append((batch.q, batch.qd))
        faults = np.bitwise_or.reduce([x.numerics for x in status])
        evaluations = np.array([x.evaluations for x in status])
        return Motion(*map(np.array, zip(*states, strict=True)), faults, evaluations, events)

    def __call__(self):
        motion = self.motion()
        for one in self.asked:
            yield Figure(self.name + one.name, float(one.number(self, motion)), one.promise)

    def fine_end(self, substeps):
        """A simulator at the end of the motion in many equal steps."""
        batch = self.started(dataclasses.replace(self.scene, tolerance=None, substeps=substeps))
        for k in range(self.intervals):
            self.advance(batch, k)
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

    def __call__(self):
        promise = at_most(self.bound, "of the largest acceleration")
        yield Figure(f"{self.name}the error of qdd", self.error(), promise)

    def error(self):
        state = (np.array(x, float) for x in (self.q, self.qd, self.Q))
        found, exact = self.arm.forward_dynamics(*state, self.g), self.exact()
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
