"""What every kind of boundary of a lane can do, joints between limits, and where laws of effects change.

A boundary bounds a coordinate, or it is a guard, a value that keeps its sign as long as a law holds. Other
kinds are in :mod:`stops` and :mod:`stiction`.
"""

import abc
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any, ClassVar

from redundant_envs.language.algebra import maximum, minimum, total, where
from redundant_envs.language.limits import ROUNDING, side_beyond
from redundant_envs.language.quantities import Quantities
from redundant_envs.robots.derived import joint_rates
from redundant_envs.simulator.events import boundary
from redundant_envs.simulator.events.boundary import BoundedCoordinate, law_behind, limits_of_law, size_of
from redundant_envs.simulator.events.first_event import Encounter, FirstEvent, first_event, first_passage
from redundant_envs.simulator.lane.dynamics import Dynamics, quantities_of_arm
from redundant_envs.simulator.lane.fields import Own, Variable, copies
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.numerics.methods import Watched

SMALLEST_LATE_SHARE = 1e-13
"""Fraction of a planned step by which every change of a law may be found late."""
LATE_ERROR = 0.02
"""Fraction of the tolerance that the tip may be off since a change of a law was found late."""
MAX_LATE_SHARE = 1e-3
"""Fraction of a planned step by which it may be late at most: laws may agree by chance where a step ends."""


class Boundary(abc.ABC):
    """A place where a motion has events."""

    first = Own("m/s^2 or N", "first acceleration at the stages, or pull of the stop")
    last = Own("m/s^2 or N", "last acceleration at the stages, or pull of the stop")
    least = Own("m/s^2 or N", "least acceleration at the stages, or pull of the stop")
    most = Own("m/s^2 or N", "most acceleration at the stages, or pull of the stop")

    def __init__(self, dynamics: Dynamics, name: str, owner: str) -> None:
        """``name`` ends the names of its fields, ``owner`` is the key of the effect that has added it."""
        self.dynamics, self.name, self.owner = dynamics, name, owner

    def own_variables(self, *names: str) -> Iterator[Variable]:
        """Some of its own fields, as lanes declare them."""
        return (replace(getattr(type(self), n).declared, name=getattr(self, n)) for n in names)

    def watched_fields(self) -> Iterator[Variable]:
        """Fields with its values at the stages of a step, and how it is met."""
        yield from self.own_variables("first", "last", "least", "most")

    @property
    def watches(self) -> tuple[str, ...]:
        """Those that a step sets, in the order of :class:`Watched`."""
        return self.first, self.last, self.least, self.most

    def watched(self, lane: Lane) -> Watched:
        return Watched(*lane.get(self.watches))

    @abc.abstractmethod
    def encounter(self, lane: Lane, number: float) -> Encounter:
        """How it is met in a trial step; ``number`` is its own."""

    @abc.abstractmethod
    def first_event(self, e: Encounter, h: Any) -> FirstEvent:
        """The first event in a trial step of length ``h``."""

    def settled(self, lane: Lane, e: Encounter) -> Encounter:
        """An encounter in a step at whose end the accelerations are known."""
        return e

    @abc.abstractmethod
    def arrive(self, lane: Lane, sought: Any, side: Any, position: Any) -> None:
        """At the end of a trial step with an event, which is of this boundary where it is ``sought``; a
        coordinate is beyond the limit of a ``side``, at a ``position``."""


