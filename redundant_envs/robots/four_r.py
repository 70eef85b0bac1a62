"""4R: q = (theta1, ..., theta4); absolute angles from +x; point masses at the link ends.

Locations in the report are marked "report 2.x". Its misprints are corrected (docs/errata.md). s21, c21
are sin, cos(theta2 - theta1) and so on; mu1 = m1 + m2 + m3 + m4, mu2 = m2 + m3 + m4, mu3 = m3 + m4, and m4 is
what link 4 carries: K12 = mu2 l1 l2, K13 = mu3 l1 l3, K14 = m4 l1 l4 and so on. w1..w4 are the rates.
(ax, ay) is the acceleration equivalent to the uniform field: minus the gravity vector, m/s^2.
"""

from dataclasses import dataclass

from redundant_envs.language.algebra import physics, sqrt
from redundant_envs.robots.arm import Arm


@physics(gives="theta21 theta32 theta43")
def angle_differences(theta1, theta2, theta3, theta4):
    """Subtracted before the sine is taken: near a straight arm this keeps every digit."""
    return theta2 - theta1, theta3 - theta2, theta4 - theta3


@physics
def rotate(s, c, sd, cd):
    """Sine and cosine of the sum of two angles."""
    return s * cd + c * sd, c * cd - s * sd


@physics(gives="s2 c2 s3 c3 s4 c4")
def directions(s1, c1, s21, c21, s32, c32, s43, c43):
    s2, c2 = rotate(s1, c1, s21, c21)
    s3, c3 = rotate(s2, c2, s32, c32)
    s4, c4 = rotate(s3, c3, s43, c43)
    return s2, c2, s3, c3, s4, c4


@physics(gives="s31 c31 s42 c42 s41 c41")
def wider_differences(s21, c21, s32, c32, s43, c43):
    s31, c31 = rotate(s21, c21, s32, c32)
    s42, c42 = rotate(s32, c32, s43, c43)
    s41, c41 = rotate(s31, c31, s43, c43)
    return s31, c31, s42, c42, s41, c41


@physics(gives="x1 y1 x2 y2 x3 y3 x4 y4")
def points(l1, l2, l3, l4, s1, c1, s2, c2, s3, c3, s4, c4):
    x1 = l1 * c1  # report 2.1, x1
    y1 = l1 * s1  # report 2.1, y1
    x2 = x1 + l2 * c2  # report 2.1, x2
    y2 = y1 + l2 * s2  # report 2.1, y2
    x3 = x2 + l3 * c3  # report 2.1, x3
    y3 = y2 + l3 * s3  # report 2.1, y3
    return x1, y1, x2, y2, x3, y3, x3 + l4 * c4, y3 + l4 * s4  # report 2.1, x4, y4


@physics(gives="J11 J12 J13 J14 J21 J22 J23 J24")
def jacobian(l1, l2, l3, l4, s1, c1, s2, c2, s3, c3, s4, c4):
    return (  # report eq. (4)
        -l1 * s1, -l2 * s2, -l3 * s3, -l4 * s4,
        l1 * c1, l2 * c2, l3 * c3, l4 * c4,
    )  # fmt: skip


@physics(gives="Jdqd1 Jdqd2")
def jacobian_dot_qd(l1, l2, l3, l4, s1, c1, s2, c2, s3, c3, s4, c4, w1, w2, w3, w4):
    b1 = l1 * w1 * w1
    b2 = l2 * w2 * w2
    b3 = l3 * w3 * w3
    b4 = l4 * w4 * w4
    return (
        -(b1 * c1 + b2 * c2 + b3 * c3 + b4 * c4),
        -(b1 * s1 + b2 * s2 + b3 * s3 + b4 * s4),
    )


@physics(gives="K11 K12 K13 K14 K22 K23 K24 K33 K34 K44")
def inertia_products(m1, m2, m3, m4, l1, l2, l3, l4):
    """K_ij = mu_max(i,j) l_i l_j."""
    mu3 = m3 + m4
    mu2 = m2 + mu3
    mu1 = m1 + mu2
    return (
        mu1 * l1 * l1, mu2 * l1 * l2, mu3 * l1 * l3, m4 * l1 * l4,
        mu2 * l2 * l2, mu3 * l2 * l3, m4 * l2 * l4,
        mu3 * l3 * l3, m4 * l3 * l4,
        m4 * l4 * l4,
    )  # fmt: skip


