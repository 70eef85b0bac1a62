"""Programs of one lane a thread as PTX, NVIDIA's assembly: a text that every driver makes machine code of."""

import re
from collections import Counter
from typing import Any

from llvmlite import ir

from redundant_envs.compiler.backends import llvm
from redundant_envs.compiler.backends.llvm_kernels import KernelEmitter, module_of
from redundant_envs.compiler.backends.llvm_lanes import ELEMENT, INT32, INT64
from redundant_envs.compiler.backends.processors import NVIDIA
from redundant_envs.compiler.tracing.flow import Kernel, Program, Scalar

ROUNDED = {"fma", "mul", "add", "sub", "div", "rcp", "sqrt"}
"""Arithmetic of floats; each operation has to be rounded once, to nearest (.rn), as IEEE 754 says: then no
assembler may join two of them."""
EXACT = {"neg", "abs", "min", "max", "selp", "mov", "setp", "ld", "st"}
"""Operations on floats that round nothing."""
CONVERSIONS = {
    "cvt.rn.f32.f64", "cvt.f64.f32", "cvt.rzi.s64.f64", "cvt.rmi.f64.f64", "cvt.rn.f64.u64", "cvt.rn.f64.s64",
}  # fmt: skip
"""Conversions of floats; of whole numbers those below 2^53, which are exact."""
OPERATION = re.compile(r"^\s*(?:@!?%p\d+\s+)?([a-z][\w.:]*)\s+[^\n]*;", re.M)
INEXACT = re.compile(r"\.(approx|ftz|full|sat)\b")


class ThreadEmitter(KernelEmitter):
    """A kernel whose arguments are those of its function: with "parameter" by value, in memory of constants,
    if all lanes share so many numbers."""

    shared = 0

    def declared(self, module: ir.Module, kernel: Kernel) -> ir.Function:
        kinds = [ELEMENT[t].as_pointer() if t in ELEMENT else INT64 for t in kernel.arguments.values()]
        function = ir.Function(module, ir.FunctionType(ir.VoidType(), kinds), kernel.name)
        function.calling_convention = "ptx_kernel"
        for argument, name in zip(function.args, kernel.arguments, strict=True):
            if self.shared and name == "parameter":
                set.add(argument.attributes, f"byval([{self.shared} x double]) align 8")
            elif isinstance(argument.type, ir.PointerType):
                argument.add_attribute("noalias")
        return function

    def _argument(self, i: Scalar) -> Any:
        return self.function.args[i.extra]

    def _thread(self, i: Scalar) -> Any:
        """The number of the thread among all."""
        block, width, own = (self.builder.zext(self._register(n), INT64) for n in ("ctaid", "ntid", "tid"))
        return self.builder.add(self.builder.mul(block, width), own)

    def _register(self, name: str) -> Any:
        full, module = f"llvm.nvvm.read.ptx.sreg.{name}.x", self.function.module
        known = module.globals.get(full) or ir.Function(module, ir.FunctionType(INT32, []), full)
        return self.builder.call(known, [])


def ptx(program: Program, shared: int = 0) -> str:
    """A program of one lane as PTX; ``shared`` numbers are parameters that all lanes share, 0 if each has its
    own. RuntimeError if it has an operation that machines may round in different ways."""
    emitter = type("SharingEmitter", (ThreadEmitter,), {"shared": shared})
    module = module_of(program, NVIDIA, emitter)
    for function in module.functions:
        if function.linkage == "internal":
            function.attributes.discard("noinline")
            set.add(function.attributes, "alwaysinline")
    with llvm.target(NVIDIA):
        text = llvm.code_of(str(module)).decode()
    check(text)
    return text


def operations(text: str) -> Counter[str]:
    """How often PTX has each operation."""
    return Counter(OPERATION.findall(text))


def check(text: str) -> None:
    """RuntimeError if PTX has an operation whose result is not the same on every machine."""
    for name in operations(text):
        first, *more = name.split(".")
        floats = "f64" in more or "f32" in more
        plain = first in EXACT or name in CONVERSIONS or (first in ROUNDED and more[:1] == ["rn"])
        if INEXACT.search(name) or (floats and not plain):
            raise RuntimeError(
                f"the compiler made the operation {name}, which machines may round differently"
            )
