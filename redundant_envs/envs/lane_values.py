"""Values of every lane that users may read, under the same names in every kind of environment."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.core import Core

LANE_VALUES = ("q", "qd", "tip", "goal")
"""Properties of :class:`LaneValues`."""


class LaneValues:
    """Coordinates, velocities, tips and goals of the lanes of a core, as copies.

    To set them, give ``q``, ``qd`` and ``goal`` to the options of a reset.
    """

    core: Core

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
