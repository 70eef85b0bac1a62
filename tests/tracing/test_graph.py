"""Traced numbers: recorded and folded operations, and refusals with helpful words."""

import contextlib
import inspect
import math

import numpy as np
import pytest

import redundant_envs.backends.numpy  # noqa: F401  its numbers are known from here on
from redundant_envs import algebra
from redundant_envs.algebra import all_of, any_of, cases, logical_not, maximum, minimum, where
from redundant_envs.quantities import Quantities
from redundant_envs.tracing.graph import Graph, located, owned, reached
from redundant_envs.tracing.number import Condition, Number


def traced(function, graph=None):
    """The result of a function for traced arguments."""
    graph = graph or Graph()
    count = len(inspect.signature(function).parameters)
    return function(*(Number(graph, graph.load("row", k)) for k in range(count)))


def names(*results):
    """Operations that some results need, without loads."""
    return [n.name for n in reached([r.value for r in results]) if n.name != "load"]


# ---- recording -------------------------------------------------------------------------------------


def test_operations_are_recorded_as_they_are_written():
    result = traced(lambda a, b: 2.0 - (a + b) / b)
    difference = result.value
    assert (difference.name, difference.arguments[0]) == ("-", 2.0)
    quotient = difference.arguments[1]
    total, b = quotient.arguments
    assert (quotient.name, total.name, b.extra) == ("/", "+", ("row", 1))
    assert [n.extra for n in total.arguments] == [("row", 0), ("row", 1)]


@pytest.mark.parametrize(
    "same", [lambda x: x * 1.0, lambda x: 1.0 * x, lambda x: x + -0.0, lambda x: -0.0 + x, lambda x: x - 0.0,
             lambda x: x / 1.0, lambda x: x * 1],
)  # fmt: skip
def test_what_changes_no_bit_is_not_recorded(same):
    assert names(traced(same)) == []


@pytest.mark.parametrize(
    "other", [lambda x: x + 0.0, lambda x: 0.0 + x, lambda x: x * -1.0, lambda x: 0.0 - x, lambda x: x - -0.0,
              lambda x: 1.0 / x, lambda x: x * 0.0, lambda x: x - x],
)  # fmt: skip
def test_what_may_change_a_bit_is_recorded(other):
    assert len(names(traced(other))) == 1


def test_equal_operations_are_one():
    def function(a, b):
        return (a + b) * (a + b), where(a < b, a, b), where(a < b, a, b), a - 1, a - 1.0

    square, first, second, whole, real = traced(function)
    assert names(square) == ["+", "*"]
    assert first.value is second.value
    assert whole.value is real.value


def test_zeros_of_different_signs_are_two_constants_and_nans_one():
    first, second = traced(lambda x: (x / 0.0, x / -0.0))
    assert first.value is not second.value
    first, second = traced(lambda x: (x / math.nan, x / float("nan")))
    assert first.value is second.value


def test_operations_of_two_graphs_never_meet():
    first, second = traced(lambda x: x + 1.0), traced(lambda x: x + 1.0)
    assert first.value is not second.value


def test_products_of_different_parts_are_never_one_and_all_else_is():
    graph = Graph()
    a, b = (Number(graph, graph.load("row", k)) for k in range(2))
    before = a * b, a + b, a / b, a < b
    again = a * b
    graph.part += 1
    after = a * b, a + b, a / b, a < b
    assert again.value is before[0].value
    assert [x.value is y.value for x, y in zip(before, after, strict=True)] == [False, True, True, True]


def test_every_operation_is_reached_once_and_after_its_operands():
    def function(a, b):
        x = a
        for _ in range(50):
            x = (x + b) * x
        return x, -x, where(x > a, x, b)

    nodes = reached([r.value for r in traced(function)])
    place = {n: k for k, n in enumerate(nodes)}
    assert len(place) == len(nodes) == 2 + 2 * 50 + 3
    assert all(place[a] < place[n] for n in nodes for a in n.operands)


def test_a_long_chain_needs_no_deep_stack():
    def function(x):
        for _ in range(100_000):
            x = x / 3.0
        return x

    assert len(reached([traced(function).value])) == 100_001


@pytest.mark.parametrize("exponent", [2, 3, 4])
def test_powers_are_products(exponent):
    power = traced(lambda x: x**exponent)
    assert set(names(power)) == {"*"}
    assert len(names(power)) == (1 if exponent == 2 else 2)


# ---- conditions ------------------------------------------------------------------------------------


@pytest.mark.parametrize("known", [True, False])
def test_known_conditions_leave_nothing_behind(known):
    def function(a, b):
        less = a < b
        return [less & known, known & less, less | known, known | less]

    both, swapped, either, other = traced(function)
    kept, decided = ((both, swapped), (either, other)) if known else ((either, other), (both, swapped))
    assert all(isinstance(c, Condition) and names(c) == ["<"] for c in kept)
    assert all(c is known for c in decided)


def test_a_choice_by_a_known_condition_is_no_operation():
    a, b = traced(lambda a, b: (a, b))
    assert where(True, a, b) is a
    assert where(False, a, b) is b
    assert all_of([]) is True
    assert any_of([]) is False
    assert cases((False, a), default=b) is b


def test_choices_between_conditions_are_conditions():
    def function(a, b):
        return [where(a < b, a > 0.0, other) for other in (True, False, b > 0.0)]

    assert all(isinstance(chosen, Condition) for chosen in traced(function))


