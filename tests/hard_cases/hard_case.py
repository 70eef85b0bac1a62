"""Hard cases: descriptions (``cases.yaml``), promises, and the mistakes that each case finds.

A case is a function of the implementation under test that returns figures. As a test it measures this
package, and every figure must keep its bound; measured on a naive variant, a figure must miss its bound.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import naive
import numpy as np
import yaml
from subject import Subject

THEMES = {
    "test_masses_and_poses": "Masses, lengths and singular poses",
    "test_chaos_and_long_runs": "Chaos, speed and long runs",
    "test_stops_and_impacts": "Stops and impacts",
    "test_rest_and_springs": "Rest, release and springs",
    "test_numbers_and_parameters": "Numbers, actions and parameters",
    "test_batches_and_copies": "Steps, batches and copies",
}
"""Modules with cases, in the order of the page, and their headings."""


@dataclass(frozen=True)
class Figure:
    """One number that a case measures, and the promise about it.

    Parameters
    ----------
    name : str
        The measured quantity, to be read before "is 3e-5".
    found : float
        NaN keeps no promise.
    at_most, at_least : float, optional
        One of them is the bound.
    unit : str
        Empty where the name says it.
    """

    name: str
    found: float
    at_most: float | None = None
    at_least: float | None = None
    unit: str = ""

    def __post_init__(self) -> None:
        assert (self.at_most is None) != (self.at_least is None), "a figure has one bound"
        object.__setattr__(self, "found", float(self.found))

    @property
    def bound(self) -> float:
        return self.at_least if self.at_most is None else self.at_most

    @property
    def kept(self) -> bool:
        return self.found >= self.bound if self.at_most is None else self.found <= self.bound

    @property
    def relation(self) -> str:
        return "at least" if self.at_most is None else "at most"

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        promise = f"{self.relation} {shown(self.bound)}{unit} is promised"
        return f"{self.name} is {shown(self.found)}{unit}, {promise}"


Measure = Callable[[Subject], Iterable[Figure]]
ROWS = yaml.safe_load(Path(__file__).with_name("cases.yaml").read_text(encoding="utf-8"))
NAIVE = {variant.__name__: variant for variant in naive.VARIANTS}


class Case:
    """A hard case: its row of ``cases.yaml``, and the function that measures a subject."""

    def __init__(
        self, number: str, row: dict[str, Any], measure: Callable[[Subject], Iterable[Figure]]
    ) -> None:
        self.number, self.measure = number, measure
        self.title, self.hard, self.naive = row["title"], row["hard"], row["naive"]
        self.caught: tuple[type[Subject], ...] = tuple(NAIVE[name] for name in row.get("caught", ()))
        self.mujoco, self.waiting_for = row.get("mujoco", ""), row.get("waiting_for", "")
        self.compared = row.get("compared", False)
        self.module, self.function = measure.__module__.rpartition(".")[2], measure.__name__

    @property
    def name(self) -> str:
        return f"case {self.number}, {self.title}"

    def figures(self, subject: Subject) -> list[Figure]:
        """Figures of a subject; variants overflow and divide by zero, which shows in their figures."""
        with np.errstate(all="ignore"):
            return list(self.measure(subject))


CASES: dict[str, Case] = {}
"""All cases by their numbers, once their modules are imported."""


def check(case: Case, figures: Iterable[Figure]) -> None:
    """AssertionError that names the case, the missed promise, and by how much it is missed."""
    missed = [f"{case.name}: {figure}" for figure in figures if not figure.kept]
    assert not missed, "\n".join(missed)


def hard_case(number: str) -> Callable[[Measure], Callable[[], None]]:
    """Register a function of a subject as a case, and make it a test of this package."""

    def register(measure: Measure) -> Callable[[], None]:
        assert number not in CASES, f"there is a case {number} already"
        case = CASES[number] = Case(number, ROWS[number], measure)

        def test() -> None:
            figures = case.figures(Subject())
            assert figures, f"{case.name} measures nothing"
            check(case, figures)

        test.__name__ = test.__qualname__ = measure.__name__
        test.__module__, test.__doc__ = measure.__module__, measure.__doc__
        return test

    return register


def all_cases() -> list[Case]:
    """Every case of every module, module by module."""
    for theme in THEMES:
        importlib.import_module(theme)
    return [case for theme in THEMES for case in CASES.values() if case.module == theme]


def shown(x: float) -> str:
    """A number with two digits, or all of a whole one."""
    if math.isnan(x):
        return "not a number"
    return f"{x:.0f}" if x == round(x) and abs(x) < 1e6 else f"{x:.2g}"
