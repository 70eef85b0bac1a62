"""Joint paths along given points, and what the null space does in them."""

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control.joint_path import joint_path, mobility_slopes
from redundant_envs.control.nominal import NominalModel

TURN = np.linspace(0.0, 2 * np.pi, 120)
CIRCLE = np.stack([0.45 + 0.15 * np.cos(TURN), 0.15 * np.sin(TURN)], axis=-1)[None]
STARTS = {"four_r": [0.1, 0.1, -2.6, 2.0], "rprp": [-0.6, 0.1, 1.2, 0.1]}


@pytest.mark.parametrize("arm", STARTS)
def test_the_tip_follows_and_the_null_space_improves_the_posture(arm):
    model = NominalModel(rde.load_scene(f"{arm}_reach"))
    towards = np.repeat(CIRCLE[:, :1], 40, axis=1)
    start = joint_path(model, np.array([STARTS[arm]]), towards, 0.02, None)[:, -1]
    measures = []
    for posture in (None, lambda phi: mobility_slopes(model, phi)):
        path = joint_path(model, start, CIRCLE, 0.02, posture)[0]
        assert np.linalg.norm(model.tip(path) - CIRCLE[0], axis=-1).max() < 1e-3
        low, high = model.travel
        assert ((path >= low) & (path <= high)).all()
        assert np.abs(np.diff(path, axis=0)).max() < 0.05
        off = np.abs(path - 0.125)[:, model.slides]  # sliders from the middle of their travel
        measures.append(-off.mean() if off.size else model.arm.manipulability(path @ model.inverse).mean())
    assert measures[1] - measures[0] > 0.1 * abs(measures[0])
