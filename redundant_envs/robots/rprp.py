"""RPRP: q = (theta1, r1, theta2, r2); absolute angles from +x; point masses at the link ends.

Locations in the report are marked "report 1.x". Its misprints are corrected (docs/errata.md). With
a1 = l1 + r1, a2 = l2 + r2, s12, c12 = sin, cos(theta1 - theta2), mu2 = m2 + m3 + m4,
sigma = m3 l2 + m4 a2, I = m3 l2^2 + m4 a2^2. Rates: w1, w2 are theta1', theta2'; v1, v2 are r1', r2'.
(ax, ay) is the acceleration equivalent to the uniform field: minus the gravity vector, m/s^2.
"""

from dataclasses import dataclass

from redundant_envs.language.algebra import physics, sqrt, where
from redundant_envs.robots.arm import Arm


@physics(gives="theta12")
def angle_difference(theta1, theta2):
    return theta1 - theta2


@physics(gives="s2 c2")
def second_direction(s1, c1, s12, c12):
    return s1 * c12 - c1 * s12, c1 * c12 + s1 * s12


@physics(gives="a1 a2")
def link_lengths(l1, l2, r1, r2):
    """Distances of the ends of the sliders from the joints of their links."""
    return l1 + r1, l2 + r2


@physics(gives="mu2 sigma")
def moments_of_mass(m2, m3, m4, l2, a2):
    """Mass beyond link 1, and first moment of mass of link 2."""
    return m2 + m3 + m4, m3 * l2 + m4 * a2


@physics(gives="x1 y1 x2 y2 x3 y3 x4 y4")
def points(l1, l2, a1, a2, s1, c1, s2, c2):
    return (
        l1 * c1,  # report 1.1, x1
        l1 * s1,  # report 1.1, y1
        a1 * c1,  # report 1.1, x2
        a1 * s1,  # report 1.1, y2
        a1 * c1 + l2 * c2,  # report 1.1, x3
        a1 * s1 + l2 * s2,  # report 1.1, y3
        a1 * c1 + a2 * c2,  # report 1.1, x4
        a1 * s1 + a2 * s2,  # report 1.1, y4
    )


@physics(gives="J11 J12 J13 J14 J21 J22 J23 J24")
def jacobian(a1, a2, s1, c1, s2, c2):
    return -a1 * s1, c1, -a2 * s2, c2, a1 * c1, s1, a2 * c2, s2  # report eq. (1)


@physics(gives="Jdqd1 Jdqd2")
def jacobian_dot_qd(a1, a2, s1, c1, s2, c2, w1, v1, w2, v2):
    return (
        -2.0 * v1 * w1 * s1 - a1 * w1 * w1 * c1 - 2.0 * v2 * w2 * s2 - a2 * w2 * w2 * c2,
        2.0 * v1 * w1 * c1 - a1 * w1 * w1 * s1 + 2.0 * v2 * w2 * c2 - a2 * w2 * w2 * s2,
    )


@physics(gives="M11 M12 M13 M14 M21 M22 M23 M24 M31 M32 M33 M34 M41 M42 M43 M44")
def mass_matrix(m1, m3, m4, mu2, sigma, l1, l2, a1, a2, s12, c12):
    M11 = m1 * l1 * l1 + mu2 * a1 * a1  # report 1.3, M11
    M13 = a1 * sigma * c12  # report 1.3, M13 = M31
    M14 = -m4 * a1 * s12  # report 1.3, M14 = M41
    M23 = sigma * s12  # report 1.3, M23 = M32
    M24 = m4 * c12  # report 1.3, M24 = M42
    M33 = m3 * l2 * l2 + m4 * a2 * a2  # report 1.3, M33
    return (
        M11, 0.0, M13, M14,  # report 1.3, M12
        0.0, mu2, M23, M24,  # report 1.3, M21, M22
        M13, M23, M33, 0.0,  # report 1.3, M34
        M14, M24, 0.0, m4,  # report 1.3, M43, M44
    )  # fmt: skip


@physics(gives="h1 h2 h3 h4")
def bias_forces(m4, mu2, sigma, a1, a2, s12, c12, w1, v1, w2, v2):
    return (
        # report 1.3, H1 (its last term corrected: r2, not its rate)
        a1 * (2.0 * mu2 * v1 * w1 + sigma * s12 * w2 * w2 + 2.0 * m4 * v2 * w2 * c12),
        -mu2 * a1 * w1 * w1 - sigma * c12 * w2 * w2 + 2.0 * m4 * v2 * w2 * s12,  # report 1.3, H2
        # report 1.3, H3 (a term printed twice, and a factor 2 lost, corrected)
        sigma * (2.0 * v1 * w1 * c12 - a1 * w1 * w1 * s12) + 2.0 * m4 * a2 * v2 * w2,
        -m4 * (a1 * w1 * w1 * c12 + 2.0 * v1 * w1 * s12 + a2 * w2 * w2),  # report 1.3, H4
    )


