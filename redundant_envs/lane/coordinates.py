"""Coordinates of boundaries, and quantities of a lane.

The coordinate of a stop is the travel of a slider or the angle of another joint, that of a force's law the
motion of a joint. A boundary without a joint has a gap, any function of the motion; dual numbers give its
derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

from redundant_envs.algebra import ABSENT, maximum, where
from redundant_envs.dual import Dual, dual
from redundant_envs.events.boundary import ROUNDING, Boundary, side_touched, size_of
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.memory import Lane
from redundant_envs.quantities import Quantities


def quantities_of_arm(dynamics: Dynamics, lane: Lane, form: str = "{}", *more: Any) -> Quantities:
    """Quantities of the arm from the fields of a form, by its functions and ``more``."""
    arm, states = dynamics.arm, lane.get(dynamics.states, of=form)
    known = dict(zip(dynamics.states, states, strict=True))
    return Quantities(known, (*dynamics.arm_functions, *more), arm.sincos, numbers_of(dynamics, lane))


def tip_norms(dynamics: Dynamics, lane: Lane, form: str = "{}") -> list[Any]:
    """Metres at the tip per unit of each coordinate, from the fields of a form."""
    x = quantities_of_arm(dynamics, lane, form, dynamics.arm.column_norms)
    return x.each(f"n{k + 1}" for k in range(dynamics.count))


def numbers_of(dynamics: Dynamics, x: Any) -> dict[str, Any]:
    """The numbers that are constant in a step, from quantities or a lane."""
    return {name: x[name] for name in dynamics.numbers}


def motion(dynamics: Dynamics, b: Boundary, lane: Lane, form: str = "{}") -> tuple[Any, Any]:
    """Value and rate of a coordinate, from the fields of a form."""
    arm = dynamics.arm
    if b.joint is None:
        q, v = (lane.get(names, of=form) for names in (arm.coordinates, arm.rates))
        gap = _gap(dynamics, b, [Dual(x, y) for x, y in zip(q, v, strict=True)], numbers_of(dynamics, lane))
        return gap.value, gap.slope
    if b.bounces and arm.prismatic[b.joint]:
        return lane[form.format(arm.coordinates[b.joint])], lane[form.format(arm.rates[b.joint])]
    x = quantities_of_arm(dynamics, lane, form)
    position, rate = x[f"phi{b.number}"], x[f"phid{b.number}"]
    if dynamics.rounds(b):
        position = _snapped(dynamics, dynamics.stop_of[b.joint], lane, form, position)
    return position, rate


def _snapped(dynamics: Dynamics, stop: Boundary, lane: Lane, form: str, position: Any) -> Any:
    """The angle of a joint, a difference of coordinates: an end of its travel where rounding alone differs.

    Coordinates that are set for an angle at an end give it back within two ulps of the largest of them.
    """
    size = reduce(maximum, [abs(lane[form.format(q)]) for q in dynamics.coordinates_of(stop)])
    for end in (lane[stop.lower], lane[stop.upper]):
        near = 0.5 * ROUNDING * maximum(size, size_of(end))
        position = where(abs(position - end) <= near, end, position)
    return position


def acceleration(dynamics: Dynamics, b: Boundary, x: Quantities) -> Any:
    """Acceleration of a gap, from quantities with the accelerations of the coordinates."""
    q, v = x.each(dynamics.arm.coordinates), x.each(dynamics.arm.rates)
    a = [x.get(f"qdd{k + 1}", 0.0) for k in range(dynamics.count)]
    moving = [Dual(Dual(x0, x1), Dual(x1, x2)) for x0, x1, x2 in zip(q, v, a, strict=True)]
    return dual(_gap(dynamics, b, moving, numbers_of(dynamics, x)).slope).slope


def normal(dynamics: Dynamics, b: Boundary, x: Quantities) -> list[Any]:
    """Derivatives of a coordinate with respect to the coordinates of the arm."""
    q, n = x.each(dynamics.arm.coordinates), range(dynamics.count)
    if b.joint is not None:
        return [float(share) for share in dynamics.arm.motor_map[:, b.joint]]
    numbers = numbers_of(dynamics, x)
    return [_gap(dynamics, b, [Dual(q[j], float(j == k)) for j in n], numbers).slope for k in n]


def response(dynamics: Dynamics, impulse: Sequence[Any], x: Quantities) -> list[Any]:
    """Change of the velocities by a generalized impulse, M^-1 n: accelerations at rest, without a field."""
    arm = dynamics.arm
    still = {q: x[q] for q in arm.coordinates} | dict.fromkeys(arm.rates, 0.0) | {"ax": ABSENT, "ay": ABSENT}
    still |= {f"Q{k + 1}": push for k, push in enumerate(impulse)}
    made = Quantities({**numbers_of(dynamics, x), **still}, dynamics.functions, arm.sincos)
    return made.each(f"qdd{k + 1}" for k in range(dynamics.count))


def _gap(dynamics: Dynamics, b: Boundary, coordinates: Sequence[Dual], numbers: Any) -> Dual:
    """A gap on coordinates with derivatives."""
    arm = dynamics.arm
    assert b.gap is not None
    known = dict(zip(arm.coordinates, coordinates, strict=True))
    return dual(b.gap(Quantities(known, dynamics.arm_functions, arm.sincos, numbers)))


def known_numbers(dynamics: Dynamics, lane: Lane) -> dict[str, Any]:
    """Inputs of the equations beside the state: efforts, parameters, and the stops at which sliders rest."""
    names = (*dynamics.commands, *dynamics.numbers, *dynamics.effect_states.updated, *dynamics.active)
    at = {b.at: side_of_stop(dynamics, stop, lane) for b, stop in dynamics.gripped}
    return {name: lane[name] for name in (*names, *dynamics.sides, *dynamics.passed)} | at


def side_of_stop(dynamics: Dynamics, stop: Boundary, lane: Lane, form: str = "{}") -> Any:
    """Side of the stop that a joint touches, in the state in the fields of a form."""
    return side_touched(*motion(dynamics, stop, lane, form), 0.0, lane[stop.lower], lane[stop.upper])


def contact_quantities(dynamics: Dynamics, states: Sequence[Any], numbers: dict[str, Any]) -> Quantities:
    """Quantities in a step, in which sliders may rest at their stops: "held1", ... are 1 while they do."""
    x = dynamics.quantities(states, numbers, held=bool(dynamics.holding or dynamics.sticking))
    x.update({f"held{k + 1}": 0.0 for k in dynamics.arm.sliders()})
    x.update({f"held{b.number}": abs(numbers[b.active]) for b in dynamics.holding})
    x.update({f"held{b.number}": where(numbers[b.side] == 0.0, 1.0, 0.0) for b in dynamics.sticking})
    return x


def pull(x: Quantities, b: Boundary, side: Any) -> Any:
    """Force with which its stop has to pull a resting slider; 0 for a free one."""
    return where(x[f"held{b.number}"] > 0.0, side * x[f"hold{b.number}"], 0.0)
