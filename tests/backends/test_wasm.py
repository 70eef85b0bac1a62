"""Objects of LLVM as WebAssembly modules, without a linker."""

import llvmlite.binding as llvm
import pytest

from redundant_envs.compiler.backends import llvm as backend
from redundant_envs.compiler.backends import wasm
from redundant_envs.compiler.backends.processors import WASM
from redundant_envs.compiler.tracing.flow import Kernel, LaneFunction, Program
from redundant_envs.compiler.tracing.graph import Graph
from redundant_envs.compiler.tracing.number import Number, value_of

SOURCE = """
target triple = "wasm32-unknown-unknown"
{more}
define double @first(double %x) {{
  {body}
}}
define double @second(double %x) {{
  %y = call double @first(double %x)
  ret double %y
}}
"""


def object_of(body, more=""):
    """The object of a small module."""
    with backend.target(WASM):
        target = backend.machine()
    return target.emit_object(llvm.parse_assembly(SOURCE.format(body=body, more=more)))


def program():
    """A kernel that computes x * x + x in a block."""
    graph = Graph()
    x = Number(graph, graph.load("row", 0))
    p = Kernel("square", {"row": "f64"}, WASM.lanes)
    p.call(LaneFunction("square", ("row",), [("row", 1, value_of(x * x + x))]), row=p["row"])
    return Program([p])


def test_a_module_is_equal_bytes_every_time_and_exports_its_kernels():
    made = wasm.module(program())
    assert made == wasm.module(program())
    assert made[:8] == b"\0asm\x01\0\0\0"
    exports = b"\x01\x06square\0"
    assert exports in made


def test_the_numbers_of_exports_are_those_of_the_functions():
    made = wasm.linked(object_of("ret double %x"), ["second"])
    assert b"\x01\x06second\0\x01" in made
    both = wasm.linked(object_of("ret double %x"), ["second", "first"])
    assert b"\x02\x06second\0\x01\x05first\0\0" in both


@pytest.mark.parametrize(
    ("body", "more", "message"),
    [
        ("%y = call double @f(double %x)\n  ret double %y", "declare double @f(double)", "imports env.f"),
        (
            "%y = load double, ptr @number\n  ret double %y", "@number = global double 2.0",
            "the object has data",
        ),
        ("%y = call double @llvm.sin.f64(double %x)\n  ret double %y",
         "declare double @llvm.sin.f64(double)", "imports env.sin"),
        ("%y = load double, ptr @number\n  ret double %y", "@number = external global double",
         "the object has data"),
    ],
)  # fmt: skip
def test_what_only_a_linker_could_place_is_refused(body, more, message):
    with pytest.raises(ValueError, match=message):
        wasm.linked(object_of(body, more), ["first"])


def test_a_program_of_another_width_is_refused():
    p = Kernel("wide", {"row": "f64"})
    with pytest.raises(AssertionError, match="lanes"):
        wasm.module(Program([p]))
