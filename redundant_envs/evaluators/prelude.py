"""What compiled modules begin with: the dialect on LLVM values, and the counter-based draws.

A lane function is plain straight-line Python. ``straight_line`` runs it once, at compile time, on
:class:`Number` objects, each operation leaving its vector instruction behind: no typing, no call,
no branch and no loop over lanes is left for the compiler to remove. The text of this file is
copied to the head of every assembled module, so that one hash covers it.
"""

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 8
OPTIONS = {"error_model": "numpy", "fastmath": {"contract"}}
FLAGS = ("contract",)
DOUBLE = ir.DoubleType()
INT64 = ir.IntType(64)


class Number:
    """A float64 of each lane, as the LLVM value that will hold them: a vector, or one double."""

    __slots__ = ("builder", "value")

    def __init__(self, builder, value):
        self.builder = builder
        self.value = value

    def _with(self, operation, other, swapped=False):
        a, b = self.value, _value(other, self.value.type)
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
        other = _value(other, self.value.type)
        return Condition(self.builder, self.builder.fcmp_ordered(how, self.value, other))

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
        value = self.builder.fcmp_unordered("!=", self.value, _value(other, self.value.type))
        return Condition(self.builder, value)

    __hash__ = None


class Condition:
    """A truth value of each lane."""

    __slots__ = ("builder", "value")

    def __init__(self, builder, value):
        self.builder = builder
        self.value = value

    def __and__(self, other):
        return Condition(self.builder, self.builder.and_(self.value, other.value))

    def __or__(self, other):
        return Condition(self.builder, self.builder.or_(self.value, other.value))


def _value(x, type_):
    return x.value if isinstance(x, Number) else _constant(type_, float(x))


def _constant(type_, x):
    """The same number in every lane of a vector, or one number."""
    if isinstance(type_, ir.VectorType):
        return ir.Constant(type_, [x] * type_.count)
    return ir.Constant(type_, x)


def _like(type_, scalar):
    """The type of as many lanes as ``type_`` has, of another scalar type."""
    return ir.VectorType(scalar, type_.count) if isinstance(type_, ir.VectorType) else scalar


def _call(name, *numbers):
    first = next(n for n in numbers if isinstance(n, Number))
    type_ = first.value.type
    suffix = f"v{type_.count}f64" if isinstance(type_, ir.VectorType) else "f64"
    module = first.builder.module
    function = module.globals.get(f"{name}.{suffix}")
    if function is None:
        signature = ir.FunctionType(type_, [type_] * len(numbers))
        function = ir.Function(module, signature, f"{name}.{suffix}")
    return Number(first.builder, first.builder.call(function, [_value(n, type_) for n in numbers]))


def sqrt(x):
    return _call("llvm.sqrt", x)


def exp(x):
    return _call("llvm.exp", x)


def floor(x):
    return _call("llvm.floor", x)


def where(condition, a, b):
    if isinstance(condition, bool):  # of two numbers that are known now
        return a if condition else b
    type_ = _like(condition.value.type, DOUBLE)
    value = condition.builder.select(condition.value, _value(a, type_), _value(b, type_))
    return Number(condition.builder, value)


def minimum(a, b):
    return where(a > b, b, a)


def maximum(a, b):
    return where(a < b, b, a)


def fma(a, b, c):
    """a b + c with one rounding, on every processor."""
    return _call("llvm.fma", a, b, c)


def sincos(x):
    """Sine and cosine to 2.3e-16 for |x| < 1e6 rad, without a branch.

    Cody and Waite's reduction by multiples of pi/2 held in two parts, then the polynomials of
    fdlibm (k_sin.c, k_cos.c) on [-pi/4, pi/4]; the quadrant swaps them and sets the signs.
    """
    builder = x.builder
    bits = _like(x.value.type, INT64)
    shifted = fma(x, 0.6366197723675814, 6755399441055744.0)  # 2/pi, 1.5 * 2^52
    quadrant = builder.bitcast(shifted.value, bits)
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
    one = _constant(bits, 1)
    odd = builder.icmp_signed("!=", builder.and_(quadrant, one), _constant(bits, 0))
    odd = Condition(builder, odd)
    return (
        _signed(where(odd, c, s), quadrant),
        _signed(where(odd, s, c), builder.add(quadrant, one)),
    )


def _signed(x, quadrant):
    """x with its sign flipped if bit 1 of the quadrant is set."""
    builder, bits = x.builder, quadrant.type
    sign = builder.and_(builder.shl(quadrant, _constant(bits, 62)), _constant(bits, -(2**63)))
    flipped = builder.xor(builder.bitcast(x.value, bits), sign)
    return Number(builder, builder.bitcast(flipped, x.value.type))


