"""Numbers and conditions that record operations on them in a graph."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Collection
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, NoReturn

from redundant_envs.compiler.tracing.graph import CONDITIONS, Graph, Value
from redundant_envs.language import algebra

EXPONENTS = (2, 3, 4)
deciding: ContextVar[Callable[[Any], bool] | None] = ContextVar("deciding", default=None)
"""Answers conditions while a stretch is run for one of its ways; without it a condition is no bool."""
OPERATORS = {
    "add": operator.add, "subtract": operator.sub, "multiply": operator.mul, "divide": operator.truediv,
}  # fmt: skip
Method = Callable[..., Any]


def _binary(name: str, swapped: bool = False) -> Method:
    """The operator of numbers that records an operation."""
    compares = name in CONDITIONS

    def method(self: Number, other: Any) -> Any:
        if isinstance(other, Number):
            if other.graph is not self.graph:
                outlives()
            b = other.value
        elif isinstance(other, (float, int)):
            b = float(other)
        else:
            return NotImplemented
        a, b = (b, self.value) if swapped else (self.value, b)
        value = self.graph.combine(name, a, b)
        if type(value) is bool:
            return value
        return Condition(self.graph, value) if compares else Number(self.graph, value)

    return method


def _unary(name: str) -> Method:
    """The function of a number that records an operation."""
    return lambda x: Number(x.graph, x.graph.record(name, x.value))


def _joining(name: str, decisive: bool) -> Method:
    """The operator of conditions that is known if one of them has the decisive value."""

    def method(self: Condition, other: Any) -> Any:
        if isinstance(other, bool):
            return other if other is decisive else self
        if not isinstance(other, Condition):
            return NotImplemented
        return Condition(self.graph, self.graph.record(name, self.value, other.value))

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
    return lambda *_: _refuse(what)


@dataclass(eq=False, repr=False, slots=True)
class Traced:
    """A value of a graph."""

    graph: Graph
    value: Value

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {getattr(self.value, 'name', self.value)}>"


class Number(Traced):
    """A float64 per lane."""

    __slots__ = ()
    __add__, __radd__ = _binary("+"), _binary("+", swapped=True)
    __sub__, __rsub__ = _binary("-"), _binary("-", swapped=True)
    __mul__, __rmul__ = _binary("*"), _binary("*", swapped=True)
    __truediv__, __rtruediv__ = _binary("/"), _binary("/", swapped=True)
    __lt__, __le__, __gt__, __ge__ = _binary("<"), _binary("<="), _binary(">"), _binary(">=")
    __eq__, __ne__ = _binary("=="), _binary("!=")
    __neg__, __abs__ = _unary("neg"), _unary("abs")

    def __pow__(self, exponent: int) -> Number:
        if not isinstance(exponent, int | float) or exponent not in EXPONENTS:
            shown = "no constant" if isinstance(exponent, Number) else repr(exponent)
            raise TypeError(
                f"the exponent is {shown}; write 2, 3 or 4, or a product, 1.0 / x, sqrt(x), exp(k * x)"
            )
        square = self * self
        return {2: square, 3: square * self, 4: square * square}[exponent]  # type: ignore[no-any-return]

    __bool__ = _refused("instead of a branch write where(condition, a, b) or cases(...)")
    __float__ = __int__ = __index__ = _refused(
        "use sqrt, exp, floor, minimum, maximum and where of redundant_envs.algebra, not those of math "
        "and NumPy"
    )
    __floordiv__ = __rfloordiv__ = _refused("write floor(a / b) instead of a // b")
    __mod__ = __rmod__ = _refused("write a - b * floor(a / b) instead of a % b")
    __divmod__ = __rdivmod__ = _refused("write floor(a / b) and a - b * floor(a / b) instead of divmod")
    __rpow__ = _refused("write exp(k * x) instead of a**x, with the logarithm k of a")
    __pos__ = _refused("write x instead of +x")
    __matmul__ = __rmatmul__ = _refused("write a sum of products instead of @")

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **_: Any) -> Any:
        """Let a NumPy scalar be an operand on either side."""
        name = ufunc.__name__
        if name in OPERATORS and method == "__call__":
            if any(getattr(x, "ndim", 0) for x in inputs):
                _refuse("it meets an array of NumPy; write a[0] * x, a[1] * x, ... for its entries")
            return OPERATORS[name](*(x if isinstance(x, Number) else float(x) for x in inputs))
        _refuse(f"NumPy's {name} does not know it; use the functions of redundant_envs.algebra", name)


class Condition(Traced):
    """A truth value per lane."""

    __slots__ = ()
    __and__ = __rand__ = _joining("and", decisive=False)
    __or__ = __ror__ = _joining("or", decisive=True)

    def __xor__(self, other: Condition) -> Condition:
        return Condition(self.graph, self.graph.record("xor", self.value, other.value))

    __invert__ = _refused(
        "write logical_not(condition) instead of ~, which turns a Python bool into a number"
    )
    __eq__ = __ne__ = _refused("conditions are compared by ^ (exclusive or), & and |")

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


def fma(a: Any, b: Any, c: Any) -> Number:
    """a b + c with one rounding, on every processor."""
    graph = next(x.graph for x in (a, b, c) if isinstance(x, Number))
    return Number(graph, graph.record("fma", value_of(a), value_of(b), value_of(c)))


def product(a: Number, b: Number) -> Number:
    """a b, which no sum takes up: parts of a program may share it."""
    return Number(a.graph, a.graph.record("*", a.value, b.value, shared=True))


def negation(x: Condition) -> Condition:
    return Condition(x.graph, x.graph.record("not", x.value))


def where(condition: Condition, a: Any, b: Any) -> Any:
    if not isinstance(condition, Condition):
        raise TypeError("where chooses by a condition, not by a number; compare it first, such as x > 0.0")
    if isinstance(a, Condition | bool) and isinstance(b, Condition | bool):
        return (condition & a) | (negation(condition) & b)
    return Number(condition.graph, condition.graph.choose(condition.value, value_of(a), value_of(b)))


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
    z, rz = product(r, r), product(r, product(r, r))
    s = fma(z, fma(z, 1.58969099521155010221e-10, -2.50507602534068634195e-08), 2.75573137070700676789e-06)
    s = fma(z, fma(z, s, -1.98412698298579493134e-04), 8.33333333332248946124e-03)
    s = fma(rz, fma(z, s, -1.66666666666666324348e-01), r)
    c = fma(z, fma(z, -1.13596475577881948265e-11, 2.08757232129817482790e-09), -2.75573143513906633035e-07)
    c = fma(z, fma(z, c, 2.48015872894767294178e-05), -1.38888888888741095749e-03)
    c = fma(z, fma(z, fma(z, c, 4.16666666666666019037e-02), -0.5), 1.0)
    # The last two bits of the shifted number are those of the quadrant.
    odd, upper = (Condition(x.graph, x.graph.record("bit", shifted.value, extra=k)) for k in (0, 1))
    s, c = where(odd, c, s), where(odd, s, c)
    return where(upper, -s, s), where(odd ^ upper, -c, c)


ROUND = 6755399441055744.0
"""1.5 * 2^52: adding it to a float rounds that to a whole number, which the last bits of the sum hold."""


def exp(x: Number) -> Any:
    """Exponential function to one unit in the last place, without a branch."""
    return _unary("exp")(x) if x.graph.whole else exponential(x, fma, _power_of_two)


def _power_of_two(n: Number) -> Any:
    return _unary("power")(n + ROUND)


def exponential(x: Any, fma: Method, power_of_two: Method) -> Any:
    """Exponential function, by a sum with a product and by powers of two.

    Cody and Waite's reduction by multiples of ln 2 held in two parts (fdlibm, e_exp.c), the Taylor polynomial
    of degree 13 for |r| <= ln 2 / 2, and two powers of two, from -1022 to 1023, neither of which overflows.
    """
    k, more = _reduced(algebra.minimum(algebra.maximum(x, -746.0), 746.0), fma)
    half = algebra.floor(0.5 * k)
    return (1.0 + more) * power_of_two(half) * power_of_two(k - half)


def expm1(x: Number) -> Any:
    """exp(x) - 1 to two units in the last place, without a branch."""
    return _unary("expm1")(x) if x.graph.whole else exponential_less_one(x, fma, _power_of_two)


def exponential_less_one(x: Any, fma: Method, power_of_two: Method) -> Any:
    """exp(x) - 1 by the reduction of :func:`exponential`: 2^k (1 + y) - 1 = 2^k y + (2^k - 1), where y alone
    has to be rounded. It is -1 from -40 on; half of it does not overflow."""
    k, more = _reduced(algebra.minimum(algebra.maximum(x, -40.0), 709.79), fma)
    half = power_of_two(k - 1.0)
    return 2.0 * fma(half, more, half - 0.5)


def _reduced(x: Any, fma: Method) -> tuple[Any, Any]:
    """k and y with exp(x) = 2^k (1 + y)."""
    k = fma(x, 1.4426950408889634, ROUND) - ROUND
    r = fma(-k, 6.93147180369123816490e-01, x)
    r = fma(-k, 1.90821492927058770002e-10, r)
    p: Any = 1.0 / math.factorial(13)
    for n in range(12, 1, -1):
        p = 1.0 / math.factorial(n) + r * p
    return k, r + r * r * p


def log(x: Number) -> Any:
    """Natural logarithm to one unit in the last place, without a branch."""
    if x.graph.whole:
        return _unary("log")(x)
    small = x < SMALLEST_NORMAL
    scaled = where(small, x * NORMALISING, x)  # has a significand of 53 bits
    exponent = _unary("exponent")(scaled) - where(small, NORMALISED, 0.0)
    return logarithm(x, _unary("significand")(scaled), exponent)


SMALLEST_NORMAL = 2.0**-1022
NORMALISED = 54.0
NORMALISING = 2.0**54
"""By which smaller numbers are multiplied, so that they have all their bits."""
SQRT_2 = 1.4142135623730951


def logarithm(x: Any, significand: Any, exponent: Any) -> Any:
    """Natural logarithm of x = significand * 2^exponent, the significand being at least 1 and less than 2.

    fdlibm (e_log.c): with m in (sqrt(1/2), sqrt(2)), f = m - 1 and s = f / (2 + f) the logarithm of m is
    2 s + 2/3 s^3 + ..., whose terms beyond the first are a polynomial; ln 2 is held in two parts.
    """
    large = significand > SQRT_2
    f = algebra.where(large, 0.5 * significand, significand) - 1.0
    k = exponent + algebra.where(large, 1.0, 0.0)
    s = f / (2.0 + f)
    z = s * s
    p: Any = 1.479819860511658591e-01
    for c in (
        1.531383769920937332e-01, 1.818357216161805012e-01, 2.222219843214978396e-01,
        2.857142874366239149e-01, 3.999999999940941908e-01, 6.666666666666735130e-01,
    ):  # fmt: skip
        p = c + z * p
    half_square = 0.5 * f * f
    rest = s * (half_square + z * p) + k * 1.90821492927058770002e-10
    log_x = k * 6.93147180369123816490e-01 - ((half_square - rest) - f)
    log_x = algebra.where(x < math.inf, log_x, math.inf)
    return algebra.where(x > 0.0, log_x, algebra.where(x == 0.0, -math.inf, math.nan))


def philox(*numbers: Any) -> tuple[Number, ...]:
    """Random words, see :func:`algebra.philox`: one operation, whose results are words."""
    graph = next(x.graph for x in numbers if isinstance(x, Number))
    operation = graph.record("philox", *map(value_of, numbers))
    return tuple(Number(graph, graph.record("word", operation, extra=k)) for k in range(4))


algebra.register_numbers(
    algebra.Primitives(_unary("sqrt"), exp, log, _unary("floor"), sincos, where, negation, philox, expm1),
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
