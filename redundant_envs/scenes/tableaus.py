"""Runge-Kutta methods as data."""

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from redundant_envs.robots.parameters import numbers
from redundant_envs.support.values import shown, whole_number


@dataclass(frozen=True)
class Tableau:
    """An explicit Runge-Kutta method.

    ``a`` holds the rows of the strictly lower triangular matrix, ``b`` the weights, ``c`` the
    nodes; ``error6``, ``error5`` and ``error3``, where given, are weights of embedded error estimates.
    """

    name: str
    order: int
    a: Sequence[Sequence[float]]
    b: Sequence[float]
    c: Sequence[float]
    error6: Sequence[float] = ()
    error5: Sequence[float] = ()
    error3: Sequence[float] = ()

    def __post_init__(self) -> None:
        for field in ("b", "c", "error6", "error5", "error3"):
            object.__setattr__(self, field, numbers(f"Tableau.{field}", getattr(self, field)))
        if not isinstance(self.a, list | tuple | np.ndarray):
            raise ValueError(f"Tableau.a is {shown(self.a)}; give a sequence of rows")
        object.__setattr__(self, "a", tuple(numbers(f"Tableau.a[{k}]", row) for k, row in enumerate(self.a)))

    @property
    def stages(self) -> int:
        """Evaluations of the right-hand side per step."""
        return len(self.b)

    @property
    def middle(self) -> int:
        """Number of the stage whose node is nearest to 1/2."""
        return min(range(self.stages), key=lambda k: abs(self.c[k] - 0.5))

    def check(self) -> None:
        """ValueError unless this is a consistent explicit method."""
        s = len(self.b)
        rows = [len(row) for row in self.a]
        if not s or len(self.c) != s or len(rows) != s or any(n > k for k, n in enumerate(rows)):
            raise ValueError(
                f"the tableau {self.name!r} has rows of {rows} numbers, {s} weights and {len(self.c)} nodes; "
                "give as many, row k (from 0) with at most k numbers"
            )
        if not isinstance(self.name, str) or not self.name.isidentifier():
            raise ValueError(f"the tableau is called {self.name!r}; give a name of letters and digits")
        if self.error6 or self.error5 or self.error3:
            raise ValueError(f"the tableau {self.name!r} gives error weights; leave them out")
        for k, row in enumerate((*self.a, self.b)):
            wanted = 1.0 if k == s else self.c[k]
            if not abs(sum(row) - wanted) <= 1e-12:
                what = "weights" if k == s else f"row {k}"
                raise ValueError(f"{what} of the tableau {self.name!r} sum to {sum(row)!r}, not {wanted!r}")
        whole_number(f"the order of the tableau {self.name!r}", self.order)

    @cached_property
    def overshoots(self) -> tuple[float, ...]:
        """Distances by which a parabola may leave the range of its values at nodes, in units of the range.

        The one of a node is the largest over a grid of positions of the vertex that are nearest to it. All
        are 0 for methods with fewer than three nodes, which give no bound.
        """
        largest = dict.fromkeys(self.c, 0.0)
        if len(largest) >= 3:
            for vertex in (k / 1000 for k in range(1001)):
                squares = {c: (c - vertex) ** 2 for c in self.c}
                nearest = min(squares, key=squares.__getitem__)
                least = squares[nearest]
                largest[nearest] = max(largest[nearest], least / (max(squares.values()) - least))
        return tuple(largest[c] for c in self.c)

    def overshoot_between_nodes(self, at_ends: bool) -> float:
        """The largest overshoot of the first and last node, or of all others."""
        nodes = zip(self.c, self.overshoots, strict=True)
        return max((share for c, share in nodes if (c in (0.0, 1.0)) == at_ends), default=0.0)


EULER = Tableau(name="euler", order=1, a=((),), b=(1.0,), c=(0.0,))
"""Semi-implicit: velocities first, positions with the new velocities. Not symplectic here,
because the mass matrix depends on the pose."""

_ROWS = (), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)
RK4 = Tableau("rk4", 4, _ROWS, (1 / 6, 1 / 3, 1 / 3, 1 / 6), (0.0, 0.5, 0.5, 1.0))
"""The classical method of order 4."""

RK8 = Tableau("rk8", 8, **json.loads(Path(__file__).with_name("dop853.json").read_text()))
"""The twelve stages of DOP853, the method of order 8, with its estimates of order 5 and 3 (Hairer, Norsett,
Wanner, Solving Ordinary Differential Equations I, 2nd ed.). ``error6`` is the sixth divided difference of the
slopes over the stages 1 and 6 to 11, its largest weight 1 or -1, up to a factor the only estimate of order 6
in these stages (docs/design.md)."""

DOP853 = dataclasses.replace(RK8, name="dop853")
"""The same stages; each lane chooses its steps so that their error stays near rounding."""

METHODS: dict[str, Tableau] = {t.name: t for t in (EULER, RK4, RK8, DOP853)}
"""Fixed-step methods by their name in scenes."""
