"""Accuracy against cost, ours and the peers': above all the tip error after one control interval from
thousands of random states, the only error of the state that is free of chaos, against its cost on one
core."""

from __future__ import annotations

import importlib.metadata
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.scenes.scene import Scene
from redundant_envs.support.machine import versions
from redundant_envs.support.progress import counted
from redundant_envs.support.timing import by_turns
from studies import accuracy_metrics as metrics
from studies import peers
from studies.accuracy_config import PEERS, Panel, States, Study
from studies.accuracy_methods import Method, MuJoCo, Ours, installed, long_methods, panel_methods
from studies.another_account import contact_motion
from studies.speed import dgemm, dgemm_rate, one_core

Array = NDArray[np.float64]
Row = dict[str, Any]

STAMP = ("machine", "date", "python", "llvmlite", "numpy", "mujoco", "scipy", "commit", "dgemm_gflops")
WHAT = ("panel", "peer", "method", "setting")
COLUMNS = (
    *STAMP, *WHAT, "ns_best", "ns_median", "evaluations", "tip_mm_median", "tip_mm_p99", "tip_mm_max",
    "q_p99", "qd_p99", "floor_mm",
)  # fmt: skip
LONG_COLUMNS = *STAMP, *WHAT, "energy_rate_median", "energy_rate_95"
ROUNDS_PER_DGEMM = 2
DGEMM = -1
"""Stands for the product of matrices among the numbers of configurations."""


class Agreement(NamedTuple):
    """Largest distance of another method from the reference after a control interval."""

    by: str
    states: int
    metres: float
    digits: float  # decimal digits of the tip's position that agree


class PanelResult(NamedTuple):
    """Results of a panel, from a run or, but for the last one, from its tables."""

    panel: Panel
    rows: list[Row]  # of COLUMNS, one for each configuration
    long_rows: list[Row]  # of LONG_COLUMNS
    floor: float  # error of the reference itself, m: smaller ones cannot be measured
    agreements: Sequence[Agreement] = ()  # with itself with twice the steps, then with others


def run(study: Study) -> list[PanelResult]:
    """The whole study; reports its progress on standard error."""
    total = sum(1 + len(panel_methods(study, p)) + len(long_methods(study, p)) for p in study.panels)
    with one_core(), counted("accuracy", total) as done:
        return [run_panel(study, panel, study.seed + i, done) for i, panel in enumerate(study.panels)]


