"""A program as text: for readers, and to tell it from other programs."""

from collections.abc import Callable, Iterable, Iterator, Sequence

from redundant_envs.compiler.tracing.flow import LaneFunction, Program, Scalar
from redundant_envs.compiler.tracing.graph import Operation, Value, reached

Namer = Callable[[str, int], str]
"""Name of number k of a space of memory."""


def plain_name(space: str, k: int) -> str:
    return f"{space}[{k}]"


def lines(program: Program, name_of: Namer = plain_name) -> Iterator[str]:
    """The whole program; with plain names the text is equal for equal programs, and for no others."""
    for f in program.functions.values():
        yield from function_lines(f, name_of)
    for kernel in program.kernels:
        arguments = ", ".join(f"{name}: {kind}" for name, kind in kernel.arguments.items())
        yield f"kernel {kernel.name}({arguments}):"
        yield from _body(kernel.body, "  ")


def function_lines(f: LaneFunction, name_of: Namer = plain_name) -> Iterator[str]:
    """Instructions of a function, its stores and outputs; those of its subroutine come first."""
    nodes = reached(f.results)
    for subroutine in dict.fromkeys(n.extra for n in nodes if n.name == "stage"):

        def input_name(space: str, k: int, names: Sequence[str] = subroutine.names) -> str:
            return names[k] if names and space == "given" and name_of is not plain_name else name_of(space, k)

        yield f"subroutine of {f.name}:"
        yield from result_lines(subroutine.traced()[0], input_name)
        yield from _about(aside=subroutine.asides)
    yield f"function {f.name}:"
    tables, known = sorted(f.inputs.items()), sorted(f.known.items())
    yield from _about(memories=f.spaces, tables=tables, known=known, aside=f.aside_results)
    if not f.joins:
        yield "  joins no products"
    numbers = {n: k for k, n in enumerate(nodes)}
    yield from _operations(numbers, name_of)
    for space, row, value in f.stores:
        yield f"  {name_of(space, row)} <- {_arguments([value], numbers)}"
    for o in f.outputs:
        yield f"  {o.array}[{o.column}/{o.columns}] ({o.element}) <- {_arguments([o.value], numbers)}"


def result_lines(results: Sequence[Value], name_of: Namer = plain_name) -> Iterator[str]:
    """Operations that some results need, and the results; equal for equal graphs, and for no others."""
    numbers = {n: k for k, n in enumerate(reached(results))}
    yield from _operations(numbers, name_of)
    yield f"  gives {_arguments(results, numbers)}"


def _about(**entries: Sequence[object]) -> Iterator[str]:
    return (f"  {what} {value}" for what, value in entries.items() if value)


def _operations(numbers: dict[Operation, int], name_of: Namer) -> Iterator[str]:
    """Operations, grouped under their source functions if these are known."""
    present = None
    for n, k in numbers.items():
        if n.origin is not None and n.name != "load" and n.origin[:3] != present:
            present = n.origin[:3]
            owner = f" for {n.origin.owner}" if n.origin.owner else ""
            yield f"  # {n.origin.function}{owner}, {n.origin.file}:{n.origin.line}"
        extra = f" {n.extra}" if isinstance(n.extra, int) else ""
        computed = f"{n.name}{extra} {_arguments(n.arguments, numbers)}"
        yield f"  %{k} = {name_of(*n.extra) if n.name == 'load' else computed}"


def _arguments(xs: Iterable[Value], numbers: dict[Operation, int]) -> str:
    return ", ".join(f"%{numbers[x]}" if isinstance(x, Operation) else repr(x) for x in xs)


def _body(body: Iterable[Scalar], indent: str) -> Iterator[str]:
    """The tree of a kernel."""
    for i in body:
        arguments = ", ".join(f"%{x.index}" if isinstance(x, Scalar) else repr(x) for x in i.arguments)
        yield f"{indent}{i.index} = {i.name} {i.kind} {arguments} {i.extra or ''}".rstrip()
        for part in i.bodies:
            yield from _body(part, indent + "  ")
            yield f"{indent}end"
