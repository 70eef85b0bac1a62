"""Passes over a graph: products joined with sums, known numbers, the order, the stages of a step."""

import inspect
import operator
from fractions import Fraction

import numpy as np
import pytest
from compiled import on_columns, recorded

from redundant_envs.algebra import logical_not, minimum, sqrt, where
from redundant_envs.tracing.graph import FREE, Graph, Operation, reached
from redundant_envs.tracing.number import Number
from redundant_envs.tracing.passes.join import join_products
from redundant_envs.tracing.passes.order import in_order
from redundant_envs.tracing.passes.specialise import specialise
from redundant_envs.tracing.passes.stages import Stages, Subroutine

MEANINGS = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "neg": operator.neg,
    "abs": abs, "fma": lambda a, b, c: a * b + c, "<": operator.lt, ">": operator.gt, "==": operator.eq,
    "!=": operator.ne, "and": operator.and_, "or": operator.or_, "not": operator.not_, "xor": operator.xor,
    "select": lambda condition, a, b: a if condition else b,
}  # fmt: skip


def evaluated(results, rows, exactly=True):
    """What results are if the rows hold some numbers; without rounding, or operation by operation."""
    kind = Fraction if exactly else float
    values = {}

    def value(x):
        return values[x] if isinstance(x, Operation) else x if isinstance(x, bool) else kind(x)

    for n in reached(results):
        known = kind(rows[n.extra[1]]) if n.name == "load" else None
        values[n] = MEANINGS[n.name](*map(value, n.arguments)) if known is None else known
    return [value(r) for r in results]


def joined(function):
    results = recorded(function)
    join_products(results)
    return results


# ---- join ------------------------------------------------------------------------------------------


def test_a_product_used_once_is_joined_with_its_sum():
    (total,) = joined(lambda a, b, c: a * b + c)
    assert (total.name, [n.extra[1] for n in total.arguments]) == ("fma", [0, 1, 2])
    (total,) = joined(lambda a, b, c: c + a * b)
    assert (total.name, [n.extra[1] for n in total.arguments]) == ("fma", [0, 1, 2])
    (difference,) = joined(lambda a, b, c: c - a * b)
    assert (difference.name, difference.arguments[0].name) == ("fma", "neg")
    (difference,) = joined(lambda a, b, c: a * b - c)
    assert (difference.name, difference.arguments[2].name) == ("fma", "neg")
    (difference,) = joined(lambda a, b, c: c - a * 3.0)
    assert difference.arguments[1] == -3.0


def test_a_product_used_twice_is_rounded_once_for_all():
    def twice(a, b, c):
        p = a * b
        return p + c, p

    total, product = joined(twice)
    assert (total.name, product.name) == ("+", "*")
    assert total.arguments[0] is product
    (square,) = joined(lambda a, b: (a * b) + (a * b))
    assert square.name == "+"


def test_of_two_products_the_later_one_is_joined():
    for function in (lambda a, b: (a / b) * b + a * b, lambda a, b: a * b + (a / b) * b):
        (total,) = joined(function)
        assert (total.arguments[0].name, total.arguments[2].name) == ("/", "*")


def test_what_is_joined_in_one_part_does_not_depend_on_another():
    graph = Graph()
    a, b, c = (Number(graph, graph.load("row", k)) for k in range(3))
    alone = [(a * b + c).value]
    graph.part += 1
    both = [*alone, (a * b - c).value]
    join_products(both)
    assert [n.name for n in both] == ["fma", "fma"]


def random_results(rng, count=300, most_used=8):
    """Results of a random expression: sums, products, quotients, choices, some used often."""

    def function(a, b, c):
        values = [a, b, c]
        for _ in range(count):
            x, y = (values[k] for k in rng.integers(max(0, len(values) - 40), len(values), 2))
            kind = rng.integers(5)
            values.append((x + y, x - y, x * y, x / (1.0 + y * y), where(x < y, x, -y))[kind])
        return tuple(values[-most_used:])

    return recorded(function)


@pytest.mark.parametrize("seed", range(8))
def test_joining_changes_the_rounding_alone_and_joining_again_nothing(seed):
    results = random_results(np.random.default_rng(seed), 14)
    rows = (Fraction(7, 3), Fraction(-5, 4), Fraction(1, 2))
    before = evaluated(results, rows)
    join_products(results)
    assert evaluated(results, rows) == before
    assert any(n.name == "fma" for n in reached(results))
    nodes = [(n, n.name, list(n.arguments)) for n in reached(results)]
    join_products(results)
    assert [(n, n.name, list(n.arguments)) for n in reached(results)] == nodes


