"""Pictures of the page of hard cases."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from engine import STEP, MuJoCo
from measured import GRAVITY, LAB, SLIDING, STATE_B, acceleration_error, energy, stopped, tip_error
from naive import CubicGuess, DenseSolve, ExplicitEuler, FixedSteps, FlippedVelocity, ImpulseAtStepEnd
from page import PICTURES
from subject import Subject
from test_stops_and_impacts import START

import redundant_envs as rde
from redundant_envs.figures import bare, new_figure, save_figure

SIZE, DPI = (6.4, 3.6), 120


def draw(number, folder, with_mujoco):
    """Draw the picture of a case into a folder."""
    figure = new_figure(*SIZE, DPI)
    axes = figure.subplots()
    {"3": vanishing_masses, "10": fly_by, "11": chaos, "23": five_impacts}[number](axes, with_mujoco)
    bare(axes)
    axes.legend(frameon=False, fontsize=8, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    save_figure(figure, Path(folder) / f"{PICTURES[number][0]}.png")


def vanishing_masses(axes, with_mujoco):
    q, qd, Q = (0.3, 1.2, -2.0, 0.8), (1.0, -2.0, 3.0, -4.0), (0.1,) * 4
    masses = 10.0 ** np.arange(-12.0, 0.5, 0.5)
    for subject in (Subject(), DenseSolve(), *([MuJoCo()] if with_mujoco else [])):
        errors = [
            acceleration_error(subject, rde.FourR((m, m, m, 1.0), (0.5,) * 4), q, qd, Q) for m in masses
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
        *([(f"MuJoCo, RK4 of {1e3 * STEP:g} ms", 1e-6, MuJoCo())] if with_mujoco else []),
        ("this package, standard", 1e-6, Subject()),
        ("this package, exact", 1e-12, Subject()),
    ):
        scene = rde.Scene(LAB, (GRAVITY,), tolerance=tolerance)
        motion = subject.motion(scene, *STATE_B, 1000)
        total = energy(scene, motion.q[:, 0], motion.qd[:, 0])
        axes.semilogy(times[1:], np.maximum(np.abs(total - total[0])[1:], 1e-16), label=name, linewidth=1)
    axes.set(xlabel="time, s", ylabel="energy error, J (log)", ylim=(1e-15, 1e3))


def five_impacts(axes, with_mujoco):
    reference = rde.simulate(stopped(integrator="dop853"), *START, [0.5]).q[-1]
    steps = np.array([1e-2, 5e-3, 2.5e-3, 1e-3, 5e-4])
    for subject in (FlippedVelocity(), ImpulseAtStepEnd(), CubicGuess(), Subject()):
        errors = []
        for h in steps:
            subject.longest = h
            motion = subject.motion(stopped(integrator="rk4", control_dt=h), *START, round(0.5 / h))
            errors.append(1e3 * tip_error(SLIDING, motion.q[-1, 0], reference))
        label = "this package, RK4" if type(subject) is Subject else subject.name
        axes.loglog(1e3 * steps, errors, marker="o", label=label)
    axes.set(xlabel="step, ms (log)", ylabel="tip error after 0.5 s, mm (log)")
