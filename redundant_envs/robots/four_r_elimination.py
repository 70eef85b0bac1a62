"""4R: accelerations by an O(n) elimination, in the notation of ``four_r.py``."""

from __future__ import annotations

from redundant_envs.algebra import physics


@physics(gives="inverse_l1 inverse_l2 inverse_l3 inverse_l4 inverse_m4 N3")
def products_of_masses(m3, m4, l1, l2, l3, l4):
    """The part of the elimination that depends on masses and lengths alone."""
    return 1.0 / l1, 1.0 / l2, 1.0 / l3, 1.0 / l4, 1.0 / m4, m3 * (m3 + m4)


@physics(gives="qdd1 qdd2 qdd3 qdd4")
def forward_dynamics(
    m1, m2, m3, m4, l1, l2, l3, l4, inverse_l1, inverse_l2, inverse_l3, inverse_l4, inverse_m4,
    N3, s1, c1, s21, c21, s32, c32, s43, c43, w1, w2, w3, w4, Q1, Q2, Q3, Q4, ax, ay,
):  # fmt: skip
    """O(n) elimination, tip to base and back, in the frame of each link: no mass matrix is formed.

    d is the effective inertia along a link, of the link and all beyond it, m + d' s^2 the pivot across
    it, with d' that of the next link: sums of positive numbers. Numerators N and denominators D of
    d = N/D and of the pivots D/D' are formed first, so that no division waits for another.
    """
    f1 = Q1 * inverse_l1
    f2 = Q2 * inverse_l2
    f3 = Q3 * inverse_l3
    f4 = Q4 * inverse_l4
    b1 = -l1 * w1 * w1
    b2 = -l2 * w2 * w2
    b3 = -l3 * w3 * w3
    b4 = -l4 * w4 * w4
    D3 = m3 + m4 * (s43 * s43)
    m34 = m3 + m4
    N2 = m2 * (m2 * D3 + N3)
    D2 = m2 * D3 + N3 * (s32 * s32)
    D1 = m1 * D2 + N2 * (s21 * s21)
    i3 = 1.0 / D3
    inverse_D2 = 1.0 / D2
    i2 = D3 * inverse_D2
    i1 = D2 / D1
    d3 = N3 * i3
    d2 = N2 * inverse_D2
    k3 = m4 * c43
    k2 = d3 * c32
    a2 = f1 - c21 * f2
    a3 = f2 - c32 * f3
    # Tip to base: p is the bias force of all beyond a link along it, f the one across it.
    p4 = m4 * b4
    p3 = d3 * b3 + i3 * (m4 * s43 * (c43 * f3 - f4) + m3 * (c43 * p4 - s43 * f4))
    p2 = d2 * b2 + i2 * (d3 * s32 * (c32 * f2 - f3) + m2 * (c32 * p3 - s32 * f3))
    # Base to tip: (e, n) is the acceleration of a link's near end, y across the link at its far end, P
    # the force along the next link if y were 0: p + k e. With a heavy tip p and k e cancel to as many
    # digits as it is heavier, so P is formed of what they leave; and so are p3 and p2 above.
    n1 = ay * c1 - ax * s1
    e1 = ax * c1 + ay * s1 + b1
    y1 = i1 * (a2 - s21 * (p2 + d2 * (c21 * e1)))
    n2 = c21 * y1 - s21 * e1
    o2 = c21 * e1 + b2
    e2 = o2 + s21 * y1
    r2 = m2 * p3 + i2 * (k2 * s32 * ((m2 + d3) * f3 - k2 * f2))
    P2 = i1 * (m1 * (p3 + k2 * o2) + s21 * (k2 * a2 + s21 * r2))
    y2 = i2 * (a3 - s32 * P2)
    n3 = c32 * y2 - s32 * e2
    o3 = c32 * e2 + b3
    e3 = o3 + s32 * y2
    r3 = m3 * p4 + i3 * (k3 * s43 * (m34 * f4 - k3 * f3))
    P3 = i2 * (m2 * (p4 + k3 * o3) + s32 * (k3 * a3 + s32 * r3))
    y3 = i3 * (f3 - c43 * f4 - s43 * P3)
    n4 = c43 * y3 - s43 * e3
    return (
        (y1 - n1) * inverse_l1,
        (y2 - n2) * inverse_l2,
        (y3 - n3) * inverse_l3,
        (f4 * inverse_m4 - n4) * inverse_l4,
    )
