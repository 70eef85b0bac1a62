"""The dynamics of a scene: functions of its arm and its effects, connected by the names of quantities."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

from redundant_envs.algebra import ABSENT, arguments_of, gives_of, maximum, numbered
from redundant_envs.effects.hooks import (
    SIDE,
    Actuation,
    Effect,
    Field,
    Force,
    Gap,
    Impact,
    Point,
    State,
)
from redundant_envs.events.boundary import Boundary, Law, side_beyond
from redundant_envs.lane import kinks, required_steps
from redundant_envs.loaded_arm import added_inertias, carried_masses, identifier
from redundant_envs.numerics.tableaus import METHODS, Tableau
from redundant_envs.quantities import Quantities
from redundant_envs.robots.added_inertia import Added, functions_with, held_functions
from redundant_envs.scene import Scene
from redundant_envs.tracing.graph import owned


@dataclass(frozen=True)
class Dynamics:
    """The equations of motion of a scene.

    Parameters
    ----------
    scene : Scene
    track_work : bool
        Whether the work of motors and of forces without a potential is a state, too.
    located : bool
        Whether changes of a force's law are located in time under error control; otherwise the law follows
        from the position at each evaluation.
    """

    scene: Scene
    track_work: bool = False
    located: bool = True

    @property
    def arm(self) -> Any:
        return self.scene.robot

    @property
    def method(self) -> Tableau:
        return METHODS[self.scene.integrator]

    @property
    def count(self) -> int:
        """Joints of the arm."""
        return len(self.arm.coordinates)

    @cached_property
    def others(self) -> tuple[str, ...]:
        """States of first order: those of effects, and the work."""
        integrated = (n for n, s in self.effect_states.items() if s.derivative is not None)
        return (*integrated, *(("work",) if self.track_work else ()))

    @cached_property
    def effect_states(self) -> dict[str, State]:
        """States of effects, by the names of their fields."""
        return {identifier(name): state for name, state in self.scene.states().items()}

    @cached_property
    def remembered(self) -> tuple[str, ...]:
        """States of effects that are constant within an interval."""
        return tuple(n for n, s in self.effect_states.items() if s.update is not None)

    @cached_property
    def states(self) -> tuple[str, ...]:
        """Integrated states: coordinates, velocities, and others."""
        return (*self.arm.coordinates, *self.arm.rates, *self.others)

    @cached_property
    def commands(self) -> tuple[str, ...]:
        """Fields of the commanded efforts."""
        return tuple(numbered("command{}", self.count))

    @cached_property
    def hooks(self) -> list[tuple[Effect, Any]]:
        """Hooks of the scene's effects."""
        return [(e, h) for e in self.scene.effects for h in e.hooks(self.arm)]

    @cached_property
    def chains(self) -> list[list[tuple[Effect, Actuation]]]:
        """For each motor the links between its command and its effort, in order."""
        links = [(e, h) for e, h in self.hooks if isinstance(h, Actuation)]
        links.sort(key=lambda link: link[1].link)
        return [[link for link in links if link[1].joint == k] for k in range(self.count)]

    @cached_property
    def boundaries(self) -> tuple[Boundary, ...]:
        """Boundaries at which the motion has events."""
        return (
            *self._stops,
            *self._walls,
            *(self.law_of.values() if self.controlled and self.located else ()),
        )

    @cached_property
    def _stops(self) -> tuple[Boundary, ...]:
        """Stops of the sliders."""
        found = []
        for e, h in self.hooks:
            if isinstance(h, Impact):
                lower, upper, bounce = (identifier(e.key + own) for own in (h.lower, h.upper, h.restitution))
                name = self.arm.joints[h.joint]
                found.append(Boundary(name, Law.BOUNCES, lower, upper, e.key, h.joint, restitution=bounce))
        return tuple(found)

    @cached_property
    def _walls(self) -> tuple[Boundary, ...]:
        """Boundaries whose coordinates are functions of the motion."""
        found: list[Boundary] = []
        for e, h in self.hooks:
            if isinstance(h, Gap):
                gap = functools.partial(self.apply, e, h, h.function)
                restitution = identifier(e.key + h.restitution)
                name = f"gap{len(found) + 1}"
                found.append(Boundary(name, Law.BOUNCES, "", "", e.key, gap=gap, restitution=restitution))
        return tuple(found)

    @cached_property
    def law_of(self) -> dict[int, Boundary]:
        """Boundaries at which forces change their laws, by the identities of their hooks."""
        found: dict[int, Boundary] = {}
        for effect, hook in self.hooks:
            if isinstance(hook, Force) and hook.switch is not None and isinstance(hook.joint, int):
                lower, upper = (identifier(f"{effect.key}{own}") for own in hook.switch)
                name = f"switch{len(found) + 1}"
                found[id(hook)] = Boundary(name, Law.CHANGES, lower, upper, effect.key, hook.joint)
        return found

    @cached_property
    def laws(self) -> tuple[Boundary, ...]:
        """Boundaries at which a force changes its law."""
        return tuple(b for b in self.boundaries if b.law is Law.CHANGES)

    @cached_property
    def stops(self) -> tuple[Boundary, ...]:
        """Boundaries that bounce."""
        return tuple(b for b in self.boundaries if b.bounces)

    @cached_property
    def holding(self) -> tuple[Boundary, ...]:
        """Stops that can hold their sliders."""
        return tuple(b for b in self.stops if b.joint is not None)

    @cached_property
    def kinks(self) -> kinks.Watches:
        """Kinks that are watched, but not located, if an estimate decides on steps."""
        return kinks.kinks_of(self)

    # ---- parameters, and fields that follow from them alone ---------------------------------------

    @cached_property
    def carried(self) -> dict[str, list[str]]:
        """Masses of the arm that carry others -> the fields of these."""
        carried = carried_masses(self.arm, self.scene.effects)
        return {m: [identifier(name) for name in loads] for m, loads in carried.items()}

    @cached_property
    def inertias(self) -> Added:
        """Inertias that effects add to the arm, by their fields."""
        return added_inertias(self.arm, self.scene.effects)

    def field_of(self, parameter: str) -> str:
        """The field of a parameter of the scene; "m4" is the total moving mass, with all that it carries."""
        return f"own_{parameter}" if parameter in self.carried else identifier(parameter)

    @cached_property
    def parameters(self) -> dict[str, float]:
        """Numbers of the scene: field -> nominal value."""
        values = {self.field_of(k): v for k, v in self.scene.parameters().items()}
        if self.scene.tolerance is not None:
            values["tip_tolerance"] = self.scene.tolerance
        return values

    def prepare(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Quantities that follow from the parameters alone, to be computed when these are set."""
        bounds = self.arm.mobility_bounds
        functions = self.arm.prepared if bounds is None else (*self.arm.prepared, bounds)
        made: dict[str, Any] = {
            mass: reduce(operator.add, (parameters[name] for name in loads), parameters[self.field_of(mass)])
            for mass, loads in self.carried.items()
        }
        x = Quantities({**parameters, **made}, functions, {})
        made |= {name: x[name] for f in self.arm.prepared for name in gives_of(f)}
        for effect, hook in self.hooks:
            if isinstance(hook, Field) and set(self.bound(effect, hook, hook.function)) <= {
                *parameters,
                *self.carried,
            }:
                made["ax"], made["ay"] = self.apply(effect, hook, hook.function, x)
        if not self.controlled:
            return made
        rates = required_steps.rates_of_parameters(self, x)
        made |= {"least_step_rate": reduce(maximum, rates)} if rates else {}
        return made | required_steps.mobilities(self, x)

    @cached_property
    def prepared(self) -> tuple[str, ...]:
        """Names of :meth:`prepare`."""
        return tuple(self.prepare(self.parameters))

    @property
    def controlled(self) -> bool:
        """Whether error control chooses the steps."""
        return self.scene.tolerance is not None or self.scene.integrator == "dop853"

    @cached_property
    def numbers(self) -> tuple[str, ...]:
        """Everything that is constant in a step: parameters and quantities prepared from them."""
        return (*self.parameters, *self.prepared)

    # ---- effects -----------------------------------------------------------------------------------

    def bound(self, effect: Effect, hook: Any, function: Callable[..., Any]) -> list[str]:
        """Names of the quantities that a function of a hook takes."""
        own = {SIDE: self.law_of[id(hook)].side} if id(hook) in self.law_of else {}
        sources = [hook.bind.get(a, own.get(a, a)) for a in arguments_of(function)]
        return [identifier(f"{effect.key}{s}") if s.startswith(".") else s for s in sources]

    def apply(self, effect: Effect, hook: Any, function: Callable[..., Any], x: Quantities) -> Any:
        """Evaluate a function of a hook on quantities."""
        arguments = x.each(self.bound(effect, hook, function))
        with owned(effect.key):
            return function(*arguments)

    def efforts(self, x: Quantities, change: str) -> tuple[list[Any], dict[str, Any]]:
        """Efforts at the ends of the chains of all motors, and the results of their states' functions, where
        ``change`` is "derivative" or "update"."""
        efforts, changes = x.each(self.commands), dict[str, Any]()
        for k, chain in enumerate(self.chains):
            command = efforts[k]
            for effect, hook in chain:
                x[self.commands[k]] = efforts[k]
                changes |= self._changes(effect, hook, change, x)
                efforts[k] = self.apply(effect, hook, hook.function, x)
            x[self.commands[k]] = command
        return efforts, changes

    def _changes(self, effect: Effect, hook: Any, change: str, x: Quantities) -> dict[str, Any]:
        named = {identifier(f"{effect.key}.{s.name}"): (s, getattr(s, change)) for s in hook.states}
        return {n: self.apply(effect, s, f, x) for n, (s, f) in named.items() if f is not None}

    def updates(self, x: Quantities) -> dict[str, Any]:
        """New values of states that are constant within an interval, from quantities at its end."""
        _, changes = self.efforts(x, "update")
        for effect, hook in self.hooks:
            if isinstance(hook, Force):
                changes |= self._changes(effect, hook, "update", x)
        return changes

    # ---- equations of motion -----------------------------------------------------------------------

    def quantities(self, states: Sequence[Any], numbers: Any, held: bool = False) -> Quantities:
        """Quantities of the arm, from states, and numbers and efforts by name; ``held``: with the dynamics of
        sliders that may rest at their stops."""
        functions = self.functions_held if held else self.functions
        return Quantities(dict(zip(self.states, states, strict=False)), functions, self.arm.sincos, numbers)

    @property
    def functions(self) -> tuple[Callable[..., Any], ...]:
        """Equations of the arm with the inertias that effects add."""
        return functions_with(self.arm, self.inertias) if self.inertias else tuple(self.arm.functions)

    @property
    def functions_held(self) -> tuple[Callable[..., Any], ...]:
        """The same with the dynamics of sliders that may rest at their stops."""
        arm = self.arm
        held = held_functions(arm) if self.inertias else (arm.held_dynamics, arm.slider_mobility)
        return (*(f for f in self.functions if "qdd1" not in gives_of(f)), *held)

    def accelerations(self, x: Quantities) -> list[Any]:
        """Accelerations from quantities, rates of change of effects' states, and the power if the work is
        tracked; ``x`` then has the forces."""
        joints = range(self.count)
        if "ax" not in self.prepared:
            x["ax"] = x["ay"] = ABSENT
        for effect, hook in self.hooks:
            if isinstance(hook, Field) and "ax" not in self.prepared:
                del x["ax"], x["ay"]
                x["ax"], x["ay"] = self.apply(effect, hook, hook.function, x)
        effort, changes = self.efforts(x, "derivative")
        at_joints = self.scene.actuation == "joint"
        total: dict[str, Any] = {f"phid{k + 1}": effort[k] if at_joints else None for k in joints}
        working, at_points = dict(total), dict[str, Any]()
        for effect, hook in self.hooks:
            if not isinstance(hook, Force):
                continue
            if hook.switch is not None and not self.laws:
                law = self.law_of[id(hook)]
                x[law.side] = side_beyond(*x.each((required_steps.motion_of(hook)[0], law.lower, law.upper)))
            force = self._components(effect, hook, hook.function, x)
            changes |= self._changes(effect, hook, "derivative", x)
            for rate, component in force.items():
                total[rate] = _plus(total.get(rate), component)
            if isinstance(hook.joint, Point):
                self._add_at_coordinates(effect, hook, force, x, at_points)
            if hook.conservative is hook.function:
                continue
            for rate, component in force.items():
                working[rate] = _plus(working.get(rate), component)
            if hook.conservative is not None and self.track_work:
                for rate, component in self._components(effect, hook, hook.conservative, x).items():
                    working[rate] = working[rate] + (-component)
        if any(total[f"phid{k + 1}"] is not None for k in joints):
            torques = (total[f"phid{k + 1}"] for k in joints)
            x.update({f"t{k + 1}": 0.0 if t is None else t for k, t in enumerate(torques)})
            forces = x.each(f"Q{k + 1}" for k in joints)
            if not at_joints:
                x.update({f"Q{k + 1}": forces[k] + effort[k] for k in joints})
        else:
            x.update({f"Q{k + 1}": effort[k] for k in joints})
        x.update({name: x[name] + force for name, force in at_points.items()})
        results = x.each(f"qdd{k + 1}" for k in joints)
        results += [changes[name] for name in self.others if name != "work"]
        if self.track_work:
            power = [force * x[rate] for rate, force in working.items() if force is not None]
            if not at_joints:
                power += [e * x[v] for e, v in zip(effort, self.arm.rates, strict=True)]
            results.append(sum(power[1:], power[0]) if power else 0.0)
        return results

    def _components(self, effect: Effect, hook: Force, function: Any, x: Quantities) -> dict[str, Any]:
        """A force by the names of the velocities along which it acts."""
        force = self.apply(effect, hook, function, x)
        return dict(zip(hook.rates, force if isinstance(force, tuple) else (force,), strict=True))

    def _add_at_coordinates(
        self, effect: Effect, hook: Force, force: Mapping[str, Any], x: Quantities, total: dict[str, Any]
    ) -> None:
        """Add the generalized force of a force at a point, J^T f of that point."""
        assert isinstance(hook.joint, Point)
        with owned(effect.key):
            for j in range(self.count):
                for axis, component in zip("XY", force.values(), strict=True):
                    slope = x[f"{axis}{hook.joint.number + 1}{j + 1}"]
                    if not (isinstance(slope, float) and slope == 0.0):  # links beyond the point
                        name = f"Q{j + 1}"
                        total[name] = _plus(total.get(name), slope * component)


def _plus(a: Any, b: Any) -> Any:
    return b if a is None else a + b
