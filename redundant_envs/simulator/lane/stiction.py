"""Joints that stick and slip: with dry friction, and where they rest at the stop of a revolute joint."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from redundant_envs.effects.hooks import Impact
from redundant_envs.language.algebra import all_of, cases, logical_not, maximum, minimum, sqrt, total, where
from redundant_envs.language.limits import ROUNDING
from redundant_envs.language.quantities import Quantities
from redundant_envs.simulator.events.boundary import BoundedCoordinate, guarded
from redundant_envs.simulator.events.first_event import Encounter
from redundant_envs.simulator.lane.boundary import SMALLEST_LATE_SHARE, Guard, Joint, Travel, times
from redundant_envs.simulator.lane.dynamics import Dynamics, quantities_of_arm
from redundant_envs.simulator.lane.fields import STATE, Own, Variable
from redundant_envs.simulator.lane.memory import Lane

LARGEST_LATE_SHARE = 1e-6
"""Fraction of a planned step by which a joint may be torn loose late."""
LATE_REST = 0.01
"""The same of a joint that comes to rest, over the root of the tolerance, as a fraction of the trial step: a
short one must not hide how a joint slips, sticks, and slips again."""
PASSES_AT_STOPS = 8
"""Times as many resolutions with stops and dry friction: of the contacts and of the modes, each twice at an
impact and twice where a slider turns."""
SHARE_OF_BOUNCES = 1 / 64
"""Less of a tolerance with stops and dry friction: a slider that bounces turns as often as it strikes."""
TORN_LOOSE = 1.0 + 1e-12
"""A joint sticks until holding it takes this share of its limit: rounding must not tear it loose."""
LOST_IN_LOADS = 1e-14
"""The same of all torques at the joints, and with dry friction of gravity and of what turning takes, which
nearly cancel where a small friction decides: with none, joints would slip and stick by rounding for ever."""
HELD_FAST = -1.0
"""Value of the guard of a joint that sticks and is locked: it never gets to 0."""
SLIPS_FREELY = -1.0
"""Value of the guard of a joint with a stop and no friction that does not rest: it never gets to 0."""


class StickingJoint(Guard):
    """A joint whose law is the way in which it slips, 1 or -1, or 0 while it sticks."""

    rest = Own("", "position at which {} sticks", STATE)
    force = Own("N m or N", "that holds the joint")
    alpha = Own("", "acceleration of the joint")
    limit = Own("N m or N", "of the friction at rest")

    def __init__(self, joint: Joint, owner: str, travel: Travel | None) -> None:
        """``travel`` is that of the joint if it has stops."""
        super().__init__(joint.dynamics, f"friction{joint.number}", owner)
        self.joint, self.travel = travel or joint, travel
        self.at = f"at_{self.name}"
        """The quantity that says at which side's stop it is."""
        self.rubs = joint.index in joint.dynamics.frictions
        """Whether it has friction, and not a stop alone."""

    def in_step(self, lane: Lane) -> BoundedCoordinate:
        return guarded(self.watched(lane), sticks=True)

    def late_share(self, lane: Lane) -> Any:
        """With dry friction the motion is led back to the change, and only the square of the lateness is an
        error, and a part of it where a limit falls as a joint is torn loose."""
        if self.dynamics.scene.tolerance is None:
            return SMALLEST_LATE_SHARE
        share = lane.tip_tolerance
        if self.dynamics.scene.attached.of(Impact):
            share = share * SHARE_OF_BOUNCES
        least = maximum(minimum(share, LARGEST_LATE_SHARE), SMALLEST_LATE_SHARE)
        if not self.rubs:
            return least
        late = LATE_REST * sqrt(lane.tip_tolerance) * (lane.step / lane.left)
        return where(lane[self.side] == 0.0, least, maximum(least, late))

    def encounter(self, lane: Lane, number: float) -> Encounter:
        return super().encounter(lane, number)._replace(steepness=-(lane[self.side] * lane[self.alpha]))

    def other_law(self, lane: Lane, passed: Any) -> dict[str, Any]:
        return {}

    def pull_of(self, x: Quantities, held: Mapping[str, Any] | None) -> Any:
        """Value of its guard; that of a joint that sticks follows from the force that holds it, or is
        ``held`` if ``x`` has no forces."""
        mode = x[self.side]
        slips = where(self._turns_freely(x), SLIPS_FREELY, -(mode * x[f"phid{self.joint.number}"]))
        if held is not None:
            return where(mode == 0.0, held[self.name], slips)
        locked = self.dynamics.locked(self.joint.index, x)
        return where(mode == 0.0, where(locked, HELD_FAST, self._load(x)), slips)

    def _load(self, x: Quantities) -> Any:
        """How much the force that holds it exceeds its limit, N m or N."""
        dynamics = self.dynamics
        applied = "t" if dynamics.scene.actuation == "joint" else "Q"
        loads = total(abs(x[f"{force}{k + 1}"]) for force in f"{applied}Gh" for k in range(dynamics.count))
        hold = x[f"hold{self.joint.number}"]
        load = abs(hold)
        if self.travel is not None:  # whose stop holds it in one direction, whatever that takes
            load = where(x[self.at] == 0.0, load, x[self.at] * hold)
        return load - (TORN_LOOSE * dynamics.friction_limit(self.joint.index, x, 0.0) + LOST_IN_LOADS * loads)

    def _is_locked(self, lane: Lane) -> Any:
        """Whether it sticks, and no impulse moves it."""
        if not self.dynamics.locking:
            return False
        return (lane[self.side] == 0.0) & self.dynamics.locked(self.joint.index, self._known(lane))

    def _turns_freely(self, x: Quantities) -> Any:
        """Whether nothing changes where its rate passes 0: it has no friction; a stop is met as a position.

        Not so if it has a stop, and another joint friction: at an impact that one slips for an instant unless
        it is locked, and its friction pushes others off their stops, which strike then. A turn at the stop
        ends the series.
        """
        dynamics, own = self.dynamics, self.joint.index
        joints = {own} if self.travel is None else {own, *dynamics.frictions}
        return all_of(
            dynamics.slips_freely(k, x) | (k != own and dynamics.rests_locked(k, x)) for k in sorted(joints)
        )

    # ---- what a lane does with it --------------------------------------------------------------------

    def _never_rests(self, lane: Lane) -> Any:
        """Whether it cannot rest where it is: it turns freely, and is at no stop."""
        x = self._known(lane)
        free = True if self.travel is None else self.travel.side_touched(lane) == 0.0
        return free & self._turns_freely(x)

    def _known(self, lane: Lane) -> Quantities:
        """What limits and locks follow from, in the present state."""
        x = quantities_of_arm(self.dynamics, lane)
        x.update(lane.values(self.dynamics.effect_states.updated))
        return x

    def _mode(self, lane: Lane, rate: Any) -> Any:
        """With a rate it slips that way; without one it sticks, unless forces object."""
        still = where(self._never_rests(lane), 1.0, 0.0)
        return cases((rate > 0.0, 1.0), (rate < 0.0, -1.0), default=still)

    def begin_mode(self, lane: Lane) -> None:
        """Before a common step."""
        position, rate = self.joint.motion(lane)
        lane[self.side] = self._mode(lane, rate)
        lane[self.pull] = -abs(rate)
        self._come_to_rest(lane, position, lane[self.side] == 0.0)

    def _come_to_rest(self, lane: Lane, position: Any, sticks: Any) -> None:
        """Record where it sticks; the position that is known stays, but for rounding."""
        size = total(abs(q) for q in lane.get(self.dynamics.arm.coordinates))
        known = abs(position - lane[self.rest]) <= ROUNDING * size
        lane[self.rest] = where(sticks & logical_not(known), position, lane[self.rest])

    def keep(self, lane: Lane, before: Mapping[str, Any], now: dict[str, Any]) -> None:
        """While it sticks, keep its position and its rate 0 to the last bit."""
        arm, joint, others = self.dynamics.arm, self.joint, self.joint.others()
        sticks = lane[self.side] == 0.0
        rate, position = 0.0, before[joint.coordinate]
        if others:
            rate = total(times(share, now[arm.rates[k]]) for k, share in others)
            still = all_of(now[arm.coordinates[k]] == before[arm.coordinates[k]] for k, _ in others)
            moved = (times(share, now[arm.coordinates[k]]) for k, share in others)
            position = where(still, position, total([lane[self.rest], *moved]))
        now[joint.rate] = where(sticks, rate, now[joint.rate])
        now[joint.coordinate] = where(sticks, position, now[joint.coordinate])

    def strike(self, lane: Lane, strikes: Any) -> None:
        """After impulses: without a rate it is decided anew, unless it is locked."""
        locked = self._is_locked(lane)
        still = self.joint.own_value(0.0, lane, self.dynamics.arm.rates)
        lane[self.joint.rate] = where(locked, still, lane[self.joint.rate])
        position, rate = self.joint.motion(lane)
        mode = where(locked, 0.0, self._mode(lane, rate))
        lane[self.side] = where(strikes, mode, lane[self.side])
        self._come_to_rest(lane, position, strikes & (mode == 0.0))

    def pivot(self, lane: Lane, settled: Any) -> Any:
        """Get another mode if the present one contradicts the forces, and the joints before are ``settled``;
        whether it is settled, too."""
        position, rate = self.joint.motion(lane)
        mode, force = lane[self.side], lane[self.force]
        wrong = where(mode == 0.0, lane[self.pull] > 0.0, mode * lane[self.alpha] < 0.0)
        wrong = wrong & logical_not(self._never_rests(lane) & (mode != 0.0))
        if self.travel is not None:
            wrong = wrong | (mode * self.travel.side_touched(lane) > 0.0)
        wrong = wrong & (rate == 0.0) & settled
        other = where(mode == 0.0, where(force > 0.0, -1.0, 1.0), 0.0)
        lane[self.side] = where(wrong, other, mode)
        self._come_to_rest(lane, position, wrong & (other == 0.0))
        return settled & logical_not(wrong)

    def arrive(self, lane: Lane, sought: Any, side: Any, position: Any) -> None:
        """One that slipped has the rate 0 now, and one that stuck slips against the force that held it."""
        passed = sought | (lane[self.pull] > 0.0)
        mode, (here, _) = lane[self.side], self.joint.motion(lane)
        loose = where(lane[self.force] > 0.0, -1.0, 1.0)
        lane[self.side] = where(passed, where(mode == 0.0, loose, 0.0), mode)
        self._come_to_rest(lane, here, passed & (mode != 0.0))
        lane.at_stop = lane.at_stop | passed


