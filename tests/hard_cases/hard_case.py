"""Hard cases: descriptions (``cases.yaml``), promises, and the mistakes that each case finds.

A case is a function of the implementation under test that returns figures. As a test it measures this
package, and every figure must keep its bound; measured on a naive variant, a figure must miss its bound.
"""

import importlib
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from . import naive
from .subject import Subject

THEMES = yaml.safe_load(Path(__file__).with_name("cases.yaml").read_text(encoding="utf-8"))
"""Heading of the page -> its cases by their numbers, in the order of the page."""
ROWS = {number: {"theme": theme, **row} for theme, rows in THEMES.items() for number, row in rows.items()}
CASES = {}
"""All cases by their numbers, once their modules are imported."""


@dataclass(frozen=True)
class Figure:
    """One number that a case measures, and the promise about it; NaN keeps no promise."""

    name: str  # the measured quantity, to be read before "is 3e-5"
    found: float
    relation: str  # "at most" or "at least"
    bound: float
    unit: str = ""  # empty where the name says it

    @property
    def kept(self):
        return self.found <= self.bound if self.relation == "at most" else self.found >= self.bound

    def __str__(self):
        unit = f" {self.unit}" if self.unit else ""
        promise = f"{self.relation} {shown(self.bound)}{unit} is promised"
        return f"{self.name} is {shown(self.found)}{unit}, {promise}"


def at_most(name, found, bound, unit=""):
    return Figure(name, float(found), "at most", bound, unit)


def at_least(name, found, bound, unit=""):
    return Figure(name, float(found), "at least", bound, unit)


@dataclass(frozen=True)
class Case:
    """A hard case: its row of ``cases.yaml``, and the function that measures a subject."""

    number: str
    measure: object
    theme: str
    title: str
    hard: str
    naive: str
    caught: tuple = ()  # naive variants that fail it
    mujoco: str = ""
    compared: bool = False  # also measured of MuJoCo

    @property
    def name(self):
        return f"case {self.number}, {self.title}"

    @property
    def variants(self):
        return [getattr(naive, name) for name in self.caught]

    def figures(self, subject):
        """Figures of a subject; variants overflow and divide by zero, which shows in their figures."""
        with np.errstate(all="ignore"):
            return list(self.measure(subject))


def hard_case(measure):
    """Register a function of a subject, test_<number>_..., as a case, and make it a test of this package."""
    number = measure.__name__.split("_")[1].lstrip("0")
    assert number not in CASES, f"there is a case {number} already"
    case = CASES[number] = Case(number, measure, **ROWS[number])

    def test():
        figures = case.figures(Subject())
        assert figures, f"{case.name} measures nothing"
        missed = [f"{case.name}: {figure}" for figure in figures if not figure.kept]
        assert not missed, "\n".join(missed)

    test.__name__ = test.__qualname__ = measure.__name__
    test.__module__, test.__doc__ = measure.__module__, measure.__doc__
    return test


def all_cases():
    """Every case, in the order of the page."""
    for module in ("test_motions", "test_stops", "test_frictions_that_stick", "test_numbers"):
        importlib.import_module(f".{module}", __package__)
    return [CASES[number] for number in ROWS]


def shown(x):
    """A number with two digits, or all of a whole one."""
    if math.isnan(x):
        return "not a number"
    return f"{x:.0f}" if x == round(x) and abs(x) < 1e6 else f"{x:.2g}"
