"""The arms against a Lagrange derivation from the report's printed energies, in exact arithmetic.

Both sides are reduced to polynomials in the sines and cosines of the coordinates and compared at
random rational points of the circle with rational parameters: a difference of exactly zero at
every point. Two different expressions of these degrees agree at one such point with a probability
far below 1e-6.
"""

import random

import pytest

import redundant_envs as rde

sp = pytest.importorskip("sympy", reason="sympy is in the extra 'verify'")

ROBOTS = {
    "RPRP": rde.RPRP((2.0, 1.5, 1.0, 0.5), (1.0, 0.8)),
    "FourR": rde.FourR((2.0, 1.5, 1.0, 0.5), (1.0, 0.8, 0.6, 0.4)),
}
POINTS = 6


class Derivation:
    """Lagrange's equations of one arm from its printed positions, KE and PE."""

    def __init__(self, robot):
        self.symbols = robot.symbols()
        self.q, self.qd = self.symbols["q"], self.symbols["qd"]
        p = self.symbols["parameters"]
        m1, m2, m3, m4, g = p["m1"], p["m2"], p["m3"], p["m4"], p["g"]
        if robot.kind == "RPRP":
            t1, r1, t2, r2 = self.q
            l1, l2 = p["l1"], p["l2"]
            points = [  # report 1.1
                (l1 * sp.cos(t1), l1 * sp.sin(t1)),
                ((l1 + r1) * sp.cos(t1), (l1 + r1) * sp.sin(t1)),
                ((l1 + r1) * sp.cos(t1) + l2 * sp.cos(t2), (l1 + r1) * sp.sin(t1) + l2 * sp.sin(t2)),
                (
                    (l1 + r1) * sp.cos(t1) + (l2 + r2) * sp.cos(t2),
                    (l1 + r1) * sp.sin(t1) + (l2 + r2) * sp.sin(t2),
                ),
            ]
            self.U = (  # report 1.1, PE
                (m1 + m2 + m3 + m4) * g * l1 * sp.sin(t1)
                + (m2 + m3 + m4) * g * r1 * sp.sin(t1)
                + (m3 + m4) * g * l2 * sp.sin(t2)
                + m4 * g * r2 * sp.sin(t2)
            )
        else:
            lengths = [p[f"l{i}"] for i in range(1, 5)]
            points = [  # report 2.1
                (
                    sum(l * sp.cos(t) for l, t in zip(lengths[:k], self.q[:k], strict=True)),
                    sum(l * sp.sin(t) for l, t in zip(lengths[:k], self.q[:k], strict=True)),
                )
                for k in range(1, 5)
            ]
            t1, t2, t3, t4 = self.q
            l1, l2, l3, l4 = lengths
            self.U = (  # report 2.1, PE
                (m1 + m2 + m3 + m4) * g * l1 * sp.sin(t1)
                + (m2 + m3 + m4) * g * l2 * sp.sin(t2)
                + (m3 + m4) * g * l3 * sp.sin(t3)
                + m4 * g * l4 * sp.sin(t4)
            )
        masses = (m1, m2, m3, m4)
        velocities = [tuple(self.rate(x) for x in point) for point in points]
        self.T = sum(m * (vx**2 + vy**2) for m, (vx, vy) in zip(masses, velocities, strict=True)) / 2
        momenta = [sp.diff(self.T, w) for w in self.qd]
        self.M = sp.Matrix([[sp.diff(p, w) for w in self.qd] for p in momenta])
        # d/dt (dT/dqd) - dT/dq at qdd = 0
        self.h = sp.Matrix([self.rate(p) - sp.diff(self.T, x) for p, x in zip(momenta, self.q, strict=True)])
        self.G = sp.Matrix([sp.diff(self.U, x) for x in self.q])
        self.tip = sp.Matrix(points[3])
        self.J = self.tip.jacobian(self.q)
        self.Jdot_qd = self.J.applyfunc(self.rate) * sp.Matrix(self.qd)
        self.Mdot = self.M.applyfunc(self.rate)
        self.Lz = sum(
            m * (x * vy - y * vx) for m, (x, y), (vx, vy) in zip(masses, points, velocities, strict=True)
        )

    def rate(self, expression):
        """Time derivative of an expression in the coordinates, at constant rates."""
        return sum(sp.diff(expression, x) * w for x, w in zip(self.q, self.qd, strict=True))


