"""Values of users in messages, and bounds of plain data, so that any input is answered at once."""

import copy
import dataclasses
import inspect
import json
import reprlib
import warnings
from collections.abc import Collection, Mapping, Sequence
from enum import Enum
from numbers import Integral
from pathlib import PurePath
from typing import Any, TextIO, TypeVar

from numpy.typing import NDArray

Thing = TypeVar("Thing")
Numbers = Sequence[float] | NDArray[Any]  # several numbers as users give them, kept as a tuple
Ends = Sequence[float | None] | NDArray[Any]  # numbers of which some may be left out

OWN = "redundant_envs", "dataclasses"  # lines that a warning does not show: nobody wrote them for a scene
DEEPEST = 20  # largest depth of plain data: what it describes needs four; Python's own limit is not reached
MAX_VALUES = 3000  # in plain data: ten times the longest description, read in a tenth of a second
LONGEST = 120  # most characters of a value in a message

_short = reprlib.Repr()
_short.maxstring = _short.maxother = 80
_short.maxlevel = 3


def shown(value: Any) -> str:
    """A value as it is shown in a message: one line, shortened."""
    try:
        text = " ".join(_short.repr(value).split())
    except Exception:  # a representation of a user's own may fail in any way
        text = f"<{type(value).__name__}>"
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def printable(text: Any) -> str:
    """A text for a terminal: characters that would command it, turn its order or hide, such as an escape or a
    bidirectional override, become escapes of Python. Ends of lines and tabs stay."""
    text = str(text)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else ascii(c)[1:-1] for c in text)


def say(*words: Any, file: TextIO | None = None, **how: Any) -> None:
    """Print what may come from a file of somebody else: all messages of the commands pass here."""
    print(*map(printable, words), file=file, **how)


def whole_number(name: str, value: Any) -> int:
    """A whole number of at least 1, or a ValueError that names it."""
    if isinstance(value, bool) or not isinstance(value, Integral) or value < 1:
        raise ValueError(f"{name} is {shown(value)}; give a whole number of at least 1")
    return int(value)


def truth(name: str, value: Any) -> bool:
    """True or False, or a ValueError that names it."""
    if not isinstance(value, bool):
        raise ValueError(f"{name} is {shown(value)}; give True or False")
    return value


def check_between(name: str, value: int, least: int, most: int) -> None:
    """ValueError unless a whole number is from ``least`` to ``most``."""
    if not least <= value <= most:
        limit = f"least {least}" if value < least else f"most {most}"
        raise ValueError(f"{name} is {shown(value)}; give at {limit}")


def check_declared(where: str, thing: Any, base: type) -> None:
    """ValueError if numbers in the body of a class derived from ``base``, whose annotations say what is a
    ClassVar, are no fields, or no defaults."""
    free = {name for name, kind in inspect.get_annotations(base).items() if "ClassVar" in str(kind)}
    fields = {f.name for f in dataclasses.fields(thing)}
    for cls in type(thing).__mro__:
        if not issubclass(cls, base) or cls is base:
            continue
        annotated = inspect.get_annotations(cls)
        if "__dataclass_fields__" not in vars(cls):
            numbers = [n for n, kind in annotated.items() if n not in free and "ClassVar" not in str(kind)]
            if numbers:
                raise ValueError(
                    f"{where}: {cls.__name__} has {', '.join(numbers)} in its body, and is no dataclass, so "
                    "these are no numbers of it; write @dataclass(frozen=True) above 'class'"
                )
        for name in (fields - annotated.keys()) & vars(cls).keys():
            value = vars(cls)[name]
            if isinstance(value, int | float | tuple):
                raise ValueError(
                    f"{where}: {cls.__name__} has {name} = {shown(value)} without a type, so Python takes "
                    f"it for no default; write {name}: {type(value).__name__} = {shown(value)}"
                )


