"""How an effect attaches to an arm: a closed list of hooks, bound by the names of quantities.

An effect is a frozen dataclass whose numbers are per-environment parameters, plus marked functions
of the physics dialect. ``hooks(arm)`` says where they attach. In ``bind`` an argument of the
function is mapped to the name of a quantity, or to one of the effect's own numbers as ".field" or
".field[k]"; an argument that is not mapped takes the quantity of its own name.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from redundant_envs.robots.parameters import Arm


@dataclass(frozen=True)
class Field:
    """A uniform field: the function returns (ax, ay), minus the gravity vector [m/s^2]."""

    function: Callable[..., Any]
    bind: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Force:
    """A force on one joint: N m on a revolute joint, N on a prismatic one.

    ``conservative`` is the part of it that is minus the derivative of ``potential`` [J] with respect
    to the position of the joint: it is booked in the potential energy, the power of the rest as work.
    With a potential and nothing else said it is the whole force, which then may depend on the position
    alone. A force without a potential is all booked as work. ``python -m redundant_envs verify``
    differentiates the potential and compares.

    ``stiffness`` [N/m or N m/rad] and ``damping`` [N s/m or N m s/rad] give the largest that the
    force can have, from the parameters alone: error control takes steps short enough for a spring
    before an estimate could have seen it.
    """

    joint: int
    function: Callable[..., Any]
    bind: Mapping[str, str] = field(default_factory=dict)
    potential: Callable[..., Any] | None = None
    conservative: Callable[..., Any] | None = None
    stiffness: Callable[..., Any] | None = None
    damping: Callable[..., Any] | None = None

    def __post_init__(self) -> None:
        if self.potential is not None and self.conservative is None:
            object.__setattr__(self, "conservative", self.function)


@dataclass(frozen=True)
class Actuation:
    """What becomes of the commanded effort of one joint: the function maps it to the real one."""

    joint: int
    function: Callable[..., Any]
    bind: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Impact:
    """Hard ends of the travel of a prismatic joint; their numbers are own fields (".lower[0]")."""

    joint: int
    lower: str
    upper: str
    restitution: str


Hook = Field | Force | Actuation | Impact


@dataclass(frozen=True)
class Effect:
    """Base of all effects.

    A subclass validates its numbers in ``__post_init__`` and gives ``hooks``. Its class name is
    its name in scene files; ``key`` is its name in parameters ("limit_spring.r1").
    """

    static: ClassVar[tuple[str, ...]] = ()
    """Fields that choose the structure; all others are per-environment numbers."""

    @property
    def key(self) -> str:
        """Name of this effect in parameter names."""
        return snake_case(type(self).__name__)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        """Where the effect attaches to an arm; ValueError if it does not fit."""
        raise NotImplementedError(f"{type(self).__name__} does not say where it attaches")

    def travel(self, arm: Arm) -> dict[int, tuple[str, str]]:
        """Joints this effect limits: joint -> own fields of the lower and the upper limit."""
        return {}

    def parameters(self) -> dict[str, float]:
        """The effect's numbers: "field" or "field[k]" -> value."""
        values: dict[str, float] = {}
        for f in dataclasses.fields(self):
            if f.name in self.static:
                continue
            value = getattr(self, f.name)
            if isinstance(value, tuple):
                values.update({f"{f.name}[{k}]": v for k, v in enumerate(value)})
            else:
                values[f.name] = value
        return values


def snake_case(name: str) -> str:
    """LimitSpring -> limit_spring."""
    return "".join("_" + c.lower() if c.isupper() else c for c in name).lstrip("_")