@physics(gives="M11 M12 M13 M14 M21 M22 M23 M24 M31 M32 M33 M34 M41 M42 M43 M44")
def mass_matrix(K11, K12, K13, K14, K22, K23, K24, K33, K34, K44, c21, c31, c41, c32, c42, c43):
    M12 = K12 * c21  # report 2.3, M12 = M21
    M13 = K13 * c31  # report 2.3, M13 = M31
    M14 = K14 * c41  # report 2.3, M14 = M41
    M23 = K23 * c32  # report 2.3, M23 = M32
    M24 = K24 * c42  # report 2.3, M24 = M42
    M34 = K34 * c43  # report 2.3, M34 = M43
    return (
        K11, M12, M13, M14,  # report 2.3, M11
        M12, K22, M23, M24,  # report 2.3, M22
        M13, M23, K33, M34,  # report 2.3, M33 (printed as M32; corrected)
        M14, M24, M34, K44,  # report 2.3, M44
    )  # fmt: skip


@physics(gives="h1 h2 h3 h4")
def bias_forces(K12, K13, K14, K23, K24, K34, s21, s31, s41, s32, s42, s43, w1, w2, w3, w4):
    return (
        -K12 * s21 * w2 * w2 - K13 * s31 * w3 * w3 - K14 * s41 * w4 * w4,  # report 2.3, H1
        K12 * s21 * w1 * w1 - K23 * s32 * w3 * w3 - K24 * s42 * w4 * w4,  # report 2.3, H2
        K13 * s31 * w1 * w1 + K23 * s32 * w2 * w2 - K34 * s43 * w4 * w4,  # report 2.3, H3
        # report 2.3, H4 (its third term corrected: no second factor m4)
        K14 * s41 * w1 * w1 + K24 * s42 * w2 * w2 + K34 * s43 * w3 * w3,
    )


@physics(gives="C11 C12 C13 C14 C21 C22 C23 C24 C31 C32 C33 C34 C41 C42 C43 C44")
def coriolis_matrix(K12, K13, K14, K23, K24, K34, s21, s31, s41, s32, s42, s43, w1, w2, w3, w4):
    """Christoffel form: C qd = h and M' = C + C^T."""
    return (
        0.0, -K12 * s21 * w2, -K13 * s31 * w3, -K14 * s41 * w4,
        K12 * s21 * w1, 0.0, -K23 * s32 * w3, -K24 * s42 * w4,
        K13 * s31 * w1, K23 * s32 * w2, 0.0, -K34 * s43 * w4,
        K14 * s41 * w1, K24 * s42 * w2, K34 * s43 * w3, 0.0,
    )  # fmt: skip


@physics(gives="G1 G2 G3 G4")
def gravity_forces(m1, m2, m3, m4, l1, l2, l3, l4, s1, c1, s2, c2, s3, c3, s4, c4, ax, ay):
    """dU/dq in the uniform field; the report's G_i at (ax, ay) = (0, g)."""
    mu3 = m3 + m4
    mu2 = m2 + mu3
    return (
        (m1 + mu2) * l1 * (ay * c1 - ax * s1),  # report 2.3, G1
        mu2 * l2 * (ay * c2 - ax * s2),  # report 2.3, G2
        mu3 * l3 * (ay * c3 - ax * s3),  # report 2.3, G3
        m4 * l4 * (ay * c4 - ax * s4),  # report 2.3, G4
    )


@physics(gives="T")
def kinetic_energy(m1, m2, m3, m4, l1, l2, l3, l4, s21, c21, s32, c32, s43, c43, w1, w2, w3, w4):
    """Half of sum m |velocity|^2 (report 2.1, KE); e, n: velocity along and across each link."""
    n1 = l1 * w1
    e2 = n1 * s21
    n2 = n1 * c21 + l2 * w2
    e3 = e2 * c32 + n2 * s32
    n3 = n2 * c32 - e2 * s32 + l3 * w3
    e4 = e3 * c43 + n3 * s43
    n4 = n3 * c43 - e3 * s43 + l4 * w4
    return 0.5 * (
        m1 * n1 * n1 + m2 * (e2 * e2 + n2 * n2) + m3 * (e3 * e3 + n3 * n3) + m4 * (e4 * e4 + n4 * n4)
    )


