"""Velocities that jump between intervals: by impulses, and where the arm gains or loses a mass."""

from collections.abc import Iterable, Mapping
from typing import Any

from redundant_envs.effects.bound_hooks import field_of
from redundant_envs.effects.hooks import Impulse, Point, PointMass
from redundant_envs.language.algebra import any_of, logical_not, maximum, total, where
from redundant_envs.language.quantities import Quantities
from redundant_envs.simulator.lane.dynamics import Dynamics, add, components, response
from redundant_envs.simulator.lane.features import Features
from redundant_envs.simulator.lane.memory import Lane


def strike(features: Features, lane: Lane, happens: Mapping[str, Any] | None = None) -> None:
    """The impulses at the start of an interval, or those at instants that happen now, by the fields that say
    whether they have passed; their work is that of the mean velocity, before and after."""
    when = "interval" if happens is None else "instant"
    dynamics = features.dynamics
    impulses = [a for a in dynamics.scene.attached.of(Impulse) if a.hook.when == when]
    if not impulses:
        return
    x = features.quantities(lane)
    dynamics.set_field(x)
    pushes: dict[str, Any] = {}
    at_coordinates: list[Any] = [0.0] * dynamics.count
    for a in impulses:
        push = components(a, "function", x)
        if happens is not None:
            push = {rate: where(happens[a.passed], p, 0.0) for rate, p in push.items()}
        add(pushes, push)
        for row, p in zip(_slopes(dynamics, a.hook.joint, x), push.values(), strict=True):
            at_coordinates = [q + slope * p for q, slope in zip(at_coordinates, row, strict=True)]
    struck = any_of(logical_not(p == 0.0) for p in pushes.values())
    after = _jump(features, lane, x, at_coordinates, struck)
    if "work" in dynamics.states:
        gained = 0.5 * total(p * (x[rate] + after[rate]) for rate, p in pushes.items())
        lane.work = where(struck, lane.work + gained, lane.work)


def exchange(features: Features, lane: Lane, before: Quantities) -> None:
    """After states have been updated: masses come from rest, or leave with the velocities of their points.

    ``before`` are the quantities with the masses before. M qd stays the same where masses come: the impulse
    on each of these points is minus the mass times its velocity.
    """
    dynamics = features.dynamics
    at_coordinates: list[Any] = [0.0] * dynamics.count
    points: list[tuple[int, Any, Any]] = []  # its number, masses that come and that leave
    for a in dynamics.scene.attached.of(PointMass):
        name = a.parameter(a.hook.mass)
        if name not in dynamics.effect_states:
            continue
        k = a.hook.point.number + 1
        more = lane[name] - before[name]
        gain, loss = maximum(more, 0.0), maximum(-more, 0.0)
        points.append((k, gain, loss))
        for row, v in zip(_slopes(dynamics, a.hook.point, before), (f"vx{k}", f"vy{k}"), strict=True):
            p = -gain * before[v]
            at_coordinates = [q + slope * p for q, slope in zip(at_coordinates, row, strict=True)]
    if not points:
        return
    now = features.quantities(lane)
    after = _jump(features, lane, now, at_coordinates, any_of(gain > 0.0 for _, gain, _ in points))
    if "work" not in dynamics.states:
        return
    ax, ay = field_of(dynamics.scene.attached.constant_fields, before)
    for k, gain, loss in points:
        old, new = ([q[f"vx{k}"], q[f"vy{k}"]] for q in (before, after))
        kinetic = -0.5 * (gain * _dot(old, new) + loss * _dot(old, old))
        potential = (gain - loss) * (ax * before[f"x{k}"] + ay * before[f"y{k}"])
        lane.work = where(logical_not(gain == loss), lane.work + (kinetic + potential), lane.work)


def _jump(features: Features, lane: Lane, x: Quantities, push: Iterable[Any], happens: Any) -> Quantities:
    """Let the velocities jump by M^-1 of a generalized impulse where a condition holds, and let go of sliders
    at rest; the quantities after it."""
    jumps = zip(features.arm.rates, response(features.dynamics, list(push), x), strict=True)
    lane.set_where(happens, {v: lane[v] + dv for v, dv in jumps})
    lane.set_where(happens, dict.fromkeys(features.active, 0.0))
    return features.quantities(lane)


def _slopes(dynamics: Dynamics, joint: int | Point, x: Quantities) -> list[list[Any]]:
    """Derivatives of a joint's position, or of both coordinates of a point, by the coordinates of the arm."""
    if isinstance(joint, Point):
        return [[x[f"{axis}{joint.number + 1}{j + 1}"] for j in range(dynamics.count)] for axis in "XY"]
    return [dynamics.arm.motor_map[:, joint].tolist()]


def _dot(a: Iterable[Any], b: Iterable[Any]) -> Any:
    return total(x * y for x, y in zip(a, b, strict=True))
