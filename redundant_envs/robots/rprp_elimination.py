"""RPRP: accelerations by an O(n) elimination, with sliders free or held, in the notation of ``rprp.py``."""

from __future__ import annotations

from redundant_envs.algebra import physics, where


@physics(gives="inverse_m4 S1 S3 I1 I3 m3m4")
def products_of_masses(m1, m3, m4, l1, l2):
    """The part that depends on masses and lengths alone; S, I: first and second moments of mass."""
    return 1.0 / m4, m1 * l1, m3 * l2, m1 * l1 * l1, m3 * l2 * l2, m3 * m4


@physics
def elimination(
    m2, m3, m4, l1, l2, inverse_m4, S1, S3, I1, I3, m3m4, r1, r2, s1, c1, s12, c12, w1, v1, w2, v2,
    Q1, Q2, Q3, Q4, ax, ay, held2, held4,
):  # fmt: skip
    """O(n) elimination of the second link, then a 2 x 2 system: no mass matrix is formed.

    Vectors are in the frame of link 1 (components e along it, n across it). Every pivot (I, Kee, D1) is a sum
    of positive numbers, and terms that would cancel are left out, so no digits are lost at extreme mass
    ratios or in line. All are multiplied by I, and D1 by Kee too, so that no division waits for another.

    A slider with held > 0 is at rest on its link (its rate is 0). The last two results are the
    forces along the sliders that hold them.
    """
    a = l1 + r1
    b = l2 + r2
    sigma = S3 + m4 * b
    I = I3 + m4 * b * b
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
    be = ax * c1 + ay * s1 - a * w1 * w1
    bn = gn + 2.0 * v1 * w1
    Knn = m2 * I + along * I * (s12 * s12) + kappa * (c12 * c12)
    base = Q1 - S1 * gn
    moment = a * base + bn * I1
    # The remainder of Kee fn + Ken fe and Knn fe + Ken fn, since Kee Knn - Ken^2 = I m23 K2: the
    # rest cancels, to as many digits as m3 is heavier than the others.
    pull = K2 * pe
    push = m23 * pn
    along_1 = Knn * Q2 - pull * c12 - push * s12
    # Slider 1 takes its share of the second link's pull along link 1, unless it is held.
    share = where(held2 > 0.0, I, Kee)
    across = where(held2 > 0.0, -fn - Ken * be, pull * s12 - push * c12 - Ken * Q2)
    load = where(held2 > 0.0, Knn, m23 * K2)
    inverse_D1 = 1.0 / (I1 * share + a * a * load)
    qdd1 = (base * share - a * (load * bn - across)) * inverse_D1
    # Acceleration of the slider across link 1, a qdd1 + bn, and along it.
    y = (moment * share + a * a * across) * inverse_D1
    x = where(held2 > 0.0, be, (I1 * fe - Ken * moment + a * a * along_1) * inverse_D1)
    qdd2 = where(held2 > 0.0, 0.0, x - be)
    qdd3 = (Q3 - b * coriolis - sigma * (x * s12 + y * c12)) * inverse_I
    along_2 = x * c12 - y * s12
    qdd4 = where(held4 > 0.0, 0.0, Q4 * inverse_m4 + b * squared - along_2)
    hold2 = (Kee * x + Ken * y - fe) * inverse_I
    hold4 = m4 * (along_2 - b * squared) - Q4
    return qdd1, qdd2, qdd3, qdd4, hold2, hold4


@physics(gives="qdd1 qdd2 qdd3 qdd4")
def forward_dynamics(
    m2, m3, m4, l1, l2, inverse_m4, S1, S3, I1, I3, m3m4, r1, r2, s1, c1, s12, c12, w1, v1, w2, v2,
    Q1, Q2, Q3, Q4, ax, ay,
):  # fmt: skip
    qdd1, qdd2, qdd3, qdd4, _, _ = elimination(
        m2, m3, m4, l1, l2, inverse_m4, S1, S3, I1, I3, m3m4, r1, r2, s1, c1, s12, c12, w1, v1, w2, v2,
        Q1, Q2, Q3, Q4, ax, ay, 0.0, 0.0,
    )  # fmt: skip
    return qdd1, qdd2, qdd3, qdd4


@physics(gives="qdd1 qdd2 qdd3 qdd4 hold2 hold4")
def held_dynamics(
    m2, m3, m4, l1, l2, inverse_m4, S1, S3, I1, I3, m3m4, r1, r2, s1, c1, s12, c12, w1, v1, w2, v2,
    Q1, Q2, Q3, Q4, ax, ay, held2, held4,
):  # fmt: skip
    """Accelerations while sliders with held > 0 rest on their links, and the forces that hold them [N]."""
    return elimination(
        m2, m3, m4, l1, l2, inverse_m4, S1, S3, I1, I3, m3m4, r1, r2, s1, c1, s12, c12, w1, v1, w2, v2,
        Q1, Q2, Q3, Q4, ax, ay, held2, held4,
    )  # fmt: skip


@physics(gives="W12 W22 W32 W42 W14 W24 W34 W44")
def slider_mobility(m2, m3, m4, l1, l2, inverse_m4, S1, S3, I1, I3, m3m4, r1, r2, s1, c1, s12, c12):
    """Columns 2 and 4 of M^-1: the change of the velocities by a unit impulse along each slider."""
    W12, W22, W32, W42, _, _ = elimination(
        m2, m3, m4, l1, l2, inverse_m4, S1, S3, I1, I3, m3m4, r1, r2, s1, c1, s12, c12, 0.0, 0.0, 0.0, 0.0,
        0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    )  # fmt: skip
    W14, W24, W34, W44, _, _ = elimination(
        m2, m3, m4, l1, l2, inverse_m4, S1, S3, I1, I3, m3m4, r1, r2, s1, c1, s12, c12, 0.0, 0.0, 0.0, 0.0,
        0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0,
    )  # fmt: skip
    return W12, W22, W32, W42, W14, W24, W34, W44
