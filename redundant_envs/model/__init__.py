"""The public faces of the physics: arms, batches, trajectories."""

from redundant_envs.model.arms import RPRP, FourR

__all__ = ["RPRP", "FourR"]
