"""What compiled modules begin with: the dialect on LLVM values, and the counter-based draws.

A lane function is plain straight-line Python. ``straight_line`` runs it once, at compile time, on
:class:`Number` objects, each operation leaving its instruction behind: no typing, no call, no
branch is left for the compiler to remove. The text of this file is copied to the head of every
assembled module, so that one hash covers it.
"""

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

LANES = 16
OPTIONS = {"error_model": "numpy", "fastmath": {"contract"}}
FLAGS = ("contract",)
DOUBLE = ir.DoubleType()
INT64 = ir.IntType(64)


class Number:
    """A float64 of one lane, as the LLVM value that will hold it."""

    __slots__ = ("builder", "value")

    def __init__(self, builder, value):
        self.builder = builder
        self.value = value

    def _with(self, operation, other, swapped=False):
        a, b = self.value, _value(other)
        if swapped:
            a, b = b, a
        return Number(self.builder, getattr(self.builder, operation)(a, b, flags=FLAGS))

    def __add__(self, other):
        return self._with("fadd", other)

    def __radd__(self, other):
        return self._with("fadd", other, True)

    def __sub__(self, other):
        return self._with("fsub", other)

    def __rsub__(self, other):
        return self._with("fsub", other, True)

    def __mul__(self, other):
        return self._with("fmul", other)

    def __rmul__(self, other):
        return self._with("fmul", other, True)

    def __truediv__(self, other):
        return self._with("fdiv", other)

    def __rtruediv__(self, other):
        return self._with("fdiv", other, True)

    def __pow__(self, exponent):
        if exponent not in (2, 3, 4):
            raise TypeError(f"the exponent is {exponent!r}; the dialect compiles 2, 3 and 4")
        square = self * self
        return {2: square, 3: square * self, 4: square * square}[exponent]

    def __neg__(self):
        return Number(self.builder, self.builder.fneg(self.value, flags=FLAGS))

    def __abs__(self):
        return _call("llvm.fabs", self)

    def _compare(self, how, other):
        return Condition(self.builder, self.builder.fcmp_ordered(how, self.value, _value(other)))

    def __lt__(self, other):
        return self._compare("<", other)

    def __le__(self, other):
        return self._compare("<=", other)

    def __gt__(self, other):
        return self._compare(">", other)

    def __ge__(self, other):
        return self._compare(">=", other)

    def __eq__(self, other):
        return self._compare("==", other)

    def __ne__(self, other):
        value = self.builder.fcmp_unordered("!=", self.value, _value(other))
        return Condition(self.builder, value)

    __hash__ = None


class Condition:
    """A truth value of one lane."""

    __slots__ = ("builder", "value")

    def __init__(self, builder, value):
        self.builder = builder
        self.value = value

    def __and__(self, other):
        return Condition(self.builder, self.builder.and_(self.value, other.value))

    def __or__(self, other):
        return Condition(self.builder, self.builder.or_(self.value, other.value))


def _value(x):
    return x.value if isinstance(x, Number) else ir.Constant(DOUBLE, float(x))


def _call(name, *numbers):
    builder = next(n.builder for n in numbers if isinstance(n, Number))
    function = builder.module.declare_intrinsic(name, [DOUBLE])
    return Number(builder, builder.call(function, [_value(n) for n in numbers]))


def sqrt(x):
    return _call("llvm.sqrt", x)


def exp(x):
    return _call("llvm.exp", x)


def floor(x):
    return _call("llvm.floor", x)


def where(condition, a, b):
    builder = condition.builder
    return Number(builder, builder.select(condition.value, _value(a), _value(b)))


def minimum(a, b):
    a = a if isinstance(a, Number) else Number(b.builder, _value(a))
    return where((a < b) | (a != a), a, b)


def maximum(a, b):
    a = a if isinstance(a, Number) else Number(b.builder, _value(a))
    return where((a > b) | (a != a), a, b)


