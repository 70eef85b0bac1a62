"""Programs as WebAssembly modules.

LLVM gives an object, which a linker would make a module. Ours has nothing to link: numbers of one rounding
are computed by its own functions, and it has neither data nor tables. Its sections are those of the module,
but for the names of the kernels, which become exports.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

from redundant_envs.compiler.backends import llvm
from redundant_envs.compiler.backends.processors import WASM
from redundant_envs.compiler.tracing.flow import Program

MEMORY, STACK_POINTER = "__linear_memory", "__stack_pointer"
IMPORTS = {("env", MEMORY), ("env", STACK_POINTER)}
"""What the modules import: a memory, and a global that holds the address at which the stack ends."""
IDENTITY = "identity"
"""Name of the custom section by which a host knows the module of a description."""
CUSTOM, TYPES, IMPORTED, FUNCTIONS, EXPORTS, CODE = 0, 1, 2, 3, 7, 10
OTHERS = {4: "a table", 5: "a memory", 6: "globals", 8: "a start", 9: "elements", 11: "data", 12: "data"}
"""Sections that our objects do not have."""
SYMBOLS = 8
"""Number of the table of symbols in the custom section "linking"."""
FUNCTION, DATA, GLOBAL, SECTION, EVENT, TABLE = range(6)
"""Kinds of symbols; those of imports that have the same numbers are functions, tables, memories, globals."""
UNDEFINED, NAMED = 0x10, 0x40
"""Bits of a symbol: another module has it; it has a name of its own nevertheless."""


def module(program: Program) -> bytes:
    """A program of the lanes of :data:`~redundant_envs.compiler.backends.processors.WASM` as a module that
    exports its kernels, which take the address of a frame as those of other back ends do."""
    with llvm.target(WASM):
        code = llvm.object_code(program)
    made = linked(code, [kernel.name for kernel in program.kernels])
    section = _text(IDENTITY) + identity(made).encode()
    return made + bytes([CUSTOM]) + _leb(len(section)) + section


def identity(code: bytes) -> str:
    """The digest of a module: the section that says it is the last one, and not part of it."""
    for number, content in _sections(code):
        reader = _Reader(content)
        if number == CUSTOM and reader.text() == IDENTITY:
            return content[reader.at :].decode()
    return hashlib.sha256(code).hexdigest()


def linked(code: bytes, names: list[str]) -> bytes:
    """The module of an object, which exports some of its functions.

    ValueError if the object needs what no module of ours has: data, tables, functions of others.
    """
    sections = [*_sections(code)]
    for number, _ in sections:
        if number in OTHERS:
            raise ValueError(
                f"the object has {OTHERS[number]}, which only a linker can place; ours have none"
            )
    own = {number: content for number, content in sections if number != CUSTOM}
    foreign = sorted({*_imports(own.get(IMPORTED, b"\0"))} - IMPORTS)
    if foreign:
        told = ", ".join(".".join(name) for name in foreign)
        raise ValueError(f"the object imports {told}; a module has a memory and a stack alone")
    functions: dict[str, int] = {}
    for number, content in sections:
        if number == CUSTOM:
            functions |= _functions(content)
    exports = [_text(name) + b"\0" + _leb(functions[name]) for name in names]
    own[EXPORTS] = _leb(len(exports)) + b"".join(exports)
    order = (TYPES, IMPORTED, FUNCTIONS, EXPORTS, CODE)
    return code[:8] + b"".join(
        bytes([number]) + _leb(len(own[number])) + own[number] for number in order if number in own
    )


class _Reader:
    """Reads numbers and texts from bytes, one after the other."""

    def __init__(self, content: bytes) -> None:
        self.content, self.at = content, 0

    def __bool__(self) -> bool:
        return self.at < len(self.content)

    def byte(self) -> int:
        self.at += 1
        return self.content[self.at - 1]

    def number(self) -> int:
        """An unsigned number in LEB128."""
        result = shift = 0
        while True:
            byte = self.byte()
            result |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return result

    def take(self) -> bytes:
        """As many bytes as a number before them says."""
        count = self.number()
        self.at += count
        return self.content[self.at - count : self.at]

    def text(self) -> str:
        return self.take().decode()


def _leb(number: int) -> bytes:
    made = bytearray()
    while number >= 0x80:
        made.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*made, number])


def _text(name: str) -> bytes:
    return _leb(len(name.encode())) + name.encode()


def _sections(code: bytes) -> Iterator[tuple[int, bytes]]:
    """Numbers and contents of the sections."""
    reader = _Reader(code)
    reader.at = 8  # after the magic number and the version
    while reader:
        yield reader.byte(), reader.take()


def _imports(content: bytes) -> Iterator[tuple[str, str]]:
    """Modules and names of imports."""
    reader = _Reader(content)
    for _ in range(reader.number()):
        name = reader.text(), reader.text()
        kind = reader.byte()
        if kind == 0:  # a function: the number of its type
            reader.number()
        elif kind == 3:  # a global: its type, and whether it changes
            reader.at += 2
        else:
            if kind == 1:  # a table: the type of its elements
                reader.byte()
            limits = reader.number()
            for _ in range(2 if limits & 1 else 1):
                reader.number()
        yield name


def _functions(content: bytes) -> dict[str, int]:
    """Numbers of functions by name, if a custom section has the symbols."""
    reader, found = _Reader(content), dict[str, int]()
    if reader.text() != "linking":
        return found
    reader.number()  # the version
    while reader:
        part = reader.byte()
        symbols = _Reader(reader.take())
        for _ in range(symbols.number() if part == SYMBOLS else 0):
            kind, flags = symbols.byte(), symbols.number()
            if kind in (DATA, SECTION):
                raise ValueError("the object has data, which only a linker can place; ours have none")
            number = symbols.number()
            if not flags & UNDEFINED or flags & NAMED:
                name = symbols.text()
                if kind == FUNCTION:
                    found[name] = number
    return found
