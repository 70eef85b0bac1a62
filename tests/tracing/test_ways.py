"""Functions with branches: the same on floats, by the interpreter and compiled; ways that are refused."""

import itertools
from collections import namedtuple

import numpy as np
import pytest
from compiled import flat, on_columns, recorded, rows_of
from hypothesis import given
from hypothesis import strategies as st
from refusals import ANYTHING

from redundant_envs.compiler.tracing.graph import Graph, reached
from redundant_envs.compiler.tracing.number import Number
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


def columns_of(count, lanes=200, seed=0):
    """Random numbers, many of them equal to others, or zeros of either sign."""
    rng = np.random.default_rng(seed)
    return rng.choice([-2.0, -1.0, -0.0, 0.0, 0.5, 1.0, 2.0, np.inf], (count, lanes))


# ---- the same on all kinds of numbers ------------------------------------------------------------------


Pair = namedtuple("Pair", "low high")


@branches
def in_order(a, b):
    return Pair(a, b) if a <= b else Pair(b, a)


@branches
def within(a, b, c):
    """A condition and numbers, by ``and``, ``or`` and ``not``."""
    inside = a <= b and b <= c
    outside = not (a < b) or b > c
    if inside and outside:
        return True, (b, 1)
    return b == c, (a * c if outside else -b, 2)


@branches
def first_below(a, b, c):
    """A loop that is left early."""
    for k, x in enumerate((a, b, c)):
        if x < 0.0:
            return float(k)
    return 3.0


@branches
def spread(a, b, c):
    """Functions with branches within one."""
    low, high = in_order(a, b)
    if c < low:
        return high - c
    return in_order(high, c).high - low if in_order(b, c).low > 0.0 else 0.0


FUNCTIONS = (in_order, within, first_below, spread)


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda f: f.__name__)
def test_a_function_with_branches_is_the_same_on_floats_by_the_interpreter_and_compiled(function):
    columns = columns_of(function.__wrapped__.__code__.co_argcount)
    expected = one_by_one(function, *columns)
    np.testing.assert_array_equal(interpreted(function, *columns), expected)
    np.testing.assert_array_equal(on_columns(function, *columns), expected)


LEAVES = st.sampled_from(["a", "b", "c", "-a", 0.0, -0.0, 1.0])
TREES = st.recursive(
    LEAVES,
    lambda inner: st.tuples(st.sampled_from("abc"), st.sampled_from(["<", "==", "not <"]),
                            st.sampled_from(["a", "b", "c", 0.0]), inner, inner),
    max_leaves=12,
)  # fmt: skip
"""Trees of decisions: a comparison and two trees, or a result."""


COMPARISONS = {"<": lambda x, y: x < y, "==": lambda x, y: x == y, "not <": lambda x, y: not x < y}


def decided(tree, names):
    """The result of a tree of decisions, with ``if``."""
    if not isinstance(tree, tuple):
        return names.get(tree, tree)
    left, comparison, right, yes, no = tree
    return decided(yes if COMPARISONS[comparison](names[left], names.get(right, right)) else no, names)


@pytest.mark.long
@ANYTHING
@given(TREES, TREES)
def test_any_tree_of_decisions_is_the_same_on_floats_and_by_the_interpreter(one, other):
    @branches
    def function(a, b, c):
        names = {"a": a, "b": b, "c": c, "-a": -a}
        return decided(one, names), decided(other, names)

    columns = np.array(list(itertools.product([-1.0, -0.0, 0.0], repeat=3))).T
    expected, got = one_by_one(function, *columns), interpreted(function, *columns)
    np.testing.assert_array_equal(got, expected)
    np.testing.assert_array_equal(np.signbit(got), np.signbit(expected))


# ---- merging -------------------------------------------------------------------------------------------


def total_with(size):
    """The sum of the sizes of some numbers."""

    @branches
    def total(*numbers):
        return sum((size(x) for x in numbers[1:]), size(numbers[0]))

    return total


def size(x):
    return x if x > 0.0 else -x


def test_256_ways_are_the_most_but_ways_that_are_merged_where_a_function_returns_do_not_count():
    for total, count in ((total_with(size), 8), (total_with(branches(size)), 12)):
        columns = columns_of(count)
        np.testing.assert_array_equal(interpreted(total, *columns), one_by_one(total, *columns))
    with pytest.raises(ValueError, match=r"total has more than 256 ways; let a function marked with @bran"):
        total_with(size)(*rows_of(Graph(), 9))


def test_a_condition_and_its_opposite_are_one_decision():
    runs = []

    @branches
    def function(a, b):
        runs.append(1)
        if a < b and a < b:
            return a
        return b if not a < b else 9.0

    nodes = reached(recorded(function, 2))
    assert len(runs) == 2
    assert [n.name for n in nodes if n.name != "load"] == ["<", "select"]


def test_ways_with_one_result_need_no_selection():
    a, b, c = rows_of(Graph(), 3)
    assert branches(lambda a, b: a if a < b else a)(a, b).value is a.value  # noqa: RUF034
    once = branches(lambda a, b, c: 1.0 if a < b else 1.0 if c < b else b)
    names = [n.name for n in reached([once(a, b, c).value])]
    assert names.count("select") == 2  # one at each fork whose sides differ


def test_equal_calls_are_traced_once():
    runs = []

    @branches
    def function(x, kind, pair):
        runs.append(1)
        return x * kind if x < pair[0] else pair[1]

    graph = Graph()
    a, b = rows_of(graph, 2)
    first = function(a, 2.0, (a, b))
    assert function(Number(graph, graph.load("row", 0)), 2.0, (a, b)).value is first.value
    assert len(runs) == 2
    for others in ((a, 2.0, (b, b)), (a, 0.0, (a, b)), (a, -0.0, (a, b)), (a, 2.0, [a, b])):
        function(*others)
    function(*rows_of(Graph(), 1), 2.0, (1.0, 0.0))
    assert len(runs) == 12


# ---- results of different forms --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "pair",
    [(1.0, (1.0, 2.0)), ((1.0, 2.0), (1.0, 2.0, 3.0)), (None, 1.0), ((1.0,), [1.0]), ("a", "b"),
     (Pair(1.0, 2.0), (1.0, 2.0)), ((1.0, None), (1.0, 2.0))],
    ids=str,
)  # fmt: skip
def test_results_of_different_forms_are_refused(pair):
    words = r"returns .* in one way and .* in another; return numbers, or tuples of numbers, of"
    with pytest.raises(TypeError, match=words):
        branches(lambda x: pair[0] if x < 0.0 else pair[1])(*rows_of(Graph(), 1))


def test_what_is_the_same_in_every_way_may_be_anything_and_a_truth_is_a_number_too():
    kept = object()
    found = branches(lambda x: (kept, None, x) if x < 0.0 else (kept, None, 0.0))(*rows_of(Graph(), 1))
    assert found[:2] == (kept, None)
    mixed = branches(lambda x: True if x < 0.0 else 1.5)
    assert interpreted(mixed, np.array([-1.0, 1.0])).tolist() == [[1.0, 1.5]]