def test_the_first_case_that_holds_is_chosen():
    result = traced(lambda a, b: cases((a > 1.0, 10.0), (a > 0.0, b), default=-1.0)).value
    assert (result.name, result.arguments[1]) == ("select", 10.0)
    inner = result.arguments[2]
    assert (inner.name, inner.arguments[1].extra, inner.arguments[2]) == ("select", ("row", 1), -1.0)


# ---- what is refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("refused", "words"),
    [
        (lambda a, b: a if a > b else b, r"where\(condition, a, b\), cases\(\.\.\.\).*instead of if"),
        (lambda a, b: a > 0.0 and b > 0.0, r"& \| logical_not instead of if, and, or, not"),
        (lambda a, b: not a > b, "logical_not"),
        (lambda a, b: 0.0 < a < b, "instead of if, and, or, not"),
        (lambda a, b: a or b, r"instead of a branch write where\(condition, a, b\) or cases"),
        (lambda a, b: max(a, b), "instead of if"),
        (lambda a, b: math.sqrt(a), "sqrt, exp.* of redundant_envs.algebra, not those of math"),
        (lambda a, b: float(a), "not those of math"),
        (lambda a, b: int(a), "not those of math"),
        (lambda a, b: [1.0, 2.0][a], "no single number"),
        (lambda a, b: np.sin(a), "NumPy's sin does not know it; use the functions of redundant_envs.algebra"),
        (lambda a, b: np.ones(3) * a, "it meets an array of NumPy; write a"),
        (lambda a, b: np.maximum(a, b), "NumPy's maximum"),
        (lambda a, b: a**0.5, r"the exponent is 0\.5; write 2, 3 or 4, or a product, 1\.0 / x, sqrt"),
        (lambda a, b: a**b, "the exponent is no constant"),
        (lambda a, b: 2.0**a, r"write exp\(k \* x\) instead of"),
        (lambda a, b: a // 2.0, r"write floor\(a / b\)"),
        (lambda a, b: 2.0 % a, r"write a - b \* floor\(a / b\)"),
        (lambda a, b: a + "1", "unsupported operand"),
        (lambda a, b: a < None, "not supported"),
        (lambda a, b: {a: b}, "unhashable"),
    ],
)  # fmt: skip
def test_what_is_no_operation_of_all_lanes_is_refused_with_what_to_write(refused, words):
    with pytest.raises(TypeError, match=words):
        traced(refused)


@pytest.mark.parametrize(
    "confused",
    [
        lambda a, b: where(a, 1.0, 0.0),
        lambda a, b: where((a > 0.0) & b, 1.0, 0.0),
        lambda a, b: where((a > 0.0) | b, 1.0, 0.0),
        lambda a, b: where(a > 0.0, b > 0.0, 0.0),
        lambda a, b: a + (b > 0.0),
        lambda a, b: (a > 0.0) == (b > 0.0),
        lambda a, b: (a > 0.0) != (b > 0.0),
    ],
)
def test_numbers_are_no_conditions_and_conditions_no_numbers(confused):
    """Nor are two conditions compared: Python would compare the objects, and say that they differ."""
    with pytest.raises(TypeError):
        traced(confused)


def test_a_numpy_scalar_on_the_right_is_a_number():
    assert traced(lambda x: x * np.float64(2.5)).value.arguments[1] == 2.5


# ---- primitives on every kind of number ------------------------------------------------------------

ONE_OF_EACH = [(1.5, 2.5), (np.array([1.5, 3.0]), 2.5), (2.5, np.float64(1.5))]


@pytest.mark.parametrize(("a", "b"), ONE_OF_EACH, ids=["floats", "arrays", "scalars"])
def test_a_function_of_the_dialect_runs_on_plain_numbers_as_it_stands(a, b):
    def function(a, b):
        s, c = algebra.sincos(a)
        clipped = minimum(maximum(a, 0.0), b)
        return where(a < b, algebra.sqrt(a) + algebra.exp(-b), algebra.floor(a)) + s * c * clipped

    array, other = np.broadcast_arrays(np.asarray(a, float), np.asarray(b, float))
    low = np.sqrt(array) + np.exp(-other)
    expected = np.where(array < other, low, np.floor(array))
    expected = expected + np.sin(array) * np.cos(array) * np.clip(array, 0.0, other)
    np.testing.assert_allclose(function(a, b), expected, rtol=1e-15)
    assert set(names(traced(function))) >= {"select", "sqrt", "floor", "fma", "power"}


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


def test_conditions_of_every_kind_can_be_turned_around():
    assert logical_not(False) is True
    np.testing.assert_array_equal(logical_not(np.array([True, False])), [False, True])
    assert names(traced(lambda x: logical_not(x > 0.0))) == [">", "not"]


# ---- who asked for an operation --------------------------------------------------------------------


def weight(x):
    return algebra.maximum(x * 9.81, 0.0)


def places(function, context=located):
    with context():
        graph = Graph()
    with owned("gravity"):
        result = traced(function, graph)
    return [n.origin for n in reached([result.value]) if n.name != "load"]


def test_places_are_kept_where_they_are_asked_for_and_nowhere_else():
    assert places(weight, contextlib.nullcontext) == [None] * 3
    found = places(weight)
    assert {p.owner for p in found} == {"gravity"}
    assert {(p.function, p.file) for p in found} == {("weight", __file__)}
    assert {p.line for p in found} == {inspect.getsourcelines(weight)[1] + 1}


def test_a_sine_is_known_as_one_and_quantities_only_pass_on():
    found = places(lambda x: Quantities({"x": x}, (), {"x": ("s", "c")})["s"])
    assert {p.function for p in found} == {"sincos"}
