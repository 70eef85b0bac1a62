"""Does MuJoCo, an engine with independent equations, agree?

Its model is made from the displacements of the point masses when a joint moves, in one pose: they show the
position of each joint, whether it turns or slides, and the masses that it carries.
"""

from typing import Any

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


def model_of(arm: Any, unit: float, moved: Array, points: Array) -> Any:
    """MuJoCo's model of an arm, with ``unit`` [kg] as its unit of mass, from the point masses in one pose,
    (masses, 2), and their displacements by each joint, (masses, joints, 2)."""
    with needs("verify"):
        import mujoco
    least = MOVED * np.abs(moved).max()
    carried = np.linalg.norm(moved, axis=2) > least
    text, small = "", " ".join([repr(SMALLEST)] * 3)
    for k, joint in enumerate(arm.joints):
        if not carried[:, k].any():
            raise NotApplicable(f"{joint} moves no mass")
        if (carried[:, k:].any(axis=1) & ~carried[:, k]).any():
            raise NotApplicable("a mass moves with a joint and not with those before it: this is not a chain")
        p = int(np.flatnonzero(carried[:, k])[-1])
        (x, y), (dx, dy) = points[p].tolist(), moved[p, k].tolist()
        if arm.prismatic[k]:
            kind = f'type="slide" axis="{dx!r} {dy!r} 0"'
            expected = np.broadcast_to((dx, dy), points.shape)
        else:  # a point turns about a centre in the direction normal to its displacement
            kind = f'type="hinge" axis="0 0 1" pos="{x - dy!r} {y + dx!r} 0"'
            expected = np.stack([y + dx - points[:, 1], points[:, 0] - x + dy], axis=1)
        if not np.abs(moved[:, k] - expected)[carried[:, k]].max() <= least:
            raise NotApplicable(f"{joint} moves masses against each other: this is not a chain")
        text += f"<body><joint {kind}/>"
        for i in np.flatnonzero(carried[:, k] & ~carried[:, k + 1 :].any(axis=1)):
            place = " ".join(map(repr, (*points[i].tolist(), 0.0)))
            text += f'<body pos="{place}"><inertial pos="0 0 0" mass="{arm.masses[i] / unit!r}" '
            text += f'diaginertia="{small}"/><site name="p{i}"/></body>'
        # In MuJoCo a body with a joint needs a mass; this one is below rounding.
        text += f'<inertial pos="{x!r} {y!r} 0" mass="{SMALLEST!r}" diaginertia="{small}"/>'
    return mujoco.MjModel.from_xml_string(
        '<mujoco><compiler angle="radian" inertiafromgeom="false" boundinertia="0"/>'
        '<option gravity="0 -9.81 0"><flag contact="disable"/></option>'
        f"<worldbody>{text}{'</body>' * len(arm.joints)}</worldbody></mujoco>"
    )


def compared(trial: Sample) -> tuple[Array, Array, Array]:
    """MuJoCo's mass matrices, with the inertias that effects add, its forces of the motion and of weights,
    both along the joints, and its tips, at some states."""
    arm, e = trial.arm, trial.shared(from_points)
    B, inverse = arm.motor_map, np.linalg.inv(arm.motor_map)
    moved = np.einsum("npaj,kj->npka", e.slopes, inverse)
    # The pose that determines the joints best: the one with carried masses farthest from their joints.
    pose = int(np.argmax(np.linalg.norm(moved, axis=3).max(axis=1).min(axis=1)))
    unit = float((e.scale**2).min()) / LARGEST
    model = model_of(arm, unit, moved[pose], e.points[pose])
    import mujoco

    data, added = mujoco.MjData(model), inverse @ added_inertia(trial) @ inverse.T
    (q, qd), rows = (x[:STATES] @ B for x in trial.states[:2]), []
    for position, rate in zip(q - trial.states[0][pose] @ B, qd, strict=True):
        data.qpos[:], data.qvel[:] = position, rate
        mujoco.mj_forward(model, data)
        M = np.zeros_like(B)
        try:
            mujoco.mj_fullM(model, data, M)
        except TypeError:  # before MuJoCo 4
            mujoco.mj_fullM(model, M, data.qM)
        tip = data.site(f"p{arm.num_masses - 1}").xpos[:2].copy()
        rows.append((unit * M + added, unit * data.qfrc_bias, tip))
    M, forces, tips = map(np.array, zip(*rows, strict=True))
    return M, forces, tips


@check("MuJoCo: mass matrix and tip", AGREE, Mode.STANDARD)
def mass_matrix(trial: Sample) -> Finding:
    """M and the tip in random poses, from a model made in one pose."""
    (M, _, tips), arm, e = trial.shared(compared), trial.arm, trial.shared(from_points)
    q, scale, B = trial.states[0][: len(M)], e.scale[: len(M)], arm.motor_map
    gaps = ratio(B @ M @ B.T - arm.mass_matrix(q), scale[:, :, None] * scale[:, None, :]).max(axis=2)
    apart = ratio(tips - arm.forward_kinematics(q), np.linalg.norm(e.points, axis=2).max())
    words = f"{arm.kind}: MuJoCo has another M or tip: a joint is not where it should be"
    return trial.finding(np.concatenate([gaps, apart], axis=1), words, (*arm.joints, "tip x", "tip y"))


@check("MuJoCo: accelerations", AGREE, Mode.STANDARD)
def accelerations(trial: Sample) -> Finding:
    """Accelerations fulfil MuJoCo's equations, to a residual that does not grow with the condition of M."""
    (M, forces, _), arm, B = trial.shared(compared), trial.arm, trial.arm.motor_map
    q, qd, _ = (x[: len(M)] for x in trial.states)
    scale = np.sqrt(np.einsum("nii->ni", M))
    efforts = np.random.default_rng(trial.seed + 4).normal(0.0, 5.0, q.shape) * scale
    gaps, _ = residual(M, arm.forward_dynamics(q, qd, efforts @ B.T) @ B, (forces, -efforts), scale)
    return trial.finding(gaps, f"{arm.kind}: MuJoCo's equations give other accelerations")
