"""Configuration of the accuracy study, from YAML: panels, configurations, references; typed and checked."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from redundant_envs.files import exists, explained, read_yaml
from redundant_envs.numerics.tableaus import METHODS
from redundant_envs.robots.parameters import number, numbers
from redundant_envs.scene import Scene
from redundant_envs.values import check_keys, shown
from studies.peers import MUJOCO_INTEGRATORS

Array = NDArray[np.float64]
States = tuple[Array, Array, Array]
"""q, qd and joint efforts, (n, 4) each: rad and m, 1/s, N m and N."""

PEERS = ("mujoco", "scipy")
SCIPY_METHODS = ("RK45", "DOP853")
TOLERANCE = "tolerance"
"""The key, among our integrators, of error-controlled rk8."""
OURS = (*METHODS, TOLERANCE)
T = TypeVar("T")


def build(kind: type[T], where: str, data: Any) -> T:
    """A dataclass from a mapping; unknown and missing keys are errors that list the valid ones."""
    fields = dataclasses.fields(kind)  # type: ignore[arg-type]
    names = [f.name for f in fields]
    if isinstance(data, kind):
        return data
    if not isinstance(data, Mapping):
        raise ValueError(f"{where} is {shown(data)}; give a mapping with {', '.join(names)}")
    check_keys(where, data, names)
    for f in fields:
        if f.name not in data and f.default is dataclasses.MISSING:
            raise ValueError(f"{where} lacks {f.name!r}; give all of {', '.join(names)}")
    return kind(**data)


def whole(field: str, value: Any) -> int:
    """A whole number of at least 1."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise ValueError(f"{field} is {shown(value)}; give a whole number of at least 1")
    return value


def positive(field: str, value: Any) -> float:
    """A positive finite number."""
    x = number(field, value)
    if x <= 0.0:
        raise ValueError(f"{field} is {x}; it must be positive")
    return x


def sweeps(field: str, data: Any, valid: Sequence[str]) -> dict[str, tuple[float, ...]]:
    """Name -> settings: whole numbers of steps, except for tolerances."""
    if not isinstance(data, Mapping):
        raise ValueError(f"{field} is {shown(data)}; give lists of settings by name: {', '.join(valid)}")
    check_keys(field, data, list(valid))
    checked: dict[str, tuple[float, ...]] = {}
    for name, values in data.items():
        at = f"{field}.{name}"
        if isinstance(values, str) or not isinstance(values, Sequence) or not values:
            raise ValueError(f"{at} is {shown(values)}; give a list of settings")
        check = positive if name in (TOLERANCE, *SCIPY_METHODS) else whole
        checked[name] = tuple(check(f"{at}[{i}]", value) for i, value in enumerate(values))
    return checked


@dataclass(frozen=True)
class Panel:
    """A scene and the distribution of its states.

    Parameters
    ----------
    name, about : str
        Title, and a description of the states in a few words.
    robot, effects :
        As in the file of a scene.
    low, high : (4,)
        Coordinates are uniform between them, rad and m.
    rate_sd : (4,)
        Velocities are normal around zero, rad/s and m/s.
    effort_sd : (4,)
        So are the joint efforts, N m and N ...
    effort_share : float
        ... of this share of the states; the others have none.
    peers : sequence of {"mujoco", "scipy"}
        Peers that can simulate the scene.
    bar : float, optional
        Goal for the ratio of MuJoCo's cost to ours at every threshold.
    """

    name: str
    about: str
    robot: Mapping[str, Any]
    effects: Sequence[Mapping[str, Any]]
    low: tuple[float, ...]
    high: tuple[float, ...]
    rate_sd: tuple[float, ...]
    effort_sd: tuple[float, ...]
    effort_share: float
    peers: tuple[str, ...]
    bar: float | None = None

    def __post_init__(self) -> None:
        for name in ("low", "high", "rate_sd", "effort_sd"):
            object.__setattr__(self, name, numbers(f"{self.name}.{name}", getattr(self, name), 4))
        if not 0.0 <= number(f"{self.name}.effort_share", self.effort_share) <= 1.0:
            raise ValueError(f"{self.name}.effort_share is {self.effort_share}; it must lie in 0 to 1")
        for peer in self.peers:
            if peer not in PEERS:
                raise ValueError(f"{self.name}.peers has {peer!r}; choose {', '.join(PEERS)}")
        object.__setattr__(self, "peers", tuple(self.peers))
        if self.bar is not None:
            object.__setattr__(self, "bar", positive(f"{self.name}.bar", self.bar))

    def scene(self, control_dt: float, **stepping: Any) -> Scene:
        """The scene with the given stepping."""
        return Scene.from_dict(
            {"robot": self.robot, "effects": self.effects, "control_dt": control_dt, **stepping}
        )

    def states(self, count: int, seed: int) -> States:
        """Random states; the same for the same seed."""
        rng = np.random.default_rng(seed)
        q = rng.uniform(self.low, self.high, (count, 4))
        qd = rng.normal(0.0, self.rate_sd, (count, 4))
        efforts = rng.normal(0.0, self.effort_sd, (count, 4))
        efforts[rng.uniform(size=count) >= self.effort_share] = 0.0
        return q, qd, efforts


