"""What a scene has that its lanes take care of: boundaries, joints that stick, a log, doubts about errors.
What it may lack is an object with a neutral default, such as :class:`NoStiction`."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

from redundant_envs.effects.bound_hooks import Attached
from redundant_envs.effects.hooks import Force, Gap, Impact, Impulse
from redundant_envs.language.algebra import arguments_of, where
from redundant_envs.language.quantities import Quantities
from redundant_envs.simulator.events.crossings import Overshoot
from redundant_envs.simulator.lane import boundary, kinks, stops
from redundant_envs.simulator.lane.dynamics import INTERVALS, Dynamics
from redundant_envs.simulator.lane.event_log import EventLog, NoLog
from redundant_envs.simulator.lane.faults import Control
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.lane.obstacles import NoWatch, Watch
from redundant_envs.simulator.lane.stiction import NoStiction, Stiction
from redundant_envs.simulator.numerics.error_control import SHARPNESS, SHARPNESS_OF_SPRINGS


class Features:
    """What the lanes of a scene take care of, beside the equations of its motion."""

    def __init__(self, dynamics: Dynamics, watches: bool = False) -> None:
        """``watches``: somebody asks how near the arm comes to obstacles within an interval."""
        self.dynamics, self.scene, self.arm = dynamics, dynamics.scene, dynamics.arm
        attached, controlled = self.scene.attached, dynamics.controlled

        # ---- boundaries
        impacts = attached.of(Impact)
        travels = {a.hook.joint: self._travel(a) for a in impacts}
        owners = {a.hook.joint: a.key for a in impacts}
        owners |= {k: some[0].key for k, some in dynamics.frictions.items()}
        self.stiction = Stiction(dynamics, travels, owners) if dynamics.slipping else NoStiction()
        self.sticking = self.stiction.joints
        of_joints = [self._stop(a, travels[a.hook.joint]) for a in impacts]
        walls = [
            stops.Wall(dynamics, f"gap{k}", a.key, a.functions["function"], a.parameter(a.hook.restitution))
            for k, a in enumerate(attached.of(Gap), start=1)
        ]
        self.stops: tuple[stops.Impacting, ...] = (*of_joints, *walls)
        """Boundaries that bounce: stops of joints, and walls, whose coordinates are any functions."""
        self.holding = tuple(b for b in of_joints if isinstance(b, stops.HoldingStop))
        """Stops that hold their sliders by themselves."""
        self.from_base = sorted(of_joints, key=lambda b: (isinstance(b, stops.HingeStop), b.travel.index))
        """Stops of sliders, then those of revolute joints from base to tip: an angle may be a difference of
        coordinates, of which those of the links before it are known first."""
        self.active = tuple(b.active_stop for b in self.holding)
        """Fields of the stops at which sliders rest."""
        self.laws = tuple(self._law_changes()) if dynamics.locates_laws else ()
        """Positions at which forces change their laws, where that is located."""
        guard = boundary.LateGuard if dynamics.bounds_late_switch else boundary.Guard
        guards = (guard(dynamics, name, a.key) for a in dynamics.guarded for name in a.guards)
        self.guards: tuple[boundary.Guard, ...] = (*guards, *self.sticking)
        """Guards that are located, and joints that stick and slip, which always are."""
        self.bounded: tuple[boundary.Bounded, ...] = (*self.stops, *self.laws)
        self.boundaries: tuple[boundary.Boundary, ...] = (*self.bounded, *self.guards)
        """Boundaries at which the motion has events; guards come last."""
        self.sides = (*(b.side for b in self.laws), *(b.side for b in self.guards))
        """Fields that say which laws hold, where their changes are located."""
        self.resolves = bool(self.stops or self.sticking)
        """Whether a lane may have to decide which stops act and which joints stick."""

        # ---- steps
        equal = Control.FIXED if self.scene.tolerance is None else Control.EQUAL
        self.control = Control.ADAPTIVE if self.scene.integrator == "dop853" else equal
        self.local = self.resolves or controlled
        self.counts_evaluations = self.local or bool(attached.instants)
        """Whether lanes may need different numbers of evaluations."""
        self.repeats_common_step = bool(attached.instants) or (not controlled and self.scene.substeps > 1)
        repeats = self.repeats_common_step or bool(attached.of(Impulse))
        self.origin = "{}_interval" if self.local and repeats else "{}_start"
        """Form of the fields that hold a lane's values at the start of the interval."""
        self.rests = tuple(j.rest for j in self.sticking)
        """Fields of the positions at which joints stick."""
        count = (INTERVALS,) if dynamics.draws else ()
        self.saved = (*dynamics.states, *dynamics.effect_states.updated, *count, *self.active, *self.rests)
        """Fields that are saved at the start of an interval, and restored when it is given up."""
        self.log = EventLog(several=not controlled) if self.stops and dynamics.track_work else NoLog()
        self.counted = (*(["impacts"] if self.stops else []), *self.log.counted)
        """Fields with counts of an interval, which are restored when it is crossed again or given up."""
        self.watch = Watch(dynamics) if watches else NoWatch()
        self.restored = (*self.active, *self.rests, *self.counted, *self.watch.closest)
        """Fields that are as they were where an interval begins anew, beside states."""
        several = len(self.stops) > 1 or bool(dynamics.frictions)
        compared = self.control is Control.EQUAL and bool(self.stops) and several
        self.bounces = (stops.ComparedBounces if compared else stops.Bounces)(self.control, bool(self.stops))

        # ---- error estimates
        forces = attached.of(Force)
        springs = any("stiffness" in a.functions for a in forces)
        single = [a.functions for a in forces if a.hook.switch is None]
        bends = any("kink" in functions and "guard" not in functions for functions in single)
        self.sharpness = SHARPNESS_OF_SPRINGS if (springs and self.stops) or bends else SHARPNESS
        """The factor of the error estimate: the larger one with springs and stops, and with a force that
        declares where its single law bends."""
        of_pose = {*arguments_of(self.arm.column_norms)} - {*self.arm.parameter_values()}
        self.pose_tells_distances = bool(of_pose)
        """Whether the distances of the tip from the joints follow from the pose."""
        estimates = self.scene.tolerance is not None and dynamics.located
        self.watched_sliders = tuple(self.arm.sliders()) if estimates and self.pose_tells_distances else ()
        """Sliders that may carry the tip past a joint and back in a step, if estimates decide on steps."""

    def _travel(self, a: Attached[Impact]) -> boundary.Travel:
        kind = boundary.Travel if self.arm.prismatic[a.hook.joint] else boundary.HingeTravel
        return kind(self.dynamics, a.hook.joint, a.parameter(a.hook.lower), a.parameter(a.hook.upper))

    def _stop(self, a: Attached[Impact], travel: boundary.Travel) -> stops.TravelStop:
        bounce = a.parameter(a.hook.restitution)
        if not self.sticking:
            return stops.HoldingStop(travel, a.key, bounce)
        kind = stops.Stop if self.arm.prismatic[travel.index] else stops.HingeStop
        return kind(travel, a.key, bounce, next(j for j in self.sticking if j.travel is travel))

    def _law_changes(self) -> Iterator[boundary.LawChange]:
        for a in self.scene.attached.of(Force):
            if a.hook.switch is not None and isinstance(a.hook.joint, int):
                joint = boundary.Joint(self.dynamics, a.hook.joint)
                yield boundary.LawChange(joint, a.law, a.key, *map(a.parameter, a.hook.switch))

    @cached_property
    def overshoot(self) -> Overshoot:
        """How far accelerations may leave the range of their values at the stages."""
        return Overshoot(*(self.dynamics.method.overshoot_between_nodes(at_ends=e) for e in (False, True)))

    @cached_property
    def kinks(self) -> kinks.Watches:
        """Kinks that are watched, but not located, if an estimate decides on steps."""
        d = self.dynamics
        if self.scene.tolerance is None or not d.located:
            return {}
        constant = (*d.parameters.numbers, *d.effect_states.updated, *self.sides, *d.passed)
        return kinks.kinks_of(self.scene.attached, self.arm, constant, d.states)

    @cached_property
    def doubts(self) -> tuple[str, ...]:
        """Fields with reasons why the error of an interval may exceed its estimate: a step may have met a
        kink, or one that no stage has seen, or something else makes its estimate doubtful."""
        if self.control is not Control.EQUAL:
            return ()
        doubtful = self.dynamics.effect_states.integrated or self.pose_tells_distances
        return (*(("kinked", "hidden_kink") if self.kinks else ()), *(("doubtful",) if doubtful else ()))

    # ---- quantities of lanes -------------------------------------------------------------------------

    def known_numbers(self, lane: Lane) -> dict[str, Any]:
        """Inputs of the equations beside the state: efforts, parameters, and stops at which sliders rest."""
        d = self.dynamics
        names = (*d.commands, *d.parameters.numbers, *d.effect_states.updated, *self.active)
        at = {b.at: b.travel.side_touched(lane) for b in self.sticking if b.travel is not None}
        return {name: lane[name] for name in (*names, *self.sides, *d.passed)} | at

    def quantities(self, lane: Lane) -> Quantities:
        """Quantities of the present state, as if no joint could be held."""
        return self.dynamics.quantities(lane.get(self.dynamics.states), self.known_numbers(lane))

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
        pulls = {name: -(x[f"side_{name}"] * value) for name, value in self.dynamics.guard_values(x).items()}
        return pulls | {b.name: b.pull_of(x, held) for b in self.sticking}
