"""Boundaries that bounce: stops of joints, and walls for any function of the pose."""

from __future__ import annotations

import abc
import math
from collections.abc import Iterator, Sequence
from functools import reduce
from typing import Any, ClassVar

from redundant_envs.effects.bound_hooks import Bound
from redundant_envs.language.algebra import logical_not, maximum, total, where
from redundant_envs.language.dual import Dual, dual
from redundant_envs.language.limits import ROUNDING
from redundant_envs.language.quantities import Quantities
from redundant_envs.simulator.events import contacts
from redundant_envs.simulator.events.boundary import leaves_stop, starts_at_stop
from redundant_envs.simulator.events.contacts import Contact, Resolved
from redundant_envs.simulator.events.first_event import Encounter
from redundant_envs.simulator.lane.boundary import Bounded, Travel
from redundant_envs.simulator.lane.dynamics import Dynamics, numbers_of, response
from redundant_envs.simulator.lane.faults import Control
from redundant_envs.simulator.lane.fields import STATE, Own, Variable, engine, variables
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.lane.stiction import StickingJoint


class Impacting(Bounded):
    """A coordinate whose limits are stops."""

    bounces: ClassVar[bool] = True
    holds: ClassVar[bool] = True  # whether they can hold it
    joint: StickingJoint | None = None  # that it holds in one direction, if joints stick
    released = Own("", "is leaving its stop", truth=True)
    happened = Own("", "resolution of the contact (Happening)", book=True)
    speed = Own("m/s", "into the stop, before an impact", book=True)

    def __init__(self, dynamics: Dynamics, name: str, owner: str, restitution: str) -> None:
        """``restitution`` is the field with that of the stops."""
        super().__init__(dynamics, name, owner)
        self.restitution = restitution
        self.mobilities = [f"mobility_{v}_{name}" for v in dynamics.arm.rates]
        """Fields with the changes of the rates of the arm per impulse along the coordinate."""

    def fields(self) -> Iterator[Variable]:
        yield from variables(self.mobilities, "rate of the arm per impulse along the coordinate")
        yield from self.own_variables("happened", "speed")

    def rule(self, lane: Lane, rule: Any, form: str = "{}") -> Any:
        """Apply a rule of :mod:`events.boundary` to the state in the fields of a form."""
        return rule(*self.motion(lane, form), self.active_side(lane, form), *self.limits(lane))

    @abc.abstractmethod
    def pushed(self, lane: Lane, x: Quantities) -> Sequence[Any]:
        """Change of the arm's rates per impulse along the coordinate; it records what else contacts take."""

    @abc.abstractmethod
    def present_acceleration(self, lane: Lane) -> Any:
        """Acceleration of the coordinate, once it has been asked for."""

    def pressing(self, lane: Lane) -> Any:
        """The same, with the friction of a joint that slips reversed: so it acts on its way back."""
        return self.present_acceleration(lane)

    @abc.abstractmethod
    def mobility(self, lane: Lane, by: Impacting) -> Any:
        """Change of the rate of the coordinate per impulse along another one."""

    def resting(self, lane: Lane, force: Any, lowest: Any) -> Contact:
        """The stop as a contact where a ``force`` holds a slider; ``lowest`` is the height of a bounce, m."""
        place = *self.motion(lane), self.active_side(lane), *self.limits(lane)
        known = lane[self.restitution], self.holds, self.owner
        return Contact(*place, None, force, None, *known, None, lowest)

    def contact(self, lane: Lane, grip: Any, lowest: Any) -> Contact:
        """The same for any coordinate, with the limit of the friction at rest."""
        force, *_ = self.forces(lane)
        known = {"acceleration": self.pressing(lane), "released": lane[self.released], "grip": grip}
        return self.resting(lane, force, lowest)._replace(**known)

    def resolved(self, lane: Lane, side: Any, force: Any) -> None:
        """After contacts are resolved: the side of the stop at which it rests, and the force there."""

    def settled(self, lane: Lane, e: Encounter) -> Encounter:
        watched = e.motion.watched._replace(last=self.present_acceleration(lane))
        return e._replace(motion=e.motion._replace(watched=watched))

    def note_released(self, lane: Lane, form: str = "{}") -> None:
        """Record whether it leaves its stop, in the state in the fields of a form."""
        lane[self.released] = self.rule(lane, leaves_stop, form)

    def starts_at_stop(self, lane: Lane) -> Any:
        return self.rule(lane, starts_at_stop, "{}_start")

    def arrive(self, lane: Lane, sought: Any, side: Any, position: Any) -> None:
        # It comes to its stop, even if by rounding it seems to move away.
        lane[self.released] = self.rule(lane, leaves_stop) & logical_not(sought)


