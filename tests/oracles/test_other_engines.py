"""Oracle O16: the arms against MuJoCo, an independent engine in joint coordinates."""

import numpy as np
import pytest
from oracle_cases import EVERY, G, assert_within, exact, motion

import redundant_envs as rde
from redundant_envs.effects import Gravity

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is in the extra 'verify'")

INERTIA = 1e-14
"""Moment of inertia of MuJoCo's bodies, kg m^2: it wants one above zero."""

STATES = 200


def model_of(robot, g=G):
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


@EVERY
def test_o16_mujoco_has_the_same_accelerations_and_motions(robot):
    """qacc under joint motors, and through them the motor map B, at 200 random states; a second of motion.

    Runge-Kutta steps do not care for linear coordinates: RK4 of 1 ms makes the same steps in both. The
    preset "exact" shows what MuJoCo's steps are off by, mm of the tip.
    """
    model = model_of(robot)
    data = mujoco.MjData(model)
    B = robot.motor_map
    q, qd, t = states(robot)
    qdd = robot.forward_dynamics(q, qd, t @ B.T, G)
    T, M = robot.kinetic_energy(q, qd), robot.mass_matrix(q)
    tip, J = robot.forward_kinematics(q), robot.jacobian(q)
    worst = {"qacc": 0.0, "M": 0.0, "tip": 0.0, "J": 0.0, "T": 0.0, "bias": 0.0}
    h = robot.bias_forces(q, qd) + robot.gravity_forces(q, G)
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
    model.opt.timestep, model.opt.integrator = 1e-3, mujoco.mjtIntegrator.mjINT_RK4
    q0, qd0 = np.array([0.0, 0.1, 0.0, 0.1]) * (robot.kind == "RPRP"), np.array([1.0, 0.5, -1.0, 0.3])
    efforts = np.array([0.5, -0.3, 0.2, 0.1])
    mujoco.mj_resetData(model, data)
    data.qpos[:], data.qvel[:], data.ctrl[:] = q0 @ B, qd0 @ B, efforts
    for _ in range(1000):
        mujoco.mj_step(model, data)
    theirs = robot.forward_kinematics(np.linalg.solve(B.T, data.qpos))
    steps = rde.Scene(robot, (Gravity(G),), "rk4", control_dt=0.02, substeps=20)
    for name, scene in (("tip, RK4 and RK4, mm", steps), ("tip, RK4 and exact, mm", exact(robot))):
        q, _ = motion(scene, q0, qd0, 1.0, efforts)
        worst[name] = 1e3 * float(np.linalg.norm(robot.forward_kinematics(q[0]) - theirs))
    bounds = {"qacc": 2e-12, "M": 2e-14, "tip": 5e-15, "J": 5e-15, "T": 3e-13, "bias": 2e-14}
    motions = {"tip, RK4 and RK4, mm": 5e-10, "tip, RK4 and exact, mm": 2e-7}
    assert_within(bounds | motions, worst)


@EVERY
def test_each_motor_acts_on_its_joint(robot):
    """One motor at a time from rest without gravity: every column of B."""
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
