"""Bring mended faults back, in a copy, and run the test of each: ``python -m tests.faults [PART ...]``."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import yaml

from redundant_envs.progress import counted

ROOT = Path(__file__).parents[2]
KERNELS = os.environ.get("REDUNDANT_ENVS_CACHE") or str(ROOT / ".pytest_cache" / "kernels")
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


def tested(tests: list[str], copy: Path) -> str:
    """The outcome of tests in a copy of the tree: green, red, or what else happened."""
    paths = {"PYTHONPATH": f"{copy}{os.pathsep}{copy / 'agents'}", "REDUNDANT_ENVS_CACHE": KERNELS}
    options = ["-B", "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
    command = [sys.executable, *options, "-m", "not long", *tests]
    try:
        done = subprocess.run(command, cwd=copy, env=os.environ | paths, capture_output=True, timeout=SECONDS)
    except subprocess.TimeoutExpired:
        return "hung"
    return {0: "green", 1: "red"}.get(done.returncode, "not run")


def outcome(fault: Fault, copy: Path, green: bool) -> str:
    before = "green" if green else tested([fault.test], copy)
    if before != "green":
        return f"NOT SEEN, as its test is {before} without it"
    path = copy / fault.file
    whole = path.read_text(encoding="utf-8")
    path.write_text(fault.brought_back(whole), encoding="utf-8")
    after = tested([fault.test], copy)
    path.write_text(whole, encoding="utf-8")
    return "red" if after == "red" else f"NOT SEEN, as its test is {after}"


def main(parts: list[str]) -> int:
    chosen = [fault for fault in faults() if not parts or any(part in fault.name for part in parts)]
    outcomes: dict[Fault, str] = {}
    with tempfile.TemporaryDirectory() as folder, counted("faults", len(chosen)) as told:

        def work(worker: int) -> None:
            copy, share = Path(folder, str(worker)), chosen[worker::WORKERS]
            shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".*", "runs", "__pycache__"))
            green = tested([fault.test for fault in share], copy) == "green"  # quicker than one by one
            for fault in share:
                outcomes[fault] = outcome(fault, copy, green)
                told(f"{outcomes[fault]}: {fault.name}")

        with ThreadPoolExecutor(WORKERS) as pool:
            list(pool.map(work, range(WORKERS)))
    unseen = [fault for fault in chosen if outcomes[fault] != "red"]
    print(*[f"{outcomes[fault]}: {fault.name} ({fault.test})" for fault in unseen], sep="\n")
    print(f"{len(chosen) - len(unseen)} of {len(chosen)} faults are seen")
    return 1 if unseen else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