# ---- known numbers ---------------------------------------------------------------------------------


def test_a_known_row_drops_what_is_never_chosen_and_splits_nothing():
    def held(x, y, mode):
        p = x * y
        return where(abs(mode) > 0.0, p - x, y), p + 1.0

    left, total = specialise(joined(held), {("row", 2): 0.0})
    assert left.extra == ("row", 1)
    # Without the other choice the product is used once, but the bits must be those of the whole.
    assert (total.name, total.arguments[0].name) == ("+", "*")
    assert {n.name for n in reached([left, total])} == {"load", "*", "+"}


@pytest.mark.parametrize(
    ("choice", "chosen"),
    [
        (lambda x, m: where(m != 0.0, -x, x), "load"),
        (lambda x, m: where(m == 0.0, -x, x), "neg"),
        (lambda x, m: where(m >= 1.0, -x, x), "load"),
        (lambda x, m: where((x > 1.0) & (m > 0.0), -x, x), "load"),
        (lambda x, m: where((m > 0.0) & (x > 1.0), -x, x), "load"),
        (lambda x, m: where((x > 1.0) & (m <= 0.0), -x, x), "select"),
        (lambda x, m: where((x > 1.0) | (m <= 0.0), -x, x), "neg"),
        (lambda x, m: where((m < 0.0) | (x > 1.0), -x, x), "select"),
        (lambda x, m: where(logical_not(m < 0.0), -x, x), "neg"),
        (lambda x, m: where(where(m > 0.0, x > 1.0, x > 2.0), -x, x), "select"),
    ],
)
def test_what_a_known_number_decides_is_decided(choice, chosen):
    (result,) = specialise(recorded(choice), {("row", 1): 0.0})
    assert result.name == chosen
    assert all(n.extra != ("row", 1) for n in reached([result]) if n.name == "load")
    assert len({n.name for n in reached([result])} & {"and", "or", "not", "=="}) == 0


@pytest.mark.parametrize("seed", range(5))
def test_the_bits_are_those_of_the_whole_with_these_numbers(seed):
    rng = np.random.default_rng(seed)

    def function(a, b, m, n):
        values = [a, b, m, n, where(m > 0.0, a, b), where((n == 0.0) | (m != 1.0), a * b, a - b)]
        for _ in range(200):
            x, y = (values[k] for k in rng.integers(max(0, len(values) - 30), len(values), 2))
            known = (m, n)[rng.integers(2)]
            terms = x + y, x * y, x / (1.0 + y * y), where(abs(known) > 0.5, x, y), minimum(x - y, known)
            values.append(terms[rng.integers(5)])
        return tuple(values[-10:])

    results = joined(function)
    rows = [*rng.normal(0.0, 1.0, 2), 1.0, 0.0]
    special = specialise(results, {("row", 2): 1.0, ("row", 3): 0.0})
    assert len(reached(special)) < len(reached(results))
    for whole, part in zip(evaluated(results, rows, False), evaluated(special, rows, False), strict=True):
        np.testing.assert_array_equal(whole, part)


def test_where_nothing_is_known_nothing_is_made():
    results = joined(lambda a, b: (a * b + 1.0, where(a > b, a, b)))
    assert specialise(results, {}) is results
    assert all(x is y for x, y in zip(specialise(results, {("row", 7): 0.0}), results, strict=True))


# ---- order -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_order_is_complete_and_each_operation_follows_its_operands(seed):
    results = random_results(np.random.default_rng(seed))
    join_products(results)
    order = in_order(results)
    assert set(order) == {n for n in reached(results) if n.name not in FREE}
    assert len(order) == len(set(order))
    place = {n: k for k, n in enumerate(order)}
    for n in order:
        for a in reached(n.operands):
            assert a.name in FREE or place[a] < place[n]


def test_order_is_the_same_every_time():
    orders = [[n.name for n in in_order(random_results(np.random.default_rng(3)))] for _ in range(2)]
    assert orders[0] == orders[1]


def test_a_chain_does_not_keep_other_work_waiting():
    """Beside a chain of divisions there is time for all sums that do not need it."""

    def function(a, b):
        chain = a
        for _ in range(4):
            chain = b / chain
        sums = [a + b * float(k) for k in range(12)]
        total = sums[0]
        for s in sums[1:]:
            total = total + s
        return chain + total

    names = [n.name for n in in_order(recorded(function))]
    first, second, *_ = (k for k, name in enumerate(names) if name == "/")
    assert first == 0
    assert second > 15


# ---- stages ----------------------------------------------------------------------------------------


