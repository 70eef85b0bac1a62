"""Coordinates of boundaries: their values, rates and accelerations, and how impulses along them act.

The coordinate of a stop is the travel of a slider, that of a force's law the motion of a joint. A boundary
without a joint has a gap, any function of the motion; dual numbers give its derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from redundant_envs.algebra import ABSENT
from redundant_envs.dual import Dual, dual
from redundant_envs.events.boundary import Boundary
from redundant_envs.quantities import Quantities

if TYPE_CHECKING:
    from redundant_envs.lane.dynamics import Dynamics
    from redundant_envs.lane.memory import Lane


def motion(dynamics: Dynamics, b: Boundary, lane: Lane, form: str = "{}") -> tuple[Any, Any]:
    """Value and rate of a coordinate, from the fields of a form."""
    arm = dynamics.arm
    if b.joint is None:
        states = lane.get((*arm.coordinates, *arm.rates), of=form)
        q, v = states[: dynamics.count], states[dynamics.count :]
        gap = _gap(dynamics, b, [Dual(x, y) for x, y in zip(q, v, strict=True)], lane)
        return gap.value, gap.slope
    if b.bounces:
        return lane[form.format(arm.coordinates[b.joint])], lane[form.format(arm.rates[b.joint])]
    known = dict(zip(dynamics.states, lane.get(dynamics.states, of=form), strict=True))
    x = Quantities(known, tuple(arm.functions), arm.sincos, lane)
    return x[f"phi{b.joint + 1}"], x[f"phid{b.joint + 1}"]


def acceleration(dynamics: Dynamics, b: Boundary, x: Quantities) -> Any:
    """Acceleration of a gap, from quantities with the accelerations of the coordinates."""
    q, v, a = _motion_of_arm(dynamics, x)
    moving = [Dual(Dual(x0, x1), Dual(x1, x2)) for x0, x1, x2 in zip(q, v, a, strict=True)]
    return dual(_gap(dynamics, b, moving, _numbers(dynamics, x)).slope).slope


def normal(dynamics: Dynamics, b: Boundary, x: Quantities) -> list[Any]:
    """Derivatives of a coordinate with respect to the coordinates of the arm."""
    q, _, _ = _motion_of_arm(dynamics, x)
    n = range(dynamics.count)
    if b.joint is not None:
        return [1.0 if k == b.joint else 0.0 for k in n]
    numbers = _numbers(dynamics, x)
    return [_gap(dynamics, b, [Dual(q[j], float(j == k)) for j in n], numbers).slope for k in n]


def response(dynamics: Dynamics, impulse: Sequence[Any], x: Quantities) -> list[Any]:
    """Change of the coordinates' velocities by a generalized impulse, M^-1 n: the accelerations of an arm at
    rest, without a field, under a force of that size."""
    arm = dynamics.arm
    still = {q: x[q] for q in arm.coordinates} | dict.fromkeys(arm.rates, 0.0) | {"ax": ABSENT, "ay": ABSENT}
    still |= {f"Q{k + 1}": push for k, push in enumerate(impulse)}
    made = Quantities({**_numbers(dynamics, x), **still}, dynamics.functions, arm.sincos)
    return made.each(f"qdd{k + 1}" for k in range(dynamics.count))


def _numbers(dynamics: Dynamics, x: Quantities) -> dict[str, Any]:
    return {name: x[name] for name in dynamics.numbers}


def _motion_of_arm(dynamics: Dynamics, x: Quantities) -> tuple[list[Any], list[Any], list[Any]]:
    arm = dynamics.arm
    accelerations = [x.get(f"qdd{k + 1}", 0.0) for k in range(dynamics.count)]
    return x.each(arm.coordinates), x.each(arm.rates), accelerations


def _gap(dynamics: Dynamics, b: Boundary, coordinates: Sequence[Dual], numbers: Any) -> Dual:
    """A gap on coordinates with derivatives."""
    arm = dynamics.arm
    assert b.gap is not None
    known = dict(zip(arm.coordinates, coordinates, strict=True))
    return dual(b.gap(Quantities(known, tuple(arm.functions), arm.sincos, numbers)))
