"""Products and sums with one rounding, for processors that have no instruction for it."""

import functools
from typing import Any

from llvmlite import ir

DOUBLE, INT64 = ir.DoubleType(), ir.IntType(64)
SPLITTER = 2.0**27 + 1.0
"""Veltkamp's: a double times it, less the difference, is the upper half of the double."""
LARGEST_FACTOR = 2.0**990
"""Above it :data:`SPLITTER` times a factor overflows."""
MIN_PRODUCT, LARGEST_PRODUCT = 2.0**-960, 2.0**1000
"""Between them the rounding error of a product, and sums with it, are doubles."""


def intrinsic(module: ir.Module, name: str, numbers: ir.VectorType, count: int) -> ir.Function:
    """LLVM's function of ``count`` vectors of doubles that gives another one."""
    whole = f"llvm.{name}.v{numbers.count}f64"
    kind = ir.FunctionType(numbers, [numbers] * count)
    return module.globals.get(whole) or ir.Function(module, kind, whole)


def rounded_once(module: ir.Module, lanes: int, checked: bool) -> ir.Function:
    """A function of this module: x * y + c of vectors, rounded once.

    The product is split into two doubles (Dekker), their sum with c is exact in three, and the last addition
    rounds correctly because the smaller two are rounded to odd before it (Boldo and Melquiond, Emulation of
    FMA and correctly rounded sums, IEEE Transactions on Computers 57, 2008). That holds for factors up to
    :data:`LARGEST_FACTOR` and products from :data:`MIN_PRODUCT` to :data:`LARGEST_PRODUCT`, and if a factor
    is 0; infinities and numbers that are not defined give what two roundings give. Outside, the last bits may
    differ, unless the function is ``checked``: then it calls the library's for a vector with such a lane.
    """
    name = f"rounded_once.v{lanes}f64"
    if name in module.globals:
        return module.globals[name]
    numbers, whole = ir.VectorType(DOUBLE, lanes), ir.VectorType(INT64, lanes)
    function = ir.Function(module, ir.FunctionType(numbers, [numbers] * 3), name)
    function.linkage = "internal"
    set.add(function.attributes, "noinline")
    x, y, c = function.args
    b = ir.IRBuilder(function.append_basic_block())

    def same(k: Any, type_: ir.Type = numbers) -> ir.Constant:
        return ir.Constant(type_, [k] * lanes)

    product = b.fmul(x, y)
    if checked:
        size = intrinsic(module, "fabs", numbers, 1)
        sizes = [b.call(size, [a]) for a in (x, y, product, c)]
        most = (LARGEST_FACTOR, LARGEST_FACTOR, LARGEST_PRODUCT, LARGEST_PRODUCT)
        inside = [b.fcmp_ordered("<", x, same(limit)) for x, limit in zip(sizes, most, strict=True)]
        zero = b.or_(*(b.fcmp_ordered("==", factor, same(0.0)) for factor in (x, y)))
        inside.append(b.or_(zero, b.fcmp_ordered(">", sizes[2], same(MIN_PRODUCT))))
        served = b.bitcast(functools.reduce(b.and_, inside), ir.IntType(lanes))
        with b.if_then(b.icmp_signed("!=", served, ir.Constant(served.type, -1)), likely=False):
            b.ret(b.call(intrinsic(module, "fma", numbers, 3), [x, y, c]))
    (x_high, x_low), (y_high, y_low) = (_halves(b, a, same(SPLITTER)) for a in (x, y))
    error = b.fsub(b.fmul(x_high, y_high), product)
    for first, second in ((x_high, y_low), (x_low, y_high), (x_low, y_low)):
        error = b.fadd(error, b.fmul(first, second))
    upper, lowest = _sum_and_error(b, c, error)
    highest, middle = _sum_and_error(b, product, upper)
    rest, lost = _sum_and_error(b, lowest, middle)
    rest_bits, lost_bits = b.bitcast(rest, whole), b.bitcast(lost, whole)
    inexact = b.fcmp_unordered("!=", lost, same(0.0))
    even = b.icmp_signed("==", b.and_(rest_bits, same(1, whole)), same(0, whole))
    # To odd: an inexact sum whose last bit is even moves by one towards its error, away from 0 if both have
    # the same sign.
    step = b.or_(b.ashr(b.xor(rest_bits, lost_bits), same(63, whole)), same(1, whole))
    odd = b.add(rest_bits, b.select(b.and_(inexact, even), step, same(0, whole)))
    result = b.fadd(highest, b.bitcast(odd, numbers))
    # A zero would lose its sign; sums of infinities are not defined.
    b.ret(b.select(b.fcmp_ordered("!=", result, same(0.0)), result, b.fadd(product, c)))
    return function


def _halves(b: ir.IRBuilder, a: Any, splitter: ir.Constant) -> tuple[Any, Any]:
    """Two numbers of half as many digits whose sum is ``a``."""
    scaled = b.fmul(a, splitter)
    high = b.fsub(scaled, b.fsub(scaled, a))
    return high, b.fsub(a, high)


def _sum_and_error(b: ir.IRBuilder, a: Any, d: Any) -> tuple[Any, Any]:
    """A rounded sum and what it lacks (Knuth)."""
    total = b.fadd(a, d)
    of_d = b.fsub(total, a)
    return total, b.fadd(b.fsub(a, b.fsub(total, of_d)), b.fsub(d, of_d))
