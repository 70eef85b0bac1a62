"""The five wrong terms that the report prints in the equations of its arms."""

import numpy as np


def misprints(kind, masses, lengths, q, qd):
    """Each as "M" or "h", the indices of its entry, and printed minus right; q and qd have a row for each
    coordinate."""
    *_, m3, m4 = masses
    if kind == "FourR":  # report 2.3
        (_, l2, l3, l4), (_, t2, t3, t4) = lengths, q
        yield "M", (2, 2), (m3 + m4) * (l2 * l3 * np.cos(t3 - t2) - l3**2)
        yield "h", (3,), m4 * l3 * l4 * (m4 - 1.0) * np.sin(t4 - t3) * qd[2] ** 2
    else:  # report 1.3
        (l1, l2), (t1, r1, t2, r2), (t1d, r1d, t2d, r2d) = lengths, q, qd
        s, c = np.sin(t1 - t2), np.cos(t1 - t2)
        yield "h", (0,), (l1 + r1) * m4 * s * (r2d - r2) * t2d**2
        yield "h", (2,), -m4 * l1 * l2 * s * t1d**2
        yield "h", (2,), -m4 * l2 * r1d * t1d * c
