"""Kernels: loops, branches, variables, masks and calls, compiled and run."""

import numpy as np
import pytest
from compiled import compiled

from redundant_envs.compiler.tracing.flow import LANES, Kernel, LaneFunction
from redundant_envs.compiler.tracing.graph import Graph

ELEMENTS = {"float64": "f64", "float32": "f32", "int64": "i64", "uint32": "u32", "int8": "i8"}


def numbers(record, out=8, kind=np.int64, **arguments):
    """The array ``out`` after a call of a kernel with arrays and whole numbers.

    ``record`` may return values that are stored one after the other.
    """
    result = np.zeros(out, kind)
    types = {n: ELEMENTS[x.dtype.name] if isinstance(x, np.ndarray) else "int" for n, x in arguments.items()}
    p = Kernel("probe", {**types, "out": ELEMENTS[result.dtype.name]})
    for k, value in enumerate(record(p) or ()):
        p.store(p["out"], k, value)
    compiled(p)(out=result, **arguments)
    return result.tolist()


def loops(p):
    """Loops from a start, in loops, while a condition holds; a loop that is left at once."""
    total, n, steps = p.variable(0), p.variable(p["n"]), p.variable(0)
    with p.each(4) as i, p.each(i + 1, start=p["start"]) as j, p.when(((i + j) & 1) == 1):
        total.value = total.value * 100 + (i * 10 + j)
    with p.loop_while(lambda: n.value > 1):
        n.value = p.select((n.value & 1) == 1, n.value * 3 + 1, n.value >> 1)
        steps.value = steps.value + 1
    p.store(p["out"], 0, total.value)
    p.store(p["out"], 1, steps.value)
    with p.each(8, start=2) as i:
        p.store(p["out"], i, 1)
        with p.when(i == p["last"]):
            p.leave()
        p.store(p["out"], i, 2)
    p.store(p["out"], 0, -1)


def bits_in_order(p):
    """Of a mask, which may change meanwhile."""
    mask, count = p.variable(p["mask"]), p.variable(0)
    with p.each_set(mask.value) as bit:
        p.store(p["out"], count.value, bit)
        mask.value, count.value = 0, count.value + 1


def stack_that_does_not_grow(p):
    total = p.variable(0)
    with p.each(p["n"]) as i:
        once, room = p.variable(i), p.space(64, "i64")
        p.store(room, 3, once.value & 1)
        total.value = total.value + p.load(room, 3)
    return [total.value]


@pytest.mark.parametrize(
    ("record", "arguments", "expected"),
    [
        (loops, {"n": 1, "start": 0, "last": 3}, [10213032, 0, 2, 1]),
        (loops, {"n": 27, "start": 1, "last": 9}, [-1, 111] + [2] * 6),
        (loops, {"n": 6, "start": 9, "last": 2}, [0, 8, 1]),
        *((bits_in_order, {"mask": mask}, [k for k in range(64) if mask >> k & 1])
          for mask in (0, 1, 0b1010_0110, 255, 1 << 40 | 8)),
        (stack_that_does_not_grow, {"n": 10_000_000}, [5_000_000]),
        (stack_that_does_not_grow, {"n": -3}, []),
    ],
)  # fmt: skip
def test_loops_and_branches(record, arguments, expected):
    assert numbers(record, **arguments) == expected + [0] * (8 - len(expected))


def test_a_branch_of_python_is_refused_with_what_to_write():
    p = Kernel("probe", {"n": "int"})
    with pytest.raises(TypeError, match=r"write with p\.when\(condition\)"):
        assert p["n"] > 3


# ---- scalars ---------------------------------------------------------------------------------------


def test_whole_numbers():
    def record(p):
        n, m = p["n"], p["m"]
        return [n + m, n - m, 5 - n, 5 + n, n * m, 3 * n, n & 6, n | 1, n ^ 3, n << 2, n >> 1, ~n]

    assert numbers(record, 12, n=6, m=4) == [10, 2, -1, 11, 24, 18, 6, 7, 5, 24, 3, -7]


def compared(x, y):
    return [x < y, x <= y, x > y, x >= y, x == y, x != y]


