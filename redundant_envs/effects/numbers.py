"""Numbers of an effect, declared once, ``field(metadata=one(not_negative, "kg"))``: their check, their unit,
and how many there are. Effects import checks and types of numbers from here as well."""

import functools
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from redundant_envs.robots.parameters import between as between
from redundant_envs.robots.parameters import not_negative as not_negative
from redundant_envs.robots.parameters import number as number
from redundant_envs.robots.parameters import numbers as numbers
from redundant_envs.robots.parameters import positive as positive
from redundant_envs.robots.parameters import share as share
from redundant_envs.robots.parameters import strength as strength
from redundant_envs.robots.parameters import strengths as strengths
from redundant_envs.robots.parameters import travel as travel
from redundant_envs.support.values import Ends as Ends
from redundant_envs.support.values import Numbers as Numbers
from redundant_envs.support.values import shown

Check = Callable[[str, Any], Any]
"""From the name of a field and its value to the value as it is kept; ValueError that names the field."""
COMMAND = "unit of the command"
"""Unit of a number that an effect compares with the command of each motor: a scene says which one that is."""
COORDINATE = "coordinate"
"""Field with the name of the joint to which the single numbers of an effect belong."""
DECLARED = "redundant_envs.declared"
"""Key of a :class:`Declared` in the metadata of a field."""


@dataclass(frozen=True)
class Declared:
    """What a field of an effect holds."""

    form: Check  # brings a value into its form, such as a single number, before its check
    check: Check  # of the value, or of all values of several
    # One unit, if it is known; or two, at a revolute and a prismatic joint, or of both axes.
    units: tuple[str, ...]
    of_joints: bool = False  # whether there is one for each joint; a single number serves all of them


class Curve(NamedTuple):
    """The picture of an effect: a quantity ``of`` a joint or the tip over another one, up to ``most``.

    A "force" is drawn over the "position", the "rate" or the "command" of a joint, from minus to plus
    ``most``; over the "time", from 0 on, the "effort" of a motor, a "reading", or the "position", the "rate"
    or the "tip" of a motion.
    """

    of: str
    over: str
    most: float


@dataclass(frozen=True)
class Example:
    """Numbers of an effect with which the package shows, tests and measures it, by their fields.

    ``numbers`` fit an arm of four joints. ``zero`` is what to change in them for a magnitude of zero, with
    which a motion keeps its bits; an effect without one changes the rounding wherever it is. ``variants`` are
    what to change in them for another structure, by what that is called. ``curve`` is what its picture shows;
    without one it is drawn beside the arm.
    """

    numbers: Mapping[str, Any]
    zero: Mapping[str, Any] | None = None
    variants: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    curve: Curve | None = None


def example_of(kind: type) -> Example:
    example = vars(kind).get("example")
    return example if isinstance(example, Example) else Example({})


def fields_with(thing: Any, numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a dataclass, with other numbers: "field" or "field[k]" -> value."""
    fields: dict[str, Any] = {}
    for name, value in numbers.items():
        field, _, entry = name.partition("[")
        if entry:  # those that are no numbers, as ends without a stop, stay
            k, entries = int(entry[:-1]), fields.get(field, getattr(thing, field))
            fields[field] = (*entries[:k], value, *entries[k + 1 :])
        else:
            fields[field] = value
    return fields


def declared_in(kind: type, name: str) -> Declared | None:
    """What a field of an effect holds: as the class declares it, or one from which it is derived, which may
    have given the field another default."""
    for base in kind.__mro__:
        field = vars(base).get("__dataclass_fields__", {}).get(name)
        if field is not None and DECLARED in field.metadata:
            declared: Declared = field.metadata[DECLARED]
            return declared
    return None


two = functools.partial(numbers, count=2)
"""A number for each axis."""


def of_axes(field: str, value: Any) -> tuple[float, ...]:
    """The same, of one number for both, too."""
    single = not hasattr(value, "__len__") or getattr(value, "ndim", 1) == 0
    return two(field, (value, value) if single else value)


def _as_given(_: str, value: Any) -> Any:
    return value


Metadata = Mapping[str, Declared]


def _declared(form: Check, of_joints: bool, check: Check, *units: str) -> Metadata:
    return {DECLARED: Declared(form, check, units, of_joints)}


one = functools.partial(_declared, number, False)
"""Metadata of a single number. With two units it belongs to the joint that :data:`COORDINATE` names."""
pair = functools.partial(_declared, two, False)  # of a number for each axis, x and y
each_axis = functools.partial(_declared, of_axes, False)  # of a number for each axis, or one for both
each_joint = functools.partial(_declared, _as_given, True)
"""Of a number for each joint, or one that serves all of them."""
row = functools.partial(_declared, numbers, False)  # of numbers of which the effect says how many there are
checked = functools.partial(_declared, _as_given, False)
"""Of what its check alone describes, such as a name."""


def text(field: str, value: Any) -> str:
    """A name as part of a longer one: empty, or letters, digits and '_'."""
    if not isinstance(value, str) or not re.fullmatch(r"\w*", value):
        raise ValueError(f"{field} is {shown(value)}; give letters, digits and '_'")
    return value
