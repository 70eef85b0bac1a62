"""Effects a scene may name. A new effect is one file here and one line below."""

from redundant_envs.effects.centring_spring import CentringSpring
from redundant_envs.effects.dropped_samples import DroppedSamples
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
    Link,
    Point,
    PointMass,
    Reading,
    Sensing,
    State,
)
from redundant_envs.effects.joint_torque import JointTorque
from redundant_envs.effects.limit_spring import LimitSpring
from redundant_envs.effects.prismatic_stop import PrismaticStop
from redundant_envs.effects.quantisation import Quantisation
from redundant_envs.effects.sensor_bias import SensorBias
from redundant_envs.effects.sensor_delay import SensorDelay
from redundant_envs.effects.sensor_noise import SensorNoise
from redundant_envs.effects.tip_force import TipForce
from redundant_envs.effects.viscous_friction import ViscousFriction

__all__ = [
    "Actuation", "CentringSpring", "DroppedSamples", "Effect", "EffortLimits", "Field", "Force", "Gap",
    "Gravity", "Impact", "Inertia", "JointTorque", "LimitSpring", "Link", "Point", "PointMass",
    "PrismaticStop", "Quantisation", "Reading", "Sensing", "SensorBias", "SensorDelay", "SensorNoise",
    "State", "TipForce", "ViscousFriction",
]  # fmt: skip

REGISTRY: dict[str, type[Effect]] = {
    effect.__name__: effect
    for effect in (
        CentringSpring, DroppedSamples, EffortLimits, Gravity, JointTorque, LimitSpring, PrismaticStop,
        Quantisation, SensorBias, SensorDelay, SensorNoise, TipForce, ViscousFriction,
    )
}  # fmt: skip
"""Effects by their name in scene files."""
