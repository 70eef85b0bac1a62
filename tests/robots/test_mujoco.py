"""The arms against MuJoCo, an independent engine in joint coordinates."""

import numpy as np
import pytest

import redundant_envs as rde

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is in the extra 'verify'")

INERTIA = 1e-14
"""Moment of inertia of MuJoCo's bodies, kg m^2: it wants one above zero."""

ROBOTS = {
    "RPRP": rde.RPRP((2.3, 0.7, 1.9, 0.4), (1.1, 0.6)),
    "FourR": rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35)),
}
STATES = 200


def model_of(robot, g=9.81):
    """MuJoCo's model of an arm: a chain of bodies with a mass point each, a motor on every joint."""
    mass = [f'mass="{m!r}" diaginertia="{INERTIA} {INERTIA} {INERTIA}"' for m in robot.masses]
    hinge, slide = 'type="hinge" axis="0 0 1"', 'type="slide" axis="1 0 0"'
    l = robot.lengths
    if robot.kind == "RPRP":
        # joint, position of the body in its parent, position of the mass in the body
        chain = [(hinge, 0.0, l[0]), (slide, l[0], 0.0), (hinge, 0.0, l[1]), (slide, l[1], 0.0)]
    else:
        chain = [(hinge, 0.0 if i == 0 else l[i - 1], l[i]) for i in range(4)]
    text = ""
    for i, (joint, at, where) in enumerate(chain):
        text += (
            f'<body pos="{at!r} 0 0"><joint name="j{i}" {joint}/><inertial pos="{where!r} 0 0" {mass[i]}/>'
        )
    end = 0.0 if robot.kind == "RPRP" else l[3]
    text += f'<site name="tip" pos="{end!r} 0 0"/>' + "</body>" * 4
    motors = "".join(f'<motor joint="j{i}"/>' for i in range(4))
    return mujoco.MjModel.from_xml_string(
        '<mujoco><compiler angle="radian" inertiafromgeom="false" boundinertia="0"/>'
        f'<option gravity="0 {-g!r} 0"><flag contact="disable"/></option>'
        f"<worldbody>{text}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


def states(robot):
    rng = np.random.default_rng(23)
    q = rng.uniform(-10.0, 10.0, (STATES, 4))
    q[:, list(robot.prismatic)] /= 20.0
    return q, rng.uniform(-5.0, 5.0, (STATES, 4)), rng.uniform(-30.0, 30.0, (STATES, 4))


@pytest.mark.parametrize("name", ROBOTS)
def test_accelerations(name):
    """qacc under joint motors, and through them the motor map B, at 200 random states."""
    robot = ROBOTS[name]
    model = model_of(robot)
    data = mujoco.MjData(model)
    B = robot.motor_map
    q, qd, t = states(robot)
    qdd = robot.forward_dynamics(q, qd, t @ B.T, 9.81)
    T, M = robot.kinetic_energy(q, qd), robot.mass_matrix(q)
    tip, J = robot.forward_kinematics(q), robot.jacobian(q)
    worst = {"qacc": 0.0, "M": 0.0, "tip": 0.0, "J": 0.0, "T": 0.0, "bias": 0.0}
    h = robot.bias_forces(q, qd) + robot.gravity_forces(q, 9.81)
    for i in range(STATES):
        data.qpos[:] = q[i] @ B
        data.qvel[:] = qd[i] @ B
        data.ctrl[:] = t[i]
        mujoco.mj_forward(model, data)
        mujoco.mj_energyVel(model, data)
        full = np.zeros((4, 4))
        try:
            mujoco.mj_fullM(model, data, full)
        except TypeError:  # before MuJoCo 4
            mujoco.mj_fullM(model, full, data.qM)
        jacobian = np.zeros((3, 4))
        mujoco.mj_jacSite(model, data, jacobian, None, 0)
        found = {
            "qacc": (data.qacc, qdd[i] @ B),
            # phi = B^T q, so M_q = B M_phi B^T, Q = B t, J_q = J_phi B^T
            "M": (B @ full @ B.T, M[i]),
            "bias": (B @ data.qfrc_bias, h[i]),
            "tip": (data.site_xpos[0][:2], tip[i]),
            "J": (jacobian[:2] @ B.T, J[i]),
            "T": (data.energy[1], T[i]),
        }
        for key, (theirs, ours) in found.items():
            error = np.abs(theirs - ours).max() / np.abs(ours).max()
            worst[key] = max(worst[key], error)
    assert worst["qacc"] <= 1e-10
    assert worst["M"] <= 1e-12
    assert worst["bias"] <= 1e-12
    assert worst["tip"] <= 1e-12
    assert worst["J"] <= 1e-12
    assert worst["T"] <= 1e-12


@pytest.mark.parametrize("name", ROBOTS)
def test_each_motor(name):
    """One motor at a time from rest without gravity: every column of B."""
    robot = ROBOTS[name]
    model = model_of(robot, 0.0)
    data = mujoco.MjData(model)
    B = robot.motor_map
    q = np.array([0.4, 0.2, -1.3, 0.3])
    for k in range(4):
        data.qpos[:] = q @ B
        data.qvel[:] = 0.0
        data.ctrl[:] = np.eye(4)[k]
        mujoco.mj_forward(model, data)
        ours = robot.forward_dynamics(q, np.zeros(4), B[:, k], 0.0) @ B
        assert np.abs(data.qacc - ours).max() <= 1e-10 * np.abs(ours).max()
