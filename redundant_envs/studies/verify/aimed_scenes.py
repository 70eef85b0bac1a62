# mypy: allow-untyped-defs
"""Scenes aimed at every way in which a lane crosses a control interval, for the record of bits.

Their starts are chosen to meet rare cases: sliders at rest at their stops, or nearer to them than rounding,
at speeds from 1e-16 m/s on; several sliders at once; links too fast for any number of steps. Each motion has
many lanes and few intervals.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.algebra import clamp, maximum, physics
from redundant_envs.effects.hooks import Actuation, Effect, Force, Hook, Link, State

Array = NDArray[Any]
LANES, INTERVALS = 512, 16
LOG2_OF_10 = 3.3219280948873626

# ---- effects with states and kinks ------------------------------------------------------------------


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


# ---- scenes -----------------------------------------------------------------------------------------

RPRP = rde.RPRP(masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3, 0.5))
ONE = rde.Chain("RP", masses=(1.0, 0.5), lengths=(0.4,))
TWO = rde.Chain("PPR", masses=(1.0, 2.0, 0.5), lengths=(0.4,))
THREE = rde.Chain("RPPP", masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3,))
BENT = rde.Chain("PRPRP", masses=(2.0, 1.5, 1.0, 0.5, 0.7), lengths=(0.3, 0.5))
FOUR = rde.Chain("PPPP", masses=(2.0, 0.5, 1.0, 0.3))
FOUR_R = rde.FourR(masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3, 0.5, 0.4, 0.6))
GRAVITY = e.Gravity(9.81, (0.6, -0.7))


def stops(arm: Any, restitution: float = 0.5, width: float = 0.2) -> e.Effect:
    """Stops of all sliders, each farther out than the one before."""
    count = len(arm.sliders())
    lower, upper = (-width * (1.0 + 0.3 * k) for k in range(count)), (width + 0.1 * k for k in range(count))
    return e.PrismaticStop(tuple(lower), tuple(upper), restitution)


def springs(*joints: str, damping: float = 20.0) -> tuple[e.Effect, ...]:
    return tuple(e.LimitSpring(joint, -0.15, 0.1, 900.0, damping) for joint in joints)


AT = ("at rest", "slow, at stops")
NEAR = ("slow, near stops", "near stops", "still")
PLACED = (*AT, *NEAR)
KINDS = ("anywhere", *PLACED, "fast", "together", "broken")
"""Kinds of starts: sliders at their stops, from 1e-18 to 0.1 m away, all striking at once; numbers that are
not finite, or too large."""


@dataclass(frozen=True)
class Aimed:
    """A motion of a scene.

    Attributes
    ----------
    scene : rde.Scene
    work : whether the work is tracked and events are logged
    varied : whether each lane has masses and a restitution of its own
    speeds : greatest speed of links and sliders at the start is 10 to this power, rad/s and m/s
    fastest : speed of the first joint in one lane, rad/s or m/s
    lanes, intervals : their numbers
    kinds : of starts, one after the other
    """

    scene: rde.Scene
    work: bool = False
    varied: bool = True
    speeds: float = 1.0
    fastest: float = 1e5
    lanes: int = LANES
    intervals: int = INTERVALS
    kinds: tuple[str, ...] = KINDS


def fixed(arm: Any, *effects: e.Effect, integrator: str = "rk8", **more: Any) -> rde.Scene:
    return rde.Scene(arm, effects, integrator, **more)


def doubling(arm: Any, *effects: e.Effect, tolerance: float = 1e-6, **more: Any) -> rde.Scene:
    return rde.Scene(arm, effects, tolerance=tolerance, **more)


def adaptive(arm: Any, *effects: e.Effect, **more: Any) -> rde.Scene:
    return rde.Scene(arm, effects, "dop853", **more)


LAG, PLAY = Lag(0.01), Play(0.02, 3.0)
AIMED: dict[str, Aimed] = {
    # Equal steps: stops only; switches are not located.
    "events: euler, 2 sliders, 3 substeps, log": Aimed(
        fixed(RPRP, GRAVITY, stops(RPRP), integrator="euler", control_dt=0.03, substeps=3), work=True
    ),
    "events: rk4, 1 slider": Aimed(fixed(ONE, GRAVITY, stops(ONE), integrator="rk4"), varied=False),
    "events: rk4, 2 sliders, generalized, lag": Aimed(
        fixed(TWO, stops(TWO), LAG, PLAY, integrator="rk4", actuation="generalized")
    ),
    "events: rk8, 2 sliders, 2 substeps, log": Aimed(
        fixed(RPRP, GRAVITY, stops(RPRP), *springs("joint2"), control_dt=0.04, substeps=2), work=True
    ),
    "events: rk8, 3 sliders, log": Aimed(fixed(THREE, GRAVITY, stops(THREE)), work=True),
    "events: rk4, 3 bent sliders": Aimed(fixed(BENT, GRAVITY, stops(BENT), integrator="rk4")),
    "events: rk4, 4 sliders": Aimed(fixed(FOUR, GRAVITY, stops(FOUR), integrator="rk4")),
    "events: rk8, 2 sliders, turns near stops": Aimed(
        fixed(RPRP, GRAVITY, stops(RPRP), LAG, control_dt=0.05), kinds=NEAR
    ),
    # Doubling under a tolerance.
    "events: 1e-6, 1 slider, log": Aimed(doubling(ONE, GRAVITY, stops(ONE)), work=True),
    "events: 1e-6, 2 sliders, log": Aimed(doubling(RPRP, GRAVITY, stops(RPRP)), work=True),
    "events: 1e-12, 2 sliders": Aimed(doubling(RPRP, GRAVITY, stops(RPRP), tolerance=1e-12)),
    "events: 1e-6, 3 sliders": Aimed(doubling(THREE, GRAVITY, stops(THREE))),
    "events: 1e-9, 2 sliders, switches, lag, kinks, log": Aimed(
        doubling(TWO, stops(TWO), *springs("joint1", "r2"), LAG, PLAY, tolerance=1e-9),
        work=True,
        lanes=64,
        intervals=12,
    ),
    "events: 1e-6, switches": Aimed(
        doubling(RPRP, GRAVITY, *springs("r1", "r2", "joint2", damping=300.0)), lanes=192
    ),
    "events: 1e-6, 4R switches, kinks, generalized": Aimed(
        doubling(FOUR_R, *springs("joint2", "joint4"), PLAY, actuation="generalized"),
        speeds=2.0,
        lanes=96,
        intervals=12,
    ),
    "events: 1e-6, no boundaries, lag, kinks": Aimed(doubling(RPRP, GRAVITY, LAG, PLAY), speeds=3.0),
    "events: 1e-6, 2 sliders, turns near stops": Aimed(
        doubling(RPRP, GRAVITY, stops(RPRP), LAG, control_dt=0.05), kinds=NEAR
    ),
    "events: 1e-6, 2 sliders, stops on one side at 0": Aimed(
        doubling(RPRP, GRAVITY, e.PrismaticStop((0.0, None), (None, 0.0), 0.5))
    ),
    # dop853.
    "events: dop853, 2 sliders, log": Aimed(adaptive(RPRP, GRAVITY, stops(RPRP)), work=True),
    "events: dop853, 3 sliders": Aimed(adaptive(THREE, GRAVITY, stops(THREE))),
    "events: dop853, stops, switches, lag, kinks": Aimed(
        adaptive(TWO, stops(TWO), *springs("joint1", "r2"), LAG, PLAY), lanes=192
    ),
    "events: dop853, 2 sliders, turns near stops": Aimed(
        adaptive(RPRP, GRAVITY, stops(RPRP), LAG, control_dt=0.05), kinds=NEAR
    ),
    "events: dop853, switches": Aimed(adaptive(RPRP, GRAVITY, *springs("r1", "r2")), speeds=2.0),
    "events: dop853, no boundaries": Aimed(adaptive(FOUR_R, GRAVITY, LAG), speeds=4.0, lanes=96),
}
"""Motions by their names."""

# ---- motions ----------------------------------------------------------------------------------------


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
    stops = [x for x in aimed.scene.effects if isinstance(x, e.PrismaticStop)]
    for i, k in enumerate(arm.sliders()):
        q[:, k] *= 0.1
        for effect in stops:
            ends = effect.lower[i], effect.upper[i]
            low, high = (far if end is None else end for far, end in zip((-1.0, 1.0), ends, strict=True))
            up = rng.random(n) < 0.5
            stop, inward = np.where(up, high, low), np.where(up, -1.0, 1.0)
            away = np.abs(powers(rng, -18.0, -1.0, n)) * np.isin(kinds, NEAR)
            placed = (rng.random(n) < 0.8) & np.isin(kinds, PLACED) | (kinds == "together")
            q[:, k] = np.clip(np.where(placed, stop + inward * away, q[:, k]), low, high)
            qd[:, k] = np.where(kinds == "together", -inward * speed, qd[:, k])
    broken = np.flatnonzero(kinds == "broken")[:4]
    qd[broken, 0] = (np.nan, np.inf, 1e200, aimed.fastest)[: len(broken)]
    return q, qd


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
    shape = (aimed.lanes, len(aimed.scene.robot.coordinates))
    steady = powers(rng, -2.0, 2.0, shape)
    for _ in range(aimed.intervals):
        changing = rng.random(shape) < 0.5
        steady = np.where(changing, powers(rng, -3.0, 1.5, shape), steady)
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