class Bounded(Boundary):
    """A coordinate between two limits."""

    bounces: ClassVar[bool] = False  # whether these are stops
    crossing = Own("", "how the trial step meets a limit (Crossing)")
    turning = Own("s", "when the coordinate turns in the trial step")
    cleared = Own("", "is known to turn before its limit", truth=True)

    def watched_fields(self) -> Iterator[Variable]:
        yield from super().watched_fields()
        yield from self.own_variables("crossing", "turning")

    @abc.abstractmethod
    def motion(self, lane: Lane, form: str = "{}") -> tuple[Any, Any]:
        """Value and rate of the coordinate, from the fields of a form."""

    @abc.abstractmethod
    def limits(self, lane: Lane) -> tuple[Any, Any]:
        """Lower and upper limit of the coordinate."""

    @abc.abstractmethod
    def at_stage(self, x: Quantities) -> Any:
        """Its acceleration at a stage, or the pull of the stop at which it rests."""

    def starts_at_stop(self, lane: Lane) -> Any:
        """Whether it starts the common step at a stop, and does not move away from it."""
        return False

    def active_side(self, lane: Lane, form: str = "{}") -> Any:
        """Side of the stop at which the coordinate rests."""
        return 0.0

    def scale(self, lane: Lane) -> Any:
        """Size of the numbers from which it is computed, if these are larger than its own."""
        return 0.0

    def in_step(self, lane: Lane, origin: str) -> BoundedCoordinate:
        """The coordinate in a step, whose initial values are in fields of this form."""
        ends = *self.motion(lane), *self.motion(lane, origin)
        limits = self.active_side(lane), *self.limits(lane)
        return BoundedCoordinate(*ends, self.watched(lane), *limits, self.bounces, self.scale(lane))

    def forces(self, lane: Lane) -> tuple[Any, Any, Any]:
        """Force of its stop at the end and at the start of a trial step, and the coordinate's mobility."""
        return 0.0, 0.0, 0.0

    def encounter(self, lane: Lane, number: float) -> Encounter:
        now, before, mobility = self.forces(lane)
        crossing, turning, cleared = lane.get((self.crossing, self.turning, self.cleared))
        motion = self.in_step(lane, "{}_trial")
        return Encounter(number, motion, now, before, crossing, turning, cleared, mobility)

    def first_event(self, e: Encounter, h: Any) -> FirstEvent:
        return first_event(e, h, 1.0 / h, self.dynamics.method.stages > 1)


class Joint:
    """A joint, and what it has of the motion of the coordinates: its angle may be a difference of two."""

    def __init__(self, dynamics: Dynamics, index: int) -> None:
        arm = dynamics.arm
        self.dynamics, self.index = dynamics, index
        self.number = index + 1  # as quantities have it
        self.coordinate, self.rate = arm.coordinates[index], arm.rates[index]
        self.shares: list[float] = arm.motor_map[:, index].tolist()
        """Generalized forces of a unit force of its motor."""
        self.coordinates = [q for q, share in zip(arm.coordinates, self.shares, strict=True) if share != 0.0]
        """The coordinates from which its position follows."""

    def motion(self, lane: Lane, form: str = "{}") -> tuple[Any, Any]:
        """Position and rate, from the fields of a form."""
        if self.dynamics.arm.prismatic[self.index]:  # its length is a coordinate
            return lane[form.format(self.coordinate)], lane[form.format(self.rate)]
        x = quantities_of_arm(self.dynamics, lane, form)
        return x[f"phi{self.number}"], x[f"phid{self.number}"]

    def along(self, values: Sequence[Any]) -> Any:
        """What it has of values for the coordinates: of rates, accelerations or mobilities."""
        return total(times(share, x) for share, x in zip(self.shares, values, strict=True) if share != 0.0)

    def others(self) -> list[tuple[int, float]]:
        """The other coordinates from which its own follows while it is at rest, and their shares."""
        row = joint_rates(self.dynamics.arm.__class__)[self.index]
        return [(k, float(-s / row[self.index])) for k, s in enumerate(row) if s != 0.0 and k != self.index]

    def own_value(self, value: Any, others: Any, names: Sequence[str]) -> Any:
        """Its coordinate's position or rate, from its own and those of other coordinates, by ``names``."""
        return total([value, *(times(share, others[names[k]]) for k, share in self.others())])


class Travel(Joint):
    """A joint that moves between two stops."""

    def __init__(self, dynamics: Dynamics, index: int, lower: str, upper: str) -> None:
        """``lower`` and ``upper`` are fields with the ends of the travel, rad or m."""
        super().__init__(dynamics, index)
        self.lower, self.upper = lower, upper

    def limits(self, lane: Lane) -> tuple[Any, Any]:
        return lane[self.lower], lane[self.upper]

    def side_touched(self, lane: Lane, form: str = "{}") -> Any:
        """Side of the stop that the joint touches: 1 upper, -1 lower, 0 none."""
        return boundary.side_touched(*self.motion(lane, form), 0.0, *self.limits(lane))


class HingeTravel(Travel):
    """The travel of a revolute joint."""

    def motion(self, lane: Lane, form: str = "{}") -> tuple[Any, Any]:
        """An end of the travel where rounding alone differs: coordinates that are set for an angle at an end
        give it back within two ulps of the largest of them."""
        position, rate = super().motion(lane, form)
        size = reduce(maximum, [abs(lane[form.format(q)]) for q in self.coordinates])
        for end in self.limits(lane):
            near = 0.5 * ROUNDING * maximum(size, size_of(end))
            position = where(abs(position - end) <= near, end, position)
        return position, rate


