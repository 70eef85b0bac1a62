"""Interquartile means, bootstrap intervals, and groups of runs."""

import numpy as np
import pytest
from run_folders import CURVE, FOUR_R, RPRP, config_text, write_run

from redundant_envs.scene import load_scene
from redundant_envs_train.evidence.runs import group, read_groups, read_run, read_runs, write_runs
from redundant_envs_train.evidence.table import table
from redundant_envs_train.statistics import interquartile_mean, run_interval

# ---- aggregates ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "mean"),
    [
        ([7.0], 7.0),
        ([1.0, 2.0, 9.0], 4.0),  # nothing is left out of up to three
        ([100.0, 1.0, 2.0, -50.0], 1.5),
        ([9.0, 1.0, 2.0, 3.0, 100.0], 14.0 / 3.0),  # 5 // 4: one on either side
        ([0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 90.0, 90.0], 2.5),
    ],
)
def test_interquartile_mean_leaves_out_a_whole_quarter_on_either_side(values, mean):
    assert interquartile_mean(values) == pytest.approx(mean, rel=1e-15)


def test_interquartile_mean_is_the_trimmed_mean_of_rliable():
    stats = pytest.importorskip("scipy.stats")
    values = np.random.default_rng(0).normal(size=(3, 11, 2))
    np.testing.assert_allclose(interquartile_mean(values, 1), stats.trim_mean(values, 0.25, axis=1))


def test_run_interval_covers_the_truth_at_about_its_rate():
    samples = np.random.default_rng(1).normal(3.0, 1.0, (20, 400))  # 400 experiments of 20 runs
    low, high = run_interval(samples)
    covered = np.mean((low <= 3.0) & (high >= 3.0))
    assert 0.87 <= covered <= 0.98  # percentile intervals of 20 runs are a little too narrow


def test_bootstrap_keeps_the_points_of_a_curve_together():
    curves_ = np.array([0.0, 5.0, 9.0, 4.0, 7.0])[:, None] + np.arange(4.0)  # (runs, points)
    for end in run_interval(curves_):
        np.testing.assert_allclose(np.diff(end), 1.0)


def test_bootstrap_does_not_depend_on_how_many_points_are_drawn_at_once(monkeypatch):
    samples = np.random.default_rng(3).normal(size=(6, 5))
    whole = run_interval(samples)
    monkeypatch.setattr("redundant_envs_train.statistics.MOST_NUMBERS", 100)
    np.testing.assert_array_equal(run_interval(samples), whole)


def test_the_interval_of_fewer_than_five_runs_is_unknown():
    assert np.isnan(run_interval([[1.0, 2.0]])).all()
    assert np.isnan(run_interval([1.0, 2.0, 3.0, 4.0])).all()
    assert np.isfinite(run_interval([1.0, 2.0, 3.0, 4.0, 5.0])).all()


# ---- runs ----------------------------------------------------------------------------------------


def test_a_run_knows_its_settings_without_the_seed(tmp_path):
    run = read_run(write_run(tmp_path / "a", seed=7, settings={"num_envs": 256}))
    assert (run.env, run.algo, run.seed) == (RPRP, "ppo", 7)
    assert run.settings["num_envs"] == 256
    assert "seed" not in run.settings
    np.testing.assert_array_equal(run.curve, CURVE)


def test_groups_are_of_one_environment_learner_settings_and_number_of_goals(tmp_path):
    folders = [
        write_run(tmp_path / "0", 0), write_run(tmp_path / "1", 1),
        write_run(tmp_path / "sac", 0, algo="sac"), write_run(tmp_path / "four", 0, FOUR_R),
        write_run(tmp_path / "wide", 0, settings={"ppo": {"net_arch": [128, 128]}}),
        write_run(tmp_path / "few", 0, episodes=100),
    ]  # fmt: skip
    groups = read_groups(folders)
    members = {(same.title, same.learner): [run.folder.name for run in same.runs] for same in groups}
    widths = sorted(name.partition("ppo.net_arch=")[2] for _, name in members if "PPO, " in name)
    assert sorted(members.values()) == [["0", "1"], ["few"], ["four"], ["sac"], ["wide"]]
    assert ("FourRReach-v0", "PPO") in members  # nothing else of its environment and learner differs
    assert widths[0] == "[128, 128]"
    assert len([name for _, name in members if name.startswith("PPO, goals=100, ")]) == 1


def test_another_scene_is_named_and_the_own_one_is_not(tmp_path):
    scenes = {
        "own": "rprp_reach",
        "springs": "rprp_limit_springs",
        "data": load_scene("rprp_reach").to_dict(),
    }
    for name, scene in scenes.items():
        write_run(tmp_path / name, settings={"env_kwargs": {"scene": scene}})
    titles = {
        same.runs[0].folder.name: same.title for same in read_groups(tmp_path / name for name in scenes)
    }
    assert titles["own"] == "RPRPReach-v0"
    assert titles["springs"] == "RPRPReach-v0 (rprp_limit_springs)"
    assert titles["data"].startswith("RPRPReach-v0 (scene ")