def plain_data(value: Any) -> Any:
    """Data of users as JSON has them: without tuples, numbers and arrays of NumPy, paths and enumerations."""
    try:
        return json.loads(json.dumps(value, default=_plainer))
    except (TypeError, ValueError):  # data that others refuse in words of their own
        return value


def _plainer(value: Any) -> Any:
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, Mapping):
        return dict(value)
    if hasattr(value, "to_dict"):  # of a scene
        return value.to_dict()
    if isinstance(value, PurePath):
        return str(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    return [*value] if isinstance(value, Collection) else float(value)  # of a Decimal, for example


def plain(kind: str, thing: Any) -> dict[str, Any]:
    """An arm or an effect as plain data, by its name in scene files."""
    values = {f.name: getattr(thing, f.name) for f in dataclasses.fields(thing) if f.init}
    return {"type": kind} | {name: [*x] if isinstance(x, tuple) else x for name, x in values.items()}


def with_fields(thing: Thing, **fields: Any) -> Thing:
    """A copy of a frozen dataclass with other fields, also those that are no arguments, unchecked."""
    clone = copy.copy(thing)
    for name, value in fields.items():
        object.__setattr__(clone, name, value)
    return clone


def replaced(thing: Any, **fields: Any) -> Any:
    """A frozen dataclass with other arguments, checked by its class. Fields that are no arguments and that
    its class leaves at None, such as the control interval of a scene, stay."""
    new = dataclasses.replace(thing, **fields)
    previous = {f.name: getattr(thing, f.name) for f in dataclasses.fields(thing) if not f.init}
    return with_fields(new, **{name: value for name, value in previous.items() if getattr(new, name) is None})


def warn(text: str) -> None:
    """A UserWarning that shows the line outside this package that led to it."""
    frame, level = inspect.currentframe(), 0
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] in OWN:
        frame, level = frame.f_back, level + 1
    warnings.warn(printable(text), stacklevel=level + 1)


def check_registered(where: str, kind: str, thing: Any, registry: Mapping[str, type[Any]]) -> None:
    """ValueError if the class of an object has the name of another class, which plain data would create."""
    cls = getattr(thing, "maker", type(thing))
    there = registry.get(kind, cls)
    if there is not cls:
        mine, other = (f"{c.__module__}.{c.__qualname__}" for c in (cls, there))
        raise ValueError(
            f"{where} is a {mine}, and {kind!r} in plain data is {other}; give the class a name of its own "
            "and register it"
        )


def check_keys(where: str, data: Mapping[str, Any], valid: list[str]) -> None:
    """Refuse keys that are not valid, naming the valid ones."""
    for key in data:
        if key not in valid:
            raise ValueError(f"{where} has the unknown key {shown(key)}; valid: {', '.join(valid)}")


def typed(where: str, data: Any, registry: Mapping[str, type[Any]]) -> Any:
    """Build the class that ``data["type"]`` names in a registry."""
    if not isinstance(data, Mapping) or "type" not in data:
        raise ValueError(f"{where} is {shown(data)}; give a mapping with a 'type'")
    kind = data["type"]
    if not isinstance(kind, str) or kind not in registry:
        raise ValueError(
            f"{where}.type is {shown(kind)}; valid: {', '.join(sorted(registry))}, and what a module of "
            "yours registers: import it first (command lines: --import MODULE before the command)"
        )
    target = registry[kind]
    arguments = {k: tuple(v) if isinstance(v, list) else v for k, v in data.items() if k != "type"}
    check_keys(where, arguments, [f.name for f in dataclasses.fields(target) if f.init])
    for name in required(target):
        if name not in arguments:
            raise ValueError(f"{where} ({kind}) lacks {name!r}")
    return target(**arguments)


def required(kind: type[Any]) -> list[str]:
    """The fields of a dataclass without a default."""
    missing = dataclasses.MISSING
    return [f.name for f in dataclasses.fields(kind) if f.default is f.default_factory is missing and f.init]
