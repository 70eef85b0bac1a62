"""One joint with an inertia of 2 kg m^2, whose motion is known; there is no gravity."""

import numpy as np
import pytest
from catalogue import advanced

import redundant_envs as rde

INERTIA = 2.0
ONE = rde.Chain("R", (INERTIA,), (1.0,))
METHODS = {
    "rk4": {"integrator": "rk4", "substeps": 20}, "rk8": {"integrator": "rk8"}, "1e-9": {"tolerance": 1e-9},
    "dop853": {"integrator": "dop853"},
}  # fmt: skip
WITH = pytest.mark.parametrize("how", METHODS.values(), ids=METHODS)
ZERO = np.zeros((1, 1))


def moved(effects, command=0.0, rate=0.0, intervals=1, arm=ONE, **how):
    """A simulator of one joint after some intervals under a constant command."""
    scene = rde.Scene(arm, effects, **how)
    return advanced(scene, ZERO, ZERO + rate, ZERO + command, intervals=intervals)[0]
