"""How far the links of an arm are from the obstacles of a scene, as quantities by name."""

from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from typing import Any

from redundant_envs.effects.bound_hooks import Attached, Attachments
from redundant_envs.effects.hooks import ENDS_OF_LINK, MEASURE, Obstacle
from redundant_envs.language.algebra import gives_of, minimum, numbered, physics
from redundant_envs.robots.arm import Arm


def clearance_functions(attached: Attachments, arm: Arm) -> tuple[Callable[..., Any], ...]:
    """They give ``clearance<k>_<j>`` [m] of obstacle k and link j, and ``clearance<k>`` of the nearest."""
    functions = []
    for k, obstacle in enumerate(attached.of(Obstacle), start=1):
        names = [f"clearance{k}_{j + 1}" for j in range(arm.num_masses)]
        functions += [_of_link(obstacle, name, j) for j, name in enumerate(names)]
        functions.append(least_of(names, f"clearance{k}"))
    return tuple(functions)


def closest_names(attached: Attachments) -> tuple[str, ...]:
    """Names of the least clearances from the obstacles within an interval."""
    return tuple(numbered("closest{}", len(attached.of(Obstacle))))


def near_names(attached: Attachments) -> tuple[str, ...]:
    """Names of the least clearances within the last step of an interval."""
    return tuple(numbered("near{}", len(attached.of(Obstacle))))


def distance_names(attached: Attachments, arm: Arm) -> list[str]:
    """Names of all distances from the obstacles."""
    clearances = (name for f in clearance_functions(attached, arm) for name in gives_of(f))
    return [*clearances, *closest_names(attached), *near_names(attached)]


def _of_link(obstacle: Attached[Obstacle], name: str, link: int) -> Callable[..., Any]:
    """The gap of a link; the first one begins at the base."""
    ends = [f"{axis}{n}" for n in (link, link + 1) if n for axis in "xy"]
    numbers = numbers_of(obstacle)

    @physics(gives=name, takes=(*ends, *numbers))
    def clearance(*values: Any) -> Any:
        places = values[: len(ends)] if link else (0.0, 0.0, *values[: len(ends)])
        return gap_of_link(obstacle, places, dict(zip(numbers, values[len(ends) :], strict=True)))

    return clearance


def least_of(names: Sequence[str], name: str) -> Callable[..., Any]:
    """A function that gives the least of some quantities under a name."""

    @physics(gives=name, takes=names)
    def least(*values: Any) -> Any:
        return reduce(minimum, values)

    return least


def numbers_of(obstacle: Attached[Obstacle]) -> tuple[str, ...]:
    """Names of the numbers that the gap of a link depends on, beside its ends."""
    taken = dict.fromkeys(name for f in obstacle.functions.values() for name in f.names)
    return tuple(name for name in taken if name not in (*ENDS_OF_LINK, MEASURE))


def measure_of_link(obstacle: Attached[Obstacle], places: Sequence[Any], numbers: Mapping[str, Any]) -> Any:
    """The measure of a link whose ends are at these places (xa, ya, xb, yb), or else its gap [m]."""
    measure = obstacle.functions.get("measure", obstacle.functions["gap"])
    known = {**numbers, **dict(zip(ENDS_OF_LINK, places, strict=True))}
    return measure.on(known[name] for name in measure.names)


def gap_at(obstacle: Attached[Obstacle], measure: Any, numbers: Mapping[str, Any]) -> Any:
    """The gap of which this is the measure, or else the gap itself, m."""
    if "measure" not in obstacle.functions:
        return measure
    gap = obstacle.functions["gap"]
    return gap.on(measure if name == MEASURE else numbers[name] for name in gap.names)


def gap_of_link(obstacle: Attached[Obstacle], places: Sequence[Any], numbers: Mapping[str, Any]) -> Any:
    """The gap of a link whose ends are at these places, m."""
    return gap_at(obstacle, measure_of_link(obstacle, places, numbers), numbers)
