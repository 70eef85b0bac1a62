"""What compiled modules begin with: the dialect on LLVM values, and the counter-based draws.

A lane function is plain straight-line Python. ``straight_line`` runs it once, at compile time, on
:class:`Number` objects, which record its operations in a graph; the graph is emitted as vector
instructions: no typing, no call, no branch and no loop over lanes is left for the compiler to
remove. The text of this file, and of those it imports from this package, is copied to the head of
every assembled module, so that one hash covers it.
"""

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from redundant_envs.evaluators.instructions import (
    DOUBLE,
    INT64,
    LANES,
    Condition,
    Graph,
    Number,
    call,
    constant,
    like,
    pointer,
    value_of,
    widen,
)
from redundant_envs.evaluators.stages import emit

BLOCK = ir.VectorType(DOUBLE, LANES)
# No kernel makes an array, so none counts references: a locked instruction for every block.
OPTIONS = {"error_model": "numpy", "_nrt": False}


def sqrt(x):
    return call("llvm.sqrt", x)


def exp(x):
    return call("llvm.exp", x)


def floor(x):
    return call("llvm.floor", x)


def where(condition, a, b):
    if isinstance(condition, bool):  # of two numbers that are known now
        return a if condition else b
    type_ = like(condition.value.type, DOUBLE)
    value = condition.builder.select(condition.value, value_of(a, type_), value_of(b, type_))
    return Number(condition.builder, value)


def minimum(a, b):
    return where(a > b, b, a)


def maximum(a, b):
    return where(a < b, b, a)


def fma(a, b, c):
    """a b + c with one rounding, on every processor."""
    return call("llvm.fma", a, b, c)


def sincos(x):
    """Sine and cosine to 2.3e-16 for |x| < 1e6 rad, without a branch.

    Cody and Waite's reduction by multiples of pi/2 held in two parts, then the polynomials of
    fdlibm (k_sin.c, k_cos.c) on [-pi/4, pi/4]; the quadrant swaps them and sets the signs.
    """
    builder = x.builder
    bits = like(x.value.type, INT64)
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
    c = fma(z, fma(z, 4.16666666666666019037e-02 + z * c, -0.5), 1.0)

    def has(bit):
        masked = builder.and_(quadrant, constant(bits, bit))
        return Condition(builder, builder.icmp_signed("!=", masked, constant(bits, 0)))

    odd, upper = has(1), has(2)
    crossed = Condition(builder, builder.xor(odd.value, upper.value))
    s, c = where(odd, c, s), where(odd, s, c)
    return where(upper, -s, s), where(crossed, -c, c)


def straight_line(function, reads, writes, lanes=LANES, known=None, apart=False):
    """Compile a lane function: its arguments are read from rows, its results written to rows.

    The compiled form takes the memory and the index of a block's first number, or with
    ``lanes=1`` of one lane's place in row 0, and treats that many lanes. If its results belong
    ``apart``, the same follows for where they go. ``known`` maps rows to numbers for a form that
    serves only lanes with these numbers there, faster and to the same bits.
    """

    type_ = DOUBLE if lanes == 1 else BLOCK
    form = "lane_function" if known is None else "special_lane_function"

    def body(builder, base, goal):
        values = _block_values(builder, base, function, reads, type_, known)
        for row, value in zip(writes, values, strict=True):
            builder.store(value, pointer(builder, goal, row * LANES, type_), align=8)

    def code(context, builder, signature, arguments):
        places = [_entry(context, builder, signature, arguments, k) for k in range(0, len(arguments), 2)]
        name = f"{form}_{function.__name__}"
        callee = builder.module.globals.get(name)
        if callee is None:  # the first of its calls in this module
            shape = ir.FunctionType(ir.VoidType(), [p.type for p in places])
            callee = ir.Function(builder.module, shape, name)
            callee.linkage = "internal"
            widen(callee)
            inner = ir.IRBuilder(callee.append_basic_block())
            body(inner, callee.args[0], callee.args[-1])
            inner.ret_void()
        builder.call(callee, places)
        return context.get_dummy_value()

    @intrinsic
    def step(typing_context, memory, index):
        return types.void(memory, index), code

    @intrinsic
    def step_apart(typing_context, memory, index, goal, place):
        return types.void(memory, index, goal, place), code

    return step_apart if apart else step


def _block_values(builder, base, function, reads, type_=BLOCK, known=None):
    """The results of a lane function for the block, or the lane, whose row 0 is at ``base``."""
    graph = Graph()
    results = function(*(Number(graph, graph.load("row", row, type_)) for row in reads))
    results = results if isinstance(results, tuple) else (results,)
    return emit(builder, [value_of(r, type_) for r in results], base, known or {})


def _entry(context, builder, signature, arguments, k):
    """Where the entry of array ``k`` lives whose index is the next argument."""
    array = context.make_array(signature.args[k])(context, builder, arguments[k])
    index = arguments[k + 1]
    if signature.args[k].ndim == 2:  # the index is a line's
        index = builder.mul(index, cgutils.unpack_tuple(builder, array.shape)[1])
    return builder.gep(array.data, [index])


