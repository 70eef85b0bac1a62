"""Numbers with a derivative give derivatives of results; numbers that know whether they move, all kinks."""

import itertools

import numpy as np
import pytest

from redundant_envs.algebra import clamp, exp, floor, log, logical_not, maximum, minimum, sincos, sqrt, where
from redundant_envs.compiler.backends.torch import torch
from redundant_envs.compiler.tracing.graph import Graph
from redundant_envs.compiler.tracing.number import Number
from redundant_envs.language.algebra import ABSENT
from redundant_envs.language.dual import Dual, dual
from redundant_envs.language.moving import Moving, kinks_in, moving

KINKED = {  # of x that moves and p that does not: the function, and where it has kinks for p = 2
    "size": (lambda x, p: abs(x - p), {2.0}),
    "smaller": (lambda x, p: minimum(x, p), {2.0}),
    "clipped": (lambda x, p: clamp(x, -p, p), {-2.0, 2.0}),
    "chosen": (lambda x, p: where(x > 0.5, x * x, 1.0 / p), {0.5}),
    "chosen of two": (lambda x, p: where((x > -p) & logical_not(x >= p), x, 0.0), {-2.0, 2.0}),
    "a choice of conditions": (lambda x, p: where(where(p > 0.0, x > 1.0, x > -1.0), x, 0.0), {-1.0, 1.0}),
    "different": (lambda x, p: where(x != p, x, 0.0), {2.0}),
    "beneath smooth functions": (lambda x, p: sqrt(1.0 + exp(-abs(x)) ** 2) / (p + sincos(x)[0]), {0.0}),
    "of a part": (lambda x, p: (x, p * maximum(1.0 - x, 0.0)), {1.0}),
}
SMOOTH = {
    "numbers alone": lambda x, p: x * maximum(abs(p), floor(p)) + where(p > 1.0, x, -x),
    "quotients and powers": lambda x, p: p - x * x / (1.0 + x**4) - p / (9.0 + x) + x**3,
    "functions": lambda x, p: exp(-x) * (1.0 - x) * sincos(3.0 * x)[1] + log(4.0 + x),
    "a constant": lambda x, p: 1.0,
    "absent": lambda x, p: (x + ABSENT) * maximum(p, ABSENT),
}
KINDS = pytest.mark.parametrize("kind", [float, np.array, torch.tensor], ids=["float", "array", "tensor"])
JUMPING = {
    "equal": lambda x, p: where(x == 0.7, p * x, where(x != 0.7, x, 0.0)),
    "whole": lambda x, p: x * floor(3.0 * x),
    "a constant that is chosen": lambda x, p: where(x > 0.0, 1.0, 2.0),
}
DIFFERENTIATED = {name: function for name, (function, _) in KINKED.items()} | SMOOTH | JUMPING


def last(result):
    return result[-1] if isinstance(result, tuple) else result


@pytest.mark.parametrize("function", DIFFERENTIATED.values(), ids=DIFFERENTIATED)
@KINDS
def test_derivatives_are_those_of_differences(function, kind):
    for place in (-1.3, -0.3, 0.7, 1.6):
        x = kind(place) if kind is not torch.tensor else torch.tensor(place, dtype=torch.float64)
        found, step = dual(last(function(Dual(x, 1.0), 2.0))), 1e-6
        assert float(found.value) == pytest.approx(float(last(function(place, 2.0))), rel=1e-12)
        ends = [last(function(place + side * step, 2.0)) for side in (-1.0, 1.0)]
        slope = (ends[1] - ends[0]) / (2.0 * step)
        if function is JUMPING["equal"]:  # it jumps at one of the places
            slope = 2.0 if place == 0.7 else 1.0
        assert float(found.slope) == pytest.approx(float(slope), rel=1e-6, abs=1e-8)
    graph = Graph()
    traced = dual(last(function(Dual(Number(graph, graph.load("argument", 0)), 1.0), 2.0)))
    assert isinstance(traced.slope, Number | float)


def values(function, x, p, kind=float):
    return [k.value for k in kinks_in(function(Moving(kind(x), True), Moving(kind(p))))]


@pytest.mark.parametrize(("function", "places"), KINKED.values(), ids=KINKED)
@KINDS
def test_one_of_its_values_changes_its_sign_at_each_kink_and_at_none_else(function, places, kind):
    grid = np.arange(-3.05, 3.0, 0.1)
    signs = np.array([[float(v) > 0.0 for v in values(function, x, 2.0, kind)] for x in grid])
    changes = (signs[1:] != signs[:-1]).any(axis=1)
    near = [any(a < x < b for x in places) for a, b in itertools.pairwise(grid)]
    np.testing.assert_array_equal(changes, near)
    for x in (-2.5, -0.3, 0.0, 1.5, 2.0):  # results are those of plain numbers
        assert moving(last(function(Moving(x, True), Moving(2.0)))).value == last(function(x, 2.0))


@pytest.mark.parametrize("function", SMOOTH.values(), ids=SMOOTH)
def test_what_is_smooth_in_what_moves_has_no_kink(function):
    assert values(function, 0.3, 2.0) == []


def test_a_kink_of_a_branch_that_is_not_taken_is_none():
    """A force that pushes only beyond a position, and never pulls; floor has one at each whole number."""

    def push(x, p):
        return where(p > 0.0, maximum(1.0 + x, 0.0), 0.0)

    assert values(push, -1.5, 1.0) == [-0.5]
    assert values(push, -1.5, -1.0) == [1.0]
    (kink,) = kinks_in(floor(Moving(1.9, True)) * abs(Moving(-2.0)))
    assert (kink.value, kink.levels) == (1.9, True)
