"""What any controller reached under weak motors: hold success of motions that iLQR improved, with the model
and the goal known, beside the goals that can be held at rest. The environment judges: it replays each motion
with its feedback, and success is the task's."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control import ComputedTorque, lightest_pose, pose_at
from redundant_envs.control.holding import effort_limits
from redundant_envs.control.ilqr import Plan, ilqr_plan
from redundant_envs.control.reach_cost import ReachCost
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.machine import versions
from redundant_envs.support.progress import counted
from redundant_envs.support.tables import markdown
from redundant_envs_train.rollout import EVALUATION_SEED, run_episodes
from redundant_envs_train.statistics import wilson
from studies.strength import ARMS, goal_loads, weakened

Array = NDArray[np.float64]

COLUMNS = (
    "machine", "date", "python", "llvmlite", "numpy", "commit", "arm", "factor", "goals", "can_be_held",
    "ilqr", "low", "high", "ilqr_of_those", "ilqr_of_others", "seconds_per_goal",
)  # fmt: skip
FACTORS = (0.6, 0.5, 0.4, 0.3)  # in this order: the motions of stronger motors are a start for weaker ones
INTERVALS, HOLD = (
    100,
    15,
)  # of an episode, and of the rest at its end that the cost asks for; success needs 10
STAGES, ROUNDS = 3, 20  # of each start: after each stage the goals that are held are left out


class Arena:
    """The episodes of an arm with weak motors: goals, starts, and the judge."""

    def __init__(self, arm: str, factor: float, goals: int) -> None:
        self.env_id, name = ARMS[arm]
        self.data, self.count = weakened(name, factor), goals
        env = make_sb3(self.env_id, goals, scene=self.data)
        env.seed(EVALUATION_SEED)
        env.reset()
        self.scene: Scene = env.core.scene
        robot = self.scene.robot
        self.q, self.qd = (env.core.memory.read(names) for names in (robot.coordinates, robot.rates))
        self.goals: Array = env.core.goals()

    def computed_torque(self, pose: Any, lanes: NDArray[np.intp]) -> Array:
        """Actions (INTERVALS, lanes, joints) of computed torque to a pose at the goal."""
        controller, limits = ComputedTorque(self.scene, pose=pose), effort_limits(self.scene)
        controller.begin(self.q[lanes], self.goals[lanes])
        batch, actions = BatchSimulator(self.scene, len(lanes)), []
        batch.set_state(self.q[lanes], self.qd[lanes])
        for k in range(INTERVALS):
            actions.append(controller.action(k * self.scene.control_dt, batch.q, batch.qd).astype(np.float64))
            batch.advance(actions[-1] * limits)
        return np.stack(actions)

    def held(self, plan: Plan, lanes: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Hold success of a plan in the environment, (lanes,)."""
        robot, actions = self.scene.robot, np.zeros((self.count, len(self.scene.robot.joints)), np.float32)

        def act(obs: Any, core: Any, step: int) -> NDArray[np.float32]:
            q, qd = (core.memory.read(names)[lanes] for names in (robot.coordinates, robot.rates))
            actions[lanes] = plan.action(step, q, qd)
            return actions

        outcome = run_episodes(self.env_id, act, self.count, EVALUATION_SEED, scene=self.data)
        assert outcome.hold is not None  # reach tasks tell it
        return outcome.hold[lanes]

    def improved(self, stronger: Array | None) -> tuple[NDArray[np.bool_], Array]:
        """Which goals are held, (goals,), and the actions of the last plan for each goal, from the starts one
        after another."""
        held = np.zeros(self.count, np.bool_)
        last = np.zeros((INTERVALS, self.count, len(self.scene.robot.joints)))
        for begin in (pose_at, lightest_pose, stronger):
            lanes = np.flatnonzero(~held)
            if begin is None or not len(lanes):
                continue
            actions = self.computed_torque(begin, lanes) if callable(begin) else begin[:, lanes]
            for _ in range(STAGES):
                cost = ReachCost(self.scene.robot, self.goals[lanes], HOLD)
                plan = ilqr_plan(self.scene, cost, self.q[lanes], self.qd[lanes], actions, ROUNDS)
                held[lanes] = success = self.held(plan, lanes)
                last[:, lanes] = plan.actions
                lanes, actions = lanes[~success], plan.actions[:, ~success]
                if not len(lanes):
                    break
        return held, last


def ilqr_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows of :func:`run`, or of its CSV file, in percent."""
    shares = {"can_be_held": "goals that can be held at rest", "ilqr": "iLQR holds, of all goals"}
    shares |= {"ilqr_of_those": "of those that can be held at rest", "ilqr_of_others": "of the others"}
    lines = []
    for row in rows:
        cells = ("-" if row[c] in (None, "") else f"{100 * float(row[c]):.0f} %" for c in shares)
        lines.append((row["arm"], f"{float(row['factor']):g}", *cells))
    return markdown(("arm", "limits times", *shares.values()), lines)


def run(arms: Sequence[str], goals: int, factors: Sequence[float] = FACTORS) -> list[dict[str, Any]]:
    """A row for each arm (all, if none is named) and factor of the limits of efforts."""
    for arm in arms:
        if arm not in ARMS:
            raise ValueError(f"arm is {arm!r}; choose {' or '.join(ARMS)}")
    rows = []
    with counted("iLQR", len(factors) * len(arms or ARMS)) as done:
        for arm in arms or ARMS:
            actions: Array | None = None
            before, loads = 1.0, None
            for factor in factors:
                begun, arena = time.perf_counter(), Arena(arm, factor, goals)
                if loads is None:
                    loads, begun = goal_loads(arm, arena.goals), time.perf_counter()
                stronger = None if actions is None else np.clip(actions * before / factor, -1.0, 1.0)
                held, actions = arena.improved(stronger)
                seconds, can, before = time.perf_counter() - begun, loads <= factor, factor
                low, high = wilson(int(held.sum()), goals)
                numbers = (
                    can.mean(), held.mean(), low, high, held[can].mean(),
                    held[~can].mean() if (~can).any() else None, seconds / goals,
                )  # fmt: skip
                rounded = [None if x is None else round(float(x), 4) for x in numbers]
                names = dict(zip(COLUMNS[-len(numbers) :], rounded, strict=True))
                rows.append({**versions(), "arm": arm, "factor": factor, "goals": goals, **names})
                done(f"{arm} {factor:g}")
    return rows