@dataclass(frozen=True)
class Reference:
    """The reference for errors, and the other methods that check it.

    Parameters
    ----------
    scene : mapping
        Integrator, substeps or tolerance of the reference.
    states : int
        Number of states that the other methods check.
    mujoco_steps : int
        RK4 steps of the check by MuJoCo per control interval.
    scipy_rtol : float
        Of the check by SciPy's DOP853.
    """

    scene: Mapping[str, Any]
    states: int
    mujoco_steps: int
    scipy_rtol: float

    def __post_init__(self) -> None:
        whole("reference.states", self.states)
        whole("reference.mujoco_steps", self.mujoco_steps)
        positive("reference.scipy_rtol", self.scipy_rtol)


@dataclass(frozen=True)
class LongRuns:
    """Motions beyond a control interval, without efforts.

    Parameters
    ----------
    states : int
    seconds : float
        Length of the motions whose energy and momentum are measured, s.
    lyapunov_seconds : float
        Length of the motions on which the exponent is measured, s.
    lyapunov_times : sequence of floats
        Times of the errors, in units of 1/exponent.
    ours, mujoco : mapping
        The configurations of the study that are used.
    """

    states: int
    seconds: float
    lyapunov_seconds: float
    lyapunov_times: tuple[float, ...]
    ours: Mapping[str, Any]
    mujoco: Mapping[str, Any]

    def __post_init__(self) -> None:
        whole("long_runs.states", self.states)
        for name in ("seconds", "lyapunov_seconds"):
            object.__setattr__(self, name, positive(f"long_runs.{name}", getattr(self, name)))
        times = tuple(positive("long_runs.lyapunov_times", x) for x in self.lyapunov_times)
        object.__setattr__(self, "lyapunov_times", times)
        for name, valid in (("ours", OURS), ("mujoco", MUJOCO_INTEGRATORS)):
            object.__setattr__(self, name, sweeps(f"long_runs.{name}", getattr(self, name), valid))


@dataclass(frozen=True)
class Timing:
    """Rounds of timing, every configuration once in each; SciPy, the slowest, only in the first few.

    ``mujoco_states`` motions of ``mujoco_steps`` steps in one call are a sample of MuJoCo's cost.
    """

    rounds: int
    scipy_rounds: int
    mujoco_states: int
    mujoco_steps: int

    def __post_init__(self) -> None:
        for f in dataclasses.fields(self):
            whole(f"timing.{f.name}", getattr(self, f.name))


@dataclass(frozen=True)
class Study:
    """The whole study.

    Parameters
    ----------
    control_dt : float
        Control interval, s.
    states, scipy_states : int
        States per panel, and the number of those that SciPy simulates.
    seed : int
        Of the states of the first panel; each further panel has the next seed.
    thresholds_mm : sequence of floats
        Errors in the table of costs, mm.
    ours : mapping
        Integrator -> equal steps per control interval; "tolerance" -> m of tip error.
    mujoco : mapping
        Integrator -> steps per control interval.
    mujoco_stiffness : float
        Of MuJoCo's elastic stops, in 1/step^2: the shorter the step, the stiffer they can be.
    scipy : mapping
        Method -> relative and absolute tolerances.
    """

    control_dt: float
    states: int
    scipy_states: int
    seed: int
    thresholds_mm: tuple[float, ...]
    ours: Mapping[str, Any]
    mujoco: Mapping[str, Any]
    mujoco_stiffness: float
    scipy: Mapping[str, Any]
    reference: Reference
    long_runs: LongRuns
    timing: Timing
    panels: tuple[Panel, ...]

    def __post_init__(self) -> None:
        for name in ("control_dt", "mujoco_stiffness"):
            object.__setattr__(self, name, positive(name, getattr(self, name)))
        for name in ("states", "scipy_states"):
            whole(name, getattr(self, name))
        for name, kind in (("reference", Reference), ("long_runs", LongRuns), ("timing", Timing)):
            object.__setattr__(self, name, build(kind, name, getattr(self, name)))  # type: ignore[arg-type]
        for name, valid in (
            ("ours", OURS), ("mujoco", MUJOCO_INTEGRATORS), ("scipy", SCIPY_METHODS),
        ):  # fmt: skip
            object.__setattr__(self, name, sweeps(name, getattr(self, name), valid))
        thresholds = tuple(positive("thresholds_mm", x) for x in self.thresholds_mm)
        object.__setattr__(self, "thresholds_mm", thresholds)
        panels = tuple(build(Panel, f"panels[{i}]", data) for i, data in enumerate(self.panels))
        object.__setattr__(self, "panels", panels)
        for who in ("ours", "mujoco"):
            for name, settings in getattr(self.long_runs, who).items():
                for value in set(settings) - set(getattr(self, who).get(name, ())):
                    raise ValueError(
                        f"long_runs.{who}.{name} has {value}, which {who}.{name} lacks: add it there"
                    )
        for panel in panels:  # reports mistakes in a scene before the first measurement
            panel.scene(self.control_dt, **self.reference.scene)


def load_study(path: Path) -> Study:
    """The study that a YAML file describes."""
    if not exists(path):
        raise ValueError(f"config is {shown(str(path))}; there is no such file")
    data = read_yaml(path, "config")
    with explained(path):
        return build(Study, "config", data)
