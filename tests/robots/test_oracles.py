"""The arms against 128 states computed from positions alone with 50 digits, and the report's misprints."""

import json
from pathlib import Path

import numpy as np
import pytest

import redundant_envs as rde
from tests.oracles.printed import lines, misprints, numbers_of, value

FOLDER = Path(__file__).parents[1] / "oracles"
ARMS = {"rprp": rde.RPRP, "four_r": rde.FourR}


def cases(arm):
    """The oracle's cases with arrays for lists."""
    data = json.loads((FOLDER / f"{arm}.json").read_text(encoding="utf-8"))["cases"]
    return [{k: np.array(v) if isinstance(v, list) else v for k, v in c.items()} for c in data]


CASES = {arm: cases(arm) for arm in ARMS}
PARAMETERS = [pytest.param(a, c, id=f"{a}-{c['id']}") for a in ARMS for c in CASES[a]]


def close(value, reference, tolerance, scale=None):
    """Whether the largest difference is within the tolerance of the scale."""
    reference = np.asarray(reference)
    assert np.shape(value) == reference.shape
    scale = np.abs(reference).max() if scale is None else scale
    return np.abs(value - reference).max() <= tolerance * scale


@pytest.mark.quick("rprp-0")
@pytest.mark.parametrize(("arm", "case"), PARAMETERS)
def test_an_arm_has_the_numbers_of_the_oracle(arm, case):
    m, q, qd, g = case["m"], case["q"], case["qd"], case["g"]
    robot = ARMS[arm](m, case["l"])
    assert close(robot.mass_matrix(q), case["M"], 1e-14)
    assert close(robot.bias_forces(q, qd), case["h"], 1e-14)
    assert close(robot.gravity_forces(q, g), case["G"], 1e-14)  # without gravity to the bit
    factor = min(10.0, max(1.0, case["cond_M"] / 100.0))
    assert close(robot.forward_dynamics(q, qd, case["Q"], g), case["qdd"], 1e-13 * factor)
    scale = np.abs(case["M"]).max() * np.abs(case["qdd"]).max() + np.abs(case["h"]).max()
    assert close(robot.inverse_dynamics(q, qd, case["qdd"], g), case["Q"], 1e-14, scale)
    reach = case["l"].sum() + (np.abs(q[[1, 3]]).sum() if arm == "rprp" else 0.0)
    assert close(robot.jacobian(q), case["J"], 1e-14)
    assert close(robot.forward_kinematics(q), case["tip"], 1e-15, reach)
    assert close(robot.points(q)[3], case["tip"], 1e-15, reach)
    terms = np.abs(case["J"]).max() * (qd**2).sum() + np.abs(qd).max() ** 2
    assert close(robot.jacobian_dot_qd(q, qd), case["Jdot_qd"], 2e-15, terms)
    momenta = np.abs(case["M"]) @ np.abs(qd)
    assert close(robot.kinetic_energy(q, qd), case["T"], 1e-15, np.abs(qd) @ momenta)
    assert close(robot.angular_momentum(q, qd), case["Lz"], 1e-15, momenta.sum())
    assert close(robot.potential_energy(q, g), case["U"], 1e-15, m.sum() * g * reach)


NOMINAL = {
    "rprp": ((2, 1.5, 1, 0.5), (1, 0.8), (0.6, 0.2, -0.4, 0.3), (1, 0.5, -1.5, 0.8)),
    "four_r": ((2, 1.5, 1, 0.5), (1, 0.8, 0.6, 0.4), (0.6, 0.2, -0.4, -1.0), (1, 0.5, -1.5, 0.8)),
}
SIZES = {"rprp": [0.096, 0.23], "four_r": [0.10, 0.20]}
"""Of misprints at the nominal state, relative to their entries; H3 of RPRP has two."""


@pytest.mark.parametrize("arm", SIZES)
def test_the_states_see_each_printed_misprint_whose_size_is_that_of_the_errata(arm):
    """One in 64 may be blind to it."""
    m, l, q, qd = NOMINAL[arm]
    robot = ARMS[arm](m, l)
    right = {"M": robot.mass_matrix(q), "h": robot.bias_forces(q, qd)}
    sizes = [abs(x / right[name][k]) for name, k, x in misprints(robot.kind, m, l, q, qd)]
    assert sizes == pytest.approx(SIZES[arm], rel=0.06)
    seen, indefinite = np.zeros(len(sizes)), 0
    for case in CASES[arm]:
        found = [*misprints(robot.kind, *(case[n] for n in ("m", "l", "q", "qd")))]
        seen += [abs(x) > 1e-6 * np.abs(case[name]).max() for name, _, x in found]
        if arm == "four_r":  # the printed M33 makes M indefinite in most states
            printed = case["M"] + np.diag([0.0, 0.0, found[0][2], 0.0])
            indefinite += np.linalg.eigvalsh(printed).min() < 0.0
    assert (seen >= 63).all()
    assert (indefinite > 32) == (arm == "four_r")


# ---- each line that the report prints, but for the misprints of docs/errata.md -----------------------

ROWS = [(kind, *key) for kind in ("RPRP", "FourR") for key in lines(kind)]
WRONG = {"RPRP": {"KE", "H1 + G1", "H3 + G3"}, "FourR": {"M33", "H4 + G4"}}
STEP = 1e-30
"""Of a derivative by a complex step, which is exact."""


def of_code(arm, name, q, qd, g):
    """What the code has for a line of this name."""
    if name in ("KE", "PE"):
        return {"KE": arm.kinetic_energy(q, qd), "PE": arm.potential_energy(q, g)}[name]
    if name in ("x", "y"):
        return arm.forward_kinematics(q)["xy".index(name)]
    k, *further = (int(digit) - 1 for digit in name.partition(" ")[0][1:])
    if name[0] in "xy":
        return arm.points(q)[k]["xy".index(name[0])]
    if name[0] == "H":
        return arm.bias_forces(q, qd)[k] + arm.gravity_forces(q, g)[k]
    return {"J": arm.jacobian, "M": arm.mass_matrix}[name[0]](q)[k, *further]


@pytest.mark.parametrize(("kind", "section", "name"), ROWS)
def test_a_printed_line_is_what_the_code_computes(kind, section, name):
    rng, g = np.random.default_rng(11), 9.81
    found = lines(kind)
    for _ in range(4):
        masses, lengths = rng.uniform(0.3, 3.0, 4), rng.uniform(0.3, 2.0, 2 if kind == "RPRP" else 4)
        q, qd = rng.uniform(-2.0, 2.0, (2, 4))
        arm = getattr(rde, kind)(masses, lengths)
        numbers = numbers_of(kind, masses, lengths, q, qd, g)
        later = numbers_of(kind, masses, lengths, q + 1j * STEP * qd, qd, g)
        for (_, point), (line, _) in found.items():
            if point[0] in "xy" and point[1:]:
                numbers[point] = value(line, numbers)
                numbers[f"{point}_dot"] = value(line, later).imag / STEP
        printed, right = (value(line, numbers) for line in found[section, name])
        assert right == pytest.approx(of_code(arm, name, q, qd, g), rel=1e-12, abs=1e-12)
        assert (printed == pytest.approx(right, rel=1e-6)) == (name not in WRONG[kind])
