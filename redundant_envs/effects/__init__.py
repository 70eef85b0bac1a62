"""Effects a scene may name. A new effect is one file here and one line below."""

from redundant_envs.effects.centring_spring import CentringSpring
from redundant_envs.effects.effort_limits import EffortLimits
from redundant_envs.effects.gravity import Gravity
from redundant_envs.effects.hooks import (
    Actuation,
    Effect,
    Field,
    Force,
    Gap,
    Impact,
    Impulse,
    Inertia,
    Link,
    Point,
    PointMass,
    Reading,
    Sensing,
    State,
)
from redundant_envs.effects.limit_spring import LimitSpring
from redundant_envs.effects.link_inertia import LinkInertia
from redundant_envs.effects.moving_base import MovingBase
from redundant_envs.effects.payload import Payload
from redundant_envs.effects.pick_up import PickUp
from redundant_envs.effects.prismatic_stop import PrismaticStop
from redundant_envs.effects.tendon import Tendon
from redundant_envs.effects.tether import Tether
from redundant_envs.effects.two_stage_spring import TwoStageSpring
from redundant_envs.effects.viscous_friction import ViscousFriction

__all__ = [
    "Actuation", "CentringSpring", "Effect", "EffortLimits", "Field", "Force", "Gap", "Gravity", "Impact",
    "Impulse", "Inertia", "LimitSpring", "Link", "LinkInertia", "MovingBase", "Payload", "PickUp", "Point",
    "PointMass", "PrismaticStop", "Reading", "Sensing", "State", "Tendon", "Tether", "TwoStageSpring",
    "ViscousFriction",
]  # fmt: skip

REGISTRY: dict[str, type[Effect]] = {
    effect.__name__: effect
    for effect in (
        CentringSpring,
        EffortLimits,
        Gravity,
        LimitSpring,
        LinkInertia,
        MovingBase,
        Payload,
        PickUp,
        PrismaticStop,
        Tendon,
        Tether,
        TwoStageSpring,
        ViscousFriction,
    )
}
"""Effects by their name in scene files."""
