"""Functions of a block of lanes as LLVM functions on vectors of doubles: of all lanes, or the first ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from llvmlite import ir

from redundant_envs.compiler.backends.llvm_fma import intrinsic, rounded_once
from redundant_envs.compiler.backends.processors import Processor
from redundant_envs.compiler.tracing.flow import LaneFunction, Output
from redundant_envs.compiler.tracing.graph import Operation, Value, bits_of, reached
from redundant_envs.compiler.tracing.passes.order import in_order
from redundant_envs.compiler.tracing.passes.simplify import join_products, specialise
from redundant_envs.compiler.tracing.passes.stages import StageResults, Stages
from redundant_envs.language.philox import LOW, philox

DOUBLE, FLOAT = ir.DoubleType(), ir.FloatType()
INT64, INT32, INT8, BIT = ir.IntType(64), ir.IntType(32), ir.IntType(8), ir.IntType(1)
EXPONENT_BIAS, MANTISSA_BITS, SIGN_BIT = 1023, 52, 63
ELEMENT = {"f64": DOUBLE, "f32": FLOAT, "i64": INT64, "u32": INT32, "i8": INT8}
BYTES = {"f64": 8, "f32": 4, "i64": 8, "u32": 4, "i8": 1}
ARITHMETIC = {
    "+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv", "neg": "fneg", "and": "and_", "or": "or_",
    "xor": "xor", "not": "not_", "select": "select",
}  # fmt: skip
WHOLE = 2.0**52
"""The last bits of a float from here to 2^53 are a whole number."""
WHOLE_BITS = (EXPONENT_BIAS + MANTISSA_BITS) << MANTISSA_BITS
"""Its representation."""
INTRINSICS = {"sqrt": "sqrt", "floor": "floor", "abs": "fabs", "fma": "fma"}


def integer(k: int) -> ir.Constant:
    return ir.Constant(INT64, k)


def address(builder: ir.IRBuilder, base: Any, offset: Any, type_: ir.Type) -> Any:
    """Address of a value of a type, ``offset`` elements after ``base``."""
    at = builder.gep(base, [integer(offset) if isinstance(offset, int) else offset])
    return builder.bitcast(at, type_.as_pointer())


class Vectors:
    """Vectors with a number for each of the lanes that a function computes: the first ones of a block, which
    has ``target.lanes`` in memory."""

    def __init__(self, lanes: int, target: Processor) -> None:
        self.lanes, self.width, self.target = lanes, target.lanes, target
        self.numbers = ir.VectorType(DOUBLE, lanes)
        self.truths, self.whole = ir.VectorType(BIT, lanes), ir.VectorType(INT64, lanes)

    def same(self, type_: ir.VectorType, k: float) -> ir.Constant:
        """One constant of a type in all lanes."""
        return ir.Constant(type_, [k] * self.lanes)

    def in_order(self, results: list[Value]) -> list[Operation]:
        """The operations that some results need: for wide processors in our own order."""
        return in_order(results, self.lanes) if self.target.wide else reached(results)

    def load(self, builder: ir.IRBuilder, base: Any, k: int) -> Any:
        """Number k of the lanes."""
        return builder.load(address(builder, base, k * self.width, self.numbers), align=8)

    def store(self, builder: ir.IRBuilder, value: Any, base: Any, k: int) -> None:
        """Store number k of the lanes."""
        builder.store(value, address(builder, base, k * self.width, value.type), align=8)


def compared(builder: ir.IRBuilder, name: str, a: Any, b: Any) -> Any:
    """A comparison of floats: with NaN only != holds."""
    return (builder.fcmp_unordered if name == "!=" else builder.fcmp_ordered)(name, a, b)


def widened(function: ir.Function) -> ir.Function:
    """Ask LLVM for full-width vectors, and for an aligned stack to spill them to."""
    for attribute in ('"prefer-vector-width"="512"', '"stackrealign"'):
        set.add(function.attributes, attribute)
    return function


def internal(
    module: ir.Module, name: str, arguments: dict[Any, ir.Type], result: ir.Type
) -> tuple[ir.IRBuilder, dict[Any, Any]]:
    """A function that only this module calls, to be built, and its arguments; memories do not overlap."""
    function = widened(ir.Function(module, ir.FunctionType(result, list(arguments.values())), name))
    function.linkage = "internal"
    for argument in function.args:
        if isinstance(argument.type, ir.PointerType):
            argument.add_attribute("noalias")
    return ir.IRBuilder(function.append_basic_block()), dict(zip(arguments, function.args, strict=True))


def signature(function: LaneFunction) -> dict[str, ir.Type]:
    """Arguments of the LLVM function: spaces, tables, columns and their strides."""
    arguments = {name: ELEMENT[element].as_pointer() for name, (element, _) in function.inputs.items()}
    arguments |= dict.fromkeys(function.spaces, DOUBLE.as_pointer())
    for output in function.outputs:
        arguments[output.array] = ELEMENT[output.element].as_pointer()
        if not output.columns and output.column:
            arguments[f"{output.array}_stride"] = INT64
    return arguments


@dataclass(eq=False)
class Emitter:
    """Emits the operations of a graph into a block, each when it is first needed."""

    builder: ir.IRBuilder
    load: Callable[[str, int], Any]  # emits the load of number k of a space
    vectors: Vectors
    stages: EmittedStages | None = None
    values: dict[Any, Any] = field(default_factory=dict)  # of operations, and of the bits of constants

    def value(self, node: Value) -> Any:
        key = bits_of(node) if isinstance(node, float) else node
        waiting = [] if key in self.values else [node]
        while waiting:  # a chain may be longer than Python's calls may be deep
            node = waiting[-1]
            missing = [a for a in self._operands(node) if a not in self.values]
            if missing:
                waiting += reversed(missing)
            else:
                waiting.pop()
                now = bits_of(node) if isinstance(node, float) else node
                if now not in self.values:
                    self.values[now] = self._emit(node)
        return self.values[key]

    def _operands(self, node: Value) -> list[Operation]:
        """Operations whose results an operation asks for; stages ask in their own order."""
        is_stage = isinstance(node, Operation) and self.stages and node.name in ("stage", "result")
        return node.operands if isinstance(node, Operation) and not is_stage else []

    def _emit(self, node: Value) -> Any:
        b, v = self.builder, self.vectors
        if isinstance(node, bool):
            return v.same(v.truths, int(node))
        if isinstance(node, float):
            return v.same(v.numbers, node)
        if node.name == "load":
            return self.load(*node.extra)
        if self.stages and node.name in ("stage", "result"):
            return (self.stages.emit if node.name == "stage" else self.stages.result)(self, node)
        if node.name == "philox":
            counter, interval, *key = (WholeNumbers(self, self._word(x)) for x in node.arguments)
            return [w.value for w in philox(key[:2], [counter, interval, *key[2:]])]
        if node.name == "word":
            return self._float(self.value(node.arguments[0])[node.extra])
        arguments = [self.value(a) for a in node.arguments]
        # A condition on a bit of a number is emitted as whole numbers that have it in their signs: on Zen 4
        # comparisons and tests of bits go to the units that multiply, shifts and logic also to others.
        signs = [a.type == v.whole for a in arguments]
        if node.name == "select" and signs[0]:
            return self._selected_by_sign(node, *arguments)
        if any(signs) and not (all(signs) and node.name == "xor"):
            pairs = zip(arguments, signs, strict=True)
            arguments = [b.icmp_signed("<", a, v.same(v.whole, 0)) if sign else a for a, sign in pairs]
        if node.name == "fma" and not v.target.joins:
            return b.call(rounded_once(b.module, v.lanes, checked=not v.target.is_wasm), arguments)
        if node.name in INTRINSICS:
            return b.call(intrinsic(b.module, INTRINSICS[node.name], v.numbers, len(arguments)), arguments)
        if node.name in ARITHMETIC:
            return getattr(b, ARITHMETIC[node.name])(*arguments)
        if node.name == "bit":
            return b.shl(b.bitcast(arguments[0], v.whole), v.same(v.whole, SIGN_BIT - node.extra))
        if node.name == "power":  # power of two, from a whole number to which 1.5 * 2^52 was added
            biased = b.add(b.bitcast(arguments[0], v.whole), v.same(v.whole, EXPONENT_BIAS))
            return b.bitcast(b.shl(biased, v.same(v.whole, MANTISSA_BITS)), v.numbers)
        if node.name == "significand":  # the number with the exponent 0
            bits = b.and_(b.bitcast(arguments[0], v.whole), v.same(v.whole, (1 << MANTISSA_BITS) - 1))
            return b.bitcast(b.or_(bits, v.same(v.whole, EXPONENT_BIAS << MANTISSA_BITS)), v.numbers)
        if node.name == "exponent":  # of a positive number
            bits = b.lshr(b.bitcast(arguments[0], v.whole), v.same(v.whole, MANTISSA_BITS))
            return b.fsub(self._float(bits), v.same(v.numbers, float(EXPONENT_BIAS)))
        return compared(b, node.name, *arguments)

    def _float(self, whole: Any) -> Any:
        """Whole numbers from 0 to 2^52 as floats: not every processor has an instruction for it."""
        b, v = self.builder, self.vectors
        shifted = b.or_(whole, v.same(v.whole, WHOLE_BITS))
        return b.fsub(b.bitcast(shifted, v.numbers), v.same(v.numbers, WHOLE))

    def _word(self, number: Value) -> Any:
        """A whole number up to 2^52 as its last 32 bits."""
        b, v = self.builder, self.vectors
        if isinstance(number, float):
            return v.same(v.whole, int(number) & LOW)
        bits = b.bitcast(b.fadd(self.value(number), v.same(v.numbers, WHOLE)), v.whole)
        return b.and_(bits, v.same(v.whole, LOW))

    def _selected_by_sign(self, node: Operation, signs: Any, a: Any, b: Any) -> Any:
        """``a`` where the sign is set, else ``b``."""
        builder, v = self.builder, self.vectors
        _, first, second = node.arguments
        x, y = (builder.bitcast(value, v.whole) for value in (a, b))
        if isinstance(first, Operation) and first.name == "neg" and first.arguments[0] is second:
            chosen = builder.xor(y, builder.and_(signs, v.same(v.whole, -(1 << SIGN_BIT))))
        else:
            everywhere = builder.ashr(signs, v.same(v.whole, SIGN_BIT))
            chosen = builder.or_(builder.and_(x, everywhere), builder.and_(y, builder.not_(everywhere)))
        return builder.bitcast(chosen, v.numbers)


def _operator(instruction: str) -> Callable[[WholeNumbers, Any], WholeNumbers]:
    def method(self: WholeNumbers, other: Any) -> WholeNumbers:
        vectors, builder = self.emitter.vectors, self.emitter.builder
        second = other.value if isinstance(other, WholeNumbers) else vectors.same(vectors.whole, other)
        return WholeNumbers(self.emitter, getattr(builder, instruction)(self.value, second))

    return method


@dataclass(eq=False)
class WholeNumbers:
    """Vectors of whole numbers with operators, as the text of a generator needs them."""

    emitter: Emitter
    value: Any

    __add__, __mul__, __rshift__ = _operator("add"), _operator("mul"), _operator("lshr")
    __and__, __xor__ = _operator("and_"), _operator("xor")


class EmittedStages:
    """The functions that the stages of a step call, and the calls."""

    def __init__(self, stages: Stages, caller: ir.Function, spaces: dict[str, Any], vectors: Vectors) -> None:
        self.stages, self.vectors = stages, vectors
        # Pointers that no part uses would take registers from those that all parts use.
        values = [v for p in stages.parts.values() for v in (*p.returned, *(v for _, _, v in p.stores))]
        read = {n.extra[0] for n in reached(values) if n.name == "load"}
        self.spaces = {name: base for name, base in spaces.items() if name in read}
        self.returned = ir.LiteralStructType([vectors.numbers] * len(stages.returned))
        self.functions = {n: self._function(caller, n, part) for n, part in stages.parts.items()}
        self.memory: dict[str, Any] = {}

    def _function(self, caller: ir.Function, name: str, part: StageResults) -> ir.Function:
        """An LLVM function: spaces of the lanes, memories of the calls, arguments."""
        result = self.returned if part.returned else ir.VoidType()
        pointers = [*self.spaces, "shared", "kept", "before", "after", "told"]
        arguments = dict.fromkeys(pointers, DOUBLE.as_pointer())
        arguments |= dict.fromkeys(self.stages.passed, self.vectors.numbers)
        builder, values = internal(caller.module, f"{caller.name}_{name}_stage", arguments, result)
        set.add(builder.function.attributes, "noinline")

        def load(space: str, k: int) -> Any:
            return values[k] if space == "given" else self.vectors.load(builder, values[space], k)

        emitter = Emitter(builder, load, self.vectors)
        places: dict[Any, list[tuple[str, int]]] = {}
        for space, k, value in part.stores:
            places.setdefault(value, []).append((space, k))
        for node in [*self.vectors.in_order([*part.returned, *(v for _, _, v in part.stores)]), *places]:
            emitted = emitter.value(node)
            for space, k in places.pop(node, ()):  # at once, so that it needs no register
                self.vectors.store(builder, emitted, values[space], k)
        if not part.returned:
            builder.ret_void()
            return builder.function
        returned: Any = ir.Constant(result, ir.Undefined)
        for k, r in enumerate(part.returned):
            returned = builder.insert_value(returned, emitter.value(r), k)
        builder.ret(returned)
        return builder.function

    def emit(self, emitter: Emitter, node: Operation) -> Any:
        """The call of a stage; the first is preceded by the earlier part of its own."""
        stages, b = self.stages, emitter.builder
        if not self.memory:
            carried, spilled = len(stages.carried), len(stages.spilled) * len(stages.calls)
            sizes = [len(stages.shared), max(stages.in_memory, default=0) + 1, carried, carried, spilled]
            names = ("shared", "kept", "even", "odd", "told")
            self.memory = {name: self._memory(b, n) for name, n in zip(names, sizes, strict=True)}
            for j, k in stages.in_memory.items():
                self.vectors.store(b, emitter.value(node.arguments[k]), self.memory["kept"], j)
            self._call(emitter, -1)
        return self._call(emitter, stages.calls.index(node))

    def _memory(self, builder: ir.IRBuilder, vectors: int) -> Any:
        memory = builder.alloca(DOUBLE, ir.Constant(INT32, self.vectors.width * max(1, vectors)))
        memory.align = 8 * self.vectors.width  # a vector that straddles cache lines is read twice
        return memory

    def _spilled(self, builder: ir.IRBuilder, call: int) -> Any:
        """Address for the results that a call does not return."""
        width = self.vectors.width * len(self.stages.spilled)
        return builder.gep(self.memory["told"], [integer(width * call)])

    def _call(self, emitter: Emitter, number: int) -> Any:
        """Call the later part of a stage, but for number -1, with the earlier part of the next, if any."""
        stages, calls = self.stages, dict(enumerate(self.stages.calls))
        present, upcoming = calls.get(number), calls.get(number + 1)
        part = "first" if present is None else "last" if upcoming is None else "middle"
        values = []
        for k in stages.passed:
            stage = upcoming if k < stages.subroutine.positions else present
            missing = ir.Constant(self.vectors.numbers, ir.Undefined)
            values.append(emitter.value(stage.arguments[k]) if stage else missing)
        before, after = ("odd", "even") if number % 2 else ("even", "odd")
        spill = self._spilled(emitter.builder, max(number, 0))
        memories = [self.memory[n] for n in ("shared", "kept", before, after)]
        return emitter.builder.call(self.functions[part], [*self.spaces.values(), *memories, spill, *values])

    def result(self, emitter: Emitter, node: Operation) -> Any:
        """A result of a stage: returned by the call, written to memory, or known without the call."""
        stages = self.stages
        (stage,), k = node.arguments, stages.first[node.extra]
        value = emitter.value(stage)
        if k in stages.returned:
            return emitter.builder.extract_value(value, stages.returned.index(k))
        if k in stages.spilled:
            place = self._spilled(emitter.builder, stages.calls.index(stage))
            return self.vectors.load(emitter.builder, place, stages.spilled.index(k))
        return emitter.value(stages.results[k])


def emit_lane_function(module: ir.Module, function: LaneFunction, vectors: Vectors) -> ir.Function:
    """The LLVM function of a lane function; for wide processors its instructions are in our own order."""
    if function.whole_blocks:
        vectors = Vectors(vectors.width, vectors.target)
    results = function.results
    if function.joins:
        join_products(results, function.aside_results)
    calls = [n for n in reached(results) if n.name == "stage"]
    stages = Stages(calls, function.spaces, function.known) if calls else None
    results = specialise(results, function.known)
    builder, bases = internal(module, f"lanes_{function.name}", signature(function), ir.VoidType())
    tables = {n: _columns(builder, bases[n], vectors, *shape) for n, shape in function.inputs.items()}

    def load(space: str, k: int) -> Any:
        return tables[space](k) if space in tables else vectors.load(builder, bases[space], k)

    spaces = {n: b for n, b in bases.items() if n in function.spaces}
    emitted = EmittedStages(stages, builder.function, spaces, vectors) if stages else None
    emitter = Emitter(builder, load, vectors, emitted)
    for node in stages.in_order(results) if stages else vectors.in_order(results):
        emitter.value(node)
    values = [emitter.value(r) for r in results]
    for (space, k, _), value in zip(function.stores, values, strict=False):
        vectors.store(builder, value, bases[space], k)
    _emit_outputs(builder, function.outputs, values[len(function.stores) :], bases, vectors)
    builder.ret_void()
    return builder.function


def _columns(
    builder: ir.IRBuilder, base: Any, vectors: Vectors, element: str, columns: int
) -> Callable[[int], Any]:
    """The columns of a table with a row for each lane, as vectors of doubles."""
    rows = ir.VectorType(ELEMENT[element], vectors.lanes * columns)
    whole = builder.load(address(builder, base, 0, rows), align=4)

    def column(k: int) -> Any:
        places = [columns * i + k for i in range(vectors.lanes)]
        chosen = ir.Constant(ir.VectorType(INT32, vectors.lanes), places)
        values = builder.shuffle_vector(whole, whole, chosen)
        return values if element == "f64" else builder.fpext(values, vectors.numbers)

    return column


def _emit_outputs(
    builder: ir.IRBuilder, outputs: list[Output], values: list[Any], bases: Any, vectors: Vectors
) -> None:
    tables: dict[str, dict[int, Any]] = {}
    for output, value in zip(outputs, values, strict=True):
        type_ = ELEMENT[output.element]
        vector = ir.VectorType(type_, vectors.lanes)
        if value.type == vectors.truths:
            value = builder.zext(value, vector)
        elif type_ == FLOAT:
            value = builder.fptrunc(value, vector)
        elif isinstance(type_, ir.IntType):
            value = builder.fptosi(value, vector)
        if output.columns:
            tables.setdefault(output.array, {})[output.column] = value
            continue
        base = bases[output.array]
        if output.column:
            base = builder.gep(base, [builder.mul(bases[f"{output.array}_stride"], integer(output.column))])
        builder.store(value, address(builder, base, 0, vector), align=BYTES[output.element])
    for array, columns in tables.items():
        _emit_lines(builder, bases[array], [columns[k] for k in range(len(columns))], vectors.lanes)


def _emit_lines(builder: ir.IRBuilder, base: Any, columns: list[Any], lanes: int) -> None:
    """Write columns to the rows of a table: four columns at once, transposed in registers."""

    def shuffled(a: Any, b: Any, chosen: list[int]) -> Any:
        return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(INT32, len(chosen)), chosen))

    width = len(columns)
    for first in range(0, width, 4):
        four = columns[first : first + 4]
        four += [four[-1]] * (4 - len(four))
        pairs = [shuffled(four[k], four[k + 1], list(range(2 * lanes))) for k in (0, 2)]
        whole = shuffled(pairs[0], pairs[1], list(range(4 * lanes)))
        for i in range(lanes):
            piece = shuffled(whole, whole, [i + lanes * k for k in range(min(4, width - first))])
            builder.store(piece, address(builder, base, i * width + first, piece.type), align=4)
