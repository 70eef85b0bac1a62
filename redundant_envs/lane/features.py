"""How the lanes of a scene cross a control interval: all decisions made before anything runs."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

from redundant_envs.algebra import maximum, where
from redundant_envs.events.boundary import Boundary
from redundant_envs.events.crossings import Overshoot
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.memory import Lane
from redundant_envs.lane.step import pose_tells_distances
from redundant_envs.numerics.methods import Watched


class Fault(enum.IntFlag):
    """Faults of a lane, as ``info["numerics"]`` reports them."""

    NON_FINITE = 1
    """A state is no finite number."""
    BAD_ACTION = 2
    """The action was no finite number."""
    SPEED_BOUND = 4
    """A rate has passed the bound of the task."""
    TOLERANCE_NOT_REACHED = 8
    """The most steps that an interval may have did not suffice for its tolerance."""
    EVENT_BUDGET = 16
    """The interval has more events than it may have, and was not crossed."""
    NO_STEP_FOUND = 32
    """dop853 has found no step that is short enough."""
    LARGE_ANGLE = 64
    """An angle is so large that its last digits are lost."""


GIVEN_UP = Fault.EVENT_BUDGET
"""From this fault on the interval was not crossed, and its lane has the state of its start again."""


class Reason(enum.IntEnum):
    """Reason why a lane leaves the common step."""

    NONE = 0
    """It stays: the step serves it."""
    ACCURACY = 1
    """The step is not accurate enough."""
    EVENT = 2
    """The step meets a boundary."""
    NEAR_BOUNDARY = 3
    """Not decided yet, but near a boundary."""


class Control(enum.Enum):
    """How the steps of a lane are chosen."""

    FIXED = "fixed"
    """Each common step is one step."""
    EQUAL = "equal"
    """1, 2, 4, ... equal steps, until their errors pass."""
    ADAPTIVE = "adaptive"
    """Each as long as its error allows (dop853)."""


LARGEST_ANGLE = 1e6
"""rad: beyond it an angle is known to no more than 1e-10 rad, and rounding adds up."""
OBSERVED_ANGLE, OBSERVED_RATE = 1e14, 1e100
"""rad; rad/s and m/s: states beyond cannot be observed, since sines of larger angles are not computed."""
MOST_LOGGED = 256
"""Number of events of an interval that are kept if the work is tracked."""
WATCHED = Watched._fields


@dataclass(frozen=True)
class SceneFeatures:
    """What the lanes of a scene have, and the names of their fields."""

    dynamics: Dynamics

    @cached_property
    def control(self) -> Control:
        scene = self.dynamics.scene
        if scene.integrator == "dop853":
            return Control.ADAPTIVE
        return Control.FIXED if scene.tolerance is None else Control.EQUAL

    @property
    def boundaries(self) -> tuple[Boundary, ...]:
        """Boundaries at which motions have events."""
        return self.dynamics.boundaries

    @property
    def stops(self) -> tuple[Boundary, ...]:
        """Those that bounce."""
        return self.dynamics.stops

    @property
    def holding(self) -> tuple[Boundary, ...]:
        """Stops that can hold their sliders."""
        return self.dynamics.holding

    @property
    def laws(self) -> tuple[Boundary, ...]:
        """Boundaries at which a force changes its law."""
        return self.dynamics.laws

    @cached_property
    def doubts(self) -> dict[str, str]:
        """Fields with reasons why the error of an interval may exceed its estimate, and their docs."""
        if self.control is not Control.EQUAL:
            return {}
        found, dynamics = {}, self.dynamics
        if dynamics.kinks:
            found["kinked"] = "a step of the interval may have met a kink"
            found["hidden_kink"] = "it may have met one that no stage has seen"
        if dynamics.effect_states.integrated or pose_tells_distances(dynamics):
            found["doubtful"] = "a step of the interval makes its estimate doubtful"
        return found

    @property
    def local(self) -> bool:
        """Whether lanes may take local steps."""
        return bool(self.stops or self.instants) or self.control is not Control.FIXED

    @property
    def repeated(self) -> bool:
        """Whether an interval consists of several common steps."""
        return self.dynamics.scene.substeps > 1

    @property
    def estimates(self) -> bool:
        """Whether the method has an error estimate."""
        return bool(self.dynamics.method.error5)

    @property
    def logs(self) -> bool:
        """Whether events are kept."""
        return bool(self.stops) and self.dynamics.track_work

    @property
    def spans(self) -> bool:
        """Whether lanes know when in the interval the common step begins."""
        return self.logs or bool(self.instants)

    @property
    def instants(self) -> tuple[str, ...]:
        """Fields with instants at which a planned step ends, s from the start of the interval; none yet."""
        return ()

    @property
    def origin(self) -> str:
        """Form of the fields that hold a lane's values at the start of the interval."""
        return "{}_interval" if self.local and self.control is Control.FIXED and self.repeated else "{}_start"

    @cached_property
    def active(self) -> tuple[str, ...]:
        """Fields of the stops at which sliders rest."""
        return tuple(b.active for b in self.holding)

    @property
    def kept(self) -> tuple[str, ...]:
        """Fields that are kept at the start of an interval, and restored when it is given up."""
        return (*self.dynamics.states, *self.dynamics.effect_states.updated, *self.active)

    def largest_angle(self, lane: Lane) -> Any:
        """The largest of the coordinates that are angles, rad."""
        arm = self.dynamics.arm
        angles = [
            abs(lane[q]) for q, slides in zip(arm.coordinates, arm.prismatic, strict=True) if not slides
        ]
        return reduce(maximum, angles) if angles else 0.0

    def angle_fault(self, lane: Lane) -> Any:
        """A fault if an angle is so large that its last digits are lost."""
        return where(self.largest_angle(lane) > LARGEST_ANGLE, float(Fault.LARGE_ANGLE), 0.0)

    @cached_property
    def overshoot(self) -> Overshoot:
        """How far accelerations may leave the range of their values at the stages."""
        method = self.dynamics.method
        return Overshoot(
            method.overshoot_between_nodes(at_ends=False), method.overshoot_between_nodes(at_ends=True)
        )
