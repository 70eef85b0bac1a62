"""Boundaries of a lane: their coordinates, how a step meets them, and how contacts with stops are resolved.

The coordinate of a stop is the travel of a slider, that of a force's law the motion of a joint. A boundary
without a joint has a gap, any function of the motion; dual numbers give its derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from redundant_envs.algebra import ABSENT, any_of, cases, maximum, minimum, total, where
from redundant_envs.dual import Dual, dual
from redundant_envs.events import boundary, contacts, crossings
from redundant_envs.events.boundary import Boundary, BoundedCoordinate
from redundant_envs.events.contacts import Resolved
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.features import WATCHED, Reason
from redundant_envs.lane.memory import Lane
from redundant_envs.numerics.methods import Watched
from redundant_envs.quantities import Quantities


def quantities_of_arm(dynamics: Dynamics, lane: Lane, form: str = "{}", *more: Any) -> Quantities:
    """Quantities of the arm from the fields of a form, by its functions and ``more``."""
    arm, states = dynamics.arm, lane.get(dynamics.states, of=form)
    known = dict(zip(dynamics.states, states, strict=True))
    return Quantities(known, (*dynamics.arm_functions, *more), arm.sincos, numbers_of(dynamics, lane))


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
    if b.bounces:
        return lane[form.format(arm.coordinates[b.joint])], lane[form.format(arm.rates[b.joint])]
    x = quantities_of_arm(dynamics, lane, form)
    return x[f"phi{b.number}"], x[f"phid{b.number}"]


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
        return [1.0 if k == b.joint else 0.0 for k in n]
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
    return {name: lane[name] for name in (*names, *(b.side for b in dynamics.laws))}


def contact_quantities(dynamics: Dynamics, states: Sequence[Any], numbers: dict[str, Any]) -> Quantities:
    """Quantities in a step, in which sliders may rest at their stops: "held1", ... are 1 while they do."""
    x = dynamics.quantities(states, numbers, held=bool(dynamics.holding))
    if dynamics.holding:
        x.update({f"held{k + 1}": 0.0 for k in dynamics.arm.sliders()})
        x.update({f"held{b.number}": abs(numbers[b.active]) for b in dynamics.holding})
    return x


def pull(x: Quantities, b: Boundary, side: Any) -> Any:
    """Force with which its stop has to pull a resting slider; 0 for a free one."""
    return where(x[f"held{b.number}"] > 0.0, side * x[f"hold{b.number}"], 0.0)


class Boundaries:
    """Procedures of lanes at the boundaries of a scene."""

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics = dynamics

    def limits(self, lane: Lane, b: Boundary) -> tuple[Any, Any]:
        """Lower and upper limit of a coordinate."""
        if b.joint is None:
            return 0.0, math.inf
        if b.bounces:
            return lane[b.lower], lane[b.upper]
        return boundary.limits_of_law(lane[b.side], lane[b.lower], lane[b.upper])

    def active(self, lane: Lane, b: Boundary, form: str = "{}") -> Any:
        """Side of the stop at which a coordinate rests."""
        return lane[form.format(b.active)] if b in self.dynamics.holding else 0.0

    def in_step(self, lane: Lane, origin: str) -> list[BoundedCoordinate]:
        """The coordinates in a step, whose initial values are in fields of this form."""
        arm = self.dynamics.arm
        lengths = (lane[f"l{k + 1}"] for k in range(arm.num_lengths))
        # The size of the numbers from which a gap is computed, m.
        size = total([*lengths, *(abs(lane[arm.coordinates[k]]) for k in arm.sliders())])
        return [
            BoundedCoordinate(
                *motion(self.dynamics, b, lane),
                *motion(self.dynamics, b, lane, origin),
                Watched(*lane.get(WATCHED, of=f"{{}}_{b.name}")), self.active(lane, b),
                *self.limits(lane, b), b.bounces, size if b.joint is None else 0.0,
            )
            for b in self.dynamics.boundaries
        ]  # fmt: skip

    def record_crossings(self, lane: Lane, origin: str, h: Any) -> None:
        """How a step of length ``h`` meets the boundaries."""
        for b, s in zip(self.dynamics.boundaries, self.in_step(lane, origin), strict=True):
            lane[f"crossing_{b.name}"] = crossings.crossing_of(s, h, self.dynamics.overshoot)
            lane[f"turning_{b.name}"] = crossings.turning_time(s, h)

    def at_start(self, lane: Lane, rule: Any) -> list[Any]:
        """Apply a rule of :mod:`boundary` to every stop in the state before the common step."""
        return [self.at_stop(lane, b, rule, "{}_start") for b in self.dynamics.stops]

    def at_stop(self, lane: Lane, b: Boundary, rule: Any, form: str = "{}") -> Any:
        """Apply such a rule to one stop, in the state in the fields of a form."""
        moving = motion(self.dynamics, b, lane, form)
        return rule(*moving, self.active(lane, b, form), *self.limits(lane, b))

    def touched_before(self, lane: Lane) -> Any:
        """Whether a coordinate was at a stop, or rested there, before the common step."""
        return any_of(side != 0.0 for side in self.at_start(lane, boundary.side_touched))

    def touches(self, lane: Lane) -> Any:
        """Whether a coordinate that rests at no stop is at one now."""
        stops = (
            (self.active(lane, b), self.at_stop(lane, b, boundary.side_touched)) for b in self.dynamics.stops
        )
        return any_of((active == 0.0) & (side != 0.0) for active, side in stops)

    def confirm_crossings(self, lane: Lane) -> None:
        """After a common step that ends near a boundary: whether the lane meets it."""
        self.record_crossings(lane, "{}_start", lane.h)
        # A coordinate that was released before the step starts at its stop and may leave it.
        starts = dict(zip(self.dynamics.stops, self.at_start(lane, boundary.starts_at_stop), strict=True))
        meets = any_of(
            s.free & ((lane[f"crossing_{b.name}"] != 0.0) | starts.get(b, False))
            for b, s in zip(self.dynamics.boundaries, self.in_step(lane, "{}_start"), strict=True)
        )
        near = lane.reason == Reason.NEAR_BOUNDARY
        lane.reason = cases((near & meets, Reason.EVENT), (near, Reason.NONE), default=lane.reason)

    def is_cut(self, lane: Lane) -> Any:
        """Whether an instant that is known beforehand lies within the common step."""
        times = [time - lane.span_start for time in lane.get(self.dynamics.instants)]
        return any_of((time > 0.0) & (time < lane.h) for time in times)

    # ---- stops that hold sliders -------------------------------------------------------------------------

    def quantities(self, lane: Lane) -> Quantities:
        """Quantities of the present state, with the present sliders at rest."""
        numbers = known_numbers(self.dynamics, lane)
        x = contact_quantities(self.dynamics, lane.get(self.dynamics.states), numbers)
        x["derivatives"] = self.dynamics.accelerations(x)
        return x

    def update_constraint_forces(self, lane: Lane) -> None:
        """After a step with sliders at rest: also the force with which a stop would have to pull one now."""
        x = self.quantities(lane)
        for b in self.dynamics.holding:
            held, now = x[f"held{b.number}"] > 0.0, pull(x, b, lane[b.active])
            for name, of in (("least", minimum), ("most", maximum), ("last", lambda _, now: now)):
                before = lane[f"{name}_{b.name}"]
                lane[f"{name}_{b.name}"] = where(held, of(before, now), before)

    def release(self, lane: Lane) -> None:
        """Before a common step: release sliders whose stops would have to pull them.

        It also notes the mobilities of the others, which say how far such a pull may move one in the step.
        """
        x, holding = self.quantities(lane), self.dynamics.holding
        resting = [self._contact(lane, b, x[f"hold{b.number}"]) for b in holding]
        w = symmetric(len(holding), lambda i, j: x[f"W{holding[i].number}{holding[j].number}"])
        for b, leaves in zip(holding, contacts.leaving(resting, w), strict=True):
            lane[b.active] = where(leaves, 0.0, lane[b.active])
        for b in holding:
            lane[f"mobility_{self.dynamics.arm.rates[b.joint]}_{b.name}"] = x[f"W{b.number}{b.number}"]

    def _contact(
        self, lane: Lane, b: Boundary, force: Any, acceleration: Any = None, released: Any = None
    ) -> contacts.Contact:
        """A stop as a contact."""
        position, velocity = motion(self.dynamics, b, lane)
        if b.joint is None:
            position = where(lane[f"arrived_{b.name}"], 0.0, position)
        return contacts.Contact(
            position, velocity, self.active(lane, b), *self.limits(lane, b),
            acceleration, force, released, lane[b.restitution], b in self.dynamics.holding, b.owner,
        )  # fmt: skip

    def find_contact_forces(self, lane: Lane) -> None:
        """Accelerations, holding forces and mobilities, of the present state."""
        x, dynamics = self.quantities(lane), self.dynamics
        lane.set(dynamics.states[dynamics.count :], x["derivatives"], of="{}_slope")
        for b in self.dynamics.stops:
            if b.joint is not None:
                lane[f"force_{b.name}"] = x[f"hold{b.number}"]
                pushed = x.each(f"W{k + 1}{b.number}" for k in range(dynamics.count))
            else:
                lane[f"acceleration_{b.name}"] = acceleration(dynamics, b, x)
                direction = normal(dynamics, b, x)
                lane.set(dynamics.arm.rates, direction, of=f"normal_{{}}_{b.name}")
                pushed = response(dynamics, direction, x)
            lane.set(dynamics.arm.rates, pushed, of=f"mobility_{{}}_{b.name}")

    def present_acceleration(self, lane: Lane, b: Boundary) -> Any:
        """Acceleration of the coordinate of a stop, once it has been asked for."""
        if b.joint is None:
            return lane[f"acceleration_{b.name}"]
        return lane[f"{self.dynamics.arm.rates[b.joint]}_slope"]

    def mobility(self, lane: Lane, of: Boundary, by: Boundary) -> Any:
        """Change of the rate of a coordinate per impulse along another one."""
        rates = self.dynamics.arm.rates
        if of.joint is not None:
            return lane[f"mobility_{rates[of.joint]}_{by.name}"]
        return total(lane[f"normal_{v}_{of.name}"] * lane[f"mobility_{v}_{by.name}"] for v in rates)

    def resolve(self, lane: Lane) -> Any:
        """Resolve the contacts of a lane once, by impulses, rest and release; whether the motion goes on."""
        dynamics, stops = self.dynamics, self.dynamics.stops
        touching = [
            self._contact(
                lane, b, lane[f"force_{b.name}"] if b in dynamics.holding else 0.0,
                self.present_acceleration(lane, b), lane[f"released_{b.name}"],
            )
            for b in stops
        ]  # fmt: skip
        w = symmetric(len(stops), lambda i, j: self.mobility(lane, stops[i], stops[j]))
        r = contacts.resolve_contacts(lane.impacts, touching, w)
        for s, value in self._struck(lane, touching, r).items():
            lane[s] = where(r.strikes, value, lane[s])
        for b, stop, force, released, happened, speed in zip(
            stops, r.active_stops, r.forces, r.released, r.happened, r.speeds, strict=True
        ):
            if b in dynamics.holding:
                lane[b.active], lane[f"force_{b.name}"] = stop, force
            lane[f"released_{b.name}"] = released
            if dynamics.logs:
                lane[f"happened_{b.name}"], lane[f"speed_{b.name}"] = happened, speed
        lane.impacts, lane.changes = r.impacts, lane.changes + 1.0
        return r.going_on

    def _struck(self, lane: Lane, touching: Sequence[contacts.Contact], r: Resolved) -> dict[str, Any]:
        """Velocities of the arm, and the work, after impulses."""
        rates, stops = self.dynamics.arm.rates, self.dynamics.stops
        exact = {rates[b.joint]: v for b, v in zip(stops, r.velocities, strict=True) if b.joint is not None}
        struck = {}
        for v in rates:
            pushes = (j * lane[f"mobility_{v}_{b.name}"] for j, b in zip(r.impulses, stops, strict=True))
            struck[v] = exact[v] if v in exact else lane[v] + total(pushes)
        if "work" in self.dynamics.states:
            impulses = zip(r.impulses, touching, r.velocities, strict=True)
            struck["work"] = lane.work + 0.5 * total(j * (c.velocity + v) for j, c, v in impulses)
        return struck


def symmetric(count: int, upper: Callable[[int, int], Any]) -> list[list[Any]]:
    """A symmetric matrix from the entries above its diagonal."""
    entries = {(i, j): upper(i, j) for j in range(count) for i in range(j + 1)}
    return [[entries[min(i, j), max(i, j)] for j in range(count)] for i in range(count)]
