"""The numbers of a scene as fields of its lanes, and what follows from them alone."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

from redundant_envs.effects.bound_hooks import field_of
from redundant_envs.effects.hooks import CONTROL_DT
from redundant_envs.language.algebra import gives_of, maximum, total
from redundant_envs.language.quantities import Quantities
from redundant_envs.scenes.scene import Scene
from redundant_envs.simulator.lane import required_steps

NO_QUANTITIES = re.compile("tip_tolerance|least_step_rate|most_mobility|instant_")
"""Numbers of error control and of pieces, which no function takes."""


@dataclass(frozen=True)
class Parameters:
    """The numbers of a scene, and the quantities that follow from them alone."""

    scene: Scene

    def field_of(self, parameter: str) -> str:
        """The field of a parameter of the scene; "m4" is the total moving mass, with all that it carries."""
        return f"own_{parameter}" if parameter in self.scene.attached.carried else parameter

    @cached_property
    def values(self) -> dict[str, float]:
        """Numbers of the scene: field -> nominal value."""
        values = {self.field_of(k): v for k, v in self.scene.parameters().items()}
        if self.scene.tolerance is not None:
            values["tip_tolerance"] = self.scene.tolerance
        if self.scene.attached.take(CONTROL_DT):
            values[CONTROL_DT] = self.scene.control_dt
        return values

    def prepare(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Quantities that follow from the parameters alone, to be computed when these are set."""
        arm = self.scene.robot
        bounds = arm.mobility_bounds
        functions = arm.prepared if bounds is None else (*arm.prepared, bounds)
        changing = self.scene.attached.changing
        # Without the masses that may come: with these no joint is more mobile.
        made: dict[str, Any] = {
            mass: total(parameters[n] for n in (self.field_of(mass), *loads) if n in parameters)
            for mass, loads in self.scene.attached.carried.items()
        }
        x = Quantities({**parameters, **made}, functions, {})
        made = {mass: value for mass, value in made.items() if mass not in changing}
        if not changing:
            made |= {name: x[name] for f in arm.prepared for name in gives_of(f)}
        fields, known = self.scene.attached.constant_fields, {*parameters, *made}
        if fields and all({*a.functions["function"].names} <= known for a in fields):
            made |= zip(self.steady_field, field_of(fields, x), strict=True)
        made |= {a.instant: a.functions["after"](x) for a in self.scene.attached.instants}
        if not self.scene.controlled:
            return made
        rates = required_steps.rates_of_parameters(self.scene, x)
        made |= {"least_step_rate": reduce(maximum, rates)} if rates else {}
        dampers = required_steps.dampers(self.scene)
        return made | {field: required_steps.most_mobility(self.scene, a, x) for field, a in dampers}

    @property
    def steady_field(self) -> tuple[str, str]:
        """Fields of the lane with the uniform field that follows from parameters alone."""
        return ("steady_ax", "steady_ay") if self.scene.attached.moving_fields else ("ax", "ay")

    @cached_property
    def prepared(self) -> tuple[str, ...]:
        """Names of :meth:`prepare`."""
        return tuple(self.prepare(self.values))

    @cached_property
    def numbers(self) -> tuple[str, ...]:
        """Quantities that are constant in a step: parameters, what is prepared from them, and masses that
        change between intervals; without :data:`NO_QUANTITIES`."""
        masses = itertools.chain.from_iterable(self.scene.attached.changing.values())
        found = (*self.values, *self.prepared, *masses)
        return tuple(n for n in found if not NO_QUANTITIES.match(n))
