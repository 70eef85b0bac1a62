"""Programs as WebAssembly modules.

LLVM gives an object, which a linker would make a module. Ours has nothing to link: numbers of one rounding
are computed by its own functions, and it has neither data nor tables. It imports a memory and a global, the
address at which the stack ends. Its sections are those of the module, but for the names of the kernels, which
become exports.
"""

import hashlib

from redundant_envs.compiler.backends import llvm
from redundant_envs.compiler.backends.processors import WASM
from redundant_envs.compiler.tracing.flow import Program

IDENTITY = "identity"
"""Name of the custom section by which a host knows the module of a description."""
CUSTOM, TYPES, IMPORTED, FUNCTIONS, EXPORTS, CODE = 0, 1, 2, 3, 7, 10
SYMBOLS = 8
"""Number of the table of symbols in the custom section "linking"."""
FUNCTION, DATA, GLOBAL, SECTION = range(4)
"""Kinds of symbols."""
UNDEFINED, NAMED = 0x10, 0x40
"""Bits of a symbol: another module has it; it has a name of its own nevertheless."""


def module(program: Program) -> bytes:
    """A program of the lanes of :data:`~redundant_envs.compiler.backends.processors.WASM` as a module that
    exports its kernels, which take the address of a frame as those of other back ends do."""
    with llvm.target(WASM):
        code = linked(llvm.object_code(program), [kernel.name for kernel in program.kernels])
    section = _text(IDENTITY) + hashlib.sha256(code).hexdigest().encode()
    return code + bytes([CUSTOM]) + _leb(len(section)) + section


def identity(code: bytes) -> str:
    """The digest of a module, with which its last section ends."""
    return code[-64:].decode()


def linked(code: bytes, names: list[str]) -> bytes:
    """The module of an object, which exports some of its functions."""
    parts: dict[int, bytes] = {}
    functions: dict[str, int] = {}
    reader = _Reader(code, 8)  # after the magic number and the version
    while reader:
        number, content = reader.byte(), reader.take()
        if number == CUSTOM:
            functions |= _functions(content)
        else:
            parts[number] = content
    exports = [_text(name) + b"\0" + _leb(functions[name]) for name in names]
    parts[EXPORTS] = _leb(len(exports)) + b"".join(exports)
    order = (TYPES, IMPORTED, FUNCTIONS, EXPORTS, CODE)
    assert parts.keys() <= {*order}, "only a linker can place data, tables and the like"
    return code[:8] + b"".join(
        bytes([number]) + _leb(len(parts[number])) + parts[number] for number in order if number in parts
    )


class _Reader:
    """Reads numbers and texts from bytes, one after the other."""

    def __init__(self, content: bytes, at: int = 0) -> None:
        self.content, self.at = content, at

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


def _leb(number: int) -> bytes:
    encoded = bytearray()
    while number >= 0x80:
        encoded.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*encoded, number])


def _text(name: str) -> bytes:
    return _leb(len(name.encode())) + name.encode()


def _functions(content: bytes) -> dict[str, int]:
    """Numbers of functions by name, if a custom section has the symbols."""
    reader, numbers = _Reader(content), dict[str, int]()
    if reader.take() != b"linking":
        return numbers
    reader.number()  # the version
    while reader:
        part = reader.byte()
        symbols = _Reader(reader.take())
        for _ in range(symbols.number() if part == SYMBOLS else 0):
            kind, flags, number = symbols.byte(), symbols.number(), symbols.number()
            assert kind not in (DATA, SECTION), "only a linker can place data"
            if not flags & UNDEFINED or flags & NAMED:
                name = symbols.take().decode()
                if kind == FUNCTION:
                    numbers[name] = number
            assert kind != FUNCTION or not flags & UNDEFINED, "the object calls functions of others"
    return numbers
