"""Arms: every printed equation names its location in the report. A new arm is a file and a line here."""

from redundant_envs.robots.arm import Arm
from redundant_envs.robots.chain import Chain
from redundant_envs.robots.four_r import FourR
from redundant_envs.robots.rprp import RPRP

__all__ = ["RPRP", "Arm", "Chain", "FourR"]

REGISTRY: dict[str, type[Arm]] = {"RPRP": RPRP, "FourR": FourR, "Chain": Chain}
"""Arms by their name in scene files."""
