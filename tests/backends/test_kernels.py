"""Kernels: loops, branches, variables, masks and calls, compiled and run."""

import numpy as np
import pytest
from compiled import compiled

from redundant_envs.batch.blocks import LANES
from redundant_envs.tracing.flow import Kernel, LaneFunction
from redundant_envs.tracing.graph import Graph

OUT = {"out": "i64"}


def numbers(record, out=8, kind=np.int64, **arguments):
    """The array ``out`` after a call of a kernel with arrays and whole numbers."""
    kinds = {"f": {4: "f32", 8: "f64"}, "i": {8: "i64", 1: "i8"}, "u": {4: "u32"}}
    types = {
        name: kinds[x.dtype.kind][x.dtype.itemsize] if isinstance(x, np.ndarray) else "int"
        for name, x in arguments.items()
    }
    p = Kernel("probe", {**types, "out": kinds[np.dtype(kind).kind][np.dtype(kind).itemsize]})
    record(p)
    result = np.zeros(out, kind)
    compiled(p)(out=result, **arguments)
    return result.tolist()


# ---- loops -----------------------------------------------------------------------------------------


def test_each_counts_from_its_start_to_its_end():
    def record(p):
        with p.each(p["n"]) as i:
            p.store(p["out"], i, i * i)
        with p.each(p["n"] + 3, start=p["n"] + 1) as i:
            p.store(p["out"], i, -1 * i)

    assert numbers(record, n=4) == [0, 1, 4, 9, 0, -5, -6, 0]


@pytest.mark.parametrize("n", [0, -3])
def test_each_of_nothing_does_nothing(n):
    def record(p):
        with p.each(p["n"]) as i:
            p.store(p["out"], i, 1)

    assert numbers(record, n=n) == [0] * 8


def test_loops_in_loops_and_branches_in_them():
    """Pairs (i, j) of j <= i < 4 whose sum is odd."""

    def record(p):
        count = p.variable(0)
        with p.each(4) as i, p.each(i + 1) as j, p.when(((i + j) & 1) == 1):
            p.store(p["out"], count.value, i * 10 + j)
            count.value = count.value + 1

    assert numbers(record) == [10, 21, 30, 32, 0, 0, 0, 0]


@pytest.mark.parametrize("mask", [0, 1, 0b1010_0110, 255, 1 << 40 | 8])
def test_each_set_is_each_bit_of_a_mask_in_order(mask):
    def record(p):
        count = p.variable(0)
        with p.each_set(p["mask"]) as bit:
            p.store(p["out"], count.value, bit)
            count.value = count.value + 1

    bits = [k for k in range(64) if mask >> k & 1]
    assert numbers(record, mask=mask) == bits + [0] * (8 - len(bits))


def test_a_mask_may_change_while_its_bits_are_gone_through():
    def record(p):
        mask, count = p.variable(0b1011), p.variable(0)
        with p.each_set(mask.value):
            mask.value = 0
            count.value = count.value + 1
        p.store(p["out"], 0, count.value)

    assert numbers(record, out=1) == [3]


@pytest.mark.parametrize("start", [1, 6, 27])
def test_a_loop_goes_on_while_its_condition_holds_anew_each_time(start):
    def record(p):
        n, steps = p.variable(p["start"]), p.variable(0)
        with p.loop_while(lambda: n.value != 1):
            odd = (n.value & 1) == 1
            n.value = p.select(odd, n.value * 3 + 1, n.value >> 1)
            steps.value = steps.value + 1
        p.store(p["out"], 0, steps.value)

    assert numbers(record, out=1, start=start) == [{1: 0, 6: 8, 27: 111}[start]]


def test_what_is_made_in_a_loop_takes_no_more_of_the_stack_each_time():
    def record(p):
        total = p.variable(0)
        with p.each(p["n"]) as i:
            once, room = p.variable(i), p.space(64, "i64")
            p.store(room, 3, once.value & 1)
            total.value = total.value + p.load(room, 3)
        p.store(p["out"], 0, total.value)

    assert numbers(record, out=1, n=10_000_000) == [5_000_000]


# ---- branches --------------------------------------------------------------------------------------


def test_a_branch_is_taken_where_its_condition_holds():
    def record(p):
        for k, other in enumerate((3, 4, 5)):
            with p.when(p["n"] < other):
                p.store(p["out"], k, 1)
                with p.when(p["n"] == 4):
                    p.store(p["out"], k, 2)

    assert numbers(record, out=3, n=4) == [0, 0, 2]
    assert numbers(record, out=3, n=2) == [1, 1, 1]


def test_a_kernel_is_left_at_once():
    def record(p):
        with p.each(8) as i:
            p.store(p["out"], i, 1)
            with p.when(i == p["last"]):
                p.leave()
            p.store(p["out"], i, 2)
        p.store(p["out"], 0, 3)

    assert numbers(record, last=2) == [2, 2, 1, 0, 0, 0, 0, 0]
    assert numbers(record, last=9) == [3, 2, 2, 2, 2, 2, 2, 2]


def test_a_branch_of_python_is_refused_with_what_to_write():
    p = Kernel("probe", {"n": "int"})
    with pytest.raises(TypeError, match=r"write with p\.when\(condition\)"):
        assert p["n"] > 3


# ---- scalars ---------------------------------------------------------------------------------------


