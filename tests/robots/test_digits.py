"""No digits are lost to heavy tips and sliders: errors relative to the effect of half an ulp of the
inputs."""

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
    qd, Q = rng.normal(0.0, 3.0, 4), forces * rng.normal(0.0, 5.0, 4)
    values = {**arm.parameter_values(), "ax": 0.0, "ay": 9.81}
    values |= dict(zip((*arm.coordinates, *arm.rates), (*q, *qd), strict=True))
    values |= {f"Q{k + 1}": Q[k] for k in range(4)}
    return arm, {name: float(value) for name, value in values.items()}


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


@pytest.mark.parametrize("ratio", [1e3, 1e6, 1e9, 1e12])
def test_a_heavy_tip_costs_no_digits(ratio):
    rng = np.random.default_rng(11)
    for _ in range(10):
        arm, values = drawn("FourR", (1.0 / ratio, 1.0 / ratio, 1.0 / ratio, 1.0), rng, 0.0)
        error, _ = error_and_sensitivity(arm, ACCELERATIONS, values, arm.functions)
        assert error <= 5e-14


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
