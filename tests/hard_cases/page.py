"""docs/hard_cases.md from the catalogue: each case, and the results of naive variants, MuJoCo and this
package."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import numpy as np
from engine import MuJoCo
from hard_case import THEMES, Case, Figure, shown
from subject import Subject

import redundant_envs as rde
from redundant_envs.tables import markdown

COMMAND = "python tests/hard_cases"
PICTURES = {
    "3": ("vanishing_masses", "Error of the accelerations over the mass of the first three links"),
    "10": ("fly_by", "Paths of the particle that passes the base at 1 cm"),
    "11": ("chaos", "Energy error of the chaotic motion over time"),
    "23": ("five_impacts", "Tip error after five impacts over the step"),
}
"""Cases with a picture: its file, and its title."""


INTRODUCTION = f"""# Hard cases

    {COMMAND}

writes this page and its figures from the tests in [tests/hard_cases](../tests/hard_cases). Each case is a
test whose pass conditions are numbers. The same measurement is made of naive variants, each with one
textbook mistake ([tests/hard_cases/naive](../tests/hard_cases/naive)), and another test shows that they fail
the case. Where MuJoCo can simulate the case, it is measured, too: RK4 with steps of 1 ms, the masses,
efforts and travel of the case, links without inertia, and elastic limits.

Bold numbers miss their bound. A dash means that there is no finite number, or no result. `standard` and
`exact` are the tip errors of 1e-6 and 1e-12 m that error control allows in a control interval of 20 ms.
"""


def heading(case: Case) -> str:
    return f"### {case.number}. {case.title[0].upper()}{case.title[1:]}"


def measured_by(case: Case, with_mujoco: bool) -> dict[str, list[Figure]]:
    """Figures of this package, of the variants that fail the case, and of MuJoCo if it can simulate it."""
    subjects: list[Subject] = [Subject(), *(variant() for variant in case.caught)]
    if case.compared and with_mujoco:
        subjects.append(MuJoCo())
    return {subject.name: case.figures(subject) for subject in subjects}


def cell(figure: Figure) -> str:
    """A found number; bold where it misses its bound, a dash where there is none."""
    if math.isnan(figure.found):
        return "**–**"
    return shown(figure.found) if figure.kept else f"**{shown(figure.found)}**"


def subnormal_time() -> str:
    """Time of an interval with subnormal rates relative to one with others; speeds are not tested."""
    lanes, seconds = 1024, []
    scene = rde.Scene(rde.FourR((1.0,) * 4, (0.5,) * 4), (), tolerance=1e-6)
    for rate in (1.0, 1e-310):
        batch, best = rde.BatchSimulator(scene, lanes), math.inf
        for _ in range(300):
            batch.set_state(np.full(4, 0.3), np.full(4, rate))
            start = time.perf_counter()
            batch.advance()
            best = min(best, time.perf_counter() - start)
        seconds.append(best)
    times = f"{seconds[1] / seconds[0]:.2g} times as long as one at 1 rad/s"
    return (
        f"An interval at 1e-310 rad/s takes {times}. That is the processor's: an Intel needs many cycles for "
        "an operation with such a number, an AMD hardly more than for another one. To flush them to 0 would "
        "lose the rate."
    )


TIMED = {"18": subnormal_time}
"""Sentences with a time, measured when the page is written."""


def section(case: Case, found: dict[str, list[Figure]]) -> list[str]:
    """The section of the page about one case."""
    lines = [heading(case), "", case.hard, "", f"*Naive:* {case.naive}"]
    if case.mujoco:
        lines += ["", f"*MuJoCo:* {case.mujoco}"]
    if case.waiting_for:
        return [*lines, "", f"The case waits for the effect `{case.waiting_for}`.", ""]
    rows = []
    for k, figure in enumerate(found[Subject.name]):
        sign = "≥" if figure.at_most is None else "≤"
        label = f"{figure.name.rstrip(',')}{', ' + figure.unit if figure.unit else ''}"
        rows.append([label, f"{sign} {shown(figure.bound)}", *(cell(each[k]) for each in found.values())])
    lines += ["", markdown(["", "promised", *found], rows), ""]
    if case.number in TIMED:
        lines += [TIMED[case.number](), ""]
    if case.number in PICTURES:
        name, what = PICTURES[case.number]
        lines += [f"![{what}](hard_cases/{name}.png)", ""]
    return lines


def summary(cases: Sequence[Case], results: dict[str, dict[str, list[Figure]]]) -> str:
    """One row for each case."""
    head, rows = ["case", "", "figures that keep their bound", "naive variants that fail it", "test"], []
    for case in cases:
        own = results[case.number][Subject.name]
        kept = f"{sum(f.kept for f in own)} of {len(own)}"
        names = ", ".join(variant.name for variant in case.caught)
        if case.waiting_for:
            kept, names = f"waits for `{case.waiting_for}`", ""
        rows.append([case.number, case.title, kept, names, f"`{case.function}`"])
    return markdown(head, rows)


def text(cases: Sequence[Case], results: dict[str, dict[str, list[Figure]]], machine: str, date: str) -> str:
    """The whole page."""
    waiting = [case for case in cases if case.waiting_for]
    waits = ", ".join(f"{case.number} for `{case.waiting_for}`" for case in waiting)
    counts = f"{len(cases) - len(waiting)} cases are measured, {len(waiting)} wait for effects"
    lines = [
        INTRODUCTION,
        f"{counts} that do not exist yet: {waits}. Single precision (35) is left out: this package has none.",
        "",
        f"Measured on {date} on {machine}.",
        "",
        summary(cases, results),
    ]
    for module, title in THEMES.items():
        lines += ["", f"## {title}", ""]
        for case in cases:
            if case.module == module:
                lines += section(case, results[case.number])
        lines.pop()
    return "\n".join(lines) + "\n"
