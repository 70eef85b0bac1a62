"""Effects a scene may name: the modules of this folder define them. A new effect is one file here.

The first lines are for type checkers and editors, which know no names that are found as the program runs.
"""

from redundant_envs.effects.armature import Armature as Armature
from redundant_envs.effects.centring_spring import CentringSpring as CentringSpring
from redundant_envs.effects.command_delay import CommandDelay as CommandDelay
from redundant_envs.effects.coulomb_friction import CoulombFriction as CoulombFriction
from redundant_envs.effects.dc_motor import DCMotor as DCMotor
from redundant_envs.effects.dead_zone import DeadZone as DeadZone
from redundant_envs.effects.disc import Disc as Disc
from redundant_envs.effects.dropped_samples import DroppedSamples as DroppedSamples
from redundant_envs.effects.effort_limits import EffortLimits as EffortLimits
from redundant_envs.effects.gear_backlash import GearBacklash as GearBacklash
from redundant_envs.effects.gravity import Gravity as Gravity
from redundant_envs.effects.half_plane import HalfPlane as HalfPlane
from redundant_envs.effects.inner_control import InnerControl as InnerControl
from redundant_envs.effects.joint_position import JointPosition as JointPosition
from redundant_envs.effects.joint_stop import JointStop as JointStop
from redundant_envs.effects.joint_torque import JointTorque as JointTorque
from redundant_envs.effects.joint_velocity import JointVelocity as JointVelocity
from redundant_envs.effects.keep_out import KeepOut as KeepOut
from redundant_envs.effects.lag import Lag as Lag
from redundant_envs.effects.limit_spring import LimitSpring as LimitSpring
from redundant_envs.effects.link_inertia import LinkInertia as LinkInertia
from redundant_envs.effects.lu_gre import LuGre as LuGre
from redundant_envs.effects.motor_brake import MotorBrake as MotorBrake
from redundant_envs.effects.motor_loss import MotorLoss as MotorLoss
from redundant_envs.effects.moving_base import MovingBase as MovingBase
from redundant_envs.effects.payload import Payload as Payload
from redundant_envs.effects.pick_up import PickUp as PickUp
from redundant_envs.effects.play import Play as Play
from redundant_envs.effects.prismatic_stop import PrismaticStop as PrismaticStop
from redundant_envs.effects.quadratic_friction import QuadraticFriction as QuadraticFriction
from redundant_envs.effects.quantisation import Quantisation as Quantisation
from redundant_envs.effects.sensor_bias import SensorBias as SensorBias
from redundant_envs.effects.sensor_delay import SensorDelay as SensorDelay
from redundant_envs.effects.sensor_noise import SensorNoise as SensorNoise
from redundant_envs.effects.smooth_coulomb_friction import SmoothCoulombFriction as SmoothCoulombFriction
from redundant_envs.effects.tendon import Tendon as Tendon
from redundant_envs.effects.tether import Tether as Tether
from redundant_envs.effects.tip_and_posture import TipAndPosture as TipAndPosture
from redundant_envs.effects.tip_force import TipForce as TipForce
from redundant_envs.effects.tip_velocity import TipVelocity as TipVelocity
from redundant_envs.effects.torque_speed import TorqueSpeed as TorqueSpeed
from redundant_envs.effects.two_stage_spring import TwoStageSpring as TwoStageSpring
from redundant_envs.effects.viscous_friction import ViscousFriction as ViscousFriction

# isort: off
from redundant_envs.effects.hooks import (
    Actuation as Actuation, Effect as Effect, Field as Field, Force as Force, Friction as Friction,
    Gap as Gap, Impact as Impact, Impulse as Impulse, Inertia as Inertia, Instant as Instant, Link as Link,
    Obstacle as Obstacle, Point as Point, PointMass as PointMass, Reading as Reading, Sensing as Sensing,
    State as State,
)  # fmt: skip
# isort: on

from redundant_envs.support.modules import classes_in

_FOUND = {kind.__name__: kind for kind in classes_in(__name__, Effect) if "hooks" in vars(kind)}
OWN: dict[str, type[Effect]] = dict(sorted(_FOUND.items()))
"""The effects of this package by their names; a base of several has no hooks."""
globals().update(OWN)
__all__ = [*(name for name, thing in sorted(globals().items()) if isinstance(thing, type))]
REGISTRY = dict(OWN)
"""Effects by their name in scene files; users add theirs."""
