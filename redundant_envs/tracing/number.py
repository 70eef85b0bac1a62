"""Numbers and conditions that record operations on them in a graph."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Collection
from contextvars import ContextVar
from typing import Any, NoReturn

from redundant_envs import algebra
from redundant_envs.tracing.graph import Graph, Value

EXPONENTS = (2, 3, 4)
deciding: ContextVar[Callable[[Any], bool] | None] = ContextVar("deciding", default=None)
"""Answers conditions while a stretch is run for one of its ways; without it a condition is no bool."""
OPERATORS = ("add", "sub", "mul", "truediv")


def _arithmetic(name: str, swapped: bool = False) -> Callable[[Number, Any], Any]:
    def method(self: Number, other: Any) -> Any:
        if not isinstance(other, Number | float | int):
            return NotImplemented
        if isinstance(other, Number) and other.graph is not self.graph:
            outlives()
        a, b = self.value, value_of(other)
        return Number(self.graph, getattr(self.graph, name)(*((b, a) if swapped else (a, b))))

    return method


def _comparison(name: str) -> Callable[[Number, Any], Any]:
    def method(self: Number, other: Any) -> Any:
        if not isinstance(other, Number | float | int):
            return NotImplemented
        if isinstance(other, Number) and other.graph is not self.graph:
            outlives()
        return Condition(self.graph, self.graph.record(name, self.value, value_of(other)))

    return method


def outlives() -> NoReturn:
    """Refuse a number that was computed before a request of a program and is used after it."""
    raise TypeError(
        "a number outlives a yield of its program, or is of another graph; keep it in a field before "
        "(lane.name = x) and read that after (lane.name)"
    )


def _refuse(what: str, name: str | None = None) -> NoReturn:
    """TypeError that says what to write; ``name`` is that of the function that was called, if it is known."""
    error: Any = TypeError(f"a traced number is no single number: {what}")
    error.name = name
    raise error


def _refused(what: str) -> Callable[..., NoReturn]:
    def method(self: Number, *_: Any) -> NoReturn:
        _refuse(what)

    return method


class Number:
    """A float64 per lane."""

    __slots__ = ("graph", "value")

    def __init__(self, graph: Graph, value: Value) -> None:
        self.graph = graph
        self.value = value

    __add__, __radd__ = _arithmetic("add"), _arithmetic("add", True)
    __sub__, __rsub__ = _arithmetic("subtract"), _arithmetic("subtract", True)
    __mul__, __rmul__ = _arithmetic("multiply"), _arithmetic("multiply", True)
    __truediv__, __rtruediv__ = _arithmetic("divide"), _arithmetic("divide", True)
    __lt__, __le__, __gt__ = _comparison("<"), _comparison("<="), _comparison(">")
    __ge__, __eq__, __ne__ = _comparison(">="), _comparison("=="), _comparison("!=")  # type: ignore[assignment]
    __hash__ = None  # type: ignore[assignment]

    def __pow__(self, exponent: int) -> Number:
        if not isinstance(exponent, int | float) or exponent not in EXPONENTS:
            shown = "no constant" if isinstance(exponent, Number) else repr(exponent)
            raise TypeError(
                f"the exponent is {shown}; write 2, 3 or 4, or a product, 1.0 / x, sqrt(x), exp(k * x)"
            )
        square = self * self
        return {2: square, 3: square * self, 4: square * square}[exponent]  # type: ignore[no-any-return]

    def __neg__(self) -> Number:
        return Number(self.graph, self.graph.record("neg", self.value))

    def __abs__(self) -> Number:
        return Number(self.graph, self.graph.record("abs", self.value))

    def __bool__(self) -> bool:
        _refuse("instead of a branch write where(condition, a, b) or cases(...)")

    def __float__(self) -> float:
        _refuse(
            "use sqrt, exp, floor, minimum, maximum and where of redundant_envs.algebra, not those of math "
            "and NumPy"
        )

    __int__ = __index__ = __float__  # type: ignore[assignment]
    __floordiv__ = __rfloordiv__ = _refused("write floor(a / b) instead of a // b")
    __mod__ = __rmod__ = _refused("write a - b * floor(a / b) instead of a % b")
    __divmod__ = __rdivmod__ = _refused("write floor(a / b) and a - b * floor(a / b) instead of divmod")
    __rpow__ = _refused("write exp(k * x) instead of a**x, with the logarithm k of a")
    __pos__ = _refused("write x instead of +x")
    __matmul__ = __rmatmul__ = _refused("write a sum of products instead of @")

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **_: Any) -> Any:
        """Let a NumPy scalar be an operand on either side."""
        name = {"divide": "truediv", "subtract": "sub", "multiply": "mul"}.get(ufunc.__name__, ufunc.__name__)
        if name in OPERATORS and method == "__call__":
            if any(getattr(x, "ndim", 0) for x in inputs):
                _refuse("it meets an array of NumPy; write a[0] * x, a[1] * x, ... for its entries")
            a, b = (x if isinstance(x, Number) else float(x) for x in inputs)
            return getattr(operator, name)(a, b)
        _refuse(
            f"NumPy's {ufunc.__name__} does not know it; use the functions of redundant_envs.algebra",
            ufunc.__name__,
        )


class Condition:
    """A truth value per lane."""

    __slots__ = ("graph", "value")

    def __init__(self, graph: Graph, value: Value) -> None:
        self.graph = graph
        self.value = value

    def __and__(self, other: Any) -> Any:
        if isinstance(other, bool):
            return self if other else False
        if not isinstance(other, Condition):
            return NotImplemented
        return Condition(self.graph, self.graph.record("and", self.value, other.value))

    def __or__(self, other: Any) -> Any:
        if isinstance(other, bool):
            return True if other else self
        if not isinstance(other, Condition):
            return NotImplemented
        return Condition(self.graph, self.graph.record("or", self.value, other.value))

    __rand__, __ror__ = __and__, __or__

    def __xor__(self, other: Condition) -> Condition:
        return Condition(self.graph, self.graph.record("xor", self.value, other.value))

    def __invert__(self) -> NoReturn:
        _refuse("write logical_not(condition) instead of ~, which turns a Python bool into a number")

    def __eq__(self, other: object) -> Any:
        _refuse("conditions are compared by ^ (exclusive or), & and |")

    __ne__ = __eq__
    __hash__ = None  # type: ignore[assignment]

    def __bool__(self) -> bool:
        answer = deciding.get()
        if answer is None:
            _refuse(
                "write where(condition, a, b), cases(...), and & | logical_not instead of if, and, or, not"
            )
        return answer(self)


def value_of(x: Any) -> Value:
    """The graph's value of a traced or plain number."""
    return x.value if isinstance(x, Number) else float(x)


