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


@pytest.mark.quick("FourR")
@pytest.mark.parametrize("kind", KINDS)
def test_accelerations_of_a_chain_lose_no_more_digits_than_the_scaled_mass_matrix(kind):
    """They follow from points alone: its condition, with ones on its diagonal, is that of a heavy tip."""
    rng = np.random.default_rng(3)
    for _ in range(10):
        hand, values = drawn(kind, 10.0 ** rng.uniform(-4, 4, 4), rng, 1.0)
        chain = rde.Chain(KINDS[kind], hand.masses, hand.lengths)
        M = hand.mass_matrix([values[name] for name in hand.coordinates])
        scale = np.sqrt(np.diag(M))
        error, _ = error_and_sensitivity(chain, ACCELERATIONS, values, chain.functions)
        assert error <= 20.0 * np.finfo(float).eps * np.linalg.cond(M / np.outer(scale, scale))
