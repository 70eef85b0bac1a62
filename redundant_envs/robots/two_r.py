"""2R: q = (theta1, theta2); absolute angles from +x; point masses at the link ends.

The control without redundancy: as many joints as the tip has coordinates. Its equations follow from its
points, as those of every chain do.
"""

from dataclasses import dataclass

from redundant_envs.robots.arm import Arm


@dataclass(frozen=True)
class TwoR(Arm):
    """Arm of two revolute joints, q = (theta1, theta2), absolute angles.

    Parameters
    ----------
    masses : (float, float)
        Point masses at the link ends, kg.
    lengths : (float, float)
        m.
    """

    joint_types = "RR"
    description = "A planar arm of two revolute joints in a vertical plane"
    schematic = """\
    base              m1               m2
     O=================O================o  tip
     |<----- l1 ------>|<----- l2 ----->|
    theta1            theta2"""