@pytest.mark.parametrize(
    ("a", "b"),
    [(-5, 3), (3, -5), (2**40, 2**40), (1.5, 2.5), (2.0, 2.0), (np.nan, 1.0), (-0.0, 0.0), (np.inf, 1e308)],
)
def test_numbers_are_compared_as_python_compares_them(a, b):
    def record(p):
        pair = [p.load(p["x"], k) for k in range(2)]
        less = pair[0] < pair[1]
        return map(p.whole, [*compared(*pair), less & (pair[1] < 1), ~less])

    assert numbers(record, x=np.array([a, b])) == [*compared(a, b), a < b < 1, not a < b]


def test_floats_and_whole_numbers_become_each_other_and_a_truth_is_one_or_zero():
    def record(p):
        x, n = p.load(p["x"], 0), p["n"]
        half = p.space(1)
        p.store(half, 0, 0.5)
        yield from (x + p.load(half) * 3.0, 1.0 - x, p.number(n) * 0.5, p.number(p.whole(x)), p.number(n - 9))
        yield from (p.select(x > 2.0, 7.0, 8.0, kind="float"), p.number(n > 2), p.number(n > 3))

    expected = [4.25, -1.75, 1.5, 2.0, -6.0, 7.0, 1.0, 0.0]
    assert numbers(record, 8, np.float64, x=np.array([2.75]), n=3) == expected


@pytest.mark.parametrize(
    ("kind", "given"),
    [(np.float64, [1e300, np.pi]), (np.float32, [0.1, 1e30]), (np.int64, [-(2**62), 7]),
     (np.uint32, [2**32 - 1, 7]), (np.int8, [3, 127])],
)  # fmt: skip
def test_elements_of_every_type_are_loaded_and_stored(kind, given):
    wide = np.float64 if np.dtype(kind).kind == "f" else np.int64
    taken = np.array(given, kind).astype(wide).tolist()

    def record(p):
        return [p.load(p["x"], 1), p.load(p["x"] + 1, -1)]

    assert numbers(record, 2, wide, x=np.array(given, kind)) == taken[::-1]
    assert numbers(record, 2, kind, x=np.array(given, wide)) == taken[::-1]


@pytest.mark.parametrize(("n", "expected"), [(0, [1.0, 2.0]), (1, [10.0, 11.0])])
def test_one_of_two_arrays_of_a_kernels_own_is_chosen(n, expected):
    def record(p):
        spaces = first, second = p.space(3), p.space(5)
        for k, space in enumerate(spaces):
            with p.each(3) as i:
                p.store(space, i, p.number(i) + 10.0 * k)
        chosen = p.select(p["n"] == 0, first + 1, second, kind=first.kind)
        return [p.load(chosen, 0), p.load(chosen, 1)]

    assert numbers(record, 2, np.float64, n=n) == expected


# ---- blocks of lanes -------------------------------------------------------------------------------


def test_a_mask_has_the_lanes_whose_number_is_not_zero():
    rows = np.zeros((3, LANES))
    rows[0] = 1.0
    rows[1] = [0.0, -0.0, 1.0, -1.0, np.nan, 1e-320, np.inf, 0.0]
    masks = numbers(lambda p: [p.mask(p["rows"], row) for row in range(3)], 3, rows=rows.reshape(-1))
    assert masks == [255, 0b0111_1100, 0]


def test_a_function_is_called_on_the_places_it_is_told_whatever_their_order():
    graph = Graph()
    a, b = graph.load("left", 1), graph.load("right", 0)
    function = LaneFunction("difference", ("left", "right"), [("left", 2, graph.combine("-", a, b))])

    def record(p):
        with p.each(2) as block:
            p.call(function, right=p["right"], left=p["left"] + block * (3 * LANES))
        return [p.load(p["left"], i * (3 * LANES) + (2 * LANES + 5)) for i in range(2)]

    left, right = np.arange(6.0 * LANES), np.full(LANES, 100.0)
    assert numbers(record, 2, np.float64, left=left, right=right) == [13.0 - 100.0, 37.0 - 100.0]
    np.testing.assert_array_equal(left[40:48], np.arange(32.0, 40.0) - 100.0)
    np.testing.assert_array_equal(left[:16], np.arange(16.0))
