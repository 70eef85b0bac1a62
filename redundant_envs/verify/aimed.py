# mypy: allow-untyped-defs
"""Motions aimed at every way in which a lane crosses a control interval, for the record of bits.

Their starts are chosen to meet rare cases: sliders at rest at their stops, or nearer to them than rounding,
at speeds from 1e-16 m/s on; several sliders at once; links too fast for any number of steps. Each motion has
many lanes and few intervals.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.algebra import clamp, maximum, physics, where
from redundant_envs.effects.hooks import Actuation, Effect, Force, Hook, Link, State

Array = NDArray[Any]

# ---- effects with states and kinks -----------------------------------------------------------------


@physics
def approach(command, effort, time_constant):
    return (command - effort) / time_constant


@physics
def effort_of(effort):
    return effort


@physics
def fastest_change(time_constant):
    return 1.0 / time_constant


@dataclass(frozen=True)
class Lag(Effect):
    """The effort of each motor approaches its command: a state of each is integrated beside the arm's."""

    time_constant: float

    def hooks(self, arm: Any) -> tuple[Hook, ...]:
        return tuple(self._link(k, "N" if slides else "N m") for k, slides in enumerate(arm.prismatic))

    def _link(self, k: int, unit: str) -> Actuation:
        own = {"effort": f".effort[{k}]", "time_constant": ".time_constant"}
        bind = {"command": f"command{k + 1}", **own}
        state = State(f"effort[{k}]", unit, derivative=approach, bind=bind, rate=fastest_change)
        return Actuation(k, effort_of, own, Link.LAG, states=(state,))


@physics
def wind_up(rate, position, turn):
    return 0.5 * turn + 0.1 * rate + 0.01 * position


@physics
def backlash(rate, position, turn, play, drag):
    beyond = maximum(abs(position - turn) - play, 0.0)
    return -drag * beyond * clamp(10.0 * rate, -1.0, 1.0)


@dataclass(frozen=True)
class Play(Effect):
    """A force on the last joint with two kinks, and a state that changes after each interval only."""

    play: float
    drag: float

    def hooks(self, arm: Any) -> tuple[Hook, ...]:
        k = len(arm.coordinates)
        here = {"rate": f"phid{k}", "position": f"phi{k}", "turn": ".turn"}
        state = State("turn", "rad", update=wind_up, bind=here)
        return (Force(k - 1, backlash, {**here, "play": ".play", "drag": ".drag"}, states=(state,)),)


@physics
def dry(rate, level):
    return where(rate > 0.0, -level, level)


@dataclass(frozen=True)
class DryFriction(Effect):
    """A force on the last joint that jumps where its rate changes its sign: pulls of stops jump with it."""

    level: float

    def hooks(self, arm: Any) -> tuple[Hook, ...]:
        k = len(arm.coordinates)
        return (Force(k - 1, dry, {"rate": f"phid{k}", "level": ".level"}),)


# ---- scenes ------------------------------------------------------------------------------------------

RPRP = rde.RPRP(masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3, 0.5))
ONE = rde.Chain("RP", masses=(1.0, 0.5), lengths=(0.4,))
PAIR = rde.Chain("PP", masses=(1.0, 0.5))
TWO = rde.Chain("PPR", masses=(1.0, 2.0, 0.5), lengths=(0.4,))
THREE = rde.Chain("RPPP", masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3,))
BENT = rde.Chain("PRPRP", masses=(2.0, 1.5, 1.0, 0.5, 0.7), lengths=(0.3, 0.5))
FOUR = rde.Chain("PPPP", masses=(2.0, 0.5, 1.0, 0.3))
FOUR_R = rde.FourR(masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3, 0.5, 0.4, 0.6))
GRAVITY = e.Gravity(9.81, (0.6, -0.7))
FALL = 5.886
"""Acceleration of a free slider along +x under this gravity, m/s^2."""


def stops(arm: Any) -> Effect:
    """Stops of all sliders, each farther out than the one before."""
    count = len(arm.sliders())
    lower, upper = (-0.2 * (1.0 + 0.3 * k) for k in range(count)), (0.2 + 0.1 * k for k in range(count))
    return e.PrismaticStop(tuple(lower), tuple(upper), 0.5)


def springs(*joints: str, damping: float = 20.0) -> tuple[Effect, ...]:
    return tuple(e.LimitSpring(joint, -0.15, 0.1, 900.0, damping) for joint in joints)


