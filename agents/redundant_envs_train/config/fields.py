"""Numbers of a configuration: allowed values, unit and help; one form of message for every mistake."""

import sys
from collections.abc import Mapping
from typing import Annotated, Any, get_args

from redundant_envs.support.extras import needs
from redundant_envs.support.values import shown

with needs("train"):
    from pydantic import BaseModel, BeforeValidator, ConfigDict, StrictStr, TypeAdapter, ValidationError
    from pydantic.fields import Field, FieldInfo
    from pydantic_core import PydanticCustomError


def _number(value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= sys.float_info.max:
        raise PydanticCustomError("kind", "give a finite number")
    return value


Whole = Annotated[int, BeforeValidator(_number)]
Real = Annotated[float, BeforeValidator(_number)]
Text = StrictStr
Flag = Annotated[bool, Field(strict=True)]


def number(default: Any, low: float, high: float, help: str, unit: str = "") -> Any:
    """A number of a model: its default, least and largest value (both allowed), help and unit."""
    more = {"unit": unit} if unit else {}
    return Field(default, ge=low, le=high, description=help, json_schema_extra=more)  # type: ignore[arg-type]


def value(default: Any, help: str) -> Any:
    return Field(default, description=help)


class Model(BaseModel):
    """Base of models: frozen, and refusing unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


def checked(kind: type[Any], data: Any, where: str = "") -> Any:
    """A model from plain data; the ValueError names the first wrong field, its value and what is allowed."""
    if not isinstance(data, Mapping):
        raise ValueError(f"{where.rstrip('.') or 'the configuration'} is {shown(data)}; give a mapping")
    try:
        return TypeAdapter(kind).validate_python(dict(data))
    except ValidationError as error:
        raise ValueError(explain(kind, error, where)) from None


def explain(kind: type[Any], error: ValidationError, where: str = "") -> str:
    """The first mistake of a validation as one sentence."""
    # A key that is unknown is often the reason why another one is missing.
    mistake = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
    place, about = tuple(mistake["loc"]), mistake.get("ctx", {})
    name, got = where + dotted(place), shown(mistake["input"])
    owner = model_at(kind, place[:-1])
    field = owner.model_fields.get(next((str(p) for p in reversed(place) if isinstance(p, str)), ""))
    match mistake["type"]:
        case "extra_forbidden" | "invalid_key":
            prefix = where + dotted(place[:-1]) + ("." if place[:-1] else "")
            return f"{name[:80]} is unknown; valid: {', '.join(prefix + f for f in owner.model_fields)}"
        case "missing":
            more = f"; give the {field.description}" if field and field.description else ""
            return f"{name} is missing{more}"
        case "value_error":  # a message written by the model itself, which names its fields
            message = str(about["error"])
            return message if not name or message.startswith(name) else f"{name}: {message}"
        case "literal_error":
            return f"{name} is {got}; choose {about['expected']}"
        case "model_type" | "dict_type":
            return f"{name} is {got}; give a mapping"
        case "bool_type":
            return f"{name} is {got}; give true or false"
        case "string_type":
            return f"{name} is {got}; give a text"
        case "tuple_type":
            default = field.default if field else None
            example = ", ".join(map(str, default)) if isinstance(default, tuple) else ""
            return f"{name} is {got}; give a list" + (f", such as [{example}]" if example else "")
        case "too_long" | "too_short":
            limit = f"most {about['max_length']}" if "max_length" in about else f"least {about['min_length']}"
            return f"{name} has {about['actual_length']} entries; give at {limit}"
        case "greater_than_equal" | "less_than_equal" | "kind" | "int_from_float" | "int_parsing_size":
            low, high = limits(field) if field else (None, None)
            if low is not None and high is not None:
                whole = "whole " if "int" in str(field.annotation) else ""
                return f"{name} is {got}; give a {whole}number from {short(low)} to {short(high)}"
    return f"{name} is {got}; {mistake['msg']}"


def dotted(place: tuple[int | str, ...]) -> str:
    """Name of an entry of nested data, as users write it: ``sac.net_arch[1]``."""
    text = ""
    for part in place:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)[:80]
    return text


def model_at(kind: type[Any], place: tuple[int | str, ...]) -> type[Any]:
    """The model that contains an entry of another model."""
    for part in place:
        field = kind.model_fields.get(str(part))
        inner = (field.annotation, *get_args(field.annotation)) if field else ()
        kind = next((c for c in inner if hasattr(c, "model_fields")), kind)
    return kind


def short(bound: float) -> str:
    """A bound as text: six digits, or all digits if six would change it."""
    return f"{bound:g}" if float(f"{bound:g}") == bound else repr(bound)


def limits(field: FieldInfo) -> tuple[float | None, float | None]:
    """Least and largest value of a number, or of the numbers in a list."""
    inside = [bound for inner in get_args(field.annotation) for bound in getattr(inner, "__metadata__", ())]
    low = high = None
    for part in (*field.metadata, *inside):
        for bound in getattr(part, "metadata", (part,)):
            low, high = getattr(bound, "ge", low), getattr(bound, "le", high)
    return low, high
