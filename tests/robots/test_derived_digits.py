"""How many digits accelerations of arms from points alone have: L D L^T of the mass matrix, beside 60 digits.

The error is a few ulps times the condition number of the mass matrix with ones on its diagonal.
Short links and straight arms leave that condition as it is; a heavy tip on light links raises it as much as
it is heavier, and an elimination written by hand does without.
"""

import numpy as np
import pytest

import redundant_envs as rde

mpmath = pytest.importorskip("mpmath", reason="mpmath is in the extra 'verify'")

from test_digits import ACCELERATIONS, drawn, error_and_sensitivity  # noqa: E402

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
    rng = np.random.default_rng(5)
    errors = []
    for _ in range(5):
        chain, hand, values = hard_state(kind, "heavy tip", rng)
        errors.append(
            [error_and_sensitivity(a, ACCELERATIONS, values, a.functions)[0] for a in (chain, hand)]
        )
    of_chains, by_hand = np.transpose(errors)
    assert by_hand.max() < 1e-13
    assert 1e-12 < of_chains.max() < 1e-8