@physics(gives="Lz")
def angular_momentum(
    K11, K12, K13, K14, K22, K23, K24, K33, K34, K44, c21, c31, c41, c32, c42, c43, w1, w2, w3, w4
):  # fmt: skip
    """About the base: the sum of the four conjugate momenta."""
    return (
        K11 * w1 + K22 * w2 + K33 * w3 + K44 * w4
        + K12 * c21 * (w1 + w2) + K13 * c31 * (w1 + w3) + K14 * c41 * (w1 + w4)
        + K23 * c32 * (w2 + w3) + K24 * c42 * (w2 + w4) + K34 * c43 * (w3 + w4)
    )  # fmt: skip


@physics(gives="manipulability")
def manipulability(l1, l2, l3, l4, s21, s31, s41, s32, s42, s43):
    """sqrt(det J J^T)."""
    return sqrt(
        (l1 * l2 * s21) ** 2 + (l1 * l3 * s31) ** 2 + (l1 * l4 * s41) ** 2
        + (l2 * l3 * s32) ** 2 + (l2 * l4 * s42) ** 2 + (l3 * l4 * s43) ** 2
    )  # fmt: skip


@physics(gives="n1 n2 n3 n4")
def column_norms(l1, l2, l3, l4):
    """Norms of the columns of J: metres at the tip per unit of each coordinate."""
    return l1, l2, l3, l4


@physics(gives="W1 W2 W3 W4")
def mobility_bounds(m1, m2, m3, m4, l1, l2, l3, l4):
    """Upper bounds of the joint mobilities, diag(B^T M^-1 B), in every pose; 1/(kg m^2).

    A mobility is 1 over the least sum of m a^2 with which its joint accelerates by 1 while the
    other joints move freely. Each bound keeps the two links of the joint, as bars that are
    free except at the base, and halves the mass they share.
    """
    return (
        1.0 / (m1 * l1 * l1),
        (2.0 / m1 + 1.0 / m2) / (l2 * l2) + 2.0 / (m1 * l1 * l1),
        (2.0 / m2 + 1.0 / m3) / (l3 * l3) + (1.0 / m1 + 2.0 / m2) / (l2 * l2),
        (2.0 / m3 + 1.0 / m4) / (l4 * l4) + (1.0 / m2 + 2.0 / m3) / (l3 * l3),
    )


@physics(
    gives="inverse_l1 inverse_l2 inverse_l3 inverse_l4 push1 push2 push3 push4 tip3 tip4 ratio1 ratio3"
    " ratio34 N3",
)
def products_of_masses(m1, m2, m3, m4, l1, l2, l3, l4):
    """The part of the elimination that depends on masses and lengths alone.

    A couple of 1 N m on link i accelerates a mass at its end across it: m2 by push_i, and m4 by tip_i.
    """
    return (
        1.0 / l1, 1.0 / l2, 1.0 / l3, 1.0 / l4,
        1.0 / (m2 * l1), 1.0 / (m2 * l2), 1.0 / (m2 * l3),
        1.0 / (m2 * l4), 1.0 / (m4 * l3), 1.0 / (m4 * l4),
        m1 / m2, m3 / m2, m3 / m4, m3 * (m3 + m4) / (m2 * m4),
    )  # fmt: skip


