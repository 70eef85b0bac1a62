"""Runge-Kutta methods as data."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Tableau:
    """An explicit Runge-Kutta method.

    ``a`` holds the rows of the strictly lower triangular matrix, ``b`` the weights, ``c`` the
    nodes; ``error6``, ``error5`` and ``error3``, where given, are weights of embedded error estimates.
    """

    name: str
    order: int
    a: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]
    c: tuple[float, ...]
    error6: tuple[float, ...] = ()
    error5: tuple[float, ...] = ()
    error3: tuple[float, ...] = ()

    @property
    def stages(self) -> int:
        """Evaluations of the right-hand side per step."""
        return len(self.b)

    def check(self) -> None:
        """ValueError unless this is a consistent explicit method."""
        s = len(self.b)
        rows = [len(row) for row in self.a]
        if not s or len(self.c) != s or len(rows) != s or any(n > k for k, n in enumerate(rows)):
            raise ValueError(
                f"the tableau {self.name!r} has rows of {rows} numbers, {s} weights and {len(self.c)} nodes; "
                "give as many rows and nodes as weights, row k (from 0) with at most k numbers"
            )
        if not isinstance(self.name, str) or not self.name.isidentifier():
            raise ValueError(f"the tableau is called {self.name!r}; give a name of letters and digits")
        if self.error6 or self.error5 or self.error3:
            raise ValueError(
                f"the tableau {self.name!r} gives error weights; only methods of this package may"
            )
        for k, row in enumerate((*self.a, self.b)):
            wanted = 1.0 if k == s else self.c[k]
            if not all(math.isfinite(x) for x in row) or not abs(sum(row) - wanted) <= 1e-12:
                what = "weights" if k == s else f"row {k}"
                raise ValueError(
                    f"the {what} of the tableau {self.name!r} sum to {sum(row)!r}; give {wanted!r}"
                )
        if isinstance(self.order, bool) or not isinstance(self.order, int) or self.order < 1:
            raise ValueError(
                f"the tableau {self.name!r} has the order {self.order!r}; give a whole number from 1 on"
            )

    def overshoot_between_nodes(self, at_ends: bool) -> float:
        """Distances by which a parabola may leave the range of its values at the nodes, in units of that
        range.

        Each is the largest over all positions of its vertex, those nearest to the first or last node and all
        others, found on a grid of positions. 0 for methods with fewer than three nodes, which give no bound.
        """
        if len(set(self.c)) < 3:
            return 0.0
        shares = [0.0]
        for vertex in (k / 1000 for k in range(1001)):
            squares = [(c - vertex) ** 2 for c in self.c]
            least = min(squares)
            if (self.c[squares.index(least)] in (0.0, 1.0)) == at_ends:
                shares.append(least / (max(squares) - least))
        return max(shares)


def difference(nodes: tuple[float, ...], stages: tuple[int, ...]) -> tuple[float, ...]:
    """Weights of the divided difference over some stages, the largest of which is 1 or -1."""
    slopes = dict.fromkeys(range(len(nodes)), 0.0)
    for i in stages:
        slopes[i] = 1.0 / math.prod(nodes[i] - nodes[j] for j in stages if j != i)
    largest = max(abs(w) for w in slopes.values())
    return tuple(w / largest for w in slopes.values())


EULER = Tableau(name="euler", order=1, a=((),), b=(1.0,), c=(0.0,))
"""Semi-implicit: velocities first, positions with the new velocities. Not symplectic here,
because the mass matrix depends on the pose."""

RK4 = Tableau(
    name="rk4",
    order=4,
    a=((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)),
    b=(1 / 6, 1 / 3, 1 / 3, 1 / 6),
    c=(0.0, 0.5, 0.5, 1.0),
)
"""The classical method of order 4."""

# Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd ed., DOP853: the twelve
# stages of the method of order 8 with its estimates of order 5 and 3, in double precision. error6 is the
# sixth difference of the slopes over the stages 1 and 6 to 11, up to a factor the only estimate of order 6
# in these stages (decision record 0017).
_NODES = (
    0.0,
    0.05260015195876773,
    0.0789002279381516,
    0.1183503419072274,
    0.2816496580927726,
    0.3333333333333333,
    0.25,
    0.3076923076923077,
    0.6512820512820513,
    0.6,
    0.8571428571428571,
    1.0,
)
RK8 = Tableau(
    name="rk8",
    order=8,
    a=(
        (),
        (0.05260015195876773,),
        (0.0197250569845379, 0.0591751709536137),
        (0.02958758547680685, 0.0, 0.08876275643042054),
        (0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792),
        (0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242),
        (0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125),
        (
            0.03709200011850479,
            0.0,
            0.0,
            0.17038392571223998,
            0.10726203044637328,
            -0.015319437748624402,
            0.008273789163814023,
        ),
        (
            0.6241109587160757,
            0.0,
            0.0,
            -3.3608926294469414,
            -0.868219346841726,
            27.59209969944671,
            20.154067550477894,
            -43.48988418106996,
        ),
        (
            0.47766253643826434,
            0.0,
            0.0,
            -2.4881146199716677,
            -0.590290826836843,
            21.230051448181193,
            15.279233632882423,
            -33.28821096898486,
            -0.020331201708508627,
        ),
        (
            -0.9371424300859873,
            0.0,
            0.0,
            5.186372428844064,
            1.0914373489967295,
            -8.149787010746927,
            -18.52006565999696,
            22.739487099350505,
            2.4936055526796523,
            -3.0467644718982196,
        ),
        (
            2.273310147516538,
            0.0,
            0.0,
            -10.53449546673725,
            -2.0008720582248625,
            -17.9589318631188,
            27.94888452941996,
            -2.8589982771350235,
            -8.87285693353063,
            12.360567175794303,
            0.6433927460157636,
        ),
    ),
    b=(
        0.054293734116568765,
        0.0,
        0.0,
        0.0,
        0.0,
        4.450312892752409,
        1.8915178993145003,
        -5.801203960010585,
        0.3111643669578199,
        -0.1521609496625161,
        0.20136540080403034,
        0.04471061572777259,
    ),
    c=_NODES,
    error6=difference(_NODES, (0, 5, 6, 7, 8, 9, 10)),
    error5=(
        0.01312004499419488,
        0.0,
        0.0,
        0.0,
        0.0,
        -1.2251564463762044,
        -0.4957589496572502,
        1.6643771824549864,
        -0.35032884874997366,
        0.3341791187130175,
        0.08192320648511571,
        -0.022355307863886294,
    ),
    error3=(
        -0.18980075407240762,
        0.0,
        0.0,
        0.0,
        0.0,
        4.450312892752409,
        1.8915178993145003,
        -5.801203960010585,
        -0.4226823213237919,
        -0.1521609496625161,
        0.20136540080403034,
        0.02265179219836082,
    ),
)

DOP853 = dataclasses.replace(RK8, name="dop853")
"""The same stages; each lane chooses its steps so that their error stays near rounding."""

METHODS: dict[str, Tableau] = {t.name: t for t in (EULER, RK4, RK8, DOP853)}
"""Fixed-step methods by their name in scenes."""
