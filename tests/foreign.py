"""Scenes in MuJoCo, by their files, and the largest difference of its accelerations from ours."""

import numpy as np
import pytest

from redundant_envs.effects import EffortLimits
from redundant_envs.exports.files import document
from redundant_envs.simulator.lane.direct import fields_of
from redundant_envs.simulator.lane.dynamics import Dynamics

try:
    import mujoco
except ModuleNotFoundError:
    mujoco = None
NEEDS_MUJOCO = pytest.mark.skipif(mujoco is None, reason="MuJoCo is not installed: pip install '.[verify]'")


def model_of(scene, form, approximate=False, name=""):
    text = document(scene, form, approximate, name).content
    assert isinstance(text, str)
    return mujoco.MjModel.from_xml_string(text)


def states(arm, count=1000, seed=11, effort=1.0):
    """Positions, rates and efforts up to one, (count, joints) each."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-np.pi, np.pi, (count, len(arm.joints)))
    q[:, arm.sliders()] = rng.uniform(-0.1, 0.4, (count, len(arm.sliders())))
    return q, rng.uniform(-5.0, 5.0, q.shape), rng.uniform(-effort, effort, q.shape)


def accelerations(scene, q, qd, commands):
    """Those of the coordinates, by the equations of the simulator; states may be rows of any numbers."""
    dynamics = Dynamics(scene, located=False)
    numbers = {**fields_of(dynamics), **dict(zip(dynamics.commands, commands, strict=True))}
    return dynamics.accelerations(dynamics.quantities([*q, *qd], numbers))[: len(q)]


def ours(scene, q, qd, efforts):
    """Accelerations of the joints, (states, joints)."""
    qdd = accelerations(scene, q.T, qd.T, efforts.T)
    return np.stack(np.broadcast_arrays(*qdd), axis=-1) @ scene.robot.motor_map


def largest_difference(scene, model, controlled, seed=11):
    """Of accelerations, as a share of the largest of each state."""
    data, worst, arm = mujoco.MjData(model), 0.0, scene.robot
    q, qd, controls = states(arm, seed=seed)
    limits = [x.limits for x in scene.effects if isinstance(x, EffortLimits)]
    efforts = controls * (np.min(limits, axis=0) if limits else 1.0)
    expected = ours(scene, q, qd, efforts)
    order = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in arm.joints]
    for k in range(len(q)):
        data.qpos[order], data.qvel[order] = q[k] @ arm.motor_map, qd[k] @ arm.motor_map
        if controlled:
            data.ctrl[:] = controls[k]
        else:
            data.qfrc_applied[order] = efforts[k]
        mujoco.mj_forward(model, data)
        worst = max(worst, np.abs(data.qacc[order] - expected[k]).max() / np.abs(expected[k]).max())
    return worst
