"""Episodes on given goals, with any source of actions, all in parallel."""

import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from redundant_envs.control.experts import Expert, expert_of
from redundant_envs.envs.core import Core
from redundant_envs.envs.face import numbers_of
from redundant_envs.envs.registration import IDS
from redundant_envs.scenes.scene import Scene
from redundant_envs.scenes.tableaus import METHODS
from redundant_envs.tasks import REGISTRY as TASKS
from redundant_envs.tasks import Task

EVALUATION_SEED = 1_000_000  # first seed of the goals of the evaluation; seeds of the training are smaller
SELECTION_SEED = 2_000_000  # first seed of the goals of the learning curve
OTHERS = "choose zero or random actions, or a trained policy"
STUDY_SEED = 3_000_000  # first seed of the goals of the policy study

SUCCESS = ("is_success", "touch_success", "distance")
"""What a task may tell in ``info``: whether the tip held and touched its goal, and its distance (m)."""

Act = Callable[[Any, Core, int], NDArray[np.float32]]  # (observations, core, step) -> actions (n, joints)


class EpisodeEnds(NamedTuple):
    """Ends of episodes, one entry each; None for what the task does not tell."""

    hold: NDArray[np.bool_] | None
    touch: NDArray[np.bool_] | None
    distance: NDArray[np.float64] | None  # m
    returns: NDArray[np.float64]
    ended: NDArray[np.bool_]  # whether a fault ended the episode before its time
    faults: NDArray[np.int64]  # the faults of the last step, a sum of redundant_envs.Numerics
    steps: NDArray[np.int64]  # control steps
    evaluations: NDArray[np.int64]  # of the equations of motion
    time_to_hold: NDArray[np.float64] | None  # s, from which on the tip stayed at the goal and slow; else NaN
    effort: NDArray[np.float64]  # mean square of the actions, 0 to 1
    smoothness: NDArray[np.float64]  # mean change from an action to the next, 0 to 2: less is smoother
    metrics: Mapping[str, NDArray[np.float64]] = {}  # the task's own, beside those above


def each(function: Callable[[Any], Any], observations: Any) -> Any:
    """Apply a function to an array of observations, or to each array of a goal environment's observations."""
    if isinstance(observations, dict):
        return {name: function(part) for name, part in observations.items()}
    return function(observations)


