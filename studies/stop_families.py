"""Families of control intervals with hard stops: short or long travel, weak or strong efforts, all masses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from redundant_envs.effects import Gravity, PrismaticStop, ViscousFriction
from redundant_envs.robots import RPRP
from redundant_envs.scenes.scene import Scene
from studies.interval_families import LaneSamples, decades


@dataclass(frozen=True)
class StopFamily:
    """Numbers of a scene of the RPRP arm, and of the states and efforts drawn for it."""

    control_dt: float = 0.02  # s
    effort: float = 30.0  # largest of a motor, N m and N
    travel: float = 0.25  # of both sliders, m
    masses: tuple[float, ...] = (0.5,) * 4  # kg
    lengths: tuple[float, ...] = (0.25, 0.25)  # m
    restitution: float = 0.0
    tolerance: float = 1e-6  # m
    g: float = 9.81
    friction: float = 0.2
    rate: float = 3.0  # scale of joint rates, rad/s; for sliders it is a travel in 60 ms, at most 3 m/s
    steps: int = 160  # equal ones of rk8 per interval that confirm the reference
    actuation = "joint"

    @property
    def name(self) -> str:
        """What distinguishes the family, in a few words."""
        masses = " ".join(f"{m:.2g}" for m in self.masses)
        return (
            f"{1e3 * self.control_dt:g} ms, {self.effort:.3g} N, travel {self.travel:.2g} m, "
            f"masses {masses} kg, restitution {self.restitution:g}"
        )

    @property
    def robot(self) -> Any:
        """The arm."""
        return RPRP(self.masses, self.lengths)

    def scene(self, **how: Any) -> Scene:
        """The scene; ``how`` sets its stepping, by default its tolerance."""
        stop = PrismaticStop((0.0, 0.0), (self.travel, self.travel), self.restitution)
        effects = (Gravity(self.g), ViscousFriction((self.friction,) * 4), stop)
        return Scene(
            self.robot, effects, control_dt=self.control_dt, **(how or {"tolerance": self.tolerance})
        )

    def draw(self, count: int, rng: np.random.Generator) -> LaneSamples:
        """Random states and efforts of lanes: a third of the sliders are anywhere in their travel, a third at
        logarithmic distances from an end, a third rest at one; half of the efforts are uniform, half at their
        limits."""
        q, qd = rng.uniform(-np.pi, np.pi, (count, 4)), rng.normal(0.0, self.rate, (count, 4))
        speed = min(self.travel / 0.06, 3.0)
        for joint in (1, 3):
            qd[:, joint] = rng.normal(0.0, speed, count)
            place = rng.uniform(0.0, self.travel, count)
            kind = rng.integers(0, 3, count)
            gap = 0.5 * self.travel * 10.0 ** rng.uniform(-7.0, 0.0, count)
            gap[kind == 2] = 0.0
            near = np.where(rng.random(count) < 0.5, gap, self.travel - gap)
            q[:, joint] = np.where(kind == 0, place, near)
            qd[kind == 2, joint] = 0.0
        efforts = self.effort * rng.uniform(-1.0, 1.0, (count, 4))
        hard = rng.random(count) < 0.5
        efforts[hard] = self.effort * np.sign(efforts[hard])
        efforts[:, [0, 2]] *= 0.5 * sum(self.lengths)
        joints, rates = q @ self.robot.motor_map, qd @ self.robot.motor_map
        return LaneSamples(joints, rates, efforts, {})


NAMED = (
    StopFamily(),
    StopFamily(control_dt=0.05, effort=100.0, travel=0.1, restitution=0.5),
    StopFamily(travel=0.02, restitution=0.5),
    StopFamily(masses=(0.5, 0.5, 0.5, 0.01)),
    StopFamily(effort=94.0, travel=0.023, masses=(0.3, 0.2, 0.1, 0.15), restitution=0.3, g=0.0, friction=0.0),
    StopFamily(effort=250.0, travel=0.05, masses=(1.0,) * 4, lengths=(0.5, 0.5), restitution=0.5, g=0.0),
    StopFamily(effort=60.0, travel=0.1, restitution=1.0),
    StopFamily(effort=10.0, travel=0.25, rate=8.0),
)
"""Families in which earlier versions missed impacts, and similar ones."""


def drawn_families(count: int, seed: int) -> list[StopFamily]:
    """Families with random numbers: control intervals, efforts, travels and masses vary over decades."""
    rng = np.random.default_rng(seed)

    def about(low: float, high: float) -> float:
        return float(decades(rng, low, high))

    return [
        StopFamily(
            control_dt=float(rng.choice([0.005, 0.01, 0.02, 0.05])),
            effort=about(3.0, 200.0),
            travel=about(0.01, 0.3),
            masses=tuple(about(0.1, 2.0) for _ in range(4)),
            lengths=(about(0.1, 1.0), about(0.1, 1.0)),
            restitution=float(rng.choice([0.0, 0.0, 0.3, 0.5, 0.9, 1.0])),
            tolerance=float(rng.choice([1e-5, 1e-6, 1e-6, 1e-7, 1e-8])),
            g=float(rng.choice([0.0, 9.81])),
            friction=float(rng.choice([0.0, 0.2])),
            rate=about(0.5, 8.0),
        )
        for _ in range(count)
    ]
