"""Each line that the report prints is what the code computes, but for the misprints of docs/errata.md."""

import numpy as np
import pytest

import redundant_envs as rde
from tests.oracles.printed import lines, numbers_of, value

ARMS = {"RPRP": rde.RPRP, "FourR": rde.FourR}
ROWS = [(kind, *key) for kind in ARMS for key in lines(kind)]
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
        arm = ARMS[kind](masses, lengths)
        numbers = numbers_of(kind, masses, lengths, q, qd, g)
        later = numbers_of(kind, masses, lengths, q + 1j * STEP * qd, qd, g)
        for (_, point), (line, _) in found.items():
            if point[0] in "xy" and point[1:]:
                numbers[point] = value(line, numbers)
                numbers[f"{point}_dot"] = value(line, later).imag / STEP
        printed, right = (value(line, numbers) for line in found[section, name])
        assert right == pytest.approx(of_code(arm, name, q, qd, g), rel=1e-12, abs=1e-12)
        assert (printed == pytest.approx(right, rel=1e-6)) == (name not in WRONG[kind])
