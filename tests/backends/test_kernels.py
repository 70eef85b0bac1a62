"""Kernels: loops, branches, variables, masks and calls, compiled and run."""

import numpy as np
import pytest
from compiled import compiled

from redundant_envs.compiler.tracing.flow import LANES, Kernel, LaneFunction
from redundant_envs.compiler.tracing.graph import Graph


def numbers(record, **arguments):
    """Eight whole numbers that a kernel leaves after a call with arrays and whole numbers.

    ``record`` may return values that are stored one after the other.
    """
    result = np.zeros(8, np.int64)
    types = {n: "f64" if isinstance(x, np.ndarray) else "int" for n, x in arguments.items()}
    p = Kernel("probe", {**types, "out": "i64"})
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
        (bits_in_order, {"mask": 0}, []),
        (bits_in_order, {"mask": 1 << 40 | 0b1010_0110}, [1, 2, 5, 7, 40]),
        (stack_that_does_not_grow, {"n": 10_000_000}, [5_000_000]),
    ],
)
def test_loops_and_branches(record, arguments, expected):
    assert numbers(record, **arguments) == expected + [0] * (8 - len(expected))


def test_a_branch_of_python_is_refused_with_what_to_write():
    p = Kernel("probe", {"n": "int"})
    with pytest.raises(TypeError, match=r"write with p\.when\(condition\)"):
        assert p["n"] > 3


def test_a_function_is_called_on_the_places_it_is_told_whatever_their_order():
    graph = Graph()
    a, b = graph.load("left", 1), graph.load("right", 0)
    function = LaneFunction("difference", ("left", "right"), [("left", 2, graph.combine("-", a, b))])

    def record(p):
        with p.each(2) as block:
            p.call(function, right=p["right"], left=p["left"] + block * (3 * LANES))

    left, right = np.arange(6.0 * LANES).reshape(2, 3, LANES), np.full(LANES, 100.0)
    expected = left.copy()
    expected[:, 2] = left[:, 1] - 100.0
    numbers(record, left=left, right=right)
    np.testing.assert_array_equal(left, expected)
