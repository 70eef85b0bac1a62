"""Speed of the compiled core: nanoseconds per step of one lane, on one core, beside its dgemm rate."""

from __future__ import annotations

import dataclasses
import functools
import platform
import re
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.backends import llvm
from redundant_envs.backends.processors import AVX2
from redundant_envs.effects import Gravity, LimitSpring, ViscousFriction
from redundant_envs.files import exists, explained, read_yaml
from redundant_envs.machine import versions
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.model.programs import batch_simulator, traced_batch
from redundant_envs.progress import counted
from redundant_envs.robots import RPRP, Arm, Chain, FourR
from redundant_envs.scene import Scene
from redundant_envs.values import check_keys, shown
from studies.timing import dgemm_rate, one_core

COLUMNS = (
    "machine", "date", "python", "llvmlite", "numpy", "commit", "dgemm_gflops", "arm", "integrator",
    "lanes", "ns_per_step_best", "ns_per_step_median", "bar_ns", "scaled_bar_ns", "within_bar",
    "tolerance", "evaluations_mean", "bar_evaluations", "share_below_tolerance",
    "packed_instructions", "vector_register", "avx2_over_avx512", "compile_seconds",
)  # fmt: skip
CASE = ("arm", "integrator", "bar_ns")
"""Keys of every case of the study; a case with error control also has these."""
CONTROLLED = ("tolerance", "bar_evaluations")
PACKED = re.compile(r"^\s+v?[a-z0-9]+pd\s.*?%?\b([xyz])mm\d", re.MULTILINE)
REGISTERS = {"z": "zmm", "y": "ymm", "x": "xmm"}
"""Vector registers, widest first."""


def load_config(path: Path) -> dict[str, Any]:
    """Numbers of the study, checked: lanes, repeats, bar_gflops [1e9/s], cases."""
    if not exists(path):
        raise ValueError(f"config is {shown(str(path))}; there is no such file")
    data = read_yaml(path, "config")
    with explained(path):
        return checked_config(data)


def checked_config(data: Any) -> dict[str, Any]:
    """Numbers of the study from plain data."""
    if not isinstance(data, Mapping):
        raise ValueError(f"config is {shown(data)}; give a mapping with lanes, repeats, bar_gflops and cases")
    names = ["lanes", "repeats", "cases", "bar_gflops"]
    check_keys("config", data, names)
    for name in names:
        if name not in data:
            raise ValueError(f"config lacks {name!r}; give all of {', '.join(names)}")
    for name in ("lanes", "repeats"):
        if isinstance(data[name], bool) or not isinstance(data[name], int) or data[name] < 1:
            raise ValueError(f"config.{name} is {shown(data[name])}; give a whole number of at least 1")
    if not isinstance(data["cases"], list | tuple):
        raise ValueError(f"config.cases is {shown(data['cases'])}; give a list of mappings")
    for i, case in enumerate(data["cases"]):
        if not isinstance(case, Mapping):
            raise ValueError(f"config.cases[{i}] is {shown(case)}; give a mapping with {', '.join(CASE)}")
        check_keys(f"config.cases[{i}]", case, [*CASE, *CONTROLLED])
        needed = (*CASE, *(CONTROLLED if any(name in case for name in CONTROLLED) else ()))
        for name in needed:
            if name not in case:
                raise ValueError(f"config.cases[{i}] lacks {name!r}; give {', '.join(needed)}")
    return dict(data)


def study_scene(arm: str, integrator: str) -> Scene:
    """The scene that is timed: an arm with gravity, friction and limit springs, one step of 1 ms."""
    masses = (0.5,) * 4
    arms: dict[str, Callable[[], Arm]] = {
        "FourR": lambda: FourR(masses, (0.25,) * 4),
        "RPRP": lambda: RPRP(masses, (0.25,) * 2),
        "Chain RRRR": lambda: Chain("RRRR", masses, (0.25,) * 4),
        "Chain RPRP": lambda: Chain("RPRP", masses, (0.25,) * 2),
    }
    if arm not in arms:
        raise ValueError(f"arm is {arm!r}; choose {', '.join(arms)}")
    robot = arms[arm]()
    if robot.sliders():
        springs = [LimitSpring(joint, 0.0, 0.25) for joint in ("r1", "r2")]
    else:
        springs = [LimitSpring(joint, -2.5, 2.5) for joint in ("joint2", "joint3")]
    effects = (Gravity(), ViscousFriction(0.1), *springs)  # type: ignore[arg-type]
    return Scene(robot, effects, integrator=integrator, control_dt=0.001, substeps=1)


