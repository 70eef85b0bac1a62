"""The page of the report's lines: each as printed, beside the code that computes it."""

from __future__ import annotations

import ast
import inspect
import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import yaml

from redundant_envs.robots import derived, four_r, rprp

LINES = Path(__file__).parents[1] / "report" / "lines.yaml"
MODULES = {"RPRP": rprp, "FourR": four_r}
SYMBOLS = {
    "RPRP": ("a1 = l1 + r1", "a2 = l2 + r2", "mu2 = m2 + m3 + m4", "sigma = m3 l2 + m4 (l2 + r2)",
             "I = m3 l2^2 + m4 (l2 + r2)^2"),
    "FourR": ("mu1 = m1 + m2 + m3 + m4", "mu2 = m2 + m3 + m4", "mu3 = m3 + m4", "K12 = (m2 + m3 + m4) l1 l2",
              "K13 = (m3 + m4) l1 l3", "K14 = m4 l1 l4"),
}  # fmt: skip
"""What the code's symbols stand for."""
NOTES = {
    "RPRP": """\
`s12`, `c12` are sin, cos(theta1 - theta2); `w1`, `v1`, `w2`, `v2` are theta1', r1', theta2', r2'. The springs
with k1 and k2 are the effect CentringSpring.""",
    "FourR": """\
`s21`, `c21` are sin, cos(theta2 - theta1), and so on, so sin(theta1 - theta2) is `-s21`; `w1` is theta1'.
K_ij is the mass that the outer of links i and j carries, times both lengths.""",
}
HEAD = """\
# The report, line by line

After reading this page you can find the code of each equation that the report prints. Both arms obey
`M(q) qdd + h(q, qd) + G(q) = Q`, eqs. (3) and (6), and the report prints `h + G` as one. Lines that it prints
wrongly are marked, and the code has the corrected ones ([errata](../errata.md)). A simulator does not form
`M`: it eliminates the links one after the other (`forward_dynamics`, `held_dynamics`), and tests show that
both agree. Eqs. (2) and (5), `J qd`, are `tip_velocity` in `derived.py`."""
WIDTH = 84  # of a formula, in characters
SECTION = r"\d\.\d(?:\.\d)?|eq\. \(\d\)"
MARK = re.compile(
    rf"[Rr]eport ({SECTION})(?: and ({SECTION}))?(?:, (\w+(?:(?:, | = )\w+)*)(?=\W|$)(?! [a-z]))?"
)


def tex(line: str) -> str:
    """A line of the report in TeX."""
    text = re.sub(r"1/2", r"\\frac{1}{2}", line.replace("theta", r"\theta"))
    text = re.sub(r"(?<![\w{])l(max|min)(\d)", r"l_{\2,\1}", text)
    text = re.sub(r"(\\theta|\b[a-zA-Z]+?)(\d+)'", r"\\dot{\1}_{\2}", text)
    text = re.sub(r"(\\theta|\bmu|\b[a-zA-Z])(\d+)(?!\w)", r"\1_{\2}", text)
    text = re.sub(r"\b(mu|sigma)(?=\b|_)", r"\\\1", text)
    return re.sub(r"\b(sin|cos)\(", r"\\\1(", text)


def broken(line: str) -> Iterator[str]:
    """A sum in lines of at most ``WIDTH`` characters, divided at the signs of its terms."""
    part = ""
    for term in re.split(r" (?=[+-] (?![^()]*\)))", line):
        if part and len(part) + len(term) > WIDTH:
            yield part
            part = ""
        part = f"{part} {term}".strip()
    yield part


def marked(module: ModuleType) -> dict[tuple[str, str], list[str]]:
    """Code by the section and the name of each line of the report that its comments mark."""
    source = inspect.getsource(module)
    text, found = source.splitlines(), dict[tuple[str, str], list[str]]()
    functions = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef)]
    for number, line in enumerate(text):
        for *sections, names in MARK.findall(line):
            code, _, _ = line.partition("# report")
            if "#" not in line:  # in a docstring: the whole function
                around = next(f for f in functions if f.lineno <= number + 1 <= f.end_lineno)
                code = "\n".join(text[around.body[1].lineno - 1 : around.end_lineno])
            elif not code.strip():  # above its line
                code = text[number + 1]
            for section, name in itertools.product(
                filter(None, sections), re.split(r", | = ", names or "all")
            ):
                found.setdefault((section, name.strip()), []).append(inspect.cleandoc(f"\n{code}").strip())
    return found


def code_of(section: str, name: str, code: dict[tuple[str, str], list[str]]) -> list[str]:
    """Code of a printed line, which may be a sum as H1 + G1."""
    parts = [code.get((section, part)) or code.get((section, "all"), []) for part in name.split(" + ")]
    return [line for part in parts for line in part]


def page() -> str:
    """Every printed line of the equations beside its code."""
    parts = [HEAD]
    for kind, sections in yaml.safe_load(LINES.read_text(encoding="utf-8")).items():
        module = MODULES[kind]
        code = marked(derived) | marked(module)
        parts += [f"## {kind}", f"`{Path(module.__file__ or '').name}`: {NOTES[kind]}"]
        parts += [f"$${tex(line)}$$" for line in SYMBOLS[kind]]
        for section, lines in sections.items():
            parts.append(f"### {section}")
            for name, line in lines.items():
                parts += [*row(name, line, code_of(section, name, code))]
    return "\n\n".join(parts)


def row(name: str, line: Any, code: list[str]) -> Iterator[str]:
    """One printed line, its correction and its code."""
    if isinstance(line, str):
        line = {"printed": line}
    for what, text in line.items():
        if len(line) > 1:
            yield "**Printed wrongly:**" if what == "printed" else "**Corrected:**"
        first, *more = broken(text)
        yield f"$${tex(name)} = {tex(first)}$$"
        yield from (f"$$\\quad {tex(further)}$$" for further in more)
    yield "```{code-block} python\n" + "\n".join(dict.fromkeys(code)) + "\n```"
