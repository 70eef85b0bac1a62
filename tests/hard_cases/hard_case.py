"""The harness of hard cases: rows that simulate a motion of a subject and ask for figures of it.

Measured of this package every figure must keep its bound; measured of a naive variant, one must miss it.
"""

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

from . import naive

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
    caught: tuple = ()  # naive variants that fail it
    mujoco: str = ""

    @property
    def name(self):
        return f"case {self.number}, {self.title}"

    @property
    def variants(self):
        return [getattr(naive, name) for name in self.caught]

    def figures(self, subject):
        """Figures of a subject; variants overflow and divide by zero, which shows in their figures."""
        with np.errstate(all="ignore"):
            for row in self.rows:
                yield from row(subject)


# ---- rows -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Asked:
    """A figure of a motion."""

    name: str
    number: Callable  # of the run and the motion
    promise: Promise


@dataclass(frozen=True)
class Run:
    """A motion, and the figures that are asked of it."""

    scene: rde.Scene
    q: Any
    qd: Any
    intervals: int
    asked: tuple[Asked, ...]
    efforts: Any = None
    name: str = ""  # before those of the figures
    longest: float | None = None  # step of variants with equal steps, s

    def motion(self, subject):
        if self.longest is not None:
            subject.longest = self.longest
        return subject.motion(self.scene, self.q, self.qd, self.intervals, self.efforts)

    def __call__(self, subject):
        motion = self.motion(subject)
        for one in self.asked:
            yield Figure(self.name + one.name, float(one.number(self, motion)), one.promise)

    def fine_end(self, substeps):
        """A simulator at the end of the motion in many equal steps."""
        fine = dataclasses.replace(self.scene, tolerance=None, substeps=substeps)
        batch = rde.BatchSimulator(fine, len(np.atleast_2d(self.q)), track_work=True)
        batch.set_state(self.q, self.qd)
        for _ in range(self.intervals):
            batch.advance(None if self.efforts is None else np.atleast_2d(self.efforts))
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
