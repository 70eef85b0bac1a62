"""Write the page of hard cases and its pictures: ``python -m tests.hard_cases [--out FOLDER]``.

The page has each case, and results of naive variants, MuJoCo and this package. ``make docs`` makes it, too.
"""

import argparse
import datetime
import importlib.util
import math
import os
import sys
from itertools import groupby
from pathlib import Path

import numpy as np

import redundant_envs as rde
from redundant_envs.support.figures import bare, new_figure, save_figure
from redundant_envs.support.machine import machine_name
from redundant_envs.support.tables import markdown

from . import TESTS
from . import measured as m
from .engine import MuJoCo
from .hard_case import all_cases, shown
from .naive import CubicGuess, DenseSolve, ExplicitEuler, FixedSteps, FlippedVelocity, ImpulseAtStepEnd
from .subject import Subject

INTRODUCTION = """# Hard cases

This page shows how this package, textbook methods and MuJoCo fare in cases that break simulators. Each case
is a test in `tests/hard_cases`; its conditions are numbers. Naive variants have one textbook mistake each
(`naive.py`), and a test shows that they fail the case. MuJoCo runs RK4 with steps of 1 ms, with the masses,
efforts and travel of the case, links without inertia, and elastic limits. `python -m tests.hard_cases`
writes this page.

Bold numbers miss their bound. A dash means that there is no finite number, or no result. `standard` and
`exact` are the tip errors of 1e-6 and 1e-12 m that error control allows in a control interval of 20 ms.
"""


def heading(case):
    return f"### {case.number}. {case.title[0].upper()}{case.title[1:]}"


def measured_by(case, with_mujoco):
    """Figures of this package, of the variants that fail the case, and of MuJoCo if it can simulate it."""
    subjects = [Subject(), *(variant() for variant in case.variants)]
    subjects += [MuJoCo()] * (case.compared and with_mujoco)
    return {subject.name: case.figures(subject) for subject in subjects}


def cell(figure):
    """A found number; bold where it misses its bound, a dash where there is none."""
    if math.isnan(figure.found):
        return "**–**"
    return shown(figure.found) if figure.kept else f"**{shown(figure.found)}**"


def section(case, found):
    """The section of the page about one case."""
    lines = [heading(case), "", case.hard, "", f"*Naive:* {case.naive}"]
    if case.mujoco:
        lines += ["", f"*MuJoCo:* {case.mujoco}"]
    rows = []
    for k, figure in enumerate(found[Subject.name]):
        sign = "≤" if figure.relation == "at most" else "≥"
        label = f"{figure.name.rstrip(',')}{', ' + figure.unit if figure.unit else ''}"
        rows.append([label, f"{sign} {shown(figure.bound)}", *(cell(each[k]) for each in found.values())])
    lines += ["", markdown(["", "promised", *found], rows, formatted=True), ""]
    if case.number in PICTURES:
        draw, what = PICTURES[case.number]
        lines += [f"![{what}](hard_cases/{draw.__name__}.png)", ""]
    return lines


def summary(cases, results):
    """One row for each case."""
    head, rows = ["case", "", "figures that keep their bound", "naive variants that fail it", "test"], []
    for case in cases:
        own, test = results[case.number][Subject.name], f"`{case.measure.__name__}`"
        kept = f"{sum(f.kept for f in own)} of {len(own)}"
        names = ", ".join(variant.name for variant in case.variants)
        rows.append([case.number, case.title, kept, names, test])
    return markdown(head, rows, formatted=True)


def text(cases, results, machine, date):
    """The whole page of cases, with their results by number."""
    lines = [
        INTRODUCTION,
        f"{len(cases)} cases are measured. Single precision (35) is left out: this package has none.",
        "",
        f"Measured on {date} on {machine}.",
        "",
        summary(cases, results),
        "",
    ]
    for theme, some in groupby(cases, lambda case: case.theme):
        lines += [f"## {theme}", ""]
        for case in some:
            lines += section(case, results[case.number])
    return "\n".join(lines)


# ---- pictures -------------------------------------------------------------------------------------------


def vanishing_masses(axes, with_mujoco):
    q, qd, Q = (0.3, 1.2, -2.0, 0.8), (1.0, -2.0, 3.0, -4.0), (0.1,) * 4
    masses = 10.0 ** np.arange(-12.0, 0.5, 0.5)
    for subject in (Subject(), DenseSolve(), *[MuJoCo()] * with_mujoco):
        errors = [
            m.acceleration_error(subject, rde.FourR((*[light] * 3, 1.0), (0.5,) * 4), q, qd, Q)
            for light in masses
        ]
        axes.loglog(masses, np.maximum(errors, 1e-17), marker=".", label=subject.name)
    axes.set(xlabel="mass of the first three links, kg (log)", ylabel="error of qdd, relative (log)")


