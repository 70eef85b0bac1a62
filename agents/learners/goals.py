"""What the networks of a goal environment are given instead of both goals."""

from __future__ import annotations

from typing import Any

from redundant_envs.extras import needs

with needs("train"):
    import torch
    from gymnasium import spaces
    from torch import Tensor

ERROR_SCALE = 0.05
"""Distance from the goal that the networks are given as 1, in reaches."""


def goal_mixing(space: spaces.Space[Any], error_scale: float = ERROR_SCALE) -> Tensor | None:
    """What the first layers of a goal environment's networks are given, as a matrix of their inputs.

    The achieved goal becomes the error, desired minus achieved, in units of ``error_scale`` reaches; the
    desired goal is given in reaches. Without it a network has to find the small difference of two large
    numbers first. Being a matrix, it is multiplied into the first layers, and the saved policy has none.
    """
    if not isinstance(space, spaces.Dict):
        return None
    goal: Any = space["desired_goal"]
    width, reach = goal.shape[0], float(goal.high.max()) / 2.0
    # in the order of the space: achieved_goal, desired_goal, observation
    rest = spaces.flatdim(space) - 2 * width
    scaled = torch.eye(width) / (error_scale * reach)
    mixing = torch.block_diag(-scaled, torch.eye(width) / reach, torch.eye(rest))
    mixing[:width, width : 2 * width] = scaled
    return mixing
