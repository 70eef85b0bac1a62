"""Episodes on given goals, with any source of actions, all in parallel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.computed_torque import ComputedTorque
from redundant_envs.envs.core import Core
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.integrators.tableaus import METHODS

EVALUATION_SEED = 1_000_000
"""Goals of the evaluation: seeds from here on; training stays below."""
SELECTION_SEED = 2_000_000
"""Goals on which checkpoints are chosen."""
STUDY_SEED = 3_000_000
"""Goals of the policy study."""

Act = Callable[[Any, Core, int], NDArray[np.float32]]
"""(observations, core, step) -> actions (n, 4)."""


@dataclass(frozen=True)
class Outcome:
    """Ends of episodes, one entry each."""

    hold: NDArray[np.bool_]
    touch: NDArray[np.bool_]
    distance: NDArray[np.float64]
    returns: NDArray[np.float64]
    numerics: NDArray[np.int64]
    ended: NDArray[np.bool_]
    """Whether numerics ended the episode before its time."""
    steps: NDArray[np.int64]
    """Control steps."""
    evaluations: NDArray[np.int64]
    """Evaluations of the equations of motion."""


def run_episodes(env_id: str, act: Act, episodes: int, seed: int, **kwargs: Any) -> Outcome:
    """Run each episode once, in an environment of its own with seed ``seed + i``."""
    env = make_sb3(env_id, episodes, **kwargs)
    env.seed(seed)
    obs = env.reset()
    ends: list[dict[str, Any]] = [{} for _ in range(episodes)]
    open_lanes = np.ones(episodes, dtype=np.bool_)
    returns = np.zeros(episodes)
    step = 0
    while open_lanes.any():
        obs, rewards, dones, infos = env.step(act(obs, env.core, step))
        returns += rewards * open_lanes
        for lane in np.flatnonzero(dones & open_lanes):
            ends[lane] = infos[lane]
        open_lanes &= ~dones
        step += 1
    scene = env.core.scene
    per_step = scene.substeps * METHODS[scene.integrator].stages  # told where it varies
    steps = np.array([e["episode_steps"] for e in ends])
    return Outcome(
        hold=np.array([e["is_success"] for e in ends]),
        touch=np.array([e["touch_success"] for e in ends]),
        distance=np.array([e["distance"] for e in ends]),
        returns=returns,
        numerics=np.array([e["numerics"] for e in ends]),
        ended=np.array([not e["TimeLimit.truncated"] for e in ends]),
        steps=steps,
        evaluations=np.array(
            [e.get("evaluations", n * per_step) for e, n in zip(ends, steps.tolist(), strict=True)]
        ),
    )


def policy_act(model: Any) -> Act:
    """The deterministic policy of an SB3 model."""

    def act(obs: Any, core: Core, step: int) -> NDArray[np.float32]:
        actions, _ = model.predict(obs, deterministic=True)
        return np.asarray(actions, dtype=np.float32)

    return act


def expert_act() -> Act:
    """The computed-torque expert, planned from the start of each episode."""
    controller: ComputedTorque | None = None

    def act(obs: Any, core: Core, step: int) -> NDArray[np.float32]:
        nonlocal controller
        arm = core.scene.robot
        q, qd = core.memory.read(arm.coordinates), core.memory.read(arm.rates)
        steps = core.memory.read(("steps",))[:, 0]
        if controller is None:
            controller = ComputedTorque(core.scene)
            controller.begin(q, core.goals())
        elif (steps == 0).any():
            begun = np.flatnonzero(steps == 0)
            controller.begin(q[begun], core.goals()[begun], begun)
        return controller.action(steps * core.scene.control_dt, q, qd)

    return act


def zero_act() -> Act:
    """No effort."""
    return lambda obs, core, step: np.zeros((core.num_envs, 4), dtype=np.float32)


def random_act(seed: int = 0) -> Act:
    """Uniform random actions."""
    generator = np.random.default_rng(seed)
    return lambda obs, core, step: generator.uniform(-1, 1, (core.num_envs, 4)).astype(np.float32)
