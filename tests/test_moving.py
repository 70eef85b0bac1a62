"""Numbers that know whether they move find every kink of the results computed with them, and no other."""

import itertools

import numpy as np
import pytest

from redundant_envs.algebra import (
    ABSENT,
    clamp,
    exp,
    floor,
    logical_not,
    maximum,
    minimum,
    sincos,
    sqrt,
    where,
)
from redundant_envs.backends.torch import torch
from redundant_envs.moving import Moving, kinks_in, moving

KINKED = {  # of x that moves and p that does not: the function, and where it has kinks for p = 2
    "size": (lambda x, p: abs(x - p), {2.0}),
    "square with a sign": (lambda x, p: -p * x * abs(x), {0.0}),
    "smaller": (lambda x, p: minimum(x, p), {2.0}),
    "larger": (lambda x, p: maximum(p, x), {2.0}),
    "clipped": (lambda x, p: clamp(x, -p, p), {-2.0, 2.0}),
    "clipped below itself": (lambda x, p: minimum(x, 0.5 * x), {0.0}),
    "chosen": (lambda x, p: where(x > 0.5, x, 1.0 / p), {0.5}),
    "chosen of two": (lambda x, p: where((x > -p) & logical_not(x >= p), x, 0.0), {-2.0, 2.0}),
    "chosen by one of two": (lambda x, p: where((x < -p) | (x <= 1.0) ^ (x == 1.5), x, p), {-2.0, 1.0, 1.5}),
    "a choice of conditions": (lambda x, p: where(where(p > 0.0, x > 1.0, x > -1.0), x, 0.0), {-1.0, 1.0}),
    "different": (lambda x, p: where(x != p, x, 0.0), {2.0}),
    "beneath smooth functions": (lambda x, p: sqrt(1.0 + exp(-abs(x)) ** 2) / (p + sincos(x)[0]), {0.0}),
    "of a part": (lambda x, p: (x, p * maximum(1.0 - x, 0.0)), {1.0}),
}
SMOOTH = {
    "numbers alone": lambda x, p: x * maximum(abs(p), floor(p)) + where(p > 1.0, x, -x),
    "smooth": lambda x, p: (
        p - x * x / (1.0 + x**4) + exp(-x) * (1.0 - x) * sincos(3.0 * x)[1] - p / (9.0 + x)
    ),
    "a constant": lambda x, p: 1.0,
    "absent": lambda x, p: (x + ABSENT) * maximum(p, ABSENT),
}


def values(function, x, p, kind=float):
    return [k.value for k in kinks_in(function(Moving(kind(x), True), Moving(kind(p))))]


@pytest.mark.parametrize(("function", "places"), KINKED.values(), ids=KINKED)
@pytest.mark.parametrize("kind", [float, np.array, torch.tensor], ids=["float", "array", "tensor"])
def test_one_of_its_values_changes_its_sign_at_each_kink_and_at_none_else(function, places, kind):
    grid = np.arange(-3.05, 3.0, 0.1)
    signs = np.array([[float(v) > 0.0 for v in values(function, x, 2.0, kind)] for x in grid])
    changes = (signs[1:] != signs[:-1]).any(axis=1)
    near = [any(a < x < b for x in places) for a, b in itertools.pairwise(grid)]
    np.testing.assert_array_equal(changes, near)


@pytest.mark.parametrize("function", SMOOTH.values(), ids=SMOOTH)
def test_what_is_smooth_in_what_moves_has_no_kink(function):
    assert values(function, 0.3, 2.0) == []


def test_results_are_those_of_plain_numbers():
    for function, _ in KINKED.values():
        for x in (-2.5, -0.3, 0.0, 1.5, 2.0):
            results, plain = function(Moving(x, True), Moving(2.0)), function(x, 2.0)
            pairs = [(results, plain)] if not isinstance(plain, tuple) else zip(results, plain, strict=True)
            assert all(moving(a).value == b for a, b in pairs)


def test_a_kink_of_a_branch_that_is_not_taken_is_none():
    """A force that pushes only beyond a position, and never pulls; floor has one at each whole number."""

    def push(x, p):
        return where(p > 0.0, maximum(1.0 + x, 0.0), 0.0)

    assert values(push, -1.5, 1.0) == [-0.5]
    assert values(push, -1.5, -1.0) == [1.0]
    (kink,) = kinks_in(floor(Moving(1.9, True)) * abs(Moving(-2.0)))
    assert (kink.value, kink.levels) == (1.9, True)


def test_what_is_chosen_by_what_moves_moves():
    x = Moving(0.3, True)
    assert where(x > 0.0, Moving(1.0), Moving(2.0)).moves
    assert (2.0 / x - 1.0).moves
    assert not (2.0 / Moving(1.0) - 1.0).moves