def _copying(emit_copy):
    """A compiled function that copies from an entry of one array to an entry of another."""

    @intrinsic
    def copy(typing_context, source, index, target, place):
        def code(context, builder, signature, arguments):
            entries = (_entry(context, builder, signature, arguments, k) for k in (0, 2))
            emit_copy(builder, *entries)
            return context.get_dummy_value()

        return types.void(source, index, target, place), code

    return copy


def take(rows):
    """Copy a block's lines of a table with as many columns, an even number, into rows of the memory."""

    def shuffled(builder, a, b, chosen):
        mask = ir.Constant(ir.VectorType(ir.IntType(32), len(chosen)), chosen)
        return builder.shuffle_vector(a, b, mask)

    def emit_copy(builder, source, base):
        item, columns, half = source.type.pointee, len(rows), LANES // 2
        lines = ir.VectorType(item, half * columns)
        halves = [builder.load(pointer(builder, source, k * lines.count, lines), align=4) for k in range(2)]
        for k in range(0, columns, 2):
            # Two columns of half a block are one vector, so two shuffles serve each column.
            pair = [columns * i + c for c in (k, k + 1) for i in range(half)]
            a, b = (shuffled(builder, values, values, pair) for values in halves)
            for c in range(2):
                part = list(range(c * half, (c + 1) * half))
                column = shuffled(builder, a, b, [*part, *(LANES + i for i in part)])
                if item != DOUBLE:
                    column = builder.fpext(column, BLOCK)
                builder.store(column, pointer(builder, base, rows[k + c] * LANES, BLOCK), align=8)

    return _copying(emit_copy)


def give(rows):
    """Copy rows of a block to its lines of a flat table of float32 with as many columns, an even number."""

    def emit_copy(builder, base, target):
        column = ir.VectorType(target.type.pointee, LANES)
        for k in range(0, len(rows), 2):
            values = (
                builder.load(pointer(builder, base, r * LANES, BLOCK), align=8) for r in rows[k : k + 2]
            )
            a, b = (builder.fptrunc(v, column) for v in values)
            for i in range(LANES):
                mask = ir.Constant(ir.VectorType(ir.IntType(32), 2), [i, LANES + i])
                pair = builder.shuffle_vector(a, b, mask)
                builder.store(pair, pointer(builder, target, i * len(rows) + k, pair.type), align=4)

    return _copying(emit_copy)


def report(function, reads, writes):
    """A lane function whose first results go to a block's part of arrays, the others to rows.

    Booleans get whether a result is 0; whole numbers get it as it is, so it must be one.
    """

    @intrinsic
    def tell(typing_context, memory, index, columns, first):
        def code(context, builder, signature, arguments):
            base = _entry(context, builder, signature, arguments, 0)
            values = _block_values(builder, base, function, reads)
            count = len(signature.args[2])
            for row, value in zip(writes, values[count:], strict=True):
                builder.store(value, pointer(builder, base, row * LANES, value.type), align=8)
            for k, (type_, value) in enumerate(zip(signature.args[2], values, strict=False)):
                array = context.make_array(type_)(context, builder, builder.extract_value(arguments[2], k))
                if type_.dtype == types.boolean:
                    value = builder.fcmp_ordered("==", value, constant(value.type, 0.0))
                    value = builder.zext(value, ir.VectorType(ir.IntType(8), LANES))
                elif isinstance(type_.dtype, types.Integer):
                    value = builder.fptosi(value, ir.VectorType(array.data.type.pointee, LANES))
                target = builder.gep(array.data, [arguments[3]])
                builder.store(value, pointer(builder, target, 0, value.type), align=1)
            return context.get_dummy_value()

        return types.void(memory, index, columns, first), code

    return tell


def move(rows):
    """Copy some rows of one lane from a place in one memory to a place in another."""

    def emit_copy(builder, source, goal):
        for row in rows:
            value = builder.load(pointer(builder, source, row * LANES, DOUBLE))
            builder.store(value, pointer(builder, goal, row * LANES, DOUBLE))

    return _copying(emit_copy)


def any_set(row):
    """Which lanes of a block have a row that is not 0, as the bits of a number."""

    @intrinsic
    def look(typing_context, memory, index):
        def code(context, builder, signature, arguments):
            base = _entry(context, builder, signature, arguments, 0)
            values = builder.load(pointer(builder, base, row * LANES, BLOCK), align=8)
            bits = builder.fcmp_unordered("!=", values, constant(BLOCK, 0.0))
            return builder.zext(builder.bitcast(bits, ir.IntType(LANES)), INT64)

        return types.int64(memory, index), code

    return look


@intrinsic
def wide_vectors(typing_context):
    """Ask LLVM for full-width vectors, and for an aligned stack to spill them to."""

    def code(context, builder, signature, arguments):
        widen(builder.function)
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
