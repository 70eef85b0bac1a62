"""The studies on tiny inputs: their columns and their refusals. No speed is asserted."""

from __future__ import annotations

import csv
import shutil

import pytest
import yaml

from redundant_envs.scenes.files import config_folder
from redundant_envs_train.config import checked
from studies import environments, stops, throughput
from studies.__main__ import main

CASE = {"arm": "RPRP", "integrator": "rk4"}
UNDER_TOLERANCE = {"arm": "FourR", "integrator": "rk8", "tolerance": 1e-9}
SPEEDS = {"lanes": 64, "repeats": 3, "cases": [CASE, UNDER_TOLERANCE]}


@pytest.mark.long
def test_throughput_writes_speeds_evaluations_and_true_errors(tmp_path):
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(SPEEDS), encoding="utf-8")
    assert main(["throughput", "--config", str(tmp_path / "c.yaml"), "--out", str(tmp_path)]) == 0
    lines = (tmp_path / "throughput.csv").read_text(encoding="utf-8").splitlines()
    row, other = ({c: yaml.safe_load(cell) for c, cell in cells.items()} for cells in csv.DictReader(lines))
    assert tuple(row) == throughput.COLUMNS
    assert 0.0 < row["ns_per_step_best"] <= row["ns_per_step_median"]
    assert 12.0 < other["evaluations_mean"] < 50.0
    assert other["share_below_tolerance"] >= 0.98


def test_a_tolerance_of_speeds_needs_the_4r_arm():
    throughput.load_study(config_folder("studies") / "throughput.yaml")
    with pytest.raises(ValueError, match="a tolerance needs FourR"):
        checked(throughput.Study, SPEEDS | {"cases": [CASE | {"tolerance": 1e-6}]})


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


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("accuracy --config nowhere.yaml", "nowhere.yaml"),
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
