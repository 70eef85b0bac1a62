"""No digits are lost to heavy tips and sliders: errors beside the effect of half an ulp of the inputs.

Hard cases 1 to 9 have straight and folded poses, vanishing masses and links, and sliders at their axes.
"""

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.quantities import Quantities

mpmath = pytest.importorskip("mpmath", reason="mpmath is in the extra 'verify'")

from exact_numbers import exactly  # noqa: E402

ACCELERATIONS = ("qdd1", "qdd2", "qdd3", "qdd4")


def error_and_sensitivity(arm, wanted, values, functions):
    """Error of some quantities, and the sum of the effects of half an ulp of each input, relative to their
    largest."""

    def found(values):
        return Quantities(values, functions, arm.sincos).each(wanted)

    got = found(values)
    with mpmath.workdps(60):
        inputs = exactly(values)
        exact = found(inputs)
        scale = max(abs(x) for x in exact)
        moved = [mpmath.mpf(0)] * len(wanted)
        for name, value in inputs.items():
            if value and not name.startswith("held"):
                other = found({**inputs, name: value + mpmath.mpf(np.spacing(abs(values[name]))) / 2})
                moved = [m + abs(a - b) for m, a, b in zip(moved, other, exact, strict=True)]
        error = max(abs(mpmath.mpf(float(a)) - b) for a, b in zip(got, exact, strict=True))
        return float(error / scale), float(max(moved) / scale)


def drawn(kind, masses, rng, forces):
    """An arm, and the numbers of a state of it."""
    if kind == "FourR":
        arm = rde.FourR(masses, 10.0 ** rng.uniform(-1, 1, 4))
        q = rng.uniform(-np.pi, np.pi, 4)
    else:
        arm = rde.RPRP(masses, 10.0 ** rng.uniform(-1, 1, 2))
        q = rng.uniform(-np.pi, np.pi, 4) * (1, 0, 1, 0) + rng.uniform(-0.3, 0.5, 4) * (0, 1, 0, 1)
    names = (*arm.coordinates, *arm.rates, *(f"Q{k + 1}" for k in range(4)))
    given = *q, *rng.normal(0.0, 3.0, 4), *(forces * rng.normal(0.0, 5.0, 4))
    known = {**arm.parameter_values(), "ax": 0.0, "ay": 9.81}
    return arm, known | dict(zip(names, map(float, given), strict=True))


@pytest.mark.parametrize("forces", [0.0, 1.0], ids=["no forces", "forces"])
@pytest.mark.parametrize("kind", ["FourR", "RPRP"])
@pytest.mark.parametrize("shape", ["heavy tip", "any"])
def test_forward_dynamics_err_by_no_more_than_ten_times_their_inputs(shape, kind, forces):
    rng = np.random.default_rng(7)
    for _ in range(25):
        light = 10.0 ** rng.uniform(-12, 0)
        masses = (light, light, light, 1.0) if shape == "heavy tip" else 10.0 ** rng.uniform(-6, 6, 4)
        arm, values = drawn(kind, masses, rng, forces)
        error, sensitivity = error_and_sensitivity(arm, ACCELERATIONS, values, arm.functions)
        assert error <= 10.0 * sensitivity + 1e-16


@pytest.mark.parametrize("held", [(0.0, 1.0), (1.0, 0.0), (1.0, 1.0)], ids=["r2", "r1", "both"])
def test_accelerations_with_held_sliders_keep_their_digits(held):
    rng = np.random.default_rng(13)
    for _ in range(15):
        arm, values = drawn("RPRP", 10.0 ** rng.uniform(-6, 6, 4), rng, 1.0)
        values |= {"held2": held[0], "held4": held[1]}
        values |= {rate: 0.0 for rate, still in zip(("v1", "v2"), held, strict=True) if still}
        functions = (*(f for f in arm.functions if f.__name__ != "forward_dynamics"), arm.held_dynamics)
        error, sensitivity = error_and_sensitivity(arm, ACCELERATIONS, values, functions)
        assert error <= 10.0 * sensitivity + 1e-16


def test_mobilities_and_energies_keep_their_digits():
    rng = np.random.default_rng(17)
    mobilities = tuple(f"W{i}{k}" for k in (2, 4) for i in range(1, 5))
    for _ in range(10):
        for kind in ("FourR", "RPRP"):
            arm, values = drawn(kind, 10.0 ** rng.uniform(-6, 6, 4), rng, 0.0)
            wanted = [("T",), ("U",), ("Lz",), ("manipulability",)]
            functions = arm.functions
            if kind == "RPRP":
                wanted.append(mobilities)
                functions = (*functions, arm.slider_mobility)
            for names in wanted:
                error, sensitivity = error_and_sensitivity(arm, names, values, functions)
                assert error <= 10.0 * sensitivity + 1e-16


# ---- arms from points alone: L D L^T of the mass matrix ------------------------------------------------

# The error is a few ulps times the condition number of the mass matrix with ones on its diagonal. Short links
# and straight arms leave that condition as it is; a heavy tip on light links raises it as much as it is
# heavier, and an elimination written by hand does without.

EPS = np.finfo(float).eps
KINDS = {"FourR": "RRRR", "RPRP": "RPRP"}


def condition(arm, values):
    """Of the mass matrix, its diagonal scaled to ones."""
    M = arm.mass_matrix([values[name] for name in arm.coordinates])
    scale = np.sqrt(np.diag(M))
    return np.linalg.cond(M / np.outer(scale, scale))


def hard_state(kind, place, rng):
    """A chain, the same arm with equations by hand, and a state of them."""
    masses = (1e-6, 1e-6, 1e-6, 1.0) if place == "heavy tip" else (2.0, 1.5, 1.0, 0.5)
    if place == "any masses":
        masses = 10.0 ** rng.uniform(-4, 4, 4)
    hand, values = drawn(kind, masses, rng, 1.0)
    if place == "short links":
        hand = type(hand)(masses, 10.0 ** rng.uniform(-9, 0, len(hand.lengths)))
        values |= hand.parameter_values()
    if place == "straight":
        angles = [name for name in hand.coordinates if name.startswith("theta")]
        values |= {name: 0.3 + 1e-9 * float(rng.normal()) for name in angles}
        if kind == "RPRP":  # the first link ends where it begins
            values["r1"] = 1e-9 - values["l1"]
    return rde.Chain(KINDS[kind], hand.masses, hand.lengths), hand, values


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("place", ["any", "short links", "straight", "heavy tip", "any masses"])
def test_accelerations_lose_no_more_digits_than_the_scaled_mass_matrix(kind, place):
    rng = np.random.default_rng(3)
    for _ in range(10):
        chain, hand, values = hard_state(kind, place, rng)
        error, _ = error_and_sensitivity(chain, ACCELERATIONS, values, chain.functions)
        assert error <= 20.0 * EPS * condition(hand, values)
        if place in ("any", "short links", "straight"):
            assert error <= 1e-13


@pytest.mark.parametrize("kind", KINDS)
def test_with_a_heavy_tip_equations_by_hand_keep_the_digits_that_a_chain_loses(kind):
    rng, worst = np.random.default_rng(5), np.zeros(2)
    for _ in range(5):
        *arms, values = hard_state(kind, "heavy tip", rng)
        errors = [error_and_sensitivity(a, ACCELERATIONS, values, a.functions)[0] for a in arms]
        worst = np.maximum(worst, errors)
    assert worst[1] < 1e-13
    assert 1e-12 < worst[0] < 1e-8