def straight_line(function, reads, writes, lanes=LANES):
    """Compile a lane function: its arguments are read from rows, its results written to rows.

    The compiled form takes the memory and the index of a block's first number, or with
    ``lanes=1`` of one lane's place in row 0, and treats that many lanes.
    """

    type_ = DOUBLE if lanes == 1 else ir.VectorType(DOUBLE, lanes)

    def body(builder, base):
        def place(row):
            return _pointer(builder, base, row * LANES, type_)

        loaded = (builder.load(place(row), align=8) for row in reads)
        results = function(*(Number(builder, value) for value in loaded))
        results = results if isinstance(results, tuple) else (results,)
        for row, result in zip(writes, results, strict=True):
            builder.store(_value(result, type_), place(row), align=8)

    @intrinsic
    def step(typing_context, memory, index):
        def code(context, builder, signature, arguments):
            base = _entry(context, builder, signature, arguments, 0)
            name = f"lane_function_{function.__name__}"
            callee = builder.module.globals.get(name)
            if callee is None:  # the first of its calls in this module
                callee = ir.Function(builder.module, ir.FunctionType(ir.VoidType(), [base.type]), name)
                callee.linkage = "internal"
                _widen(callee)
                inner = ir.IRBuilder(callee.append_basic_block())
                body(inner, callee.args[0])
                inner.ret_void()
            builder.call(callee, [base])
            return context.get_dummy_value()

        return types.void(memory, index), code

    return step


def _entry(context, builder, signature, arguments, k):
    """Where the entry of array ``k`` lives whose index is the next argument."""
    array = context.make_array(signature.args[k])(context, builder, arguments[k])
    index = arguments[k + 1]
    if signature.args[k].ndim == 2:  # the index is a line's
        index = builder.mul(index, cgutils.unpack_tuple(builder, array.shape)[1])
    return builder.gep(array.data, [index])


def _pointer(builder, base, offset, type_):
    """Where ``offset`` numbers after ``base`` a value of ``type_`` lives."""
    return builder.bitcast(builder.gep(base, [ir.Constant(INT64, offset)]), type_.as_pointer())


def take(rows):
    """Copy a block's lines of a table with as many columns into rows of the memory."""

    @intrinsic
    def copy(typing_context, table, first, memory, index):
        def code(context, builder, signature, arguments):
            source = _entry(context, builder, signature, arguments, 0)
            base = _entry(context, builder, signature, arguments, 2)
            item = source.type.pointee
            columns = len(rows)
            block = ir.VectorType(item, LANES * columns)
            values = builder.load(_pointer(builder, source, 0, block), align=4)
            type_ = ir.VectorType(DOUBLE, LANES)
            for k, row in enumerate(rows):
                chosen = [columns * i + k for i in range(LANES)]
                mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), chosen)
                column = builder.shuffle_vector(values, values, mask)
                if item != DOUBLE:
                    column = builder.fpext(column, type_)
                builder.store(column, _pointer(builder, base, row * LANES, type_), align=8)
            return context.get_dummy_value()

        return types.void(table, first, memory, index), code

    return copy


def give(row):
    """Copy a row of the memory to a block's part of an array; to booleans: whether it is 0.

    To whole numbers it goes as it is: it must hold whole numbers.
    """

    @intrinsic
    def copy(typing_context, memory, index, column, first):
        def code(context, builder, signature, arguments):
            base = _entry(context, builder, signature, arguments, 0)
            target = _entry(context, builder, signature, arguments, 2)
            type_ = ir.VectorType(DOUBLE, LANES)
            values = builder.load(_pointer(builder, base, row * LANES, type_), align=8)
            if signature.args[2].dtype == types.boolean:
                values = builder.fcmp_ordered("==", values, _constant(type_, 0.0))
                values = builder.zext(values, ir.VectorType(ir.IntType(8), LANES))
            elif isinstance(signature.args[2].dtype, types.Integer):
                whole = ir.VectorType(target.type.pointee, LANES)
                values = builder.fptosi(values, whole)
            builder.store(values, _pointer(builder, target, 0, values.type), align=1)
            return context.get_dummy_value()

        return types.void(memory, index, column, first), code

    return copy


def move(rows):
    """Copy some rows of one lane from a place in one memory to a place in another."""

    @intrinsic
    def copy(typing_context, memory, index, target, place):
        def code(context, builder, signature, arguments):
            source = _entry(context, builder, signature, arguments, 0)
            goal = _entry(context, builder, signature, arguments, 2)
            for row in rows:
                value = builder.load(_pointer(builder, source, row * LANES, DOUBLE))
                builder.store(value, _pointer(builder, goal, row * LANES, DOUBLE))
            return context.get_dummy_value()

        return types.void(memory, index, target, place), code

    return copy


def any_set(row):
    """Which lanes of a block have a row that is not 0, as the bits of a number."""

    @intrinsic
    def look(typing_context, memory, index):
        def code(context, builder, signature, arguments):
            base = _entry(context, builder, signature, arguments, 0)
            type_ = ir.VectorType(DOUBLE, LANES)
            values = builder.load(_pointer(builder, base, row * LANES, type_), align=8)
            bits = builder.fcmp_unordered("!=", values, _constant(type_, 0.0))
            return builder.zext(builder.bitcast(bits, ir.IntType(LANES)), INT64)

        return types.int64(memory, index), code

    return look


def _widen(function):
    for attribute in ('"prefer-vector-width"="512"', '"stackrealign"'):
        set.add(function.attributes, attribute)


@intrinsic
def wide_vectors(typing_context):
    """Ask LLVM for full-width vectors, and for an aligned stack to spill them to."""

    def code(context, builder, signature, arguments):
        _widen(builder.function)
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
