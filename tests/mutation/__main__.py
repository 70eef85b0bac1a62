"""Draw mutants at random and run the tests on each: ``python -m tests.mutation --count 300 --seed 1``.

Mutants are those of cosmic-ray (``pip install cosmic-ray``), one operator, constant or condition of one line
each. A worker has a copy of the repository of its own, in which it writes one mutant after the other; quick
comparisons with records run first, then the other quick tests, then the long ones, and the first test that
fails ends the run. Annotations, docstrings and error messages are left out: no test could see them.

``--mended [PART]`` brings back the mended faults of ``mended.yaml``, or those with PART in their names, and
runs the test of each.
"""

import argparse
import ast
import csv
import random
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from . import mended
from .copies import ROOT, Outcome, in_copies, outcome

PACKAGE = "redundant_envs"
EQUATIONS = ("robots/rprp", "robots/four_r", "robots/derived", "robots/added_inertia")
EVENTS = ("boundary", "crossings", "first_event", "search", "contacts", "complementarity")
LANE = ("dynamics", "parameters", "kinks", "common_step", "step_control", "boundaries",
        "boundary", "stiction", "stops", "features", "program",
        "interval")  # fmt: skip
MODULES = (
    *EQUATIONS, "scenes/tableaus", "language/limits",
    *(f"simulator/numerics/{m}" for m in ("methods", "error_control")),
    *(f"simulator/events/{m}" for m in EVENTS),
    *(f"simulator/lane/{m}" for m in LANE),
)  # fmt: skip
RECORDS = "tests/lane/test_recorded_programs.py", "tests/verify/test_recorded_bits.py"
"""Any change of a program or a motion is one for them. They collect quickly."""
TESTS = ("tests/robots", "tests/numerics", "tests/events", "tests/effects", "tests/lane",
         "tests/oracles", "tests/hard_cases", "tests/outside", "tests/model", "tests/control",
         "tests/test_dialect.py")  # fmt: skip
QUICK, LONG = "not long", "long"
SECONDS = {QUICK: 300.0, LONG: 1800.0}
"""For a stage of tests: on two idle cores the quick ones take 10 and 100 s."""
COLUMNS = ("module", "line", "function", "operator", "outcome", "seconds", "test", "before", "after")


class Place(NamedTuple):
    """Where a mutant could be."""

    module: str  # path from the root of the repository
    line: int
    function: str  # in which it is
    operator: str  # cosmic-ray's name of the change
    occurrence: int  # index among those in the module that this operator can change


def unseen_spans(tree: ast.AST) -> Iterator[tuple[int, int, int, int]]:
    """Line and column of the ends of code that no test could check: annotations, docstrings, error
    messages."""
    for node in ast.walk(tree):
        hidden: list[Any] = []
        docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if isinstance(node, ast.FunctionDef | ast.arg | ast.AnnAssign):
            hidden = [node.returns if isinstance(node, ast.FunctionDef) else node.annotation]
        elif docstring or isinstance(node, ast.Raise | ast.ImportFrom | ast.Import):
            hidden = [node]
        for part in hidden:
            if part is not None:
                yield part.lineno, part.col_offset, part.end_lineno, part.end_col_offset


def places_of(module: str) -> Iterator[Place]:
    """All possible mutations of a module."""
    import cosmic_ray.plugins
    from cosmic_ray.ast import ast_nodes, get_ast_from_path
    from cosmic_ray.ast.ast_query import ASTQuery

    path = ROOT / module
    hidden = list(unseen_spans(ast.parse(path.read_text(encoding="utf-8"))))
    nodes = list(ast_nodes(get_ast_from_path(path)))
    for name in cosmic_ray.plugins.operator_names():
        operator = cosmic_ray.plugins.get_operator(name)
        if operator.arguments():
            continue
        starts = [(n, start) for n in nodes for start, _ in operator().mutation_positions(n)]
        for occurrence, (node, start) in enumerate(starts):
            if not any((a, b) <= tuple(start) < (c, d) for a, b, c, d in hidden):
                yield Place(module, start[0], ASTQuery(node).get_definition_name() or "", name, occurrence)


def stages(recorded: bool) -> Iterator[tuple[list[str], str]]:
    """Tests and the mark that selects among them, the quickest first, with or without records."""
    others = [*TESTS, *(f"--ignore={name}" for name in RECORDS)]
    if recorded:
        yield [*RECORDS], QUICK
    yield others, QUICK
    if recorded:
        yield [*RECORDS], LONG
    yield others, LONG


def row_of(place: Place, clone: Path, recorded: bool) -> dict[str, Any]:
    """A row of ``COLUMNS``."""
    import cosmic_ray.plugins
    from cosmic_ray.mutating import mutate_code

    path = clone / place.module
    whole, start = path.read_text(encoding="utf-8"), time.monotonic()
    changed = mutate_code(whole, cosmic_ray.plugins.get_operator(place.operator)(), place.occurrence) or whole
    path.write_text(changed, encoding="utf-8")
    kernels = str(clone / "kernels")
    found = Outcome("green")
    for tests, mark in stages(recorded):
        if found.result == "green":
            found = outcome(tests, clone, kernels, mark, SECONDS[mark])
    path.write_text(whole, encoding="utf-8")
    before, after = whole.splitlines(), changed.splitlines()
    told = {"green": "survived", "hung": "hung"}.get(found.result, "killed")
    row = place._asdict() | {
        "outcome": told,
        "test": found.failed,
        "seconds": round(time.monotonic() - start),
    }
    row |= {"before": before[place.line - 1].strip(), "after": after[min(place.line, len(after)) - 1].strip()}
    return {name: row[name] for name in COLUMNS}


def run(options: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows of the mutants, written as they come."""
    everything = [place for name in options.modules for place in places_of(f"{PACKAGE}/{name}.py")]
    drawn = random.Random(options.seed).sample(everything, options.count)
    print(f"{options.count} of {len(everything)} mutants of {len(options.modules)} modules", file=sys.stderr)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    with open(options.out, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()

        def told(place: Place, clone: Path) -> str:
            rows.append(row := row_of(place, clone, options.records))
            writer.writerow(row)
            file.flush()
            return f"{row['outcome']}: {row['module']}:{row['line']} {row['operator']}"

        in_copies("mutants", drawn, options.workers, told)
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/mutation.csv"))
    parser.add_argument("--modules", nargs="+", choices=MODULES, default=MODULES, metavar="MODULE")
    no_records = "leave out the tests that compare with records"
    parser.add_argument("--no-records", dest="records", action="store_false", help=no_records)
    parser.add_argument("--mended", nargs="?", const="", metavar="PART", help="bring mended faults back")
    options = parser.parse_args()
    if options.mended is not None:
        return mended.run(options.mended, options.workers)
    rows = run(options)
    left = [row for row in rows if row["outcome"] != "killed"]
    for row in left:
        place = f"{row['outcome']}: {row['module']}:{row['line']} {row['operator']}"
        print(f"{place}\n  - {row['before']}\n  + {row['after']}")
    killed = len(rows) - len(left)
    print(f"{killed} of {len(rows)} mutants killed, {100.0 * killed / len(rows):.1f} %")
    return 0


if __name__ == "__main__":
    sys.exit(main())
