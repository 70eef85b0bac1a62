"""What learners have learned: whether they end in poses like those of the expert, and why they fail."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.holding import slider_travel
from redundant_envs.envs.core import Core
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.machine import versions
from redundant_envs.support.progress import counted
from redundant_envs.support.tables import markdown
from redundant_envs_train.policies import load_policy
from redundant_envs_train.report import with_efforts
from redundant_envs_train.rollout import Act, EpisodeEnds, expert_act, policy_act, run_episodes
from redundant_envs_train.run_folder import own_config

SEED = 41_000_000
"""Of the first episode: nothing was trained, chosen or tuned on these."""
FAILURES = ("struck", "heavy", "lost")
"""Reasons that tasks tell."""
LIKE = "like_expert_where_held"
COLUMNS = (
    "machine", "date", "python", "llvmlite", "numpy", "commit", "run", "task", "arm",
    "episodes", "held", "expert_held", LIKE, "like_expert_where_missed",
    *FAILURES,
)  # fmt: skip
Array = NDArray[np.float64]


def pose_class(scene: Scene, q: Array) -> NDArray[np.int64]:
    """Number of the class of each pose q (n, joints): on which side of the line from base to tip the middle
    joint is, and for each slider with stops whether it is in the outer half of its travel."""
    points, phi = scene.robot.points(q), q @ scene.robot.motor_map
    (mx, my), (tx, ty) = points[:, points.shape[1] // 2 - 1].T, points[:, -1].T
    bits = [tx * my - ty * mx > 0.0]
    bits += [phi[:, joint] > np.mean(ends) for joint, ends in slider_travel(scene).items()]
    numbers: NDArray[np.int64] = np.transpose(bits) @ (1 << np.arange(len(bits)))
    return numbers


def last_poses(env_id: str, act: Act, episodes: int, **kwargs: Any) -> tuple[EpisodeEnds, Array]:
    """Ends of episodes, and the poses (episodes, joints) in which their last actions began."""
    poses, before = np.zeros((0, 0)), np.full(episodes, -1.0)

    def seen(obs: Any, core: Core, step: int) -> Any:
        nonlocal poses, before
        q, steps = core.memory.read(core.scene.robot.coordinates), core.memory.read(("steps",))[:, 0]
        open_lanes = steps > before  # until an episode is over and another one begins
        poses = np.where(open_lanes[:, None], q, poses) if len(poses) else q
        before = np.where(open_lanes, steps, np.inf)
        return act(obs, core, step)

    return run_episodes(env_id, seen, episodes, SEED, **kwargs), poses


def run(folders: Sequence[Path], episodes: int, trust: bool = False) -> list[dict[str, Any]]:
    """Run the policy of each folder and the expert of its task on the same goals, to rows of ``COLUMNS``."""
    rows, about, experts = [], versions(), dict[str, tuple[EpisodeEnds, Array]]()
    with counted("policies", len(folders)) as done:
        for folder in folders:
            config = own_config(folder)
            act = policy_act(load_policy(folder, config, trust))
            core = make_sb3(config.env, 1, **config.env_kwargs).core
            efforts = with_efforts(config.env_kwargs, core.scene)
            policy, its = last_poses(config.env, act, episodes, **config.env_kwargs)
            key = repr((config.env, {**efforts, "scene": efforts["scene"].to_dict()}))
            if key not in experts:
                experts[key] = last_poses(config.env, expert_act(), episodes, **efforts)
            expert, theirs = experts[key]
            if policy.hold is None or expert.hold is None:
                fix = "give runs of tasks that tell it"
                raise ValueError(f"folders has {folder}, of {config.env}, which tells no success; {fix}")
            same = pose_class(core.scene, its) == pose_class(core.scene, theirs)
            failed = {name: policy.metrics.get(name) for name in FAILURES}
            rows.append({
                **about, "run": folder.name, "task": core.task.name, "arm": core.scene.robot.kind,
                "episodes": episodes, "held": share(policy.hold), "expert_held": share(expert.hold),
                LIKE: share(same[policy.hold & expert.hold]),
                "like_expert_where_missed": share(same[~policy.hold & expert.hold]),
                **{name: "" if flags is None else share(flags > 0.0) for name, flags in failed.items()},
            })  # fmt: skip
            done(folder.name)
    return rows


def share(flags: NDArray[np.bool_]) -> float | str:
    """Share of the true ones; empty if there are none at all."""
    return round(float(flags.mean()), 4) if len(flags) else ""


def poses_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Successes of each seed of a run, and means over its seeds of reasons of failures and of successes in a
    pose like the expert's, in percent."""
    heads = "run", "success", "touched", "heavy", "target lost", "like the expert"
    runs: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        runs.setdefault(re.sub(r" seed=\d+$", "", row["run"]), []).append(row)
    cells = []
    for name, seeds in runs.items():
        columns = [[100 * float(row[c]) for row in seeds if row[c] != ""] for c in (*FAILURES, LIKE)]
        means = [f"{np.mean(column):.1f}" if column else "" for column in columns]
        held = ", ".join(f"{100 * float(row['held']):.1f}" for row in seeds)
        cells.append((f"`{name}`", held, *means))
    return markdown(heads, cells, formatted=True)
