"""Guards of a lane: which laws of effects hold, and which joints stick."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from redundant_envs.algebra import all_of, cases, logical_not, total, where
from redundant_envs.events.boundary import ROUNDING, Boundary, side_beyond
from redundant_envs.lane.coordinates import known_numbers, motion, side_of_stop
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.memory import Lane
from redundant_envs.quantities import Quantities


class Guards:
    """Procedures of lanes whose laws change where guards change their signs."""

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics = dynamics

    def begin_laws(self, lane: Lane) -> None:
        """Before a common step: which laws the state selects."""
        for b in self.dynamics.laws:
            position, _ = motion(self.dynamics, b, lane)
            lane[b.side] = lane[f"{b.side}_start"] = side_beyond(position, lane[b.lower], lane[b.upper])
        self.settle(lane, True)
        self._begin_modes(lane)
        lane.copy(self.dynamics.rests, to="{}_start")
        for b in self.dynamics.guards:
            lane.copy((b.side, b.pull), to="{}_start")

    def _begin_modes(self, lane: Lane) -> None:
        """Joints with a rate slip that way; those without stick, unless the forces say otherwise."""
        for b in self.dynamics.sticking:
            position, rate = motion(self.dynamics, b, lane)
            lane[b.side] = cases((rate > 0.0, 1.0), (rate < 0.0, -1.0), default=0.0)
            lane[b.pull] = -abs(rate)
            self._come_to_rest(lane, b, position, lane[b.side] == 0.0)

    def _come_to_rest(self, lane: Lane, b: Boundary, position: Any, sticks: Any) -> None:
        """Record where a joint sticks; the position that is known stays, but for rounding."""
        size = total(abs(q) for q in lane.get(self.dynamics.arm.coordinates))
        known = abs(position - lane[b.rest]) <= ROUNDING * size
        lane[b.rest] = where(sticks & logical_not(known), position, lane[b.rest])

    def settle(self, lane: Lane, here: Any) -> None:
        """Let the state of some lanes decide which laws of guards hold."""
        numbers = known_numbers(self.dynamics, lane)
        x = self.dynamics.quantities(lane.get(self.dynamics.states), numbers)
        for name, value in self.dynamics.guard_values(x, begins=True).items():
            side, pull = f"side_{name}", f"pull_{name}"
            lane[side] = where(here, x[side], lane[side])
            lane[pull] = where(here, -abs(value), lane[pull])

    def record_pulls(self, lane: Lane) -> None:
        """After a step: the values of guards in the present state; those of joints that stick are from the
        last stage."""
        numbers = known_numbers(self.dynamics, lane)
        x = self.dynamics.quantities(lane.get(self.dynamics.states), numbers)
        held = {b.name: lane[f"last_{b.name}"] for b in self.dynamics.sticking}
        for name, value in self.dynamics.pulls(x, held).items():
            lane[f"pull_{name}"] = value

    # ---- joints that stick -------------------------------------------------------------------------------

    def keep_sticking(self, lane: Lane, before: Mapping[str, Any], now: dict[str, Any]) -> None:
        """Let joints that stick keep their positions and their rate 0 to the last bit, in a new state ``now``
        after a state ``before``."""
        arm = self.dynamics.arm
        for b in self.dynamics.sticking:
            assert b.joint is not None
            sticks, position, rate = lane[b.side] == 0.0, arm.coordinates[b.joint], arm.rates[b.joint]
            others = self.dynamics.others_of_joint(b)
            rest, kept = 0.0, before[position]
            if others:
                rest = total(_times(share, now[arm.rates[k]]) for k, share in others)
                still = all_of(now[arm.coordinates[k]] == before[arm.coordinates[k]] for k, _ in others)
                moved = (_times(share, now[arm.coordinates[k]]) for k, share in others)
                kept = where(still, kept, total([lane[b.rest], *moved]))
            now[rate] = where(sticks, rest, now[rate])
            now[position] = where(sticks, kept, now[position])

    def stick(self, lane: Lane, before: Mapping[str, Any] | None = None) -> None:
        """Let joints that stick have the rate 0 in the present state, and after a state ``before`` their
        positions."""
        names = (*self.dynamics.arm.coordinates, *self.dynamics.arm.rates)
        now = dict(zip(names, lane.get(names), strict=True))
        self.keep_sticking(lane, dict(now) if before is None else before, now)
        lane.set(now, now.values())

    def record_friction(self, lane: Lane, x: Quantities) -> None:
        """The forces that hold joints, and the accelerations of others, in the present state."""
        for b in self.dynamics.sticking:
            lane[f"force_{b.name}"], lane[f"alpha_{b.name}"] = x[f"hold{b.number}"], x[f"alpha{b.number}"]
        for b, _ in self.dynamics.gripped:
            lane[f"limit_{b.name}"] = self.dynamics.friction_limit(b, x, 0.0)
        for name, value in self.dynamics.pulls(x).items():
            lane[f"pull_{name}"] = value

    def strike(self, lane: Lane, strikes: Any) -> None:
        """After impulses: joints with a rate slip that way, and those without one are decided anew. Friction
        is bounded, so it has no impulse: joints that stuck get rates like all others."""
        for b in self.dynamics.sticking:
            position, rate = motion(self.dynamics, b, lane)
            mode = cases((rate > 0.0, 1.0), (rate < 0.0, -1.0), default=0.0)
            lane[b.side] = where(strikes, mode, lane[b.side])
            self._come_to_rest(lane, b, position, strikes & (mode == 0.0))

    def stick_or_slip(self, lane: Lane, here: Any = True) -> Any:
        """One pass of pivoting in lanes that are ``here``: of the joints without a rate the first whose mode
        contradicts the forces gets another one; whether none does.

        Joints stick where their limits hold them, or else slip the way in which they accelerate: a linear
        complementarity problem with bounds, whose matrix, a block of B^T M^-1 B, is positive definite. So
        there is one solution, and pivoting by the least index finds it (Murty 1974). A joint at its stop has
        one bound only, since the stop holds it in the other direction.
        """
        settled: Any = here
        stops = dict(self.dynamics.gripped)
        for b in self.dynamics.sticking:
            position, rate = motion(self.dynamics, b, lane)
            mode, force = lane[b.side], lane[f"force_{b.name}"]
            wrong = where(mode == 0.0, lane[b.pull] > 0.0, mode * lane[f"alpha_{b.name}"] < 0.0)
            if b in stops:
                wrong = wrong | (mode * side_of_stop(self.dynamics, stops[b], lane) > 0.0)
            wrong = wrong & (rate == 0.0) & settled
            other = where(mode == 0.0, where(force > 0.0, -1.0, 1.0), 0.0)
            lane[b.side] = where(wrong, other, mode)
            self._come_to_rest(lane, b, position, wrong & (other == 0.0))
            settled = settled & logical_not(wrong)
        lane.changes = lane.changes + 1.0
        return settled

    def rest_or_tear_loose(self, lane: Lane, b: Boundary, passed: Any) -> None:
        """At an event of a joint with dry friction: one that slipped has the rate 0 now, and one that stuck
        slips against the force that held it."""
        mode, (position, _) = lane[b.side], motion(self.dynamics, b, lane)
        loose = where(lane[f"force_{b.name}"] > 0.0, -1.0, 1.0)
        lane[b.side] = where(passed, where(mode == 0.0, loose, 0.0), mode)
        self._come_to_rest(lane, b, position, passed & (mode != 0.0))


def _times(share: float, x: Any) -> Any:
    return x if share == 1.0 else share * x
