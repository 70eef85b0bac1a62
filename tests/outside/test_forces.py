"""Forces, motors and stops from outside move as their laws say; what a scene does not name is not there."""

import numpy as np
import pytest
from arms import ARMS, e, states
from catalogue import advanced
from held_command import HeldCommand

import redundant_envs as rde
from redundant_envs.simulator.lane.direct import fields_of
from redundant_envs.simulator.lane.dynamics import Dynamics

# ---- at points -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "k"), [("4R", 4), ("RPRP", 1), ("3R", 2), ("RRP", 3)])
def test_a_force_at_a_point_accelerates_as_virtual_work_says(name, k):
    actuation = ("joint", "generalized")[k % 2]
    arm, tether = ARMS[name], e.Tether(k, (0.3, -0.2), 50.0, 2.0)
    q, qd, efforts = states(arm, 30, 2.0)
    dynamics = Dynamics(rde.Scene(arm, (e.Gravity(9.81), tether), "rk4", actuation=actuation))
    numbers = {**fields_of(dynamics), **dict(zip(dynamics.commands, efforts.T, strict=True))}
    x = dynamics.quantities([*q.T, *qd.T], numbers)
    found = np.array([np.broadcast_to(a, len(q)) for a in dynamics.accelerations(x)]).T
    names = [f"{axis}{k}{j + 1}" for axis in "XY" for j in range(len(arm.joints))]
    known = arm.parameter_values() | dict(zip(arm.coordinates, q.T, strict=True))
    columns = [np.broadcast_to(x, len(q)) for x in arm.evaluate(names, known)]
    at_point = np.transpose(columns).reshape(len(q), 2, -1)
    force = 50.0 * (np.array([0.3, -0.2]) - arm.points(q)[:, k - 1])
    force -= 2.0 * np.einsum("nij,nj->ni", at_point, qd)
    driven = efforts @ arm.motor_map.T if actuation == "joint" else efforts
    expected = arm.forward_dynamics(q, qd, driven + np.einsum("nij,ni->nj", at_point, force))
    assert np.abs(found - expected).max() < 1e-7 * np.abs(expected).max()


# ---- motors and states ---------------------------------------------------------------------------------


def test_links_act_in_their_stated_order_whatever_the_order_of_effects():
    chain, zero = (HeldCommand(), e.Lag(0.03), e.EffortLimits(1.5)), np.zeros((4, 3))
    own, turned, free = (
        advanced(
            rde.Scene(ARMS["3R"], effects, integrator="rk4", substeps=4), zero, zero, zero + 4.0, intervals=5
        )[0]
        for effects in (chain, chain[::-1], chain[:2])
    )
    lagged = own.z[0, 3:]  # the first interval has no command
    assert np.abs(lagged - 4.0 * (1.0 - np.exp(-0.08 / 0.03))).max() < 1e-4
    assert lagged.min() > 1.5  # what acts is less: limits come last
    assert np.array_equal(own.q, turned.q)
    assert np.abs(free.qd - own.qd).max() > 0.1


# ---- stops ---------------------------------------------------------------------------------------------