class Wall(Impacting):
    """A gap, any function of the pose, that is not negative; dual numbers give its derivatives."""

    holds = False
    acceleration = Own("m/s^2", "of the gap")
    arrived = Own("", "is at its stop, but for rounding", truth=True)

    def __init__(self, dynamics: Dynamics, name: str, owner: str, gap: Bound, restitution: str) -> None:
        super().__init__(dynamics, name, owner, restitution)
        self.gap, self.normals = gap, [f"normal_{v}_{name}" for v in dynamics.arm.rates]

    def fields(self) -> Iterator[Variable]:
        yield from self.own_variables("acceleration", "arrived")
        yield from variables(self.normals, "rate of the gap per rate of the arm")
        yield from super().fields()

    def _on(self, coordinates: Sequence[Dual], numbers: Any) -> Dual:
        arm = self.dynamics.arm
        known = dict(zip(arm.coordinates, coordinates, strict=True))
        return dual(self.gap(Quantities(known, self.dynamics.arm_functions, arm.sincos, numbers)))

    def motion(self, lane: Lane, form: str = "{}") -> tuple[Any, Any]:
        arm = self.dynamics.arm
        q, v = (lane.get(names, of=form) for names in (arm.coordinates, arm.rates))
        gap = self._on([Dual(x, y) for x, y in zip(q, v, strict=True)], numbers_of(self.dynamics, lane))
        return gap.value, gap.slope

    def limits(self, lane: Lane) -> tuple[Any, Any]:
        return 0.0, math.inf

    def scale(self, lane: Lane) -> Any:
        arm = self.dynamics.arm
        lengths = (lane[f"l{k + 1}"] for k in range(arm.num_lengths))
        return total([*lengths, *(abs(lane[arm.coordinates[k]]) for k in arm.sliders())])

    def at_stage(self, x: Quantities) -> Any:
        q, v = x.each(self.dynamics.arm.coordinates), x.each(self.dynamics.arm.rates)
        a = [x.get(f"qdd{k + 1}", 0.0) for k in range(self.dynamics.count)]
        moving = [Dual(Dual(x0, x1), Dual(x1, x2)) for x0, x1, x2 in zip(q, v, a, strict=True)]
        return dual(self._on(moving, numbers_of(self.dynamics, x)).slope).slope

    def pushed(self, lane: Lane, x: Quantities) -> Sequence[Any]:
        lane[self.acceleration] = self.at_stage(x)
        q, n = x.each(self.dynamics.arm.coordinates), range(self.dynamics.count)
        numbers = numbers_of(self.dynamics, x)
        normal = [self._on([Dual(q[j], float(j == k)) for j in n], numbers).slope for k in n]
        lane.set(self.normals, normal)
        return response(self.dynamics, normal, x)

    def present_acceleration(self, lane: Lane) -> Any:
        return lane[self.acceleration]

    def mobility(self, lane: Lane, by: Impacting) -> Any:
        return total(lane[n] * lane[w] for n, w in zip(self.normals, by.mobilities, strict=True))

    def resting(self, lane: Lane, force: Any, lowest: Any) -> Contact:
        contact = super().resting(lane, force, lowest)
        return contact._replace(position=where(lane[self.arrived], 0.0, contact.position))

    def note_released(self, lane: Lane, form: str = "{}") -> None:
        super().note_released(lane, form)
        lane[self.arrived] = False

    def arrive(self, lane: Lane, sought: Any, side: Any, position: Any) -> None:
        lane[self.arrived] = position <= 0.0
        super().arrive(lane, sought, side, position)


class TravelStop(Impacting):
    """Both ends of the travel of a joint."""

    def __init__(self, travel: Travel, owner: str, restitution: str) -> None:
        super().__init__(travel.dynamics, travel.dynamics.arm.joints[travel.index], owner, restitution)
        self.travel, self.number = travel, travel.number

    def motion(self, lane: Lane, form: str = "{}") -> tuple[Any, Any]:
        return self.travel.motion(lane, form)

    def limits(self, lane: Lane) -> tuple[Any, Any]:
        return self.travel.limits(lane)

    def pushed(self, lane: Lane, x: Quantities) -> Sequence[Any]:
        if self.dynamics.locking:
            return response(self.dynamics, self.travel.shares, x)
        return x.each(f"W{k + 1}{self.number}" for k in range(self.dynamics.count))

    def at_stage(self, x: Quantities) -> Any:
        return self.travel.along(x.each(f"qdd{k + 1}" for k in range(self.dynamics.count)))

    def present_acceleration(self, lane: Lane) -> Any:
        return self.travel.along(lane.get(self.dynamics.arm.rates, of="{}_slope"))

    def mobility(self, lane: Lane, by: Impacting) -> Any:
        return self.travel.along(lane.get(by.mobilities))

    def set_position(self, lane: Lane, position: Any) -> None:
        lane[self.travel.coordinate] = position


