"""Traced numbers: recorded and folded operations, and passes. ``tests/test_dialect.py`` has refusals."""

import inspect
import math

import numpy as np
import pytest
from compiled import on_columns, recorded, rows_of

from redundant_envs.compiler.tracing.graph import Graph, Operation, reached
from redundant_envs.compiler.tracing.number import Number
from redundant_envs.compiler.tracing.passes.simplify import join_products
from redundant_envs.compiler.tracing.passes.stages import Stages, Subroutine
from redundant_envs.language.algebra import minimum, where


def traced(function):
    """The result of a function for traced arguments."""
    return function(*rows_of(Graph(), len(inspect.signature(function).parameters)))


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
        assert "".join(n.name for n in reached([traced(function).value]) if n.name != "load") == recorded


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


# ---- passes: products joined with sums, the stages of a step -----------------------------------------


def test_a_value_is_shown_by_its_operation_alone():
    """With its operands the text doubles with each product, and a traceback that shows it never ends."""

    def deep(a, b):
        for _ in range(200):
            a = a * a + b
        return a, a < b

    added, compared = deep(*rows_of(Graph(), 2))
    assert repr([added, compared, added.value]) == "[<Number +>, <Condition <>, <+>]"


def test_what_is_joined_in_one_part_does_not_depend_on_another():
    graph = Graph()
    a, b, c = (Number(graph, graph.load("row", k)) for k in range(3))
    alone = [(a * b + c).value]
    graph.part += 1
    both = [*alone, (a * b - c).value]
    join_products(both)
    assert [n.name for n in both] == ["fma", "fma"]


def random_results(rng, count):
    """Results of a random expression: sums, products, quotients, choices, some used often."""

    def function(a, b, c):
        values = [a, b, c]
        for _ in range(count):
            x, y = (values[k] for k in rng.integers(max(0, len(values) - 40), len(values), 2))
            kind = rng.integers(5)
            values.append((x + y, x - y, x * y, x / (1.0 + y * y), where(x < y, x, -y))[kind])
        return tuple(values[-8:])

    return recorded(function)


@pytest.mark.parametrize("seed", range(8))
def test_results_are_joined_as_if_those_aside_were_not_there(seed):
    numbers = {}  # equal expressions have the same

    def told(results):
        known = {}
        for n in reached(results):
            text = (n.name, n.extra, *(known[a] if isinstance(a, Operation) else a for a in n.arguments))
            known[n] = f"%{numbers.setdefault(text, len(numbers))}"
        return [known[r] for r in results]

    beside, alone = (random_results(np.random.default_rng(seed), 60) for _ in range(2))
    asides = (0, 3, 5)
    alone = [r for k, r in enumerate(alone) if k not in asides]
    join_products(alone)
    join_products(beside, asides)
    assert any(n.name == "fma" for n in reached(alone))
    assert told([r for k, r in enumerate(beside) if k not in asides]) == told(alone)


def staged(rate, positions, results, steps):
    """A step of some stages: every argument of the rate follows from the stage before."""
    count = len(inspect.signature(rate).parameters)
    subroutine = Subroutine(rate, positions, results)

    def step(x, v, k):
        totals = [0.0] * results
        for n in range(steps):
            slopes = subroutine(*(x, v, k, float(n), 2.0)[:count])
            totals = [t + s for t, s in zip(totals, slopes, strict=True)]
            x, v = x + 0.1 * v, v + 0.1 * slopes[0]
        return (x, v, *totals)

    return step


RATES = {
    "one result": (lambda x, v, k: (-(k * x) - v * v,), 1, 1),
    "more than registers return": (
        lambda x, v, k: tuple(v * float(n) - k * x * x + 1.0 / (v + 9.0) for n in range(7)), 1, 7,
    ),
    "an argument of each, and a number": (lambda x, v, k, n, two: (n * x - two * v, two + k), 1, 2),
    "choices": (lambda x, v, k: (where(x * x > k, -v * x, minimum(v, x) / (3.0 + x * x)),), 1, 1),
}  # fmt: skip


@pytest.mark.parametrize("name", RATES)
@pytest.mark.parametrize("steps", [1, 5])
def test_calls_of_a_subroutine_are_its_text_on_plain_numbers(name, steps):
    step = staged(*RATES[name], steps)
    columns = np.random.default_rng(1).uniform(0.2, 1.0, (3, 19))
    plain = np.array([step(*row) for row in columns.T.tolist()]).T
    np.testing.assert_allclose(on_columns(step, *columns), plain, rtol=1e-14, atol=1e-14)


def test_what_the_caller_finds_for_all_stages_is_kept_wherever_it_stands():
    rate = Subroutine(lambda x, v, *kept: (-x * kept[9] - v / kept[11],), 1, 1)

    def step(x, v, k):
        for _ in range(2):
            (a,) = rate(x, v, *(k + float(n) for n in range(12)))
            x, v = x + v, v + a
        return x, v

    calls = [n for n in reached(recorded(step)) if n.name == "stage"]
    assert set(Stages(calls, ("row",), {}).in_memory.values()) == {11, 13}
    columns = np.random.default_rng(1).uniform(0.2, 1.0, (3, 8))
    plain = np.array([step(*row) for row in columns.T.tolist()]).T
    np.testing.assert_allclose(on_columns(step, *columns), plain, rtol=1e-13)
