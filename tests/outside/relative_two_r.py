"""Two links on revolute joints, in relative angles: the pose determines the tip's distance from the base."""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import physics


@physics(gives="s12 c12")
def directions(s1, c1, s2, c2):
    return s1 * c2 + c1 * s2, c1 * c2 - s1 * s2


@physics(gives="x1 y1 x2 y2")
def points(l1, l2, s1, c1, s12, c12):
    return l1 * c1, l1 * s1, l1 * c1 + l2 * c12, l1 * s1 + l2 * s12


@dataclass(frozen=True)
class RelativeTwoR(rde.Arm):
    """Masses at the ends of both links, kg; lengths, m."""

    num_masses, num_lengths = 2, 2
    coordinates, rates = ("a", "b"), ("w1", "w2")
    joints, prismatic = ("joint1", "joint2"), (False, False)
    sincos = {"a": ("s1", "c1"), "b": ("s2", "c2")}
    functions = (directions, points)
