"""Boundaries of a lane: how a step meets them, and how contacts with stops are resolved."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

from redundant_envs.algebra import any_of, cases, logical_not, maximum, minimum, total, where
from redundant_envs.events import boundary, contacts, crossings
from redundant_envs.events.boundary import ROUNDING, Boundary, BoundedCoordinate
from redundant_envs.events.contacts import Resolved
from redundant_envs.lane import pieces
from redundant_envs.lane.coordinates import (
    acceleration,
    contact_quantities,
    known_numbers,
    motion,
    normal,
    pull,
    response,
    side_of_stop,
)
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.features import WATCHED, Control, Reason
from redundant_envs.lane.guards import Guards
from redundant_envs.lane.memory import Lane
from redundant_envs.numerics.methods import Watched
from redundant_envs.quantities import Quantities


class Boundaries:
    """Procedures of lanes at the boundaries of a scene."""

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics, self.guards = dynamics, Guards(dynamics)

    def limits(self, lane: Lane, b: Boundary) -> tuple[Any, Any]:
        """Lower and upper limit of a coordinate."""
        if b.joint is None:
            return 0.0, math.inf
        if b.bounces:
            return lane[b.lower], lane[b.upper]
        return boundary.limits_of_law(lane[b.side], lane[b.lower], lane[b.upper])

    def active(self, lane: Lane, b: Boundary, form: str = "{}") -> Any:
        """Side of the stop at which a coordinate rests."""
        if b in self.dynamics.holding:
            return lane[form.format(b.active)]
        for friction, stop in self.dynamics.gripped:
            if stop is b:
                sticks = lane[form.format(friction.side)] == 0.0
                return where(sticks, side_of_stop(self.dynamics, stop, lane, form), 0.0)
        return 0.0

    def in_step(self, lane: Lane, origin: str) -> list[BoundedCoordinate]:
        """The coordinates in a step, whose initial values are in fields of this form."""
        arm = self.dynamics.arm
        lengths = (lane[f"l{k + 1}"] for k in range(arm.num_lengths))
        # The size of the numbers from which a gap is computed, m.
        size = total([*lengths, *(abs(lane[arm.coordinates[k]]) for k in arm.sliders())])
        sizes = {b.name: size if b.joint is None else 0.0 for b in self.dynamics.bounded}
        for b in self.dynamics.angular:
            sizes[b.name] = reduce(maximum, [abs(lane[q]) for q in self.dynamics.coordinates_of(b)])
        return [
            BoundedCoordinate(
                *motion(self.dynamics, b, lane),
                *motion(self.dynamics, b, lane, origin),
                self.watched(lane, b), self.active(lane, b),
                *self.limits(lane, b), b.bounces, sizes[b.name],
            )
            for b in self.dynamics.bounded
        ]  # fmt: skip

    def record_crossings(self, lane: Lane, origin: str, h: Any) -> None:
        """How a step of length ``h`` meets the boundaries."""
        for b, s in zip(self.dynamics.bounded, self.in_step(lane, origin), strict=True):
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
            for b, s in zip(self.dynamics.bounded, self.in_step(lane, "{}_start"), strict=True)
        )
        near = lane.reason == Reason.NEAR_BOUNDARY
        lane.reason = cases((near & meets, Reason.EVENT), (near, Reason.NONE), default=lane.reason)

    def watched(self, lane: Lane, b: Boundary) -> Watched:
        """Values at the stages of a step: accelerations, or pulls of stops and guards."""
        names = Watched._fields if b.guards else WATCHED
        return Watched(*lane.get(names, of=f"{{}}_{b.name}"))

    # ---- stops that hold sliders -------------------------------------------------------------------------

    def quantities_of_motion(self, lane: Lane) -> Quantities:
        """Quantities of the present state, without accelerations."""
        numbers = known_numbers(self.dynamics, lane)
        return contact_quantities(self.dynamics, lane.get(self.dynamics.states), numbers)

    def quantities(self, lane: Lane) -> Quantities:
        """Quantities of the present state, with the present sliders at rest."""
        x = self.quantities_of_motion(lane)
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
        x, dynamics, holding = self.quantities(lane), self.dynamics, self.dynamics.holding
        resting = [self._contact(lane, b, x[f"hold{b.number}"]) for b in holding]
        w = symmetric(len(holding), lambda i, j: x[f"W{holding[i].number}{holding[j].number}"])
        for b, leaves in zip(holding, contacts.leaving(resting, w), strict=True):
            if dynamics.instants:
                leaves = leaves & pieces.goes_on(lane)
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
            acceleration, force, released, lane[b.restitution], b.joint is not None, b.owner,
            self._grip(lane, b), self._lowest_bounce(lane),
        )  # fmt: skip

    def _lowest_bounce(self, lane: Lane) -> Any:
        """Height below which a bounce ends in rest, m."""
        if self.dynamics.compares_bounces:
            return lane.lowest_bounce
        if self.dynamics.control is Control.EQUAL:
            return contacts.lowest_bounce(lane.tip_tolerance)
        return ROUNDING if self.dynamics.control is Control.ADAPTIVE else contacts.LOWEST_BOUNCE

    def most_impacts(self, lane: Lane) -> Any:
        """Most impacts of an interval."""
        lowered = self._lowest_bounce(lane) < contacts.LOWEST_BOUNCE
        return where(lowered, float(contacts.MOST_WITH_LOW_BOUNCES), float(contacts.MOST_IMPACTS))

    def _grip(self, lane: Lane, b: Boundary) -> Any:
        """Limit of the friction at rest of a joint with a stop; None in a scene without dry friction."""
        if not self.dynamics.sticking:
            return None
        limits = (lane[f"limit_{joint.name}"] for joint, stop in self.dynamics.gripped if stop is b)
        return next(limits, 0.0)

    def find_contact_forces(self, lane: Lane) -> None:
        """Accelerations, holding forces and mobilities, of the present state."""
        if self.dynamics.impulses_change_laws:
            self.guards.settle(lane, lane.resolving)
        x, dynamics = self.quantities(lane), self.dynamics
        if dynamics.sticking:
            self.guards.record_friction(lane, x)
        lane.set(dynamics.states[dynamics.count :], x["derivatives"], of="{}_slope")
        for b in self.dynamics.stops:
            if b in dynamics.angular:
                pushed = response(dynamics, normal(dynamics, b, x), x)
            elif b.joint is not None:
                if b in dynamics.holding:
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
        if b in self.dynamics.angular:
            return self.dynamics.along(b, lane.get(self.dynamics.arm.rates, of="{}_slope"))
        return lane[f"{self.dynamics.arm.rates[b.joint]}_slope"]

    def _pressing_acceleration(self, lane: Lane, b: Boundary) -> Any:
        """The same, with the friction of a joint that slips reversed: so it acts on its way back."""
        a = self.present_acceleration(lane, b)
        for friction, stop in self.dynamics.gripped:
            if stop is b and friction.joint in self.dynamics.frictions:
                reversed_force = 2.0 * (lane[friction.side] * lane[f"limit_{friction.name}"])
                a = a + reversed_force * self.mobility(lane, b, b)
        return a

    def mobility(self, lane: Lane, of: Boundary, by: Boundary) -> Any:
        """Change of the rate of a coordinate per impulse along another one."""
        rates = self.dynamics.arm.rates
        if of in self.dynamics.angular:
            return self.dynamics.along(of, lane.get(rates, of=f"mobility_{{}}_{by.name}"))
        if of.joint is not None:
            return lane[f"mobility_{rates[of.joint]}_{by.name}"]
        return total(lane[f"normal_{v}_{of.name}"] * lane[f"mobility_{v}_{by.name}"] for v in rates)

    def decide(self, lane: Lane) -> Any:
        """Resolve the contacts of a lane once, and then which joints stick; whether the motion goes on."""
        dynamics = self.dynamics
        if not dynamics.stops:
            return self.guards.stick_or_slip(lane)
        settled = self.resolve(lane)
        return self.guards.stick_or_slip(lane, settled) if dynamics.sticking else settled

    def resolve(self, lane: Lane) -> Any:
        """Resolve the contacts of a lane once, by impulses, rest and release; whether the motion goes on."""
        dynamics, stops = self.dynamics, self.dynamics.stops
        touching = [
            self._contact(
                lane, b, lane[f"force_{b.name}"] if b in dynamics.holding else 0.0,
                self._pressing_acceleration(lane, b), lane[f"released_{b.name}"],
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
        if dynamics.compares_bounces:
            happens = (r.impacts > lane.impacts) | (r.left_out > 0.0)
            missed = r.others | (happens & (lane.elapsed < lane.bounces_end))
            lane.bounce_missed = lane.bounce_missed | missed
            lane.bounces_end = maximum(lane.bounces_end, lane.elapsed + r.left_out)
        lane.impacts, lane.changes = r.impacts, lane.changes + 1.0
        if dynamics.sticking:
            self.guards.strike(lane, r.strikes)
            return r.going_on & logical_not(r.strikes)  # the forces are those of the modes before
        return r.going_on

    def _struck(self, lane: Lane, touching: Sequence[contacts.Contact], r: Resolved) -> dict[str, Any]:
        """Velocities of the arm, and the work, after impulses."""
        rates, stops = self.dynamics.arm.rates, self.dynamics.stops
        exact = {rates[b.joint]: v for b, v in zip(stops, r.velocities, strict=True) if b.joint is not None}
        struck = {}
        for v in rates:
            pushes = (j * lane[f"mobility_{v}_{b.name}"] for j, b in zip(r.impulses, stops, strict=True))
            struck[v] = exact[v] if v in exact else lane[v] + total(pushes)
        for b in self.dynamics.angular:  # from base to tip: the rates of links before a joint are known
            v = rates[b.joint]
            struck[v] = self.dynamics.own_value(b, exact[v], struck, rates)
        if "work" in self.dynamics.states:
            impulses = zip(r.impulses, touching, r.velocities, strict=True)
            struck["work"] = lane.work + 0.5 * total(j * (c.velocity + v) for j, c, v in impulses)
        return struck


def symmetric(count: int, upper: Callable[[int, int], Any]) -> list[list[Any]]:
    """A symmetric matrix from the entries above its diagonal."""
    entries = {(i, j): upper(i, j) for j in range(count) for i in range(j + 1)}
    return [[entries[min(i, j), max(i, j)] for j in range(count)] for i in range(count)]
