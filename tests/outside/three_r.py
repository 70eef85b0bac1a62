"""A planar arm of three revolute joints, as a user would add it from outside the package."""

import redundant_envs as rde
from redundant_envs.algebra import physics


@physics(gives="x1 y1 x2 y2 x3 y3")
def points(l1, l2, l3, s1, c1, s2, c2, s3, c3):
    """Masses at the link ends; s1, c1 are sine and cosine of the angle of link 1 from +x, and so on."""
    x1, y1 = l1 * c1, l1 * s1
    x2, y2 = x1 + l2 * c2, y1 + l2 * s2
    return x1, y1, x2, y2, x2 + l3 * c3, y2 + l3 * s3


class ThreeR(rde.Arm):
    joint_types = "RRR"
    functions = (points,)


SCENE = {
    "robot": {"type": "ThreeR", "masses": [0.5, 0.5, 0.5], "lengths": [0.4, 0.35, 0.25]},
    "effects": [
        {"type": "Gravity"},
        {"type": "ViscousFriction", "coefficients": 0.2},
        {"type": "EffortLimits", "limits": [20.0, 10.0, 4.0]},
    ],
    "tolerance": 1e-6,
}
rde.register_arm(ThreeR, SCENE)