def stacked(rows: Sequence[Any]) -> Any:
    """Arrays, or dictionaries of arrays, one above the other."""
    if isinstance(rows[0], dict):
        return {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    return np.stack(rows)


def info_names(core: Core) -> list[str]:
    """Names in ``info`` of what the task tells."""
    return [core.task.labels.get(name, name) for name in core.task.metrics]


def run_episodes(env_id: str, act: Act, episodes: int, seed: int, **kwargs: Any) -> EpisodeEnds:
    """Run each episode once, in a separate environment with seed ``seed + i``."""
    from redundant_envs.envs.sb3 import make_sb3  # imports torch

    env = make_sb3(env_id, episodes, **kwargs)
    env.seed(seed)
    obs = env.reset()
    ends: list[dict[str, Any]] = [{} for _ in range(episodes)]
    open_lanes = np.ones(episodes, dtype=np.bool_)
    returns, effort, change = np.zeros(episodes), np.zeros(episodes), np.zeros(episodes)
    held, counts_steps = np.zeros(episodes), "hold" in env.core.task.memory
    decisions = np.zeros(episodes, dtype=np.int64)
    before: NDArray[np.float64] | None = None
    step = 0
    while open_lanes.any():
        actions = act(obs, env.core, step)
        done_by = np.clip(np.nan_to_num(actions), -1.0, 1.0).astype(np.float64)
        effort += open_lanes * np.square(done_by).mean(axis=1)
        if before is not None:
            change += open_lanes * np.abs(done_by - before).mean(axis=1)
        before = done_by
        if counts_steps:
            held = np.where(open_lanes, env.core.memory.read(("hold",))[:, 0], held)
        obs, rewards, dones, infos = env.step(actions)
        returns += rewards * open_lanes
        for lane in np.flatnonzero(dones & open_lanes):
            ends[lane] = infos[lane]
        decisions += open_lanes
        open_lanes &= ~dones
        step += 1
    scene = env.core.scene
    per_step = scene.substeps * METHODS[scene.integrator].stages  # reported only if it varies
    metrics = {name: np.array([end[name] for end in ends]) for name in info_names(env.core)}
    whole = np.array([end["TimeLimit.truncated"] for end in ends])
    steps = np.array([end["episode_steps"] for end in ends])
    hold, touch, distance = (metrics.pop(name, None) for name in SUCCESS)
    time_to_hold = None
    if hold is not None and counts_steps:  # ``held`` counts the steps before the last decision
        last = env.core.decide_every * (decisions - 1)
        time_to_hold = np.where(hold, (last - held) * scene.control_dt, np.nan)
    evaluations = [e.get("evaluations", n * per_step) for e, n in zip(ends, steps.tolist(), strict=True)]
    return EpisodeEnds(
        hold, touch, distance, returns,
        ended=~whole, faults=np.array([end.get("numerics", 0) for end in ends]), steps=steps,
        evaluations=np.array(evaluations), time_to_hold=time_to_hold,
        effort=effort / decisions, smoothness=change / np.maximum(decisions - 1, 1), metrics=metrics,
    )  # fmt: skip


def recorded(spec: EnvSpec, act: Act, episodes: int, seed: int) -> Iterator[tuple[Any, list[Any], Any]]:
    """Run each episode once, with seed ``seed + i``, and give of each one its observations, the arrays of its
    steps, actions first, and its infos; observations and infos begin at the reset."""

    def step_info(info: Any, actions: Any) -> dict[str, Any]:
        effort = np.square(np.clip(actions.astype(np.float64), -1.0, 1.0)).mean(axis=1)
        return {name: info[name] for name in SUCCESS[:1] if name in info} | {"effort": effort, "tip": env.tip}

    env: Any = gym.make_vec(spec, num_envs=episodes)
    obs, info = env.reset(seed=seed)
    seen, infos, steps = [obs], [step_info(info, np.zeros((episodes, 1)))], list[Any]()
    lengths, open_lanes = np.zeros(episodes, np.int64), np.ones(episodes, np.bool_)
    while open_lanes.any():
        actions = act(obs, env.unwrapped.core, len(steps))
        obs, *step, info = env.step(actions)
        seen.append(obs)
        infos.append(step_info(info, actions))
        steps.append((actions, *step))
        lengths += open_lanes
        open_lanes &= ~(step[1] | step[2])
    env.close()
    columns, observations, whole = [*map(np.stack, zip(*steps, strict=True))], stacked(seen), stacked(infos)
    for lane, n in enumerate(lengths.tolist()):
        states = operator.itemgetter((slice(n + 1), lane))
        yield each(states, observations), [part[:n, lane] for part in columns], each(states, whole)


def policy_act(model: Any) -> Act:
    """The deterministic policy of an SB3 model."""

    def act(obs: Any, core: Core, step: int) -> NDArray[np.float32]:
        actions, _ = model.predict(obs, deterministic=True)
        return np.asarray(actions, dtype=np.float32)

    return act


def expert_act(make: Callable[[Task, Scene], Expert] = expert_of) -> Act:
    """The expert of the task, or another one that ``make`` returns, planned when each episode begins."""
    expert: Expert | None = None

    def act(obs: Any, core: Core, step: int) -> NDArray[np.float32]:
        nonlocal expert
        arm = core.scene.robot
        q, qd = core.memory.read(arm.coordinates), core.memory.read(arm.rates)
        steps = core.memory.read(("steps",))[:, 0]
        if expert is None:
            if not core.goal_fields:
                raise ValueError(f"the task {core.task.name} has no goal, which the expert needs; {OTHERS}")
            expert = make(core.task, core.scene)
            expert.begin(q, core.goals(), None, numbers_of(core))
        elif (steps == 0).any():
            begun = np.flatnonzero(steps == 0)
            numbers = {name: values[begun] for name, values in numbers_of(core).items()}
            expert.begin(q[begun], core.goals()[begun], begun, numbers)
        return expert.action(steps * core.scene.control_dt, q, qd)

    return act


def task_of(env_id: str) -> type[Task]:
    """The task of an environment; that of an id that is not registered is the base of all."""
    return TASKS[IDS[env_id].task] if env_id in IDS else Task


def expert_name(env_id: str, entry: str = "expert") -> str:
    """The expert of an environment's task, or its "baseline", in words."""
    task = task_of(env_id)
    is_default = getattr(task, entry) == getattr(Task, entry)
    return "computed torque" if is_default else f"the {entry} of {task.name}"


def random_act(seed: int = 0) -> Act:
    draw = np.random.default_rng(seed).uniform
    return lambda obs, core, step: draw(-1, 1, (core.num_envs, len(core.actions))).astype(np.float32)
