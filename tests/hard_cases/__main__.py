"""Write the page of hard cases and its pictures: ``python -m tests.hard_cases [--out FOLDER]``.

The page has each case, and results of naive variants, MuJoCo and this package. ``make docs`` makes it, too.
"""

import argparse
import datetime
import importlib.util
import math
import os
import sys
import textwrap
from itertools import groupby
from pathlib import Path

import numpy as np

import redundant_envs as rde
from redundant_envs.support import palette
from redundant_envs.support.figures import bare, new_figure, save_figure
from redundant_envs.support.machine import machine_name
from redundant_envs.support.tables import markdown

from .cases import BENT, CASES, PARTICLE, STATE_B, energy, errors_of_five_impacts, falling, flying_by
from .engine import MuJoCo
from .hard_case import Accelerations, Run, Subject
from .naive import DenseSolve, ExplicitEuler, FixedSteps, FlippedVelocity, ImpulseAtStepEnd

ROOT = Path(__file__).parents[2]
INTRODUCTION = """# Hard cases

This page shows how this package, textbook methods and MuJoCo fare in cases that break simulators. Each case
is a row in `tests/hard_cases`; its conditions are numbers. Naive variants have one textbook mistake each
(`naive.py`), and a test shows that they fail the case. MuJoCo runs RK4 with steps of 1 ms, with the masses,
efforts and travel of the case, links without inertia, and elastic limits. `python -m tests.hard_cases`
writes this page.

`python -m redundant_envs verify` judges more of any scene: whether lanes depend on their neighbours, on
threads, copies or snapshots, whether impacts are those of rigid bodies, and whether steps have their order.

Bold numbers miss their bound. A dash means that there is no finite number, or no result. `standard` and
`exact` are the tip errors of 1e-6 and 1e-12 m that error control allows in a control interval of 20 ms.
"""


def heading(case):
    return f"### {case.number}. {case.title[0].upper()}{case.title[1:]}"


def measured(case, with_mujoco):
    """Figures of this package, of the variants that fail the case, and of MuJoCo if it can simulate it."""
    subjects = [Subject(), *(variant() for variant in case.caught)]
    subjects += [MuJoCo()] * (case.compared and with_mujoco)
    return {subject.name: list(case.figures(subject)) for subject in subjects}


def cell(figure):
    """A found number; bold where it misses its bound, a dash where there is none."""
    found = "–" if math.isnan(figure.found) else f"{figure.found:.2g}"
    return found if figure.kept else f"**{found}**"


def section(case, found):
    """The section of the page about one case."""
    lines = [heading(case), "", case.hard, "", f"*Naive:* {case.naive}"]
    if case.mujoco:
        lines += ["", f"*MuJoCo:* {case.mujoco}"]
    rows = [
        [figure.name.rstrip(","), str(figure.promise), *(cell(each[k]) for each in found.values())]
        for k, figure in enumerate(found[Subject.name])
    ]
    lines += ["", markdown(["", "promised", *found], rows, formatted=True), ""]
    if case.number in PICTURES:
        draw, what = PICTURES[case.number]
        lines += [f"![{what}](hard_cases/{draw.__name__}.png)", ""]
    return lines


def text(results, machine, date):
    """The whole page of cases, with their results by number."""
    head, rows = ["case", "", "figures that keep their bound", "naive variants that fail it"], []
    for case in CASES:
        own, names = results[case.number][Subject.name], ", ".join(x.name for x in case.caught)
        rows.append([case.number, case.title, f"{sum(f.kept for f in own)} of {len(own)}", names])
    summary = markdown(head, rows, formatted=True)
    lines = [INTRODUCTION, f"Measured on {date} on {machine}.", "", summary, ""]
    for theme, some in groupby(CASES, lambda case: case.theme):
        lines += [f"## {theme}", ""]
        for case in some:
            lines += section(case, results[case.number])
    return "\n".join(lines)


# ---- pictures ---------------------------------------------------------------------------------------------


COLOURS = {Subject.name: palette.BLUE, MuJoCo.name: palette.GREY, ImpulseAtStepEnd.name: palette.AMBER}
"""Of subjects; the only naive variant of a picture has another one."""


def look(name):
    """Label and colour of a line."""
    return {"label": name, "color": COLOURS.get(name, palette.VERMILION)}


def vanishing_masses(axes, with_mujoco):
    masses, worst = 10.0 ** np.arange(-12.0, 0.5, 0.5), {}
    arms = [rde.FourR((light, light, light, 1.0), (0.5,) * 4) for light in masses]
    for subject in (Subject(), DenseSolve(), *[MuJoCo()] * with_mujoco):
        errors = [Accelerations(arm, *BENT, (0.1,) * 4).error(subject) for arm in arms]
        axes.loglog(masses, np.maximum(errors, 1e-17), marker=".", **look(subject.name))
        worst[subject.name] = np.nanmax(errors)
    axes.set(xlabel="mass of the first three links, kg", ylabel="error of qdd, share of the largest")
    return "Accelerations are off by up to " + ", ".join(
        f"{error:.0e} in {name}" for name, error in worst.items()
    )


