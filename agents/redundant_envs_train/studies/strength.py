"""Where learning pays: hold success over the strength of the motors, and the goals that can be held at all.

Every effort limit of a reach scene is multiplied by a factor. The share of goals that can be held at all
needs no controller (``redundant_envs.control.holding``); computed torque needs no training; rows of trained
policies are merged from their run folders.
"""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.computed_torque import lightest_pose, pose_at
from redundant_envs.control.holding import holding_load
from redundant_envs.control.statics import effort_limits, slider_travel
from redundant_envs.effects import EffortLimits
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.robots.parameters import number
from redundant_envs.scene import Scene, load_scene, scene_at, scene_data
from redundant_envs.tasks.reach import ReachTask
from redundant_envs.values import shown

from ..evidence.curves import LEARNER_COLORS
from ..evidence.run_table import read_runs, value_of
from ..evidence.runs import Run
from ..rollout import EVALUATION_SEED, expert_act, run_episodes
from ..run_folder import evaluate_anew
from ..statistics import wilson
from .factors import FACTORS

ARMS = {"4R": ("redundant_envs/FourRReach-v0", "four_r_reach"),
        "RPRP": ("redundant_envs/RPRPReach-v0", "rprp_reach")}  # fmt: skip
"""For each arm the environment and the scene whose limits have the factor 1."""
HOLDABLE, EXPERT = "can be held at all", "computed torque"
LIGHTEST = "computed torque to the lightest pose"
POSES = {EXPERT: pose_at, LIGHTEST: lightest_pose}
"""Poses in which the plans of computed torque end."""
LEARNERS = ("PPO", "SAC")
COLORS = {EXPERT: "#000000", LIGHTEST: "#7F7F7F"} | {who: LEARNER_COLORS[who] for who in LEARNERS}
"""Colours of all controllers and learners; the share that can be held is a grey area."""
ROUNDING = 1e-9
SAME_GOALS = {"scene", "accuracy", "on_bad_action"}
"""Arguments of an environment that do not change its goals and its hold success."""


@dataclass(frozen=True)
class Row:
    """One point of the figure.

    Attributes
    ----------
    arm : {"4R", "RPRP"}
    factor : float
        Effort limits / those of the reach scene.
    who : str
        HOLDABLE, or a name of COLORS.
    hold_success, low, high : float
        Share of the goals and its 95 % interval (Wilson), 0 to 1. With several seeds it is their mean, and
        low and high are the ends of the union of their intervals.
    touch_success : float or None
        Share of the goals that were touched; None for :data:`HOLDABLE`.
    seeds : int
        Of trained policies; 0 without training.
    episodes : int
        Goals, of each seed; the fewest if seeds differ.
    """

    arm: str
    factor: float
    who: str
    hold_success: float
    low: float
    high: float
    touch_success: float | None
    seeds: int
    episodes: int

    def __post_init__(self) -> None:
        for name, valid in (("arm", ARMS), ("who", (HOLDABLE, *COLORS))):
            if getattr(self, name) not in valid:
                raise ValueError(f"{name} is {shown(getattr(self, name))}; choose {', '.join(valid)}")
        if not number("factor", self.factor) > 0.0:
            raise ValueError(f"factor is {self.factor}; it must be positive")
        if not 0.0 <= self.low <= self.hold_success <= self.high <= 1.0:
            raise ValueError(
                f"hold_success is {self.hold_success} in {self.low} to {self.high}; give shares from 0 to 1 "
                "with low <= hold_success <= high"
            )


COLUMNS = tuple(field.name for field in dataclasses.fields(Row))
"""Of the CSV file."""


def weakened(scene_name: str, factor: float) -> dict[str, Any]:
    """Plain data of a scene whose effort limits are multiplied by a factor.

    Parameters
    ----------
    scene_name : str
        A name or the path of a YAML file.
    factor : float
        Positive.

    Raises
    ------
    ValueError
        If the factor is not positive, or the scene has no EffortLimits.
    """
    if not number("factor", factor) > 0.0:
        raise ValueError(f"factor is {factor}; it must be positive")
    limits = effort_limits(load_scene(scene_name))
    data: dict[str, Any] = scene_data(scene_name)
    for effect in data["effects"]:
        if effect["type"] == EffortLimits.__name__:
            effect["limits"] = (factor * limits).tolist()
    return data


def frozen_goals(arm: str, episodes: int, seed: int = EVALUATION_SEED) -> NDArray[np.float64]:
    """Goals of the environments with the seeds seed, seed + 1, ..., (episodes, 2), m."""
    env = make_sb3(ARMS[arm][0], episodes)
    env.seed(seed)
    env.reset()
    goals: NDArray[np.float64] = env.core.goals()
    return goals


