"""Effects a scene may name. A new effect is one file here and one line below."""

from redundant_envs.effects.armature import Armature
from redundant_envs.effects.centring_spring import CentringSpring
from redundant_envs.effects.command_delay import CommandDelay
from redundant_envs.effects.coulomb_friction import CoulombFriction
from redundant_envs.effects.dc_motor import DCMotor
from redundant_envs.effects.dead_zone import DeadZone
from redundant_envs.effects.disc import Disc
from redundant_envs.effects.dropped_samples import DroppedSamples
from redundant_envs.effects.effort_limits import EffortLimits
from redundant_envs.effects.gear_backlash import GearBacklash
from redundant_envs.effects.gravity import Gravity
from redundant_envs.effects.half_plane import HalfPlane
from redundant_envs.effects.hooks import (
    Actuation,
    Effect,
    Field,
    Force,
    Friction,
    Gap,
    Impact,
    Impulse,
    Inertia,
    Instant,
    Link,
    Point,
    PointMass,
    Reading,
    Sensing,
    State,
)
from redundant_envs.effects.joint_stop import JointStop
from redundant_envs.effects.joint_torque import JointTorque
from redundant_envs.effects.lag import Lag
from redundant_envs.effects.limit_spring import LimitSpring
from redundant_envs.effects.link_inertia import LinkInertia
from redundant_envs.effects.lu_gre import LuGre
from redundant_envs.effects.moving_base import MovingBase
from redundant_envs.effects.payload import Payload
from redundant_envs.effects.pick_up import PickUp
from redundant_envs.effects.play import Play
from redundant_envs.effects.prismatic_stop import PrismaticStop
from redundant_envs.effects.quadratic_friction import QuadraticFriction
from redundant_envs.effects.quantisation import Quantisation
from redundant_envs.effects.sensor_bias import SensorBias
from redundant_envs.effects.sensor_delay import SensorDelay
from redundant_envs.effects.sensor_noise import SensorNoise
from redundant_envs.effects.smooth_coulomb_friction import SmoothCoulombFriction
from redundant_envs.effects.tendon import Tendon
from redundant_envs.effects.tether import Tether
from redundant_envs.effects.tip_force import TipForce
from redundant_envs.effects.torque_speed import TorqueSpeed
from redundant_envs.effects.two_stage_spring import TwoStageSpring
from redundant_envs.effects.viscous_friction import ViscousFriction

__all__ = [
    "Actuation", "Armature", "CentringSpring", "CommandDelay", "CoulombFriction", "DCMotor", "DeadZone",
    "Disc", "DroppedSamples", "Effect", "EffortLimits", "Field", "Force", "Friction", "Gap",
    "GearBacklash", "Gravity", "HalfPlane", "Impact", "Impulse", "Inertia", "Instant", "JointStop",
    "JointTorque", "Lag", "LimitSpring", "Link", "LinkInertia", "LuGre", "MovingBase", "Payload",
    "PickUp", "Play", "Point", "PointMass", "PrismaticStop", "QuadraticFriction", "Quantisation",
    "Reading", "Sensing", "SensorBias", "SensorDelay", "SensorNoise", "SmoothCoulombFriction", "State",
    "Tendon", "Tether", "TipForce", "TorqueSpeed", "TwoStageSpring", "ViscousFriction",
]  # fmt: skip

REGISTRY: dict[str, type[Effect]] = {
    effect.__name__: effect
    for effect in (
        Armature,
        CentringSpring,
        CommandDelay,
        CoulombFriction,
        DCMotor,
        DeadZone,
        Disc,
        DroppedSamples,
        EffortLimits,
        GearBacklash,
        Gravity,
        HalfPlane,
        JointStop,
        JointTorque,
        Lag,
        LimitSpring,
        LinkInertia,
        LuGre,
        MovingBase,
        Payload,
        PickUp,
        Play,
        PrismaticStop,
        QuadraticFriction,
        Quantisation,
        SensorBias,
        SensorDelay,
        SensorNoise,
        SmoothCoulombFriction,
        Tendon,
        Tether,
        TipForce,
        TorqueSpeed,
        TwoStageSpring,
        ViscousFriction,
    )
}
"""Effects by their name in scene files."""