def fly_by(axes, with_mujoco):
    arm, b = rde.RPRP((1e-12, 1.0, 1e-12, 1e-12), (0.5, 0.5)), 0.01
    radius = np.hypot(1.0, b)
    start = (np.arctan2(b, -1.0), radius - 0.5, 0.0, 0.0), (-b / radius**2, -1.0 / radius, 0.0, 0.0)
    scene = rde.Scene(arm, (), tolerance=1e-6)
    for subject, style in ((FixedSteps(), "o-"), (Subject(), ".")):
        points = arm.points(subject.motion(scene, *start, 100).q[:, 0])[:, 1]
        axes.plot(points[:, 0], 1e3 * points[:, 1], style, label=subject.name, markersize=4)
    axes.plot(0.0, 0.0, "k+", markersize=10, label="base")
    axes.set(xlabel="x, m", ylabel="y, mm")


def chaos(axes, with_mujoco):
    times = 0.02 * np.arange(1001)
    for name, tolerance, subject in (
        ("explicit Euler of 5 ms", 1e-6, ExplicitEuler()),
        *((x.name, 1e-6, x) for x in [MuJoCo()] * with_mujoco),
        ("this package, standard", 1e-6, Subject()),
        ("this package, exact", 1e-12, Subject()),
    ):
        scene = rde.Scene(m.LAB, (m.GRAVITY,), tolerance=tolerance)
        motion = subject.motion(scene, *m.STATE_B, 1000)
        total = m.energy(scene, motion.q[:, 0], motion.qd[:, 0])
        axes.semilogy(times[1:], np.maximum(np.abs(total - total[0])[1:], 1e-16), label=name, linewidth=1)
    axes.set(xlabel="time, s", ylabel="energy error, J (log)", ylim=(1e-15, 1e3))


def five_impacts(axes, with_mujoco):
    steps = np.array([1e-2, 5e-3, 2.5e-3, 1e-3, 5e-4])
    for subject in (FlippedVelocity(), ImpulseAtStepEnd(), CubicGuess(), Subject()):
        errors, _ = m.five_impacts(subject, steps)
        label = "this package, RK4" if type(subject) is Subject else subject.name
        axes.loglog(1e3 * steps, 1e3 * np.array(errors), marker="o", label=label)
    axes.set(xlabel="step, ms (log)", ylabel="tip error after 0.5 s, mm (log)")


PICTURES = {
    "3": (vanishing_masses, "Error of the accelerations over the mass of the first three links"),
    "10": (fly_by, "Paths of the particle that passes the base at 1 cm"),
    "11": (chaos, "Energy error of the chaotic motion over time"),
    "23": (five_impacts, "Tip error after five impacts over the step"),
}
"""Cases with a picture: what draws it, whose name is that of its file, and its title."""


def draw_pictures(folder, with_mujoco):
    folder.mkdir(parents=True, exist_ok=True)
    for draw, _ in PICTURES.values():
        figure = new_figure(6.4, 3.6, 120)
        axes = figure.subplots()
        draw(axes, with_mujoco)
        bare(axes)
        axes.legend(frameon=False, fontsize=8, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
        save_figure(figure, folder / f"{draw.__name__}.png")


def main(arguments):
    parser = argparse.ArgumentParser(
        prog="python -m tests.hard_cases", description="Write the page of hard cases."
    )
    parser.add_argument("--out", type=Path, default=Path("runs/hard_cases"), help="default: %(default)s")
    out = parser.parse_args(arguments).out
    os.environ.setdefault("REDUNDANT_ENVS_CACHE", str(TESTS.parent / ".pytest_cache" / "kernels"))
    with_mujoco = importlib.util.find_spec("mujoco") is not None
    if not with_mujoco:
        print("mujoco is not installed: the page will have no figures of it", file=sys.stderr)
    draw_pictures(out / "hard_cases", with_mujoco)
    cases, results = all_cases(), {}
    for case in cases:
        print(case.name, flush=True)
        results[case.number] = measured_by(case, with_mujoco)
    today = datetime.date.today().isoformat()
    (out / "hard_cases.md").write_text(text(cases, results, machine_name(), today), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
