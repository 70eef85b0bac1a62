"""Kernels, and the functions that they call, as a module of LLVM: for compiling, not for loading."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir

from redundant_envs.backends.llvm_lanes import (
    BLOCK,
    DOUBLE,
    ELEMENT,
    INT8,
    INT32,
    INT64,
    LANES,
    address,
    emit_lane_function,
    integer,
    signature,
    widened,
)  # fmt: skip
from redundant_envs.tracing.flow import Instruction, Kernel, Program

INTEGERS = {
    "+": "add",
    "-": "sub",
    "*": "mul",
    "and": "and_",
    "or": "or_",
    "xor": "xor",
    "<<": "shl",
    ">>": "lshr",
}
FLOATS = {"+": "fadd", "-": "fsub", "*": "fmul"}


class KernelEmitter:
    """Emits the tree of a kernel."""

    def __init__(
        self, module: ir.Module, kernel: Kernel, functions: dict[str, tuple[ir.Function, Any]]
    ) -> None:
        self.functions = functions
        made = ir.Function(module, ir.FunctionType(ir.VoidType(), [INT64.as_pointer()]), kernel.name)
        self.function = widened(made)
        self.entry = ir.IRBuilder(made.append_basic_block("entry"))
        body = made.append_basic_block("body")
        self.builder = ir.IRBuilder(body)
        self.values: dict[int, Any] = {}
        self.run(kernel.body)
        self.builder.ret_void()
        self.entry.branch(body)

    def value(self, x: Any, kind: str = "int") -> Any:
        if hasattr(x, "index"):
            return self.values[x.index]
        if kind == "float":
            return ir.Constant(DOUBLE, float(x))
        return integer(int(x))

    def run(self, body: Sequence[Instruction]) -> None:
        for instruction in body:
            self.values[instruction.result] = getattr(self, f"_{NAMES.get(instruction.name, 'arithmetic')}")(
                instruction
            )

    def _arithmetic(self, i: Instruction) -> Any:
        b = self.builder
        kinds = [x.kind for x in i.arguments if hasattr(x, "kind")]
        floats = "float" in kinds
        arguments = [self.value(x, "float" if floats else "int") for x in i.arguments]
        if i.kind == "truth" and i.name in ("<", "<=", ">", ">=", "==", "!="):
            if floats:
                return (
                    b.fcmp_unordered("!=", *arguments)
                    if i.name == "!="
                    else b.fcmp_ordered(i.name, *arguments)
                )
            return b.icmp_signed(i.name, *arguments)
        return getattr(b, (FLOATS if floats else INTEGERS)[i.name])(*arguments)

    def _argument(self, i: Instruction) -> Any:
        b = self.builder
        type_ = ELEMENT[i.kind].as_pointer() if i.kind in ELEMENT else INT64
        return b.load(address(b, self.function.args[0], i.extra, type_))

    def _offset(self, i: Instruction) -> Any:
        return self.builder.gep(self.value(i.arguments[0]), [self.value(i.arguments[1])])

    def _not(self, i: Instruction) -> Any:
        return self.builder.not_(self.value(i.arguments[0]))

    def _select(self, i: Instruction) -> Any:
        condition, *two = i.arguments
        return self.builder.select(self.value(condition), *(self.value(x, i.kind) for x in two))

    def _float(self, i: Instruction) -> Any:
        truth = i.arguments[0].kind == "truth"
        convert = self.builder.uitofp if truth else self.builder.sitofp
        return convert(self.value(i.arguments[0]), DOUBLE)

    def _int(self, i: Instruction) -> Any:
        value = self.value(i.arguments[0])
        if value.type == DOUBLE:
            return self.builder.fptosi(value, INT64)
        return self.builder.zext(value, INT64)

    def _space(self, i: Instruction) -> Any:
        memory = self.entry.alloca(ELEMENT[i.kind], ir.Constant(INT32, i.extra))
        memory.align = 64
        return memory

    def _variable(self, i: Instruction) -> Any:
        return self.entry.alloca(DOUBLE if i.kind == "float" else INT64)

    def _get(self, i: Instruction) -> Any:
        return self.builder.load(self.value(i.arguments[0]))

    def _set(self, i: Instruction) -> None:
        place, value = i.arguments
        self.builder.store(self.value(value, i.kind), self.value(place))

    def _load(self, i: Instruction) -> Any:
        b = self.builder
        value = b.load(b.gep(self.value(i.arguments[0]), [self.value(i.arguments[1])]))
        if i.extra == "f32":
            return b.fpext(value, DOUBLE)
        return value if i.extra in ("f64", "i64") else b.zext(value, INT64)

    def _store(self, i: Instruction) -> None:
        b, type_ = self.builder, ELEMENT[i.extra]
        array, index, x = i.arguments
        value = self.value(x, "float" if i.extra in ("f64", "f32") else "int")
        if i.extra == "f32":
            value = b.fptrunc(value, type_)
        elif isinstance(type_, ir.IntType) and type_ != INT64:
            value = b.trunc(value, type_)
        b.store(value, b.gep(self.value(array), [self.value(index)]))

    def _mask(self, i: Instruction) -> Any:
        b = self.builder
        values = b.load(address(b, self.value(i.arguments[0]), i.extra * LANES, BLOCK), align=8)
        bits = b.fcmp_unordered("!=", values, ir.Constant(BLOCK, [0.0] * LANES))
        return b.zext(b.bitcast(bits, INT8), INT64)

    def _counter(self, i: Instruction) -> Any:
        return self.values[i.result]  # set by the loop

    def _each(self, i: Instruction) -> None:
        start, stop = (self.value(x) for x in i.arguments)
        b, f = self.builder, self.function
        head, inside, after = (f.append_basic_block(n) for n in ("head", "each", "after"))
        before = b.block
        b.branch(head)
        b.position_at_end(head)
        k = b.phi(INT64)
        k.add_incoming(start, before)
        b.cbranch(b.icmp_signed("<", k, stop), inside, after)
        b.position_at_end(inside)
        self.values[i.extra] = k
        self.run(i.bodies[0])
        k.add_incoming(b.add(k, integer(1)), b.block)
        b.branch(head)
        b.position_at_end(after)

    def _each_set(self, i: Instruction) -> None:
        b, f = self.builder, self.function
        head, inside, after = (f.append_basic_block(n) for n in ("head", "each_set", "after"))
        before, mask = b.block, self.value(i.arguments[0])
        b.branch(head)
        b.position_at_end(head)
        rest = b.phi(INT64)
        rest.add_incoming(mask, before)
        b.cbranch(b.icmp_signed("!=", rest, integer(0)), inside, after)
        b.position_at_end(inside)
        self.values[i.extra] = b.cttz(rest, ir.Constant(ir.IntType(1), 1))
        self.run(i.bodies[0])
        rest.add_incoming(b.and_(rest, b.sub(rest, integer(1))), b.block)
        b.branch(head)
        b.position_at_end(after)

    def _while(self, i: Instruction) -> None:
        b, f = self.builder, self.function
        head, inside, after = (f.append_basic_block(n) for n in ("head", "while", "after"))
        b.branch(head)
        b.position_at_end(head)
        self.run(i.bodies[0])
        b.cbranch(self.value(i.arguments[0]), inside, after)
        b.position_at_end(inside)
        self.run(i.bodies[1])
        b.branch(head)
        b.position_at_end(after)

    def _when(self, i: Instruction) -> None:
        b, f = self.builder, self.function
        inside, after = (f.append_basic_block(n) for n in ("when", "after"))
        b.cbranch(self.value(i.arguments[0]), inside, after)
        b.position_at_end(inside)
        self.run(i.bodies[0])
        if not b.block.is_terminated:
            b.branch(after)
        b.position_at_end(after)

    def _leave(self, i: Instruction) -> None:
        self.builder.ret_void()

    def _call(self, i: Instruction) -> None:
        name, places = i.extra
        function, arguments = self.functions[name]
        given = dict(zip(places, i.arguments, strict=True))
        self.builder.call(function, [self.value(given[a]) for a in arguments])


NAMES = {
    n: n
    for n in (
        "argument", "offset", "not", "select", "float", "int", "space", "variable", "get", "set", "load",
        "store", "mask", "counter", "each", "each_set", "while", "when", "leave", "call",
    )
}  # fmt: skip


def module_of(program: Program, ordered: bool, triple: str) -> ir.Module:
    """The LLVM module of a program, for a kind of machine."""
    module = ir.Module("program")
    module.triple = triple
    functions = {
        name: (emit_lane_function(module, f, ordered), signature(f)) for name, f in program.functions.items()
    }
    for kernel in program.kernels:
        KernelEmitter(module, kernel, functions)
    return module
