"""A planar arm with two revolute joints and a slider, in joint coordinates, from outside the package.

q = (alpha1, alpha2, r): alpha1 from +x, alpha2 from link 1, r along link 2. m1 and m2 are at the link ends,
m3, the tip, is on link 2 at b = l2 + r. s2, c2 and w2 are of link 2 itself, s21, c21 of alpha2; sigma and I
are moments of m2 and m3 about joint 2; (ax, ay) is minus the gravity vector.
"""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import physics


@physics(gives="s2 c2")
def second_direction(s1, c1, s21, c21):
    return s1 * c21 + c1 * s21, c1 * c21 - s1 * s21


@physics(gives="w1 w2")
def link_rates(alphad1, alphad2):
    return alphad1, alphad1 + alphad2


@physics(gives="b sigma I")
def second_link(m2, m3, l2, r):
    b = l2 + r
    return b, m2 * l2 + m3 * b, m2 * l2 * l2 + m3 * b * b


@physics(gives="x1 y1 x2 y2 x3 y3")
def points(l1, l2, b, s1, c1, s2, c2):
    x1, y1 = l1 * c1, l1 * s1
    return x1, y1, x1 + l2 * c2, y1 + l2 * s2, x1 + b * c2, y1 + b * s2


@physics(gives="J11 J12 J13 J21 J22 J23")
def jacobian(l1, b, s1, c1, s2, c2):
    return -l1 * s1 - b * s2, -b * s2, c2, l1 * c1 + b * c2, b * c2, s2


@physics(gives="Jdqd1 Jdqd2")
def jacobian_dot_qd(l1, b, s1, c1, s2, c2, w1, w2, v):
    a1, a2, across = l1 * w1 * w1, b * w2 * w2, 2.0 * v * w2
    return -a1 * c1 - a2 * c2 - across * s2, -a1 * s1 - a2 * s2 + across * c2


@physics(gives="M11 M12 M13 M21 M22 M23 M31 M32 M33")
def mass_matrix(m1, m2, m3, l1, sigma, I, s21, c21):
    coupling = l1 * sigma * c21
    M11 = (m1 + m2 + m3) * l1 * l1 + 2.0 * coupling + I
    M12 = coupling + I
    M13 = m3 * l1 * s21
    return M11, M12, M13, M12, I, 0.0, M13, 0.0, m3


@physics(gives="h1 h2 h3")
def bias_forces(m3, l1, b, sigma, s21, c21, w1, w2, v):
    on_first = l1 * (2.0 * m3 * v * w2 * c21 - sigma * s21 * w2 * w2)
    on_second = l1 * sigma * s21 * w1 * w1 + 2.0 * m3 * b * v * w2
    return on_first + on_second, on_second, -m3 * (l1 * c21 * w1 * w1 + b * w2 * w2)


@physics(gives="G1 G2 G3")
def gravity_forces(m1, m2, m3, l1, sigma, s1, c1, s2, c2, ax, ay):
    on_second = sigma * (ay * c2 - ax * s2)
    on_first = (m1 + m2 + m3) * l1 * (ay * c1 - ax * s1)
    return on_first + on_second, on_second, m3 * (ax * c2 + ay * s2)


@physics(gives="W1 W2 W3")
def mobility_bounds(m1, m2, m3, l1, l2):
    """Upper bounds in any pose: m1 and m2 as free points for the angles; both as one, along link 2, for r."""
    return (
        1.0 / (m1 * l1 * l1),
        1.0 / (m2 * l2 * l2) + (1.0 / l1 + 1.0 / l2) ** 2 / m1,
        1.0 / m3 + 1.0 / (m1 + m2),
    )


@dataclass(frozen=True)
class RRP(rde.Arm):
    """Arm of two revolute joints and a slider: masses (3) [kg], lengths (l1, l2) [m]."""

    num_masses = 3
    num_lengths = 2
    coordinates = ("alpha1", "alpha2", "r")
    rates = ("alphad1", "alphad2", "v")
    joints = ("joint1", "joint2", "r")
    prismatic = (False, False, True)
    sincos = {"alpha1": ("s1", "c1"), "alpha2": ("s21", "c21")}
    functions = (
        second_direction, link_rates, second_link, points, jacobian, jacobian_dot_qd, mass_matrix,
        bias_forces, gravity_forces,
    )  # fmt: skip
    mobility_bounds = mobility_bounds


SCENE = {
    "robot": {"type": "RRP", "masses": [0.5, 0.5, 0.5], "lengths": [0.4, 0.3]},
    "effects": [
        {"type": "Gravity"},
        {"type": "ViscousFriction", "coefficients": [0.2, 0.2, 0.2]},
        {"type": "EffortLimits", "limits": [20.0, 10.0, 16.0]},
        {"type": "PrismaticStop", "lower": [0.0], "upper": [0.3], "restitution": 0.0},
    ],
    "tolerance": 1e-6,
}
rde.register_arm(RRP, SCENE)
