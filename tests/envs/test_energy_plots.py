"""Energies of a motion, their table, figures and clip."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from redundant_envs import load_scene
from redundant_envs.envs import energy_plots as plots
from redundant_envs.envs.animation import animate, stated_limits
from redundant_envs.model import energy_run as energy


@pytest.mark.parametrize("name", sorted(energy.STARTS))
def test_total_energy_is_constant(name):
    run = energy.energy_run(name, load_scene(name), 0.6, energy.STARTS[name])
    assert run.drift < 1e-6
    assert np.abs(run.trajectory.work).max() < 1e-12 * run.scale


def test_sliders_reach_their_limit_springs():
    name = "rprp_limit_springs"
    run = energy.energy_run(name, load_scene(name), 1.0, energy.STARTS[name])
    for joint, (low, high) in stated_limits(run.scene).items():
        assert run.trajectory.q[:, joint].min() < low
        assert run.trajectory.q[:, joint].max() > high


def test_balance_closes_where_energy_is_lost():
    scene = dataclasses.replace(load_scene("rprp_reach"), substeps=100, tolerance=None)
    run = energy.energy_run("reach", scene, 0.5, (0.5, 0.1, 0.0, 0.1))
    assert run.total[-1] < run.total[0] - 0.01
    assert run.drift < 1e-5


def test_springs_left_out_is_not_constant():
    name = "rprp_report_spring"
    run = energy.energy_run(name, load_scene(name), 1.5, energy.STARTS[name])
    assert np.ptp(run.without_springs) > 0.1 * run.scale
    free = energy.energy_run("free", load_scene("four_r_free"), 0.1, energy.STARTS["four_r_free"])
    assert free.without_springs is None


def test_default_start_is_in_mid_travel():
    assert energy.default_start("mine", load_scene("rprp_reach")) == (0.0, 0.125, 0.0, 0.125)
    assert energy.default_start("mine", load_scene("four_r_reach")) == (0.0,) * 4


@pytest.mark.parametrize(
    ("seconds", "q", "field"),
    [(0.0, (0.0,) * 4, "seconds"), (np.nan, (0.0,) * 4, "seconds"), (1.0, (0.0,) * 3, "q"),
     (1.0, (0.0, np.inf, 0.0, 0.0), "q")],
)  # fmt: skip
def test_energy_refuses(seconds, q, field):
    with pytest.raises(ValueError, match=f"^{field} is"):
        energy.energy_run("free", load_scene("four_r_free"), seconds, q)


def test_figures(tmp_path):
    pytest.importorskip("matplotlib")
    name = "rprp_report_spring"
    run = energy.energy_run(name, load_scene(name), 0.1, energy.STARTS[name])
    for path in plots.save_figures(run, tmp_path):
        assert path.read_bytes().startswith(b"\x89PNG")
    assert "relative drift" in plots.total_figure(run).axes[0].get_title(loc="left")
    for figure in (plots.energies_figure(run), plots.total_figure(run)):
        assert all("[" in axes.get_ylabel() for axes in figure.axes)
        assert figure.axes[-1].get_xlabel() == "time [s]"


@pytest.mark.parametrize("name", ["rprp_limit_springs", "four_r_free"])
def test_arm_picture(name):
    run = energy.energy_run(name, load_scene(name), 0.05, energy.STARTS[name])
    picture = animate(run.trajectory).frame(-1)
    assert picture.shape == (480, 480, 3)
    assert picture.dtype == np.uint8
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 10
