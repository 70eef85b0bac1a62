"""Does MuJoCo, an engine with independent equations, agree?

Its model is made from the displacements of the point masses when a joint moves, in one pose: they show the
position of each joint, whether it turns or slides, and the masses that it carries.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from redundant_envs.support.extras import needs
from redundant_envs.verify.checks import Array, Sample, check, ratio
from redundant_envs.verify.equations import added_inertia, from_points, residual
from redundant_envs.verify.promises import Finding, Mode, NotApplicable, at_most

AGREE = at_most(1e-9)  # of terms, or of diagonals of M: MuJoCo rounds poses, 1e-14 of the reach per joint
SMALLEST = 1e-14  # moment of inertia of a body, which MuJoCo requires to be positive
LARGEST = 1e6  # smallest diagonal entry of M in MuJoCo's unit of mass: that inertia is below its rounding
MOVED = 1e-9  # fraction of the largest displacement: a mass that moves less with a joint is not carried by it
STATES = 64


class Compared(NamedTuple):
    """MuJoCo's mass matrices and forces at some states, in coordinates of the joints."""

    M: Array
    forces: Array
    tip: Array


def model_of(arm: Any, unit: float, slopes: Array, points: Array) -> Any:
    """MuJoCo's model of an arm, from one pose; ``unit`` is its unit of mass, kg."""
    with needs("verify"):
        import mujoco
    joints, inverse = len(arm.joints), np.linalg.inv(arm.motor_map)
    moved = np.einsum("paj, kj->pka", slopes, inverse)  # displacement of each point by each joint
    carried = np.linalg.norm(moved, axis=2) > MOVED * np.abs(moved).max()
    text, closing, small = "", "", " ".join([repr(SMALLEST)] * 3)
    for k in range(joints):
        if not carried[:, k].any():
            raise NotApplicable(f"{arm.joints[k]} moves no mass")
        if (carried[:, k:].any(axis=1) & ~carried[:, k]).any():
            raise NotApplicable("a mass moves with a joint and not with those before it: this is not a chain")
        p = int(np.flatnonzero(carried[:, k])[-1])
        x, y = points[p].tolist()
        dx, dy = moved[p, k].tolist()
        if arm.prismatic[k]:
            joint = f'type="slide" axis="{dx!r} {dy!r} 0"'
            expected = np.broadcast_to((dx, dy), points.shape)
        else:  # a point turns about a centre in the direction normal to its displacement
            joint = f'type="hinge" axis="0 0 1" pos="{x - dy!r} {y + dx!r} 0"'
            expected = np.stack([y + dx - points[:, 1], points[:, 0] - x + dy], axis=1)
        apart = np.abs(moved[:, k] - expected)[carried[:, k]].max()
        if not apart <= MOVED * np.abs(moved).max():
            raise NotApplicable(f"{arm.joints[k]} moves masses against each other: this is not a chain")
        text += f'<body><joint name="j{k}" {joint}/>'
        own = carried[:, k] & ~carried[:, k + 1 :].any(axis=1)
        for i in np.flatnonzero(own):
            place = " ".join(map(repr, (*points[i].tolist(), 0.0)))
            text += f'<body pos="{place}"><inertial pos="0 0 0" mass="{arm.masses[i] / unit!r}" '
            text += f'diaginertia="{small}"/><site name="p{i}"/></body>'
        # In MuJoCo a body with a joint needs a mass; this one is below rounding.
        text += f'<inertial pos="{x!r} {y!r} 0" mass="{SMALLEST!r}" diaginertia="{small}"/>'
        closing += "</body>"
    return mujoco.MjModel.from_xml_string(
        '<mujoco><compiler angle="radian" inertiafromgeom="false" boundinertia="0"/>'
        '<option gravity="0 -9.81 0"><flag contact="disable"/></option>'
        f"<worldbody>{text}{closing}</worldbody></mujoco>"
    )


def compared(trial: Sample) -> Compared:
    """MuJoCo's mass matrix, with the inertias that effects add, and forces of the motion and of weights."""
    arm, e = trial.arm, trial.shared(from_points)
    q, qd, _ = trial.states
    # The pose that determines the joints best: the one with carried masses farthest from their joints.
    lever = np.linalg.norm(np.einsum("npaj, kj->npka", e.slopes, np.linalg.inv(arm.motor_map)), axis=3)
    pose = int(np.argmax(lever.max(axis=1).min(axis=1)))
    unit = float((e.scale**2).min()) / LARGEST
    model = model_of(arm, unit, e.slopes[pose], e.points[pose])
    import mujoco

    data, n = mujoco.MjData(model), len(arm.joints)
    count = min(STATES, len(q))
    M, forces, tips = np.zeros((count, n, n)), np.zeros((count, n)), np.zeros((count, 2))
    B, inverse = arm.motor_map, np.linalg.inv(arm.motor_map)
    added = inverse @ added_inertia(trial) @ inverse.T
    for i in range(count):
        data.qpos[:], data.qvel[:] = (q[i] - q[pose]) @ B, qd[i] @ B
        mujoco.mj_forward(model, data)
        try:
            mujoco.mj_fullM(model, data, M[i])
        except TypeError:  # before MuJoCo 4
            mujoco.mj_fullM(model, M[i], data.qM)
        M[i] = unit * M[i] + added
        forces[i] = unit * data.qfrc_bias
        tips[i] = data.site(f"p{arm.num_masses - 1}").xpos[:2]
    return Compared(M, forces, tips)


@check("MuJoCo: mass matrix and tip", AGREE, Mode.STANDARD)
def mass_matrix(trial: Sample) -> Finding:
    """M and the tip in random poses, from a model made in one pose."""
    theirs, arm, e = trial.shared(compared), trial.arm, trial.shared(from_points)
    q, B = trial.states[0][: len(theirs.M)], arm.motor_map
    own = arm.mass_matrix(q)
    scale = e.scale[: len(q)]
    gaps = ratio(B @ theirs.M @ B.T - own, scale[:, :, None] * scale[:, None, :]).max(axis=2)
    reach = np.linalg.norm(e.points, axis=2).max()
    tips = ratio(theirs.tip - arm.forward_kinematics(q), reach)
    names = (*arm.joints, "tip x", "tip y")
    words = f"{arm.kind}: MuJoCo has another M or tip: a joint is not where it should be"
    return trial.finding(np.concatenate([gaps, tips], axis=1), words, names)


@check("MuJoCo: accelerations", AGREE, Mode.STANDARD)
def accelerations(trial: Sample) -> Finding:
    """Accelerations fulfil MuJoCo's equations, to a residual that does not grow with the condition of M."""
    theirs, arm, e = trial.shared(compared), trial.arm, trial.shared(from_points)
    count, B = len(theirs.M), arm.motor_map
    q, qd, _ = (x[:count] for x in trial.states)
    scale = np.sqrt(np.einsum("nii->ni", theirs.M))
    efforts = np.random.default_rng(trial.seed + 4).normal(0.0, 5.0, q.shape) * e.scale[:count]
    qdd = arm.forward_dynamics(q, qd, efforts @ B.T) @ B
    gaps, _ = residual(theirs.M, qdd, (theirs.forces, -efforts), scale)
    return trial.finding(gaps, f"{arm.kind}: MuJoCo's equations give other accelerations")
