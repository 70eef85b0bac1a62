"""Inputs of the networks of a goal environment, instead of both goals."""

from __future__ import annotations

from typing import Any

from redundant_envs.extras import needs

with needs("train"):
    import torch
    from gymnasium import spaces
    from torch import Tensor

ERROR_SCALE = 0.05
"""Distance from the goal that is the input 1 of the networks, in reaches."""


def goal_mixing(space: spaces.Space[Any], error_scale: float = ERROR_SCALE) -> Tensor | None:
    """The matrix that maps observations to inputs of the first layers of a goal environment's networks.

    The achieved goal becomes the error, desired minus achieved, in units of ``error_scale`` reaches; the
    desired goal is given in reaches. Without the matrix a network first has to learn the small difference of
    two large numbers. The matrix is multiplied into the first layers, so the saved policy has none.
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
