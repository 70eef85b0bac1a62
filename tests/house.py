"""Weight of the house: ``python -m tests.house`` prints lines by room, words of the docs, and counts of the
engine.

A branch on a feature asks what a scene has; a test of a kind asks what kind a boundary is.
"""

import ast
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from tests.docs.words import count_words

ROOT = Path(__file__).parents[1]
FEATURES = {
    "active", "attempts", "begins", "bounces", "bounded", "boundaries", "bounds_late_switch", "closed",
    "control", "controlled", "counted", "counts_evaluations", "doubts", "draws",
    "frictions", "friction_with_stop", "guarded", "guards", "holding", "impulses_change_laws", "instants",
    "kinks", "laws", "local", "located", "locates_laws", "logs", "origin", "passed", "pieces",
    "pose_tells_distances", "renewed", "repeats_common_step", "resolves", "rests", "slipping", "sticking",
    "stiction", "stops", "varying", "watched_sliders",
}  # fmt: skip
KINDS = {"HoldingStop", "Stop", "HingeStop", "Wall", "LawChange", "Guard", "StickingJoint", "TravelStop"}
FLAGS = re.compile(r"\bb\.(joint|bounces|guards|sticks|holds)\b|\bb (not )?in (self\.)?dynamics\.\w+")


def lines(files: Iterable[Path]) -> int:
    """Lines of some files."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files)


def rooms(folder: Path) -> Iterator[tuple[str, int]]:
    """Lines of each room of a folder; its loose files are one."""
    sizes = ((p.name, lines(p.rglob("*.py"))) for p in sorted(folder.iterdir()) if p.is_dir())
    yield from (room for room in sizes if room[1])
    yield "loose files", lines(folder.glob("*.py"))


def conditions(engine: Path) -> Iterator[ast.expr]:
    """Conditions of all branches of the engine."""
    for path in engine.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.If | ast.IfExp):
                yield node.test
            elif isinstance(node, ast.comprehension):
                yield from node.ifs


def asked_in(test: ast.expr) -> Iterator[str]:
    """Last parts of the attributes that a condition asks for, but for methods."""
    of_others = {id(n.value) for n in ast.walk(test) if isinstance(n, ast.Attribute)}
    called = {id(n.func) for n in ast.walk(test) if isinstance(n, ast.Call)}
    for n in ast.walk(test):
        if isinstance(n, ast.Attribute) and id(n) not in of_others | called:
            yield n.attr


def counts(engine: Path) -> dict[str, int]:
    """Counts of the engine, the folder with the lanes of a simulation."""
    tests = [*conditions(engine)]
    asked = [set(asked_in(test)) for test in tests]
    kinds = [
        any({getattr(n, "id", ""), getattr(n, "attr", "")} & KINDS for n in ast.walk(test))
        or bool(FLAGS.search(ast.unparse(test)))
        for test in tests
    ]
    texts = "\n".join(p.read_text(encoding="utf-8") for p in engine.rglob("*.py"))
    dynamics = re.search(r"\nclass Dynamics\b.*?(?=\n(?:class|def|@) )", texts, re.DOTALL)
    return {
        "branches on features": sum(bool(names & FEATURES) for names in asked),
        "tests of a kind": sum(kinds),
        'lane[f"': texts.count('lane[f"'),
        "methods of Dynamics": len(re.findall(r"\n    def ", dynamics[0] if dynamics else "")),
    }


def main() -> None:
    for name in ("redundant_envs", "agents", "studies", "tests"):
        print(f"{name}: {lines((ROOT / name).rglob('*.py'))} lines")
        for room, size in rooms(ROOT / name):
            print(f"  {room:<22} {size:>6}")
    print(f"docs: {sum(count_words().values())} words")
    for name, count in counts(ROOT / "redundant_envs" / "simulator").items():
        print(f"{name}: {count}")


if __name__ == "__main__":
    main()
