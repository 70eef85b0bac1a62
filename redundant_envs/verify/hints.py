"""Does error control know the time scales of effects, and do dampers brake?

The declared stiffness, damping and rates of states determine how short steps must be before any error
estimate exists; here they are compared with derivatives of forces and of states.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from redundant_envs.dual import Dual, dual
from redundant_envs.effects.hooks import Effect, Force, Point
from redundant_envs.events.boundary import side_beyond
from redundant_envs.lane.direct import fields_of
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.loaded_arm import identifier
from redundant_envs.quantities import Quantities
from redundant_envs.verify.checks import (
    ROUNDING,
    Array,
    Finding,
    Mode,
    NotApplicable,
    Trial,
    at_most,
    check,
    ratio,
)
from redundant_envs.verify.equations import TILTED

SHORT = at_most(1.5)
"""A step covers two radians of an oscillation, or two time constants of a decay. With half as much again it
covers three, which is still in the region of stability of rk8; and a declared number may leave out states
that hardly occur."""
SLOWEST = 6.0
"""Number of decades of rates below the usual ones: friction that is smooth at 0 is steepest there."""
DRIVES = at_most(1e-6)
"""Largest positive power of a damper, in units of the largest power that it absorbs."""

Case = tuple[Dynamics, Effect, Force]


class Motion:
    """Joint positions and rates at which the hooks of a scene are evaluated, and efforts."""

    def __init__(self, dynamics: Dynamics, joints: Array, rates: Array, efforts: Array | float = 0.0) -> None:
        self.dynamics, self.joints, self.rates = dynamics, joints, rates
        self.efforts = np.broadcast_to(efforts, joints.shape)

    def values(
        self,
        more: Mapping[str, Any] = MappingProxyType({}),
        moved: int | None = None,
        faster: int | None = None,
    ) -> Quantities:
        """All quantities, some of them given in ``more``, with derivatives by the position of the joint
        ``moved``, or by the rate of the joint ``faster``."""
        arm, d = self.dynamics.arm, self.dynamics
        back = np.linalg.inv(arm.motor_map)
        known: dict[str, Any] = fields_of(d) | {n: s.initial for n, s in d.effect_states.items()}
        known |= {name: self.efforts[:, k] for k, name in enumerate(d.commands)}
        for names, numbers, joint in ((arm.coordinates, self.joints, moved), (arm.rates, self.rates, faster)):
            columns = (numbers @ back).T
            slopes = np.zeros(len(names)) if joint is None else back[joint]
            along = (Dual(x, s) if s else x for x, s in zip(columns, slopes.tolist(), strict=True))
            known |= dict(zip(names, along, strict=True))
        for switch in d.law_of.values():
            position = self.joints[:, switch.joint]
            known[switch.side] = side_beyond(position, known[switch.lower], known[switch.upper])
        return Quantities({**TILTED, **known, **more}, d.functions, arm.sincos)

    def of(self, case: Case, function: Callable[..., Any], x: Quantities) -> list[Any]:
        """The result of a function of a force, one or two components."""
        found = case[0].apply(*case[1:], function, x)
        return [*found] if isinstance(found, tuple) else [found]

    def slopes(self, case: Case, of_rate: bool) -> Array:
        """Derivatives of a force by its own position or rate: their largest sum of squares, a root of it."""
        hook, count = case[2], len(self.joints)
        if not isinstance(hook.joint, Point):
            x = self.values(faster=hook.joint) if of_rate else self.values(moved=hook.joint)
            (force,) = self.of(case, hook.function, x)
            return np.abs(np.broadcast_to(dual(force).slope, count))
        columns = []
        for name in point_names(case, of_rate):
            plain = self.values()
            moving = self.values({alias: Dual(plain[alias], 1.0) for alias in name})
            columns += [np.broadcast_to(dual(f).slope, count) for f in self.of(case, hook.function, moving)]
        table = np.stack(columns, axis=-1).reshape(count, 2, 2)
        return np.asarray(np.linalg.norm(table, ord=2, axis=(1, 2)))


def point_names(case: Case, of_rate: bool) -> list[list[str]]:
    """Names of the coordinates, or velocities, of the point of a force; the tip has two names for each."""
    assert isinstance(case[2].joint, Point)
    number, form = case[2].joint.number + 1, "v" if of_rate else ""
    last = number == case[0].arm.num_masses
    return [[f"{form}{axis}{number}", *([f"tip_{form}{axis}"] if last else [])] for axis in "xy"]


def cases(trial: Trial) -> Iterator[tuple[Case, Motion]]:
    """Forces of a scene that declare stiffness or damping, each with motions in all its regimes: between its
    switches and beyond both, at rates of all sizes."""
    dynamics, (q, qd) = Dynamics(trial.scene), trial.poses
    rng = np.random.default_rng(trial.seed + 7)
    B = dynamics.arm.motor_map
    rates = qd @ B * 10.0 ** -(rng.uniform(0.0, SLOWEST, (len(q), 1)) ** (np.arange(len(q)) % 2)[:, None])
    for effect, hook in dynamics.hooks:
        if not isinstance(hook, Force) or (hook.stiffness is None and hook.damping is None):
            continue
        joints = q @ B
        if hook.switch is not None and isinstance(hook.joint, int):
            low, high = (effect.parameters()[name[1:]] for name in hook.switch)
            width = high - low if np.isfinite(high - low) else 1.0
            share = rng.uniform(0.0, 0.5, len(q)) * width
            beyond = np.where(np.arange(len(q)) % 4 < 2, low - share, high + share)
            use = (np.arange(len(q)) % 2 == 0) & np.isfinite(beyond)
            joints[use, hook.joint] = beyond[use]
        yield (dynamics, effect, hook), Motion(dynamics, joints, rates)


def worst_of(findings: list[Finding], reason: str) -> Finding:
    if not findings:
        raise NotApplicable(reason)
    return max(findings, key=lambda f: f.found if f.found == f.found else np.inf)


def hinted(trial: Trial, which: str) -> list[Finding]:
    """Ratios of the actual to the declared stiffness or damping of forces."""
    found = []
    for case, motion in cases(trial):
        effect, hook = case[1:]
        function = getattr(hook, which)
        if function is None:
            continue
        if which == "stiffness":
            motion = Motion(case[0], motion.joints, 0.0 * motion.rates)
        own = motion.slopes(case, which == "damping")
        declared = np.broadcast_to(motion.of(case, function, motion.values())[0], own.shape)
        gap, where = trial.worst(np.where(np.isfinite(declared), ratio(own, declared), np.nan))
        state = int(where.removeprefix("state "))
        words = (
            f"{effect.key}: the {which} of the force is {own[state]:.6g} and {which}= gives "
            f"{declared[state]:.6g}: error control takes steps that are too long; give the largest"
        )
        found.append(Finding(gap, f"{where}, {effect.key}", words))
    return found


@check("declared stiffness", SHORT, Mode.QUICK)
def stiffness(trial: Trial) -> Finding:
    """The derivative of a force by its position, at rest, in units of the stiffness that it declares."""
    return worst_of(hinted(trial, "stiffness"), "no force declares a stiffness")


@check("declared damping", SHORT, Mode.QUICK)
def damping(trial: Trial) -> Finding:
    """The derivative of a force by its rate, in units of the damping that it declares."""
    return worst_of(hinted(trial, "damping"), "no force declares a damping")


@check("dampers brake", DRIVES, Mode.QUICK)
def dampers(trial: Trial) -> Finding:
    """A force that declares a damping dissipates energy: the part that its own rate causes has no positive
    power.

    The part that follows from a potential is left out, and so are the rates of other joints: a damper between
    two joints may drive one of them.
    """
    found = []
    for case, motion in cases(trial):
        effect, hook = case[1:]
        if hook.damping is None:
            continue
        if isinstance(hook.joint, Point):
            names = point_names(case, of_rate=True)
            x = motion.values()
            rates = [np.broadcast_to(x[name[0]], len(motion.joints)) for name in names]
            still = motion.values({alias: 0.0 * x[name[0]] for name in names for alias in name})
        else:
            slow = np.where(np.arange(motion.rates.shape[1]) == hook.joint, 0.0, motion.rates)
            x, still = motion.values(), Motion(case[0], motion.joints, slow).values()
            rates = [motion.rates[:, hook.joint]]
        moving, resting = (
            np.stack([np.broadcast_to(f, len(rates[0])) for f in motion.of(case, hook.function, at)])
            for at in (x, still)
        )
        speed = np.linalg.norm(rates, axis=0)
        power = np.sum((moving - resting) * rates, axis=0)
        noise = ROUNDING * np.abs(moving).max(axis=0) * speed
        largest = np.linalg.norm(moving - resting, axis=0).max() * speed
        gap, where = trial.worst(ratio(np.maximum(power - noise, 0.0), largest))
        state = int(where.removeprefix("state "))
        words = (
            f"{effect.key}: declares a damping, and drives: its rate adds {power[state]:.3g} W; turn its "
            "sign, or leave damping= out and give what is meant to drive as an Actuation"
        )
        found.append(Finding(gap, f"{where}, {effect.key}", words))
    return worst_of(found, "no force declares a damping")


@check("declared rates of states", SHORT, Mode.QUICK)
def rates_of_states(trial: Trial) -> Finding:
    """Derivatives of the rates of change of effects' states by these states, and the fastest motion of the
    states of a hook together, in units of the rates that they declare."""
    dynamics, (q, qd, efforts) = Dynamics(trial.scene), trial.states
    B, found = dynamics.arm.motor_map, []
    motion = Motion(dynamics, q @ B, qd @ B, efforts)
    for effect, hook in dynamics.hooks:
        states = [s for s in getattr(hook, "states", ()) if s.derivative is not None]
        if not any(s.rate is not None for s in states):
            continue
        names = [identifier(f"{effect.key}.{s.name}") for s in states]
        own, declared = np.zeros((len(q), len(states), len(states))), np.full((len(states), len(q)), np.nan)
        for j, (name, state) in enumerate(zip(names, states, strict=True)):
            x = motion.values({name: Dual(np.full(len(q), state.initial), 1.0)})
            for i, other in enumerate(states):
                own[:, i, j] = dual(dynamics.apply(effect, other, other.derivative, x)).slope
            if state.rate is not None:
                declared[j] = dynamics.apply(effect, state, state.rate, x)
        said = [j for j, s in enumerate(states) if s.rate is not None]
        gaps = [ratio(own[:, j, j], declared[j]) for j in said]
        if len(said) == len(states) and np.isfinite(own).all():
            gaps.append(ratio(np.abs(np.linalg.eigvals(own)).max(axis=1), declared.max(axis=0)))
        most, where = trial.worst(np.stack(gaps, axis=1), [*(states[j].name for j in said), "together"])
        words = (
            f"{effect.key}: states change {most:.3g} times as fast as their rate= says: error control takes "
            "steps that are too long; give the largest"
        )
        found.append(Finding(most, f"{where}, {effect.key}", words))
    return worst_of(found, "no state declares a rate")
