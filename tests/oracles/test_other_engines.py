"""Oracle O16: the arms against MuJoCo, an independent engine in joint coordinates."""

import numpy as np
import pytest
from oracle_cases import EVERY, G, assert_within, exact, largest, motion

import redundant_envs as rde
from redundant_envs.effects import Gravity

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is in the extra 'verify'")

INERTIA = 1e-14
"""Moment of inertia of MuJoCo's bodies, kg m^2: it wants one above zero."""


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
    text = (
        "".join(
            f'<body pos="{at!r} 0 0"><joint name="j{i}" {joint}/><inertial pos="{where!r} 0 0" {mass[i]}/>'
            for i, (joint, at, where) in enumerate(chain)
        )
        + "</body>" * 4
    )
    motors = "".join(f'<motor joint="j{i}"/>' for i in range(4))
    return mujoco.MjModel.from_xml_string(
        '<mujoco><compiler angle="radian" inertiafromgeom="false" boundinertia="0"/>'
        f'<option gravity="0 {-g!r} 0"><flag contact="disable"/></option>'
        f"<worldbody>{text}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


@EVERY
def test_o16_mujoco_has_the_same_accelerations_and_motions(robot):
    """qacc under joint motors, and through them the motor map B, at 200 random states; a second of motion.

    Runge-Kutta steps do not care for linear coordinates: RK4 of 1 ms makes the same steps in both. The
    preset "exact" shows what MuJoCo's steps are off by, mm of the tip.
    """
    model = model_of(robot)
    data, B = mujoco.MjData(model), robot.motor_map
    rng = np.random.default_rng(23)
    q, qd, t = (
        rng.uniform(-10.0, 10.0, (200, 4)),
        rng.uniform(-5.0, 5.0, (200, 4)),
        rng.uniform(-30.0, 30.0, (200, 4)),
    )
    q[:, list(robot.prismatic)] /= 20.0
    ours, found = robot.forward_dynamics(q, qd, t @ B.T, G) @ B, {"qacc": 0.0}
    for i in range(200):
        data.qpos[:], data.qvel[:], data.ctrl[:] = q[i] @ B, qd[i] @ B, t[i]  # phi = B^T q
        mujoco.mj_forward(model, data)
        found["qacc"] = max(found["qacc"], largest(data.qacc - ours[i], np.abs(ours[i]).max()))
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
        end, _ = motion(scene, q0, qd0, 1.0, efforts)
        found[name] = 1e3 * float(np.linalg.norm(robot.forward_kinematics(end[0]) - theirs))
    assert_within({"qacc": 2e-12, "tip, RK4 and RK4, mm": 5e-10, "tip, RK4 and exact, mm": 2e-7}, found)
