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
        masses = m1, m2, m3, m4 = [p[f"m{k}"] for k in range(1, 5)]
        g, l = p["g"], [p[name] for name in p if name.startswith("l")]
        if robot.kind == "RPRP":  # report 1.1: positions, and PE
            (t1, r1, t2, r2), (l1, l2) = self.q, l
            links = [[(l1, t1)], [(l1 + r1, t1)], [(l1 + r1, t1), (l2, t2)], [(l1 + r1, t1), (l2 + r2, t2)]]
            heights = (m1 + m2 + m3 + m4) * l1 * sp.sin(t1) + (m2 + m3 + m4) * r1 * sp.sin(t1)
            heights += (m3 + m4) * l2 * sp.sin(t2) + m4 * r2 * sp.sin(t2)
        else:  # report 2.1
            links = [list(zip(l[:k], self.q[:k], strict=True)) for k in range(1, 5)]
            heights = sum(sum(masses[k:]) * l[k] * sp.sin(t) for k, t in enumerate(self.q))
        self.U = g * heights
        points = [
            (sum(a * sp.cos(t) for a, t in part), sum(a * sp.sin(t) for a, t in part)) for part in links
        ]
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
        self.random, self.circle, self.values, self.cache = random.Random(seed), {}, {}, {}
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


def test_coriolis_matrix_and_accelerations(derivation, points):
    """C qd = h, M' = C + C^T and M qdd + h + G = Q, exactly."""
    s = derivation.symbols
    for at in points:
        c, h = at(s["C"]), at(derivation.h)
        assert c * at(sp.Matrix(derivation.qd)) == h
        assert c + c.T == at(derivation.Mdot)
        assert at(derivation.M) * at(s["qdd"]) + h + at(derivation.G) == at(sp.Matrix(s["Q"]))


def test_manipulability(derivation, points):
    """manipulability^2 = det J J^T, exactly."""
    w2 = derivation.symbols["manipulability"].args[0]
    assert derivation.symbols["manipulability"] == sp.sqrt(w2)
    for at in points:
        J = at(derivation.J)
        assert at(w2) == (J * J.T).det()
