"""Speed of the compiled core: nanoseconds per step of one lane, on one core, beside its dgemm rate."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from redundant_envs.compiler.backends import llvm
from redundant_envs.compiler.backends.processors import AVX2
from redundant_envs.effects import Gravity, LimitSpring, ViscousFriction
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.model.programs import traced_batch
from redundant_envs.robots import RPRP, Arm, Chain, FourR
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.extras import needs
from redundant_envs.support.machine import versions
from redundant_envs.support.progress import counted
from redundant_envs.support.timing import by_turns, seconds
from redundant_envs_train.config import Model, Real, Whole, load_model, number
from studies.speed import dgemm, dgemm_rate, one_core, second_call

with needs("train"):
    from pydantic import model_validator

COLUMNS = (
    "machine", "date", "python", "llvmlite", "numpy", "commit", "dgemm_gflops", "arm", "integrator",
    "lanes", "ns_per_step_best", "ns_per_step_median", "tolerance", "evaluations_mean",
    "share_below_tolerance", "avx2_over_avx512", "compile_seconds",
)  # fmt: skip
DGEMM_TURNS = 20
"""Products of matrices among the timed calls of a case."""
ARMS: dict[str, Callable[[], Arm]] = {
    "FourR": lambda: FourR((0.5,) * 4, (0.25,) * 4),
    "RPRP": lambda: RPRP((0.5,) * 4, (0.25,) * 2),
    "Chain RRRR": lambda: Chain("RRRR", (0.5,) * 4, (0.25,) * 4),
    "Chain RPRP": lambda: Chain("RPRP", (0.5,) * 4, (0.25,) * 2),
}


class Case(Model):
    """What is timed: one step of 1 ms, or with a tolerance a control interval of 20 ms."""

    arm: Literal["FourR", "RPRP", "Chain RRRR", "Chain RPRP"]
    integrator: Literal["euler", "rk4", "rk8"]
    tolerance: Real | None = number(None, 1e-13, 1.0, "tip error per control interval", "m")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.tolerance is not None and self.arm != "FourR":
            problem = f"arm is {self.arm!r} and tolerance is {self.tolerance}"
            raise ValueError(f"{problem}; a tolerance needs FourR")
        return self

    @property
    def scene(self) -> Scene:
        """The arm with gravity, friction and, without a tolerance, limit springs."""
        if self.tolerance is not None:  # links of 1 kg and 0.5 m
            arm = FourR((1.0,) * 4, (0.5,) * 4)
            return Scene(arm, (Gravity(), ViscousFriction(0.1)), tolerance=self.tolerance)
        robot = ARMS[self.arm]()
        limits = (("r1", "r2"), 0.0, 0.25) if robot.sliders() else (("joint2", "joint3"), -2.5, 2.5)
        effects = (Gravity(), ViscousFriction(0.1), *(LimitSpring(joint, *limits[1:]) for joint in limits[0]))
        return Scene(robot, effects, integrator=self.integrator, control_dt=0.001, substeps=1)


class Study(Model):
    """The numbers of the study."""

    lanes: Whole = number(..., 1, 1e6, "lanes of a batch")
    repeats: Whole = number(..., 1, 1e6, "timed calls of each case")
    cases: tuple[Case, ...]


load_study = functools.partial(load_model, Study)


def lively_batch(scene: Scene, lanes: int) -> tuple[BatchSimulator, NDArray[np.float64]]:
    """A batch with uniform angles and normal rates of 4 rad/s; and efforts, on every second lane."""
    rng, batch = np.random.default_rng(0), BatchSimulator(scene, lanes)
    batch.set_state(rng.uniform(-np.pi, np.pi, (lanes, 4)), rng.normal(0.0, 4.0, (lanes, 4)))
    efforts = rng.uniform(-1.0, 1.0, (lanes, 4)) * (20.0, 12.0, 8.0, 4.0)
    efforts[::2] = 0.0
    return batch, efforts


def control_figures(scene: Scene, lanes: int) -> tuple[float, float]:
    """Mean evaluations of an interval, and the share of lanes whose true tip error is in tolerance."""
    fine = dataclasses.replace(scene, tolerance=None, substeps=64)
    tips, evaluations = [], 0.0
    for s in (fine, scene):
        batch, efforts = lively_batch(s, lanes)
        evaluations = float(batch.advance(efforts).evaluations.mean())
        tips.append(scene.robot.forward_kinematics(batch.q))  # type: ignore[attr-defined]
    error = np.linalg.norm(tips[1] - tips[0], axis=1)
    return evaluations, float(np.mean(error < scene.tolerance))


def filled_batch(scene: Scene, lanes: int) -> tuple[BatchSimulator, NDArray[np.float64]]:
    """A batch with random states, and masses and lengths of each lane within 10 % of the scene's; efforts."""
    rng, arm, batch = np.random.default_rng(0), scene.robot, BatchSimulator(scene, lanes)
    for name in ("masses", "lengths"):
        values = getattr(arm, name)
        batch.set_parameters({name: np.multiply(values, rng.uniform(0.9, 1.1, (lanes, len(values))))})
    q = rng.uniform(-np.pi, np.pi, (lanes, len(arm.joints)))
    for k in arm.sliders():
        q[:, k] = rng.uniform(0.0, 0.25, lanes)
    batch.set_state(q, rng.uniform(-1.0, 1.0, q.shape))
    return batch, np.random.default_rng(0).uniform(-1.0, 1.0, q.shape)


