"""The studies on tiny inputs: their columns and their refusals. No speed is asserted."""

from __future__ import annotations

import csv
import importlib.metadata
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


def written(path, **changes):
    """A file of a study of speeds, without cases."""
    data = {"lanes": 32, "repeats": 3, "bar_gflops": 53, "cases": [], **changes}
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return path


CASE = throughput.Case(arm="RPRP", integrator="rk4", bar_ns=28)


@pytest.mark.long
def test_throughput_writes_columns_and_numbers(tmp_path, capsys):
    config = written(tmp_path / "c.yaml", cases=[{"arm": "RPRP", "integrator": "rk4", "bar_ns": 28}])
    allowed = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
    assert main(["throughput", "--config", str(config), "--out", str(tmp_path)]) == 0
    if allowed is not None:
        assert os.sched_getaffinity(0) == allowed
    assert "ns_per_step_best" in capsys.readouterr().out
    (cells,) = csv.DictReader((tmp_path / "throughput.csv").read_text(encoding="utf-8").splitlines())
    row = {column: yaml.safe_load(cell) for column, cell in cells.items()}
    assert tuple(row) == throughput.COLUMNS
    assert 0.0 < row["ns_per_step_best"] <= row["ns_per_step_median"]
    assert row["scaled_bar_ns"] == pytest.approx(28 * 53 / row["dgemm_gflops"], rel=1e-2)
    assert row["within_bar"] == (row["ns_per_step_best"] <= row["scaled_bar_ns"])
    assert 0.0 < row["compile_seconds"] < 60.0
    assert row["llvmlite"] == importlib.metadata.version("llvmlite")


@pytest.mark.long
def test_throughput_of_error_control_counts_evaluations_and_true_errors():
    case = {"arm": "FourR", "integrator": "rk8", "tolerance": 1e-9, "bar_ns": 700, "bar_evaluations": 50}
    data = {"lanes": 64, "repeats": 1, "bar_gflops": 53, "cases": [case]}
    (row,) = throughput.run(checked(throughput.Study, data))
    assert 12.0 < row["evaluations_mean"] < 50.0
    assert row["share_below_tolerance"] >= 0.98
    assert row["tolerance"] == 1e-9


def test_kernel_is_vectorised_on_x86():
    count, register = throughput.packed_instructions(CASE.scene)
    if count is None:
        pytest.skip("no x86 assembly here")
    assert count > 100
    assert register in ("zmm", "ymm", "xmm")


def test_filled_batch_differs_by_lane_within_ten_percent():
    batch, _ = throughput.filled_batch(CASE.scene, 20)
    masses = batch._memory.read(("m1", "m2", "m3", "m4"))
    assert np.ptp(masses[:, 0]) > 0.0
    assert np.abs(masses / 0.5 - 1.0).max() <= 0.1


def test_shipped_config_loads():
    study = throughput.load_study(config_folder("studies") / "throughput.yaml")
    assert {case.arm for case in study.cases} == {*throughput.ARMS}
    assert {case.scene.robot.kind for case in study.cases} == {"FourR", "RPRP", "Chain"}


@pytest.mark.parametrize(
    ("change", "message"),
    [({"lanes": 0}, "lanes is 0; give a whole number from 1"), ({"wrong": 1}, "wrong is unknown; valid"),
     ({"cases": [{"arm": "RPRP"}]}, r"cases\[0\].integrator is missing"),
     ({"cases": [{"arm": "SCARA", "integrator": "rk4", "bar_ns": 1}]}, "arm is 'SCARA'; choose 'FourR'"),
     ({"cases": [{"arm": "FourR", "integrator": "rk8", "bar_ns": 1, "tolerance": 1e-6}]}, "bar_evaluations")],
)  # fmt: skip
def test_config_refuses(tmp_path, change, message):
    with pytest.raises(ValueError, match=message):
        throughput.load_study(written(tmp_path / "c.yaml", **change))


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
def test_stops_study_times_both_scenes_at_the_shares_asked_for():
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
    ("words", "message"),
    [
        ("throughput --config nowhere.yaml", "no such file"),
        ("throughput --out broken/a", "is broken/a, which is below the broken link"),
        ("throughput --config c.csv --out c.csv --force", "c.csv would be replaced"),
        ("environments --lanes 0", "lanes is 0"),
        ("effects --config nowhere.yaml", "no such file"),
        ("effects Wind", "effect is 'Wind'; choose Armature, "),
        ("stops --lanes 7", "lanes is 7; give at least 8"),
        ("nothing", "invalid choice: 'nothing'"),
        ("", "required: study"),
    ],
)
def test_mistakes_exit_with_2(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken").symlink_to("nowhere")
    shutil.copy(config_folder("studies") / "throughput.yaml", "c.csv")
    assert main(words.split()) == 2
    out, err = capsys.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)
    assert message in err
