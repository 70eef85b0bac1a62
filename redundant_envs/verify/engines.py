"""Does MuJoCo, an engine with independent equations, agree? Its model of an arm is the exported one."""

from __future__ import annotations

import numpy as np

from redundant_envs.effects import Gravity
from redundant_envs.effects.hooks import Inertia, PointMass
from redundant_envs.exports.files import document
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.extras import needs
from redundant_envs.verify.checks import Sample, check
from redundant_envs.verify.equations import residual
from redundant_envs.verify.promises import Finding, Mode, NotApplicable, at_most

AGREE = at_most(1e-9)  # of the terms of the equations: MuJoCo rounds poses, 1e-14 of the reach per joint
STATES = 64


@check("MuJoCo: accelerations", AGREE, Mode.STANDARD)
def accelerations(trial: Sample) -> Finding:
    """Accelerations of the arm with its loads fulfil MuJoCo's equations, to a residual that does not grow
    with the condition of M."""
    with needs("verify"):
        import mujoco
    arm, attached = trial.arm, trial.scene.attached
    others = {a.key for a in attached if not isinstance(a.hook, PointMass | Inertia)}
    loads = (x for x in trial.scene.effects if x.key not in others)
    try:
        text = document(Scene(trial.scene.robot, (Gravity(), *loads)), "mjcf").content
    except ValueError as error:
        raise NotApplicable(str(error)) from None
    model = mujoco.MjModel.from_xml_string(text)
    data, B = mujoco.MjData(model), arm.motor_map
    q, qd, _ = (x[:STATES] for x in trial.states)
    M, forces = np.zeros((*q.shape, q.shape[1])), np.zeros(q.shape)
    for i in range(len(q)):
        data.qpos[:], data.qvel[:] = q[i] @ B, qd[i] @ B
        mujoco.mj_forward(model, data)
        try:
            mujoco.mj_fullM(model, data, M[i])
        except TypeError:  # before MuJoCo 4
            mujoco.mj_fullM(model, M[i], data.qM)
        forces[i] = data.qfrc_bias
    scale = np.sqrt(np.einsum("nii->ni", M))
    efforts = np.random.default_rng(trial.seed + 4).normal(0.0, 5.0, q.shape) * scale
    qdd = arm.forward_dynamics(q, qd, efforts @ B.T) @ B
    gaps, _ = residual(M, qdd, (forces, -efforts), scale)
    return trial.finding(gaps, f"{arm.kind}: MuJoCo's equations give other accelerations")
