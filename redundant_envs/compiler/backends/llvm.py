"""Programs as machine code, through llvmlite."""

import ctypes
import functools
import json
import os
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from redundant_envs.compiler.backends import llvm_text
from redundant_envs.compiler.backends.processors import Processor
from redundant_envs.compiler.tracing.flow import Program
from redundant_envs.compiler.tracing.graph import setting, uncollected

Entry = Callable[[int], None]
"""A kernel in machine code: it takes the address of a frame, its arguments as 8 bytes each."""

EFFORT = 3
"""Of LLVM's code generator, 0 to 3: with 1 it takes a fifth less time, and motors are 2.5 % slower (0011)."""

LONG_TEXT = 2_500_000
"""Characters of a program in LLVM's language beyond which it takes more than a second to compile, which is
done in a process of its own: nothing else stops a compiler."""

_lock = threading.Lock()
_target: ContextVar[Processor | None] = ContextVar("target", default=None)
target = functools.partial(setting, _target)
"""Within this context programs are made for another processor, its argument, whose code this one can run."""


@functools.cache
def host() -> Processor:
    """This machine's."""
    return Processor(llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())


def processor() -> Processor:
    """The target of programs: this machine's, unless another was chosen."""
    return _target.get() or host()


def facts() -> tuple[str, ...]:
    """Everything that machine code depends on beside the program."""
    return llvmlite.__version__, ".".join(map(str, llvm.llvm_version_info)), *map(str, (EFFORT, *processor()))


def machine() -> Any:
    """The processor, in LLVM's terms."""
    return llvm_text.machine(*_described())


def _described() -> tuple[str, str, str, int]:
    return (*processor()[:3], EFFORT)


def object_code(program: Program) -> bytes:
    """The machine code of a program for this processor."""
    return code_of(_text(program))


def code_of(text: str) -> bytes:
    """That of a program in LLVM's language."""
    if len(text) > LONG_TEXT and Path(llvm_text.__file__).is_file() and not getattr(sys, "frozen", False):
        return _compiled_in_child(text, json.dumps([_described(), processor().wide]))
    return _emitted(text, llvm_text.object_code)  # type: ignore[no-any-return]


def assembly(program: Program) -> str:
    """The same as readable assembly."""
    return _emitted(_text(program), lambda target, module: target.emit_assembly(module))  # type: ignore[no-any-return]


def _emitted(text: str, emit: Callable[[Any, Any], Any]) -> Any:
    with _lock:
        return llvm_text.emitted(text, _described(), processor().wide, emit)


def _compiled_in_child(text: str, arguments: str) -> bytes:
    """The code that a process of its own makes, which an interrupt ends."""
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    command = [sys.executable, "-P", llvm_text.__file__, arguments]  # beside it are files named as libraries
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, env=env) as child:
        try:
            code, said = child.communicate(text.encode())
        except BaseException:
            child.kill()
            child.wait()
            raise
    if child.returncode:
        last = said.decode(errors="replace").strip().rpartition("\n")[2]
        raise RuntimeError(f"the compiler ended with status {child.returncode}: {last or 'it said nothing'}")
    return code


def _text(program: Program) -> str:
    """A program in LLVM's language."""
    from redundant_envs.compiler.backends.llvm_kernels import module_of  # not needed to load compiled code

    made_for = processor()
    assert program.width == made_for.lanes, "programs for a target have its lanes"
    if not made_for.joins and not made_for.is_wasm:
        warnings.warn(
            "this processor cannot multiply and add with one rounding (FMA); simulations have the same bits "
            "as elsewhere, and take some 50 times as long",
            stacklevel=2,
        )
    with uncollected():
        described = module_of(program, made_for)
        text = str(described)
        for block in (block for function in described.functions for block in function.blocks):
            block.instructions.clear()  # They know their block: a garbage collection would look at all.
    return text


def load(code: bytes, names: Sequence[str]) -> dict[str, Entry]:
    """Kernels of machine code by their names; it stays as long as one of them."""
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
    entries: dict[str, Any] = {name: kind(engine.get_function_address(name)) for name in names}
    for entry in entries.values():
        entry.engine = engine
    return entries
