"""Where redundancy pays: what experts hold that use the null space, what the nearest pose holds, by arm."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

from redundant_envs.control.experts import baseline_of, expert_of
from redundant_envs.envs.registration import id_of
from redundant_envs.support.machine import versions
from redundant_envs.support.progress import counted
from redundant_envs.support.tables import markdown
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
