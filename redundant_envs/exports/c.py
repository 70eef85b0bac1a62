"""The accelerations of a scene as a function in C99, written from the traced equations."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from redundant_envs.compiler.tracing.graph import COMPARISONS, CONDITIONS, Operation, Value, reached
from redundant_envs.exports.files import Document, Heading
from redundant_envs.exports.motion import INPUTS, equations, smooth_scene
from redundant_envs.scenes.scene import Scene

FORMS = {
    **{name: f"{{}} {name} {{}}" for name in ("+", "-", "*", "/", *COMPARISONS)},
    **{name: f"{name}({{}})" for name in ("sqrt", "floor", "exp", "expm1", "log", "sin", "cos")},
    "and": "{} && {}", "or": "{} || {}", "xor": "{} != {}", "select": "{} ? {} : {}",
    "abs": "fabs({})", "neg": "-({})", "not": "!({})",
}  # fmt: skip
"""Operations in C, of one, two or three values."""


def c_code(scene: Scene, heading: Heading, approximate: bool) -> Document:
    """A C file with one function, such as ``four_r_reach_accelerations``; it needs math.h alone. ValueError
    if effects have states or jumps, and the result is not to be ``approximate``."""
    smooth, notes = smooth_scene(scene, "C", approximate)
    n, results = len(scene.robot.joints), equations(smooth, "qdd")["qdd"]
    about = [
        f"q: {', '.join(scene.robot.coordinates)} [rad, and m of sliders]; qd: their rates.",
        f"commands: of the motors [{', '.join(smooth.command_units())}]; qdd: the second derivatives of q.",
    ]
    comment = "\n   ".join(heading.lines(about, notes)).replace("*/", "* /").replace("/*", "/ *")
    inputs = ", ".join(f"const double {name}[{n}]" for name in INPUTS)
    head = f"void {identifier(heading.function)}_accelerations({inputs}, double qdd[{n}])"
    attached = (bound.function for a in smooth.attached for bound in a.functions.values())
    named = {getattr(f, "__name__", "") for f in (*scene.robot.functions, *attached)}
    used = {operation.extra[0] for operation in reached(results) if operation.name == "load"}
    unused = [f"(void){name};" for name in INPUTS if name not in used]
    body = "\n".join(f"  {line}" for line in (*unused, *_statements(results, named)))
    return Document(f"/* {comment} */\n\n#include <math.h>\n\n{head};\n\n{head} {{\n{body}\n}}\n", notes)


def identifier(name: str) -> str:
    """A name of C, so that the functions of several scenes fit into one program."""
    letters = (x if x.isascii() or not x.isalnum() else f"u{ord(x):x}" for x in name)
    word = re.sub(r"\W", "_", "".join(letters), flags=re.ASCII)
    return word if word[:1].isalpha() else f"scene_{word}"


def _statements(results: list[Value], named: set[str]) -> Iterator[str]:
    """Operations in their order, under the functions of equations they come from, if these are ``named``."""
    names: dict[Operation, str] = {}
    source = ""
    for operation in reached(results):
        if operation.name == "load":
            array, k = operation.extra
            names[operation] = f"{array}[{k}]"
            continue
        origin = operation.origin
        if origin is not None and origin.function in named:
            before, source = source, f"{origin.function}, {Path(origin.file).name}"
            yield from [f"/* {source} */"] if source != before else []
        kind, letter = ("int", "c") if operation.name in CONDITIONS else ("double", "x")
        name = f"{letter}{len(names)}"
        yield f"const {kind} {name} = {FORMS[operation.name].format(*_shown(operation.arguments, names))};"
        names[operation] = name
    yield from (f"qdd[{k}] = {text};" for k, text in enumerate(_shown(results, names)))


def _shown(values: Iterable[Value], names: dict[Operation, str]) -> Iterator[str]:
    for value in values:
        if isinstance(value, Operation):
            yield names[value]
        elif isinstance(value, bool):
            yield str(int(value))
        else:
            text = repr(value).replace("nan", "NAN").replace("inf", "INFINITY")
            yield f"({text})" if text.startswith("-") else text
