"""The equations of motion as the report prints them."""

import numpy as np

from naive.steps import EqualSteps


class PrintedReport(EqualSteps):
    """The report's five wrong terms, as printed."""

    name = "the report as printed"
    longest = 2e-3

    def accelerations(self, arm, q, qd, Q, g=0.0):
        M, h = arm.mass_matrix(q), arm.bias_forces(q, qd)
        _, _, m3, m4 = arm.masses
        if arm.kind == "FourR":
            _, l2, l3, l4 = arm.lengths
            M[..., 2, 2] = (m3 + m4) * l2 * l3 * np.cos(q[..., 2] - q[..., 1])
            h[..., 3] += (m4 - 1.0) * m4 * l3 * l4 * np.sin(q[..., 3] - q[..., 2]) * qd[..., 2] ** 2
        else:
            l1, l2 = arm.lengths
            r1, w1, v1, r2, w2, v2 = (x[..., k] for k in (0, 2) for x in (q[..., 1:], qd, qd[..., 1:]))
            s, c = np.sin(q[..., 0] - q[..., 2]), np.cos(q[..., 0] - q[..., 2])
            h[..., 0] += m4 * s * (v2 - r2) * w2**2 * (l1 + r1)
            h[..., 2] -= m4 * l1 * l2 * s * w1**2 + m4 * l2 * v1 * w1 * c
        return np.linalg.solve(M, (Q - h - arm.gravity_forces(q, g))[..., None])[..., 0]
