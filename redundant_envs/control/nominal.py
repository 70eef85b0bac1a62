"""What plans know of a scene: the nominal arm in joint coordinates phi = B^T q, its motors and its travel."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.holding import motor_efforts, slider_travel
from redundant_envs.effects import EffortLimits, Gravity, JointVelocity, PrismaticStop, ViscousFriction
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]


class NominalModel:
    """Arm, gravity, viscous friction, effort limits and stops of a scene; its other effects are unknown to
    plans. All arrays are (..., joints), in joint coordinates: rad or m, N m or N. ``speeds`` and ``gain`` are
    those of the mode :class:`~redundant_envs.effects.JointVelocity`, None and infinite without it; ``scene``
    is without that mode.

    Raises
    ------
    ValueError
        If actions are shares of neither effort limits nor joint speeds, or gravity has a part along x; where
        the travel is asked for, if a slider has no stops.
    """

    def __init__(self, scene: Scene) -> None:
        mode = next((e for e in scene.effects if isinstance(e, JointVelocity)), None)
        self.speeds: Array | None = None if mode is None else np.array(mode.speeds)
        self.gain = np.inf if mode is None else float(mode.gain)
        if mode:
            others = tuple(effect for effect in scene.effects if effect is not mode)
            scene = dataclasses.replace(scene, effects=others)
        kinds: Any = (EffortLimits, ViscousFriction, Gravity)
        found: Any = [next((e for e in scene.effects if isinstance(e, kind)), None) for kind in kinds]
        limits, friction, gravity = found
        if limits is None:
            raise ValueError("scene has no EffortLimits; the expert returns actions in their units")
        if (units := scene.action_units()) != tuple(f"{limits.key}.{name}" for name in limits.parameters()):
            raise ValueError(
                f"actions are shares of {units[0]}; the expert knows efforts and joint velocities"
            )
        if gravity and gravity.down[0] != 0.0:
            raise ValueError("scene has gravity along x; the expert handles gravity along -y")
        self.scene, self.arm = scene, scene.robot
        self.joints = len(self.arm.joints)
        self.limits = np.array(limits.limits)
        self.friction = np.array(friction.coefficients) if friction else np.zeros(self.joints)
        self.g = -gravity.g * gravity.down[1] if gravity else 0.0
        self.b = self.arm.motor_map
        self.inverse = np.linalg.inv(self.b)  # q = phi @ inverse, efforts = Q @ inverse.T
        self.slides = np.array(self.arm.prismatic)

    @cached_property
    def static(self) -> Scene:
        """The scene with those effects alone whose part at rest is known."""
        kept = tuple(e for e in self.scene.effects if isinstance(e, KNOWN_AT_REST))
        return dataclasses.replace(self.scene, effects=kept, randomize=None)

    @cached_property
    def travel(self) -> tuple[Array, Array]:
        """Lower and upper ends (joints,) of the joints, infinite for revolute ones."""
        low, high = np.full(self.joints, -np.inf), np.full(self.joints, np.inf)
        for joint, ends in slider_travel(self.static).items():
            low[joint], high[joint] = ends
        return low, high

    @cached_property
    def lengths_beyond(self) -> Array:
        """Length of the stretched arm from each joint on, (joints,), m."""
        parts = self.travel[1].copy()
        parts[~self.slides] = self.arm.lengths
        beyond: Array = np.cumsum(parts[::-1])[::-1]
        return beyond

    def efforts(self, phi: Array, phid: Array, phidd: Array) -> Array:
        """Inverse dynamics: efforts of the motors for a motion, as (11) of Luh, Walker and Paul (1980)."""
        arm, inverse = self.scene.loaded_robot, self.inverse
        forces = arm.inverse_dynamics(phi @ inverse, phid @ inverse, phidd @ inverse, g=self.g)
        efforts: Array = forces @ inverse.T + self.friction * phid
        return efforts

    def load(self, phi: Array, phid: Array, phidd: Array) -> Array:
        """Largest effort / limit (...) of a motion."""
        load: Array = (np.abs(self.efforts(phi, phid, phidd)) / self.limits).max(axis=-1)
        return load

    def loads_at_rest(self, phi: Array) -> Array:
        """Effort / limit of each motor that holds a pose, where sliders lean on their stops."""
        loads: Array = np.abs(motor_efforts(self.static, phi @ self.inverse)) / self.limits
        return loads

    def tip(self, phi: Array) -> Array:
        """Position of the tip (..., 2), m."""
        return self.arm.forward_kinematics(phi @ self.inverse)

    def jacobian(self, phi: Array) -> Array:
        """Of the tip by joint coordinates, (..., 2, joints)."""
        jacobian: Array = self.arm.jacobian(phi @ self.inverse) @ self.inverse.T
        return jacobian

    def links(self, phi: Array) -> Array:
        """Ends of the straight links, (..., links + 1, 2) m, the base first: a link and the slider that
        extends it are one."""
        points = self.arm.points(phi @ self.inverse)[..., ~np.append(self.slides[1:], False), :]
        return np.concatenate([np.zeros_like(points[..., :1, :]), points], axis=-2)


KNOWN_AT_REST = (Gravity, ViscousFriction, EffortLimits, PrismaticStop)
