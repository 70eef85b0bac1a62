"""Torch steps of scenes from outside are the compiled ones and have gradients."""

import numpy as np
import pytest
from armature import Armature
from arms import ARMS, e, effects_from_outside, states
from payload import Payload

import redundant_envs as rde
from redundant_envs.backends.torch import torch
from redundant_envs.lane.dynamics import Dynamics

CASES = {
    "states of effects": (
        rde.Scene(ARMS["3R"], effects_from_outside(ARMS["3R"])["states and links"][:2], tolerance=1e-7),
        "z", np.linspace(-1.0, 1.0, 24).reshape(4, 6),
    ),
    "inertias": (rde.Scene(ARMS["4R"], (e.Gravity(), Armature(0.2))), "armature.inertias", [0.2] * 4),
    "a load": (rde.Scene(ARMS["RRP"], (e.Gravity(), Payload(0.4))), "payload.mass", 0.4),
}  # fmt: skip


@pytest.mark.parametrize(("scene", "what", "values"), CASES.values(), ids=CASES)
def test_torch_steps_are_the_compiled_ones_and_their_gradients_those_of_differences(scene, what, values):
    q, qd, efforts = map(torch.tensor, states(scene.robot, 4))
    value = torch.tensor(values, dtype=torch.float64, requires_grad=True)
    step = rde.torch_step(scene)

    def moved(value):
        z = {"z": value} if what == "z" else {}
        return step(q, qd, efforts, {what: value} if "." in what else {}, **z)

    batch = rde.BatchSimulator(scene, 4)
    batch.set_state(q.numpy(), qd.numpy())
    batch._memory.write(tuple(Dynamics(scene).effect_states), values if what == "z" else batch.z)
    batch.advance(efforts.numpy())
    found = moved(value)
    for one, compiled in zip(found, (batch.q, batch.qd, batch.z), strict=False):
        assert np.abs(one.detach().numpy() - compiled).max(initial=0.0) < 1e-12 * np.abs(batch.qd).max()
    found[1].sum().backward()
    shift = torch.zeros_like(value)
    shift.view(-1)[-1] = 1e-5
    with torch.no_grad():
        slope = (moved(value + shift)[1].sum() - moved(value - shift)[1].sum()) / 2e-5
    assert float(value.grad.view(-1)[-1]) == pytest.approx(float(slope), rel=1e-6, abs=1e-7)
    assert abs(slope) > 1e-4
    if what == "z":
        with pytest.raises(ValueError, match="z is missing"):
            step(q, qd, efforts)
