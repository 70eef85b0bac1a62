"""A boundary from outside the package, in one file: a frictionless wall for the tip."""

from dataclasses import dataclass

from redundant_envs import effects as e
from redundant_envs.algebra import physics


@physics
def gap_to_wall(tip_x, place):
    return place - tip_x


@dataclass(frozen=True)
class Wall(e.Effect):
    """The tip stays to the left of a wall, ``place`` m to the right of the base."""

    place: float = 0.9
    restitution: float = 0.5

    def hooks(self, arm):
        return (e.Gap(gap_to_wall, ".restitution", {"place": ".place"}),)
