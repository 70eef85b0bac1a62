"""Motions by Gauss-Legendre collocation of 8 stages (order 16) in mpmath, another family of methods: against
known ones, and against the compiled ones.

In each step the velocity is the polynomial of degree 8 whose derivative at the 8 Gauss points is the
acceleration there. Accelerations come from the dynamics that are compiled, run on mpmath's numbers.
"""

import functools
import json
from pathlib import Path

import pytest

import redundant_envs as rde
from redundant_envs.effects import CentringSpring, Gravity, ViscousFriction
from redundant_envs.lane.dynamics import Dynamics

mpmath = pytest.importorskip("mpmath", reason="mpmath is in the extra 'verify'")

import exact_numbers  # noqa: E402, F401 - lets mpmath's numbers be numbers
from lanes_of_numbers import constants  # noqa: E402

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


FOLDER = Path(__file__).parents[1] / "oracles"
ARMS = {"rprp": rde.RPRP, "four_r": rde.FourR}
MASSES = (2.3, 0.7, 1.9, 0.4)
ROBOTS = {"rprp": rde.RPRP(MASSES, (1.1, 0.6)), "four_r": rde.FourR(MASSES, (1.1, 0.6, 0.9, 0.35))}
SMOOTH = (Gravity(9.81), ViscousFriction((0.3, 0.1, 0.2, 0.05)))
Q0, QD0, EFFORTS = (-1.2, -0.9, -1.8, -0.4), (0.5, -0.3, 0.2, 0.4), (1.5, -0.7, 0.4, 0.2)


def difference(found, other):
    """Largest difference of two states (q, qd), with every digit they have."""
    with mpmath.workdps(50):
        pairs = [xy for vectors in zip(found, other, strict=True) for xy in zip(*vectors, strict=True)]
        return max(abs(mpmath.mpf(x) - mpmath.mpf(y)) for x, y in pairs)


# Steps in [0.1, 0.5] s where 16 do not give every digit.
STEPS = {("four_r", 2): 24, ("four_r", 3): 32, ("four_r", 4): 56}


def runs(arm):
    """The known motions of an arm, their numbers as text."""
    text = (FOLDER / f"traj_{arm}.json").read_text(encoding="utf-8")
    return json.loads(text, parse_float=str)["trajectories"]


@pytest.mark.parametrize(
    ("arm", "number"),
    [pytest.param(a, n, marks=pytest.mark.long if n > 2 else ()) for a in ARMS for n in range(6)],
)
def test_oracle(arm, number):
    """The known states at 0.1 and 0.5 s, to half a unit of their last digit."""
    run = runs(arm)[number]
    m, l, q, qd, Q = (tuple(float(x) for x in run[key]) for key in ("m", "l", "q0", "qd0", "Q"))
    scene = rde.Scene(ARMS[arm](m, l), (Gravity(float(run["g"])),), actuation="generalized")
    for state, duration, steps in zip(
        run["states"], ("0.1", "0.4"), (4, STEPS.get((arm, number), 16)), strict=False
    ):
        q, qd = found = solve(scene, q, qd, duration, steps, Q, digits=20)
        error = difference(found, (state["q"], state["qd"]))
        assert error <= mpmath.mpf("0.5") / 10 ** state["decimals"]
    assert state["t"] == "0.5"


FALL = ("-2.2941618162353746", "-2.4834802323820511", "-2.7634110527282831", "-2.7308771419242488")
WHIRL = ("-5.6234554775619", "9.1694028524103", "2.0051369993462", "-3.7597109257148")


@pytest.mark.parametrize(
    ("q", "qd", "steps", "digits", "published", "most"),
    [
        ([0.0] * 4, [0.0] * 4, 50, 20, FALL, 2e-16),
        pytest.param(
            (0.2, 1.0, -0.5, 2.0), (6.0, -4.0, 8.0, -10.0), 160, 16, WHIRL, 1e-12, marks=pytest.mark.long
        ),
    ],
    ids=["fall from rest", "whirl"],
)
def test_published_motions_after_one_second(q, qd, steps, digits, published, most):
    scene = rde.Scene(rde.FourR((1.0,) * 4, (0.5,) * 4), (Gravity(9.81),))
    assert difference([solve(scene, q, qd, 1.0, steps, digits=digits)[0]], [published]) <= most


@pytest.mark.parametrize("arm", ARMS)
def test_compiled_motion(arm):
    """The compiled rk8 step in float64 follows, with joint efforts, friction and springs."""
    spring = {"rprp": (CentringSpring((30.0, 40.0), (-0.1, -0.2), (0.3, 0.4)),), "four_r": ()}[arm]
    scene = rde.Scene(ROBOTS[arm], (*SMOOTH, *spring), "rk8", 0.005)
    batch = rde.BatchSimulator(scene)
    batch.set_state(Q0, QD0)
    for _ in range(40):
        batch.advance(EFFORTS)
    found = solve(scene, Q0, QD0, 0.2, 8, EFFORTS, digits=20)
    assert difference(found, (batch.q[0], batch.qd[0])) <= 1e-13
