"""Write the page of hard cases: ``python -m tests.hard_cases [--out FOLDER]``; ``make docs`` does, too."""

import argparse
import datetime
import math
import os
import sys
from itertools import groupby
from pathlib import Path

from redundant_envs.support.machine import machine_name
from redundant_envs.support.tables import markdown

from .cases import CASES

ROOT = Path(__file__).parents[2]
INTRODUCTION = """# Hard cases

This page shows how this package fares in cases that break simulators. Each case is a row in
`tests/hard_cases`; its conditions are numbers. `python -m tests.hard_cases` writes this page.

`python -m redundant_envs verify` judges more of any scene: whether lanes depend on their neighbours, on
threads, copies or snapshots, whether impacts are those of rigid bodies, and whether steps have their order.

Bold numbers miss their bound. `standard` and `exact` are the tip errors of 1e-6 and 1e-12 m that error
control allows in a control interval of 20 ms.
"""


def heading(case):
    return f"### {case.number}. {case.title[0].upper()}{case.title[1:]}"


def cell(figure):
    """A found number; bold where it misses its bound, a dash where there is none."""
    found = "–" if math.isnan(figure.found) else f"{figure.found:.2g}"
    return found if figure.kept else f"**{found}**"


def section(case, figures):
    """The section of the page about one case."""
    lines = [heading(case), "", case.hard, "", f"*Naive:* {case.naive}"]
    if case.mujoco:
        lines += ["", f"*MuJoCo:* {case.mujoco}"]
    rows = [[one.name.rstrip(","), str(one.promise), cell(one)] for one in figures]
    return [*lines, "", markdown(["", "promised", "found"], rows, formatted=True), ""]


def text(results, machine, date):
    """The whole page of cases, with their figures by number."""
    rows = [
        [case.number, case.title, f"{sum(f.kept for f in figures)} of {len(figures)}"]
        for case, figures in ((case, results[case.number]) for case in CASES)
    ]
    summary = markdown(["case", "", "figures that keep their bound"], rows, formatted=True)
    lines = [INTRODUCTION, f"Measured on {date} on {machine}.", "", summary, ""]
    for theme, some in groupby(CASES, lambda case: case.theme):
        lines += [f"## {theme}", ""]
        for case in some:
            lines += section(case, results[case.number])
    return "\n".join(lines)


def main(arguments):
    parser = argparse.ArgumentParser(
        prog="python -m tests.hard_cases", description="Write the page of hard cases."
    )
    parser.add_argument("--out", type=Path, default=Path("runs/hard_cases"), help="default: %(default)s")
    out = parser.parse_args(arguments).out
    os.environ.setdefault("REDUNDANT_ENVS_CACHE", str(ROOT / ".pytest_cache" / "kernels"))
    results = {}
    for case in CASES:
        print(f"case {case.number}, {case.title}", flush=True)
        results[case.number] = case.figures()
    out.mkdir(parents=True, exist_ok=True)
    page = text(results, machine_name(), datetime.date.today().isoformat())
    (out / "hard_cases.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
