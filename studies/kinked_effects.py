"""Effects as a user might write them, with undeclared kinks that depend on rates."""

from __future__ import annotations

from dataclasses import dataclass

from redundant_envs.effects import Actuation, Effect, Force
from redundant_envs.effects.hooks import Hook
from redundant_envs.language.algebra import clamp, physics
from redundant_envs.robots.arm import Arm


def on_each_joint(arm, hook, law, args, **how):
    """A hook on each joint; in names of what its law is given, {k} is the joint's index, {n} its number."""
    joints = range(len(arm.joints))
    names = [{name: at.format(k=k, n=k + 1) for name, at in args.items()} for k in joints]
    return tuple(hook(k, law, names[k], **how) for k in joints)


@physics
def smooth_friction(rate, level, scale):
    return -level * rate / (abs(rate) + scale)


@physics
def steepest_friction(level, scale):
    return level / scale


@dataclass(frozen=True)
class SmoothFriction(Effect):
    """Dry friction made continuous: ``levels`` at rates far beyond ``scale``."""

    levels: float | tuple[float, ...]  # N m or N
    scale: float = 0.5  # rad/s or m/s

    of_joints = ("levels",)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        args = {"rate": "phid{n}", "level": ".levels[{k}]", "scale": ".scale"}
        return on_each_joint(arm, Force, smooth_friction, args, damping=steepest_friction)


@physics
def clipped_velocity_effort(command, rate, gain, limit):
    return clamp(command - gain * rate, -limit, limit)


@dataclass(frozen=True)
class VelocityController(Effect):
    """Motors that hold a rate, command / gain, with a clipped effort."""

    gains: float | tuple[float, ...]  # N m s/rad or N s/m
    limits: float | tuple[float, ...]  # N m or N

    of_joints = ("gains", "limits")

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        args = {"command": "command{n}", "rate": "phid{n}", "gain": ".gains[{k}]", "limit": ".limits[{k}]"}
        return on_each_joint(arm, Actuation, clipped_velocity_effort, args)


@dataclass(frozen=True)
class Kinked:
    """An effect, and the bounds between which its numbers are drawn."""

    name: str
    effect: Effect
    bounds: dict[str, tuple[float, float]]


KINKED = (
    Kinked("smooth friction", SmoothFriction(0.5), {"levels": (1e-2, 3.0), "scale": (0.05, 1.0)}),
    Kinked("clipped velocity", VelocityController(1.0, 3.0), {"gains": (0.05, 1.0), "limits": (0.5, 5.0)}),
)