@physics(gives="C11 C12 C13 C14 C21 C22 C23 C24 C31 C32 C33 C34 C41 C42 C43 C44")
def coriolis_matrix(m4, mu2, sigma, a1, a2, s12, c12, w1, v1, w2, v2):
    """Christoffel form: C qd = h and M' = C + C^T."""
    return (
        mu2 * a1 * v1, mu2 * a1 * w1, a1 * (sigma * w2 * s12 + m4 * v2 * c12), m4 * a1 * w2 * c12,
        -mu2 * a1 * w1, 0.0, -sigma * w2 * c12 + m4 * v2 * s12, m4 * w2 * s12,
        sigma * (v1 * c12 - a1 * w1 * s12), sigma * w1 * c12, m4 * a2 * v2, m4 * a2 * w2,
        -m4 * (v1 * s12 + a1 * w1 * c12), -m4 * w1 * s12, -m4 * a2 * w2, 0.0,
    )  # fmt: skip


@physics(gives="G1 G2 G3 G4")
def gravity_forces(m1, m4, mu2, sigma, l1, a1, s1, c1, s2, c2, ax, ay):
    """dU/dq in the uniform field; the report's G_i at (ax, ay) = (0, g)."""
    return (
        (m1 * l1 + mu2 * a1) * (ay * c1 - ax * s1),  # report 1.3, G1
        mu2 * (ay * s1 + ax * c1),  # report 1.3, G2
        sigma * (ay * c2 - ax * s2),  # report 1.3, G3
        m4 * (ay * s2 + ax * c2),  # report 1.3, G4
    )


@physics(gives="T")
def kinetic_energy(m1, m2, m3, m4, l1, l2, a1, a2, s12, c12, w1, v1, w2, v2):
    """Half of sum m |velocity|^2 (report 1.1, KE), in the frame of each link's direction."""
    e = v1 + l2 * w2 * s12  # mass 3, along link 1
    n = a1 * w1 + l2 * w2 * c12  # mass 3, across link 1
    p = v1 + a2 * w2 * s12 + v2 * c12
    q = a1 * w1 + a2 * w2 * c12 - v2 * s12
    return 0.5 * (
        m1 * (l1 * w1) ** 2 + m2 * ((a1 * w1) ** 2 + v1 * v1) + m3 * (e * e + n * n) + m4 * (p * p + q * q)
    )


@physics(gives="Lz")
def angular_momentum(m1, m3, m4, mu2, sigma, l1, l2, a1, a2, s12, c12, w1, v1, w2, v2):
    """About the base: the sum of the momenta conjugate to theta1 and theta2."""
    I = m3 * l2 * l2 + m4 * a2 * a2
    return (
        (m1 * l1 * l1 + mu2 * a1 * a1) * w1
        + I * w2
        + a1 * sigma * c12 * (w1 + w2)
        + sigma * s12 * v1
        - m4 * a1 * s12 * v2
    )


@physics(gives="manipulability")
def manipulability(a1, a2, s12, c12):
    """sqrt(det J J^T), with r in metres (the columns of J mix units)."""
    return sqrt((a1 * a1 + a2 * a2) * (1.0 + c12 * c12) + (1.0 + a1 * a1 * a2 * a2) * s12 * s12)


@physics(gives="n1 n2 n3 n4")
def column_norms(l1, l2, r1, r2):
    """Norms of the columns of J: metres at the tip per unit of each coordinate."""
    return abs(l1 + r1), 1.0, abs(l2 + r2), 1.0


@physics(gives="W1 W2 W3 W4")
def mobility_bounds(m1, m2, m3, m4, l1, l2):
    """Upper bounds of the joint mobilities, diag(B^T M^-1 B), in every pose; 1/(kg m^2) or 1/kg.

    A mobility is 1 over the least sum of m a^2 with which its joint accelerates by 1 while the
    other joints move freely; each bound leaves out masses or lets them move more freely.
    """
    return (
        1.0 / (m1 * l1 * l1),
        1.0 / m2,
        1.0 / (m1 * l1 * l1) + (1.0 / m2 + 1.0 / m3) / (l2 * l2),
        1.0 / m4 + 1.0 / (m2 + m3),
    )


