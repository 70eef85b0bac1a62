"""Boundaries at which laws of effects change: limits of a joint's motion, and guards."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from redundant_envs.language.algebra import maximum, minimum, where
from redundant_envs.language.limits import side_beyond
from redundant_envs.language.quantities import Quantities
from redundant_envs.simulator.events.boundary import BoundedCoordinate, guarded, law_behind, limits_of_law
from redundant_envs.simulator.events.first_event import Encounter, Event, first_passage
from redundant_envs.simulator.lane.boundary import Boundary, Bounded
from redundant_envs.simulator.lane.fields import FieldName, Own, Variable, copies
from redundant_envs.simulator.lane.joint import Joint
from redundant_envs.simulator.lane.memory import Lane

SMALLEST_LATE_SHARE = 1e-13
"""Fraction of a planned step by which every change of a law may be found late."""
LATE_ERROR = 0.02
"""Fraction of the tolerance that the tip may be off since a change of a law was found late."""
MAX_LATE_SHARE = 1e-3
"""Fraction of a planned step by which it may be late at most: laws may agree by chance where a step ends."""


class LawChange(Bounded):
    """Two positions of a joint at which a force changes its law."""

    side = Own("", "which law of a force holds: 1 above, -1 below, 0 between")

    def __init__(self, joint: Joint, name: str, owner: str, lower: str, upper: str) -> None:
        super().__init__(joint.dynamics, name, owner)
        self.joint, self.lower, self.upper = joint, lower, upper

    def fields(self) -> Iterator[Variable]:
        yield from self.own("side")
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
        lane[self.side] = lane[self.side.start] = side_beyond(position, lane[self.lower], lane[self.upper])

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
        yield from self.own("side", "pull")
        yield from copies((self.side, self.pull), "{}_start", "before the common step")
        yield from copies((self.pull,), "{}_trial", "at the start of the trial step")
        yield from self.own("middle", "inner")

    @property
    def watches(self) -> tuple[FieldName, ...]:
        return (*super().watches, self.middle, self.inner)

    def in_step(self, lane: Lane) -> BoundedCoordinate:
        """The guard in a step."""
        return guarded(self.watched(lane))

    def encounter(self, lane: Lane, number: float) -> Encounter:
        pulls, still = lane.get((self.pull, self.pull.trial)), (0.0, lane.step, False, 0.0)
        late = self.late_share(lane), self.steepness(lane), self.has_left(lane)
        return Encounter(number, self.in_step(lane), *pulls, *still, *late)  # type: ignore[call-arg]

    def first_event(self, e: Encounter, h: Any) -> Event:
        method = self.dynamics.method
        return first_passage(e, h, method.c[method.middle])

    def late_share(self, lane: Lane) -> Any:
        """Fraction of the planned step by which a change of law may be found late: until then the motion
        departs by what the laws differ."""
        return SMALLEST_LATE_SHARE

    def steepness(self, lane: Lane) -> Any:
        """Rate at which the pull grows at the end of the step; 0 if it is not known."""
        return 0.0

    def has_left(self, lane: Lane) -> Any:
        """Whether it has passed 0 just before the step."""
        return False

    def other_law(self, lane: Lane, passed: Any) -> dict[str, Any]:
        """The side of the other law, where it has ``passed`` 0, by the field of the side."""
        return {self.side: where(passed, -lane[self.side], lane[self.side])}

    def arrive(self, lane: Lane, sought: Any, side: Any, position: Any) -> None:
        passed = sought | (lane[self.pull] > 0.0)
        lane[self.side] = where(passed, -lane[self.side], lane[self.side])
        lane[self.pull] = where(passed, -lane[self.pull], lane[self.pull])


class LateGuard(Guard):
    """A guard under a tolerance, which bounds how late its passage may be found."""

    def late_share(self, lane: Lane) -> Any:
        allowed = LATE_ERROR * lane.tip_tolerance / (lane.departure * lane.left)
        return minimum(maximum(allowed, SMALLEST_LATE_SHARE), MAX_LATE_SHARE)

    def has_left(self, lane: Lane) -> Any:
        return lane[self.left]

    def arrive(self, lane: Lane, sought: Any, side: Any, position: Any) -> None:
        lane[self.left] = sought | (lane[self.pull] > 0.0)
        super().arrive(lane, sought, side, position)
