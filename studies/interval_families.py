"""Families of control intervals: a scene each, with separate numbers, states and efforts for every lane."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.effects import (
    CentringSpring,
    CoulombFriction,
    Disc,
    Effect,
    EffortLimits,
    Gravity,
    HalfPlane,
    LimitSpring,
    PrismaticStop,
    ViscousFriction,
)
from redundant_envs.robots import RPRP, FourR
from redundant_envs.robots.arm import Arm
from redundant_envs.scenes.scene import Scene
from studies.kinked_effects import KINKED, Kinked

Array = NDArray[np.float64]
REACH = 1.0
"""Approximate reach of every arm, m: 4R has four links of a quarter, RPRP two, and as much travel."""


@dataclass
class LaneSamples:
    """Random data of the lanes of a family."""

    joints: Array  # positions of the joints, (count, joints), rad and m
    rates: Array
    efforts: Array  # of the motors, (count, joints), N m and N
    parameters: dict[str, Array]  # numbers of the scene by name, (count, entries) each
    states: dict[str, Array] = field(default_factory=dict)  # of effects, where they are not those of a start


def chosen(drawn: LaneSamples, lanes: NDArray[Any]) -> LaneSamples:
    """Some of the lanes."""
    tables = drawn.parameters, drawn.states
    rows = ({name: values[lanes] for name, values in table.items()} for table in tables)
    return LaneSamples(drawn.joints[lanes], drawn.rates[lanes], drawn.efforts[lanes], *rows)


Change = Callable[[LaneSamples, np.random.Generator], None]


@dataclass(frozen=True)
class Family:
    """Scenes of one structure, whose numbers may be drawn again for each lane."""

    name: str
    arm: type[Arm]
    effects: tuple[Effect, ...] = (Gravity(),)
    changes: tuple[Change, ...] = ()  # replace the usual draws, in order
    control_dt: float = 0.02  # s
    tolerance: float = 1e-6  # m
    actuation: str = "joint"
    steps: int = 96  # equal ones of rk8 per interval that confirm the reference

    @property
    def robot(self) -> Any:
        """The arm with ordinary numbers."""
        return self.arm((0.5,) * self.arm.num_masses, (0.25,) * self.arm.num_lengths)

    def scene(self, **how: Any) -> Scene:
        """The scene; ``how`` sets its stepping, by default its tolerance."""
        how = how or {"tolerance": self.tolerance}
        return Scene(self.robot, self.effects, control_dt=self.control_dt, actuation=self.actuation, **how)

    def draw(self, count: int, rng: np.random.Generator) -> LaneSamples:
        """Random data of ``count`` lanes."""
        slides = np.array(self.robot.prismatic)
        shape = count, len(slides)
        joints = np.where(slides, rng.uniform(0.0, 0.25, shape), rng.uniform(-np.pi, np.pi, shape))
        rates = rng.normal(0.0, 1.0, shape) * np.where(slides, 0.5, 3.0)
        efforts = rng.uniform(-1.0, 1.0, shape) * np.where(slides, 10.0, 4.0)
        hard = rng.random(count) < 0.5  # half of them bang-bang
        efforts[hard] = np.sign(efforts[hard]) * np.abs(efforts).max(axis=0)
        drawn = LaneSamples(joints, rates, efforts, {})
        drawn.parameters["masses"] = decades(rng, 0.2, 1.0, (count, self.arm.num_masses))
        drawn.parameters["lengths"] = decades(rng, 0.1, 0.5, (count, self.arm.num_lengths))
        for change in self.changes:
            change(drawn, rng)
        return drawn


def decades(rng: np.random.Generator, low: float, high: float, shape: Any = None) -> Any:
    """A number or numbers whose logarithms are uniform."""
    return np.exp(rng.uniform(np.log(low), np.log(high), shape))


# ---- changes of the usual draws ------------------------------------------------------------------


def masses(drawn: LaneSamples, rng: np.random.Generator, low: float) -> None:
    """Masses over decades, up to 1 kg."""
    drawn.parameters["masses"] = decades(rng, low, 1.0, drawn.joints.shape)


def lengths(drawn: LaneSamples, rng: np.random.Generator, low: float) -> None:
    """Lengths over decades, up to a quarter of a metre, which one has in each lane."""
    shape = drawn.parameters["lengths"].shape
    values = decades(rng, low, 0.25, shape)
    values[np.arange(shape[0]), rng.integers(0, shape[1], shape[0])] = 0.25
    drawn.parameters["lengths"] = values


def heavy_tip(drawn: LaneSamples, rng: np.random.Generator) -> None:
    """A tip up to a thousand times as heavy as the rest of the arm."""
    drawn.parameters["masses"][:, 3] *= decades(rng, 1.0, 1e3, len(drawn.joints))


def weak(drawn: LaneSamples, rng: np.random.Generator) -> None:
    """Motors for the lightest and shortest link: strong ones would turn it thousands of times an interval."""
    lightest, shortest = (drawn.parameters[name].min(axis=1) for name in ("masses", "lengths"))
    slides = drawn.parameters["lengths"].shape[1] == 2
    inertia = lightest / 0.5 * (1.0 if slides else (shortest / 0.25) ** 2)
    drawn.efforts *= inertia[:, None]


def faster(drawn: LaneSamples, rng: np.random.Generator) -> None:
    """All rates and efforts five times as large."""
    drawn.rates *= 5.0
    drawn.efforts *= 5.0


def singular(drawn: LaneSamples, rng: np.random.Generator) -> None:
    """Links in line or folded, exactly or nearly; for RPRP some second sliders at the pole, l2 + r2 = 0."""
    count, slides = len(drawn.joints), drawn.parameters["lengths"].shape[1] == 2
    gap = rng.normal(size=(count, 4)) * decades(rng, 1e-12, 0.1, (count, 4))
    near = np.where(rng.random((count, 4)) < 0.5, 0.0, gap)
    folded = np.where(rng.random((count, 4)) < 0.5, 0.0, np.pi)
    if not slides:
        drawn.joints[:, 1:] = (folded + near)[:, 1:]
        return
    drawn.joints[:, 2] = (folded + near)[:, 2]
    pole = rng.random(count) < 0.5
    drawn.joints[pole, 3] = -drawn.parameters["lengths"][pole, 1] + 0.1 * near[pole, 3]


def near_limits(
    drawn: LaneSamples, rng: np.random.Generator, arm: type[RPRP | FourR], names: Sequence[str]
) -> None:
    """Joints near the limits of springs, whose stiffness and damping are drawn over decades."""
    count = len(drawn.joints)
    for name in names:
        joint = arm.joints.index(name)
        slides = name.startswith("r")
        low, high = (0.0, 0.25) if slides else (-1.0, 1.0)
        width = high - low
        gap = width * rng.choice([-1.0, 1.0, 1.0], count) * decades(rng, 1e-9, 0.05, count)
        side = rng.random(count) < 0.5
        drawn.joints[:, joint] = np.where(side, low + gap, high - gap)
        key, arms = f"limit_spring.{name}", 1.0 if slides else 0.03  # lever arms squared, m^2
        drawn.parameters[f"{key}.stiffness"] = arms * decades(rng, 1e2, 2e4, (count, 1))
        damped = rng.random((count, 1)) < 0.3
        damping = np.where(damped, arms * decades(rng, 1.0, 100.0, (count, 1)), 0.0)
        drawn.parameters[f"{key}.damping"] = damping


def in_damper(drawn: LaneSamples, rng: np.random.Generator, arm: type[RPRP | FourR], name: str) -> None:
    """A joint as deep in a spring as 0.1 m or 0.6 rad; the damping is strong in some lanes."""
    count, joint, slides = len(drawn.joints), arm.joints.index(name), name.startswith("r")
    depth, arms = (0.1, 1.0) if slides else (0.6, 0.03)
    drawn.joints[:, joint] = (0.25 if slides else 1.0) + depth * rng.random(count)
    drawn.rates[:, joint] = rng.normal(0.0, 2.0 if slides else 8.0, count)
    drawn.parameters[f"limit_spring.{name}.stiffness"] = arms * decades(rng, 1.0, 1e4, (count, 1))
    drawn.parameters[f"limit_spring.{name}.damping"] = arms * decades(rng, 0.1, 1e3, (count, 1))


def near_stops(drawn: LaneSamples, rng: np.random.Generator) -> None:
    """A third of the sliders anywhere, a third near an end of the travel, a third at rest at one."""
    count = len(drawn.joints)
    for joint in (1, 3):
        kind = rng.integers(0, 3, count)
        gap = np.where(kind == 2, 0.0, 0.125 * 10.0 ** rng.uniform(-7.0, 0.0, count))
        near = np.where(rng.random(count) < 0.5, gap, 0.25 - gap)
        drawn.joints[:, joint] = np.where(kind == 0, drawn.joints[:, joint], near)
        drawn.rates[kind == 2, joint] = 0.0
    elastic = rng.choice([0.0, 0.0, 0.3, 0.7, 1.0], (count, 1))
    drawn.parameters["prismatic_stop.restitution"] = elastic


def dry(drawn: LaneSamples, rng: np.random.Generator) -> None:
    """Levels of dry friction over decades; half of the joints at rest."""
    count, joints = drawn.joints.shape
    drawn.rates[rng.random((count, joints)) < 0.5] = 0.0
    drawn.parameters["coulomb_friction.level"] = decades(rng, 1e-2, 5.0, (count, joints))


def friction(drawn: LaneSamples, rng: np.random.Generator) -> None:
    """Coefficients of viscous friction over decades."""
    drawn.parameters["viscous_friction.coefficients"] = decades(rng, 1e-3, 3.0, drawn.joints.shape)


def floors(drawn: LaneSamples, rng: np.random.Generator) -> None:
    """Floors of any hardness, with and without friction, at any height."""
    count = len(drawn.joints)
    drawn.parameters["half_plane.stiffness"] = decades(rng, 1e2, 2e4, (count, 1))
    drawn.parameters["half_plane.friction"] = rng.choice([0.0, 0.3, 1.0], (count, 1))
    height = rng.uniform(-0.6, -0.05, count)
    drawn.parameters["half_plane.point"] = np.stack([np.zeros(count), height], axis=1)


def discs(drawn: LaneSamples, rng: np.random.Generator) -> None:
    """Discs of any hardness, with and without friction, anywhere below the base."""
    count = len(drawn.joints)
    drawn.parameters["disc.stiffness"] = decades(rng, 1e2, 2e4, (count, 1))
    drawn.parameters["disc.friction"] = rng.choice([0.0, 0.3, 1.0], (count, 1))
    drawn.parameters["disc.radius"] = rng.uniform(0.1, 0.35, (count, 1))
    far, angle = rng.uniform(0.4, 1.0, count), rng.uniform(-np.pi, 0.0, count)
    drawn.parameters["disc.centre"] = np.stack([far * np.cos(angle), far * np.sin(angle)], axis=1)


def near_kinks(drawn: LaneSamples, rng: np.random.Generator, kinked: Kinked) -> None:
    """Rates near 0 in half of the lanes, and numbers of the effect."""
    count, joints = drawn.joints.shape
    drawn.rates[rng.random(count) < 0.5] *= 0.01
    for name, (low, high) in kinked.bounds.items():
        wide = joints if name in kinked.effect.of_joints else 1
        drawn.parameters[f"{kinked.effect.key}.{name}"] = decades(rng, low, high, (count, wide))


# ---- the families --------------------------------------------------------------------------------

FRICTION = ViscousFriction(0.1)
STOP = PrismaticStop((0.0, 0.0), (0.25, 0.25), 0.5)


def spring(name: str) -> LimitSpring:
    """A spring at the limits of a joint; its stiffness is drawn."""
    low, high = (0.0, 0.25) if name.startswith("r") else (-1.0, 1.0)
    return LimitSpring(name, low, high, 1000.0)


def kinked(name: str, arm: type[Arm], tolerance: float) -> tuple[Family, ...]:
    """Effects whose laws change with rates, and that do not declare their kinks."""
    return tuple(
        Family(
            f"{name}, {one.name}, {tolerance:g} m", arm, (Gravity(), one.effect),
            (partial(near_kinks, kinked=one),), tolerance=tolerance, steps=1024,
        )
        for one in KINKED
    )  # fmt: skip


TILTED = Gravity.on_plane(9.81, 0.6, 0.4)
CENTRED = CentringSpring((50.0, 30.0), (0.0, 0.0), (0.25, 0.25))
FLOOR = HalfPlane((0.0, -0.3))
WEAK = EffortLimits((8.0, 4.0, 2.0, 1.0))

FAMILIES = (
    Family("4R, smooth", FourR),
    Family("RPRP, smooth", RPRP),
    Family("4R, friction", FourR, (Gravity(), FRICTION), (friction,)),
    Family("RPRP, friction", RPRP, (Gravity(), FRICTION), (friction,)),
    Family(
        "4R, limit springs", FourR, (Gravity(), spring("joint2"), spring("joint3")),
        (partial(near_limits, arm=FourR, names=("joint2", "joint3")),), steps=1024,
    ),
    Family(
        "RPRP, limit springs", RPRP, (Gravity(), spring("r1"), spring("r2")),
        (partial(near_limits, arm=RPRP, names=("r1", "r2")),), steps=1024,
    ),
    Family(
        "4R, strong dampers", FourR, (Gravity(), spring("joint2")),
        (partial(in_damper, arm=FourR, name="joint2"),), 0.05, steps=1024,
    ),
    Family(
        "RPRP, strong dampers", RPRP, (Gravity(), spring("r2")),
        (partial(in_damper, arm=RPRP, name="r2"),), 0.05, steps=1024,
    ),
    Family("RPRP, stops", RPRP, (Gravity(), FRICTION, STOP), (near_stops,)),
    Family(
        "RPRP, stops and springs", RPRP, (Gravity(), STOP, spring("joint2")),
        (near_stops, partial(near_limits, arm=RPRP, names=("joint2",))), steps=512,
    ),
    Family("RPRP, stops and true stiction", RPRP, (Gravity(), CoulombFriction(0.5), STOP), (dry, near_stops)),
    Family("4R, singular starts", FourR, changes=(singular,)),
    Family("RPRP, singular starts", RPRP, changes=(singular,)),
    Family("4R, masses over five decades", FourR, changes=(partial(masses, low=1e-5), weak), steps=512),
    Family("RPRP, masses over six decades", RPRP, changes=(partial(masses, low=1e-6), weak), steps=512),
    Family("4R, heavy tip", FourR, changes=(heavy_tip,), steps=512),
    Family("4R, lengths over three decades", FourR, changes=(partial(lengths, low=2.5e-4), weak), steps=512),
    Family("RPRP, lengths over six decades", RPRP, changes=(partial(lengths, low=2.5e-7), weak)),
    Family("4R, fast", FourR, (Gravity(), WEAK), (faster,)),
    Family("RPRP, 50 ms, generalized forces", RPRP, (TILTED, CENTRED), (), 0.05, actuation="generalized"),
    Family("4R, 1e-9 m", FourR, (Gravity(), FRICTION), tolerance=1e-9),
    Family("RPRP with stops, 1e-9 m", RPRP, (Gravity(), STOP), (near_stops,), tolerance=1e-9),
    Family("4R, tip on a floor", FourR, (Gravity(), FLOOR), (floors,), steps=1024),
    Family("4R, tip on a disc", FourR, (Gravity(), Disc((0.6, -0.3), 0.1)), (discs,), steps=1024),
    *kinked("4R", FourR, 1e-6), *kinked("RPRP", RPRP, 1e-9),
)  # fmt: skip
