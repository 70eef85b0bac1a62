"""An arm with inertias that effects add: of motors' rotors, or of links about their point masses.

An inertia belongs to the rate of a joint, or to the sum of the rates of some: that of all revolute joints up
to a link is the link's absolute rate. Such a sum is b . qd with the same b in every pose, so the inertia I
adds I b b^T to the mass matrix, I (b . qd)^2 / 2 to the kinetic energy, and nothing to h and G. The arm's own
elimination does not hold then: accelerations follow from the mass matrix, by L D L^T.
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Mapping
from typing import Any

from redundant_envs.language.algebra import arguments_of, entries, gives_of, physics
from redundant_envs.robots import derived
from redundant_envs.robots.arm import Arm

Function = Callable[..., Any]
Added = tuple[tuple[tuple[int, ...], str], ...]
"""Joints whose rates are summed, and the name of the inertia, kg m^2 or kg."""
BARE = "bare_{}"
"""Names of quantities of the point masses alone; an arm's own functions take these."""
LARGEST_RATIO = 1e6
"""Largest ratio of an inertia to the lightest mass on the shortest link: L D L^T loses its digits."""


@functools.lru_cache(maxsize=64)
def functions_with(arm: type[Arm], added: Added) -> tuple[Function, ...]:
    """The functions of an arm with inertias: those of the mass matrix and its consequences are replaced."""
    n = len(arm.coordinates)
    remaining = [f for f in arm.functions if "qdd1" not in gives_of(f)]
    result_names = {name for f in remaining if not derived.is_derived(f) for name in gives_of(f)}
    bare = {*entries("M", n, n), *({"T", "Lz"} & result_names)}
    functions = [f if derived.is_derived(f) else _of_point_masses(f, bare) for f in remaining]
    functions += [_mass_matrix(arm, added), derived.forward_dynamics(n)]
    if "T" in bare:
        functions.append(_sum_over(added, "T", lambda inertia, rate: 0.5 * inertia * rate * rate))
    if "Lz" in bare:  # of what turns with the first revolute joint: motors of the others are part of the arm
        first = arm.prismatic.index(False) if False in arm.prismatic else None
        turning = tuple((group, name) for group, name in added if first in group)
        functions.append(_sum_over(turning, "Lz", lambda inertia, rate: inertia * rate))
    return tuple(functions)


@functools.lru_cache(maxsize=64)
def held_functions(arm: type[Arm]) -> tuple[Function, Function]:
    """Dynamics with sliders at rest, and mobilities of the sliders, from any mass matrix."""
    n, sliders = len(arm.coordinates), arm.sliders()
    return derived.forward_dynamics(n, sliders), derived.slider_mobility(n, sliders)


class WithAddedInertia:
    """Base of arms with inertias of effects, which cannot be the arm of a scene."""


def with_inertias(arm: Arm, added: Added, values: Mapping[str, float]) -> Arm:
    """An arm that includes inertias, whose values are given by name."""
    kind: Any = type(arm)
    return _loaded_class(kind, added, tuple(values[name] for _, name in added))(**_fields(arm))  # type: ignore[no-any-return]


def _fields(arm: Any) -> dict[str, Any]:
    return {f.name: getattr(arm, f.name) for f in dataclasses.fields(arm) if f.init}


@functools.lru_cache(maxsize=64)
def _loaded_class(kind: Any, added: Added, inertias: tuple[float, ...]) -> type[Any]:
    values = {name: value for (_, name), value in zip(added, inertias, strict=True)}

    def parameter_values(self: Any) -> dict[str, float]:
        return {**kind.parameter_values(self), **values}

    def reduced(self: Any) -> tuple[Any, ...]:
        return with_inertias, (kind(**_fields(self)), added, values)

    more = {
        "functions": functions_with(kind, added), "kind": kind.kind, "parameter_values": parameter_values,
        "__reduce__": reduced, "__module__": kind.__module__, "__doc__": kind.__doc__,
    }  # fmt: skip
    return type(kind.__name__, (kind, WithAddedInertia), more)


def _of_point_masses(function: Function, bare: set[str]) -> Function:
    """The same function with the quantities of the point masses alone, under names that say so."""
    names = gives_of(function), arguments_of(function)
    if bare.isdisjoint(itertools.chain(*names)):
        return function
    gives, takes = ([BARE.format(name) if name in bare else name for name in some] for some in names)

    @physics(gives=gives, takes=takes)
    @functools.wraps(function)
    def renamed(*values: Any) -> Any:
        return function(*values)

    vars(renamed).pop("follows", None)  # no other function returns this
    return renamed


def _mass_matrix(arm: type[Arm], added: Added) -> Function:
    n, rates = len(arm.coordinates), derived.joint_rates(arm)
    shares = [[sum(rates[k, j] for k in joints) for j in range(n)] for joints, _ in added]
    names, inertias = entries("M", n, n), [name for _, name in added]

    @physics(gives=names, takes=(*map(BARE.format, names), *inertias))
    def mass_matrix(*values: Any) -> tuple[Any, ...]:
        matrix = list(values[: n * n])
        for b, inertia in zip(shares, values[n * n :], strict=True):
            for k, (b_i, b_j) in enumerate(itertools.product(b, b)):
                if b_i * b_j != 0.0:
                    matrix[k] = matrix[k] + float(b_i * b_j) * inertia
        return tuple(matrix)

    return mass_matrix


def _sum_over(added: Added, quantity: str, term: Callable[[Any, Any], Any]) -> Function:
    """A quantity of the point masses, and a term of each inertia and the rate that it resists."""
    joints = sorted({k for group, _ in added for k in group})
    rates, names = [f"phid{k + 1}" for k in joints], [name for _, name in added]

    @physics(gives=quantity, takes=(BARE.format(quantity), *rates, *names))
    def total(of_point_masses: Any, *values: Any) -> Any:
        rate, result = dict(zip(joints, values, strict=False)), of_point_masses
        for (group, _), inertia in zip(added, values[len(joints) :], strict=True):
            result = result + term(inertia, functools.reduce(lambda a, b: a + b, (rate[k] for k in group)))
        return result

    return total
