"""How the lanes of a scene cross a control interval: all decisions made before anything runs."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

from redundant_envs.algebra import maximum, where
from redundant_envs.integrators.crossings import Unseen
from redundant_envs.integrators.methods import Watched
from redundant_envs.integrators.trial_steps import Search
from redundant_envs.simulator.boundaries import Stop, Switch
from redundant_envs.simulator.dynamics import Dynamics
from redundant_envs.simulator.lane import Lane
from redundant_envs.simulator.step import active_stop, integrated_states, pose_tells_distances


class Fault(enum.IntFlag):
    """Faults of a lane, as ``info["numerics"]`` reports them."""

    NON_FINITE = 1
    BAD_ACTION = 2
    SPEED_BOUND = 4
    TOLERANCE_NOT_REACHED = 8
    EVENT_BUDGET = 16
    NO_STEP_FOUND = 32
    LARGE_ANGLE = 64


GIVEN_UP = Fault.EVENT_BUDGET
"""From this fault on the interval was not crossed, and its lane has the state of its start again."""


class Reason(enum.IntEnum):
    """Reason why a lane leaves the common step."""

    NONE = 0
    ACCURACY = 1
    STOP = 2
    NEAR_STOP = 3
    """Not decided yet, but near a stop, or near a position at which a force changes its law."""


class Plan(enum.Enum):
    """How the steps of a lane are chosen."""

    FIXED = "fixed"
    DOUBLING = "doubling"
    ADAPTIVE = "adaptive"


LARGEST_ANGLE = 1e6
"""rad: beyond it an angle is known to no more than 1e-10 rad, and rounding adds up."""
OBSERVED_ANGLE, OBSERVED_RATE = 1e14, 1e100
"""rad; rad/s and m/s: states beyond cannot be observed, since sines of larger angles are not computed."""
MOST_SEARCHED = 500
"""Trial steps in search of one event; with more the interval is given up."""
MOST_TRIALS = 65536
"""Most trial steps of an interval that is crossed with 1, 2, 4, ... 16384 steps: twice as many as without
events. With fixed steps the same, and :data:`TRIALS_OF_SUBSTEP` more for each substep."""
TRIALS_OF_SUBSTEP = 16
MOST_LOGGED = 256
"""Number of events of an interval that are kept if the work is tracked."""
WATCHED = Watched._fields
SEARCH = Search._fields


@dataclass(frozen=True)
class Setting:
    """Properties of the intervals of a scene, and names of the fields of its lanes."""

    dynamics: Dynamics

    @cached_property
    def plan(self) -> Plan:
        scene = self.dynamics.scene
        if scene.integrator == "dop853":
            return Plan.ADAPTIVE
        return Plan.FIXED if scene.tolerance is None else Plan.DOUBLING

    @cached_property
    def stops(self) -> tuple[Stop, ...]:
        return self.dynamics.stops

    @cached_property
    def switches(self) -> tuple[Switch, ...]:
        return self.dynamics.switches

    @cached_property
    def boundaries(self) -> tuple[Stop | Switch, ...]:
        """Boundaries at which motions have events."""
        return (*self.stops, *self.switches)

    @cached_property
    def doubts(self) -> dict[str, str]:
        """Fields with reasons why the error of an interval may exceed its estimate, and their docs."""
        if self.plan is not Plan.DOUBLING:
            return {}
        found, dynamics = {}, self.dynamics
        if dynamics.kinks:
            found["kinked"] = "a step of the interval may have met a kink"
            found["hidden_kink"] = "it may have met one that no stage has seen"
        if integrated_states(dynamics) or pose_tells_distances(dynamics):
            found["doubtful"] = "a step of the interval makes its estimate doubtful"
        return found

    @property
    def local(self) -> bool:
        """Whether lanes may take local steps."""
        return bool(self.stops) or self.plan is not Plan.FIXED

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
    def origin(self) -> str:
        """Form of the fields that hold a lane's values at the start of the interval."""
        return "{}_interval" if self.local and self.plan is Plan.FIXED and self.repeated else "{}_start"

    @cached_property
    def active(self) -> tuple[str, ...]:
        """Fields of the stops at which sliders rest."""
        return tuple(active_stop(s.name) for s in self.stops)

    @property
    def kept(self) -> tuple[str, ...]:
        """Fields that are kept at the start of an interval, and restored when it is given up."""
        return (*self.dynamics.states, *self.dynamics.remembered, *self.active)

    def angle_fault(self, lane: Lane) -> Any:
        """A fault if an angle is so large that its last digits are lost."""
        return where(self.largest_angle(lane) > LARGEST_ANGLE, float(Fault.LARGE_ANGLE), 0.0)

    def largest_angle(self, lane: Lane) -> Any:
        """The largest of the coordinates that are angles, rad."""
        arm = self.dynamics.arm
        angles = [
            abs(lane[q]) for q, slides in zip(arm.coordinates, arm.prismatic, strict=True) if not slides
        ]
        return reduce(maximum, angles) if angles else 0.0

    @property
    def positions(self) -> list[str]:
        """Coordinates of the sliders with stops."""
        return [self.dynamics.arm.coordinates[s.joint] for s in self.stops]

    @property
    def rates(self) -> list[str]:
        return [self.dynamics.arm.rates[s.joint] for s in self.stops]

    @cached_property
    def unseen(self) -> Unseen:
        method = self.dynamics.method
        return Unseen(method.unseen(at_ends=False), method.unseen(at_ends=True))
