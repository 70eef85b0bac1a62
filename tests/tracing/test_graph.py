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
from redundant_envs.compiler.tracing.number import Condition
from redundant_envs.language import algebra
from redundant_envs.language.algebra import all_of, any_of, cases, where


def traced(function):
    """The result of a function for traced arguments."""
    return function(*rows_of(Graph(), len(inspect.signature(function).parameters)))


def names(*results):
    """Operations that some results need, without loads."""
    return [n.name for n in reached([r.value for r in results]) if n.name != "load"]


# ---- recording -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("function", "recorded"),
    [
        *((f, "") for f in (
            lambda x: x * 1.0, lambda x: 1.0 * x, lambda x: x + -0.0, lambda x: -0.0 + x, lambda x: x - 0.0,
            lambda x: x / 1.0, lambda x: x * 1,
        )),
        *((f, "+") for f in (lambda x: x + 0.0, lambda x: 0.0 + x)),
        *((f, "*") for f in (lambda x: x * -1.0, lambda x: x * 0.0, lambda x: x**2)),
        *((f, "-") for f in (lambda x: 0.0 - x, lambda x: x - -0.0, lambda x: x - x)),
        *((f, "**") for f in (lambda x: x**3, lambda x: x**4)),
        (lambda x: 1.0 / x, "/"),
    ],
)  # fmt: skip
def test_only_what_may_change_a_bit_is_recorded_and_powers_are_products(function, recorded):
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


def test_products_of_different_parts_are_never_one_and_all_else_is():
    """Sines, too, are one pair in all parts, though products are in them."""
    graph = Graph()
    a, b = rows_of(graph, 2)

    def results():
        return [x.value for x in (a * b, a + b, a / b, a < b, *algebra.sincos(a))]

    before, again = results(), results()
    graph.part += 1
    assert [x is y for x, y in zip(before, again, strict=True)] == [True] * 6
    assert [x is y for x, y in zip(before, results(), strict=True)] == [False] + [True] * 5


@pytest.mark.parametrize(
    ("compare", "recorded"),
    [
        (lambda side: side > 0.0, ">"),
        (lambda side: side < 0.0, "> not < and"),
        (lambda side: side != 0.0, "> < or"),
        (lambda side: side <= 1.0, ""),
        (lambda side: (side > 1.0) | (side > 0.0), ">"),
    ],
)
def test_a_comparison_of_chosen_constants_is_what_has_chosen_them(compare, recorded):
    def decided(x):
        return where(compare(cases((x > 0.25, 1.0), (x < -0.25, -1.0), default=0.0)), x, 7.0)

    found = traced(decided)
    assert sorted(n for n in names(found) if n != "select") == sorted(recorded.split())
    for x, side in ((0.5, 1.0), (-2.0, -1.0), (0.0, 0.0), (math.nan, 0.0)):
        np.testing.assert_equal(decided(x), x if compare(side) else 7.0)


@pytest.mark.parametrize("above", [lambda side: side > 0.0, lambda side: side != 0.0])
def test_a_choice_within_a_choice_does_not_ask_for_its_condition_again(above):
    def clamped(x):
        side = cases((x < -0.25, -1.0), (x > 0.25, 1.0), default=0.0)
        return where(side < 0.0, -0.25, where(above(side), 0.25, x))

    assert sorted(names(traced(clamped))) == ["<", ">", "select", "select"]
    for x, expected in ((0.5, 0.25), (-2.0, -0.25), (0.1, 0.1), (math.nan, math.nan)):
        np.testing.assert_equal(clamped(x), expected)


def test_every_operation_is_reached_once_and_after_its_operands():
    def function(a, b):
        x = a
        for _ in range(5000):  # without a deep stack
            x = (x + b) * x
        return x, -x, where(x > a, x, b)

    nodes = reached([r.value for r in traced(function)])
    place = {n: k for k, n in enumerate(nodes)}
    assert len(place) == len(nodes) == 2 + 2 * 5000 + 3
    assert all(place[a] < place[n] for n in nodes for a in n.operands)


# ---- conditions ------------------------------------------------------------------------------------


@pytest.mark.parametrize("known", [True, False])
def test_known_conditions_leave_nothing_behind(known):
    a, b = rows_of(Graph(), 2)
    less = a < b
    kept, decided = (less & known, known & less), (less | known, known | less)
    for c in kept if known else decided:
        assert isinstance(c, Condition)
        assert names(c) == ["<"]
    assert all(c is known for c in (decided if known else kept))
    assert where(known, a, b) is (a if known else b)
    assert cases((known, a), default=b) is (a if known else b)
    assert all_of([]) is True
    assert any_of([]) is False


def test_choices_between_conditions_are_conditions():
    a, b = rows_of(Graph(), 2)
    for other in (True, False, b > 0.0):
        assert isinstance(where(a < b, a > 0.0, other), Condition)


# ---- what is refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("refused", "words"),
    [
        (lambda a, b: a if a > b else b, r"where\(condition, a, b\), cases\(.*instead of if, and, or"),
        (lambda a, b: a or b, r"instead of a branch write where\(condition, a, b\) or cases"),
        (lambda a, b: math.sqrt(a), "sqrt, exp.* of redundant_envs.algebra, not those of math"),
        (lambda a, b: int(a), "not those of math"),
        (lambda a, b: [1.0, 2.0][a], "no single number"),
        (lambda a, b: np.sin(a), "NumPy's sin does not know it; use the functions of redundant_envs.algebra"),
        (lambda a, b: a + "1", "unsupported operand"),
        (lambda a, b: a < None, "not supported"),
        (lambda a, b: {a: b}, "unhashable"),
        # Numbers are no conditions, and conditions are no numbers; nor are two conditions compared: Python
        # would compare the objects, and say that they differ.
        (lambda a, b: where(a, 1.0, 0.0), "where chooses by a condition"),
        (lambda a, b: where((a > 0.0) & b, 1.0, 0.0), "unsupported operand"),
        (lambda a, b: where((a > 0.0) | b, 1.0, 0.0), "unsupported operand"),
        (lambda a, b: where(a > 0.0, b > 0.0, 0.0), "float"),
        (lambda a, b: a + (b > 0.0), "unsupported operand"),
        (lambda a, b: (a > 0.0) == (b > 0.0), r"compared by \^"),
        (lambda a, b: (a > 0.0) != (b > 0.0), r"compared by \^"),
    ],
)
def test_what_is_no_operation_of_all_lanes_is_refused_with_what_to_write(refused, words):
    with pytest.raises(TypeError, match=words):
        traced(refused)


# ---- numbers of other kinds ------------------------------------------------------------------------


def test_numbers_that_are_registered_later_are_known_from_then_on_with_all_derived_from_them():
    class Base(float):
        pass

    class Derived(Base):
        pass

    assert algebra.sqrt(Derived(4.0)) == 2.0
    algebra.register_numbers(algebra.FLOATS._replace(sqrt=lambda x: "their own"), Base)
    assert algebra.sqrt(Base(4.0)) == "their own"
    assert algebra.sqrt(Derived(4.0)) == "their own"
    assert algebra.sqrt(4.0) == 2.0