class NoStiction:
    """A scene in which no joint sticks: its stops hold sliders by themselves."""

    joints: Sequence[StickingJoint] = ()
    at_stops: Sequence[StickingJoint] = ()  # those of them that have stops
    passes = 1  # times as many resolutions of contacts as without stiction
    node: float | None = None  # the middle stage of a step, as a fraction of it, with dry friction

    def fields(self) -> Iterator[Variable]:
        """Fields beside those that every guard has."""
        for j in self.joints:
            yield from j.own_variables("rest", "force", "alpha")
        for j in self.at_stops:
            yield from j.own_variables("limit")

    def grip(self, lane: Lane, joint: StickingJoint | None) -> Any:
        """Limit of the friction at rest of a joint with a stop; None if stops hold sliders by themselves."""
        return None

    def keep(self, lane: Lane, before: Mapping[str, Any], now: dict[str, Any]) -> None:
        """Let joints that stick keep their positions and their rate 0 to the last bit, in a new state ``now``
        after a state ``before``."""
        for joint in self.joints:
            joint.keep(lane, before, now)

    def stick(self, lane: Lane, before: Mapping[str, Any] | None = None) -> None:
        """Let joints that stick have the rate 0 in the present state; after a last piece from a state
        ``before`` lead the motion back to where they stick."""

    def record(self, lane: Lane, x: Quantities, pulls: Callable[[Quantities], Mapping[str, Any]]) -> None:
        """The forces that hold joints, and the accelerations of others, in the present state."""

    def strike(self, lane: Lane, strikes: Any, going_on: Any) -> Any:
        """After contacts are resolved, with impulses where one ``strikes``: whether the motion goes on."""
        return going_on

    def decide(self, lane: Lane, here: Any) -> Any:
        """Decide which joints stick in the lanes that are ``here``; whether the motion goes on."""
        return here