def avx2_over_avx512(make: Callable[[], tuple[BatchSimulator, Any]], turns: int) -> float | None:
    """Time with code for AVX2 over that for AVX-512, by turns on one core, the median; None without
    AVX-512."""
    if not llvm.processor().wide:
        return None
    wide = second_call(*make())
    with llvm.target(AVX2):
        narrow = second_call(*make())
    times = by_turns({"narrow": narrow, "wide": wide}, turns)
    return float(np.median(times["narrow"].samples / times["wide"].samples))


def compile_seconds(scene: Scene) -> float:
    """Time from a scene to the machine code of its step, without any cache, s."""
    return seconds(lambda: llvm.object_code(traced_batch(scene, track_work=False).program))


def run(study: Study) -> list[dict[str, Any]]:
    """Time every case of the study; one row of ``COLUMNS`` for each."""
    rows, about = [], versions()
    with one_core(), counted("throughput", len(study.cases)) as done:
        for case in study.cases:
            scene = case.scene
            figures = None if case.tolerance is None else control_figures(scene, study.lanes)
            make = functools.partial(lively_batch if figures else filled_batch, scene, study.lanes)
            # By turns, since the speed of a shared machine changes within seconds.
            times = by_turns(
                {"step": second_call(*make()), "dgemm": dgemm()}, study.repeats, {"dgemm": DGEMM_TURNS}
            )
            rate, step = dgemm_rate(times["dgemm"]), 1e9 / (study.lanes * scene.substeps)
            best = step * float(times["step"].best)
            ratio = avx2_over_avx512(make, study.repeats)
            rows.append({
                **about, "dgemm_gflops": round(rate, 2), "arm": case.arm, "integrator": case.integrator,
                "lanes": study.lanes, "ns_per_step_best": round(best, 2),
                "ns_per_step_median": round(step * float(times["step"].median), 2),
                "tolerance": case.tolerance or "",
                "evaluations_mean": round(figures[0], 2) if figures else "",
                "share_below_tolerance": round(figures[1], 5) if figures else "",
                "avx2_over_avx512": "" if ratio is None else round(ratio, 2),
                "compile_seconds": round(compile_seconds(scene), 2),
            })  # fmt: skip
            to = f" to {case.tolerance} m" if figures else ""
            done(f"{case.arm} {case.integrator}{to} {best:.1f} ns, spread {100 * times['step'].spread:.0f} %")
    return rows
