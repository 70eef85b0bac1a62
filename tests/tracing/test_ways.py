"""Functions with branches: the same on floats, by the interpreter and compiled; ways that are refused."""

import numpy as np
import pytest
from compiled import flat, on_columns, recorded, rows_of

from redundant_envs.compiler.tracing.graph import Graph
from redundant_envs.compiler.tracing.ways import branches
from redundant_envs.simulator.lane.direct import evaluate


def interpreted(function, *columns):
    """Results of a traced function by the interpreter, a row for each number."""
    results = recorded(function, len(columns), Graph(whole=True))
    with np.errstate(invalid="ignore"):  # both sides of a selection are computed
        found = evaluate(results, lambda place: columns[place[1]])
    return np.array([np.broadcast_to(x, columns[0].shape) for x in found], dtype=float)


def one_by_one(function, *columns):
    """The same on the floats of one lane after the other."""
    with np.errstate(invalid="ignore"):
        return np.array([flat(function(*lane)) for lane in zip(*columns, strict=True)], dtype=float).T


def columns_of(count):
    """Random numbers, many of them equal to others, or zeros of either sign."""
    rng = np.random.default_rng(0)
    return rng.choice([-2.0, -1.0, -0.0, 0.0, 0.5, 1.0, 2.0, np.inf], (count, 200))


@branches
def in_order(a, b):
    return (a, b) if a <= b else (b, a)


@branches
def within(a, b, c):
    """A condition and numbers, by ``and``, ``or`` and ``not``."""
    inside = a <= b and b <= c
    outside = not (a < b) or b > c
    if inside and outside:
        return True, (b, 1)
    return b == c, (a * c if outside else -b, 2)


@branches
def spread(a, b, c):
    """Functions with branches within one."""
    low, high = in_order(a, b)
    if c < low:
        return high - c
    return in_order(high, c)[1] - low if in_order(b, c)[0] > 0.0 else 0.0


@pytest.mark.parametrize("function", [within, spread], ids=lambda f: f.__name__)
def test_a_function_with_branches_is_the_same_on_floats_by_the_interpreter_and_compiled(function):
    columns = columns_of(3)
    expected = one_by_one(function, *columns)
    np.testing.assert_array_equal(interpreted(function, *columns), expected)
    np.testing.assert_array_equal(on_columns(function, *columns), expected)


def total_of_sizes(size):
    return branches(lambda *numbers: sum((size(x) for x in numbers[1:]), size(numbers[0])))


def size(x):
    return x if x > 0.0 else -x


def test_256_ways_are_the_most_but_ways_that_are_merged_where_a_function_returns_do_not_count():
    for total, count in ((total_of_sizes(size), 8), (total_of_sizes(branches(size)), 12)):
        columns = columns_of(count)
        np.testing.assert_array_equal(interpreted(total, *columns), one_by_one(total, *columns))
    with pytest.raises(ValueError, match=r"has more than 256 ways; let a function marked with @bran"):
        total_of_sizes(size)(*rows_of(Graph(), 9))


@pytest.mark.parametrize("pair", [(1.0, (1.0, 2.0)), (None, 1.0), ((1.0,), [1.0])], ids=str)
def test_results_of_different_forms_are_refused(pair):
    words = r"returns .* in one way and .* in another; return numbers, or tuples of numbers, of"
    with pytest.raises(TypeError, match=words):
        branches(lambda x: pair[0] if x < 0.0 else pair[1])(*rows_of(Graph(), 1))