AT = ("at rest", "slow, at stops")
NEAR = ("slow, near stops", "near stops", "still", "spun")
KINDS = ("anywhere", *AT, *NEAR[:3], "fast", "together", "one strikes", "broken")
"""Kinds of starts: sliders at their stops, from 1e-18 to 0.1 m away, all striking at once; numbers that are
not finite, or too large."""


@dataclass(frozen=True)
class Aimed:
    """A motion of a scene."""

    scene: rde.Scene
    work: bool  # whether it is tracked and events are logged
    varied: bool = True  # whether each lane has masses and a restitution of its own
    speeds: float = 1.0  # the greatest of links and sliders at the start is 10 to this power, rad/s and m/s
    fastest: float = 1e5  # speed of the first joint in one lane, rad/s or m/s
    lanes: int = 512
    intervals: int = 16
    kinds: tuple[str, ...] = KINDS  # of starts, one after the other
    efforts: float = 1.5  # the greatest is 10 to this power, N m or N
    numbers: Mapping[str, float] = field(default_factory=dict)  # instead of the scene's: for shared code


def aimed(
    name: str, arm: Any, *effects: Any, dt: float = 0.02, substeps: int = 1, actuation: str = "joint",
    **more: Any,
) -> tuple[str, Aimed]:  # fmt: skip
    """A name, whose first word is the method or the tolerance and whose last may be "log", and its motion;
    :func:`stops` among the effects are those of the arm."""
    method = name.partition(",")[0]
    integrator, tolerance = ("rk8", float(method)) if method[0] == "1" else (method, None)
    own = tuple(stops(arm) if x is stops else x for x in effects)
    scene = rde.Scene(arm, own, integrator, dt, substeps, tolerance, actuation)
    return f"events: {name}", Aimed(scene, name.endswith("log"), **more)