@physics(gives="inverse_m4 S1 S3 I1 I3 m3m4 S34 m23")
def products_of_masses(m1, m2, m3, m4, l1, l2):
    """The part that depends on masses and lengths alone; S, I: first and second moments of mass; S34 is
    2 m4 S3."""
    return 1.0 / m4, m1 * l1, m3 * l2, m1 * l1 * l1, m3 * l2 * l2, m3 * m4, 2.0 * m4 * m3 * l2, m2 + m3


@physics(gives="qdd1 qdd2 qdd3 qdd4 hold2 hold4")
def held_dynamics(
    m2, m3, m4, inverse_m4, S1, S3, I1, I3, m3m4, a1, a2, r2, s1, c1, s12, c12, w1, v1, w2, v2,
    Q1, Q2, Q3, Q4, ax, ay, held2, held4,
):  # fmt: skip
    """qdd of M qdd + h + G = Q, for M, h and G of ``mass_matrix``, ``bias_forces`` and ``gravity_forces``, by
    O(n) elimination of the second link, then a 2 x 2 system: M is not formed.

    Vectors are in the frame of link 1 (components e along it, n across it). Every pivot (I, Kee, D1) is a sum
    of positive numbers, and terms that would cancel are left out, so no digits are lost at extreme mass
    ratios or in line. All are multiplied by I, and D1 by Kee too, so that no division waits for another.

    A slider with held > 0 is at rest on its link (its rate is 0). The last two results are the
    forces along the sliders that hold them.
    """
    sigma = S3 + m4 * a2
    I = I3 + m4 * a2 * a2
    inverse_I = 1.0 / I
    # Contribution of the second link at the slider: m2 1 + along e2 e2^T + kappa n2 n2^T, kappa I here.
    along = where(held4 > 0.0, m3 + m4, m3)
    kappa = m3m4 * r2 * r2
    Kee = m2 * I + along * I * (c12 * c12) + kappa * (s12 * s12)
    Ken = (kappa - along * I) * (c12 * s12)
    K2 = m2 * I + kappa
    m23 = m2 + along
    squared = w2 * w2
    coriolis = 2.0 * m4 * (v2 * w2)
    pe = where(held4 > 0.0, -sigma * squared, Q4 - S3 * squared)
    pn = sigma * Q3 - S3 * r2 * coriolis  # times I
    fe = I * (Q2 - pe * c12) - pn * s12
    fn = pn * c12 - I * (pe * s12)
    gn = ay * c1 - ax * s1
    be = ax * c1 + ay * s1 - a1 * w1 * w1
    bn = gn + 2.0 * v1 * w1
    Knn = m2 * I + along * I * (s12 * s12) + kappa * (c12 * c12)
    base = Q1 - S1 * gn
    moment = a1 * base + bn * I1
    # The remainder of Kee fn + Ken fe and Knn fe + Ken fn, since Kee Knn - Ken^2 = I m23 K2: the
    # rest cancels, to as many digits as m3 is heavier than the others.
    pull = K2 * pe
    push = m23 * pn
    along_1 = Knn * Q2 - pull * c12 - push * s12
    # Slider 1 takes its share of the second link's pull along link 1, unless it is held.
    share = where(held2 > 0.0, I, Kee)
    across = where(held2 > 0.0, -fn - Ken * be, pull * s12 - push * c12 - Ken * Q2)
    load = where(held2 > 0.0, Knn, m23 * K2)
    inverse_D1 = 1.0 / (I1 * share + a1 * a1 * load)
    qdd1 = (base * share - a1 * (load * bn - across)) * inverse_D1
    # Acceleration of the slider across link 1, a1 qdd1 + bn, and along it.
    y = (moment * share + a1 * a1 * across) * inverse_D1
    x = where(held2 > 0.0, be, (I1 * fe - Ken * moment + a1 * a1 * along_1) * inverse_D1)
    qdd2 = where(held2 > 0.0, 0.0, x - be)
    qdd3 = (Q3 - a2 * coriolis - sigma * (x * s12 + y * c12)) * inverse_I
    along_2 = x * c12 - y * s12
    qdd4 = where(held4 > 0.0, 0.0, Q4 * inverse_m4 + a2 * squared - along_2)
    hold2 = (Kee * x + Ken * y - fe) * inverse_I
    hold4 = m4 * (along_2 - a2 * squared) - Q4
    return qdd1, qdd2, qdd3, qdd4, hold2, hold4


