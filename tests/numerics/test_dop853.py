"""dop853: what SciPy's does in as many evaluations, and motions that it gives up.

``model/test_trajectory.py`` has known motions, and that more times do not change one.
"""

import numpy as np
import pytest
from catalogue import ARMS, EQUAL

import redundant_envs as rde

e = rde.effects
RPRP = EQUAL["RPRP"]


@pytest.mark.long
def test_scipy_agrees_and_needs_as_many_evaluations():
    integrate = pytest.importorskip("scipy.integrate", reason="SciPy is in the extra verify")
    arm = ARMS["RPRP"]
    q, qd, efforts = (-1.2, 0.2, -0.4, 0.1), (0.5, -0.3, 0.2, 0.4), (1.5, -0.7, 0.4, 0.2)

    def slope(t, y):
        return np.r_[y[4:], arm.forward_dynamics(y[:4], y[4:], arm.motor_map @ efforts, 9.81)]

    peer = integrate.solve_ivp(slope, (0, 1), [*q, *qd], "DOP853", rtol=1e-13, atol=1e-14)
    batch = rde.BatchSimulator(rde.Scene(arm, (e.Gravity(),), "dop853", 1.0))
    batch.set_state(q, qd)
    assert batch.advance([efforts]).evaluations[0] <= 1.2 * peer.nfev
    np.testing.assert_allclose([*batch.q[0], *batch.qd[0]], peer.y[:, -1], rtol=0, atol=1e-10)


def test_a_motion_that_overflows_ends():
    batch = rde.BatchSimulator(rde.Scene(RPRP, (e.Gravity(),), integrator="dop853"), 2)
    batch.set_state([0.3, 0.1, -0.4, 0.2], [[0, 1e200, 0, 0], [0, 0, 0, 0]])
    before = np.c_[batch.q, batch.qd]
    status = batch.advance()
    assert status.numerics[0] & rde.Numerics.TOLERANCE_NOT_REACHED
    assert status.numerics[0] & rde.Numerics.NO_STEP_FOUND
    assert status.numerics[1] == 0
    np.testing.assert_array_equal(np.c_[batch.q, batch.qd][0], before[0])
    with pytest.raises(ValueError, match=r"dop853 finds no step .* at t = 0 s"):
        rde.simulate(batch.scene, [0.3, 0.1, -0.4, 0.2], [0, 1e200, 0, 0], [1.0])
