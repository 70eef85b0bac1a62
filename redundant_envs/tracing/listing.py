"""A program as text, for readers and for comparison with other programs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from redundant_envs.tracing.flow import Instruction, Kernel, LaneFunction, Program, Scalar
from redundant_envs.tracing.graph import Operation, Value, reached

Namer = Callable[[str, int], str]
"""Name of number k of a space of memory."""


def plain_name(space: str, k: int) -> str:
    return f"{space}[{k}]"


def function_lines(f: LaneFunction, name_of: Namer = plain_name) -> Iterator[str]:
    """Instructions of a function, its stores and outputs; those of its subroutine come first."""
    nodes = reached(f.results)
    for subroutine in {n.extra for n in nodes if n.name == "stage"}:

        def given(space: str, k: int, names: Sequence[str] = subroutine.names) -> str:
            return names[k] if names and space == "given" else name_of(space, k)

        results, inner = subroutine.traced()
        numbers = {n: k for k, n in enumerate(inner)}
        yield f"subroutine of {f.name}:"
        yield from _numbered(numbers, given)
        yield f"  gives {_arguments(results, numbers)}"
    yield f"function {f.name}:"
    if f.inputs:
        yield f"  reads tables {sorted(f.inputs.items())}"
    if f.known:
        yield f"  known {sorted(f.known.items())}"
    numbers = {n: k for k, n in enumerate(nodes)}
    yield from _numbered(numbers, name_of)
    for space, row, value in f.stores:
        yield f"  {name_of(space, row)} <- {_arguments([value], numbers)}"
    for o in f.outputs:
        yield f"  {o.array}[{o.column}/{o.columns}] ({o.element}) <- {_arguments([o.value], numbers)}"


def _numbered(numbers: dict[Operation, int], name_of: Namer) -> Iterator[str]:
    """Operations, grouped under their source functions if these are known."""
    present = None
    for n, k in numbers.items():
        if n.origin is not None and n.name != "load" and n.origin[:3] != present:
            present = n.origin[:3]
            owner = f" for {n.origin.owner}" if n.origin.owner else ""
            yield f"  # {n.origin.function}{owner}, {n.origin.file}:{n.origin.line}"
        extra = f" {n.extra}" if isinstance(n.extra, int) else ""
        shown = (
            name_of(*n.extra) if n.name == "load" else f"{n.name}{extra} {_arguments(n.arguments, numbers)}"
        )
        yield f"  %{k} = {shown}"


def _arguments(xs: Iterable[Value], numbers: dict[Operation, int]) -> str:
    return ", ".join(f"%{numbers[x]}" if isinstance(x, Operation) else repr(x) for x in xs)


def kernel_lines(kernel: Kernel) -> Iterator[str]:
    """The tree of a kernel."""
    arguments = ", ".join(f"{name}: {kind}" for name, kind in kernel.arguments.items())
    yield f"kernel {kernel.name}({arguments}):"
    yield from _body(kernel.body, "  ")


def _body(body: Iterable[Instruction], indent: str) -> Iterator[str]:
    for i in body:
        arguments = ", ".join(f"%{x.index}" if isinstance(x, Scalar) else repr(x) for x in i.arguments)
        yield f"{indent}{i.result} = {i.name} {i.kind} {arguments} {i.extra or ''}".rstrip()
        for part in i.bodies:
            yield from _body(part, indent + "  ")
            yield f"{indent}end"


def lines(program: Program, name_of: Namer = plain_name) -> Iterator[str]:
    """The whole program."""
    for f in program.functions.values():
        yield from function_lines(f, name_of)
    for kernel in program.kernels:
        yield from kernel_lines(kernel)


def fingerprints(program: Program) -> Iterator[str]:
    """Text that is equal for equal programs, and for no others; faster than :func:`lines`."""
    for f in program.functions.values():
        nodes = reached(f.results)
        for subroutine in dict.fromkeys(n.extra for n in nodes if n.name == "stage"):
            results, inner = subroutine.traced()
            yield repr((f.name, tuple(subroutine.asides), outline(inner, results)))
        places = [(space, row) for space, row, _ in f.stores], [o[:4] for o in f.outputs]
        told = f.aside_results, places, outline(nodes, f.results)
        yield repr((f.name, f.spaces, sorted(f.inputs.items()), sorted(f.known.items()), *told))
    for kernel in program.kernels:
        yield from kernel_lines(kernel)


def outline(nodes: Sequence[Operation], results: Sequence[Value]) -> list[Any]:
    """Operations with numbers for those that they take, and results; constants stay what they are.

    It is equal for equal graphs, and for no others: by its representation, in which 0.0 and -0.0 differ.
    """
    numbers: dict[Any, Any] = {n: k for k, n in enumerate(nodes)}
    told: list[Any] = []
    for n in nodes:
        extra = None if n.name == "stage" else n.extra
        told.append((n.name, extra, [numbers[a] if type(a) is Operation else a for a in n.arguments]))
    return [*told, [numbers[r] if type(r) is Operation else r for r in results]]
