"""Sliders at their stops, and joints at which forces change their laws: how a step finds their events, and
how contacts are resolved."""

from __future__ import annotations

from typing import Any

from redundant_envs.algebra import any_of, cases, maximum, minimum, where
from redundant_envs.integrators import contact_resolution, contacts, crossings
from redundant_envs.integrators.methods import Watched
from redundant_envs.integrators.sliders import Slider, limits_of_law, side_touched, starts_at_stop
from redundant_envs.integrators.trial_steps import Phase
from redundant_envs.simulator.lane import Lane
from redundant_envs.simulator.setting import WATCHED, Fault, Reason, Setting
from redundant_envs.simulator.step import (
    active_stop,
    contact_quantities,
    joint_quantities,
    known_numbers,
    pull,
)


class AtStops(Setting):
    """Procedures of lanes whose sliders may be at stops."""

    def sliders(self, lane: Lane, origin: str, h: Any) -> list[Slider]:
        """The sliders in a step, whose initial values are in fields of this form, and the joints with
        switches."""
        sliders = [
            Slider(
                lane[q], lane[v], lane[origin.format(q)], lane[origin.format(v)],
                Watched(*lane.get(WATCHED, of=f"{{}}_{s.name}")), lane[active_stop(s.name)],
                lane[s.lower], lane[s.upper],
            )
            for s, q, v in zip(self.stops, self.positions, self.rates, strict=True)
        ]  # fmt: skip
        if not self.switches:
            return sliders
        ends, starts = (joint_quantities(self.dynamics, lane, form) for form in ("{}", origin))
        for s in self.switches:
            names = f"phi{s.joint + 1}", f"phid{s.joint + 1}"
            lower, upper = limits_of_law(lane[s.side], lane[s.lower], lane[s.upper])
            (position, velocity), (start, start_velocity) = ends.each(names), starts.each(names)
            watched = Watched(*lane.get(WATCHED, of=f"{{}}_{s.name}"))
            sliders.append(
                Slider(position, velocity, start, start_velocity, watched, 0.0, lower, upper, passes=True)
            )
        return sliders

    def _set_crossings(self, lane: Lane, sliders: list[Slider], h: Any) -> None:
        for s, slider in zip(self.boundaries, sliders, strict=True):
            lane[f"crossing_{s.name}"] = crossings.crossing_of(slider, h, self.unseen)
            lane[f"turning_{s.name}"] = crossings.turning_time(slider, h)

    def begun_at(self, lane: Lane, rule: Any) -> list[Any]:
        """Apply a rule of :mod:`sliders` to every slider in its state before the common step."""
        return [
            rule(*lane.get((q, v, active_stop(s.name)), of="{}_start"), lane[s.lower], lane[s.upper])
            for s, q, v in zip(self.stops, self.positions, self.rates, strict=True)
        ]

    def _touched_before(self, lane: Lane) -> Any:
        """Whether a slider was at a stop, or rested there, before the common step."""
        return any_of(
            side_touched(lane[f"{q}_start"], lane[f"{a}_start"], lane[s.lower], lane[s.upper]) != 0.0
            for s, q, a in zip(self.stops, self.positions, self.active, strict=True)
        )

    def meet(self, lane: Lane) -> None:
        """After :meth:`judge`, for sliders near a stop: whether they meet it."""
        sliders = self.sliders(lane, "{}_start", lane.h)
        self._set_crossings(lane, sliders, lane.h)
        # A slider that was released before the step starts at its stop and may leave it.
        starts = [*self.begun_at(lane, starts_at_stop), *(False for _ in self.switches)]
        meets = any_of(
            slider.free & ((lane[f"crossing_{s.name}"] != 0.0) | start)
            for s, slider, start in zip(self.boundaries, sliders, starts, strict=True)
        )
        met = where(meets, Reason.STOP, Reason.NONE)
        lane.reason = where(lane.reason == Reason.NEAR_STOP, met, lane.reason)

    def press(self, lane: Lane) -> None:
        """After a step with sliders at rest: also the force with which a stop would have to pull one now."""
        x = self.contact_quantities(lane)
        for s in self.stops:
            held = x[f"held{s.joint + 1}"] > 0.0
            now = pull(x, s.joint, lane[active_stop(s.name)])
            for name, value in (
                ("least", minimum(lane[f"least_{s.name}"], now)),
                ("most", maximum(lane[f"most_{s.name}"], now)),
                ("last", now),
            ):
                lane[f"{name}_{s.name}"] = where(held, value, lane[f"{name}_{s.name}"])

    def contact_quantities(self, lane: Lane) -> Any:
        """Quantities of the present state, with the present sliders at rest."""
        numbers = known_numbers(self.dynamics, lane, held=True)
        x = contact_quantities(self.dynamics, lane.get(self.dynamics.states), numbers)
        x["derivatives"] = self.dynamics.accelerations(x)
        return x

    def mobility(self, column: Any) -> list[list[Any]]:
        """Mobilities of the sliders: the velocity of each by a unit impulse along each."""
        upper = {(i, j): column(i, j) for j in range(len(self.stops)) for i in range(j + 1)}
        n = range(len(self.stops))
        return [[upper[min(i, j), max(i, j)] for j in n] for i in n]

    def release(self, lane: Lane) -> None:
        """Before a common step: release sliders whose stops would have to pull them."""
        x = self.contact_quantities(lane)
        joints = [s.joint + 1 for s in self.stops]
        sliders = [
            contacts.Contact(
                lane[q], lane[v], lane[active_stop(s.name)], lane[s.lower], lane[s.upper], None,
                x[f"hold{s.joint + 1}"], None,
            )
            for s, q, v in zip(self.stops, self.positions, self.rates, strict=True)
        ]  # fmt: skip
        w = self.mobility(lambda i, j: x[f"W{joints[i]}{joints[j]}"])
        for name, leaves in zip(self.active, contacts.leaving(sliders, w), strict=True):
            lane[name] = where(leaves, 0.0, lane[name])

    def look_at_contacts(self, lane: Lane) -> None:
        """Accelerations, holding forces and mobilities, of the present state."""
        x, dynamics = self.contact_quantities(lane), self.dynamics
        lane.set(dynamics.states[dynamics.count :], x["derivatives"], of="{}_slope")
        for s in self.stops:
            lane[f"force_{s.name}"] = x[f"hold{s.joint + 1}"]
            for k, v in enumerate(dynamics.arm.rates):
                lane[f"mobility_{v}_{s.name}"] = x[f"W{k + 1}{s.joint + 1}"]

    def resolve_contacts(self, lane: Lane) -> None:
        """At a stop: apply impulses, rest and release, as :mod:`contact_resolution` decides."""
        dynamics = self.dynamics
        moving = dynamics.states[dynamics.count :]
        # The velocities of a Taylor step to the stop, now that the accelerations are known.
        now = {
            s: where(lane.slide == 0.0, lane[s], lane[s] + lane.slide * lane[f"{s}_slope"]) for s in moving
        }
        now |= {q: lane[q] for q in dynamics.arm.coordinates}
        touching = [
            contacts.Contact(
                now[q], now[v], lane[active_stop(s.name)], lane[s.lower], lane[s.upper], lane[f"{v}_slope"],
                lane[f"force_{s.name}"], lane[f"released_{s.name}"],
            )
            for s, q, v in zip(self.stops, self.positions, self.rates, strict=True)
        ]  # fmt: skip
        rates, names = self.rates, [s.name for s in self.stops]
        w = self.mobility(lambda i, j: lane[f"mobility_{rates[i]}_{names[j]}"])
        at_stop, restitution = lane.phase == Phase.AT_STOP, lane[self.stops[0].restitution]
        r = contact_resolution.resolve_contacts(at_stop, lane.changes, lane.impacts, touching, w, restitution)
        struck = dict(zip(rates, r.velocities, strict=True))
        for v in dynamics.arm.rates:
            if v not in struck:
                pushes = [j * lane[f"mobility_{v}_{n}"] for j, n in zip(r.impulses, names, strict=True)]
                struck[v] = now[v] + sum(pushes[1:], pushes[0])
        if "work" in now:
            done = [j * (c.velocity + v) for j, c, v in zip(r.impulses, touching, r.velocities, strict=True)]
            struck["work"] = now["work"] + 0.5 * sum(done[1:], done[0])
        for s in dynamics.states:
            after = where(r.strikes, struck[s], now[s]) if s in struck else now[s]
            lane[s] = where(r.given_up, lane[f"{s}_start"], after)
            lane[f"{s}_trial"] = where(r.going_on, after, lane[f"{s}_trial"])
        for name, value in zip(self.active, r.active_stops, strict=True):
            lane[name] = where(r.given_up, lane[f"{name}_start"], value)
        lane.error_trial = where(r.going_on, lane.error, lane.error_trial)
        lane.step = where(r.going_on, lane.left, lane.step)
        lane.impacts = where(r.given_up, lane.impacts_start, r.impacts)
        lane.changes = lane.changes + where(at_stop, 1.0, 0.0)
        lane.fault = where(r.given_up, Fault.EVENT_BUDGET, lane.fault)
        lane.slide = 0.0
        self._set_phase(
            lane, cases((r.given_up, Phase.COMPLETE), (r.going_on, Phase.RUN), default=lane.phase)
        )
        for stop, force, released, happened, speed in zip(
            self.stops, r.forces, r.released, r.happened, r.speeds, strict=True
        ):
            lane[f"force_trial_{stop.name}"] = where(r.going_on, force, lane[f"force_trial_{stop.name}"])
            lane[f"released_{stop.name}"] = released
            if self.logs:
                lane[f"happened_{stop.name}"], lane[f"speed_{stop.name}"] = happened, speed
        if self.logs:
            lane.logged = where(r.given_up, lane.logged_start, lane.logged)

    def _set_phase(self, lane: Lane, phase: Any) -> None:
        lane.phase = phase
        lane.complete = phase == Phase.COMPLETE
        if self.stops:
            lane.touching = phase == Phase.AT_STOP
