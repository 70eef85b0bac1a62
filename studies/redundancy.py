"""Where redundancy pays: what experts hold that use the null space, what the nearest pose holds, by arm."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from redundant_envs.control.experts import baseline_of, expert_of
from redundant_envs.envs.registration import IDS, full_id, id_of
from redundant_envs.support import palette
from redundant_envs.support.figures import bare, new_figure
from redundant_envs.support.machine import versions
from redundant_envs.support.progress import counted
from redundant_envs.support.tables import markdown
from redundant_envs_train.evidence.runs import read_groups
from redundant_envs_train.rollout import expert_act, run_episodes

TASKS = "ReachAround", "ReachLight", "Track", "TrackAround", "ReachFault"
ARMS = {"4R": "FourR", "RPRP": "RPRP", "2R": "TwoR"}
SEED = 40_000_000
"""Of the first episode: no controller was tuned on these."""
CONTROLLERS = {"nearest pose": baseline_of, "expert": expert_of}
COLUMNS = (
    "machine", "date", "python", "llvmlite", "numpy", "commit", "episodes", "task", "arm", "controller",
    "success", "struck", "ms_per_episode",
)  # fmt: skip


def run(episodes: int, tasks: Sequence[str] = TASKS) -> list[dict[str, Any]]:
    """Run each controller on the same episodes; one row of ``COLUMNS`` for each task, arm and controller. The
    time is that of the process, the simulation included."""
    rows, about = [], versions()
    with counted("controllers", len(tasks) * len(ARMS) * len(CONTROLLERS)) as done:
        for task in tasks:
            for arm, kind in ARMS.items():
                for controller, make in CONTROLLERS.items():
                    began = time.process_time()
                    ends = run_episodes(id_of(kind, task), expert_act(make), episodes, SEED)
                    spent, struck = time.process_time() - began, ends.metrics.get("struck")
                    assert ends.hold is not None
                    rows.append({
                        **about, "episodes": episodes, "task": task, "arm": arm, "controller": controller,
                        "success": round(float(ends.hold.mean()), 4),
                        "struck": "" if struck is None else round(float(struck.mean()), 4),
                        "ms_per_episode": round(1e3 * spent / episodes, 1),
                    })  # fmt: skip
                    done(f"{task}, {arm}, {controller}")
    return rows


def redundancy_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Success in percent, a line for each task."""
    cells = {(r["task"], r["arm"], r["controller"]): f"{100 * float(r['success']):.1f}" for r in rows}
    heads = ("task", *(f"{arm}: {controller}" for arm in ARMS for controller in CONTROLLERS))
    tasks = dict.fromkeys(r["task"] for r in rows)
    return markdown(heads, [(t, *(cells[t, arm, c] for arm in ARMS for c in CONTROLLERS)) for t in tasks])


def learned(places: Iterable[str | Path]) -> dict[tuple[str, str], float]:
    """For each task and arm the success of the learner whose median seed has most."""
    kinds, best = {kind: arm for arm, kind in ARMS.items()}, dict[tuple[str, str], float]()
    for group in read_groups(places):
        kind, task = IDS[full_id(group.environment)]
        key = task, kinds[kind]
        best[key] = max(best.get(key, 0.0), statistics.median(group.numbers("hold_success")))
    return best


def finding(success: Mapping[tuple[str, str, str], float]) -> str:
    """Where the null space buys most, by the successes in percent of tasks, arms and controllers."""
    pairs = {(t, arm) for t, arm, _ in success}
    bought = {pair: success[*pair, "expert"] - success[*pair, "nearest pose"] for pair in pairs}
    task, arm = max(sorted(bought), key=bought.__getitem__)
    whole, near = (success[task, arm, who] for who in ("expert", "nearest pose"))
    return (
        f"In {task} {arm} succeeds in {whole:.0f} % by its null space, in {near:.0f} % from the nearest pose"
    )


def figure(rows: Sequence[Mapping[str, Any]], learners: Mapping[tuple[str, str], float]) -> Any:
    """Success by task and arm: a wide bar of the expert, a narrow one of the nearest pose, a mark of the best
    learner."""
    success = {(r["task"], r["arm"], r["controller"]): 100.0 * float(r["success"]) for r in rows}
    result = new_figure(9.0, 3.6, 120)
    panel, width, (first, *_) = result.subplots(), 0.8 / len(ARMS), ARMS
    for k, (arm, colour) in enumerate(palette.ROBOTS.items()):
        x = [place + (k - (len(ARMS) - 1) / 2) * width for place in range(len(TASKS))]
        whole, near = ([success[task, arm, name] for task in TASKS] for name in ("expert", "nearest pose"))
        marks = [100.0 * learners.get((task, arm), math.nan) for task in TASKS]
        panel.bar(x, whole, 0.92 * width, color=colour, alpha=0.35)
        panel.bar(x, near, 0.4 * width, color=colour, label=arm)
        panel.plot(
            x, marks, "D", color=palette.DARK, mfc="w", ms=5, label="best learner" if arm == first else None
        )
    panel.bar(0, 0, color=palette.DARK, alpha=0.35, label="wide: expert")
    panel.bar(0, 0, color=palette.DARK, label="narrow: nearest pose")
    panel.set_xticks(range(len(TASKS)), TASKS)
    panel.set_ylabel("episodes that succeed, %")
    panel.set_ylim(0.0, 103.0)
    panel.set_title(finding(success), loc="left", fontsize="medium", fontweight="bold")
    bare(panel)
    panel.grid(axis="x", visible=False)
    handles = dict(zip(*reversed(panel.get_legend_handles_labels()), strict=True))
    shown = [*palette.ROBOTS, "wide: expert", "narrow: nearest pose", "best learner"]
    legend = {"loc": "outside lower center", "ncols": len(shown), "frameon": False}
    result.legend([handles[name] for name in shown], shown, **legend)
    return result
