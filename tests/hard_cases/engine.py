"""MuJoCo as a subject of the cases that it can simulate."""

import functools

import numpy as np

import redundant_envs as rde
from studies.peers import mujoco_model

from .hard_case import Motion, Subject
from .naive import stops_of

STEP = 1e-3


@functools.lru_cache(maxsize=8)
def model_of(scene):
    """The chain of four bodies of a scene, elastic at its stops. Its links have no moment of inertia:
    the compiler asks for one, the engine does not. Numbers show which motions diverge: nothing is logged."""
    import mujoco

    mujoco.set_mju_user_warning(lambda message: None)
    limits = {k: (lower, upper) for k, lower, upper, _ in stops_of(scene)}
    model = mujoco_model(scene, "RK4", STEP, limits)
    model.body_inertia[:] = 0.0
    return model


class MuJoCo(Subject):
    """MuJoCo's RK4 with steps of 1 ms, of which its documentation says that it is its most accurate."""

    name = "MuJoCo, RK4 of 1 ms"

    def accelerations(self, arm, q, qd, Q, g=0.0):
        import mujoco

        model = model_of(rde.Scene(arm, (rde.effects.Gravity(g),)))
        data, B = mujoco.MjData(model), arm.motor_map
        data.qpos[:], data.qvel[:] = np.asarray(q) @ B, np.asarray(qd) @ B
        data.qfrc_applied[:] = np.linalg.solve(B, Q)
        mujoco.mj_forward(model, data)
        return data.qacc @ np.linalg.inv(B)

    def pose_at(self, scene, start, goal):
        """MuJoCo leaves inverse kinematics to its users."""
        return np.full(4, np.nan)

    def motion(self, run):
        import mujoco

        (q, qd), B, model = run.start(), run.scene.robot.motor_map, model_of(run.scene)
        inverse, steps = np.linalg.inv(B), round(run.scene.control_dt / STEP)
        motion = Motion.begun(q, qd, run.intervals)
        motion.evaluations[:] = 4 * steps
        for lane in range(len(q)):
            data = mujoco.MjData(model)
            data.qpos[:], data.qvel[:] = q[lane] @ B, qd[lane] @ B
            for k in range(run.intervals):
                data.qfrc_applied[:] = run.command(k)[lane]
                mujoco.mj_step(model, data, nstep=steps)
                motion.q[k + 1, lane], motion.qd[k + 1, lane] = data.qpos @ inverse, data.qvel @ inverse
        return motion
