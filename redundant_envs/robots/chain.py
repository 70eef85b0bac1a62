"""Any planar chain of revolute joints and sliders, made from a word such as "RPR"."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from redundant_envs.robots.arm import Arm
from redundant_envs.robots.joint_types import check_joint_types


@dataclass(frozen=True, init=False, repr=False)
class Chain(Arm):
    """A planar arm of revolute (R) and prismatic (P) joints, with a point mass after every joint.

    ``Chain("RPRP", ...)`` is the arm of ``RPRP``, and ``Chain("RRRR", ...)`` that of ``FourR``, to rounding:
    those have equations of their own, which are faster. All equations of a chain follow from the positions
    of its mass points (:mod:`redundant_envs.robots.from_points`).

    Angles are absolute, from +x. A revolute joint begins a new direction, with a link whose length is the
    next one of ``lengths``; a slider moves along the direction of the joint before it, or along +x if no
    revolute joint is before it, and its coordinate is the distance. The next mass is at the end of each.

    Parameters
    ----------
    joint_types : str
        1 to 10 letters, from base to tip.
    masses : sequence of floats
        One for each joint, kg, positive.
    lengths : sequence of floats
        One for each revolute joint, m, positive.

    Examples
    --------
    >>> arm = Chain("RPR", masses=(1.0, 0.5, 0.5), lengths=(0.4, 0.3))
    >>> arm.coordinates
    ('theta1', 'r1', 'theta2')
    """

    kind = "Chain"
    joint_types: str  # type: ignore[misc] # of a class, in other arms
    maker: ClassVar[type[Arm]]

    def __new__(cls, joint_types: Any = None, *args: Any, **kwargs: Any) -> Chain:
        chain_class = _class_of(check_joint_types("joint_types", joint_types)) if cls is Chain else cls
        return object.__new__(chain_class)

    def __init__(self, joint_types: str, masses: Any, lengths: Any = ()) -> None:
        kind: Any = type(self)
        if not hasattr(kind, "coordinates"):
            raise ValueError(
                f"{kind.__name__} is derived from Chain; derive it from redundant_envs.Arm, with "
                "joint_types = 'RPR' or the like"
            )
        if joint_types != kind.joint_types:
            raise ValueError(
                f"joint_types is {joint_types!r}; this arm is one of {kind.joint_types!r}: make another Chain"
            )
        for name, value in (("masses", masses), ("lengths", lengths), ("joint_types", joint_types)):
            object.__setattr__(self, name, value)
        self.__post_init__()

    def __repr__(self) -> str:
        return f"Chain({self.joint_types!r}, masses={self.masses!r}, lengths={self.lengths!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        return Chain, (self.joint_types, self.masses, self.lengths)


def _class_of(types: str) -> type[Chain]:
    """The class of all chains of such joints; there are at most 2046."""
    if types in _classes:
        return _classes[types]
    ns = {"joint_types": types, "kind": Chain.kind, "__module__": Chain.__module__, "__doc__": Chain.__doc__}
    ns["description"] = f"A planar arm of the joints {types} in a vertical plane"
    return _classes.setdefault(types, type(Chain.__name__, (Chain,), ns))


_classes: dict[str, type[Chain]] = {}


Chain.maker = Chain