def test_a_seed_counts_once(tmp_path):
    first = write_run(tmp_path / "a", 0)
    copy = write_run(tmp_path / "b", 0, machine="Other", date="2026-05-05", train_seconds=77.0)
    other = write_run(tmp_path / "c", 1)
    (same,) = read_groups([first, copy, other, first, f"{other}/"])
    assert [run.folder for run in same.runs] == [first, other]


@pytest.mark.parametrize("change", ["evaluation", "curve"])
def test_two_results_of_one_seed_are_refused_by_both_names(tmp_path, change):
    first = write_run(tmp_path / "a", 3)
    other = {"curve": [*CURVE[:2], (3000, 3.5, 0.96, 1.0, 70.0)]}
    write_run(tmp_path / "b", 3, **(other if change == "curve" else {"hold_success": 0.98}))
    with pytest.raises(ValueError, match=f"{first} and {tmp_path / 'b'} are runs of seed 3.*give one"):
        group([read_run(first), read_run(tmp_path / "b")])


@pytest.mark.parametrize("name", ["config.yaml", "evaluation.json", "selection.csv"])
def test_a_folder_that_is_no_run_is_named_with_what_is_missing(tmp_path, name):
    (write_run(tmp_path / "run") / name).unlink()
    with pytest.raises(ValueError) as error:
        read_run(tmp_path / "run")
    assert str(tmp_path / "run") in str(error.value)
    assert name in str(error.value)


@pytest.mark.parametrize(
    "line", ["4000,nan,0.5,0.5,1", "4000,3.4,0.5,0.5,1", "2999,4,0.5,0.5,1", "4000,4,0.5,0.5", "x"]
)
def test_a_damaged_curve_is_refused(tmp_path, line):
    folder = write_run(tmp_path / "run")
    with (folder / "selection.csv").open("a") as file:
        file.write(line + "\n")
    with pytest.raises(ValueError, match=f"{folder}/selection.csv is damaged.*make it again"):
        read_run(folder)


def test_an_evaluation_of_another_run_is_refused(tmp_path):
    folder = write_run(tmp_path / "run", 1)
    (folder / "config.yaml").write_text(config_text(2, RPRP, "ppo", {}))
    with pytest.raises(ValueError, match=r"evaluation\.json has 1 as 'seed', and config.yaml has 2"):
        read_run(folder)


def test_no_folders_are_refused():
    with pytest.raises(ValueError, match="folders is empty; give at least one run folder"):
        table([])


def test_a_run_that_was_evaluated_by_an_older_version_is_the_same_run(tmp_path):
    old = write_run(tmp_path / "old")
    new = write_run(tmp_path / "new", restless=3)
    (only,) = read_groups([old, new])
    assert len(only.runs) == 1


# ---- tables of runs ------------------------------------------------------------------------------


def various_runs(base):
    """Folders of runs that differ in all that a table keeps."""
    scene = load_scene("rprp_reach").to_dict()
    scene["robot"]["masses"] = [0.5, 0.5, 0.25, 0.1]
    return [
        write_run(base / "a" / "seed0", 0, machine="12", time_to_hold=None),
        write_run(base / "a" / "seed1", 1, curve=[], without=("effort",)),
        write_run(base / "b" / "0", 0, FOUR_R, "sac", settings={"env_kwargs": {"scene": "four_r_weak"}}),
        write_run(
            base / "c" / "x", 3, settings={"env_kwargs": {"scene": scene}}, versions={"a.b": "", "c": "1"}
        ),
    ]


def test_runs_of_a_table_are_those_of_the_folders(tmp_path):
    folders, path = various_runs(tmp_path / "runs"), tmp_path / "new" / "runs.csv"
    write_runs(read_runs(folders), path)
    for one, other in zip(read_runs(folders), read_runs([path]), strict=True):
        for name in ("env", "algo", "learner", "seed", "settings", "scene", "evaluation", "simulator"):
            assert getattr(one, name) == getattr(other, name), name
        np.testing.assert_array_equal(one.curve, other.curve)
        assert other.folder == path / one.folder.relative_to(tmp_path / "runs")
    assert table([path]) == table(folders)
    picked = read_runs([path / "b" / "0", folders[0], path / "*seed1"])
    assert [run.folder.name for run in picked] == ["0", "seed0", "seed1"]
    with pytest.raises(ValueError, match=r"runs.csv has no run d/\*; it has a/seed0, a/seed1, b/0 ..."):
        read_runs([path / "d" / "*"])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("evaluation.hold_success", "hold", "'hold_success'"),
        ("0.99,", "1.99,", "has 1.99 as 'hold_success'"),
        (",rk8,", ",rk7,", "'rk7'"),
        ("config.total_steps", "config.total", "total"),
        ("[1000.0, 2000.0, 3000.0]", "[1000.0, 3000.0, 2000.0]", "steps or seconds go back"),
        ("[1000.0, 2000.0, 3000.0]", "[1000.0]", "shape"),
        ("run,", "name,", "'run'"),
    ],
)
def test_a_damaged_table_is_named_with_the_run(tmp_path, old, new, words):
    path = tmp_path / "runs.csv"
    write_runs([read_run(write_run(tmp_path / "seed0"))], path)
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(ValueError, match=r"runs.csv is no table of runs.*write it again") as error:
        read_runs([path])
    assert words in str(error.value)