def _unary(name: str) -> Callable[[Number], Number]:
    return lambda x: Number(x.graph, x.graph.record(name, x.value))


def fma(a: Any, b: Any, c: Any) -> Number:
    """a b + c with one rounding, on every processor."""
    graph = next(x.graph for x in (a, b, c) if isinstance(x, Number))
    return Number(graph, graph.record("fma", value_of(a), value_of(b), value_of(c)))


def negation(x: Condition) -> Condition:
    return Condition(x.graph, x.graph.record("not", x.value))


def where(condition: Condition, a: Any, b: Any) -> Any:
    if not isinstance(condition, Condition):
        raise TypeError("where chooses by a condition, not by a number; compare it first, such as x > 0.0")
    graph = condition.graph
    if isinstance(a, Condition | bool) and isinstance(b, Condition | bool):
        return (condition & a) | (negation(condition) & b)
    return Number(graph, graph.record("select", condition.value, value_of(a), value_of(b)))


def sincos(x: Number) -> tuple[Any, Any]:
    """Sine and cosine to 2.3e-16 for |x| < 1e6 rad, without a branch.

    Cody and Waite's reduction by multiples of pi/2 held in two parts, then the polynomials of
    fdlibm (k_sin.c, k_cos.c) on [-pi/4, pi/4]; the quadrant swaps them and sets the signs.
    """
    if x.graph.whole:
        return _unary("sin")(x), _unary("cos")(x)
    shifted = fma(x, 0.6366197723675814, ROUND)  # 2/pi
    k = shifted - ROUND
    r = fma(-k, 1.5707963267948966, x)
    r = fma(-k, 6.123233995736766e-17, r)
    z = r * r
    s = 2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    s = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * s)
    s = r + r * z * (-1.66666666666666324348e-01 + z * s)
    c = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
    c = -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * c)
    c = fma(z, fma(z, 4.16666666666666019037e-02 + z * c, -0.5), 1.0)
    # The last two bits of the shifted number are those of the quadrant.
    odd, upper = (Condition(x.graph, x.graph.record("bit", shifted.value, extra=bit)) for bit in (1, 2))
    s, c = where(odd, c, s), where(odd, s, c)
    return where(upper, -s, s), where(odd ^ upper, -c, c)


ROUND = 6755399441055744.0
"""1.5 * 2^52: adding it to a float rounds that to a whole number, which the last bits of the sum hold."""


def exp(x: Number) -> Any:
    """Exponential function to one unit in the last place, without a branch.

    Cody and Waite's reduction by multiples of ln 2 held in two parts (fdlibm, e_exp.c), the Taylor polynomial
    of degree 13 on [-ln 2 / 2, ln 2 / 2], and two powers of two, neither of which overflows.
    """
    if x.graph.whole:
        return _unary("exp")(x)
    x = algebra.minimum(algebra.maximum(x, -746.0), 746.0)
    k = fma(x, 1.4426950408889634, ROUND) - ROUND
    r = fma(-k, 6.93147180369123816490e-01, x)
    r = fma(-k, 1.90821492927058770002e-10, r)
    p: Any = 1.0 / math.factorial(13)
    for n in range(12, 1, -1):
        p = 1.0 / math.factorial(n) + r * p
    half = algebra.floor(0.5 * k)
    return (1.0 + (r + r * r * p)) * _power_of_two(half) * _power_of_two(k - half)


def _power_of_two(k: Number) -> Number:
    """2^k for a whole number from -1022 to 1023."""
    return Number(k.graph, k.graph.record("power", (k + ROUND).value))


algebra.register_numbers(
    algebra.Primitives(
        _unary("sqrt"), exp, _unary("floor"), sincos, where, negation
    ),
    Number, Condition,
)  # fmt: skip


class Loads(dict[str, Number]):
    """Numbers that are loaded by their names: those that were asked for, of some or of any names."""

    def __init__(self, names: Collection[str] | None = None) -> None:
        super().__init__()
        self.graph, self.names = Graph(), names

    def __contains__(self, name: object) -> bool:
        return self.names is None or name in self.names

    def __missing__(self, name: str) -> Number:
        self[name] = Number(self.graph, self.graph.load("quantity", name))  # type: ignore[arg-type]
        return self[name]
