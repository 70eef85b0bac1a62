"""The studies on tiny inputs: their columns and their refusals. No speed is asserted."""

from __future__ import annotations

import csv
import os
import shutil

import numpy as np
import pytest
import yaml

from redundant_envs import load_scene
from redundant_envs.scenes.files import config_folder
from redundant_envs_train.config import checked
from studies import environments, stops, throughput
from studies.__main__ import main

CASE = {"arm": "RPRP", "integrator": "rk4", "bar_ns": 28}
SPEEDS = {"lanes": 32, "repeats": 3, "bar_gflops": 53, "cases": [CASE]}


@pytest.mark.long
def test_throughput_writes_columns_and_numbers(tmp_path, capsys):
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(SPEEDS), encoding="utf-8")
    allowed = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
    assert main(["throughput", "--config", str(tmp_path / "c.yaml"), "--out", str(tmp_path)]) == 0
    if allowed is not None:
        assert os.sched_getaffinity(0) == allowed
    assert "ns_per_step_best" in capsys.readouterr().out
    (cells,) = csv.DictReader((tmp_path / "throughput.csv").read_text(encoding="utf-8").splitlines())
    row = {column: yaml.safe_load(cell) for column, cell in cells.items()}
    assert tuple(row) == throughput.COLUMNS
    assert 0.0 < row["ns_per_step_best"] <= row["ns_per_step_median"]
    assert row["scaled_bar_ns"] == pytest.approx(28 * 53 / row["dgemm_gflops"], rel=1e-2)
    assert row["within_bar"] == (row["ns_per_step_best"] <= row["scaled_bar_ns"])


@pytest.mark.long
def test_throughput_of_error_control_counts_evaluations_and_true_errors():
    case = {"arm": "FourR", "integrator": "rk8", "tolerance": 1e-9, "bar_ns": 700, "bar_evaluations": 50}
    (row,) = throughput.run(checked(throughput.Study, SPEEDS | {"repeats": 1, "cases": [case]}))
    assert 12.0 < row["evaluations_mean"] < 50.0
    assert row["share_below_tolerance"] >= 0.98
    assert row["tolerance"] == 1e-9


def test_a_batch_is_filled_with_masses_within_ten_percent_and_its_kernel_is_vectorised():
    scene = throughput.Case(**CASE).scene
    batch, _ = throughput.filled_batch(scene, 20)
    masses = batch._memory.read(("m1", "m2", "m3", "m4"))
    assert np.ptp(masses[:, 0]) > 0.0
    assert np.abs(masses / 0.5 - 1.0).max() <= 0.1
    count, _ = throughput.packed_instructions(scene)
    assert count is None or count > 100  # None where there is no x86 assembly


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"lanes": 0}, "lanes is 0; give a whole number from 1"),
        ({"cases": [CASE | {"arm": "SCARA"}]}, "arm is 'SCARA'; choose 'FourR'"),
        ({"cases": [CASE | {"tolerance": 1e-6}]}, "bar_evaluations"),
    ],
)
def test_a_wrong_config_of_speeds_is_refused(change, said):
    throughput.load_study(config_folder("studies") / "throughput.yaml")
    with pytest.raises(ValueError, match=said):
        checked(throughput.Study, SPEEDS | change)


@pytest.mark.long
def test_environment_columns(monkeypatch):
    # The subprocess that measures the import time takes seconds; it is left to the study.
    monkeypatch.setattr(environments, "first_step_seconds", lambda name: 0.5)
    found = environments.run(lanes=4, rounds=1, steps=120)
    assert [row["env"] for row in found] == list(environments.IDS)
    for row in found:
        assert tuple(row) == environments.COLUMNS
        numbers = ("vector_steps_per_s_best", "single_us_per_step", "cartpole_us_per_step")
        assert all(row[name] > 0 for name in numbers)


@pytest.mark.long
def test_the_study_of_stops_times_both_scenes_at_the_shares_asked_for():
    *shares, random = found = stops.run({"random": stops.random_policy(0)}, lanes=200, repeats=2)
    assert [row["touched_share"] for row in shares] == [0.01, 0.2]
    assert random["touched_share"] > 0.05
    for row in found:
        assert set(row) == set(stops.COLUMNS)
        assert row["ratio"] == pytest.approx(row["ns_with"] / row["ns_without"], rel=0.02)
        assert row["evaluations_with"] > row["evaluations_without"]


def test_touching_lanes_are_those_that_a_stop_concerns():
    scene = load_scene("rprp_reach")
    q = np.array([[0.0, 0.1, 0.0, 0.1], [0.0, 0.25, 0.0, 0.1], [0.0, 0.249, 0.0, 0.1], [0.0, 0.2, 0.0, 0.0]])
    qd = np.array([[0.0] * 4, [0.0] * 4, [0.0, 1.0, 0.0, 0.0], [0.0] * 4])
    got = stops.touching(scene, q, qd, np.zeros((4, 4)))
    np.testing.assert_array_equal(got, [False, True, True, True])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("accuracy --config nowhere.yaml", "there is no such file"),
        ("accuracy --redraw empty", "has no accuracy.csv"),
        ("throughput --out broken/a", "is broken/a, which is below the broken link"),
        ("throughput --config c.csv --out c.csv --force", "c.csv would be replaced"),
        ("environments --lanes 0", "lanes is 0"),
        ("effects Wind", "effect is 'Wind'; choose Armature, "),
        ("intervals --intervals 0", "intervals is 0; give at least 1"),
        ("stops --lanes 7", "lanes is 7; give at least 8"),
        ("nothing", "invalid choice: 'nothing'"),
        ("", "required: study"),
    ],
)
def test_mistakes_exit_with_2(words, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken").symlink_to("nowhere")
    (tmp_path / "empty").mkdir()
    shutil.copy(config_folder("studies") / "throughput.yaml", "c.csv")
    assert main(words.split()) == 2
    out, err = capsys.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)
    assert said in err