def run_panel(study: Study, panel: Panel, seed: int, done: Callable[[str], None]) -> PanelResult:
    """Measure everything on one panel."""
    scene = panel.scene(study.control_dt, **study.reference.scene)
    start = panel.states(study.states, seed)
    reference = metrics.end(scene, start, study.control_dt)
    agreements = check_reference(study, panel, scene, start, reference[0])
    done(f"{panel.name}: reference")
    rounds, rows, long_rows = study.timing.rounds, list[Row](), list[Row]()
    samplers, fewer = {DGEMM: dgemm()}, {DGEMM: max(4, rounds // ROUNDS_PER_DGEMM)}
    for k, method in enumerate(panel_methods(study, panel)):
        count = study.scipy_states if method.peer == "scipy" else study.states
        some: States = (start[0][:count], start[1][:count], start[2][:count])
        known = reference[0][:count], reference[1][:count]
        rows.append({**name(panel, method), **interval_errors(method, scene, some, known)})
        samplers[k] = method.timer(scene, some)
        fewer |= {k: study.timing.scipy_rounds} if method.peer == "scipy" else {}
        done(f"{panel.name}: error of {method.line}, {method.setting}")
    methods = long_methods(study, panel)

    def go_on(turns: int) -> None:
        """Measure long motions between the rounds, since the speed of a machine changes within seconds."""
        for method in methods[len(long_rows) : round(len(methods) * turns / rounds)]:
            long_rows.append({**name(panel, method), **energy_rates(study, panel, method, scene, start)})
            done(f"{panel.name}: long motions of {method.line}, {method.setting}; timing")

    times = by_turns(samplers, rounds, fewer, done=go_on)
    for k, row in enumerate(rows):
        row["ns_best"] = round(1e9 * float(times[k].best), 2)
        row["ns_median"] = round(1e9 * float(times[k].median), 2)
    floor = max(a.metres for a in agreements)
    stamp = {**versions(), "dgemm_gflops": round(dgemm_rate(times[DGEMM]), 2)}
    stamp |= {peer: importlib.metadata.version(peer) if installed(peer) else "" for peer in PEERS}
    for row in (*rows, *long_rows):
        row.update(stamp)
    for row in rows:
        row["floor_mm"] = 1e3 * floor
    return PanelResult(panel, rows, long_rows, floor, agreements)


def name(panel: Panel, method: Method) -> Row:
    """Columns that identify a row."""
    return {"panel": panel.name, "peer": method.peer, "method": method.line, "setting": method.setting}


def check_reference(
    study: Study, panel: Panel, scene: Scene, start: States, reference: Array
) -> list[Agreement]:
    """The reference against a finer one, and against others on the first states."""
    count = study.reference.states
    few: States = (start[0][:count], start[1][:count], start[2][:count])
    arm: Any = scene.robot
    reach = float(np.linalg.norm(arm.forward_kinematics(reference), axis=1).max())

    def agreement(by: str, q: Array) -> Agreement:
        metres = float(metrics.tip_error(scene, q, reference[: len(q)]).max())
        return Agreement(by, len(q), metres, metrics.digits(metres, reach))

    seconds, substeps = scene.control_dt, max(64, 2 * scene.substeps)
    other = panel.scene(seconds, integrator="rk8", substeps=substeps)
    agreements = [agreement(f"rk8, {other.substeps} steps", metrics.end(other, start, seconds)[0])]
    rtol, stops = study.reference.scipy_rtol, metrics.stops(scene)
    if stops is not None and installed("scipy"):
        q = contact_motion(scene, few, rtol)
        agreements.append(agreement(f"SciPy's DOP853 with events, rtol {rtol:.0e}", q))
    elif "scipy" in panel.peers and installed("scipy"):
        q = peers.scipy_motion(scene, "DOP853", rtol, few, seconds)[0]
        agreements.append(agreement(f"SciPy's DOP853, rtol {rtol:.0e}", q))
    if stops is None and "mujoco" in panel.peers and installed("mujoco"):
        dt = seconds / study.reference.mujoco_steps
        q = peers.mujoco_motion(scene, peers.mujoco_model(scene, "RK4", dt), few, seconds)[0]
        agreements.append(agreement(f"MuJoCo's RK4, {1e3 * dt:.3g} ms", q))
    return agreements


def interval_errors(method: Method, scene: Scene, start: States, reference: tuple[Array, Array]) -> Row:
    """Errors after one control interval, and its number of evaluations."""
    q, qd, evaluations = method.motion(scene, start, scene.control_dt)
    tip = 1e3 * metrics.tip_error(scene, q, reference[0])
    shares = {"median": 0.5, "p99": 0.99, "max": 1.0}
    return {
        "evaluations": round(evaluations, 2),
        **{f"tip_mm_{name}": metrics.quantile(tip, share) for name, share in shares.items()},
        "q_p99": metrics.quantile(metrics.largest_error(q, reference[0]), 0.99),
        "qd_p99": metrics.quantile(metrics.largest_error(qd, reference[1]), 0.99),
    }


def energy_rates(study: Study, panel: Panel, method: Ours | MuJoCo, scene: Scene, start: States) -> Row:
    """Change of the energy of free motions per second, relative to what raises the stretched arm upright."""
    if not metrics.keeps_energy(scene):
        return {}
    long = study.long_runs
    q, qd, efforts = (x[: long.states] for x in start)
    ends = method.motion(scene, (q, qd, np.zeros_like(efforts)), long.seconds)[:2]
    scale = metrics.energy_scale(scene, 0.5 * np.add(panel.low, panel.high)) * long.seconds
    rates = np.abs(metrics.energy(scene, *ends) - metrics.energy(scene, q, qd)) / scale
    shares = {"median": 0.5, "95": 0.95}
    return {f"energy_rate_{name}": metrics.quantile(rates, share) for name, share in shares.items()}


class Answer(NamedTuple):
    """Cost of an error: the cheapest rows whose 99th percentile is below it; None if there are none."""

    threshold_mm: float
    ours: Row | None
    mujoco: Row | None

    @property
    def ratio(self) -> float:
        """Ratio of MuJoCo's cost to ours; NaN if one of both does not reach the error."""
        if self.ours is None or self.mujoco is None:
            return math.nan
        return float(self.mujoco["ns_best"] / self.ours["ns_best"])


def cheapest(rows: Sequence[Row], peer: str, threshold_mm: float) -> Row | None:
    """The cheapest row whose 99th percentile of the tip error is below a threshold, or None."""
    enough = [r for r in rows if r["peer"] == peer and r["tip_mm_p99"] < threshold_mm]
    return min(enough, key=lambda r: float(r["ns_best"]), default=None)


def answers(rows: Sequence[Row], thresholds_mm: Sequence[float]) -> list[Answer]:
    """One for each threshold, from the rows of one panel."""
    return [Answer(x, cheapest(rows, "", x), cheapest(rows, "mujoco", x)) for x in thresholds_mm]
