"""A planar arm of three revolute joints whose equations are all written by hand, from outside the package.

q = (theta1, theta2, theta3), absolute angles from +x; point masses at the link ends. s21, c21 are sin,
cos(theta2 - theta1) and so on; w1..w3 are the rates; (ax, ay) is minus the gravity vector.
"""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import physics


@physics(gives="theta21 theta32")
def angle_differences(theta1, theta2, theta3):
    """Subtracted before the sine is taken: near a straight arm this keeps every digit."""
    return theta2 - theta1, theta3 - theta2


@physics
def rotate(s, c, sd, cd):
    """Sine and cosine of the sum of two angles."""
    return s * cd + c * sd, c * cd - s * sd


@physics(gives="s2 c2 s3 c3 s31 c31")
def directions(s1, c1, s21, c21, s32, c32):
    s2, c2 = rotate(s1, c1, s21, c21)
    s3, c3 = rotate(s2, c2, s32, c32)
    s31, c31 = rotate(s21, c21, s32, c32)
    return s2, c2, s3, c3, s31, c31


@physics(gives="phi1 phi2 phi3")
def joint_positions(theta1, theta21, theta32):
    return theta1, theta21, theta32


@physics(gives="phid1 phid2 phid3")
def joint_rates(w1, w2, w3):
    return w1, w2 - w1, w3 - w2


@physics(gives="theta1 theta2 theta3")
def coordinates_of_joints(phi1, phi2, phi3):
    return phi1, phi1 + phi2, phi1 + phi2 + phi3


@physics(gives="Q1 Q2 Q3")
def motor_map(t1, t2, t3):
    """Motor i acts between link i-1 and link i."""
    return t1 - t2, t2 - t3, t3


@physics(gives="x1 y1 x2 y2 x3 y3")
def points(l1, l2, l3, s1, c1, s2, c2, s3, c3):
    x1, y1 = l1 * c1, l1 * s1
    x2, y2 = x1 + l2 * c2, y1 + l2 * s2
    return x1, y1, x2, y2, x2 + l3 * c3, y2 + l3 * s3


@physics(gives="J11 J12 J13 J21 J22 J23")
def jacobian(l1, l2, l3, s1, c1, s2, c2, s3, c3):
    return -l1 * s1, -l2 * s2, -l3 * s3, l1 * c1, l2 * c2, l3 * c3


@physics(gives="Jdqd1 Jdqd2")
def jacobian_dot_qd(J11, J12, J13, J21, J22, J23, w1, w2, w3):
    """Every column of J turns with its link."""
    a1, a2, a3 = w1 * w1, w2 * w2, w3 * w3
    return -(J21 * a1 + J22 * a2 + J23 * a3), J11 * a1 + J12 * a2 + J13 * a3


@physics(gives="K11 K12 K13 K22 K23 K33")
def inertia_products(m1, m2, m3, l1, l2, l3):
    """K_ij = l_i l_j times the mass that both links carry."""
    m23 = m2 + m3
    return (m1 + m23) * l1 * l1, m23 * l1 * l2, m3 * l1 * l3, m23 * l2 * l2, m3 * l2 * l3, m3 * l3 * l3


@physics(gives="M11 M12 M13 M21 M22 M23 M31 M32 M33")
def mass_matrix(K11, K12, K13, K22, K23, K33, c21, c31, c32):
    M12, M13, M23 = K12 * c21, K13 * c31, K23 * c32
    return K11, M12, M13, M12, K22, M23, M13, M23, K33


@physics(gives="h1 h2 h3")
def bias_forces(K12, K13, K23, s21, s31, s32, w1, w2, w3):
    return (
        -K12 * s21 * w2 * w2 - K13 * s31 * w3 * w3,
        K12 * s21 * w1 * w1 - K23 * s32 * w3 * w3,
        K13 * s31 * w1 * w1 + K23 * s32 * w2 * w2,
    )


@physics(gives="G1 G2 G3")
def gravity_forces(m1, m2, m3, J11, J12, J13, J21, J22, J23, ax, ay):
    """All masses that a link carries move with its column of J."""
    m23 = m2 + m3
    return (m1 + m23) * (ax * J11 + ay * J21), m23 * (ax * J12 + ay * J22), m3 * (ax * J13 + ay * J23)


@physics(gives="W1 W2 W3")
def mobility_bounds(m1, m2, m3, l1, l2, l3):
    """Upper bounds in any pose, as if the masses were free points; a straight arm attains them."""
    return (
        1.0 / (m1 * l1 * l1),
        1.0 / (m2 * l2 * l2) + (1.0 / l1 + 1.0 / l2) ** 2 / m1,
        1.0 / (m3 * l3 * l3) + (1.0 / l2 + 1.0 / l3) ** 2 / m2 + 1.0 / (m1 * l2 * l2),
    )


@dataclass(frozen=True)
class ThreeRByHand(rde.Arm):
    """Arm of three revolute joints: masses (3) at the link ends [kg], lengths (3) [m]."""

    num_masses = 3
    num_lengths = 3
    coordinates = ("theta1", "theta2", "theta3")
    rates = ("w1", "w2", "w3")
    joints = ("joint1", "joint2", "joint3")
    prismatic = (False, False, False)
    sincos = {"theta1": ("s1", "c1"), "theta21": ("s21", "c21"), "theta32": ("s32", "c32")}
    functions = (
        angle_differences, directions, joint_positions, joint_rates, motor_map, points, jacobian,
        jacobian_dot_qd, inertia_products, mass_matrix, bias_forces, gravity_forces,
    )  # fmt: skip
    mobility_bounds = mobility_bounds
    coordinates_of_joints = coordinates_of_joints
