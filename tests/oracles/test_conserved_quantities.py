"""Oracle O8: energy and momentum over a long time; verify checks every scene over short ones."""

import numpy as np
import pytest
from oracle_cases import LAB, assert_within, motion

import redundant_envs as rde
from redundant_envs.effects import Gravity

WHIRLS = {
    "FourR": ((0.2, 1.0, -0.5, 2.0), (6.0, -4.0, 8.0, -10.0)),
    "RPRP": ((0.2, 0.1, -0.5, 0.2), (6.0, -0.5, 8.0, -1.0)),
}
"""Fast starts of the arms of equal links."""
BOUNDS = {("FourR", "rk4"): (4.5e-7, 2e-6), ("FourR", "rk8"): (2e-7, 2e-6),
          ("RPRP", "rk4"): (1.5e-10, 6e-11), ("RPRP", "rk8"): (4e-14, 5e-14)}  # fmt: skip
"""Relative changes of momentum and energy in 20 s."""


@pytest.mark.parametrize(("kind", "method"), BOUNDS)
def test_o08_energy_and_momentum_stay_without_gravity(kind, method):
    """20 s after a fast start by RK4 of 1 ms and RK8 of 5 ms. The RPRP arm flies apart then, and turns ever
    more slowly."""
    arm, start = LAB[kind], WHIRLS[kind]
    substeps = {"rk4": 20, "rk8": 4}[method]
    end = motion(rde.Scene(arm, (Gravity(0.0),), method, 0.02, substeps), *start, 20.0)
    now, before = (np.ravel([arm.angular_momentum(*x), arm.kinetic_energy(*x)]) for x in (end, start))
    found = dict(zip(("momentum", "energy"), np.abs(now / before - 1.0), strict=True))
    assert_within(dict(zip(found, BOUNDS[kind, method], strict=True)), found)