def goal_loads(arm: str, goals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Least load of the motors at rest within the task's tolerance of each goal, (n,).

    Hold success requires the tip within the tolerance, and so does this. With limits times f, the goals with
    loads of at most f can be held.
    """
    scene = load_scene(ARMS[arm][1])
    reach = sum(scene.robot.lengths) + sum(high for _, high in slider_travel(scene).values())
    return holding_load(scene, goals, ReachTask().goal_tolerance * reach)


def expert_rows(
    arm: str, factors: Sequence[float] = FACTORS, episodes: int = 1000, seed: int = EVALUATION_SEED
) -> list[Row]:
    """Shares that can be held at all, and that computed torque holds with either plan, on the same goals.

    Parameters
    ----------
    arm : {"4R", "RPRP"}
    factors : sequence of float
    episodes : int
    seed : int
        Of the first environment; episode i has the goal of seed + i.
    """
    if arm not in ARMS:
        raise ValueError(f"arm is {shown(arm)}; choose {', '.join(ARMS)}")
    env_id, scene = ARMS[arm]
    loads = goal_loads(arm, frozen_goals(arm, episodes, seed))
    rows = []
    for factor in factors:
        rows.append(Row(arm, factor, HOLDABLE, *_share(loads <= factor), None, 0, episodes))
        for who, pose in POSES.items():
            outcome = run_episodes(env_id, expert_act(pose), episodes, seed, scene=weakened(scene, factor))
            touched = float(outcome.touch.mean())
            rows.append(Row(arm, factor, who, *_share(outcome.hold), touched, 0, episodes))
    return rows


def _share(held: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Share and its 95 % interval, whose ends rounding puts on the wrong side of 0 and 1."""
    share = float(held.mean())
    low, high = wilson(int(held.sum()), len(held))
    return share, min(low, share), max(high, share)


def learner_rows(places: Sequence[Path]) -> list[Row]:
    """Rows of evaluated runs: those of one arm, factor and learner are seeds of one row.

    ``places`` are run folders and tables of runs, as in :func:`read_runs`.

    Raises
    ------
    ValueError
        If a run has another task, or another scene than a reach scene with all limits times one factor; or
        a place is not an evaluated run.
    """
    found: dict[tuple[str, float, str], list[Run]] = {}
    for run in read_runs(places) if places else ():
        arm = next((arm for arm, (env, _) in ARMS.items() if env == run.env), None)
        if arm is None:
            known = " or ".join(env for env, _ in ARMS.values())
            raise ValueError(f"{run.folder} is of {run.env}; give {known}")
        if run.learner not in COLORS:
            raise ValueError(f"{run.folder} is a run of {run.learner}; give {', '.join(LEARNERS)}")
        key = (arm, _factor(run, arm), run.learner)
        same = found.setdefault(key, [])
        if run.seed in [other.seed for other in same]:
            raise ValueError(f"{run.folder} is a second run of seed {run.seed}; leave one out")
        same.append(run)
        own = [{k: v for k, v in r.settings.items() if k != "env_kwargs"} for r in (same[0], run)]
        if own[0] != own[1]:
            raise ValueError(
                f"{run.folder} has other settings than {same[0].folder}; give runs of one setting"
            )
    return [
        Row(
            *key,
            hold_success=float(np.mean([run.evaluation["hold_success"] for run in runs])),
            low=min(_ends(run)[0] for run in runs),
            high=max(_ends(run)[1] for run in runs),
            touch_success=float(np.mean([run.evaluation["touch_success"] for run in runs])),
            seeds=len(runs),
            episodes=min(run.evaluation["episodes"] for run in runs),
        )
        for key, runs in sorted(found.items())
    ]


def _ends(run: Run) -> tuple[float, float]:
    """The interval of a run, whose ends rounding may put on the wrong side of its hold success."""
    (low, high), hold = run.evaluation["interval"], run.evaluation["hold_success"]
    if not low - ROUNDING <= hold <= high + ROUNDING:
        raise ValueError(
            f"{run.folder}/evaluation.json has the hold success {hold:g} outside its interval {low:g} to "
            f"{high:g}; make it again: {evaluate_anew(run.folder)}"
        )
    return min(low, hold), max(high, hold)


def _factor(run: Run, arm: str) -> float:
    """Effort limits of a run's scene / those of the reach scene of its arm."""
    env_kwargs = run.settings["env_kwargs"]
    for name in env_kwargs:
        if name not in SAME_GOALS:
            raise ValueError(
                f"{run.folder}: env_kwargs has {name!r}, so its goals or episodes are others; leave it out"
            )
    strong = scene_at(ARMS[arm][1], env_kwargs.get("accuracy"))
    scene = load_scene(run.scene)
    ratios = effort_limits(scene) / effort_limits(strong)
    others = [_without_limits(s) for s in (scene, strong)]
    if np.ptp(ratios) > 1e-9 * ratios[0] or others[0] != others[1]:
        raise ValueError(
            f"{run.folder}: its scene has {', '.join(f'{r:g}' for r in ratios)} times the limits of "
            f"{ARMS[arm][1]}, or differs in something else; give {ARMS[arm][1]} with all limits times "
            "one factor"
        )
    return float(round(ratios[0], 9))


def _without_limits(scene: Scene) -> dict[str, Any]:
    """A scene without the numbers of its effort limits."""
    data = scene.to_dict()
    effects = [e for e in data["effects"] if e["type"] != EffortLimits.__name__]
    return {**data, "effects": effects}


def read_rows(path: Path) -> list[Row]:
    """The rows of a CSV file of ``COLUMNS``; ValueError with file and line for others."""
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        if tuple(reader.fieldnames or ()) != COLUMNS:
            raise ValueError(f"{path} has the columns {shown(reader.fieldnames)}; give {', '.join(COLUMNS)}")
        rows = []
        for values in reader:
            try:
                cells: dict[str, Any] = {k: value_of(cell) if cell else None for k, cell in values.items()}
                rows.append(Row(**cells))
            except (ValueError, TypeError) as error:
                raise ValueError(f"{path}, line {reader.line_num}: {error}; write the file again") from error
    return rows
