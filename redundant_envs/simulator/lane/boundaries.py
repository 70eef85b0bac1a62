"""All boundaries of a lane together: how a step meets them, and how contacts with stops are resolved."""

from collections.abc import Callable, Sequence
from typing import Any

from redundant_envs.language.algebra import any_of, cases, maximum, minimum, total, where
from redundant_envs.language.quantities import Quantities
from redundant_envs.simulator.events import contacts, crossings
from redundant_envs.simulator.events.boundary import side_touched
from redundant_envs.simulator.events.contacts import Resolved
from redundant_envs.simulator.lane.faults import Reason
from redundant_envs.simulator.lane.features import Features
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.lane.pieces import Whole


class Boundaries:
    """Procedures of lanes at the boundaries of a scene."""

    def __init__(self, features: Features, pieces: Whole) -> None:
        self.features, self.dynamics, self.pieces = features, features.dynamics, pieces
        self.impulses_change_laws = bool(features.dynamics.guarded and features.stops)

    def record_crossings(self, lane: Lane, origin: str, h: Any) -> None:
        """How a step of length ``h`` meets the boundaries."""
        for b in self.features.bounded:
            s = b.in_step(lane, origin)
            lane[b.crossing] = crossings.crossing_of(s, h, self.features.overshoot)
            lane[b.turning] = crossings.turning_time(s, h)

    def touches(self, lane: Lane) -> Any:
        """Whether a coordinate that rests at no stop is at one now."""
        sides = ((b.active_side(lane), b.rule(lane, side_touched)) for b in self.features.stops)
        return any_of((active == 0.0) & (side != 0.0) for active, side in sides)

    def confirm_crossings(self, lane: Lane) -> None:
        """After a common step that ends near a boundary: whether the lane meets it."""
        self.record_crossings(lane, "{}_start", lane.h)
        # A coordinate that was released before the step starts at its stop and may leave it.
        meets = any_of(
            b.in_step(lane, "{}_start").free & ((lane[b.crossing] != 0.0) | b.starts_at_stop(lane))
            for b in self.features.bounded
        )
        near = lane.reason == Reason.NEAR_BOUNDARY
        lane.reason = cases((near & meets, Reason.EVENT), (near, Reason.NONE), default=lane.reason)

    # ---- laws that hold, and joints that stick -----------------------------------------------------------

    def begin_laws(self, lane: Lane) -> None:
        """Before a common step: which laws the state selects."""
        features = self.features
        for law in features.laws:
            law.begin_law(lane)
        self.settle_laws(lane, True)
        for joint in features.sticking:
            joint.begin_mode(lane)
        lane.copy(features.rests, to="{}_start")
        for b in features.guards:
            lane.copy((b.side, b.pull), to="{}_start")

    def settle_laws(self, lane: Lane, here: Any) -> None:
        """Let the state of some lanes decide which laws of guards hold."""
        x = self.features.quantities(lane)
        for name, value in self.dynamics.guard_values(x, begins=True).items():
            lane.set_where(here, {f"side_{name}": x[f"side_{name}"], f"pull_{name}": -abs(value)})

    def note_resolving(self, lane: Lane, resolving: bool) -> None:
        """Note whether contacts are being resolved, so that impulses may change which laws hold."""
        if self.impulses_change_laws:
            lane.resolving = resolving

    def record_pulls(self, lane: Lane) -> None:
        """After a step: the present values of guards; those of joints that stick are from the last stage."""
        held = {b.name: lane[b.last] for b in self.features.sticking}
        for name, value in self.features.pulls(self.features.quantities(lane), held).items():
            lane[f"pull_{name}"] = value

    # ---- stops that hold sliders -------------------------------------------------------------------------

    def quantities_of_motion(self, lane: Lane) -> Quantities:
        """Quantities of the present state, without accelerations."""
        numbers = self.features.known_numbers(lane)
        return self.features.quantities_in_step(lane.get(self.dynamics.states), numbers)

    def quantities(self, lane: Lane) -> Quantities:
        """Quantities of the present state, with the present sliders at rest."""
        x = self.quantities_of_motion(lane)
        x["derivatives"] = self.dynamics.accelerations(x)
        return x

    def update_constraint_forces(self, lane: Lane) -> None:
        """After a step with sliders at rest: also the force with which a stop would have to pull one now."""
        x = self.quantities(lane)
        for b in self.features.holding:
            held, now = x[f"held{b.number}"] > 0.0, b.pull(x, lane[b.active_stop])
            for name, of in ((b.least, minimum), (b.most, maximum), (b.last, lambda _, now: now)):
                lane[name] = where(held, of(lane[name], now), lane[name])

    def release(self, lane: Lane) -> None:
        """Before a common step: release sliders whose stops would have to pull them, and note the mobilities
        of the others, which say how far such a pull may move one in the step."""
        x, holding = self.quantities(lane), self.features.holding
        lowest = self.features.bounces.lowest(lane)
        resting = [b.resting(lane, x[f"hold{b.number}"], lowest) for b in holding]
        w = symmetric(holding, lambda a, b: x[f"W{a.number}{b.number}"])
        for b, leaves in zip(holding, contacts.leaving(resting, w), strict=True):
            leaves = leaves & self.pieces.goes_on(lane)
            lane[b.active_stop] = where(leaves, 0.0, lane[b.active_stop])
        for b in holding:
            lane[b.mobilities[b.travel.index]] = x[f"W{b.number}{b.number}"]

    def find_contact_forces(self, lane: Lane) -> None:
        """Accelerations, holding forces and mobilities, of the present state."""
        if self.impulses_change_laws:
            self.settle_laws(lane, lane.resolving)
        x, dynamics = self.quantities(lane), self.dynamics
        self.features.stiction.record(lane, x, self.features.pulls)
        lane.set(dynamics.states[dynamics.count :], x["derivatives"], of="{}_slope")
        for b in self.features.stops:
            lane.set(b.mobilities, b.pushed(lane, x))

    def decide(self, lane: Lane) -> Any:
        """Resolve the contacts of a lane once, and then which joints stick; whether the motion goes on."""
        return self.features.stiction.decide(lane, self.resolve(lane) if self.features.stops else True)

    def resolve(self, lane: Lane) -> Any:
        """Resolve the contacts of a lane once, by impulses, rest and release; whether the motion goes on."""
        features, stops = self.features, self.features.stops
        lowest = features.bounces.lowest(lane)
        grips = [features.stiction.grip(lane, b.joint) for b in stops]
        touching = [b.contact(lane, grip, lowest) for b, grip in zip(stops, grips, strict=True)]
        w = symmetric(stops, lambda a, b: a.mobility(lane, b))
        if self.dynamics.locking:  # a locked joint has no mobility, and at its stop needs no impulse
            for k in range(len(stops)):
                w[k][k] = where(w[k][k] == 0.0, 1.0, w[k][k])
        r = contacts.resolve_contacts(lane.impacts, touching, w)
        lane.set_where(r.strikes, self._struck(lane, touching, r))
        results = r.active_stops, r.forces, r.released, r.happened, r.speeds
        for b, side, force, released, happened, speed in zip(stops, *results, strict=True):
            b.resolved(lane, side, force)
            lane[b.released] = released
            features.log.note(lane, b, happened, speed)
        features.bounces.note(lane, r)
        lane.impacts, lane.changes = r.impacts, lane.changes + 1.0
        return features.stiction.strike(lane, r.strikes, r.going_on)

    def _struck(self, lane: Lane, touching: Sequence[contacts.Contact], r: Resolved) -> dict[str, Any]:
        """Velocities of the arm, and the work, after impulses."""
        stops, exact = self.features.stops, dict(zip(self.features.stops, r.velocities, strict=True))
        struck = {}
        for k, v in enumerate(self.dynamics.arm.rates):
            pushes = (j * lane[b.mobilities[k]] for j, b in zip(r.impulses, stops, strict=True))
            struck[v] = lane[v] + total(pushes)
        for b in self.features.from_base:
            struck[b.travel.rate] = b.travel.own_value(exact[b], struck, self.dynamics.arm.rates)
        if "work" in self.dynamics.states:
            impulses = zip(r.impulses, touching, r.velocities, strict=True)
            struck["work"] = lane.work + 0.5 * total(j * (c.velocity + v) for j, c, v in impulses)
        return struck


def symmetric(some: Sequence[Any], entry: Callable[[Any, Any], Any]) -> list[list[Any]]:
    """A symmetric matrix, from an entry for each pair of some objects."""
    entries = {(i, j): entry(some[i], b) for j, b in enumerate(some) for i in range(j + 1)}
    n = range(len(some))
    return [[entries[min(i, j), max(i, j)] for j in n] for i in n]
