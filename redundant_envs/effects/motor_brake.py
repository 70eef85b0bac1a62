import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from redundant_envs.effects.hooks import Arm, Friction, Hook, named
from redundant_envs.effects.motor_faults import MotorFault
from redundant_envs.effects.numbers import Curve, Example, between, one, positive
from redundant_envs.language.algebra import physics, where

STRONGEST_GRIP = 1e6
"""N m or N: with 1e9 the energy of a stop is missed by 2e-5 J, as the joint stops within rounding of time."""


@functools.cache
def grip_at(k: int) -> Callable[..., Any]:
    """The limit of the brake's friction in joint k, counted from 0."""

    @physics
    def limit(joint, active, grip):
        return where(joint == float(k), where(active > 0.0, grip, 0.0), 0.0)

    return limit  # type: ignore[no-any-return]


@functools.cache
def closed_at(k: int) -> Callable[..., Any]:
    """Whether the brake of joint k, counted from 0, has closed, as 1 or 0."""

    @physics
    def closed(joint, active):
        return where(joint == float(k), active, 0.0)

    return closed  # type: ignore[no-any-return]


def grip_of(field: str, value: Any) -> float:
    """A grip whose stop error control still resolves, or a ValueError that names the field."""
    return between(field, positive(field, value), 0.0, STRONGEST_GRIP, " N m or N")


@dataclass(frozen=True)
class MotorBrake(MotorFault):
    """The motor of one joint gives no effort from a time on, and its brake, dry friction, holds the joint.

    The brake stops the joint in the time that its grip takes, and from then on the rate is 0 exactly. Before
    it closes it does nothing. Whether it has closed is the state ``active``.

    Parameters
    ----------
    grip : float, default 1000
        Torque (N m) or force (N) with which the brake stops the joint, positive, at most 1e6. Once that is at
        rest, the brake holds it whatever that takes, impacts of other joints at their stops included.
    """

    grip: float = field(default=1000.0, metadata=one(grip_of, "N m or N"))
    key = named("motor_brake_")
    example = Example({"joint": 1.0, "at": 0.1}, curve=Curve("effort", "time", 0.5))

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        brakes = (Friction(k, grip_at(k), lock=closed_at(k)) for k in range(len(arm.joints)))
        return (*self.cuts(arm), *brakes)