class Stiction(NoStiction):
    """A scene with dry friction, or with stops of revolute joints."""

    def __init__(self, dynamics: Dynamics, travels: Mapping[int, Travel], owners: Mapping[int, str]) -> None:
        """``travels`` of joints with stops, and keys of the effects that let joints stick, by joints."""
        self.dynamics = dynamics
        joints = [Joint(dynamics, k) for k in dynamics.slipping]
        self.joints = [StickingJoint(j, owners[j.index], travels.get(j.index)) for j in joints]
        self.at_stops = [j for j in self.joints if j.travel is not None]
        self.passes = PASSES_AT_STOPS if self.at_stops else 1
        self.node = dynamics.method.c[dynamics.method.middle] if dynamics.frictions else None

    def grip(self, lane: Lane, joint: StickingJoint | None) -> Any:
        return 0.0 if joint is None else lane[joint.limit]

    def stick(self, lane: Lane, before: Mapping[str, Any] | None = None) -> None:
        now = lane.values((*self.dynamics.arm.coordinates, *self.dynamics.arm.rates))
        self.keep(lane, before or {**now}, now)
        lane.set(now, now.values())

    def record(self, lane: Lane, x: Quantities, pulls: Callable[[Quantities], Mapping[str, Any]]) -> None:
        for j in self.joints:
            lane[j.force], lane[j.alpha] = x[f"hold{j.joint.number}"], x[f"alpha{j.joint.number}"]
        for j in self.at_stops:
            lane[j.limit] = self.dynamics.friction_limit(j.joint.index, x, 0.0)
        for name, value in pulls(x).items():
            lane[f"pull_{name}"] = value

    def strike(self, lane: Lane, strikes: Any, going_on: Any) -> Any:
        """Friction is bounded, so it has no impulse: joints that stuck get rates like all others, unless they
        are locked; then the forces are those of the modes before."""
        for j in self.joints:
            j.strike(lane, strikes)
        return going_on & logical_not(strikes)

    def decide(self, lane: Lane, here: Any) -> Any:
        """One pass of pivoting: of the joints without a rate the first whose mode contradicts the forces gets
        another one.

        Joints stick where their limits hold them, or else slip the way in which they accelerate: a linear
        complementarity problem with bounds, whose matrix, a block of B^T M^-1 B, is positive definite. So
        there is one solution, and pivoting by the least index finds it (Murty 1974). A joint at its stop has
        one bound only, since the stop holds it in the other direction.
        """
        settled = here
        for j in self.joints:
            settled = j.pivot(lane, settled)
        lane.changes = lane.changes + 1.0
        return settled
