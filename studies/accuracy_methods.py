"""Configurations of the accuracy study: ours, MuJoCo's and SciPy's, with the same methods each.

``motion`` gives q and qd after a duration [s], (n, 4), and the mean evaluations of a control interval;
and ``timer`` a function that measures s of one core per control interval of one arm.
"""

from __future__ import annotations

import dataclasses
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from redundant_envs.model.batch import BatchSimulator
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.timing import seconds
from studies import peers
from studies.accuracy_config import MuJoCoSweep, OurSweep, Panel, States, Study
from studies.accuracy_metrics import stops
from studies.speed import second_call

Array = NDArray[np.float64]

EVALUATIONS = {"Euler": 1, "implicitfast": 1, "implicit": 1, "RK4": 4}
"""Evaluations of the right-hand side in one MuJoCo step."""


def brief(x: float) -> str:
    """A number in few characters: "0.01", "1e-9"."""
    return f"{x:.3g}".replace("e-0", "e-")


def _milliseconds(seconds: float) -> str:
    return f"{brief(1e3 * seconds)} ms"


@dataclass(frozen=True)
class Ours:
    """The compiled core with equal steps, or error-controlled."""

    integrator: str
    control_dt: float
    substeps: int = 1
    tolerance: float | None = None

    peer: ClassVar[str] = ""

    @property
    def line(self) -> str:
        return self.integrator if self.tolerance is None else f"{self.integrator}, error-controlled"

    @property
    def setting(self) -> str:
        if self.tolerance is None:
            return f"{self.substeps} x {_milliseconds(self.control_dt / self.substeps)}"
        return f"tolerance {brief(1e3 * self.tolerance)} mm"

    def scene(self, scene: Scene) -> Scene:
        """The scene with this stepping."""
        stepping = {name: getattr(self, name) for name in ("integrator", "substeps", "tolerance")}
        return dataclasses.replace(scene, **stepping)

    def batch(self, scene: Scene, start: States) -> BatchSimulator:
        """A simulator with these states."""
        batch = BatchSimulator(self.scene(scene), len(start[0]))
        batch.set_state(*start[:2])
        return batch

    def motion(self, scene: Scene, start: States, seconds: float) -> tuple[Array, Array, float]:
        batch = self.batch(scene, start)
        intervals = round(seconds / scene.control_dt)
        evaluations = [batch.advance(start[2]).evaluations.mean() for _ in range(intervals)]
        return batch.q, batch.qd, float(np.mean(evaluations))

    def timer(self, scene: Scene, start: States) -> Callable[[], float]:
        sample = second_call(self.batch(scene, start), start[2])
        return lambda: sample() / len(start[0])


@dataclass(frozen=True)
class MuJoCo:
    """MuJoCo with equal steps, many of them in one call from C, without its timers; ``states`` motions of
    ``steps`` steps are a sample of its cost. Stops are springs without damping of ``stiffness`` / step^2."""

    integrator: str
    control_dt: float
    substeps: int
    states: int
    steps: int
    stiffness: float

    peer: ClassVar[str] = "mujoco"

    @property
    def line(self) -> str:
        return f"MuJoCo {self.integrator}"

    @property
    def setting(self) -> str:
        return f"{self.substeps} x {_milliseconds(self.control_dt / self.substeps)}"

    def model(self, scene: Scene) -> Any:
        """MuJoCo's model, with springs at the stops."""
        dt = self.control_dt / self.substeps
        solref = -self.stiffness / dt**2, 0.0
        return peers.mujoco_model(scene, self.integrator, dt, stops(scene), solref)

    def motion(self, scene: Scene, start: States, seconds: float) -> tuple[Array, Array, float]:
        q, qd, _ = peers.mujoco_motion(scene, self.model(scene), start, seconds)
        return q, qd, float(EVALUATIONS[self.integrator] * self.substeps)

    def timer(self, scene: Scene, start: States) -> Callable[[], float]:
        model = self.model(scene)
        few = start[0][: self.states], start[1][: self.states], np.zeros((len(start[0][: self.states]), 4))

        def sample() -> float:
            spent = peers.mujoco_motion(scene, model, few, self.steps * model.opt.timestep)[2]
            return float(spent.mean()) * self.substeps / self.steps

        return sample


@dataclass(frozen=True)
class SciPy:
    """SciPy's solve_ivp on all states as one system."""

    method: str
    rtol: float

    peer: ClassVar[str] = "scipy"

    @property
    def line(self) -> str:
        return f"SciPy {self.method}"

    @property
    def setting(self) -> str:
        return f"rtol {brief(self.rtol)}"

    def motion(self, scene: Scene, start: States, seconds: float) -> tuple[Array, Array, float]:
        q, qd, evaluations = peers.scipy_motion(scene, self.method, self.rtol, start, seconds, together=True)
        return q, qd, float(evaluations.mean()) * scene.control_dt / seconds

    def timer(self, scene: Scene, start: States) -> Callable[[], float]:
        few = start[0], start[1], np.zeros_like(start[0])
        return lambda: seconds(self.motion, scene, few, scene.control_dt) / len(few[0])


Method = Ours | MuJoCo | SciPy


def installed(peer: str) -> bool:
    """Whether a peer of the extra "verify" can be imported."""
    return importlib.util.find_spec(peer) is not None


def our_methods(study: Study, sweep: OurSweep) -> list[Ours]:
    """Ours, of the study or of its long runs."""
    dt = study.control_dt
    fixed = {name: values for name, values in sweep if name != "tolerance"}
    return [
        *(Ours(name, dt, value) for name, values in fixed.items() for value in values),
        *(Ours("rk8", dt, tolerance=value) for value in sweep.tolerance),
    ]


def mujoco_methods(study: Study, panel: Panel, sweep: MuJoCoSweep) -> list[MuJoCo]:
    """MuJoCo's, if it is installed and can simulate the panel."""
    if not ("mujoco" in panel.peers and installed("mujoco")):
        return []
    more = study.timing.mujoco_states, study.timing.mujoco_steps, study.mujoco_stiffness
    return [MuJoCo(name, study.control_dt, value, *more) for name, values in sweep for value in values]


def panel_methods(study: Study, panel: Panel) -> list[Method]:
    """All configurations of a panel whose package is installed."""
    methods: list[Method] = [*our_methods(study, study.ours), *mujoco_methods(study, panel, study.mujoco)]
    if "scipy" in panel.peers and installed("scipy"):
        methods += [SciPy(name, rtol) for name, rtols in study.scipy for rtol in rtols]
    return methods


def long_methods(study: Study, panel: Panel) -> list[Ours | MuJoCo]:
    """The configurations with which the long motions are measured."""
    long = study.long_runs
    return [*our_methods(study, long.ours), *mujoco_methods(study, panel, long.mujoco)]
