"""Lane functions as LLVM instructions: recorded, fused, emitted.

A lane function runs once, at compile time, on :class:`Number` objects whose operations are recorded
in a :class:`Graph`. Little is left for the compiler to choose but registers: which product joins
which sum is decided here, so that bits do not depend on it, and so is the order (order.py).
"""

import math
import operator

from llvmlite import ir

LANES = 8
DOUBLE = ir.DoubleType()
INT64 = ir.IntType(64)
BIT = ir.IntType(1)

LATENCY = {"fdiv": 24, "llvm.sqrt": 32, "llvm.exp": 100, "select": 2}
"""Cycles until a result can be used, of vectors of 8; those of an addition if not listed."""
ADDITION = 4
COMPARISONS = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq
}  # fmt: skip
NO_COST = ("bitcast", "fneg", "and_", "result", "load")
"""They become part of the instructions that use their results, or are only names of values."""


class Number:
    """A float64 of each lane: what the graph holds for it, or one double."""

    __slots__ = ("builder", "value")

    def __init__(self, builder, value):
        self.builder = builder
        self.value = value

    def _with(self, operation, other, swapped=False):
        a, b = self.value, value_of(other, self.value.type)
        if swapped:
            a, b = b, a
        return Number(self.builder, getattr(self.builder, operation)(a, b))

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
        return Number(self.builder, self.builder.fneg(self.value))

    def __abs__(self):
        return call("llvm.fabs", self)

    def _compare(self, how, other):
        other = value_of(other, self.value.type)
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
        value = self.builder.fcmp_unordered("!=", self.value, value_of(other, self.value.type))
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


def value_of(x, type_):
    return x.value if isinstance(x, Number) else constant(type_, float(x))


def constant(type_, x):
    """The same number in every lane of a vector, or one number."""
    if isinstance(type_, ir.VectorType):
        return ir.Constant(type_, [x] * type_.count)
    return ir.Constant(type_, x)


def like(type_, scalar):
    """The type of as many lanes as ``type_`` has, of another scalar type."""
    return ir.VectorType(scalar, type_.count) if isinstance(type_, ir.VectorType) else scalar


def call(name, *numbers):
    """An LLVM intrinsic of some numbers."""
    known = [n for n in numbers if isinstance(n, Number)]
    if not known:  # of literals: a number now
        return float(getattr(math, name.removeprefix("llvm."))(*numbers))
    builder, type_ = known[0].builder, known[0].value.type
    return Number(builder, builder.intrinsic(name, [value_of(n, type_) for n in numbers]))


class Operation:
    """One operation of a graph; ``extra`` is what it needs beside the values of its arguments."""

    __slots__ = ("arguments", "extra", "name", "type")

    def __init__(self, name, arguments, extra, type_):
        self.name = name
        self.arguments = arguments
        self.extra = extra
        self.type = type_

    @property
    def operands(self):
        """Those of its arguments that are operations."""
        return [a for a in self.arguments if isinstance(a, Operation)]

    @property
    def latency(self):
        return 0 if self.name in NO_COST else LATENCY.get(self.name, ADDITION)


def _number_in(value):
    """The number a constant holds in every lane; None of anything else."""
    if not isinstance(value, ir.Constant):
        return None
    number = value.constant
    while isinstance(number, (list, tuple, ir.Constant)):
        number = number.constant if isinstance(number, ir.Constant) else number[0]
    return number if isinstance(number, float) else None


class Graph:
    """Stands where an LLVM builder would, and remembers what it is asked to build."""

    def __init__(self):
        self.known = {}

    def _record(self, name, arguments, extra, type_):
        key = (name, str(extra), *(a if isinstance(a, Operation) else str(a) for a in arguments))
        if key not in self.known:
            self.known[key] = Operation(name, list(arguments), extra, type_)
        return self.known[key]

    def load(self, kind, k, type_):
        """Number ``k`` of a kind of places."""
        return self._record("load", (), (kind, k), type_)

    # What x + (-0), x - 0, x * 1 and x / 1 leave of x is x, bit for bit.

    def fadd(self, a, b):
        for one, other in ((a, b), (b, a)):
            if str(_number_in(one)) == "-0.0":
                return other
        return self._record("fadd", (a, b), None, a.type)

    def fsub(self, a, b):
        return a if str(_number_in(b)) == "0.0" else self._record("fsub", (a, b), None, a.type)

    def fmul(self, a, b):
        for one, other in ((a, b), (b, a)):
            if _number_in(one) == 1.0:
                return other
        return self._record("fmul", (a, b), None, a.type)

    def fdiv(self, a, b):
        return a if _number_in(b) == 1.0 else self._record("fdiv", (a, b), None, a.type)

    def fneg(self, a):
        return self._record("fneg", (a,), None, a.type)

    def fcmp_ordered(self, how, a, b):
        return self._record("fcmp_ordered", (a, b), how, like(a.type, BIT))

    def fcmp_unordered(self, how, a, b):
        return self._record("fcmp_unordered", (a, b), how, like(a.type, BIT))

    def icmp_signed(self, how, a, b):
        return self._record("icmp_signed", (a, b), how, like(a.type, BIT))

    def and_(self, a, b):
        return self._record("and_", (a, b), None, a.type)

    def or_(self, a, b):
        return self._record("or_", (a, b), None, a.type)

    def xor(self, a, b):
        return self._record("xor", (a, b), None, a.type)

    def bitcast(self, a, type_):
        return self._record("bitcast", (a,), type_, type_)

    def select(self, condition, a, b):
        return self._record("select", (condition, a, b), None, a.type)

    def intrinsic(self, name, arguments):
        return self._record(name, arguments, None, arguments[0].type)

    def stage(self, subroutine, arguments):
        """The results of a subroutine, which the graph emits as stages of one step."""
        type_ = arguments[0].type
        made = self._record("stage", arguments, subroutine, type_)
        return [self._record("result", (made,), k, type_) for k in range(subroutine.results)]


