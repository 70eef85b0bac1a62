"""Values of every lane that users may read, under the same names in every kind of environment."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.core import Core
from redundant_envs.envs.parameters import Parameters, parameters_of
from redundant_envs.scene import Scene

LANE_VALUES = ("q", "qd", "tip", "goal", "parameters")
"""Properties of :class:`LaneValues` that lanes have each for itself."""


class LaneValues:
    """The scene of a core, and coordinates, velocities, tips, goals and numbers of its lanes, as copies.

    To set them, give ``q``, ``qd``, ``goal`` and ``parameters`` to the options of a reset.
    """

    core: Core

    @property
    def scene(self) -> Scene:
        """The scene: arm, effects, and how it is simulated."""
        return self.core.scene

    @property
    def parameters(self) -> Parameters:
        """Names, values and units of all numbers, of arm, effects and task."""
        return parameters_of(self.core)

    @property
    def q(self) -> NDArray[np.float64]:
        """Generalized coordinates, (num_envs, joints), or (joints,) of a single environment; rad and m."""
        return self.core.memory.read(self.core.scene.robot.coordinates)

    @property
    def qd(self) -> NDArray[np.float64]:
        """Generalized velocities, (num_envs, joints), or (joints,) of a single environment; rad/s and m/s."""
        return self.core.memory.read(self.core.scene.robot.rates)

    @property
    def tip(self) -> NDArray[np.float64]:
        """Position of the tip, (num_envs, 2), or (2,) of a single environment; m."""
        return self.core.tips()

    @property
    def goal(self) -> NDArray[np.float64]:
        """Position of the goal, (num_envs, 2), or (2,) of a single environment; m."""
        return self.core.goals()


class LaneValue(LaneValues):
    """The same for a core with one lane: without the first axis."""

    @property
    def parameters(self) -> Parameters:
        return super().parameters.of_lane(0)

    @property
    def q(self) -> NDArray[np.float64]:
        return super().q[0]

    @property
    def qd(self) -> NDArray[np.float64]:
        return super().qd[0]

    @property
    def tip(self) -> NDArray[np.float64]:
        return super().tip[0]

    @property
    def goal(self) -> NDArray[np.float64]:
        return super().goal[0]
