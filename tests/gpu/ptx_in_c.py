"""PTX as C, one statement for each operation: a machine without a GPU runs what a GPU would be given."""

import ctypes
import re
import subprocess
from pathlib import Path

HEAD = """
#include <math.h>
#include <stdint.h>
#include <string.h>
typedef uint64_t b64; typedef uint32_t b32; typedef uint16_t b16; typedef unsigned char b8;
static inline double D(b64 x) { double d; memcpy(&d, &x, 8); return d; }
static inline b64 B(double d) { b64 x; memcpy(&x, &d, 8); return x; }
static inline float F(b32 x) { float f; memcpy(&f, &x, 4); return f; }
static inline b32 S(float f) { b32 x; memcpy(&x, &f, 4); return x; }
static inline b64 taken(b64 *counter, b64 more) { b64 before = *counter; *counter += more; return before; }
"""
REGISTERS = {"rd": "b64", "r": "b32", "rs": "b16", "p": "b8"}
OF_FLOATS = {
    "add": "D({0}) + D({1})", "sub": "D({0}) - D({1})", "mul": "D({0}) * D({1})", "div": "D({0}) / D({1})",
    "rcp": "1.0 / D({0})", "sqrt": "sqrt(D({0}))", "fma": "fma(D({0}), D({1}), D({2}))",
    "abs": "fabs(D({0}))", "neg": "-D({0})", "min": "fmin(D({0}), D({1}))", "max": "fmax(D({0}), D({1}))",
}  # fmt: skip
OF_WHOLE = {
    "add": "{0} + {1}", "sub": "{0} - {1}", "mul.lo": "{0} * {1}", "mad.lo": "{0} * {1} + {2}",
    "mul.wide": "(b64){0} * {1}", "and": "{0} & {1}", "or": "{0} | {1}", "xor": "{0} ^ {1}", "not": "~{0}",
    "neg": "0 - {0}", "shl": "{0} << {1}", "mov": "{0}", "selp": "{2} ? {0} : {1}",
}  # fmt: skip
CONVERSIONS = {
    "rn.f32.f64": "S((float)D({0}))", "f64.f32": "B((double)F({0}))", "rmi.f64.f64": "B(floor(D({0})))",
    "rn.f64.u64": "B((double){0})", "rn.f64.s64": "B((double)(int64_t){0})",
    "rzi.s64.f64": "(b64)(int64_t)D({0})", "u32.u64": "(b32){0}", "u64.u32": "(b64){0}",
    "u64.u16": "(b64){0}", "s64.s32": "(b64)(int64_t)(int32_t){0}", "u16.u32": "(b16){0}",
    "u32.u16": "(b32){0}",
}  # fmt: skip
ORDERED = {"eq": "==", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
OPPOSITE = {"ltu": ">=", "leu": ">", "gtu": "<=", "geu": "<", "neu": "=="}
OPERATION = re.compile(r"(?:@(!?)(%p\d+)\s+)?([a-z][\w.]*)\s*(.*)", re.S)


def library(ptx: str, folder: Path) -> ctypes.CDLL:
    """The kernels as functions ``all_<name>(arguments, threads)``, which take the addresses of their
    arguments, as a driver does, and run so many threads."""
    source, made = folder / "ptx.c", folder / "ptx.so"
    source.write_text(in_c(ptx))
    options = ["-O1", "-ffp-contract=off", "-fno-math-errno", "-w", "-shared", "-fPIC"]
    subprocess.run(["gcc", *options, "-o", str(made), str(source), "-lm"], check=True)
    return ctypes.CDLL(str(made))


def in_c(ptx: str) -> str:
    text = re.sub(r"//[^\n]*", "", ptx)
    found = re.findall(r"\.visible \.entry (\w+)\((.*?)\n\)\s*\{(.*?)\n\}", text, re.S)
    assert len(found) == text.count(".entry"), "each kernel is read"
    assert ".func" not in text, "kernels call no function"
    return HEAD + "".join(_kernel(*one) for one in found)


def _kernel(name: str, parameters: str, body: str) -> str:
    entries = re.findall(r"\.param [^\n,]*?(\w+)(?:\[\d+\])?(?:,|$)", parameters)
    lines = [f"static void {name}(void **arguments, b32 thread) {{"]
    lines += [f"b64 {entry} = (b64)arguments[{k}];" for k, entry in enumerate(entries)]
    for kind, count in re.findall(r"\.reg \.\w+\s+%(\w+)<(\d+)>;", body):
        lines.append(f"{REGISTERS[kind]} {', '.join(f'{kind}{k}' for k in range(int(count)))};")
    for part in re.sub(r"\.reg [^;]*;", "", body).split(";"):
        rest = part.strip()
        while label := re.match(r"\$(\w+):\s*", rest):
            lines.append(f"{label[1]}: ;")
            rest = rest[label.end() :]
        if rest:
            lines.append(_statement(rest))
    lines.append("}")
    each = f"for (b32 thread = 0; thread < threads; thread++) {name}(arguments, thread);"
    return "\n".join([*lines, f"void all_{name}(void **arguments, b32 threads) {{ {each} }}", ""])


def _statement(text: str) -> str:
    unless, guard, name, rest = OPERATION.fullmatch(text).groups()
    done = _done(name, [a.strip() for a in re.split(r",\s*(?![^\[]*\])", rest)] if rest else [])
    return f"if ({unless}{_operand(guard)}) {done}" if guard else done


def _operand(text: str) -> str:
    special = {"%ctaid.x": "(thread / 128)", "%ntid.x": "128u", "%tid.x": "(thread % 128)"}
    if text in special:
        return special[text]
    if text.startswith("0d"):
        return f"0x{text[2:]}ull"
    return text.replace("%", "").replace("$", "")


def _place(text: str, kind: str) -> str:
    """The number of a type at an address in brackets."""
    base, _, offset = text[1:-1].partition("+")
    return (
        f"*({kind.replace('f', 'b').replace('u', 'b').replace('s', 'b')} *)({_operand(base)} + {offset or 0})"
    )


def _done(name: str, given: list[str]) -> str:
    first, *more = name.split(".")
    kind = more[-1] if more else ""
    if first == "ret":
        return "return;"
    if first == "bra":
        return f"goto {_operand(given[0])};"
    if first == "st":
        return f"{_place(given[0], kind)} = {_operand(given[1])};"
    goal, *operands = given
    goal = _operand(goal)
    if first == "ld":
        return f"{goal} = {_place(operands[0], kind)};"
    if name in ("atom.global.add.u64", "atom.add.u64"):
        return f"{goal} = taken((b64 *){_operand(operands[0][1:-1])}, {_operand(operands[1])});"
    operands = [_operand(x) for x in operands]
    if first == "cvta":
        return f"{goal} = {operands[0]};"
    if first == "cvt":
        return f"{goal} = {CONVERSIONS[name[4:]].format(*operands)};"
    if first == "setp":
        return f"{goal} = {_compared(more[0], kind, *operands)};"
    if kind == "f64" and first not in ("selp", "mov"):
        assert first in ("abs", "neg", "min", "max") or more[0] == "rn", name
        return f"{goal} = B({OF_FLOATS[first].format(*operands)});"
    if first == "shr":
        signed = "(int64_t)" if kind == "s64" else "(int32_t)" if kind == "s32" else ""
        return f"{goal} = {signed}{operands[0]} >> {operands[1]};"
    if kind == "pred" and first == "not":
        return f"{goal} = !{operands[0]};"
    whole = name.rpartition(".")[0]
    return f"{goal} = {OF_WHOLE[whole].format(*operands)};"


def _compared(how: str, kind: str, a: str, b: str) -> str:
    if kind == "f64":
        x, y = f"D({a})", f"D({b})"
        if how in ("num", "nan"):
            return f"{'!' if how == 'num' else ''}isunordered({x}, {y})"
        if how in ("ne", "equ"):  # ordered and not equal; its opposite
            return f"{'!' if how == 'equ' else ''}(({x} < {y}) | ({x} > {y}))"
        return f"{x} {ORDERED[how]} {y}" if how in ORDERED else f"!({x} {OPPOSITE[how]} {y})"
    sign = {"s64": "(int64_t)", "s32": "(int32_t)", "s16": "(int16_t)"}.get(kind, "")
    return f"{sign}{a} {({**ORDERED, 'ne': '!='})[how]} {sign}{b}"
