"""Compiled code, NumPy, single numbers and torch agree on arms and effects from outside; gradients."""

import numpy as np
import pytest
from armature import Armature
from arms import ADDED, ARMS, STEPS, advanced, e, effects_from_outside, states, stops
from heun import HEUN
from payload import Payload

import redundant_envs as rde
from redundant_envs.backends.torch import torch
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.verify import Mode, evaluators, verify
from redundant_envs.verify.checks import checks_of

KINDS = list(effects_from_outside(ARMS["3R"]))
QUICK = {  # each kind of effect, each arm and each method once
    ("states and links", "3R", "heun"), ("states and links", "RRP", "1e-6"), ("inertias", "4R", "rk4"),
    ("inertias", "RPRP", "rk4"), ("a load", "RRP", "1e-6"), ("a force at a point", "3R", "dop853"),
    ("a force at a point", "3R", "1e-6"), ("a law that changes", "4R", "1e-6"), ("sensors", "3R", "rk8"),
    ("a law that changes", "RRP", "1e-6"), ("states and links", "RRP", "rk8"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "name", "steps"),
    [
        pytest.param(k, n, s, marks=[] if (k, n, s) in QUICK else [pytest.mark.long])
        for k in KINDS
        for n in ARMS
        for s in STEPS
    ],
)
def test_evaluators_agree(kind, name, steps):
    arm = ARMS[name]
    effects = (e.Gravity(), e.ViscousFriction(0.1), *stops(arm, 0.0), *effects_from_outside(arm)[kind])
    scene = rde.Scene(arm, effects, **STEPS[steps])
    assert verify(scene, 64, Mode.FULL, checks=checks_of(evaluators)).misses == ()


@pytest.mark.parametrize("name", ADDED)
def test_torch_steps_agree_with_compiled_ones_and_have_gradients_by_states(name):
    arm = ARMS[name]
    scene = rde.Scene(arm, (e.Gravity(), *effects_from_outside(arm)["states and links"][:2]), tolerance=1e-7)
    q, qd, efforts = (torch.tensor(x) for x in states(arm, 4))
    z = torch.linspace(-1.0, 1.0, 4 * 6, dtype=torch.float64).reshape(4, 6)
    step = rde.torch_step(scene)
    moved = step(q, qd, efforts, z=z)
    batch = rde.BatchSimulator(scene, 4)
    batch.set_state(q.numpy(), qd.numpy())
    batch._memory.write(tuple(Dynamics(scene).effect_states), z.numpy())
    batch.advance(efforts.numpy())
    for found, compiled in zip(moved, (batch.q, batch.qd, batch.z), strict=True):
        assert np.abs(found.numpy() - compiled).max() < 1e-12 * max(1.0, np.abs(compiled).max())
    z.requires_grad_(True)
    step(q, qd, efforts, z=z)[1].sum().backward()
    shift = 1e-5 * torch.eye(24, dtype=torch.float64)[0].reshape(4, 6)
    with torch.no_grad():
        up, down = (step(q, qd, efforts, z=z + s)[1].sum() for s in (shift, -shift))
    assert abs(float(z.grad[0, 0]) - float((up - down) / 2e-5)) < 1e-6
    with pytest.raises(ValueError, match="z is missing"):
        step(q, qd, efforts)


@pytest.mark.parametrize(
    ("effect", "field", "values"),
    [(Armature(0.2), "armature.inertias", (0.2,) * 4), (Payload(0.4), "payload.mass", 0.4)],
)
def test_gradients_by_numbers_of_effects_are_those_of_differences(effect, field, values):
    step = rde.torch_step(rde.Scene(ARMS["4R"], (e.Gravity(), effect), "rk8"))
    q, qd = torch.tensor([[0.1, 0.5, 1.0, 1.3]], dtype=torch.float64), torch.ones((1, 4), dtype=torch.float64)

    def tip(value):
        return step(q, qd, 0.0 * q, {field: value})[0].sum()

    value = torch.tensor(values, dtype=torch.float64, requires_grad=True)
    tip(value).backward()
    shift = torch.zeros_like(value)
    shift.view(-1)[-1] = 1e-5
    with torch.no_grad():
        slope = (tip(value + shift) - tip(value - shift)) / 2e-5
    assert abs(float(value.grad.view(-1)[-1] - slope)) < 1e-6 * abs(float(slope))


def test_gradients_go_through_a_chain_and_its_steps_are_the_compiled_ones():
    scene = rde.Scene(rde.Chain("PRP", (1.0, 0.5, 0.5), (0.4,)), (e.Gravity(),), integrator="rk4")
    q, qd, efforts = np.array([[[0.1, 0.4, 0.2]], [[0.3, -0.5, 0.1]], [[1.0, -2.0, 0.5]]])
    start = torch.tensor(q, requires_grad=True)
    after = rde.torch_step(scene)(start, torch.tensor(qd), torch.tensor(efforts))[0]
    assert np.abs(after.detach().numpy() - advanced(scene, q, qd, efforts)[0].q).max() < 1e-14
    after.sum().backward()
    assert np.isfinite(start.grad.numpy()).all()
    assert start.grad.abs().max() > 0.5


def test_a_method_added_from_outside_converges_with_its_order():
    arm, errors = ARMS["4R"], []
    exact, _ = advanced(rde.Scene(arm, (e.Gravity(),), tolerance=1e-12), *states(arm, 1))
    for steps in (8, 16, 32):
        scene = rde.Scene(arm, (e.Gravity(),), integrator="heun", substeps=steps)
        errors.append(np.abs(advanced(scene, *states(arm, 1))[0].q - exact.q).max())
    assert np.allclose(np.log2(np.divide(errors[:-1], errors[1:])), HEUN.order, atol=0.15)


@pytest.mark.parametrize(("types", "hand"), [("RPRP", ARMS["RPRP"]), ("RRRR", ARMS["4R"])])
def test_a_chain_moves_as_the_arm_written_by_hand(types, hand):
    """Through impacts, with separate masses for each lane."""
    effects = [e.Gravity(), e.ViscousFriction(0.1), *stops(hand, 0.7)]
    masses, ends = {"masses": np.random.default_rng(4).uniform(0.5, 2.0, (16, 4))}, []
    for arm in (hand, rde.Chain(types, hand.masses, hand.lengths)):
        scene = rde.Scene(arm, effects, tolerance=1e-10)
        batch, status = advanced(scene, *states(hand, 16), masses, intervals=10)
        assert status.finite.all()
        ends.append(np.concatenate([batch.q, batch.qd], axis=1))
    assert np.abs(ends[0] - ends[1]).max() < 1e-7
