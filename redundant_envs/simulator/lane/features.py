"""What a scene has that its lanes take care of: boundaries, joints that stick, a log, doubts about errors.

All of it is decided before anything runs. What a scene may lack is an object with a neutral default, such as
:class:`~redundant_envs.simulator.lane.stiction.NoStiction`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from redundant_envs.effects.hooks import Force, Gap, Impact, Impulse
from redundant_envs.language.algebra import arguments_of, where
from redundant_envs.language.quantities import Quantities
from redundant_envs.simulator.events.crossings import Overshoot
from redundant_envs.simulator.lane import kinks
from redundant_envs.simulator.lane.bounces import Bounces, ComparedBounces, NoStops
from redundant_envs.simulator.lane.boundary import Boundary, Bounded
from redundant_envs.simulator.lane.dynamics import INTERVALS, Dynamics
from redundant_envs.simulator.lane.event_log import EventLog, LogOfSubsteps, NoLog
from redundant_envs.simulator.lane.faults import Control
from redundant_envs.simulator.lane.joint import HingeTravel, Joint, SliderTravel, Travel
from redundant_envs.simulator.lane.laws import Guard, LateGuard, LawChange
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.lane.stiction import DryFriction, NoStiction, StickingJoint, Stiction
from redundant_envs.simulator.lane.stops import HingeStop, HoldingStop, Impacting, Stop, TravelStop, Wall
from redundant_envs.simulator.numerics.error_control import SHARPNESS, SHARPNESS_OF_SPRINGS


class Features:
    """What the lanes of a scene take care of, beside the equations of its motion."""

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics, self.scene, self.arm = dynamics, dynamics.scene, dynamics.arm

    # ---- boundaries ----------------------------------------------------------------------------------

    @cached_property
    def travels(self) -> dict[int, Travel]:
        """Joints with stops, by their numbers."""
        kinds = {True: SliderTravel, False: HingeTravel}
        found = {}
        for a in self.scene.attached.of(Impact):
            ends = map(a.parameter, (a.hook.lower, a.hook.upper))
            found[a.hook.joint] = kinds[self.arm.prismatic[a.hook.joint]](self.dynamics, a.hook.joint, *ends)
        return found

    @cached_property
    def stiction(self) -> NoStiction:
        """How joints stick and slip."""
        if not self.dynamics.slipping:
            return NoStiction()
        owners = {a.hook.joint: a.key for a in self.scene.attached.of(Impact)}
        owners |= {k: some[0].key for k, some in self.dynamics.frictions.items()}
        kind = DryFriction if self.dynamics.frictions else Stiction
        return kind(self.dynamics, self.travels, owners)

    @property
    def sticking(self) -> tuple[StickingJoint, ...]:
        """Joints that stick and slip, in their order."""
        return self.stiction.joints

    @cached_property
    def stops(self) -> tuple[Impacting, ...]:
        """Boundaries that bounce: stops of joints, and walls, whose coordinates are any functions."""
        return (*self._stops_of_joints, *self._walls())

    @cached_property
    def _stops_of_joints(self) -> tuple[TravelStop, ...]:
        found: list[TravelStop] = []
        for a in self.scene.attached.of(Impact):
            travel, bounce = self.travels[a.hook.joint], a.parameter(a.hook.restitution)
            if not self.sticking:
                found.append(HoldingStop(travel, a.key, bounce))
                continue
            kind = Stop if self.arm.prismatic[travel.index] else HingeStop
            found.append(kind(travel, a.key, bounce, self.stiction.of_stop(travel)))
        return tuple(found)

    def _walls(self) -> list[Wall]:
        walls = enumerate(self.scene.attached.of(Gap), start=1)
        return [
            Wall(self.dynamics, f"gap{k}", a.key, a.functions["function"], a.parameter(a.hook.restitution))
            for k, a in walls
        ]

    @cached_property
    def holding(self) -> tuple[HoldingStop, ...]:
        """Stops that hold their sliders by themselves."""
        return tuple(b for b in self.stops if isinstance(b, HoldingStop))

    @cached_property
    def from_base(self) -> tuple[TravelStop, ...]:
        """Stops of sliders, then those of revolute joints from base to tip: an angle may be a difference of
        coordinates, of which those of the links before it are known first."""
        by_joint = sorted(self._stops_of_joints, key=lambda b: b.travel.index)
        return tuple(sorted(by_joint, key=lambda b: isinstance(b, HingeStop)))

    @cached_property
    def active(self) -> tuple[str, ...]:
        """Fields of the stops at which sliders rest."""
        return tuple(b.active_stop for b in self.holding)

    @cached_property
    def laws(self) -> tuple[LawChange, ...]:
        """Positions at which forces change their laws, where that is located."""
        if not self.dynamics.locates_laws:
            return ()
        return tuple(
            LawChange(Joint(self.dynamics, a.hook.joint), a.law, a.key, *map(a.parameter, a.hook.switch))
            for a in self.scene.attached.of(Force)
            if a.hook.switch is not None and isinstance(a.hook.joint, int)
        )

    @cached_property
    def guards(self) -> tuple[Guard, ...]:
        """Guards that are located, and joints that stick and slip, which always are."""
        kind = LateGuard if self.dynamics.bounds_late_switch else Guard
        own = (kind(self.dynamics, name, a.key) for a in self.dynamics.guarded for name in a.guards)
        return (*own, *self.sticking)

    @property
    def bounded(self) -> tuple[Bounded, ...]:
        """Boundaries of coordinates."""
        return (*self.stops, *self.laws)

    @cached_property
    def boundaries(self) -> tuple[Boundary, ...]:
        """Boundaries at which the motion has events; guards come last."""
        return (*self.bounded, *self.guards)

    @property
    def sides(self) -> tuple[str, ...]:
        """Fields that say which laws hold, where their changes are located."""
        return (*(b.side for b in self.laws), *(b.side for b in self.guards))

    @property
    def resolves(self) -> bool:
        """Whether a lane may have to decide which stops act and which joints stick."""
        return bool(self.stops or self.sticking)

    @cached_property
    def overshoot(self) -> Overshoot:
        """How far accelerations may leave the range of their values at the stages."""
        method = self.dynamics.method
        return Overshoot(*(method.overshoot_between_nodes(at_ends=ends) for ends in (False, True)))

    # ---- quantities of lanes -------------------------------------------------------------------------

    def known_numbers(self, lane: Lane) -> dict[str, Any]:
        """Inputs of the equations beside the state: efforts, parameters, and the stops at which sliders
        rest."""
        d = self.dynamics
        names = (*d.commands, *d.parameters.numbers, *d.effect_states.updated, *self.active)
        at = {b.at: b.side_touched(lane) for b in self.sticking if b.travel is not None}
        return {name: lane[name] for name in (*names, *self.sides, *d.passed)} | at

    def quantities(self, lane: Lane, numbers: Mapping[str, Any] | None = None) -> Quantities:
        """Quantities of the present state, as if no joint could be held."""
        numbers = self.known_numbers(lane) if numbers is None else numbers
        return self.dynamics.quantities(lane.get(self.dynamics.states), numbers)

    def quantities_in_step(self, states: Sequence[Any], numbers: Mapping[str, Any]) -> Quantities:
        """Quantities in a step, in which joints may be held: "held1", ... are 1 while they are."""
        x = self.dynamics.quantities(states, numbers, held=bool(self.holding or self.sticking))
        x.update({f"held{k + 1}": 0.0 for k in self.arm.sliders()})
        x.update({f"held{b.number}": abs(numbers[b.active_stop]) for b in self.holding})
        held = {b.joint.number: where(numbers[b.side] == 0.0, 1.0, 0.0) for b in self.sticking}
        x.update({f"held{number}": value for number, value in held.items()})
        return x

    def pulls(self, x: Quantities, held: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Values of guards by the names of their boundaries, positive where the present law does not hold any
        more; see :meth:`StickingJoint.pull_of`."""
        values = self.dynamics.guard_values(x)
        found = {name: -(x[f"side_{name}"] * value) for name, value in values.items()}
        return found | {b.name: b.pull_of(x, held) for b in self.sticking}

    # ---- steps ---------------------------------------------------------------------------------------

    @cached_property
    def control(self) -> Control:
        """How steps are chosen."""
        if self.scene.integrator == "dop853":
            return Control.ADAPTIVE
        return Control.FIXED if self.scene.tolerance is None else Control.EQUAL

    @property
    def local(self) -> bool:
        """Whether lanes may take local steps."""
        return self.resolves or self.dynamics.controlled

    @property
    def counts_evaluations(self) -> bool:
        """Whether lanes may need different numbers of evaluations."""
        return self.local or bool(self.scene.attached.instants)

    @property
    def repeats_common_step(self) -> bool:
        """Whether an interval has several common steps."""
        several = not self.dynamics.controlled and self.scene.substeps > 1
        return bool(self.scene.attached.instants) or several

    @property
    def origin(self) -> str:
        """Form of the fields that hold a lane's values at the start of the interval."""
        repeats = self.repeats_common_step or bool(self.scene.attached.of(Impulse))
        return "{}_interval" if self.local and repeats else "{}_start"

    @property
    def kept(self) -> tuple[str, ...]:
        """Fields that are kept at the start of an interval, and restored when it is given up."""
        d = self.dynamics
        count = (INTERVALS,) if d.draws else ()
        return (*d.states, *d.effect_states.updated, *count, *self.active, *self.stiction.rests)

    @cached_property
    def log(self) -> NoLog:
        """The log of events."""
        if not (self.stops and self.dynamics.track_work):
            return NoLog()
        return EventLog() if self.dynamics.controlled else LogOfSubsteps()

    @property
    def counted(self) -> tuple[str, ...]:
        """Fields with counts of an interval, which are restored when it is crossed again or given up."""
        return (*(["impacts"] if self.stops else []), *self.log.counted)

    @cached_property
    def bounces(self) -> NoStops:
        """How low a bounce ends in rest."""
        if not self.stops:
            return NoStops(self.control)
        several = len(self.stops) > 1 or bool(self.dynamics.frictions)
        compared = self.control is Control.EQUAL and several
        return ComparedBounces(self.control) if compared else Bounces(self.control)

    # ---- error estimates -----------------------------------------------------------------------------

    @cached_property
    def sharpness(self) -> float:
        """The factor of the error estimate: the larger one with springs and stops, and with a force that
        declares where its single law bends."""
        forces = self.scene.attached.of(Force)
        springs = any("stiffness" in a.functions for a in forces)
        bends = any(
            "kink" in a.functions and "guard" not in a.functions and a.hook.switch is None for a in forces
        )
        return SHARPNESS_OF_SPRINGS if (springs and self.stops) or bends else SHARPNESS

    @cached_property
    def kinks(self) -> kinks.Watches:
        """Kinks that are watched, but not located, if an estimate decides on steps."""
        d = self.dynamics
        if self.scene.tolerance is None or not d.located:
            return {}
        constant = (*d.parameters.numbers, *d.effect_states.updated, *self.sides, *d.passed)
        return kinks.kinks_of(self.scene.attached, self.arm, constant, d.states)

    @property
    def pose_tells_distances(self) -> bool:
        """Whether the distances of the tip from the joints follow from the pose."""
        return not set(arguments_of(self.arm.column_norms)) <= {*self.arm.parameter_values()}

    @cached_property
    def watched_sliders(self) -> tuple[int, ...]:
        """Sliders that may carry the tip past a joint and back in a step, if estimates decide on steps."""
        watched = self.scene.tolerance is not None and self.dynamics.located and self.pose_tells_distances
        return tuple(self.arm.sliders()) if watched else ()

    @cached_property
    def doubts(self) -> dict[str, str]:
        """Fields with reasons why the error of an interval may exceed its estimate, and their docs."""
        if self.control is not Control.EQUAL:
            return {}
        found = {}
        if self.kinks:
            found["kinked"] = "a step of the interval may have met a kink"
            found["hidden_kink"] = "it may have met one that no stage has seen"
        if self.dynamics.effect_states.integrated or self.pose_tells_distances:
            found["doubtful"] = "a step of the interval makes its estimate doubtful"
        return found