def controlled_scene(arm: str, tolerance: float) -> Scene:
    """The scene whose error control is timed: 1 kg and 0.5 m links, gravity, friction, 20 ms."""
    if arm != "FourR":
        raise ValueError(f"arm is {arm!r}; error control is timed with FourR")
    robot = FourR((1.0,) * 4, (0.5,) * 4)
    return Scene(robot, (Gravity(), ViscousFriction(0.1)), tolerance=tolerance)  # type: ignore[arg-type]


def lively_states(lanes: int, seed: int = 0) -> tuple[NDArray[np.float64], ...]:
    """Angles uniform, rates normal with 4 rad/s, and efforts on every second lane: (lanes, 4) each."""
    rng = np.random.default_rng(seed)
    q, qd = rng.uniform(-np.pi, np.pi, (lanes, 4)), rng.normal(0.0, 4.0, (lanes, 4))
    efforts = rng.uniform(-1.0, 1.0, (lanes, 4)) * (20.0, 12.0, 8.0, 4.0)
    efforts[::2] = 0.0
    return q, qd, efforts


def lively_batch(scene: Scene, lanes: int) -> BatchSimulator:
    q, qd, _ = lively_states(lanes)
    batch = BatchSimulator(scene, lanes)
    batch.set_state(q, qd)
    return batch


def control_figures(scene: Scene, lanes: int) -> tuple[float, float]:
    """Mean evaluations of an interval, and the share of lanes whose true tip error is in tolerance."""
    q, qd, efforts = lively_states(lanes)
    fine = dataclasses.replace(scene, tolerance=None, substeps=64)
    tips, evaluations = [], 0.0
    for s in (fine, scene):
        batch = BatchSimulator(s, lanes)
        batch.set_state(q, qd)
        evaluations = float(batch.advance(efforts).evaluations.mean())
        tips.append(scene.robot.forward_kinematics(batch.q))  # type: ignore[attr-defined]
    error = np.linalg.norm(tips[1] - tips[0], axis=1)
    return evaluations, float(np.mean(error < scene.tolerance))


def filled_batch(scene: Scene, lanes: int, seed: int = 0) -> BatchSimulator:
    """A batch with random states, and masses and lengths of each lane within 10 % of the scene's."""
    rng = np.random.default_rng(seed)
    batch = BatchSimulator(scene, lanes)
    arm = scene.robot
    batch.set_parameters(
        {
            "masses": np.multiply(arm.masses, rng.uniform(0.9, 1.1, (lanes, arm.num_masses))),
            "lengths": np.multiply(arm.lengths, rng.uniform(0.9, 1.1, (lanes, len(arm.lengths)))),
        }
    )
    q = rng.uniform(-np.pi, np.pi, (lanes, len(arm.joints)))
    for k in arm.sliders():
        q[:, k] = rng.uniform(0.0, 0.25, lanes)
    batch.set_state(q, rng.uniform(-1.0, 1.0, q.shape))
    return batch