def calls_of(results):
    return [n for n in reached(results) if n.name == "stage"]


def staged(rate, positions, results, steps=5):
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


def test_positions_that_need_the_stage_before_are_refused():
    double = Subroutine(lambda x, v: (x + v,), positions=1, results=1)

    def step(x, v):
        for _ in range(2):
            (x,) = double(x, v)
        return x

    with pytest.raises(ValueError, match="follow from its results in the stage before"):
        Stages(calls_of(recorded(step)), ("row",), {})


def test_two_subroutines_in_one_function_are_refused():
    one, other = (Subroutine(lambda x: (x + 1.0,), 1, 1) for _ in range(2))
    with pytest.raises(ValueError, match="calls two subroutines; give it one"):
        Stages(calls_of(recorded(lambda x: (one(x)[0], other(x)[0]))), ("row",), {})


RATES = {
    "one result": (lambda x, v, k: (-(k * x) - v * v,), 1, 1),
    "more results than registers return": (
        lambda x, v, k: tuple(v * float(n) - k * x * x + 1.0 / (v + 9.0) for n in range(7)), 1, 7,
    ),
    "results that are the same, given, or known": (
        lambda x, v, k: (-k * x, v, -k * x, 3.0, k, x), 1, 6,
    ),
    "roots and quotients of what all stages share": (
        lambda x, v, k: (sqrt(k * k + 1.0) * x - v / sqrt(k + 2.0),), 1, 1,
    ),
    "an argument of each stage, and one that is a number": (
        lambda x, v, k, n, two: (n * x - two * v, sqrt(two) + k), 1, 2,
    ),
    "choices": (lambda x, v, k: (where(x * x > k, -v * x, minimum(v, x) / (3.0 + x * x)),), 1, 1),
    "everything is a position": (lambda x, v, k: (-k * x * x,), 3, 1),
}  # fmt: skip


@pytest.mark.parametrize("name", RATES)
@pytest.mark.parametrize("steps", [1, 2, 5])
def test_calls_of_a_subroutine_are_its_text_on_plain_numbers(name, steps):
    rate, positions, results = RATES[name]
    if name == "everything is a position":  # then none of them may follow from the stage before
        subroutine = Subroutine(rate, positions, results)

        def step(x, v, k):
            return sum(subroutine(x + float(n), v, k)[0] for n in range(steps))
    else:
        step = staged(rate, positions, results, steps)
    rng = np.random.default_rng(1)
    columns = rng.uniform(0.2, 1.0, (3, 19))
    compiled = on_columns(step, *columns)
    plain = [step(*row) for row in columns.T.tolist()]
    expected = np.array([p if isinstance(p, tuple) else (p,) for p in plain]).T
    np.testing.assert_allclose(compiled, expected, rtol=1e-14, atol=1e-14)


def test_what_the_caller_finds_for_all_stages_is_kept_wherever_it_stands():
    rate = Subroutine(lambda x, v, *kept: (-x * kept[9] - v / kept[11],), 1, 1)

    def step(x, v, k):
        for _ in range(2):
            (a,) = rate(x, v, *(k + float(n) for n in range(12)))
            x, v = x + v, v + a
        return x, v

    assert set(Stages(calls_of(recorded(step)), ("row",), {}).kept.values()) == {11, 13}
    columns = np.random.default_rng(1).uniform(0.2, 1.0, (3, 8))
    plain = np.array([step(*row) for row in columns.T.tolist()]).T
    np.testing.assert_allclose(on_columns(step, *columns), plain, rtol=1e-13)


def test_known_numbers_are_known_in_the_stages_too():
    def rate(x, v, k):
        return (where(k > 0.0, v / x, -v),)

    (_, v, _) = recorded(staged(rate, 1, 1))
    known = {("row", 2): 0.0}
    names = {
        known_or_not: {
            n.name for part in Stages(calls_of([v]), ("row",), numbers).parts.values()
            for n in reached([*part.returned, *(value for _, _, value in part.stores)])
        }
        for known_or_not, numbers in (("known", known), ("not", {}))
    }  # fmt: skip
    assert "/" in names["not"]
    assert not names["known"] & {"/", "select", ">"}


def test_a_right_hand_side_may_be_a_long_chain():
    def rate(x, v):
        for _ in range(3000):
            v = v / 1.5
        return (v - x,)

    subroutine = Subroutine(rate, 1, 1)

    def step(x, v):
        for _ in range(2):
            (a,) = subroutine(x, v)
            x, v = x + v, v + a
        return x, v

    stages = Stages(calls_of(recorded(step)), ("row",), {})
    assert len(reached(stages.results)) > 3000