WEIGHTLESS: dict[str, Any] = {"efforts": -8.0, "numbers": {"gravity.g": 0.0}}
TOGETHER: dict[str, Any] = {**WEIGHTLESS, "kinds": ("nearly together", "one strikes")}
FALLING = GRAVITY, stops(PAIR)
THROWN: dict[str, Any] = {"kinds": ("thrown",), "efforts": -8.0, "intervals": 4}
SWITCHES = springs("r1", "r2", "joint2", damping=300.0)
LONG: dict[str, Any] = {
    "kinds": ("near stops", "slow, near stops", "anywhere"),
    "lanes": 1536,
    "intervals": 10,
}
FOLDED: dict[str, Any] = {"kinds": ("folded",), "lanes": 16, "intervals": 2, "efforts": -8.0}
STIFF = {"gravity.g": 0.0, "limit_spring.joint2.stiffness": 1e14}
BUZZ = {"lower": -1e-6, "upper": 1e-6, "stiffness": 1e11, "damping": 0.0}
BUZZING = {"gravity.g": 0.0, **{f"limit_spring.{r}.{n}": x for r in ("r1", "r2") for n, x in BUZZ.items()}}
NARROW = e.PrismaticStop((-0.003, -0.002), (0.002, 0.004), 0.5)
ABOVE, BESIDE = e.PrismaticStop((0.0,), (None,), 0.5), e.PrismaticStop((0.0, None), (None, 0.0), 0.5)
LAG, PLAY, DRY = Lag(0.01), Play(0.02, 3.0), DryFriction(2.0)
FREE = "generalized"
AIMED: dict[str, Aimed] = dict((
    # Equal steps: stops only; switches are not located.
    aimed("euler, 2 sliders, 3 substeps, log", RPRP, GRAVITY, stops, dt=0.03, substeps=3),
    aimed("rk4, 1 slider", ONE, GRAVITY, stops, varied=False),
    aimed("rk4, 2 sliders, generalized, lag", TWO, stops, LAG, PLAY, actuation=FREE),
    aimed("rk8, 2 sliders, 2 substeps, log", RPRP, GRAVITY, stops, *springs("joint2"), dt=0.04, substeps=2),
    aimed("rk8, 3 sliders, log", THREE, GRAVITY, stops),
    aimed("rk4, 3 bent sliders", BENT, GRAVITY, stops),
    aimed("rk4, 4 sliders", FOUR, GRAVITY, stops),
    aimed("rk8, 2 sliders, turns near stops", RPRP, GRAVITY, stops, LAG, dt=0.05, kinds=NEAR[:3]),
    aimed("rk4, 4 sliders, nearly together", FOUR, GRAVITY, stops, **TOGETHER),
    aimed("rk8, 1 slider, late turns", ONE, GRAVITY, ABOVE, dt=0.1, kinds=("spun",)),
    aimed("rk4, 2 sliders, forces that jump", TWO, stops, DRY, dt=0.05, lanes=192),
    aimed(
        "rk8, 2 sliders, narrow stops, 2 substeps, log",
        RPRP, GRAVITY, NARROW, *springs("joint2"), dt=0.04, substeps=2,
    ),
    aimed("rk4, 2 sliders of a pair, thrown", PAIR, *FALLING, **THROWN),
    aimed(
        "rk4, 2 sliders of a pair, creeping, log",
        PAIR, *FALLING, kinds=("creeping", "slow, near stops"), **WEIGHTLESS,
    ),
    aimed(
        "euler, 2 sliders, 3 substeps, long steps, log", RPRP, GRAVITY, stops, dt=0.1, substeps=3, **LONG
    ),
    aimed(
        "rk4, 2 sliders, generalized, lag, long steps",
        TWO, stops, LAG, PLAY, dt=0.1, actuation=FREE, **LONG,
    ),
    aimed("rk8, 2 sliders, turns near stops, long steps", RPRP, GRAVITY, stops, LAG, dt=0.1, **LONG),
    # Doubling under a tolerance.
    aimed("1e-6, 1 slider, log", ONE, GRAVITY, stops),
    aimed("1e-6, 2 sliders, log", RPRP, GRAVITY, stops),
    aimed("1e-12, 2 sliders", RPRP, GRAVITY, stops),
    aimed("1e-6, 3 sliders", THREE, GRAVITY, stops),
    aimed(
        "1e-9, 2 sliders, switches, lag, kinks, log",
        TWO, stops, *springs("joint1", "r2"), LAG, PLAY, lanes=64, intervals=12,
    ),
    aimed("1e-6, switches", RPRP, GRAVITY, *SWITCHES, lanes=192),
    aimed(
        "1e-6, 4R switches, kinks, generalized",
        FOUR_R, *springs("joint2", "joint4"), PLAY, actuation=FREE, speeds=2.0, lanes=96, intervals=12,
    ),
    aimed(
        "1e-6, no boundaries, lag, kinks", RPRP, GRAVITY, LAG, PLAY, speeds=3.0, kinds=(*KINDS, "at a kink")
    ),
    aimed("1e-6, 2 sliders, turns near stops", RPRP, GRAVITY, stops, LAG, dt=0.05, kinds=NEAR[:3]),
    aimed("1e-6, 2 sliders, stops on one side at 0", RPRP, GRAVITY, BESIDE),
    aimed("1e-6, 2 sliders, nearly together, log", RPRP, GRAVITY, stops, **TOGETHER),
    aimed("1e-6, 2 sliders, narrow stops, log", RPRP, GRAVITY, NARROW),
    aimed("1e-6, 2 sliders, thrown", TWO, *FALLING, **THROWN),
    aimed(
        "1e-2, 2 sliders, narrow stops, folded, log", RPRP, GRAVITY, NARROW, kinds=("folded",), **WEIGHTLESS
    ),
    aimed("1e-6, 2 sliders, narrow stops, kinks", RPRP, GRAVITY, NARROW, PLAY, lanes=256),
    aimed("1e-13, 2 sliders", RPRP, GRAVITY, stops, intervals=8),
    aimed(
        "1e-6, switches passed together",
        RPRP, GRAVITY, *SWITCHES, varied=False, kinds=("in step",), **WEIGHTLESS,
    ),
    aimed("1e-6, switches, too stiff", RPRP, GRAVITY, *SWITCHES, numbers=STIFF, **FOLDED),
    aimed("1e-6, switches, too many trials", RPRP, GRAVITY, *SWITCHES, numbers=BUZZING, **FOLDED),
    aimed(
        "1e-6, no boundaries, steps a power of 2",
        RPRP, GRAVITY, LAG, PLAY, dt=0.015625, kinds=("round",), lanes=96, intervals=2,
    ),
    # dop853.
    aimed("dop853, 2 sliders, log", RPRP, GRAVITY, stops),
    aimed("dop853, 2 sliders, narrow stops, log", RPRP, GRAVITY, NARROW),
    aimed("dop853, 2 sliders, thrown", TWO, *FALLING, **THROWN),
    aimed("dop853, 3 sliders", THREE, GRAVITY, stops),
    aimed(
        "dop853, stops, switches, lag, kinks", TWO, stops, *springs("joint1", "r2"), LAG, PLAY, lanes=192
    ),
    aimed("dop853, 2 sliders, turns near stops", RPRP, GRAVITY, stops, LAG, dt=0.05, kinds=NEAR[:3]),
    aimed("dop853, switches", RPRP, GRAVITY, *springs("r1", "r2"), speeds=2.0),
    aimed("dop853, no boundaries", FOUR_R, GRAVITY, LAG, speeds=2.5, lanes=96, intervals=8),
    aimed(
        "dop853, no boundaries, too many steps",
        FOUR_R, GRAVITY, LAG, fastest=1e8, kinds=("broken",), lanes=1, intervals=1,
    ),
))  # fmt: skip
"""Motions by their names."""

