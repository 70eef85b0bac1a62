"""The speeds of derived equations in docs/extending.md are those of the study."""

import csv
import re
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def test_figures_of_derived_equations_are_those_of_the_study():
    with (DOCS / "results" / "throughput_chains.csv").open(encoding="utf-8") as file:
        rows = {row["arm"]: row for row in csv.DictReader(file)}
    text = (DOCS / "extending.md").read_text(encoding="utf-8")
    said = re.findall(r"^\| `(.+?)` \| .+? \| (\d+) \| ([\d.]+) s \|$", text, re.MULTILINE)
    assert len(said) == len(rows) == 4
    for arm, nanoseconds, seconds in said:
        row = rows[re.sub(r'\("(\w+)"\)', r" \1", arm)]
        assert row["integrator"] == "rk8"
        assert int(nanoseconds) == round(float(row["ns_per_step_best"]))
        assert seconds == row["compile_seconds"]
