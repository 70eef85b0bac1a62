"""Bring mended faults back, in a copy, and run the test of each: ``python -m tests.faults [PART ...]``.

``--list`` writes the faults whose tests are long into docs/mutation.md, and brings none back.
"""

import ast
import functools
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple, TypeVar

import yaml

from redundant_envs.support.progress import counted

ROOT = Path(__file__).parents[2]
KERNELS = os.environ.get("REDUNDANT_ENVS_CACHE") or str(ROOT / ".pytest_cache" / "kernels")
T = TypeVar("T")
SECONDS, WORKERS = 1800.0, 2  # for a run of tests; at once


class Fault(NamedTuple):
    name: str
    file: str
    old: str  # as in the file, but for the indentation that all its lines share
    new: str
    test: str

    def places(self, text: str) -> list[re.Match[str]]:
        lines = r"\n(?P=margin)".join(re.escape(line) for line in self.old.splitlines())
        return list(re.finditer(rf"^(?P<margin> *)(?P<before>.*?){lines}", text, re.MULTILINE))

    def brought_back(self, text: str) -> str:
        (place,) = self.places(text)
        new = self.new.replace("\n", "\n" + place["margin"])
        return text[: place.start()] + place["margin"] + place["before"] + new + text[place.end() :]


def faults() -> list[Fault]:
    return [Fault(**entry) for entry in yaml.safe_load(Path(__file__).with_name("faults.yaml").read_bytes())]


PAGE = ROOT / "docs" / "mutation.md"
HEAD, TAIL = "<!-- faults that make test does not see -->\n", "<!-- end -->\n"
MAX_UNSEEN = 0.2
"""Share of the faults that only ``make test-long`` may see."""


@functools.cache
def body_of(path: str) -> list[ast.stmt]:
    """The statements of a file."""
    return ast.parse((ROOT / path).read_text(encoding="utf-8")).body


def is_long(test: str) -> bool:
    """Whether only ``make test-long`` runs a test, as its marks say."""
    path, name, row = re.match(r"(.*?)::(\w+)(?:\[(.*)\])?$", test).groups()
    body = body_of(path)
    assigned = [x for x in body if isinstance(x, ast.Assign)]
    marks = [ast.unparse(x.value) for x in assigned if ast.unparse(x.targets[0]) == "pytestmark"]
    (found,) = (x for x in body if isinstance(x, ast.FunctionDef) and x.name == name)
    for mark in found.decorator_list:
        if row and isinstance(mark, ast.Call) and ast.unparse(mark.func) == "pytest.mark.quick":
            return row not in [ast.literal_eval(x) for x in mark.args]
        marks.append(ast.unparse(mark))
    return "pytest.mark.long" in marks


def listed() -> str:
    """The page's list of faults whose tests are long."""
    found = faults()
    unseen = [fault for fault in found if is_long(fault.test)]
    head = f"{len(unseen)} of {len(found)} mended faults:\n\n"
    return head + "".join(f"* {fault.name} (`{fault.test}`)\n" for fault in unseen)


def outcome(tests: Sequence[str], copy: Path, kernels: str = KERNELS, mark: str = "not long") -> str:
    """The outcome of tests in a copy of the tree: green, red, or what else happened."""
    paths = {"PYTHONPATH": f"{copy}{os.pathsep}{copy / 'agents'}", "REDUNDANT_ENVS_CACHE": kernels}
    options = ["-B", "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
    command = [sys.executable, *options, "-m", mark, *tests]
    try:
        done = subprocess.run(command, cwd=copy, env=os.environ | paths, capture_output=True, timeout=SECONDS)
    except subprocess.TimeoutExpired:
        return "hung"
    return {0: "green", 1: "red"}.get(done.returncode, "not run")


def in_copies(what: str, items: Sequence[T], workers: int, do: Callable[[T, Path], str]) -> None:
    """Do something with each item in a copy of the tree, one for each worker, and tell what it returns."""
    with tempfile.TemporaryDirectory() as folder, counted(what, len(items)) as told:

        def work(worker: int) -> None:
            copy = Path(folder, str(worker))
            shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".*", "runs", "__pycache__"))
            for item in items[worker::workers]:
                told(do(item, copy))

        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(work, range(workers)))


def main(parts: list[str]) -> int:
    if parts == ["--list"]:
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(HEAD)
        PAGE.write_text(before + HEAD + listed() + TAIL + rest.partition(TAIL)[2], encoding="utf-8")
        return 0
    chosen = [fault for fault in faults() if not parts or any(part in fault.name for part in parts)]
    if not chosen:
        print(f"the name of no fault has {' or '.join(parts)} in it", file=sys.stderr)
        return 2
    green = outcome([fault.test for fault in chosen], ROOT, mark="") == "green"  # quicker than one by one
    outcomes: dict[Fault, str] = {}

    def seen(fault: Fault, copy: Path) -> str:
        mark = "" if is_long(fault.test) else "not long"
        found = "green" if green else outcome([fault.test], copy, mark=mark)
        if found == "green":
            path = copy / fault.file
            whole = path.read_text(encoding="utf-8")
            path.write_text(fault.brought_back(whole), encoding="utf-8")
            found = outcome([fault.test], copy, mark=mark)
            path.write_text(whole, encoding="utf-8")
            outcomes[fault] = "red" if found == "red" else f"NOT SEEN, as its test is {found}"
        else:
            outcomes[fault] = f"NOT SEEN, as its test is {found} without it"
        return f"{outcomes[fault]}: {fault.name}"

    in_copies("faults", chosen, WORKERS, seen)
    unseen = [fault for fault in chosen if outcomes[fault] != "red"]
    print(*[f"{outcomes[fault]}: {fault.name} ({fault.test})" for fault in unseen], sep="\n")
    print(f"{len(chosen) - len(unseen)} of {len(chosen)} faults are seen")
    return 1 if unseen else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
