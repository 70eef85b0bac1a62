"""Traced numbers: recorded and folded operations. ``tests/test_dialect.py`` has what is refused."""

import inspect
import math

import pytest
from compiled import rows_of

from redundant_envs.compiler.tracing.graph import Graph, reached
from redundant_envs.language.algebra import where


def traced(function):
    """The result of a function for traced arguments."""
    return function(*rows_of(Graph(), len(inspect.signature(function).parameters)))


def names(result):
    """Operations that a result needs, without loads."""
    return [n.name for n in reached([result.value]) if n.name != "load"]


@pytest.mark.parametrize(
    ("recorded", "functions"),
    [
        ("", (lambda x: x * 1.0, lambda x: 1.0 * x, lambda x: x + -0.0, lambda x: x / 1.0)),
        ("+", (lambda x: x + 0.0, lambda x: 0.0 + x)),
        ("*", (lambda x: x * -1.0, lambda x: x * 0.0, lambda x: x**2)),
        ("-", (lambda x: 0.0 - x, lambda x: x - -0.0, lambda x: x - x)),
        ("**", (lambda x: x**3, lambda x: x**4)),
        ("/", (lambda x: 1.0 / x,)),
    ],
)
def test_only_what_may_change_a_bit_is_recorded_and_powers_are_products(recorded, functions):
    for function in functions:
        assert "".join(names(traced(function))) == recorded


@pytest.mark.parametrize(
    ("pair", "one"),
    [
        (lambda a, b: (a + b, a + b), True),
        (lambda a, b: (where(a < b, a, b), where(a < b, a, b)), True),
        (lambda a, b: (a - 1, a - 1.0), True),
        (lambda a, b: (a / math.nan, a / float("nan")), True),
        (lambda a, b: (a / 0.0, a / -0.0), False),
    ],
)
def test_equal_operations_are_one_and_zeros_of_different_signs_are_two_constants(pair, one):
    first, second = traced(pair)
    assert (first.value is second.value) is one
