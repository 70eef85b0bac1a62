"""Products and sums with one rounding, computed by our own function: equal to the last bit."""

import itertools
import platform
import warnings
from fractions import Fraction

import numpy as np
import pytest
from compiled import on_columns

from redundant_envs.compiler.backends import llvm, llvm_lanes
from redundant_envs.compiler.backends.llvm_fma import rounded_once
from redundant_envs.compiler.backends.processors import Processor

pytestmark = pytest.mark.skipif(
    platform.machine().lower() not in ("x86_64", "amd64"), reason="other processors have the instruction"
)
SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.1, 3.0, -3.0, np.inf, -np.inf, np.nan]
OUTSIDE = [*SPECIAL, 5e-324, -5e-324, 2.0**-1022, 1e-300, 1e308, -1.7e308]


def known(*columns):
    """x * y + c by the processor, or the library."""
    return on_columns(lambda x, y, c: x * y + c, *columns)[0]


def ours(*columns):
    """The same by code for a processor without the instruction."""
    with warnings.catch_warnings(), llvm.target(Processor("x86-64-v2", "")):
        warnings.simplefilter("ignore")
        return known(*columns)


def numbers(rng, low, high, count):
    """Of either sign, with exponents from ``low`` to ``high``."""
    return np.ldexp(rng.uniform(1.0, 2.0, count), rng.integers(low, high, count)) * rng.choice([-1, 1], count)


def inside(rng, count=1 << 15):
    """Cases in the range that the function serves."""

    def drawn(*ranges):
        return [numbers(rng, *each, count) for each in ranges]

    def short():
        """Numbers of few digits, whose sums are often halfway between two others."""
        digits = rng.integers(1, 2 ** rng.integers(1, 30, count)).astype(float)
        return np.ldexp(digits, rng.integers(-30, 30, count)) * rng.choice([-1, 1], count)

    a, b = drawn((-5, 5), (-5, 5))
    near_one = 1.0 + 2.0**-52 * rng.integers(0, 8, count)
    return {
        "moderate": drawn((-20, 20), (-20, 20), (-40, 40)),
        "cancelling": (a, b, -(a * b) * (1.0 + rng.integers(-4, 5, count) * 2.0**-52)),
        "short": (short(), short(), short()),
        "wide": drawn((-480, 480), (-480, 480), (-960, 960)),
        "small sums": drawn((-300, 300), (-300, 300), (-1074, -1000)),
        "large sums": drawn((-300, 480), (-300, 480), (900, 1000)),
        "long products": (numbers(rng, 0, 1, count), near_one, numbers(rng, -54, 2, count)),
        "special": np.array([*itertools.product(SPECIAL, repeat=3)]).T,
    }


def test_it_rounds_as_the_processor_does():
    rng, special = np.random.default_rng(42), np.array([*itertools.product(OUTSIDE, repeat=3)]).T
    huge = [numbers(rng, *each, 1 << 15) for each in ((990, 1023), (-1000, -900), (-5, 5))]
    tiny = [numbers(rng, *each, 1 << 15) for each in ((-600, -480), (-600, -400), (-1074, -900))]
    cases = inside(rng) | {"huge": huge, "tiny": tiny, "special": special}
    for what, columns in cases.items():
        found, expected = ours(*columns), known(*columns)
        number = ~np.isnan(expected)
        np.testing.assert_array_equal(np.isnan(found), ~number, what)
        np.testing.assert_array_equal(found[number].view(np.int64), expected[number].view(np.int64), what)


def test_in_its_range_it_rounds_exact_sums_without_the_check_that_leads_to_the_library(monkeypatch):
    """Without another function that might share its mistakes: Python rounds fractions correctly."""
    monkeypatch.setattr(llvm_lanes, "rounded_once", lambda *given, checked: rounded_once(*given, False))
    cases = inside(np.random.default_rng(44), 1 << 13)
    del cases["special"]
    for what, columns in cases.items():
        exact = [float(Fraction(a) * Fraction(b) + Fraction(c)) for a, b, c in zip(*columns, strict=True)]
        np.testing.assert_array_equal(ours(*columns), exact, what)
