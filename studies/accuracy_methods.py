"""Configurations of the accuracy study: ours, MuJoCo's and SciPy's, with the same three methods each."""

from __future__ import annotations

import dataclasses
import importlib.util
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from redundant_envs.model.batch import BatchSimulator
from redundant_envs.model.trajectory import simulate
from redundant_envs.scene import Scene
from studies import peers
from studies.accuracy_config import TOLERANCE, Panel, States, Study
from studies.accuracy_metrics import stops

Array = NDArray[np.float64]

Impacts = list[tuple[int, float]] | None
"""Index of a motion, and the time at which one of its sliders met a stop, s; in the order of time."""

EVALUATIONS = {"Euler": 1, "implicitfast": 1, "implicit": 1, "RK4": 4}
"""Evaluations of the right-hand side in one MuJoCo step."""


class Method(Protocol):
    """One configuration of an integrator, ours or a peer's."""

    peer: ClassVar[str]
    """Package that it belongs to, "" for ours."""

    @property
    def line(self) -> str:
        """Name of its line in the figures."""

    @property
    def setting(self) -> str:
        """Name of its point on the line."""

    def motion(self, scene: Scene, start: States, seconds: float) -> tuple[Array, Array, float]:
        """q and qd after a duration [s], (n, 4), and the mean evaluations of a control interval."""

    def timer(self, scene: Scene, start: States) -> Callable[[], float]:
        """A function that measures once more, ns of one core per control interval of one arm."""


class LongMethod(Method, Protocol):
    """A configuration with which long motions are measured."""

    def path(self, scene: Scene, start: States, seconds: float, samples: int) -> tuple[Array, Impacts]:
        """q of a motion without efforts at equal times, (T, n, 4); and its impacts, if they are known."""


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
        return dataclasses.replace(
            scene, integrator=self.integrator, substeps=self.substeps, tolerance=self.tolerance
        )

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

    def path(self, scene: Scene, start: States, seconds: float, samples: int) -> tuple[Array, Impacts]:
        times = np.linspace(0.0, seconds, samples + 1)[1:]
        motion = simulate(self.scene(scene), *start[:2], times)
        return motion.q, [(e.lane, e.time) for e in motion.events if "impact" in e.kind]

    def timer(self, scene: Scene, start: States) -> Callable[[], float]:
        batch = self.batch(scene, start)
        snapshot, efforts = batch.save(), np.ascontiguousarray(start[2])

        def sample() -> float:
            # The second of two calls is timed: restoring a snapshot has just replaced the caches.
            batch.restore(snapshot)
            batch.advance(efforts)
            before = time.process_time()
            batch.advance(efforts)
            return 1e9 * (time.process_time() - before) / batch.num_envs

        return sample


@dataclass(frozen=True)
class MuJoCo:
    """MuJoCo with equal steps, many of them in one call from C, without its timers.

    ``states`` motions of ``steps`` steps each make one sample of its cost. Stops are springs without damping
    of ``stiffness`` / step^2.
    """

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

    def stops(self, scene: Scene) -> tuple[dict[int, tuple[float, float]] | None, tuple[float, float]]:
        """Limits of the joints and their solref, in MuJoCo's direct form."""
        return stops(scene), (-self.stiffness * (self.substeps / self.control_dt) ** 2, 0.0)

    def motion(self, scene: Scene, start: States, seconds: float) -> tuple[Array, Array, float]:
        dt = scene.control_dt / self.substeps
        ends = peers.mujoco_interval(scene, self.integrator, dt, start, seconds, *self.stops(scene))
        return *ends, float(EVALUATIONS[self.integrator] * self.substeps)

    def path(self, scene: Scene, start: States, seconds: float, samples: int) -> tuple[Array, Impacts]:
        # Whole steps only: a long step gives fewer samples.
        steps = max(1, round(seconds / samples * self.substeps / scene.control_dt))
        interval = steps * scene.control_dt / self.substeps
        q, qd, rest = start[0], start[1], np.zeros_like(start[0])
        path = []
        for _ in range(round(seconds / interval)):
            q, qd, _ = self.motion(scene, (q, qd, rest), interval)
            path.append(q)
        return np.array(path), None

    def timer(self, scene: Scene, start: States) -> Callable[[], float]:
        dt = scene.control_dt / self.substeps
        few = (start[0][: self.states], start[1][: self.states], start[2][: self.states])

        def sample() -> float:
            per_second = peers.mujoco_cost(
                scene, self.integrator, dt, few, self.steps * dt, 1, *self.stops(scene)
            )
            return per_second * scene.control_dt

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
        q, qd, evaluations = peers.scipy_interval(
            scene, self.method, self.rtol, self.rtol, start, seconds, together=True
        )
        return q, qd, float(evaluations.mean()) * scene.control_dt / seconds

    def timer(self, scene: Scene, start: States) -> Callable[[], float]:
        dt = scene.control_dt

        def sample() -> float:
            per_second = peers.scipy_cost(
                scene, self.method, self.rtol, self.rtol, start, dt, repeats=1, together=True
            )
            return per_second * dt

        return sample


def installed(peer: str) -> bool:
    """Whether a peer of the extra "verify" can be imported."""
    try:
        return importlib.util.find_spec(peer) is not None
    except ImportError:
        return False


def our_methods(study: Study, sweep: Mapping[str, Any]) -> list[Ours]:
    """Ours, from integrator -> substeps and "tolerance" -> tolerances."""
    dt = study.control_dt
    return [
        Ours("rk8", dt, tolerance=value) if name == TOLERANCE else Ours(name, dt, value)
        for name, values in sweep.items()
        for value in values
    ]


def mujoco_methods(study: Study, sweep: Mapping[str, Any]) -> list[MuJoCo]:
    """MuJoCo's, from integrator -> steps per control interval."""
    timing = study.timing
    return [
        MuJoCo(
            name, study.control_dt, value, timing.mujoco_states, timing.mujoco_steps, study.mujoco_stiffness
        )
        for name, values in sweep.items()
        for value in values
    ]


def panel_methods(study: Study, panel: Panel) -> list[Method]:
    """All configurations of a panel whose package is installed."""
    methods: list[Method] = [*our_methods(study, study.ours)]
    if "mujoco" in panel.peers and installed("mujoco"):
        methods += mujoco_methods(study, study.mujoco)
    if "scipy" in panel.peers and installed("scipy"):
        methods += [SciPy(name, rtol) for name, rtols in study.scipy.items() for rtol in rtols]
    return methods


def long_methods(study: Study, panel: Panel) -> list[LongMethod]:
    """The configurations with which the long motions are measured."""
    methods: list[LongMethod] = [*our_methods(study, study.long_runs.ours)]
    if "mujoco" in panel.peers and installed("mujoco"):
        methods += mujoco_methods(study, study.long_runs.mujoco)
    return methods
