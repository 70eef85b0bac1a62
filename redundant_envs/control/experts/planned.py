"""What experts share: a motion that is planned when an episode begins, and followed by computed torque, or by
joint velocities where these are the actions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.following import Following, VelocityFollowing
from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.time_law import Motion
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]


class Planned:
    """An expert, see :class:`~redundant_envs.control.experts.Expert`; a subclass writes :meth:`plan`."""

    frequency = 14.0  # rad/s, of the error dynamics

    def __init__(self, scene: Scene) -> None:
        self.model = NominalModel(scene)
        efforts = self.model.speeds is None
        self.following = Following(self.model, self.frequency) if efforts else VelocityFollowing(self.model)
        self.dt = scene.control_dt

    def plan(self, start: Array, goal: Array, numbers: Mapping[str, Array]) -> Motion:
        """The motion of all episodes that begin, from poses phi (n, joints) to goals (n, 2)."""
        raise NotImplementedError(f"{type(self).__name__} does not say how it plans")

    def begin(
        self, q: Array, goal: Array, index: NDArray[np.intp] | None, numbers: Mapping[str, Array]
    ) -> None:
        """Plan new episodes."""
        self.following.decide(numbers.get("decide_every", np.ones(1)).max())
        self.following.begin(self.plan(q @ self.model.b, goal, numbers), index)

    def action(self, t: Array | float, q: Array, qd: Array) -> NDArray[np.float32]:
        """Actions (n, joints) in [-1, 1] at times ``t`` [s] since each episode began."""
        return self.following.action(t, q, qd)
