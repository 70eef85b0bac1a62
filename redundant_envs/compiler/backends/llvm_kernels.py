"""Kernels, and the functions that they call, as a module of LLVM: for compiling, not for loading."""

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir

from redundant_envs.compiler.backends import llvm_lanes as lanes
from redundant_envs.compiler.backends.llvm_lanes import ARITHMETIC, DOUBLE, ELEMENT, INT64, Vectors, integer
from redundant_envs.compiler.backends.processors import Processor
from redundant_envs.compiler.tracing.flow import ELEMENTS, Kernel, Program, Scalar

Functions = dict[str, tuple[ir.Function, dict[str, ir.Type]]]
"""Functions of lanes and their arguments, by name."""
INTEGERS = {**ARITHMETIC, "+": "add", "-": "sub", "*": "mul", "<<": "shl", ">>": "lshr"}

SIMPLE: dict[str, Callable[..., Any]] = {
    "not": lambda b, x: b.not_(x),
    "select": lambda b, condition, x, y: b.select(condition, x, y),
    "float": lambda b, x: (b.uitofp if x.type == lanes.BIT else b.sitofp)(x, DOUBLE),
    "int": lambda b, x: (b.fptosi if x.type == DOUBLE else b.zext)(x, INT64),
    "lowest": lambda b, x: b.cttz(x, ir.Constant(lanes.BIT, 1)),
    "leave": lambda b: b.ret_void(),
}
"""Instructions of one operation on their operands."""


class KernelEmitter:
    """Emits the tree of a kernel: each instruction as :data:`SIMPLE` says, by the method of its name, or as
    arithmetic."""

    def __init__(self, module: ir.Module, kernel: Kernel, functions: Functions, vectors: Vectors) -> None:
        self.functions, self.vectors = functions, vectors
        self.function = function = self.declared(module, kernel)
        self.entry = ir.IRBuilder(function.append_basic_block("entry"))
        body = function.append_basic_block("body")
        self.builder = ir.IRBuilder(body)
        self.values: dict[int, Any] = {}
        self.run(kernel.body)
        self.builder.ret_void()
        self.entry.branch(body)

    def declared(self, module: ir.Module, kernel: Kernel) -> ir.Function:
        """The function of a kernel, which takes the address of its frame."""
        kind = ir.FunctionType(ir.VoidType(), [INT64.as_pointer()])
        return lanes.widened(ir.Function(module, kind, kernel.name))

    def value(self, x: Any, kind: str = "int") -> Any:
        if isinstance(x, Scalar):
            return self.values[x.index]
        return ir.Constant(DOUBLE, float(x)) if kind == "float" else integer(int(x))

    def operands(self, i: Scalar, kind: str = "int") -> list[Any]:
        return [self.value(x, kind) for x in i.arguments]

    def run(self, body: Sequence[Scalar]) -> None:
        for i in body:
            if i.name in SIMPLE:
                self.values[i.index] = SIMPLE[i.name](self.builder, *self.operands(i, i.kind))
            else:
                self.values[i.index] = getattr(self, f"_{i.name}", self._arithmetic)(i)

    def _arithmetic(self, i: Scalar) -> Any:
        b = self.builder
        floats = any(getattr(x, "kind", None) == "float" for x in i.arguments)
        operands = self.operands(i, "float" if floats else "int")
        if i.name in ("<", "<=", ">", ">=", "==", "!="):
            return lanes.compared(b, i.name, *operands) if floats else b.icmp_signed(i.name, *operands)
        if i.kind in ELEMENT:  # of an address
            return b.gep(operands[0], operands[1:])
        return getattr(b, (ARITHMETIC if floats else INTEGERS)[i.name])(*operands)

    def _argument(self, i: Scalar) -> Any:
        type_ = ELEMENT[i.kind].as_pointer() if i.kind in ELEMENT else INT64
        return self.builder.load(lanes.address(self.builder, self.function.args[0], i.extra, type_))

    def _space(self, i: Scalar) -> Any:
        memory = self.entry.alloca(ELEMENT[i.kind], ir.Constant(lanes.INT32, i.extra))
        memory.align = 64
        return memory

    def _load(self, i: Scalar) -> Any:
        b, (base, index) = self.builder, self.operands(i)
        value = b.load(b.gep(base, [index]))
        if i.extra == "f32":
            return b.fpext(value, DOUBLE)
        return value if i.extra in ("f64", "i64") else b.zext(value, INT64)

    def _take(self, i: Scalar) -> Any:
        """The number of a counter, which grows by 1, and no other thread gets."""
        return self.builder.atomic_rmw("add", self.value(i.arguments[0]), integer(1), "monotonic")

    def _store(self, i: Scalar) -> None:
        b, type_ = self.builder, ELEMENT[i.extra]
        array, index, x = i.arguments
        value = self.value(x, ELEMENTS[i.extra])
        if i.extra == "f32":
            value = b.fptrunc(value, type_)
        elif isinstance(type_, ir.IntType) and type_ != INT64:
            value = b.trunc(value, type_)
        b.store(value, b.gep(self.value(array), [self.value(index)]))

    def _mask(self, i: Scalar) -> Any:
        b, v = self.builder, self.vectors
        bits = lanes.compared(b, "!=", v.load(b, self.value(i.arguments[0]), i.extra), v.same(v.numbers, 0.0))
        return b.zext(b.bitcast(bits, ir.IntType(v.lanes)), INT64)

    def _while(self, i: Scalar) -> None:
        b = self.builder
        head, inside, after = (b.append_basic_block(name) for name in ("head", "while", "after"))
        b.branch(head)
        b.position_at_end(head)
        self.run(i.bodies[0])
        b.cbranch(*self.operands(i), inside, after)
        b.position_at_end(inside)
        self.run(i.bodies[1])
        b.branch(head)
        b.position_at_end(after)

    def _when(self, i: Scalar) -> None:
        with self.builder.if_then(*self.operands(i)):
            self.run(i.bodies[0])

    def _call(self, i: Scalar) -> None:
        name, places = i.extra
        function, arguments = self.functions[name]
        operands = dict(zip(places, self.operands(i), strict=True))
        self.builder.call(function, [operands[a] for a in arguments])


def module_of(program: Program, target: Processor, emitter: type = KernelEmitter) -> ir.Module:
    """The LLVM module of a program, for a target."""
    module = ir.Module("program")
    module.triple = target.triple
    vectors = Vectors(program.lanes, target)
    functions = {
        name: (lanes.emit_lane_function(module, f, vectors), lanes.signature(f))
        for name, f in program.functions.items()
    }
    for kernel in program.kernels:
        emitter(module, kernel, functions, vectors)
    return module