def test_whole_numbers():
    def record(p):
        n, m = p["n"], p["m"]
        results = [n + m, n - m, 5 - n, 5 + n, n * m, 3 * n, n & 6, n | 1, n ^ 3, n << 2, n >> 1, ~n]
        for k, x in enumerate(results):
            p.store(p["out"], k, x)

    expected = [10, 2, -1, 11, 24, 18, 6, 7, 5, 24, 3, -7]
    assert numbers(record, out=12, n=6, m=4) == expected


def test_comparisons_of_whole_numbers_know_signs():
    def record(p):
        n, m = p["n"], p["m"]
        for k, c in enumerate((n < m, n <= m, n > m, n >= m, n == m, n != m, (n < m) & (m < 1), ~(n < m))):
            p.store(p["out"], k, p.whole(c))

    assert numbers(record, n=-5, m=3) == [1, 1, 0, 0, 0, 1, 0, 0]
    assert numbers(record, n=2**40, m=2**40) == [0, 1, 0, 1, 1, 0, 0, 1]


@pytest.mark.parametrize(("a", "b"), [(1.5, 2.5), (2.0, 2.0), (np.nan, 1.0), (-0.0, 0.0), (np.inf, 1e308)])
def test_floats_are_compared_as_python_compares_them(a, b):
    def record(p):
        x, y = (p.load(p["x"], k) for k in range(2))
        for k, c in enumerate((x < y, x <= y, x > y, x >= y, x == y, x != y, x == 2.0)):
            p.store(p["out"], k, p.whole(c))

    expected = [a < b, a <= b, a > b, a >= b, a == b, a != b, a == 2.0]
    assert numbers(record, out=7, x=np.array([a, b])) == expected


def test_floats_and_whole_numbers_become_each_other():
    def record(p):
        x = p.load(p["x"], 0)
        half = p.variable(0.5, kind="float")
        half.value = half.value * 3.0
        results = [
            x + half.value, 1.0 - x, p.number(p["n"]) * 0.5, p.number(p.whole(x)),
            p.select(x > 2.0, 7.0, 8.0, kind="float"), p.number(p["n"] - 9),
        ]  # fmt: skip
        for k, value in enumerate(results):
            p.store(p["out"], k, value)

    assert numbers(record, 6, np.float64, x=np.array([2.75]), n=3) == [4.25, -1.75, 1.5, 2.0, 7.0, -6.0]


def test_a_truth_as_a_number_is_one_or_zero():
    def record(p):
        for k, truth in enumerate((p["n"] > 2, p["n"] > 3)):
            p.store(p["out"], k, p.number(truth))

    assert numbers(record, 2, np.float64, n=3) == [1.0, 0.0]


@pytest.mark.parametrize(
    ("kind", "given", "taken"),
    [
        (np.float64, [1e300, np.pi], [1e300, np.pi]),
        (np.float32, [0.1, 1e30], [float(np.float32(0.1)), float(np.float32(1e30))]),
        (np.int64, [-(2**62), 7], [-(2**62), 7]),
        (np.uint32, [2**32 - 1, 7], [2**32 - 1, 7]),
        (np.int8, [3, 127], [3, 127]),
    ],
)
def test_elements_of_every_type_are_loaded_and_stored(kind, given, taken):
    real = np.dtype(kind).kind == "f"
    wide = np.float64 if real else np.int64

    def record(p):
        p.store(p["out"], 0, p.load(p["x"], 1))
        p.store(p["out"], 1, p.load(p["x"] + 1, -1))

    assert numbers(record, 2, wide, x=np.array(given, kind)) == taken[::-1]
    assert numbers(record, 2, kind, x=np.array(given, wide)) == taken[::-1]


def test_arrays_of_ones_own_begin_at_a_cache_line_and_one_of_two_is_chosen():
    def record(p):
        first, second = p.space(3), p.space(5)
        for k, space in enumerate((first, second)):
            with p.each(3) as i:
                p.store(space, i, p.number(i) + 10.0 * k)
        chosen = p.choose(p["n"] == 0, first + 1, second)
        with p.each(2) as i:
            p.store(p["out"], i, p.load(chosen, i))

    assert numbers(record, 2, np.float64, n=0) == [1.0, 2.0]
    assert numbers(record, 2, np.float64, n=1) == [10.0, 11.0]


# ---- blocks of lanes -------------------------------------------------------------------------------


def test_a_mask_has_the_lanes_whose_number_is_not_zero():
    rows = np.zeros((3, LANES))
    rows[0] = 1.0
    rows[1] = [0.0, -0.0, 1.0, -1.0, np.nan, 1e-320, np.inf, 0.0]

    def record(p):
        for row in range(3):
            p.store(p["out"], row, p.mask(p["rows"], row))

    assert numbers(record, 3, rows=rows.reshape(-1)) == [255, 0b0111_1100, 0]


def test_a_function_is_called_on_the_places_it_is_told_whatever_their_order():
    graph = Graph()
    a, b = graph.load("left", 1), graph.load("right", 0)
    function = LaneFunction("difference", ("left", "right"), [("left", 2, graph.combine("-", a, b))])

    def record(p):
        with p.each(2) as block:
            p.call(function, right=p["right"], left=p["left"] + block * (3 * LANES))
        with p.each(2) as i:
            p.store(p["out"], i, p.load(p["left"], i * (3 * LANES) + (2 * LANES + 5)))

    left, right = np.arange(6.0 * LANES), np.full(LANES, 100.0)
    assert numbers(record, 2, np.float64, left=left, right=right) == [13.0 - 100.0, 37.0 - 100.0]
    np.testing.assert_array_equal(left[40:48], np.arange(32.0, 40.0) - 100.0)
    np.testing.assert_array_equal(left[:16], np.arange(16.0))
