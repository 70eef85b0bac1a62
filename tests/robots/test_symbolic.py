"""The arms against a Lagrange derivation from the report's printed energies.

Both sides are evaluated at random points with 60 digits, and agree to 50: two different expressions do not.
"""

import random

import pytest

import redundant_envs as rde

sp = pytest.importorskip("sympy", reason="sympy is in the extra 'verify'")
import mpmath  # noqa: E402

pytestmark = pytest.mark.long

ROBOTS = {
    "RPRP": rde.RPRP((2.0, 1.5, 1.0, 0.5), (1.0, 0.8)),
    "FourR": rde.FourR((2.0, 1.5, 1.0, 0.5), (1.0, 0.8, 0.6, 0.4)),
    "TwoR": rde.TwoR((2.0, 1.5), (1.0, 0.8)),
}


@pytest.fixture(scope="module", params=ROBOTS)
def sides(request):
    """Expressions of the package by name, and Lagrange's, from printed positions, KE and PE."""
    robot = ROBOTS[request.param]
    own = robot.symbols()
    q, qd, p = own["q"], own["qd"], own["parameters"]
    masses, l = ([x for n, x in p.items() if n.startswith(kind)] for kind in ("m", "l"))

    def rate(expression):
        """Time derivative at constant rates."""
        return sum(sp.diff(expression, x) * w for x, w in zip(q, qd, strict=True))

    if robot.kind == "RPRP":  # report 1.1: positions, and PE
        (t1, r1, t2, r2), (l1, l2), (m1, m2, m3, m4) = q, l, masses
        links = [[(l1, t1)], [(l1 + r1, t1)], [(l1 + r1, t1), (l2, t2)], [(l1 + r1, t1), (l2 + r2, t2)]]
        heights = (m1 + m2 + m3 + m4) * l1 * sp.sin(t1) + (m2 + m3 + m4) * r1 * sp.sin(t1)
        heights += (m3 + m4) * l2 * sp.sin(t2) + m4 * r2 * sp.sin(t2)
    else:  # report 2.1; 2R is its first half
        links = [list(zip(l[:k], q[:k], strict=True)) for k in range(1, len(q) + 1)]
        heights = sum(sum(masses[k:]) * l[k] * sp.sin(t) for k, t in enumerate(q))
    points = [tuple(sum(a * f(t) for a, t in part) for f in (sp.cos, sp.sin)) for part in links]
    moving = [(m, *point, *map(rate, point)) for m, point in zip(masses, points, strict=True)]
    T = sum(m * (vx**2 + vy**2) for m, _, _, vx, vy in moving) / 2
    momenta = [sp.diff(T, w) for w in qd]
    derived = {"T": T, "U": p["g"] * heights, "tip": sp.Matrix(points[-1])}
    derived["M"] = M = sp.Matrix([[sp.diff(p, w) for w in qd] for p in momenta])
    # d/dt (dT/dqd) - dT/dq at qdd = 0
    derived["h"] = sp.Matrix([rate(p) - sp.diff(T, x) for p, x in zip(momenta, q, strict=True)])
    derived["G"] = sp.Matrix([sp.diff(derived["U"], x) for x in q])
    derived["J"] = J = derived["tip"].jacobian(q)
    derived["Jdot_qd"] = J.applyfunc(rate) * sp.Matrix(qd)
    derived["Lz"] = sum(m * (x * vy - y * vx) for m, x, y, vx, vy in moving)
    derived["manipulability"] = sp.sqrt((J * J.T).det())
    # C qd = h, M' = C + C^T and M qdd + h + G = Q
    C = own["C"]
    both = {name: (own[name], expected) for name, expected in derived.items()}
    both |= {"C qd": (C * sp.Matrix(qd), derived["h"]), "C + C^T": (C + C.T, M.applyfunc(rate))}
    both["accelerations"] = M * own["qdd"] + derived["h"] + derived["G"], sp.Matrix(own["Q"])
    return [*q, *qd, *own["Q"], *p.values()], both


NAMES = "M h G tip J Jdot_qd T U Lz manipulability", "C qd", "C + C^T", "accelerations"


@pytest.mark.parametrize("name", [*NAMES[0].split(), *NAMES[1:]])
def test_the_packages_expression_is_the_derived_one(sides, name):
    symbols, both = sides
    one, other = (sp.lambdify(symbols, sp.Matrix([x]), "mpmath") for x in both[name])
    draw = random.Random(7)
    with mpmath.workdps(60):
        for _ in range(6):
            at = [mpmath.mpf(draw.uniform(0.5, 2.0)) for _ in symbols]
            left, right = one(*at), other(*at)
            assert mpmath.mnorm(left - right, "f") <= mpmath.mpf(10) ** -50 * mpmath.mnorm(right, "f")
