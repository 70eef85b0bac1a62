"""Configuration of the accuracy study, from YAML: panels, configurations, references."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from redundant_envs.scenes.scene import Scene
from redundant_envs.support.extras import needs
from redundant_envs_train.config import Model, Real, Text, Whole, load_model, number

with needs("train"):
    from pydantic import Field, model_validator

Array = NDArray[np.float64]
States = tuple[Array, Array, Array]
"""q, qd and joint efforts, (n, 4) each: rad and m, 1/s, N m and N."""

PEERS = ("mujoco", "scipy")
MOST = 1_000_000
MIN_TOLERANCE = 1e-15
Count = Annotated[Whole, Field(ge=1, le=MOST)]
Positive = Annotated[Real, Field(ge=MIN_TOLERANCE, le=1e9)]
Four = Annotated[tuple[Real, ...], Field(min_length=4, max_length=4)]


class OurSweep(Model):
    """Integrator -> equal steps per control interval; m of tip error of error-controlled rk8."""

    euler: tuple[Count, ...] = ()
    rk4: tuple[Count, ...] = ()
    rk8: tuple[Count, ...] = ()
    tolerance: tuple[Positive, ...] = ()


class MuJoCoSweep(Model):
    """Integrator -> steps per control interval."""

    Euler: tuple[Count, ...] = ()
    implicitfast: tuple[Count, ...] = ()
    implicit: tuple[Count, ...] = ()
    RK4: tuple[Count, ...] = ()


class SciPySweep(Model):
    """Method -> relative and absolute tolerances."""

    RK45: tuple[Positive, ...] = ()
    DOP853: tuple[Positive, ...] = ()


class Panel(Model):
    """A scene and its states: coordinates are uniform from ``low`` to ``high``, rad and m; velocities, rad/s
    and m/s, are normal around zero, and so are the joint efforts of a share of the states, N m and N."""

    name: Text
    about: Text
    robot: Mapping[str, Any]
    effects: tuple[Mapping[str, Any], ...]
    low: Four
    high: Four
    rate_sd: Four
    effort_sd: Four
    effort_share: Real = number(..., 0, 1, "share of the states with efforts")
    peers: tuple[Literal["mujoco", "scipy"], ...]

    def scene(self, control_dt: float, **stepping: Any) -> Scene:
        """The scene with the given stepping."""
        entries = {"robot": self.robot, "effects": self.effects}
        return Scene.from_dict({**entries, "control_dt": control_dt, **stepping})

    def states(self, count: int, seed: int) -> States:
        """Random states; the same for the same seed."""
        rng = np.random.default_rng(seed)
        q = rng.uniform(self.low, self.high, (count, 4))
        qd = rng.normal(0.0, self.rate_sd, (count, 4))
        efforts = rng.normal(0.0, self.effort_sd, (count, 4))
        efforts[rng.uniform(size=count) >= self.effort_share] = 0.0
        return q, qd, efforts


class Reference(Model):
    """The reference for errors, and the other methods that check it."""

    scene: Mapping[str, Any]  # integrator, substeps or tolerance of the reference
    states: Count  # that the other methods check
    mujoco_steps: Count  # RK4 steps of the check by MuJoCo per control interval
    scipy_rtol: Positive  # of the check by SciPy's DOP853


class LongRuns(Model):
    """Motions beyond a control interval, without efforts."""

    states: Count
    seconds: Positive  # of the motions whose energy is measured
    ours: OurSweep  # the configurations of the study that are used
    mujoco: MuJoCoSweep


class Timing(Model):
    """Rounds of timing, in which MuJoCo's cost is one of ``mujoco_states`` motions of ``mujoco_steps``
    steps."""

    rounds: Count
    scipy_rounds: Count
    mujoco_states: Count
    mujoco_steps: Count


class Study(Model):
    """The whole study."""

    control_dt: Positive  # s
    states: Count  # of a panel
    scipy_states: Count  # of them, those that SciPy simulates
    seed: Whole = number(..., 0, 2**31, "seed of the first panel's states; the others have the next ones")
    thresholds_mm: tuple[Positive, ...]  # errors in the table of costs
    ours: OurSweep
    mujoco: MuJoCoSweep
    mujoco_stiffness: Positive  # of MuJoCo's elastic stops, in 1/step^2: short steps follow stiffer ones
    scipy: SciPySweep
    reference: Reference
    long_runs: LongRuns
    timing: Timing
    panels: tuple[Panel, ...]

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for who in ("ours", "mujoco"):
            for name, settings in getattr(self.long_runs, who):
                for value in set(settings) - set(getattr(getattr(self, who), name)):
                    raise ValueError(
                        f"long_runs.{who}.{name} has {value}, which {who}.{name} lacks: add it there"
                    )
        for i, panel in enumerate(self.panels):  # mistakes in a scene, before the first measurement
            try:
                panel.scene(self.control_dt, **self.reference.scene)
            except ValueError as error:
                raise ValueError(f"panels[{i}], with the stepping of the reference: {error}") from None
        return self


load_study = functools.partial(load_model, Study)
