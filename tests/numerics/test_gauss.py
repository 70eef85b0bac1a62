"""Motions by Gauss-Legendre collocation in mpmath: against known ones, and against the compiled ones."""

import json
from pathlib import Path

import pytest

import redundant_envs as rde
from redundant_envs.effects import CentringSpring, Gravity, ViscousFriction

mpmath = pytest.importorskip("mpmath", reason="mpmath is in the extra 'verify'")

from gauss import solve  # noqa: E402

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