@physics(gives="qdd1 qdd2 qdd3 qdd4")
def forward_dynamics(
    l1, l2, l3, l4, inverse_l1, inverse_l2, inverse_l3, inverse_l4, push1, push2, push3, push4, tip3, tip4,
    ratio1, ratio3, ratio34, N3, s1, c1, s21, c21, s32, c32, s43, c43, w1, w2, w3, w4, Q1, Q2, Q3, Q4, ax, ay,
):  # fmt: skip
    """qdd of M qdd + h + G = Q, for M, h and G of ``mass_matrix``, ``bias_forces`` and ``gravity_forces``, by
    O(n) elimination, tip to base and back, in the frame of each link: M is not formed.

    Masses are in units of m2, and forces are accelerations of m2. The effective inertia along a link, of the
    link and all beyond it, is N/D, and the pivot across it D/D', with the D' of the next link: sums of
    positive numbers. All N and D are divided by m4, and are formed first, so that no division waits for
    another.
    """
    f1 = Q1 * push1
    f2 = Q2 * push2
    f3 = Q3 * push3
    f4 = Q4 * push4
    g4 = Q4 * tip4
    b1 = -l1 * w1 * w1
    b2 = -l2 * w2 * w2
    b3 = -l3 * w3 * w3
    b4 = -l4 * w4 * w4
    D3 = ratio34 + s43 * s43
    N2 = D3 + N3
    ss2 = s32 * s32
    ss1 = s21 * s21
    D2 = D3 + N3 * ss2
    D1 = ratio1 * D2 + N2 * ss1
    i3 = 1.0 / D3
    i2 = 1.0 / D2
    i1 = 1.0 / D1
    k2 = N3 * c32
    a1 = f1 - c21 * f2
    a2 = f2 - c32 * f3
    a3 = Q3 * tip3 - c43 * g4
    # Tip to base: p is the bias force of all beyond a link along it, times D; p2 is without that of b2, which
    # o2 has. E is the share of the couples.
    # Nearly straight, what couples leave is small, and so differences of equals are taken first.
    E3 = s43 * ((f4 - c43 * f3) + ratio34 * f4)
    p3 = N3 * b3 + (c43 * (ratio3 * b4) - E3)
    E2 = s32 * (N3 * (f3 - c32 * f2) + D3 * f3)
    p2 = c32 * p3 - E2
    # Base to tip: (e, n) is the acceleration of a link's near end, y across the link at its far end, P
    # the force along the next link if y were 0, p + N/D e, times D of both links. With a heavy tip the two
    # cancel to as many digits as it is heavier, so P is formed of what they leave.
    n1 = ay * c1 - ax * s1
    e1 = ax * c1 + ay * s1 + b1
    o2 = c21 * e1 + b2
    y1 = i1 * (D2 * a1 - s21 * (N2 * o2 + p2))
    n2 = c21 * y1 - s21 * e1
    e2 = o2 + s21 * y1
    P2 = (ratio1 + ss1) * p3 + k2 * (ratio1 * o2 + s21 * a1 + ss1 * (i2 * E2))
    y2 = i2 * (D3 * a2) - s32 * (i1 * P2)
    n3 = c32 * y2 - s32 * e2
    o3 = c32 * e2 + b3
    e3 = o3 + s32 * y2
    P3 = (1.0 + ratio3 * ss2) * b4 + c43 * (o3 + s32 * a2 + ss2 * (i3 * E3))
    y3 = i3 * a3 - s43 * (i2 * P3)
    n4 = c43 * y3 - s43 * e3
    return (
        (y1 - n1) * inverse_l1,
        (y2 - n2) * inverse_l2,
        (y3 - n3) * inverse_l3,
        (g4 - n4) * inverse_l4,
    )


@dataclass(frozen=True)
class FourR(Arm):
    """Arm of four revolute joints, q = (theta1, ..., theta4), absolute angles.

    Parameters
    ----------
    masses : 4 floats
        Point masses at the link ends, kg.
    lengths : 4 floats
        m.
    """

    joint_types = "RRRR"
    sincos = {
        "theta1": ("s1", "c1"), "theta21": ("s21", "c21"),
        "theta32": ("s32", "c32"), "theta43": ("s43", "c43"),
    }  # fmt: skip
    posture = {
        "s1": "sine of joint angle 1", "c1": "cosine of joint angle 1",
        "s21": "sine of joint angle 2", "c21": "cosine of joint angle 2",
        "s32": "sine of joint angle 3", "c32": "cosine of joint angle 3",
        "s43": "sine of joint angle 4", "c43": "cosine of joint angle 4",
    }  # fmt: skip
    functions = (
        angle_differences, directions, wider_differences, points, jacobian, jacobian_dot_qd,
        inertia_products, mass_matrix, products_of_masses, bias_forces, coriolis_matrix, gravity_forces,
        kinetic_energy, angular_momentum, manipulability, forward_dynamics,
    )  # fmt: skip
    prepared = (products_of_masses,)
    column_norms = staticmethod(column_norms)
    mobility_bounds = staticmethod(mobility_bounds)
    description = "A planar arm of four revolute joints in a vertical plane"
    schematic = """\
    base          m1            m2            m3            m4
     O=============O=============O=============O=============o  tip
     |<--- l1 ---->|<--- l2 ---->|<--- l3 ---->|<--- l4 ---->|
    theta1        theta2        theta3        theta4"""