class HoldingStop(TravelStop):
    """A stop that holds its slider by itself: in scenes in which no joint sticks."""

    active_stop = Own("", "side of the stop a slider rests at: 1 upper, -1 lower, 0 none", STATE)
    force = Own("N", "that holds the slider")
    force_trial = Own("N", "at the start of the trial step")

    def fields(self) -> Iterator[Variable]:
        yield from self.own_variables("force", "force_trial")
        yield from super().fields()

    def active_side(self, lane: Lane, form: str = "{}") -> Any:
        return lane[form.format(self.active_stop)]

    def forces(self, lane: Lane) -> tuple[Any, Any, Any]:
        return lane[self.force], lane[self.force_trial], self.mobility(lane, self)

    def pull(self, x: Quantities, side: Any) -> Any:
        """Force with which it has to pull a slider that rests; 0 for a free one."""
        return where(x[f"held{self.number}"] > 0.0, side * x[f"hold{self.number}"], 0.0)

    def at_stage(self, x: Quantities) -> Any:
        return where(x[f"held{self.number}"] > 0.0, self.pull(x, x[self.active_stop]), x[f"qdd{self.number}"])

    def pushed(self, lane: Lane, x: Quantities) -> Sequence[Any]:
        lane[self.force] = x[f"hold{self.number}"]
        return super().pushed(lane, x)

    def resolved(self, lane: Lane, side: Any, force: Any) -> None:
        lane[self.active_stop], lane[self.force] = side, force


class Stop(TravelStop):
    """A stop of a slider that sticks there: with its friction, it decides whether the slider rests."""

    def __init__(self, travel: Travel, owner: str, restitution: str, joint: StickingJoint) -> None:
        super().__init__(travel, owner, restitution)
        self.joint: StickingJoint = joint

    def active_side(self, lane: Lane, form: str = "{}") -> Any:
        return where(lane[form.format(self.joint.side)] == 0.0, self.travel.side_touched(lane, form), 0.0)

    def pressing(self, lane: Lane) -> Any:
        acceleration, joint = self.present_acceleration(lane), self.joint
        if not joint.rubs:
            return acceleration
        reversed_force = 2.0 * (lane[joint.side] * lane[joint.limit])
        return acceleration + reversed_force * self.mobility(lane, self)


class HingeStop(Stop):
    """A stop of a revolute joint, whose angle may be a difference of coordinates."""

    def scale(self, lane: Lane) -> Any:
        return reduce(maximum, [abs(lane[q]) for q in self.travel.coordinates])

    def pushed(self, lane: Lane, x: Quantities) -> Sequence[Any]:
        return response(self.dynamics, self.travel.shares, x)

    def set_position(self, lane: Lane, position: Any) -> None:
        lower, upper = self.limits(lane)
        at_stop = (position == lower) | (position == upper)
        coordinate = self.travel.own_value(position, lane, self.dynamics.arm.coordinates)
        lane[self.travel.coordinate] = where(at_stop, coordinate, lane[self.travel.coordinate])


class Bounces:
    """How low a bounce ends in rest; here it follows from the tolerance alone."""

    def __init__(self, control: Control, happen: bool = True) -> None:
        """``happen``: there are stops."""
        self.control, self.happen = control, happen

    def fields(self) -> Iterator[Variable]:
        return iter(())

    def impacts(self, lane: Lane) -> Any:
        return lane.impacts if self.happen else 0.0

    def impacts_since_start(self, lane: Lane) -> Any:
        """Those since the start of the common step."""
        return lane.impacts - lane.impacts_start if self.happen else 0.0

    def lowest(self, lane: Lane) -> Any:
        """Height below which a bounce ends in rest, m."""
        if self.control is Control.EQUAL:
            return contacts.lowest_bounce(lane.tip_tolerance)
        return ROUNDING if self.control is Control.ADAPTIVE else contacts.LOWEST_BOUNCE

    def most_impacts(self, lane: Lane) -> Any:
        lowered = self.lowest(lane) < contacts.LOWEST_BOUNCE
        return where(lowered, float(contacts.MAX_WITH_LOW_BOUNCES), float(contacts.MAX_IMPACTS))

    def plan(self, lane: Lane, every: bool = False) -> None:
        """Before the first crossing of an interval, and one with ``every`` bounce, to compare them."""

    def begin(self, lane: Lane) -> None:
        """Before each crossing."""

    def note(self, lane: Lane, r: Resolved) -> None:
        """After contacts are resolved, which leaves out bounces."""

    def missed(self, lane: Lane) -> Any:
        """Whether bounces were left out that may matter."""
        return False


class ComparedBounces(Bounces):
    """Bounces of an interval that is compared with one that has all of them: with another stop, or dry
    friction, an impact may come before those left out would be over, and find at rest what is in the air."""

    def fields(self) -> Iterator[Variable]:
        yield from engine("lowest_bounce", "bounces_end", "bounce_missed")

    def lowest(self, lane: Lane) -> Any:
        return lane.lowest_bounce

    def plan(self, lane: Lane, every: bool = False) -> None:
        lane.lowest_bounce = ROUNDING if every else contacts.lowest_bounce(lane.tip_tolerance)

    def begin(self, lane: Lane) -> None:
        lane.bounces_end, lane.bounce_missed = -1.0, False

    def note(self, lane: Lane, r: Resolved) -> None:
        happens = (r.impacts > lane.impacts) | (r.left_out > 0.0)
        lane.bounce_missed = lane.bounce_missed | (r.others | (happens & (lane.elapsed < lane.bounces_end)))
        lane.bounces_end = maximum(lane.bounces_end, lane.elapsed + r.left_out)

    def missed(self, lane: Lane) -> Any:
        return lane.bounce_missed
