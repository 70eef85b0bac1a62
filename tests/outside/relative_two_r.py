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


@physics(gives="J11 J12 J21 J22")
def jacobian(l1, l2, s1, c1, s12, c12):
    return -l1 * s1 - l2 * s12, -l2 * s12, l1 * c1 + l2 * c12, l2 * c12


@physics(gives="Jdqd1 Jdqd2")
def bias_acceleration(l1, l2, s1, c1, s12, c12, w1, w2):
    w = w1 + w2
    return -l1 * c1 * w1 * w1 - l2 * c12 * w * w, -l1 * s1 * w1 * w1 - l2 * s12 * w * w


@physics(gives="M11 M12 M21 M22")
def mass_matrix(m1, m2, l1, l2, c2):
    coupling, far = m2 * l1 * l2 * c2, m2 * l2 * l2
    return (m1 + m2) * l1 * l1 + far + 2.0 * coupling, far + coupling, far + coupling, far


@physics(gives="h1 h2")
def bias_forces(m2, l1, l2, s2, w1, w2):
    k = m2 * l1 * l2 * s2
    return -k * (2.0 * w1 + w2) * w2, k * w1 * w1


@physics(gives="G1 G2")
def weights(m1, m2, J11, J12, J21, J22, l1, s1, c1, ax, ay):
    return m1 * l1 * (ay * c1 - ax * s1) + m2 * (ax * J11 + ay * J21), m2 * (ax * J12 + ay * J22)


@physics(gives="W1 W2")
def mobility_bounds(m1, m2, l1, l2):
    return 1.0 / (m1 * l1 * l1), 1.0 / (m2 * l2 * l2) + (1.0 / l1 + 1.0 / l2) ** 2 / m1


@dataclass(frozen=True)
class RelativeTwoR(rde.Arm):
    """Masses at the ends of both links, kg; lengths, m."""

    num_masses, num_lengths = 2, 2
    coordinates, rates = ("a", "b"), ("w1", "w2")
    joints, prismatic = ("joint1", "joint2"), (False, False)
    sincos = {"a": ("s1", "c1"), "b": ("s2", "c2")}
    functions = (
        directions, points, jacobian, bias_acceleration, mass_matrix, bias_forces, weights,
    )  # fmt: skip
    mobility_bounds = mobility_bounds
