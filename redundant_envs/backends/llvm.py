"""Programs as machine code, through llvmlite."""

from __future__ import annotations

import ctypes
import functools
import threading
import warnings
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from redundant_envs.backends.processors import Processor
from redundant_envs.tracing.flow import Program
from redundant_envs.tracing.graph import setting, uncollected

Entry = Callable[[int], None]
"""A kernel in machine code: it takes the address of a frame, its arguments as 8 bytes each."""

ORDER_OPTION = "-enable-misched={}"
"""LLVM's option for its own scheduler. It is global to the process, so it is set under a lock."""

EFFORT = 3
"""Of LLVM's code generator, 0 to 3: with 1 it takes a fifth less time, and motors are 2.5 % slower (0011)."""

_lock = threading.Lock()
_loaded: list[Any] = []
"""Engines own the machine code, so they are kept."""


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
    version = ".".join(map(str, llvm.llvm_version_info))
    return llvmlite.__version__, version, str(EFFORT), *map(str, processor())


def machine() -> Any:
    """The processor, in LLVM's terms."""
    made_for = processor()
    if made_for.is_wasm:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        how: dict[str, Any] = {"codemodel": "default", "reloc": "static"}
    else:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        how = {"codemodel": "jitdefault", "jit": True}
    of_kind = llvm.Target.from_triple(made_for.triple)
    return of_kind.create_target_machine(cpu=made_for.name, features=made_for.features, opt=EFFORT, **how)


def object_code(program: Program) -> bytes:
    """The machine code of a program for this processor."""
    return _emitted(program, lambda target, module: target.emit_object(module))  # type: ignore[no-any-return]


def assembly(program: Program) -> str:
    """The same as readable assembly."""
    return _emitted(program, lambda target, module: target.emit_assembly(module))  # type: ignore[no-any-return]


def _emitted(program: Program, emit: Callable[[Any, Any], Any]) -> Any:
    from redundant_envs.backends.llvm_kernels import module_of  # not needed to load compiled code

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
    with _lock:
        llvm.set_option("redundant-envs", ORDER_OPTION.format("false" if made_for.wide else "true"))
        try:
            target = machine()
            module = llvm.parse_assembly(text)
            module.verify()
            _tidy(module, target)
            return emit(target, module)
        finally:
            llvm.set_option("redundant-envs", ORDER_OPTION.format("true"))


def _tidy(module: Any, target: Any) -> None:
    """Put variables of kernels into registers, and remove empty blocks.

    LLVM need not do more: our own passes have done what its pipelines would do for speed, and these gain
    nothing in twice the time.
    """
    builder = llvm.create_pass_builder(target, llvm.create_pipeline_tuning_options())
    passes = llvm.create_new_function_pass_manager()
    passes.add_sroa_pass()
    passes.add_simplify_cfg_pass()
    for function in module.functions:
        if not function.is_declaration:
            passes.run(function, builder)


def load(code: bytes, names: Sequence[str]) -> dict[str, Entry]:
    """Kernels of machine code by their names."""
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _loaded.append(engine)
    kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
    return {name: kind(engine.get_function_address(name)) for name in names}
