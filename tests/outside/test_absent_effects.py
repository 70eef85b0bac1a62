"""Effects that a scene does not name are not computed."""

import dataclasses

import numpy as np
import pytest
from arms import ARMS

import redundant_envs as rde
from redundant_envs.algebra import ABSENT, exp, maximum, sqrt, where
from redundant_envs.backends.torch import torch

e = rde.effects


@pytest.mark.parametrize("name", ["4R", "RRP"])
def test_a_scene_without_gravity_computes_nothing_of_it(name):
    """On arms that compute a sum of their forces, too: an absent effect leaves no operation."""
    arm = ARMS[name]
    without = rde.Scene(arm, (), "rk4")
    assert "gravity" not in rde.listing(without)
    bill, more = rde.bill(without), rde.bill(rde.Scene(arm, (e.Gravity(),), "rk4"))
    assert "gravity" not in bill
    assert more["arm"] == bill["arm"]
    assert more["gravity"].products >= 16
    q, qd, Q = np.random.default_rng(1).normal(size=(3, 20, len(arm.joints)))
    batch = rde.BatchSimulator(dataclasses.replace(without, integrator="euler", control_dt=1e-3), 20)
    batch.set_state(q, qd)
    batch.advance(Q)
    expected = qd + 1e-3 * arm.forward_dynamics(q, qd, Q @ arm.motor_map.T, g=0.0)
    np.testing.assert_allclose(batch.qd, expected, rtol=1e-12, atol=1e-12)


NUMBERS = {
    "float": 3.0,
    "array": np.array([3.0, -1.0]),
    "scalar of NumPy": np.float64(3.0),
    "tensor": torch.tensor([3.0, -1.0], dtype=torch.float64),
}


@pytest.mark.parametrize("x", NUMBERS.values(), ids=NUMBERS)
def test_a_number_that_is_not_there_leaves_sums_as_they_are(x):
    for found in (x + ABSENT, ABSENT + x, x - ABSENT, x - 2.0 * ABSENT, x + ABSENT * x, x - x * ABSENT / 3.0):
        assert found is x
    assert all(np.ravel(np.asarray((ABSENT - x) == -x)))
    assert abs(-ABSENT) ** 2 + ABSENT is ABSENT
    assert np.ravel(np.asarray(maximum(x, ABSENT)))[0] == 3.0
    assert float(np.ravel(np.asarray(where(x > ABSENT, ABSENT, x)))[0]) == 0.0
    assert not np.any(np.asarray(x == ABSENT))
    assert np.all(np.asarray(x != ABSENT))
    assert ABSENT == -ABSENT
    assert ABSENT == 0.0
    assert (sqrt(ABSENT), exp(ABSENT), float(ABSENT)) == (0.0, 1.0, 0.0)
