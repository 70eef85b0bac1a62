"""Forces, motors and stops from outside move as their laws say; what a scene does not name is not there."""

import dataclasses

import numpy as np
import pytest
from arms import ARMS, e, states
from catalogue import advanced
from held_command import HeldCommand

import redundant_envs as rde
from redundant_envs.compiler.backends.torch import torch
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


def test_commands_of_the_interval_before_act_to_the_bit_and_begin_anew_where_a_state_is_set():
    free = rde.Scene(ARMS["RPRP"], (e.Gravity(),), tolerance=1e-6)
    late = dataclasses.replace(free, effects=(*free.effects, HeldCommand()))
    commands = np.random.default_rng(0).normal(size=(6, 5, 4))
    a, b = rde.BatchSimulator(free, 5), rde.BatchSimulator(late, 5)
    for k in range(6):
        a.advance(commands[k - 1] if k else None)
        b.advance(commands[k])
        assert np.array_equal(a.q, b.q)
        assert np.array_equal(b.z, commands[k])
    b.set_state(np.zeros((1, 4)), np.zeros((1, 4)), index=[3])
    assert np.array_equal(b.z, np.where(np.arange(5)[:, None] == 3, 0.0, commands[5]))


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


def test_torch_steps_have_the_gradients_of_differences_by_states_of_effects():
    start, step = (
        [torch.tensor(x) for x in states(ARMS["3R"], 4)],
        rde.torch_step(rde.Scene(ARMS["3R"], (e.Lag(0.04), HeldCommand()))),
    )

    def moved(value):
        return step(*start, z=value)[1].sum()

    value = torch.linspace(-1.0, 1.0, 24, dtype=torch.float64).reshape(4, 6).requires_grad_()
    moved(value).backward()
    shift = torch.zeros_like(value)
    shift[-1, -1] = 1e-5
    with torch.no_grad():
        slope = (moved(value + shift) - moved(value - shift)) / 2e-5
    assert float(value.grad[-1, -1]) == pytest.approx(float(slope), rel=1e-6, abs=1e-7)
    assert abs(slope) > 1e-4


# ---- stops ---------------------------------------------------------------------------------------------
