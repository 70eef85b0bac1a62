"""Scenes aimed at every way in which a lane crosses a control interval, for the record of bits.

Their starts are chosen to meet rare cases: sliders at rest at their stops, or nearer to them than rounding,
at speeds from 1e-16 m/s on; several sliders at once; links too fast for any number of steps. Each motion has
many lanes and few intervals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.verify.aimed_effects import DryFriction, Lag, Play

LANES, INTERVALS = 512, 16

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


def stops(arm: Any, restitution: float = 0.5, width: float = 0.2) -> e.Effect:
    """Stops of all sliders, each farther out than the one before."""
    count = len(arm.sliders())
    lower, upper = (-width * (1.0 + 0.3 * k) for k in range(count)), (width + 0.1 * k for k in range(count))
    return e.PrismaticStop(tuple(lower), tuple(upper), restitution)


def springs(*joints: str, damping: float = 20.0) -> tuple[e.Effect, ...]:
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
    work: bool = False  # whether it is tracked and events are logged
    varied: bool = True  # whether each lane has masses and a restitution of its own
    speeds: float = 1.0  # the greatest of links and sliders at the start is 10 to this power, rad/s and m/s
    fastest: float = 1e5  # speed of the first joint in one lane, rad/s or m/s
    lanes: int = LANES
    intervals: int = INTERVALS
    kinds: tuple[str, ...] = KINDS  # of starts, one after the other
    efforts: float = 1.5  # the greatest is 10 to this power, N m or N
    numbers: Mapping[str, float] = field(
        default_factory=dict
    )  # others than the scene's: it shares machine code


def fixed(arm: Any, *effects: e.Effect, **more: Any) -> rde.Scene:
    return rde.Scene(arm, effects, **more)


doubling, adaptive = partial(fixed, tolerance=1e-6), partial(fixed, integrator="dop853")
WEIGHTLESS: dict[str, Any] = {
    "kinds": ("nearly together", "one strikes"),
    "efforts": -8.0,
    "numbers": {"gravity.g": 0.0},
}
FALLING = GRAVITY, stops(PAIR)
THROWN: dict[str, Any] = {"kinds": ("thrown",), "efforts": -8.0, "intervals": 4}
SWITCHES = springs("r1", "r2", "joint2", damping=300.0)
LONG: dict[str, Any] = {
    "kinds": ("near stops", "slow, near stops", "anywhere"),
    "lanes": 1536,
    "intervals": 10,
}
BUZZ = {"lower": -1e-6, "upper": 1e-6, "stiffness": 1e11, "damping": 0.0}
NARROW = e.PrismaticStop((-0.003, -0.002), (0.002, 0.004), 0.5)
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
        fixed(RPRP, GRAVITY, stops(RPRP), LAG, control_dt=0.05), kinds=NEAR[:3]
    ),
    "events: rk4, 4 sliders, nearly together": Aimed(
        fixed(FOUR, GRAVITY, stops(FOUR), integrator="rk4"), **WEIGHTLESS
    ),
    "events: rk8, 1 slider, late turns": Aimed(
        fixed(ONE, GRAVITY, e.PrismaticStop((0.0,), (None,), 0.5), control_dt=0.1), kinds=("spun",)
    ),
    "events: rk4, 2 sliders, forces that jump": Aimed(
        fixed(TWO, stops(TWO), DryFriction(2.0), integrator="rk4", control_dt=0.05), lanes=192
    ),
    "events: rk8, 2 sliders, narrow stops, 2 substeps, log": Aimed(
        fixed(RPRP, GRAVITY, NARROW, *springs("joint2"), control_dt=0.04, substeps=2), work=True
    ),
    "events: rk4, 2 sliders of a pair, thrown": Aimed(fixed(PAIR, *FALLING, integrator="rk4"), **THROWN),
    "events: rk4, 2 sliders of a pair, creeping, log": Aimed(
        fixed(PAIR, *FALLING, integrator="rk4"),
        work=True,
        **WEIGHTLESS | {"kinds": ("creeping", "slow, near stops")},
    ),
    "events: euler, 2 sliders, 3 substeps, long steps, log": Aimed(
        fixed(RPRP, GRAVITY, stops(RPRP), integrator="euler", control_dt=0.1, substeps=3), work=True, **LONG
    ),
    "events: rk4, 2 sliders, generalized, lag, long steps": Aimed(
        fixed(TWO, stops(TWO), LAG, PLAY, integrator="rk4", control_dt=0.1, actuation="generalized"), **LONG
    ),
    "events: rk8, 2 sliders, turns near stops, long steps": Aimed(
        fixed(RPRP, GRAVITY, stops(RPRP), LAG, control_dt=0.1), **LONG
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
    "events: 1e-6, switches": Aimed(doubling(RPRP, GRAVITY, *SWITCHES), lanes=192),
    "events: 1e-6, 4R switches, kinks, generalized": Aimed(
        doubling(FOUR_R, *springs("joint2", "joint4"), PLAY, actuation="generalized"),
        speeds=2.0,
        lanes=96,
        intervals=12,
    ),
    "events: 1e-6, no boundaries, lag, kinks": Aimed(
        doubling(RPRP, GRAVITY, LAG, PLAY), speeds=3.0, kinds=(*KINDS, "at a kink")
    ),
    "events: 1e-6, 2 sliders, turns near stops": Aimed(
        doubling(RPRP, GRAVITY, stops(RPRP), LAG, control_dt=0.05), kinds=NEAR[:3]
    ),
    "events: 1e-6, 2 sliders, stops on one side at 0": Aimed(
        doubling(RPRP, GRAVITY, e.PrismaticStop((0.0, None), (None, 0.0), 0.5))
    ),
    "events: 1e-6, 2 sliders, nearly together, log": Aimed(
        doubling(RPRP, GRAVITY, stops(RPRP)), work=True, **WEIGHTLESS
    ),
    "events: 1e-6, 2 sliders, narrow stops, log": Aimed(doubling(RPRP, GRAVITY, NARROW), work=True),
    "events: 1e-6, 2 sliders, thrown": Aimed(doubling(TWO, *FALLING), **THROWN),
    "events: 1e-2, 2 sliders, narrow stops, folded, log": Aimed(
        doubling(RPRP, GRAVITY, NARROW, tolerance=1e-2), work=True, **WEIGHTLESS | {"kinds": ("folded",)}
    ),
    "events: 1e-6, 2 sliders, narrow stops, kinks": Aimed(doubling(RPRP, GRAVITY, NARROW, PLAY), lanes=256),
    "events: 1e-13, 2 sliders": Aimed(doubling(RPRP, GRAVITY, stops(RPRP), tolerance=1e-13), intervals=8),
    "events: 1e-6, switches passed together": Aimed(
        doubling(RPRP, GRAVITY, *SWITCHES), varied=False, **WEIGHTLESS | {"kinds": ("in step",)}
    ),
    "events: 1e-6, switches, too stiff": Aimed(
        doubling(RPRP, GRAVITY, *SWITCHES),
        kinds=("folded",),
        lanes=16,
        intervals=2,
        efforts=-8.0,
        numbers={"gravity.g": 0.0, "limit_spring.joint2.stiffness": 1e14},
    ),
    "events: 1e-6, switches, too many trials": Aimed(
        doubling(RPRP, GRAVITY, *SWITCHES),
        kinds=("folded",),
        lanes=16,
        intervals=2,
        efforts=-8.0,
        numbers={"gravity.g": 0.0}
        | {f"limit_spring.{r}.{n}": x for r in ("r1", "r2") for n, x in BUZZ.items()},
    ),
    "events: 1e-6, no boundaries, steps a power of 2": Aimed(
        doubling(RPRP, GRAVITY, LAG, PLAY, control_dt=0.015625), kinds=("round",), lanes=96, intervals=2
    ),
    # dop853.
    "events: dop853, 2 sliders, log": Aimed(adaptive(RPRP, GRAVITY, stops(RPRP)), work=True),
    "events: dop853, 2 sliders, narrow stops, log": Aimed(adaptive(RPRP, GRAVITY, NARROW), work=True),
    "events: dop853, 2 sliders, thrown": Aimed(adaptive(TWO, *FALLING), **THROWN),
    "events: dop853, 3 sliders": Aimed(adaptive(THREE, GRAVITY, stops(THREE))),
    "events: dop853, stops, switches, lag, kinks": Aimed(
        adaptive(TWO, stops(TWO), *springs("joint1", "r2"), LAG, PLAY), lanes=192
    ),
    "events: dop853, 2 sliders, turns near stops": Aimed(
        adaptive(RPRP, GRAVITY, stops(RPRP), LAG, control_dt=0.05), kinds=NEAR[:3]
    ),
    "events: dop853, switches": Aimed(adaptive(RPRP, GRAVITY, *springs("r1", "r2")), speeds=2.0),
    "events: dop853, no boundaries": Aimed(adaptive(FOUR_R, GRAVITY, LAG), speeds=2.5, lanes=96, intervals=8),
    "events: dop853, no boundaries, too many steps": Aimed(
        adaptive(FOUR_R, GRAVITY, LAG), fastest=1e8, kinds=("broken",), lanes=1, intervals=1
    ),
}
"""Motions by their names."""