def fma(a, b, c):
    """a b + c with one rounding, on every processor."""
    return Number(a.builder, a.builder.fma(a.value, _value(b), _value(c)))


def sincos(x):
    """Sine and cosine to 2.3e-16 for |x| < 1e6 rad, without a branch.

    Cody and Waite's reduction by multiples of pi/2 held in two parts, then the polynomials of
    fdlibm (k_sin.c, k_cos.c) on [-pi/4, pi/4]; the quadrant swaps them and sets the signs.
    """
    builder = x.builder
    shifted = fma(x, 0.6366197723675814, 6755399441055744.0)  # 2/pi, 1.5 * 2^52
    quadrant = builder.bitcast(shifted.value, INT64)
    k = shifted - 6755399441055744.0
    r = fma(-k, 1.5707963267948966, x)
    r = fma(-k, 6.123233995736766e-17, r)
    z = r * r
    s = 2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    s = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * s)
    s = r + r * z * (-1.66666666666666324348e-01 + z * s)
    c = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
    c = -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * c)
    c = (1.0 - 0.5 * z) + z * z * (4.16666666666666019037e-02 + z * c)
    one = ir.Constant(INT64, 1)
    odd = Condition(builder, builder.icmp_signed("!=", builder.and_(quadrant, one), ir.Constant(INT64, 0)))
    return (
        _signed(where(odd, c, s), quadrant),
        _signed(where(odd, s, c), builder.add(quadrant, one)),
    )


def _signed(x, quadrant):
    """x with its sign flipped if bit 1 of the quadrant is set."""
    builder = x.builder
    sign = builder.shl(quadrant, ir.Constant(INT64, 62))
    sign = builder.and_(sign, ir.Constant(INT64, -(2**63)))
    bits = builder.xor(builder.bitcast(x.value, INT64), sign)
    return Number(builder, builder.bitcast(bits, DOUBLE))


def straight_line(function, reads, writes):
    """Compile a lane function: its arguments are read from rows, its results written to rows.

    The compiled form takes the memory and the index of the lane in row 0 of its block.
    """

    @intrinsic
    def lane(typing_context, memory, index):
        def code(context, builder, signature, arguments):
            array = context.make_array(signature.args[0])(context, builder, arguments[0])
            base = builder.gep(array.data, [arguments[1]])

            def place(row):
                return builder.gep(base, [ir.Constant(INT64, row * LANES)])

            results = function(*(Number(builder, builder.load(place(row))) for row in reads))
            results = results if isinstance(results, tuple) else (results,)
            for row, result in zip(writes, results, strict=True):
                builder.store(_value(result), place(row))
            return context.get_dummy_value()

        return types.void(memory, index), code

    return lane


@intrinsic
def wide_vectors(typing_context):
    """Ask LLVM for full-width vectors, and for an aligned stack to spill them to."""

    def code(context, builder, signature, arguments):
        for attribute in ('"prefer-vector-width"="512"', '"stackrealign"'):
            set.add(builder.function.attributes, attribute)
        return context.get_constant(types.int64, 0)

    return types.int64(), code


@njit(**OPTIONS)
def philox(k0, k1, c0, c1, c2, c3):
    """Philox4x32-10 (Salmon et al., SC11): four 32-bit words from a key and a counter."""
    low = np.uint64(0xFFFFFFFF)
    half = np.uint64(32)
    for _ in range(10):
        a = np.uint64(0xD2511F53) * c0
        b = np.uint64(0xCD9E8D57) * c2
        c0 = (b >> half) ^ c1 ^ k0
        c1 = b & low
        c2 = (a >> half) ^ c3 ^ k1
        c3 = a & low
        k0 = (k0 + np.uint64(0x9E3779B9)) & low
        k1 = (k1 + np.uint64(0xBB67AE85)) & low
    return c0, c1, c2, c3


@njit(**OPTIONS)
def uniform(word):
    """A 32-bit word as a float in (0, 1)."""
    return (float(word) + 0.5) * 2.3283064365386963e-10
