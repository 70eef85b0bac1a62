"""Arms: every printed equation names its location in the report. A new arm is one file here."""

from redundant_envs.robots.arm import Arm
from redundant_envs.robots.chain import Chain
from redundant_envs.robots.four_r import FourR
from redundant_envs.robots.rprp import RPRP
from redundant_envs.robots.two_r import TwoR
from redundant_envs.support.modules import classes_in

__all__ = ["RPRP", "Arm", "Chain", "FourR", "TwoR"]

REGISTRY: dict[str, type[Arm]] = {arm.kind: arm for arm in classes_in(__name__, Arm)}
"""Arms by their name in scene files."""
