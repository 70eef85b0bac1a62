"""Effects a scene may name. A new effect is one file here and one line below."""

from redundant_envs.effects.centring_spring import CentringSpring
from redundant_envs.effects.command_delay import CommandDelay
from redundant_envs.effects.effort_limits import EffortLimits
from redundant_envs.effects.gravity import Gravity
from redundant_envs.effects.hooks import (
    Actuation,
    Effect,
    Field,
    Force,
    Gap,
    Impact,
    Inertia,
    Instant,
    Link,
    Point,
    PointMass,
    Reading,
    Sensing,
    State,
)
from redundant_envs.effects.limit_spring import LimitSpring
from redundant_envs.effects.prismatic_stop import PrismaticStop
from redundant_envs.effects.viscous_friction import ViscousFriction

__all__ = [
    "Actuation", "CentringSpring", "CommandDelay", "Effect", "EffortLimits", "Field", "Force", "Gap",
    "Gravity", "Impact", "Inertia", "Instant", "LimitSpring", "Link", "Point", "PointMass", "PrismaticStop",
    "Reading", "Sensing", "State", "ViscousFriction",
]  # fmt: skip

REGISTRY: dict[str, type[Effect]] = {
    effect.__name__: effect
    for effect in (
        CentringSpring,
        CommandDelay,
        EffortLimits,
        Gravity,
        LimitSpring,
        PrismaticStop,
        ViscousFriction,
    )
}
"""Effects by their name in scene files."""