def times(share: float, x: Any) -> Any:
    """The product, without an operation for a share of 1."""
    return x if share == 1.0 else share * x


class LawChange(Bounded):
    """Two positions of a joint at which a force changes its law."""

    side = Own("", "which law of a force holds: 1 above, -1 below, 0 between")

    def __init__(self, joint: Joint, name: str, owner: str, lower: str, upper: str) -> None:
        super().__init__(joint.dynamics, name, owner)
        self.joint, self.lower, self.upper = joint, lower, upper

    def fields(self) -> Iterator[Variable]:
        yield from self.own_variables("side")
        yield from copies((self.side,), "{}_start", "before the common step")

    def motion(self, lane: Lane, form: str = "{}") -> tuple[Any, Any]:
        return self.joint.motion(lane, form)

    def limits(self, lane: Lane) -> tuple[Any, Any]:
        return limits_of_law(lane[self.side], lane[self.lower], lane[self.upper])

    def at_stage(self, x: Quantities) -> Any:
        return self.joint.along(x.each(f"qdd{k + 1}" for k in range(self.dynamics.count)))

    def begin_law(self, lane: Lane) -> None:
        """Before a common step: which law the state selects."""
        position, _ = self.motion(lane)
        lane[self.side] = side_beyond(position, lane[self.lower], lane[self.upper])
        lane.copy((self.side,), to="{}_start")

    def arrive(self, lane: Lane, sought: Any, side: Any, position: Any) -> None:
        lane[self.side] = where(side != 0.0, law_behind(lane[self.side], side), lane[self.side])


class Guard(Boundary):
    """A value that keeps its sign as long as a law of an effect holds."""

    side = Own("", "which law holds: 1 or -1; 0 of a joint that sticks")
    pull = Own("", "value of the guard, positive where the law does not hold")
    middle = Own("", "in the middle of the step")
    inner = Own("", "the greatest at a stage between the ends of the step")
    left = Own("", "has passed 0 where the trial step starts", truth=True)

    def fields(self) -> Iterator[Variable]:
        yield from self.own_variables("side", "pull")
        yield from copies((self.side, self.pull), "{}_start", "before the common step")
        yield from copies((self.pull,), "{}_trial", "at the start of the trial step")
        yield from self.own_variables("middle", "inner")

    @property
    def watches(self) -> tuple[str, ...]:
        return (*super().watches, self.middle, self.inner)

    def in_step(self, lane: Lane) -> BoundedCoordinate:
        return boundary.guarded(self.watched(lane))

    def encounter(self, lane: Lane, number: float) -> Encounter:
        now, before = lane.get((self.pull, f"{self.pull}_trial"))
        still, steepness = (0.0, lane.step, False, 0.0), 0.0  # it is not known
        return Encounter(number, self.in_step(lane), now, before, *still, self.late_share(lane), steepness)

    def first_event(self, e: Encounter, h: Any) -> FirstEvent:
        return first_passage(e, h, self.dynamics.method.c[self.dynamics.method.middle])

    def late_share(self, lane: Lane) -> Any:
        """Fraction of the planned step by which a change of law may be found late: until then the motion
        departs by what the laws differ."""
        return SMALLEST_LATE_SHARE

    def other_law(self, lane: Lane, passed: Any) -> dict[str, Any]:
        """The side of the other law, where it has ``passed`` 0, by the field of the side."""
        return {self.side: where(passed, -lane[self.side], lane[self.side])}

    def arrive(self, lane: Lane, sought: Any, side: Any, position: Any) -> None:
        passed = sought | (lane[self.pull] > 0.0)
        lane.set_where(passed, {self.side: -lane[self.side], self.pull: -lane[self.pull]})


class LateGuard(Guard):
    """A guard under a tolerance, which bounds how late its passage may be found."""

    def late_share(self, lane: Lane) -> Any:
        allowed = LATE_ERROR * lane.tip_tolerance / (lane.departure * lane.left)
        return minimum(maximum(allowed, SMALLEST_LATE_SHARE), MAX_LATE_SHARE)

    def encounter(self, lane: Lane, number: float) -> Encounter:
        return super().encounter(lane, number)._replace(left=lane[self.left])

    def arrive(self, lane: Lane, sought: Any, side: Any, position: Any) -> None:
        lane[self.left] = sought | (lane[self.pull] > 0.0)
        super().arrive(lane, sought, side, position)