def fly_by(axes, with_mujoco):
    ends = []
    for subject, style in ((FixedSteps(), "o-"), (Subject(), ".")):
        points = PARTICLE.points(subject.motion(flying_by(0.01)).q[:, 0])[:, 1]
        axes.plot(points[:, 0], 1e3 * points[:, 1], style, markersize=4, **look(subject.name))
        ends.append(points[-1])
    axes.plot(0.0, 0.0, "+", color=palette.DARK, markersize=10, label="base")
    axes.set(xlabel="x, m", ylabel="y, mm")
    return (
        f"{FixedSteps.name.capitalize()} lead the particle {np.linalg.norm(ends[0] - ends[1]):.2g} m astray"
    )


def chaos(axes, with_mujoco):
    times, off = 0.02 * np.arange(1, 1001), {}
    for setting, tolerance, subject, style in (
        (" of 5 ms", 1e-6, ExplicitEuler(), "-"),
        *(("", 1e-6, x, "-") for x in [MuJoCo()] * with_mujoco),
        (", standard", 1e-6, Subject(), "-"),
        (", exact", 1e-12, Subject(), ":"),
    ):
        scene = falling(tolerance=tolerance)
        motion = subject.motion(Run(scene, *STATE_B, 1000))
        total = energy(scene, motion.q[:, 0], motion.qd[:, 0])
        errors, label = np.abs(total[1:] - total[0]), f"{subject.name}{setting}"
        of_name = {**look(subject.name), "label": label}
        axes.semilogy(times, np.maximum(errors, 1e-16), style, linewidth=1, **of_name)
        off[label] = f"{float(f'{np.nanmax(errors):.1g}'):g} J"
    axes.set(xlabel="time, s", ylabel="energy that came or went, J", ylim=(1e-15, 1e3))
    return "Of 98 J come or go: " + ", ".join(f"{lost} ({who})" for who, lost in off.items())


def five_impacts(axes, with_mujoco):
    steps, gains = np.array([1e-2, 5e-3, 2.5e-3, 1e-3, 5e-4]), {}
    for subject in (FlippedVelocity(), ImpulseAtStepEnd(), Subject()):
        errors, *_ = errors_of_five_impacts(subject, steps)
        axes.loglog(1e3 * steps, 1e3 * np.array(errors), marker="o", **look(subject.name))
        gains[subject.name] = (errors[0] / errors[-1]) ** (np.log(2.0) / np.log(steps[0] / steps[-1]))
    axes.set(xlabel="step of RK4, ms", ylabel="tip error after 0.5 s, mm")
    return "Half the step divides the error by " + ", ".join(f"{x:.2g} ({who})" for who, x in gains.items())


PICTURES = {
    "3": (vanishing_masses, "Error of the accelerations over the mass of the first three links"),
    "10": (fly_by, "Paths of the particle that passes the base at 1 cm"),
    "11": (chaos, "Energy error of the chaotic motion over time"),
    "23": (five_impacts, "Tip error after five impacts over the step"),
}
"""Number of a case -> function that draws its picture, whose name is that of the file, and returns the title,
which states what it shows; and what the picture is of."""


def draw_pictures(folder, with_mujoco):
    folder.mkdir(parents=True, exist_ok=True)
    for draw, _ in PICTURES.values():
        figure = new_figure(6.4, 3.6, 120)
        axes = figure.subplots()
        title = textwrap.fill(draw(axes, with_mujoco), 80)
        axes.set_title(title, loc="left", fontsize="small", fontweight="bold")
        bare(axes)
        figure.legend(frameon=False, fontsize=8, loc="outside lower center", ncols=2)
        save_figure(figure, folder / f"{draw.__name__}.png")


def main(arguments):
    parser = argparse.ArgumentParser(
        prog="python -m tests.hard_cases", description="Write the page of hard cases."
    )
    parser.add_argument("--out", type=Path, default=Path("runs/hard_cases"), help="default: %(default)s")
    out = parser.parse_args(arguments).out
    os.environ.setdefault("REDUNDANT_ENVS_CACHE", str(ROOT / ".pytest_cache" / "kernels"))
    with_mujoco = importlib.util.find_spec("mujoco") is not None
    if not with_mujoco:
        print("mujoco is not installed: the page will have no figures of it", file=sys.stderr)
    draw_pictures(out / "hard_cases", with_mujoco)
    results = {}
    for case in CASES:
        print(f"case {case.number}, {case.title}", flush=True)
        results[case.number] = measured(case, with_mujoco)
    page = text(results, machine_name(), datetime.date.today().isoformat())
    (out / "hard_cases.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
