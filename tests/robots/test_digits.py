"""No digits are lost to heavy tips and sliders: errors beside the effect of half an ulp of the inputs.

Hard cases 1 to 9 have straight and folded poses, vanishing masses and links, and sliders at their axes.
"""

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.language.quantities import Quantities

mpmath = pytest.importorskip("mpmath", reason="mpmath is in the extra 'verify'")

from exact_numbers import exactly  # noqa: E402

KINDS = {"FourR": "RRRR", "RPRP": "RPRP"}
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


SINGLE = {name: (name,) for name in ("T", "U", "Lz", "manipulability")}
OF_ARMS = {"accelerations": ACCELERATIONS, **SINGLE}
R1, R2 = {"held2": 1.0, "held4": 0.0, "v1": 0.0}, {"held2": 0.0, "held4": 1.0, "v2": 0.0}
HELD = {"r1": R1, "r2": R2, "both": {**R1, **R2, "held2": 1.0}}
QUANTITIES = {
    **{f"{kind} {name}": (kind, wanted, (), {}) for kind in KINDS for name, wanted in OF_ARMS.items()},
    "RPRP mobilities": ("RPRP", [f"W{i}{k}" for k in (2, 4) for i in range(1, 5)], ("slider_mobility",), {}),
    **{f"RPRP {name} held": ("RPRP", ACCELERATIONS, ("held_dynamics",), held) for name, held in HELD.items()},
}
"""Kind of an arm, names, functions that it has beside its own, and what of a state is known."""


@pytest.mark.quick("FourR accelerations")
@pytest.mark.parametrize(("kind", "wanted", "more", "known"), QUANTITIES.values(), ids=QUANTITIES)
def test_quantities_err_by_no_more_than_ten_times_their_inputs(kind, wanted, more, known):
    """With forces and without, of heavy tips and of any masses."""
    rng = np.random.default_rng(7)
    for k in range(40 if wanted is ACCELERATIONS else 12):
        light = 10.0 ** rng.uniform(-12, 0)
        masses = (light, light, light, 1.0) if k % 4 < 2 else 10.0 ** rng.uniform(-6, 6, 4)
        arm, values = drawn(kind, masses, rng, k % 2)
        own = (f for f in arm.functions if not known or f.__name__ != "forward_dynamics")
        functions = (*own, *(getattr(arm, name) for name in more))
        error, sensitivity = error_and_sensitivity(arm, wanted, values | known, functions)
        assert error <= 10.0 * sensitivity + 1e-16


# The error is a few ulps times the condition number of the mass matrix with ones on its diagonal. Short links
# and straight arms leave that condition as it is; a heavy tip on light links raises it as much as it is
# heavier, and an elimination written by hand does without.

EPS = np.finfo(float).eps


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


@pytest.mark.quick("any-FourR")
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
