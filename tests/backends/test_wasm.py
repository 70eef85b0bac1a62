"""Objects of LLVM as WebAssembly modules, without a linker; ``web/test_module.py`` runs such modules."""

import llvmlite.binding as llvm
import pytest

from redundant_envs.compiler.backends import llvm as backend
from redundant_envs.compiler.backends import wasm
from redundant_envs.compiler.backends.processors import WASM

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


@pytest.mark.parametrize(
    ("value", "more", "message"),
    [
        ("call double @f(double %x)", "declare double @f(double)", "imports env.f"),
        ("load double, ptr @number", "@number = global double 2.0", "the object has data"),
    ],
)
def test_what_only_a_linker_could_place_is_refused(value, more, message):
    with pytest.raises(ValueError, match=message):
        wasm.linked(object_of(f"%y = {value}\n  ret double %y", more), ["first"])