def advance_times(
    batch: BatchSimulator, repeats: int, efforts: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Seconds of each of ``repeats`` calls of advance, (repeats,).

    Each is the second of two calls from the same snapshot: in normal use calls follow each other, while
    restoring a snapshot replaces the caches.
    """
    if efforts is None:
        efforts = np.random.default_rng(0).uniform(-1.0, 1.0, batch.q.shape)
    snapshot = batch.save()
    times = np.empty(repeats)
    for i in range(repeats):
        batch.restore(snapshot)
        batch.advance(efforts)
        start = time.process_time()
        batch.advance(efforts)
        times[i] = time.process_time() - start
    batch.restore(snapshot)
    return times


def interleaved(
    batch: BatchSimulator, repeats: int, efforts: NDArray[np.float64] | None = None, parts: int = 4
) -> tuple[NDArray[np.float64], float]:
    """Seconds of each call of advance, (repeats,), and the best dgemm rate before, between and after.

    They alternate, because the speed of a shared machine changes within seconds.
    """
    rates, times = [dgemm_rate()], []
    for part in np.array_split(np.arange(repeats), min(parts, repeats)):
        times.append(advance_times(batch, len(part), efforts))
        rates.append(dgemm_rate())
    return np.concatenate(times), max(rates)


def avx2_over_avx512(make: Callable[[], BatchSimulator], repeats: int, efforts: Any) -> float | None:
    """Time with code for AVX2 over time with code for AVX-512, alternating on the same core, the median.

    None on a processor without AVX-512.
    """
    if not llvm.processor().wide:
        return None
    wide = make()
    with llvm.target(AVX2):
        narrow = make()
    turns = [
        (advance_times(narrow, 4, efforts), advance_times(wide, 4, efforts)) for _ in range(repeats // 8 + 1)
    ]
    return float(np.median([a.min() / b.min() for a, b in turns]))


def compile_seconds(scene: Scene) -> float:
    """Time from a scene to the machine code of its step, without any cache, s."""
    start = time.process_time()
    llvm.object_code(traced_batch(scene, track_work=False).program)
    return time.process_time() - start


def packed_instructions(scene: Scene) -> tuple[int | None, str]:
    """Packed double instructions in the assembly of ``advance``, and the widest register among them.

    Returns (None, "") if the processor is not x86.
    """
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return None, ""
    found = PACKED.findall(llvm.assembly(batch_simulator(scene, track_work=False).program))
    return len(found), next((REGISTERS[r] for r in "zyx" if r in found), "")


def run(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Time every case of the study; one row of ``COLUMNS`` for each."""
    rows, about = [], versions()
    with one_core(), counted("throughput", len(config["cases"])) as done:
        for case in config["cases"]:
            lanes, efforts, figures = config["lanes"], None, None
            if "tolerance" in case:
                scene = controlled_scene(case["arm"], case["tolerance"])
                figures = control_figures(scene, lanes)
                *_, efforts = lively_states(lanes)
                make = functools.partial(lively_batch, scene, lanes)
            else:
                scene = study_scene(case["arm"], case["integrator"])
                make = functools.partial(filled_batch, scene, lanes)
            batch = make()
            seconds, rate = interleaved(batch, config["repeats"], efforts)
            nanoseconds = 1e9 * seconds / (config["lanes"] * scene.substeps)
            best = float(nanoseconds.min())
            scaled = case["bar_ns"] * config["bar_gflops"] / rate
            count, register = packed_instructions(scene)
            ratio = avx2_over_avx512(make, config["repeats"], efforts)
            rows.append(
                {
                    **about,
                    "dgemm_gflops": round(rate, 2),
                    "arm": case["arm"],
                    "integrator": case["integrator"],
                    "lanes": config["lanes"],
                    "ns_per_step_best": round(best, 2),
                    "ns_per_step_median": round(float(np.median(nanoseconds)), 2),
                    "bar_ns": case["bar_ns"],
                    "scaled_bar_ns": round(scaled, 2),
                    "within_bar": best <= scaled,
                    "tolerance": case.get("tolerance", ""),
                    "evaluations_mean": round(figures[0], 2) if figures else "",
                    "bar_evaluations": case.get("bar_evaluations", ""),
                    "share_below_tolerance": round(figures[1], 5) if figures else "",
                    "packed_instructions": "" if count is None else count,
                    "vector_register": register,
                    "avx2_over_avx512": "" if ratio is None else round(ratio, 2),
                    "compile_seconds": round(compile_seconds(scene), 2),
                }
            )
            to = f" to {case['tolerance']} m" if figures else ""
            done(f"{case['arm']} {case['integrator']}{to} {best:.1f} ns")
    return rows
