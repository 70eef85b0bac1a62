"""Faults that were mended: each is brought back in a copy, and must turn its test red."""

import ast
import re
import sys
from pathlib import Path
from typing import NamedTuple

import yaml

from .copies import ROOT, in_copies, outcome


class Fault(NamedTuple):
    name: str
    file: str
    old: str  # as in the file, but for the indentation that all its lines share
    new: str
    test: str

    def brought_back(self, text: str) -> str:
        """The text of the file with the fault."""
        lines = r"\n(?P=margin)".join(re.escape(line) for line in self.old.splitlines())
        places = list(re.finditer(rf"^(?P<margin> *)(?P<before>.*?){lines}", text, re.MULTILINE))
        if len(places) != 1:
            raise ValueError(f"{self.file} has the quoted line {len(places)} times, not once: renew `old`")
        (place,) = places
        new = self.new.replace("\n", "\n" + place["margin"])
        found = text[: place.start()] + place["margin"] + place["before"] + new + text[place.end() :]
        if ast.dump(ast.parse(found)) == ast.dump(ast.parse(text)):
            raise ValueError(f"{self.file} means the same with the fault: renew `new`")
        return found


def faults() -> list[Fault]:
    return [Fault(**entry) for entry in yaml.safe_load(Path(__file__).with_name("mended.yaml").read_bytes())]


def run(part: str, workers: int) -> int:
    """Bring back the faults with ``part`` in their names; 1 if a test does not see its own."""
    chosen = [fault for fault in faults() if part in fault.name]
    if not chosen:
        print(f"the name of no fault has {part} in it", file=sys.stderr)
        return 2
    green = outcome([fault.test for fault in chosen], ROOT).result == "green"  # quicker than one by one
    told: dict[Fault, str] = {}

    def seen(fault: Fault, copy: Path) -> str:
        path = copy / fault.file
        whole = path.read_text(encoding="utf-8")
        without = "green" if green else outcome([fault.test], copy).result
        try:
            if without == "green":
                path.write_text(fault.brought_back(whole), encoding="utf-8")
                found = outcome([fault.test], copy).result
                told[fault] = "red" if found == "red" else f"NOT SEEN, as its test is {found}"
            else:
                told[fault] = f"NOT SEEN, as its test is {without} without it"
        except ValueError as error:
            told[fault] = f"NOT SEEN, as {error}"
        path.write_text(whole, encoding="utf-8")
        return f"{told[fault]}: {fault.name}"

    in_copies("faults", chosen, workers, seen)
    unseen = [fault for fault in chosen if told[fault] != "red"]
    print(*[f"{told[fault]}: {fault.name} ({fault.test})" for fault in unseen], sep="\n")
    print(f"{len(chosen) - len(unseen)} of {len(chosen)} faults are seen")
    return 1 if unseen else 0
