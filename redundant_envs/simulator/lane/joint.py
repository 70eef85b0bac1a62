"""A joint of an arm, whose coordinates may be those of its links."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

from redundant_envs.language.algebra import maximum, total, where
from redundant_envs.language.limits import ROUNDING
from redundant_envs.robots.derived import joint_rates
from redundant_envs.simulator.events.boundary import side_touched, size_of
from redundant_envs.simulator.lane.coordinates import quantities_of_arm
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.memory import Lane


class Joint:
    """A joint, and what it has of the motion of the coordinates: its angle may be a difference of two."""

    def __init__(self, dynamics: Dynamics, index: int) -> None:
        arm = dynamics.arm
        self.dynamics, self.index = dynamics, index
        self.number = index + 1
        """As quantities have it."""
        self.coordinate, self.rate = arm.coordinates[index], arm.rates[index]
        self.shares: list[float] = arm.motor_map[:, index].tolist()
        """Generalized forces of a unit force of its motor."""

    @property
    def coordinates(self) -> list[str]:
        """The coordinates from which its position follows."""
        pairs = zip(self.dynamics.arm.coordinates, self.shares, strict=True)
        return [q for q, share in pairs if share != 0.0]

    def motion(self, lane: Lane, form: str = "{}") -> tuple[Any, Any]:
        """Position and rate, from the fields of a form."""
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
        """Value of its coordinate from that of the joint, a position or a rate, and those of other
        coordinates, by ``names``."""
        return total([value, *(times(share, others[names[k]]) for k, share in self.others())])


class Travel(Joint):
    """A joint that moves between two stops."""

    def __init__(self, dynamics: Dynamics, index: int, lower: str, upper: str) -> None:
        """``lower`` and ``upper`` are fields with the ends of the travel, rad or m."""
        super().__init__(dynamics, index)
        self.lower, self.upper = lower, upper

    def limits(self, lane: Lane) -> tuple[Any, Any]:
        """Both ends of the travel."""
        return lane[self.lower], lane[self.upper]

    def side_touched(self, lane: Lane, form: str = "{}") -> Any:
        """Side of the stop that the joint touches: 1 upper, -1 lower, 0 none."""
        return side_touched(*self.motion(lane, form), 0.0, *self.limits(lane))


class SliderTravel(Travel):
    """The travel of a slider, whose length is a coordinate."""

    def motion(self, lane: Lane, form: str = "{}") -> tuple[Any, Any]:
        return lane[form.format(self.coordinate)], lane[form.format(self.rate)]


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
