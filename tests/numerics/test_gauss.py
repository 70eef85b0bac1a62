"""Motions by Gauss-Legendre collocation in mpmath: against known ones, and against the compiled ones."""

import json
from pathlib import Path

import pytest

import redundant_envs as rde
from redundant_envs.effects import CentringSpring, Gravity, ViscousFriction

mpmath = pytest.importorskip("mpmath", reason="mpmath is in the extra 'verify'")

from gauss import STAGES, solve, tableau  # noqa: E402

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


def test_tableau():
    """B(16) and not B(17), C(8) and not C(9), nodes and weights symmetric: order 16 follows."""
    c, b, a, ahead = tableau(34)
    nodes = range(STAGES)
    with mpmath.workdps(40):

        def misses(k):
            quadrature = mpmath.fdot(b, [x ** (k - 1) for x in c]) - mpmath.mpf(1) / k
            stages = [mpmath.fdot(row, [x ** (k - 1) for x in c]) - c[i] ** k / k for i, row in enumerate(a)]
            return abs(quadrature), max(abs(s) for s in stages)

        assert max(misses(k)[0] for k in range(1, 17)) <= 1e-38
        assert max(misses(k)[1] for k in range(1, 9)) <= 1e-38
        assert misses(17)[0] > 1e-11
        assert misses(9)[1] > 1e-7
        assert all(x < y for x, y in zip([0, *c], [*c, 1], strict=True))
        assert max(abs(c[i] + c[-1 - i] - 1) + abs(b[i] - b[-1 - i]) for i in nodes) <= 1e-38
        assert max(abs(a[i][j] + a[-1 - i][-1 - j] - b[j]) for i in nodes for j in nodes) <= 1e-38
        continued = [mpmath.fdot(row, [x**7 for x in c]) - (c[i] + 1) ** 7 for i, row in enumerate(ahead)]
        assert max(abs(x) for x in continued) <= 1e-32


@pytest.mark.parametrize("arm", ARMS)
def test_order_16(arm):
    """Halving the step divides the error by 2^16; in the end two step counts agree to 28 decimals."""
    scene = rde.Scene(ROBOTS[arm], SMOOTH)
    *states, exact = (solve(scene, Q0, QD0, 0.05, n, EFFORTS) for n in (2, 4, 8))
    errors = [difference(state, exact) for state in states]
    assert float(mpmath.log(errors[0] / errors[1], 2)) == pytest.approx(16.0, abs=0.25)
    assert errors[1] <= 1e-28


def test_too_long_steps_are_refused():
    with pytest.raises(ArithmeticError, match="steps is 2;"):
        solve(rde.Scene(ROBOTS["four_r"], SMOOTH), Q0, [20.0 * v for v in QD0], 1.0, 2, digits=20)


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