@physics(gives="qdd1 qdd2 qdd3 qdd4")
def forward_dynamics(
    m2, m4, m23, inverse_m4, S1, S3, I1, I3, m3m4, S34, a1, a2, r2, s1, c1, s12, c12, w1, v1, w2, v2,
    Q1, Q2, Q3, Q4, ax, ay,
):  # fmt: skip
    """The same for free sliders with fewer operations, slider 1 in the frame of link 2.

    There the inertia of slider 1, with what the second link adds to it, is m23 along that link and K2/I
    across it, and only link 1 couples the two. x, y: acceleration of slider 1 along and across link 2.
    """
    S4 = m4 * a2
    sigma = S3 + S4
    I = I3 + S4 * a2
    inverse_I = 1.0 / I
    K2 = m2 * I + m3m4 * r2 * r2
    squared = w2 * w2
    coriolis = v2 * w2
    # Forces on slider 1 along link 2, and across it times I, without the one of link 1 across itself.
    along = Q2 * c12 + (S3 * squared - Q4)
    across = I * (Q2 * s12) - (sigma * Q3 - S34 * r2 * coriolis)
    gn = ay * c1 - ax * s1
    be = ax * c1 + ay * s1 - a1 * w1 * w1
    bn = gn + 2.0 * v1 * w1
    base = Q1 - S1 * gn
    # The force of link 1 across itself is eliminated and multiplied out; terms that cancel are left out. The
    # torque on link 1 and the forces on slider 1 turn the arm; the inertia of link 1 lags behind the bias bn.
    Ic = I * c12
    mc = m23 * c12
    a11 = a1 * a1
    inverse_D1 = 1.0 / (I1 * (mc * Ic) + K2 * (I1 * (s12 * s12) + m23 * a11))
    turn_along = s12 * base - a1 * along
    turn_across = Ic * base + a1 * across
    pull = I1 * (Ic * along + s12 * across)
    lag = I1 * bn
    qdd1 = (K2 * (s12 * turn_along - a1 * (m23 * bn)) + mc * turn_across) * inverse_D1
    x = (c12 * pull - K2 * (a1 * turn_along + s12 * lag)) * inverse_D1
    y = (s12 * pull + m23 * (a1 * turn_across + Ic * lag)) * inverse_D1
    return (
        qdd1,
        c12 * x + (s12 * y - be),
        (Q3 - (S4 + S4) * coriolis - sigma * y) * inverse_I,
        a2 * squared + (Q4 * inverse_m4 - x),
    )


@physics(gives="W12 W22 W32 W42 W14 W24 W34 W44")
def slider_mobility(m2, m3, m4, inverse_m4, S1, S3, I1, I3, m3m4, a1, a2, r2, s1, c1, s12, c12):
    """Columns 2 and 4 of M^-1: the change of the velocities by a unit impulse along each slider."""
    W12, W22, W32, W42, _, _ = held_dynamics(
        m2, m3, m4, inverse_m4, S1, S3, I1, I3, m3m4, a1, a2, r2, s1, c1, s12, c12, 0.0, 0.0, 0.0, 0.0,
        0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    )  # fmt: skip
    W14, W24, W34, W44, _, _ = held_dynamics(
        m2, m3, m4, inverse_m4, S1, S3, I1, I3, m3m4, a1, a2, r2, s1, c1, s12, c12, 0.0, 0.0, 0.0, 0.0,
        0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0,
    )  # fmt: skip
    return W12, W22, W32, W42, W14, W24, W34, W44


@dataclass(frozen=True)
class RPRP(Arm):
    """Revolute-prismatic-revolute-prismatic arm, q = (theta1, r1, theta2, r2).

    Parameters
    ----------
    masses : 4 floats
        Point masses at l1, l1 + r1, and (beyond the second joint) l2, l2 + r2, kg.
    lengths : (float, float)
        l1, l2, m.
    """

    joint_types = "RPRP"
    sincos = {"theta1": ("s1", "c1"), "theta12": ("s12", "c12")}
    functions = (
        angle_difference, second_direction, link_lengths, moments_of_mass, points, jacobian, jacobian_dot_qd,
        mass_matrix, bias_forces, coriolis_matrix, gravity_forces, kinetic_energy, angular_momentum,
        manipulability, products_of_masses, forward_dynamics,
    )  # fmt: skip
    prepared = (products_of_masses,)
    column_norms = staticmethod(column_norms)
    mobility_bounds = staticmethod(mobility_bounds)
    held_dynamics = staticmethod(held_dynamics)
    slider_mobility = staticmethod(slider_mobility)
    extent = ("l1", "high2", "l2", "high4")
    posture = {
        "s1": "sine of theta1", "c1": "cosine of theta1",
        "s12": "sine of theta1 - theta2", "c12": "cosine of theta1 - theta2",
    }  # fmt: skip
    description = "A planar revolute-prismatic-revolute-prismatic arm in a vertical plane"
    schematic = """\
    base              m1         m2              m3         m4
     O================#----------O================#----------o  tip
     |<----- l1 ----->|<-- r1 -->|<----- l2 ----->|<-- r2 -->|
    theta1                      theta2"""