# ---- motions -----------------------------------------------------------------------------------------

LOG2_OF_10 = 3.3219280948873626
BROKEN = np.nan, np.inf, 1e200, 1e60, 1e20
"""Rates of the first joint that are no numbers, or with which a motion soon is none."""


def powers(rng: np.random.Generator, low: float, high: float, shape: Any) -> Array:
    """Numbers from about 10^low to 10^high of either sign, the same on every machine."""
    exponents = np.floor(LOG2_OF_10 * (low + (high - low) * rng.random(shape))).astype(np.int64)
    return np.where(rng.random(shape) < 0.5, -1.0, 1.0) * np.ldexp(1.0 + rng.random(shape), exponents)


def starts(aimed: Aimed, rng: np.random.Generator) -> tuple[Array, Array]:
    """States of lanes: of each kind in turn."""
    arm, n = aimed.scene.robot, aimed.lanes
    shape = n, len(arm.coordinates)
    kinds = np.array(aimed.kinds)[np.arange(n) % len(aimed.kinds)]
    q = 3.0 * rng.random(shape) - 1.5
    qd = 6.0 * rng.random(shape) - 3.0
    for kind, speeds in (
        ("at rest", 0.0 * qd), ("still", 0.0 * qd), ("slow, at stops", powers(rng, -16.0, 0.0, shape)),
        ("slow, near stops", powers(rng, -14.0, 0.5, shape)), ("near stops", 0.3 * qd),
        ("fast", powers(rng, 0.0, aimed.speeds, shape)),
    ):  # fmt: skip
        qd[kinds == kind] = speeds[kinds == kind]
    speed = np.abs(powers(rng, -8.0, 0.5, n))
    soon = np.abs(powers(rng, -4.0, -2.0, n))
    stops = [x for x in aimed.scene.effects if isinstance(x, e.PrismaticStop)]
    for i, k in enumerate(arm.sliders()):
        q[:, k] *= 0.1
        for effect in stops:
            ends = effect.lower[i], effect.upper[i]
            low, high = (far if end is None else end for far, end in zip((-1.0, 1.0), ends, strict=True))
            up = rng.random(n) < 0.5
            stop, inward = np.where(up, high, low), np.where(up, -1.0, 1.0)
            away = np.abs(powers(rng, -18.0, -1.0, n)) * np.isin(kinds, NEAR)
            placed = (rng.random(n) < 0.8) & np.isin(kinds, (*AT, *NEAR))
            placed |= np.isin(kinds, ("together", "one strikes"))
            q[:, k] = np.clip(np.where(placed, stop + inward * away, q[:, k]), low, high)
            qd[:, k] = np.where(kinds == "together", -inward * speed, qd[:, k])
            way = np.abs(qd[:, k]) * soon * (1.0 + powers(rng, -14.0, -6.0, n))
            nearly = kinds == "nearly together"
            q[:, k] = np.where(nearly, stop + inward * way, q[:, k])
            qd[:, k] = np.where(nearly, -inward * np.abs(qd[:, k]), qd[:, k])
    for k, slides in enumerate(arm.prismatic):
        if not slides:
            qd[kinds == "nearly together", k] = 0.0
            qd[:, k] = np.where(kinds == "spun", powers(rng, 1.0, 2.3, n), qd[:, k])
    alone = kinds == "one strikes"
    striking = rng.integers(0, len(arm.sliders()) or 1, n)
    for i, k in enumerate(arm.sliders()):
        qd[:, k] = np.where(alone, np.where(striking == i, np.sign(q[:, k]) * speed, 0.0), qd[:, k])
    qd[alone] *= arm.prismatic
    turns = ~np.array(arm.prismatic)
    for kind, sides, speeds in (
        ("folded", powers(rng, -7.0, -3.0, shape), powers(rng, -1.0, 1.0, shape)),
        ("in step", 0.01 * rng.random((n, 1)), powers(rng, 0.0, 1.0, (n, 1))),
    ):
        q[kinds == kind] = np.where(turns & (kind == "in step"), 0.0, sides + 0.0 * q)[kinds == kind]
        qd[kinds == kind] = np.where(turns, 0.0, speeds + 0.0 * qd)[kinds == kind]
    q[kinds == "at a kink"] = 0.0
    q[kinds == "at a kink", -1] = PLAY.play
    qd[kinds == "round", 0] = np.ldexp(1.0, rng.integers(4, 9, n))[kinds == "round"]
    qd[kinds == "round", 1:] *= 0.1
    _send_past(aimed, rng, kinds, q, qd)
    broken = np.flatnonzero(kinds == "broken")[: len(BROKEN) + 1]
    qd[broken, 0] = (aimed.fastest, *BROKEN)[: len(broken)]
    return q, qd


