"""Where learning pays: hold success over the strength of the motors, and the goals that can be held at all by
any controller (``redundant_envs.control.holding_load``). Rows of trained policies are those of their run
folders."""

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control import ComputedTorque, holding_load, lightest_pose, pose_at
from redundant_envs.control.holding import effort_limits, slider_travel
from redundant_envs.effects import EffortLimits
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.scenes.files import text_value
from redundant_envs.scenes.scene import load_scene, scene_at, scene_data
from redundant_envs.support import bounded, palette
from redundant_envs.support.figures import bare, new_figure, save_figure
from redundant_envs.support.progress import counted
from redundant_envs.support.tables import markdown, write_rows
from redundant_envs.support.values import shown
from redundant_envs.tasks.reach import ReachTask
from redundant_envs_train.config import Config, checked, load
from redundant_envs_train.evidence.runs import Run, read_groups
from redundant_envs_train.rollout import EVALUATION_SEED, expert_act, run_episodes
from redundant_envs_train.run_folder import check_study
from redundant_envs_train.statistics import wilson
from redundant_envs_train.training.many import train_many
from redundant_envs_train.training.pool import count_of

ARMS = {"4R": ("redundant_envs/FourRReach-v0", "four_r_reach"),
        "RPRP": ("redundant_envs/RPRPReach-v0", "rprp_reach")}  # fmt: skip
"""For each arm the environment and the scene whose limits have the factor 1."""
WEAK, WEAK_SCENES = 0.5, {"4R": "four_r_weak", "RPRP": "rprp_weak"}
"""Up to this factor the presets are those of the weak scenes, which have it."""
HOLDABLE, EXPERT = "can be held at all", "computed torque"
LIGHTEST = "computed torque to the lightest pose"
POSES: dict[str, Callable[..., Any]] = {EXPERT: pose_at, LIGHTEST: lightest_pose}
"""Poses in which the plans of computed torque end."""
FACTORS = (1.0, 0.8, 0.6, 0.5, 0.4, 0.3)  # effort limits, in units of those of the reach scenes
LEARNERS = ("PPO", "SAC")
COLORS = {EXPERT: palette.EXPERT, LIGHTEST: palette.GREY} | {who: palette.LEARNERS[who] for who in LEARNERS}
"""Colours of all controllers and learners; the share that can be held is a grey area."""
MAX_FACTORS, MAX_FACTOR = 100, 10.0
SAME_GOALS = {"scene", "accuracy", "on_bad_action"}
"""Arguments of an environment that do not change its goals and its hold success."""
TRAINED = ("ppo", "sac")
MARKERS = dict(zip(COLORS, ("o", "v", "s", "^"), strict=True))
"""A marker for each, so that they can be distinguished without colours."""
AREA = palette.css(palette.GRID)

Key = tuple[str, float, str]  # arm, factor and learner of a row


@dataclass(frozen=True)
class Row:
    """One point of the figure; with several seeds their mean, and the union of their intervals."""

    arm: str  # of ARMS
    factor: float  # effort limits / those of the reach scene
    who: str  # HOLDABLE, or a name of COLORS
    hold_success: float  # share of the goals, 0 to 1
    low: float  # ends of its 95 % interval (Wilson)
    high: float
    touch_success: float | None  # share of the goals; None for HOLDABLE
    seeds: int  # of trained policies; 0 without training
    episodes: int  # goals, of each seed


COLUMNS = tuple(field.name for field in dataclasses.fields(Row))  # of the CSV file


def weakened(scene_name: str, factor: float) -> dict[str, Any]:
    """Plain data of a scene, by name or file, whose effort limits are multiplied by a positive factor."""
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
    """Least load of the motors at rest within the task's tolerance of each goal, (n,), as hold success
    requires it: with limits times f, the goals with loads of at most f can be held."""
    scene = load_scene(ARMS[arm][1])
    reach = sum(scene.robot.lengths) + sum(high for _, high in slider_travel(scene).values())
    return holding_load(scene, goals, ReachTask().goal_tolerance * reach)


