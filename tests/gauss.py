"""Gauss-Legendre collocation of 8 stages (order 16) in mpmath: motions by another family of methods.

In each step the velocity is the polynomial of degree 8 whose derivative at the 8 Gauss points is the
acceleration there. Accelerations come from the dynamics that are compiled, run on mpmath's numbers.
"""

import functools

import exact_numbers  # noqa: F401 - lets mpmath's numbers be numbers
import mpmath
from lanes_of_numbers import constants

from redundant_envs.lane.dynamics import Dynamics

STAGES = 8
GUARD = 6  # decimal digits carried beyond those asked for


@functools.cache
def tableau(digits, n=STAGES):
    """Nodes c, weights b, matrix a, and the matrix that continues stage values into the next step.

    With p_k the Legendre polynomials on [0, 1], Lagrange's are l_j = b_j sum_k (2k + 1) p_k(c_j) p_k,
    and the integral of (2k + 1) p_k from 0 is (p_{k+1} - p_{k-1}) / 2, with p_{-1} = -1.
    """
    with mpmath.workdps(digits + GUARD):
        x = [-mpmath.cos(mpmath.pi * (i + 0.75) / (n + 0.5)) for i in range(n)]
        for _ in range(digits.bit_length() + 2):  # Newton doubles the digits
            p = [[mpmath.legendre(k, z) for k in range(n + 1)] for z in x]
            slopes = [n * (y[n - 1] - z * y[n]) / (1 - z * z) for z, y in zip(x, p, strict=True)]
            x = [z - y[n] / slope for z, y, slope in zip(x, p, slopes, strict=True)]
        b = [1 / (1 - z * z) / slope**2 for z, slope in zip(x, slopes, strict=True)]
        integrals = [[(y[k + 1] - (y[k - 1] if k else -1)) / 2 for k in range(n)] for y in p]
        a = [[w * mpmath.fdot(y[:n], row) for w, y in zip(b, p, strict=True)] for row in integrals]
        ahead = [[mpmath.fprod((y + 2 - w) / (z - w) for w in x if w != z) for z in x] for y in x]
        return [(1 + z) / 2 for z in x], b, a, ahead


def accelerations(scene, efforts):
    """qdd(q, qd) by the equations of motion that each stage of a compiled step has."""
    dynamics = Dynamics(scene)
    numbers = constants(dynamics, mpmath.mpf) | dict(zip(dynamics.commands, efforts, strict=True))
    return lambda q, qd: dynamics.accelerations(dynamics.quantities([*q, *qd], numbers))


def solve(scene, q, qd, duration, steps, efforts=None, digits=34):
    """q and qd after ``duration`` [s] of constant efforts in equal steps, solved to ``digits``."""

    def advanced(x, weights, rates):
        return [y + step * mpmath.fdot(weights, r) for y, r in zip(x, zip(*rates, strict=True), strict=True)]

    _, b, a, ahead = tableau(digits)
    with mpmath.workdps(digits + GUARD):
        given = q, qd, (0,) * 4 if efforts is None else efforts
        q, qd, efforts = ([mpmath.mpf(x) for x in vector] for vector in given)
        acceleration, step = accelerations(scene, efforts), mpmath.mpf(duration) / steps
        forces = [acceleration(q, qd)] * STAGES
        for _ in range(steps):
            for tries in range(61):  # fixed-point iteration: one or two digits each
                before, rates = forces, [advanced(qd, row, forces) for row in a]
                forces = [acceleration(advanced(q, row, rates), v) for row, v in zip(a, rates, strict=True)]
                pairs = [xy for stage in zip(before, forces, strict=True) for xy in zip(*stage, strict=True)]
                change = max(abs(x - y) for x, y in pairs)
                if change <= max(abs(y) for _, y in pairs) / 10**digits:
                    break
                if tries == 60 or not change * step**2 < 1e6:
                    raise ArithmeticError(f"steps is {steps}; the stages do not converge: take more")
            q, qd = advanced(q, b, rates), advanced(qd, b, forces)
            forces = [[mpmath.fdot(row, f) for f in zip(*forces, strict=True)] for row in ahead]
        return q, qd
