"""States of effects in closed form: fixed steps evaluate them, and integrate everything else.

Stages of a Runge-Kutta step may not be longer than a few time constants of a state. Where a state decays
faster, its closed form is evaluated at each stage: from its value at the start of the step, the time since
then, and quantities of the stage, which the form takes as constant. A quantity that is not constant is given
its value at some time between the start and the stage; :func:`share` says at which.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from redundant_envs.effects.bound_hooks import TIME, Attached
from redundant_envs.effects.hooks import Force
from redundant_envs.effects.validate_hooks import roots_of
from redundant_envs.language.algebra import expm1, where
from redundant_envs.language.quantities import Quantities

FEW_DECAYS = 1e-3
"""Time in time constants below which :func:`share` is a series: rounding would be 1e-13 of it, and the next
term of the series is 1e-12."""


def share(decays: Any) -> Any:
    """Share of a time in which a quantity is taken, if a state that decays towards it is to end where it
    would if the quantity changed evenly: 1/2 for a short time, 1 for one of many time constants.

    With e = exp(-t / T) the solution of z' = (a + b t - z) / T is a + b t - b T + (z(0) - a + b T) e. That of
    z' = (a + w b t - z) / T, constant but for z, is the same at t if w = 1 / (1 - e) - T / t. ``decays`` is
    t / T.
    """
    gone = -expm1(-decays)
    many = decays > FEW_DECAYS
    exact = (decays - gone) / where(many, decays * gone, 1.0)
    return where(many, exact, 0.5 + 0.08333333333333333 * decays)


Closing = Callable[[Attached[Any], Quantities], None]
"""What is done with the states of a hook in closed form, where its inputs are known in quantities."""


def noting(varying: Mapping[str, Sequence[str]], start: dict[str, Any]) -> Closing:
    """Note the quantities that closed forms take at the start of a step."""

    def note(a: Attached[Any], x: Quantities) -> None:
        for field in a.states:
            start.update({noted(field, name): x[name] for name in varying.get(field, ())})

    return note


def closing(start: Mapping[str, Any], elapsed: Any, varying: Mapping[str, Sequence[str]]) -> Closing:
    """Give quantities the values of states at a time in a step; ``start`` has the states at the start of the
    step, and what :func:`noting` has found there."""

    def close(a: Attached[Any], x: Quantities) -> None:
        for field, functions in a.states.items():
            if "closed" not in functions:
                continue
            values = {field: start[field], TIME: elapsed}
            if field in varying:
                early = share(functions["rate"](x) * elapsed)
                for name in varying[field]:
                    before = start[noted(field, name)]
                    values[name] = before + early * (x[name] - before)
            names = functions["closed"].names
            x[field] = functions["closed"].on(values[name] if name in values else x[name] for name in names)

    return close


def noted(field: str, name: str) -> str:
    """Name of a quantity as it is at the start of a step, for the closed form of a state."""
    return f"{name} at start, for {field}"


def varying_arguments(attached: Any, arm: Any, constant: frozenset[str]) -> dict[str, tuple[str, ...]]:
    """For each state with a closed form and a rate the quantities that this form takes, and that change
    within a step; ``constant`` has the names of some that do not."""
    arguments: dict[str, tuple[str, ...]] = {}

    def changes(name: str, known: frozenset[str]) -> bool:
        if name in known:
            return False
        if name in attached.states or name.startswith("side_"):
            return True
        return not roots_of(name, arm).isdisjoint((*arm.coordinates, *arm.rates))

    def examine(a: Attached[Any], known: frozenset[str]) -> None:
        for field, functions in a.states.items():
            if "closed" in functions and "rate" in functions:
                names = [n for n in functions["closed"].names if n not in (field, TIME)]
                varying = tuple(dict.fromkeys(n for n in names if changes(n, known)))
                if varying:
                    arguments[field] = varying

    for a in attached.of(Force):
        examine(a, constant)
    for command, chain in attached.links():
        known = constant
        for link in chain:
            examine(link, known)
            if any(changes(name, known) for name in link.functions["function"].names):
                known = known - {command}
    return arguments
