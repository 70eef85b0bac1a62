"""Numbers with a derivative yield the derivatives of results computed with them."""

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.algebra import exp, floor, logical_not, maximum, minimum, physics, sincos, sqrt, where
from redundant_envs.backends.torch import torch
from redundant_envs.dual import Dual, dual
from redundant_envs.tracing.graph import Graph
from redundant_envs.tracing.number import Number

FUNCTIONS = {
    "sum": lambda x: 2.0 + x + 1.0,
    "difference": lambda x: 2.0 - x - 0.25 * (x - 1.0),
    "product": lambda x: 3.0 * x * x * (x + 1.0),
    "ratio": lambda x: (x + 2.0) / (1.0 + x * x) + 1.0 / x + x / 4.0,
    "powers": lambda x: x**2 - x**3 + 0.5 * x**4,
    "root": lambda x: sqrt(1.0 + x * x),
    "exponential": lambda x: exp(-0.5 * x),
    "sine": lambda x: sincos(2.0 * x)[0],
    "cosine": lambda x: sincos(2.0 * x)[1],
    "size": lambda x: abs(x - 1.0) + abs(-x),
    "largest": lambda x: maximum(minimum(x, 0.8), 0.2 * x * x),
    "chosen": lambda x: where((x > 0.5) & logical_not(x >= 2.0), x * x, -x),
    "chosen by one of two": lambda x: where((x < -0.5) | (x <= -3.0), 2.0 * x, 3.0),
    "equal": lambda x: where(x == 0.7, 2.0 * x, where(x != 0.7, x, 0.0)),
    "whole": lambda x: x * floor(3.0 * x),
    "constant": lambda x: where(x > 0.0, 1.0, 2.0),
}
PLACES = (-1.3, -0.3, 0.7, 1.6)


@pytest.mark.parametrize("function", FUNCTIONS.values(), ids=FUNCTIONS)
@pytest.mark.parametrize("kind", [float, np.array, torch.tensor], ids=["float", "array", "tensor"])
def test_derivatives_are_those_of_differences(function, kind):
    for place in PLACES:
        x = kind(place) if kind is not torch.tensor else torch.tensor(place, dtype=torch.float64)
        found, step = dual(function(Dual(x, 1.0))), 1e-6
        assert float(found.value) == pytest.approx(float(function(place)), rel=1e-12)
        if function is FUNCTIONS["equal"]:  # it jumps at one of the places
            slope = 2.0 if place == 0.7 else 1.0
        else:
            slope = (function(place + step) - function(place - step)) / (2.0 * step)
        assert float(found.slope) == pytest.approx(float(slope), rel=1e-6, abs=1e-8)
    graph = Graph()
    traced = dual(function(Dual(Number(graph, graph.load("argument", 0)), 1.0)))
    assert isinstance(traced.slope, Number | float)


def test_nothing_is_computed_for_what_has_no_derivative():
    made = sqrt(Dual(2.0) * 3.0 + 1.0) / Dual(4.0) - sincos(Dual(1.0))[0]
    assert made.slope == 0.0
    assert isinstance(made.slope, float)


@pytest.mark.parametrize("kind", [np.array, torch.tensor], ids=["array", "tensor"])
def test_a_condition_on_numbers_without_derivatives_chooses_between_derivatives(kind):
    condition, x = kind([True, False]), Dual(2.0, 3.0)
    chosen = where(condition, x * x, -x)
    assert chosen.value.tolist() == [4.0, -2.0]
    assert chosen.slope.tolist() == [12.0, -3.0]
    plain = where(condition & (x > 5.0), x, 0.0)
    assert plain.slope.tolist() == [0.0, 0.0]


def test_a_traced_condition_on_parameters_chooses_between_derivatives():
    graph = Graph()
    length = Number(graph, graph.load("argument", 0))
    made = where(length > 1.0, Dual(length, 1.0), 2.0)
    assert isinstance(made.slope, Number)


def test_an_arm_whose_points_depend_on_which_length_is_longer_is_compiled():
    @physics(gives="x1 y1")
    def points(l1, l2, s1, c1):
        radius = where(l1 > l2, l1, 2.0 * l2)
        return where(l1 > l2, radius * c1, l2 * c1), radius * s1

    class Choosing(rde.Arm):
        joint_types, num_lengths, functions = "R", 2, (points,)

    ends = []
    for arm in (Choosing((1.0,), (0.8, 0.5)), rde.Chain("R", (1.0,), (0.8,))):
        batch = rde.BatchSimulator(rde.Scene(arm, (rde.effects.Gravity(),), control_dt=0.01))
        batch.advance()
        ends.append(batch.q)
    assert abs(ends[0] - ends[1]).max() < 1e-15