def _send_past(aimed: Aimed, rng: np.random.Generator, kinds: Array, q: Array, qd: Array) -> None:
    """Lanes of an arm that begins with a slider: thrown against gravity, it turns very near its lower stop
    within an interval; or it creeps there from within rounding."""
    if not np.isin(kinds, ("thrown", "creeping")).any():
        return
    (stop,) = (float(x.lower[0] or 0.0) for x in aimed.scene.effects if isinstance(x, e.PrismaticStop))
    n, h = aimed.lanes, aimed.scene.control_dt
    turn, miss = h * rng.random(n), powers(rng, -17.0, -1.0, n)
    turn[::2] = 0.5 * h * (1.0 + miss[::2])
    height = np.maximum(0.5 * FALL * turn * turn * (1.0 + miss[::-1]), 0.0)
    creeping = np.abs(stop) * np.ldexp(np.floor(8.0 * rng.random(n)), -53)
    for kind, way, speed in (
        ("thrown", height, FALL * turn), ("creeping", creeping, creeping / (h * (0.2 + rng.random(n)))),
    ):  # fmt: skip
        hanging = [0.0 if slides else -0.5 * np.pi for slides in aimed.scene.robot.prismatic]
        q[kinds == kind], qd[kinds == kind] = hanging, 0.0
        q[:, 0] = np.where(kinds == kind, stop + way, q[:, 0])
        qd[:, 0] = np.where(kinds == kind, -speed, qd[:, 0])


def parameters(aimed: Aimed, rng: np.random.Generator) -> dict[str, Array]:
    """Masses of each lane, light ones between heavy ones among them, and its restitution."""
    n, arm = aimed.lanes, aimed.scene.robot
    values = {"masses": np.abs(powers(rng, -1.5, 1.0, (n, len(arm.coordinates))))}
    if any(isinstance(effect, e.PrismaticStop) for effect in aimed.scene.effects):
        values["prismatic_stop.restitution"] = rng.choice((0.0, 0.5, 1.0, 0.1, 0.95), n)
    return values


def aimed_motion(name: str) -> Iterator[Array]:
    """Tables of numbers, interval by interval."""
    aimed = AIMED[name]
    rng = np.random.default_rng(len(name))
    q, qd = starts(aimed, rng)
    batch = rde.BatchSimulator(aimed.scene, aimed.lanes, track_work=aimed.work)
    batch.set_state(q, qd)
    if aimed.varied:
        batch.set_parameters(parameters(aimed, rng))
    if aimed.numbers:
        batch.set_parameters(aimed.numbers)
    shape = (aimed.lanes, len(aimed.scene.robot.coordinates))
    steady = powers(rng, aimed.efforts - 4.5, aimed.efforts, shape)
    for _ in range(aimed.intervals):
        changing = rng.random(shape) < 0.5
        steady = np.where(changing, powers(rng, aimed.efforts - 4.5, aimed.efforts, shape), steady)
        steady[::4] = 0.0
        status = batch.advance(steady)
        yield from (batch.q, batch.qd, batch.z)
        yield from (np.asarray(column, np.float64) for column in status)
        if aimed.work:
            yield batch.work
            happened = events(batch)
            yield np.array([(x.lane, x.time, x.speed) for x in happened])
            yield np.array([f"{x.kind} {x.joint}" for x in happened])


def events(batch: rde.BatchSimulator) -> list[Any]:
    """The events of an interval; none if a lane had more than are kept."""
    try:
        return batch.events()
    except ValueError:
        return []
