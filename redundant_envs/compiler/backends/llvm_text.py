"""Machine code from LLVM's text. As a program of its own it compiles in a process that can be stopped, and
imports nothing of this package: it reads arguments and text, and writes the code."""

import json
import sys
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm

ORDER_OPTION = "-enable-misched={}"
"""LLVM's option for its own scheduler. It is global to the process, so it is set under a lock."""
GPU = "nvptx"
"""How the kind of a GPU begins."""


def machine(name: str, features: str, triple: str, effort: int) -> Any:
    """A processor, in LLVM's terms."""
    if triple.startswith(("wasm32", GPU)):
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        how: dict[str, Any] = {"codemodel": "default", "reloc": "static"}
    else:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        how = {"codemodel": "jitdefault", "jit": True}
    of_kind = llvm.Target.from_triple(triple)
    return of_kind.create_target_machine(cpu=name, features=features, opt=effort, **how)


def emitted(text: str, target: tuple[str, str, str, int], wide: bool, emit: Callable[[Any, Any], Any]) -> Any:
    """What ``emit`` makes from a text; on ``wide`` processors instructions keep their order."""
    llvm.set_option("redundant-envs", ORDER_OPTION.format("false" if wide else "true"))
    try:
        made_for = machine(*target)
        module = llvm.parse_assembly(text)
        module.verify()
        (_optimise if target[2].startswith(GPU) else _tidy)(module, made_for)
        return emit(made_for, module)
    finally:
        llvm.set_option("redundant-envs", ORDER_OPTION.format("true"))


def object_code(target: Any, module: Any) -> bytes:
    """The code of a module: for a GPU assembly, of which a driver makes more."""
    if target.triple.startswith(GPU):
        return target.emit_assembly(module).encode()  # type: ignore[no-any-return]
    return target.emit_object(module)  # type: ignore[no-any-return]


def _optimise(module: Any, target: Any) -> None:
    """LLVM's own passes: in a GPU all memories of a lane have to become registers."""
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = options.slp_vectorization = False
    builder = llvm.create_pass_builder(target, options)
    builder.getModulePassManager().run(module, builder)


def _tidy(module: Any, target: Any) -> None:
    """Put variables of kernels into registers, and remove empty blocks. LLVM's pipelines would take twice the
    time and gain nothing: our own passes have done what they do for speed."""
    builder = llvm.create_pass_builder(target, llvm.create_pipeline_tuning_options())
    passes = llvm.create_new_function_pass_manager()
    passes.add_sroa_pass()
    passes.add_simplify_cfg_pass()
    for function in module.functions:
        if not function.is_declaration:
            passes.run(function, builder)


if __name__ == "__main__":
    made_for, order = json.loads(sys.argv[1])
    sys.stdout.buffer.write(emitted(sys.stdin.buffer.read().decode(), made_for, order, object_code))