def reached(results):
    """All operations that some results need, each after its operands."""
    order, seen = [], set()
    for result in results:
        stack = [(result, False)]
        while stack:
            node, complete = stack.pop()
            if complete:
                order.append(node)
            elif isinstance(node, Operation) and node not in seen:
                seen.add(node)
                stack.append((node, True))
                stack.extend((a, False) for a in reversed(node.operands))
    return order


def fuse(results):
    """Join products that are used once with the sum they go into: one rounding, one instruction.

    Of two products the one that is known later is joined.
    """
    nodes = reached(results)
    uses = dict.fromkeys(nodes, 0)
    for value in [a for n in nodes for a in n.operands] + [r for r in results if isinstance(r, Operation)]:
        uses[value] += 1
    known = {}  # cycles after which a value is there

    def negative(value):
        number = _number_in(value)
        if number is not None:
            return constant(value.type, -number)
        result = Operation("fneg", [value], None, value.type)
        known[result] = known.get(value, 0)
        return result

    for node in nodes:
        products = [
            k
            for k, a in enumerate(node.arguments)
            if isinstance(a, Operation) and a.name == "fmul" and uses[a] == 1
        ]
        if products and node.name in ("fadd", "fsub"):
            k = max(products, key=lambda k: known[node.arguments[k]])
            a, b = node.arguments[k].arguments
            c = node.arguments[1 - k]
            if node.name == "fsub":
                if k == 0:
                    c = negative(c)
                elif _number_in(b) is not None:
                    b = negative(b)
                else:
                    a = negative(a)
            node.name, node.arguments = "llvm.fma", [a, b, c]
        ready = (known.get(a, 0) for a in node.operands)
        known[node] = max(ready, default=0) + node.latency


def specialise(results, known):
    """The results if some rows hold numbers that are known: what these never choose is dropped.

    What was joined stays joined, so the bits are those of the whole function with these numbers.
    """
    numbers, truths = {}, {}
    for node in reached(results):
        node.arguments = [numbers.get(a, a) for a in node.arguments]
        held = [_number_in(a) for a in node.arguments]
        if node.name == "load" and node.extra[0] == "row" and node.extra[1] in known:
            numbers[node] = constant(node.type, known[node.extra[1]])
        elif node.name == "llvm.fabs" and held[0] is not None:
            numbers[node] = constant(node.type, abs(held[0]))
        elif node.name == "fcmp_ordered" and None not in held:
            truths[node] = COMPARISONS[node.extra](*held)
        elif node.name == "select" and node.arguments[0] in truths:
            numbers[node] = node.arguments[1 if truths[node.arguments[0]] else 2]
    return [numbers.get(r, r) for r in results]


class Emitter:
    """Emits the operations of a graph into a block, each when it is first needed."""

    def __init__(self, builder, places, stages=None):
        """``places`` maps kinds of places to functions that emit a load from number k of a type."""
        self.builder = builder
        self.places = places
        self.stages = stages
        self.values = {}

    def value(self, node):
        if not isinstance(node, Operation):
            return node
        if node not in self.values:
            self.values[node] = self._emit(node)
        return self.values[node]

    def _emit(self, node):
        if node.name == "load":
            kind, k = node.extra
            return self.places[kind](k, node.type)
        if node.name == "stage":
            return self.stages.emit(self, node)
        if node.name == "result":
            return self.stages.result(self, node)
        arguments = [self.value(a) for a in node.arguments]
        if node.name.startswith("llvm."):
            function = _intrinsic(self.builder.module, node.name, node.type, len(arguments))
            return self.builder.call(function, arguments)
        build = getattr(self.builder, node.name)
        if node.name in ("fcmp_ordered", "fcmp_unordered", "icmp_signed"):
            return build(node.extra, *arguments)
        return build(*arguments) if node.extra is None else build(*arguments, node.extra)


def _intrinsic(module, name, type_, count):
    suffix = f"v{type_.count}f64" if isinstance(type_, ir.VectorType) else "f64"
    full = f"{name}.{suffix}"
    return module.globals.get(full) or ir.Function(module, ir.FunctionType(type_, [type_] * count), full)


def pointer(builder, base, offset, type_):
    """Where ``offset`` numbers after ``base`` a value of ``type_`` lives."""
    return builder.bitcast(builder.gep(base, [ir.Constant(INT64, offset)]), type_.as_pointer())


def widen(function):
    """Ask LLVM for full-width vectors, and for an aligned stack to spill them to."""
    for attribute in ('"prefer-vector-width"="512"', '"stackrealign"'):
        set.add(function.attributes, attribute)


class Rows:
    """Rows of a memory that begins at ``base``, to be loaded."""

    def __init__(self, builder, base):
        self.builder = builder
        self.base = base

    def __call__(self, row, type_):
        return self.builder.load(pointer(self.builder, self.base, row * LANES, type_), align=8)