class ExactPoint:
    """Rational values of everything: angles as rational points of the circle."""

    def __init__(self, symbols, seed):
        self.random = random.Random(seed)
        self.circle = {}
        self.values = {}
        for s in symbols["q"]:
            if s.name.startswith("theta"):
                t = self.rational()
                self.circle[s] = (2 * t / (1 + t**2), (1 - t**2) / (1 + t**2))
            else:
                self.values[s] = self.rational()
        for s in (*symbols["qd"], *symbols["Q"], symbols["parameters"]["g"]):
            self.values[s] = self.rational()
        for s in symbols["parameters"].values():
            self.values.setdefault(s, abs(self.rational()))
        self.cache = {}

    def rational(self):
        """A rational number whose numerator is seldom repeated."""
        return sp.Rational(self.random.choice((-1, 1)) * self.random.randint(1000, 9999), 1009)

    def trig(self, atom):
        """Exact value of a sine or cosine of a sum of whole multiples of the angles."""
        if atom not in self.cache:
            s, c = sp.Integer(0), sp.Integer(1)
            for angle, k in atom.args[0].as_coefficients_dict().items():
                assert k == int(k), atom
                s1, c1 = self.circle[angle]
                for _ in range(abs(int(k))):
                    sk = s1 if k > 0 else -s1
                    s, c = s * c1 + c * sk, c * c1 - s * sk
            self.cache[sp.sin(atom.args[0])] = s
            self.cache[sp.cos(atom.args[0])] = c
            self.cache[atom] = s if isinstance(atom, sp.sin) else c
        return self.cache[atom]

    def __call__(self, expression):
        """The exact rational value of an expression or of every entry of a matrix."""
        if isinstance(expression, sp.MatrixBase):
            return expression.applyfunc(self)
        expression = sp.sympify(expression)
        table = {f: sp.Rational(f) for f in expression.atoms(sp.Float)}
        table.update({a: self.trig(a) for a in expression.atoms(sp.sin, sp.cos)})
        table.update(self.values)
        value = expression.xreplace(table)
        assert value.is_Rational or not value.free_symbols
        return value


@pytest.fixture(scope="module", params=ROBOTS)
def derivation(request):
    return Derivation(ROBOTS[request.param])


@pytest.fixture(scope="module")
def points(derivation):
    return [ExactPoint(derivation.symbols, seed) for seed in range(POINTS)]


@pytest.mark.parametrize("name", ["M", "h", "G", "tip", "J", "Jdot_qd", "T", "U", "Lz"])
def test_identity(derivation, points, name):
    """The package's expression is the derived one, exactly."""
    own, derived = derivation.symbols[name], getattr(derivation, name)
    for at in points:
        difference = at(own) - at(derived)
        zero = difference.is_zero_matrix if isinstance(difference, sp.MatrixBase) else difference == 0
        assert zero, (name, difference)


def test_coriolis_matrix(derivation, points):
    """C qd = h and M' = C + C^T, exactly."""
    C, qd = derivation.symbols["C"], sp.Matrix(derivation.qd)
    for at in points:
        c = at(C)
        assert c * at(qd) == at(derivation.h)
        assert c + c.T == at(derivation.Mdot)


def test_forward_dynamics(derivation, points):
    """The elimination solves M qdd + h + G = Q, exactly."""
    s = derivation.symbols
    Q = sp.Matrix(s["Q"])
    for at in points:
        assert at(derivation.M) * at(s["qdd"]) + at(derivation.h) + at(derivation.G) == at(Q)


def test_manipulability(derivation, points):
    """manipulability^2 = det J J^T, exactly."""
    w2 = derivation.symbols["manipulability"].args[0]
    assert derivation.symbols["manipulability"] == sp.sqrt(w2)
    for at in points:
        J = at(derivation.J)
        assert at(w2) == (J * J.T).det()


def test_the_comparison_sees_each_misprint(derivation, points):
    """Each misprint of the report, put into the package's expressions, makes a difference."""
    p, s = derivation.symbols["parameters"], derivation.symbols
    m3, m4, l1, l2 = p["m3"], p["m4"], p["l1"], p["l2"]
    if len(p) == 4 + 2 + 1:
        t1, r1, t2, r2 = s["q"]
        w1, v1, w2, v2 = s["qd"]
        sin, cos = sp.sin(t1 - t2), sp.cos(t1 - t2)
        deltas = [
            (s["h"][0], derivation.h[0], m4 * (l1 + r1) * sin * w2**2 * (v2 - r2)),
            (s["h"][2], derivation.h[2], -m4 * l1 * l2 * sin * w1**2),
            (s["h"][2], derivation.h[2], -m4 * l2 * v1 * w1 * cos),
        ]
    else:
        _, t2, t3, t4 = s["q"]
        l3, l4, w3 = p["l3"], p["l4"], s["qd"][2]
        deltas = [
            (s["M"][2, 2], derivation.M[2, 2], (m3 + m4) * l3 * (l2 * sp.cos(t3 - t2) - l3)),
            (s["h"][3], derivation.h[3], m4 * (m4 - 1) * l3 * l4 * sp.sin(t4 - t3) * w3**2),
        ]
    for own, derived, delta in deltas:
        for at in points:
            assert at(own) == at(derived)
            assert at(own + delta) != at(derived)