def expert_rows(
    arm: str, factors: Sequence[float] = FACTORS, episodes: int = 1000, seed: int = EVALUATION_SEED
) -> list[Row]:
    """Shares of the goals of seeds from ``seed`` that can be held, and that computed torque holds."""
    env_id, scene = ARMS[arm]
    loads = goal_loads(arm, frozen_goals(arm, episodes, seed))
    rows = []
    for factor in factors:
        rows.append(Row(arm, factor, HOLDABLE, *_share(loads <= factor), None, 0, episodes))
        for who, pose in POSES.items():
            act, weak = expert_act(_computed_torque(pose)), weakened(scene, factor)
            outcome = run_episodes(env_id, act, episodes, seed, scene=weak)
            assert outcome.hold is not None
            assert outcome.touch is not None  # reach tasks tell both
            touched = float(outcome.touch.mean())
            rows.append(Row(arm, factor, who, *_share(outcome.hold), touched, 0, episodes))
    return rows


def _computed_torque(pose: Callable[..., Any]) -> Callable[[Any, Any], ComputedTorque]:
    return lambda task, scene: ComputedTorque(scene, pose=pose)


def _share(held: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Share and its 95 % interval, whose ends rounding puts on the wrong side of 0 and 1."""
    share = float(held.mean())
    low, high = wilson(int(held.sum()), len(held))
    return share, min(low, share), max(high, share)


def learner_rows(places: Sequence[Path]) -> list[Row]:
    """Rows of evaluated runs: one for the seeds of an arm, factor and learner. ValueError for another task,
    or a scene that is no reach scene with all limits times one factor."""
    rows: dict[Key, Row] = {}
    for same in read_groups(places) if places else ():
        run, seeds = same.runs[0], [one.evaluation for one in same.runs]
        arm = next((arm for arm, (env, _) in ARMS.items() if env == run.env), None)
        if arm is None:
            known = " or ".join(env for env, _ in ARMS.values())
            raise ValueError(f"{run.folder} is of {run.env}; give {known}")
        if run.learner not in COLORS:
            raise ValueError(f"{run.folder} is a run of {run.learner}; give {', '.join(LEARNERS)}")
        key = arm, _factor(run, arm), run.learner
        if key in rows:
            raise ValueError(f"{run.folder} has other settings than other runs; give runs of one setting")
        held, touched = (float(np.mean(same.numbers(f"{name}_success"))) for name in ("hold", "touch"))
        low, high = zip(*(one["interval"] for one in seeds), strict=True)
        goals = run.evaluation["episodes"]
        rows[key] = Row(*key, held, min(*low, held), max(*high, held), touched, len(seeds), goals)
    return [rows[key] for key in sorted(rows)]


def _factor(run: Run, arm: str) -> float:
    """Effort limits of a run's scene / those of the reach scene of its arm."""
    env_kwargs = run.settings["env_kwargs"]
    for name in env_kwargs:
        if name not in SAME_GOALS:
            why = f"env_kwargs has {name!r}, so its goals or episodes are others"
            raise ValueError(f"{run.folder}: {why}; leave it out")
    strong = scene_at(ARMS[arm][1], env_kwargs.get("accuracy"))
    scene = load_scene(run.scene)
    ratios = effort_limits(scene) / effort_limits(strong)
    rest, rest_of_strong = scene.to_dict(), strong.to_dict()
    for data in (rest, rest_of_strong):
        data["effects"] = [e for e in data["effects"] if e["type"] != EffortLimits.__name__]
    if np.ptp(ratios) > 1e-9 * ratios[0] or rest != rest_of_strong:
        raise ValueError(
            f"{run.folder}: its scene has {', '.join(f'{r:g}' for r in ratios)} times the limits of "
            f"{ARMS[arm][1]}, or differs in something else; give {ARMS[arm][1]} with all limits times "
            "one factor"
        )
    return float(round(ratios[0], 9))


def read_rows(path: Path) -> list[Row]:
    """The rows of a CSV file of ``COLUMNS``; ValueError with file and line for others."""
    rows = []
    for count, values in enumerate(bounded.read_rows(path, "table"), 2):
        if tuple(values) != COLUMNS:
            raise ValueError(f"{path} has the columns {shown(list(values))}; give {', '.join(COLUMNS)}")
        try:
            cells: Any = {k: text_value(cell, k) if cell else None for k, cell in values.items()}
            rows.append(Row(**cells))
        except (ValueError, TypeError) as error:
            raise ValueError(f"{path}, line {count}: {error}; write the file again") from error
    return rows


def trainings(factors: Sequence[float], seeds: Sequence[int]) -> dict[str, tuple[Key, Config]]:
    """Row and configuration of each learner by the name of its folder: presets with scaled effort limits."""
    chosen = {}
    for arm, (_, scene) in ARMS.items():
        for learner in TRAINED:
            for factor in factors:
                preset = load(f"{scene if factor > WEAK else WEAK_SCENES[arm]}_{learner}").to_dict()
                data = scene_data(scene) if factor == 1.0 else weakened(scene, factor)
                for seed in seeds:
                    config = {**preset, "seed": seed, "env_kwargs": {"scene": data}}
                    run = checked(Config, config)
                    key = (arm, factor, run.label)
                    chosen[f"{arm.lower()}_{learner}_{factor!r}_seed{seed}"] = key, run
    return chosen


def factors_of(text: str) -> tuple[float, ...]:
    """Factors of the effort limits as a user writes them, ``0.6,0.5``."""
    try:
        factors = tuple(round(float(part), 6) for part in text.split(","))
    except ValueError:
        factors = ()
    valid = 1 <= len(set(factors)) == len(factors) <= MAX_FACTORS
    if not valid or not all(0.0 < factor <= MAX_FACTOR for factor in factors):
        raise ValueError(
            f"factors is {shown(text)}; give different numbers above 0 and up to {MAX_FACTOR:g}, such "
            "as 0.6,0.5"
        )
    return factors


def run_study(
    factors: Sequence[float], seeds: Sequence[int], episodes: int, runs: Sequence[Path],
    processes: int | None, out: Path,
) -> str:  # fmt: skip
    """Train what is missing, and write strength.csv and strength.png into ``out``; returns a Markdown table.
    Without ``seeds`` nothing is trained, nor is a learner for which ``runs`` have an arm and factor; finished
    runs in ``out`` are kept. ``episodes`` are the goals of computed torque and of the share that can be
    held."""
    if not 2 <= episodes <= 1_000_000:
        raise ValueError(f"episodes is {episodes}; give a whole number from 2 to 1000000")
    if processes is not None:
        count_of(processes)
    run_rows = learner_rows(runs)
    path = out / "strength.csv"
    check_study(out, [path.name])
    before = read_rows(path) if path.is_file() else []
    if path.is_file() and not before:
        raise ValueError(f"out is {out}, whose {path.name} has no rows of a study; choose another --out")
    rows = [row for row in before if not row.seeds]
    asked = itertools.product(ARMS, factors, (HOLDABLE, *POSES), [episodes])
    if {(row.arm, row.factor, row.who, row.episodes) for row in rows} != {*asked}:
        rows = []
        with counted("computed torque, and what can be held", len(ARMS)) as done:
            for arm in ARMS:
                rows += expert_rows(arm, factors, episodes)
                done(arm)
        write_rows(map(dataclasses.asdict, rows), COLUMNS, path)
    known = {(row.arm, row.factor, row.who) for row in run_rows}
    chosen = {name: config for name, (key, config) in trainings(factors, seeds).items() if key not in known}
    if chosen:
        train_many(chosen, out / "runs", processes)
    trained = learner_rows([out / "runs" / name for name in chosen])
    rows = [*rows, *(row for row in (*run_rows, *trained) if row.factor in factors)]
    write_rows(map(dataclasses.asdict, rows), COLUMNS, path)
    save_figure(figure(rows), out / "strength.png")
    return strength_table(rows)


def strength_table(rows: Sequence[Row]) -> str:
    """Hold success in percent, a line for each arm and factor."""
    who = list(dict.fromkeys(row.who for row in rows))
    by_key = {(row.arm, row.factor, row.who): row for row in rows}
    lines = []
    for arm, factor in dict.fromkeys((row.arm, row.factor) for row in rows):
        cells = []
        for name in who:
            row = by_key.get((arm, factor, name))
            more = f" ({row.seeds} seed{'s' * (row.seeds > 1)})" if row and row.seeds else ""
            cells.append(f"{100 * row.hold_success:.1f} %{more}" if row else "-")
        lines.append((arm, f"{factor:g}", *cells))
    return markdown(("arm", "limits times", *who), lines)


def finding(rows: Sequence[Row]) -> str:
    """Where the learners hold most goals more than computed torque, of the rows of one arm."""
    of_factor: dict[float, dict[str, float]] = {}
    for row in rows:
        of_factor.setdefault(row.factor, {})[row.who] = 100.0 * row.hold_success
    both = {f: held for f, held in of_factor.items() if EXPERT in held and held.keys() & {*LEARNERS}}
    if not both:
        return ""
    learned = {f: max((who for who in LEARNERS if who in both[f]), key=both[f].__getitem__) for f in both}
    most = max(both, key=lambda f: both[f][learned[f]] - both[f][EXPERT])
    who, held = learned[most], both[most]
    return f": at {most:g} of the strength {who}\nholds {held[who]:.0f} %, {EXPERT} {held[EXPERT]:.0f} %"


def figure(rows: Sequence[Row]) -> Any:
    """A panel for each arm: hold success [%] over the factor of the effort limits; a grey area can be held at
    all."""
    arms = [arm for arm in ARMS if any(row.arm == arm for row in rows)]
    result = new_figure(4.0 * len(arms) + 0.6, 4.1, 120)
    panels = result.subplots(1, len(arms), sharey=True, squeeze=False)[0]
    handles: dict[str, Any] = {}
    for panel, arm in zip(panels, arms, strict=True):
        for who in (HOLDABLE, *COLORS):
            curve = sorted((r for r in rows if (r.arm, r.who) == (arm, who)), key=lambda row: row.factor)
            x, y = [row.factor for row in curve], [100.0 * row.hold_success for row in curve]
            if curve and who == HOLDABLE:
                handles[who] = panel.fill_between(x, 0.0, y, color=AREA, linewidth=0.0)
            elif curve:
                low, high = ([100.0 * getattr(row, end) for row in curve] for end in ("low", "high"))
                panel.fill_between(x, low, high, color=COLORS[who], alpha=0.2, linewidth=0.0)
                look = {"color": COLORS[who], "marker": MARKERS[who], "markersize": 4.5, "linewidth": 1.8}
                (handles[who],) = panel.plot(x, y, **look)
        factors = sorted({row.factor for row in rows if row.arm == arm})
        panel.set_xticks(factors, [f"{factor:g}" for factor in factors])
        title = f"{arm}{finding([row for row in rows if row.arm == arm])}"
        panel.set_title(title, loc="left", fontsize="medium", fontweight="bold")
        panel.set_xlabel("effort limits, as a share of those of the reach scene")
        bare(panel)
    panels[0].set_ylabel("goals held, %")
    panels[0].set_ylim(0.0, 103.0)
    shown = [who for who in (HOLDABLE, *COLORS) if who in handles]
    result.legend([handles[who] for who in shown], shown, loc="outside lower center", ncols=3, frameon=False)
    return result
