"""Counts of the house: lines by folder, long functions, selections and masks in the code of events.

``python -m tests.house`` prints them beside what they were at commit 86b3b5f, when the lane's interval became
a program.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
CORE = ("tracing", "backends", "lane", "batch", "events", "numerics")
"""Folders of the package that were tracing, backends, simulator and integrators."""
EVENTS = (
    "lane/program.py", "lane/boundaries.py", "lane/guards.py", "lane/coordinates.py", "events/boundary.py",
    "events/complementarity.py", "events/contacts.py", "events/crossings.py", "events/first_event.py",
    "events/search.py",
)  # fmt: skip
"""Program, boundaries, searches and contacts."""
MOST_ARGUMENTS, MOST_LINES = 8, 60
BEFORE = {"core": 8338, "wheel": 28989, "agents": 9074, "tests": 38330, "selections": 179}
"""Lines at commit 86b3b5f, when wheel and agents had the studies, and calls of ``where`` and ``cases`` in
what EVENTS replaces."""
SHARES = {"core": 0.84, "wheel": 0.75, "agents": 0.82, "tests": 0.63}


def python_files(*folders: Path) -> list[Path]:
    return [path for folder in folders for path in sorted(folder.rglob("*.py"))]


def lines(*folders: Path) -> int:
    """Lines of all Python files of some folders."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in python_files(*folders))


def calls(*paths: Path) -> int:
    """Calls of ``where`` and ``cases``."""
    nodes = (n for path in paths for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    called = [n.func.id for n in nodes if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)]
    return called.count("where") + called.count("cases")


def counts() -> dict[str, int]:
    package = ROOT / "redundant_envs"
    return {
        "core": lines(*(package / folder for folder in CORE)),
        "wheel": lines(package),
        "agents": lines(ROOT / "agents"),
        "tests": lines(ROOT / "tests"),
        "selections": calls(*(package / name for name in EVENTS)),
    }


class Long(NamedTuple):
    """A function with many lines or arguments."""

    place: str
    lines: int
    arguments: int


def long_functions() -> list[Long]:
    """Functions of the core with more than :data:`MOST_LINES` or :data:`MOST_ARGUMENTS`."""
    found = []
    for path in python_files(*(ROOT / "redundant_envs" / folder for folder in CORE)):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                count = sum(a.arg not in ("self", "cls") for a in given)
                size = (node.end_lineno or node.lineno) - node.lineno + 1
                if size > MOST_LINES or count > MOST_ARGUMENTS:
                    found.append(Long(f"{path.relative_to(ROOT)}:{node.name}", size, count))
    return found


def main() -> None:
    for name, now in counts().items():
        share = f", at most {SHARES[name]}" if name in SHARES else ", at most 40 calls"
        print(f"{name:<11} {now:>6} of {BEFORE[name]:>6}: {now / BEFORE[name]:.3f}{share}")
    for place, size, count in long_functions():
        print(f"{place}: {size} lines, {count} arguments")


if __name__ == "__main__":
    sys.exit(main())
