"""Traced numbers: recorded and folded operations, and refusals with helpful words.

``tests/test_dialect.py`` has more of what is refused, with the same words.
"""

import inspect
import math

import numpy as np
import pytest
from compiled import rows_of

import redundant_envs.compiler.backends.numpy  # noqa: F401  its numbers are known from here on
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


@pytest.mark.parametrize(
    ("refused", "words"),
    [
        (lambda a, b: a if a > b else b, r"where\(condition, a, b\), cases\(.*instead of if, and, or"),
        (lambda a, b: math.sqrt(a), "sqrt, exp.* of redundant_envs.algebra, not those of math"),
        (lambda a, b: np.sin(a), "NumPy's sin does not know it; use the functions of redundant_envs.algebra"),
        (lambda a, b: [1.0, 2.0][a], "no single number"),
        (lambda a, b: a < None, "not supported"),
        (lambda a, b: {a: b}, "unhashable"),
        # Python would compare the objects, and say that they differ.
        (lambda a, b: (a > 0.0) == (b > 0.0), r"compared by \^"),
    ],
)
def test_what_is_no_operation_of_all_lanes_is_refused_with_what_to_write(refused, words):
    with pytest.raises(TypeError, match=words):
        traced(refused)
