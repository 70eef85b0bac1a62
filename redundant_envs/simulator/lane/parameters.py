"""The numbers of a scene as fields of its lanes, and what follows from them alone."""

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

from redundant_envs.effects.bound_hooks import Attached, field_of
from redundant_envs.effects.hooks import CONTROL_DT, Force, Point
from redundant_envs.language.algebra import gives_of, maximum, sqrt, total
from redundant_envs.language.quantities import Quantities
from redundant_envs.scenes.scene import Scene

NO_QUANTITIES = re.compile("tip_tolerance|least_step_rate|most_mobility|instant_")
"""Numbers of error control and of pieces, which no function takes."""


@dataclass(frozen=True)
class SceneParameters:
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
        functions = arm.prepared if arm.mobility_bounds is None else (*arm.prepared, arm.mobility_bounds)
        changing = self.scene.attached.changing
        # Without the masses that may come: with these no joint is more mobile.
        prepared: dict[str, Any] = {
            mass: total(parameters[n] for n in (self.field_of(mass), *loads) if n in parameters)
            for mass, loads in self.scene.attached.carried.items()
        }
        x = Quantities({**parameters, **prepared}, functions, {})
        prepared = {mass: value for mass, value in prepared.items() if mass not in changing}
        if not changing:
            prepared |= {name: x[name] for f in arm.prepared for name in gives_of(f)}
        fields, known = self.scene.attached.constant_fields, {*parameters, *prepared}
        if fields and all({*a.functions["function"].names} <= known for a in fields):
            prepared |= zip(self.steady_field, field_of(fields, x), strict=True)
        prepared |= {a.instant: a.functions["after"](x) for a in self.scene.attached.instants}
        if not self.scene.controlled:
            return prepared
        rates = rates_of_parameters(self.scene, x)
        prepared |= {"least_step_rate": reduce(maximum, rates)} if rates else {}
        return prepared | {field: most_mobility(self.scene, a, x) for field, a in dampers(self.scene)}

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
        return tuple(n for n in (*self.values, *self.prepared, *masses) if not NO_QUANTITIES.match(n))


# ---- steps that springs, dampers and states require, independent of error estimates --------------------


def steps_of_damper(damping: Any, mobility: Any) -> Any:
    """Steps per second that resolve a decay: two of its time constants in each."""
    return 0.5 * damping * mobility


def steps_towards_damper(here: Any, there: Any, mobility: Any, interval: Any) -> Any:
    """Steps per second that resolve a decay whose damping changes from its value ``here`` to its value
    ``there``, the position that the joint reaches in the interval at the present rate: one of the time
    constants at the end of a step."""
    here, there = 2.0 * steps_of_damper(here, mobility), 2.0 * steps_of_damper(there, mobility)
    return maximum(here, sqrt(maximum(here, 1.0 / interval) * there))


def rates_of_parameters(scene: Scene, x: Quantities) -> list[Any]:
    """Steps per second that follow from the parameters alone."""
    rates = []
    for a in scene.attached:
        # A state, too, has two of its time constants in each step, and an oscillation 2 rad of its phase.
        rates += [0.5 * functions["rate"](x) for functions in a.states.values() if "rate" in functions]
        of_force = a.functions if isinstance(a.hook, Force) else {}
        if "stiffness" in of_force:
            rates.append(0.5 * sqrt(of_force["stiffness"](x) * most_mobility(scene, a, x)))
        if "damping" in of_force and not depends_on_motion(a):
            rates.append(steps_of_damper(of_force["damping"](x), most_mobility(scene, a, x)))
    return rates


def depends_on_motion(a: Attached[Any]) -> bool:
    """Whether the damping of a force depends on the position or the rate of its joint."""
    if "damping" not in a.functions or isinstance(a.hook.joint, Point):
        return False
    return not {*a.hook.motion}.isdisjoint(a.functions["damping"].names)


def dampers(scene: Scene) -> list[tuple[str, Attached[Force]]]:
    """Forces whose damping depends on their joint's motion, under a tolerance, with the fields of the largest
    mobilities of their joints. Estimates of dop853, held near rounding, see such dampers."""
    forces = [a for a in scene.attached.of(Force) if scene.tolerance is not None and depends_on_motion(a)]
    return [(f"most_mobility{a.hook.joint + 1}", a) for a in forces if isinstance(a.hook.joint, int)]


def rates_of_motion(scene: Scene, lane: Any, x: Quantities, numbers: Any, interval: Any) -> list[Any]:
    """Steps per second that dampers require now which depend on positions and rates ``x``."""
    rates = []
    for field, a in dampers(scene):
        position, rate = a.hook.motion
        known = {position: x[position] + interval * x[rate], rate: x[rate]}
        ahead = Quantities(known, tuple(scene.robot.functions), scene.robot.sincos, numbers)
        here, there = (a.functions["damping"](quantities) for quantities in (x, ahead))
        rates.append(steps_towards_damper(here, there, lane[field], interval))
    return rates


def most_mobility(scene: Scene, a: Attached[Any], x: Quantities) -> Any:
    """Largest acceleration by a unit force at its own joint or point, in any pose."""
    if isinstance(a.hook.joint, Point):  # no more than if the point mass were free
        return 1.0 / x[f"m{a.hook.joint.number + 1}"]
    if scene.robot.mobility_bounds is None:
        raise ValueError(
            f"{scene.robot.kind} has no mobility_bounds, from which error control knows what "
            f"{type(a.effect).__name__} asks of its steps; give the arm these bounds, or the scene an "
            "integrator and substeps"
        )
    return x[f"W{a.hook.joint + 1}"]
