"""Figures of learning curves, and the numbers written beside them."""

import csv
import itertools
from pathlib import Path

import numpy as np
import pytest
from run_folders import CURVE, FOUR_R, RPRP, write_run

from redundant_envs_train.evidence.curves import MEASURES, curves, draw, summarize
from redundant_envs_train.evidence.runs import read_groups
from redundant_envs_train.statistics import run_interval


def make_runs(base: Path, seeds: int = 3) -> list[Path]:
    """Runs of two learners on two environments, each with different seconds."""
    generator = np.random.default_rng(0)
    folders = []
    for env in (RPRP, FOUR_R):
        for algo in ("ppo", "sac"):
            for seed in range(seeds):
                rates = np.sort(generator.integers(0, 501, (4, 2)), axis=None).reshape(4, 2) / 500
                curve = [
                    (1000 * (k + 1), 10.0 * (k + 1) * (1 + 0.1 * seed), *rates[k], 20.0 * k) for k in range(4)
                ]
                name = f"{env.rpartition('/')[2]}_{algo}_{seed}"
                folders.append(write_run(base / name, seed, env, algo, curve))
    return folders


def test_the_ticks_of_success_tell_98_from_100_percent(tmp_path):
    figure = draw(read_groups(make_runs(tmp_path)), ("steps", "seconds"))
    figure.canvas.draw()
    assert len(figure.subfigs) == 2
    for part in figure.subfigs:
        assert len(part.axes) == 6
        for panel in (panel for panel in part.axes if "success" in panel.get_title(loc="left")):
            assert "logarithmic" in panel.get_title(loc="left")
            labels = [tick.get_text() for tick in panel.get_yticklabels()]
            assert {"0", "50", "90", "99", "100"} <= set(labels)
            boxes = [tick.get_window_extent() for tick in panel.get_yticklabels()]
            assert all(a.y1 <= b.y0 for a, b in itertools.pairwise(boxes))  # none overlap
            low, high = panel.transData.transform([(1.0, 0.98), (1.0, 1.0)])[:, 1]
            assert high - low > 0.2 * panel.get_window_extent().height


def test_the_legend_names_learners_seeds_and_computed_torque(tmp_path):
    folders = [*make_runs(tmp_path), write_run(tmp_path / "goal", env="redundant_envs/RPRPGoalReach-v0")]
    parts = draw(read_groups(folders), ("steps",)).subfigs
    legends = [[text.get_text() for text in part.legends[0].get_texts()] for part in parts]
    assert legends[0][:3] == ["PPO (3 seeds)", "SAC (3 seeds)", "computed torque"]
    assert "PPO (1 seed)" in legends[1]
    colors = {line.get_label(): line.get_color() for line in parts[2].axes[0].get_lines()}
    assert colors["PPO (3 seeds)"] != colors["SAC (3 seeds)"]
    assert colors["computed torque"] == "black"


def test_computed_torque_is_drawn_at_its_success_and_return(tmp_path):
    folder = write_run(tmp_path / "a", expert_hold_success=0.97)
    hold, touch, returns = draw(read_groups([folder]), ("steps",)).subfigs[0].axes
    levels = [
        [line.get_ydata()[0] for line in panel.get_lines() if line.get_label() == "computed torque"]
        for panel in (hold, touch, returns)
    ]
    assert levels == [[0.97], [], [63.0]]


def test_learners_of_very_different_length_share_a_logarithmic_axis(tmp_path):
    long = [(20 * steps, *rest) for steps, *rest in CURVE]
    folders = [write_run(tmp_path / "ppo", curve=long), write_run(tmp_path / "sac", algo="sac")]
    steps, seconds = draw(read_groups(folders), ("steps", "seconds")).subfigs[0].axes[::3]
    assert (steps.get_xscale(), seconds.get_xscale()) == ("log", "linear")
    assert steps.get_xlabel() == "environment steps, millions (logarithmic)"


def test_the_csv_holds_what_a_direct_computation_gives(tmp_path):
    folders = make_runs(tmp_path / "runs", 5)
    path = curves(folders, tmp_path / "out" / "curves.png")
    assert path == tmp_path / "out" / "curves.csv"
    assert (tmp_path / "out" / "curves.png").read_bytes().startswith(b"\x89PNG")
    with path.open() as file:
        found = list(csv.DictReader(file))
    assert len(found) == 4 * 2 * 4  # groups, axes, points
    tables = [np.loadtxt(f / "selection.csv", delimiter=",", skiprows=1) for f in folders[5:10]]
    steps = [row for row in found if row["environment"] == "RPRPReach-v0" and row["learner"] == "SAC"]
    for k, row in enumerate(row for row in steps if row["axis"] == "steps"):
        assert float(row["x"]) == tables[0][k, 0]
        for column, name in enumerate(MEASURES, start=2):
            values = [table_[k, column] for table_ in tables]
            assert float(row[name]) == pytest.approx(np.mean(sorted(values)[1:-1]))
            low, high = run_interval(values)
            assert float(row[f"{name}_low"]) == pytest.approx(low)
            assert float(row[f"{name}_high"]) == pytest.approx(high)
        assert (float(row["expert_hold_success"]), float(row["expert_mean_return"])) == (1.0, 63.0)
    grid = np.linspace(14.0, 40.0, 4)  # the slowest run's first point, the fastest one's last
    for x, row in zip(grid, (row for row in steps if row["axis"] == "seconds"), strict=True):
        values = sorted(np.interp(x, table_[:, 1], table_[:, 2]) for table_ in tables)
        assert float(row["x"]) == pytest.approx(x)
        assert float(row["hold_success"]) == pytest.approx(np.mean(values[1:-1]))


def test_of_two_points_at_one_step_the_last_counts(tmp_path):
    curve = [*CURVE, (3000, 3.6, 0.5, 0.5, 50.0)]
    (same,) = read_groups([write_run(tmp_path / "a", curve=curve)])
    found = summarize(same, "steps")
    np.testing.assert_array_equal(found.x, [1000, 2000, 3000])
    np.testing.assert_array_equal(found.middle[-1], [0.5, 0.5, 50.0])
    assert np.isnan(found.low).all()


def test_a_figure_of_one_seed_is_written_as_svg(tmp_path):
    path = curves([write_run(tmp_path / "a")], tmp_path / "one.svg")
    assert "<svg" in (tmp_path / "one.svg").read_text()
    with path.open() as file:
        assert {row["hold_success_low"] for row in csv.DictReader(file)} == {""}


def test_a_figure_that_cannot_be_written_is_refused_before_anything_is_read(tmp_path):
    with pytest.raises(ValueError, match=r"path is '.*a.gif'; end its name in .png or .svg"):
        curves([tmp_path / "missing"], tmp_path / "a.gif")


def test_a_run_without_a_curve_is_named(tmp_path):
    with pytest.raises(ValueError, match=f"{tmp_path / 'a'} has no row in selection.csv"):
        curves([write_run(tmp_path / "a", curve=[])], tmp_path / "a.png")


def test_runs_without_common_time_are_named(tmp_path):
    late = [(steps, seconds + 100.0, *rest) for steps, seconds, *rest in CURVE]
    folders = [write_run(tmp_path / "a", 0), write_run(tmp_path / "b", 1, curve=late)]
    with pytest.raises(ValueError, match=f"{folders[0]} ends at 3.5 and {folders[1]} starts at 101"):
        curves(folders, tmp_path / "a.png")
