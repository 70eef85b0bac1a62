"""Statistics of runs and episodes; runs and tables of them, their tables for readers, and learning curves."""

import itertools

import numpy as np
import pytest
from run_folders import CURVE, FOUR_R, REFUSALS, RPRP, csv_rows, says, write_run

from redundant_envs.scenes.scene import load_scene
from redundant_envs_train import statistics
from redundant_envs_train.evidence import outcomes
from redundant_envs_train.evidence.curves import MEASURES, curves, finding
from redundant_envs_train.evidence.runs import read_groups, read_run, read_runs, write_runs
from redundant_envs_train.evidence.table import results_table
from redundant_envs_train.run_folder import EPISODES
from redundant_envs_train.statistics import bootstrap, interquartile_mean, run_interval


@pytest.mark.parametrize(
    ("found", "expected"),
    [  # Newcombe 1998, table I: Wilson's score method without continuity correction
        (statistics.wilson(81, 263), (0.2553, 0.3662)), (statistics.wilson(0, 20), (0.0, 0.1611)),
        (statistics.sign_test(0, 6), 0.03125), (statistics.sign_test(1, 5), 0.21875),
        (statistics.sign_test(4, 4), 1.0),
        (interquartile_mean([100.0, 1.0, 2.0, -50.0]), 1.5),  # a whole quarter is left out on either side
        (interquartile_mean([1.0, 2.0, 9.0]), 4.0), (interquartile_mean([9, 1, 2, 3, 100]), 14.0 / 3.0),
    ],
)  # fmt: skip
def test_statistics_have_the_values_of_tables_and_of_hand(found, expected):
    assert found == pytest.approx(expected, abs=6e-5)


def test_what_differs_in_pairs_is_told_from_chance():
    normal = np.random.default_rng(3).normal
    base = normal(0.0, 10.0, 400)
    assert statistics.differs(base, base + normal(0.3, 1.0, 400))  # far less than their spread
    assert not statistics.differs(base, base + normal(0.0, 1.0, 400))
    assert not statistics.differs(base[:19], base[:19] + 1.0)  # too few
    held = np.ones(1000, dtype=bool)
    for missed, known in ((1, False), (5, False), (6, True)):
        assert statistics.differs(np.arange(1000) >= missed, held) == known


def test_bootstrap_agrees_with_the_normal_interval_and_the_binomial_and_keeps_columns_together():
    sample = np.random.default_rng(1).normal(3.0, 2.0, 1000)
    half = 1.96 * sample.std() / np.sqrt(1000)
    pairs = bootstrap(np.column_stack([sample, -2 * sample]), 10_000, 0)
    expected = sample.mean() - half, sample.mean() + half
    assert statistics.middle_95(pairs[:, 0]) == pytest.approx(expected, abs=0.01)
    np.testing.assert_allclose(pairs[:, 1], -2 * pairs[:, 0], atol=1e-12)
    means = bootstrap([0.0, 1.0], 40_000, 0)  # of two draws from {0, 1}
    assert [np.mean(means == m) for m in (0.0, 0.5, 1.0)] == pytest.approx([0.25, 0.5, 0.25], abs=0.01)


def test_the_interval_of_fewer_than_five_runs_is_unknown():
    assert np.isnan(run_interval([1.0, 2.0, 3.0, 4.0])).all()
    assert np.isfinite(run_interval([1.0, 2.0, 3.0, 4.0, 5.0])).all()


def test_groups_are_of_one_environment_learner_settings_scene_and_number_of_goals(tmp_path):
    springs = {"env_kwargs": {"scene": "rprp_limit_springs"}}
    folders = [
        write_run(tmp_path / "0", 0), write_run(tmp_path / "1", 1),
        write_run(tmp_path / "sac", 0, algo="sac"), write_run(tmp_path / "four", 0, FOUR_R),
        write_run(tmp_path / "wide", 0, settings={"ppo": {"net_arch": [128, 128]}}),
        write_run(tmp_path / "few", 0, episodes=100), write_run(tmp_path / "springs", settings=springs),
    ]  # fmt: skip
    groups = read_groups(folders)
    members = {(same.title, same.learner): [run.folder.name for run in same.runs] for same in groups}
    assert sorted(members.values()) == [["0", "1"], ["few"], ["four"], ["sac"], ["springs"], ["wide"]]
    assert ("FourRReach-v0", "PPO") in members  # nothing else of its environment and learner differs
    assert members["RPRPReach-v0 (rprp_limit_springs)", "PPO"] == ["springs"]
    assert any(name.endswith("ppo.net_arch=[128, 128]") for _, name in members)
    assert any(name.startswith("PPO, goals=100, ") for _, name in members)


def test_a_seed_counts_once_and_two_results_of_it_are_refused_by_both_names(tmp_path):
    first = write_run(tmp_path / "a", 0, restless=3, faults={"SPEED_BOUND": 1}, new="x")  # others tell less
    copy = write_run(tmp_path / "b", 0, machine="Other", date="2026-05-05", train_seconds=77.0)
    other = write_run(tmp_path / "c", 1)
    (same,) = read_groups([first, copy, other, first, f"{other}/"])
    assert [run.folder for run in same.runs] == [first, other]
    lower = [*CURVE[:2], (3000, 3.5, 0.96, 1.0, 70.0)]
    for k, result in enumerate(({"hold_success": 0.98}, {"curve": lower})):
        wrong = write_run(tmp_path / f"wrong{k}", 1, **result)
        with says(f"{other} and {wrong} are runs of seed 1", "give one"):
            read_groups([first, other, wrong])


def test_runs_of_a_table_are_those_of_the_folders(tmp_path):
    """They differ in all that a table keeps."""
    scene = load_scene("rprp_reach").to_dict()
    scene["robot"]["masses"] = [0.5, 0.5, 0.25, 0.1]
    base, path, weak = tmp_path / "runs", tmp_path / "new" / "runs.jsonl", {"scene": "four_r_weak"}
    folders = [
        write_run(base / "a/seed0", 0, machine="12", time_to_hold=None),
        write_run(base / "a/seed1", 1, curve=[], without=("effort",)),
        write_run(base / "b/0", 0, FOUR_R, "sac", settings={"env_kwargs": weak}),
        write_run(base / "c/x", 3, settings={"env_kwargs": {"scene": scene}}, versions={"a.b": "", "c": "1"}),
    ]
    write_runs(read_runs(folders), path)
    for one, other in zip(read_runs(folders), read_runs([path]), strict=True):
        for name in ("env", "learner", "seed", "settings", "scene", "evaluation", "simulator"):
            assert getattr(one, name) == getattr(other, name), name
        np.testing.assert_array_equal(one.curve, other.curve)
        assert other.folder == path / one.folder.relative_to(base)
    assert results_table([path]) == results_table(folders)
    picked = read_runs([path / "b" / "0", folders[0], path / "*seed1"])
    assert [run.folder.name for run in picked] == ["0", "seed0", "seed1"]
    with says("runs.jsonl has no run d/*; it has a/seed0, a/seed1, b/0 ..."):
        read_runs([path / "d" / "*"])


@pytest.mark.parametrize(("old", "new", "words"), REFUSALS["tables"])
def test_a_damaged_table_is_named_with_the_run(tmp_path, old, new, words):
    path = tmp_path / "runs.jsonl"
    write_runs([read_run(write_run(tmp_path / "seed0"))], path)
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    with says("runs.jsonl is no table of runs", "write it again", words):
        read_runs([path])


def row_of(base, **columns):
    """The row of a table of runs of the seeds 0, 1, ..., by its columns; each run has its own entries."""
    rows = zip(*columns.values(), strict=True)
    runs = [write_run(base / f"{k}", k, **dict(zip(columns, row, strict=True))) for k, row in enumerate(rows)]
    head, _, row, *_ = results_table(runs).split("\n\n")[0].split("\n")
    names, cells = ([cell.strip() for cell in line.strip("|").split(" | ")] for line in (head, row))
    return dict(zip(names, cells, strict=True))


def test_a_row_has_median_worst_and_interquartile_mean_of_its_seeds(tmp_path):
    holds = [0.9, 0.97, 0.98, 0.99, 1.0]
    low, high = run_interval(holds)
    shown = row_of(tmp_path, hold_success=holds)
    assert (shown["hold, median"], shown["hold, worst seed"]) == ("98.0 %", "90.0 %")
    assert shown["hold, IQM [95 % interval]"] == f"98.0 % [{100 * low:.1f} to {100 * high:.1f}]"


@pytest.mark.parametrize(
    ("holds", "verdict"),
    [
        ([0.98, 0.99, 0.995], "the expert holds more"),
        ([0.994, 0.995, 0.995], "no difference beyond chance"),
        ([0.99, 0.995, 1.0], "no difference beyond chance"),
        ([1.0, 1.0, 0.996], "the learner holds more"),
        ([1.0, 1.0, 1.0, 0.994], "the learner holds more (the expert holds more in 1 of 4 seeds)"),
    ],
)  # fmt: skip
def test_a_loss_beyond_chance_is_named(tmp_path, holds, verdict):
    shown = row_of(tmp_path, hold_success=holds, expert_hold_success=[0.995] * len(holds))
    assert shown["hold compared"] == verdict


def test_a_rate_below_one_is_never_shown_as_100_percent_and_early_ends_show_in_the_steps(tmp_path):
    steps, rates = [8_000_000, 2_000_000], [0.9996, 1.0]
    shown = row_of(tmp_path, hold_success=rates, touch_success=[1.0, 1.0], env_steps=steps)
    assert (shown["hold, median"], shown["touch, median"]) == ("99.9 %", "100.0 %")
    assert shown["steps, millions"] == "2 to 8"


@pytest.mark.long
def test_the_csv_holds_what_a_direct_computation_gives(tmp_path):
    folders, generator = [], np.random.default_rng(0)
    for algo, seed in itertools.product(("ppo", "sac"), range(5)):  # each with other seconds
        rates = np.sort(generator.integers(0, 501, (4, 2)), axis=None).reshape(4, 2) / 500
        curve = [(1000 * (k + 1), 10.0 * (k + 1) * (1 + 0.1 * seed), *rates[k], 20.0 * k) for k in range(4)]
        folders.append(write_run(tmp_path / f"{algo}_{seed}", seed, algo=algo, curve=curve))
    path = curves(folders, tmp_path / "out" / "curves.png")
    assert path == tmp_path / "out" / "curves.csv"
    assert (tmp_path / "out" / "curves.png").read_bytes().startswith(b"\x89PNG")
    found = csv_rows(path)
    assert len(found) == 2 * 2 * 4  # groups, axes, points
    tables = [np.loadtxt(f / "selection.csv", delimiter=",", skiprows=1) for f in folders[5:10]]
    steps = [row for row in found if row["environment"] == "RPRPReach-v0" and row["learner"] == "SAC"]
    for k, row in enumerate(row for row in steps if row["axis"] == "steps"):
        assert float(row["x"]) == tables[0][k, 0]
        for column, name in enumerate(MEASURES, start=2):
            values = [table_[k, column] for table_ in tables]
            expected = [np.mean(sorted(values)[1:-1]), *run_interval(values)]
            assert [float(row[f"{name}{end}"]) for end in ("", "_low", "_high")] == pytest.approx(expected)
        assert (float(row["expert_hold_success"]), float(row["expert_mean_return"])) == (1.0, 63.0)
    grid = np.linspace(14.0, 40.0, 4)  # the slowest run's first point, the fastest one's last
    for x, row in zip(grid, (row for row in steps if row["axis"] == "seconds"), strict=True):
        values = sorted(np.interp(x, table_[:, 1], table_[:, 2]) for table_ in tables)
        assert [float(row["x"]), float(row["hold_success"])] == pytest.approx([x, np.mean(values[1:-1])])


ENDS_LOW = [*CURVE[:2], (3000, 3.5, 0.34, 0.4, 20.0)]


@pytest.mark.parametrize(
    ("curves", "words"),
    [
        ({"ppo": CURVE}, "95 % of goals held from 0.003 million steps on"),
        ({"ppo": [*CURVE, (4000, 4.0, 1.0, 1.0, 80.0)], "sac": CURVE, "td3": ENDS_LOW},
         "99 % of goals held by PPO from 0.004 million steps on; 98 % by SAC, 34 % by TD3 at the end"),
        ({"ppo": [(1000, 1.0, 0.9999, 1.0, 1.0)], "sac": [*CURVE[:2], (4000, 4.0, 0.99, 1.0, 1.0)]},
         "99 % of goals held by PPO from 0.001 million steps on, by SAC from 0.004"),
        ({"ppo": ENDS_LOW, "sac": [(1000, 1.0, 0.4999, 1.0, 0.0)]},
         "49.9 % of goals held by SAC, 34 % by PPO at the end"),
    ],
)  # fmt: skip
def test_a_title_says_from_when_on_goals_are_held(curves, words, tmp_path):
    folders = [write_run(tmp_path / algo, algo=algo, curve=curve) for algo, curve in curves.items()]
    assert finding(read_groups(folders)) == words


@pytest.mark.parametrize(
    ("held", "words"),
    [
        ([1, 1, 1, 1], "4 of 4 goals held: half of the tips end within 1.5 mm"),
        ([1, 1, 1, 0], "3 of 4 goals held: half of the tips end within 1.5 mm, the missed 1 at 1200 mm"),
        ([0, 0, 0, 0], "0 of 4 goals held: half of the tips end within 1.5 mm, the missed 4 at 0.5 to "
         "1200 mm"),
        ([np.nan] * 4, "Half of the tips end within 1.5 mm"),
    ],
)  # fmt: skip
def test_a_title_says_where_the_tips_end(held, words):
    episodes = dict.fromkeys(EPISODES, np.zeros(4))
    episodes |= {"hold": np.array(held), "distance": np.array([0.0005, 0.001, 0.002, 1.234])}
    assert outcomes.finding({"env": RPRP}, episodes) == words
    figure = outcomes.figure({"env": RPRP, "algo": "ppo"}, np.column_stack([*episodes.values()]), 0.02)
    (panel,) = figure.axes
    assert (panel.get_title(loc="left").replace("\n", " "), panel.get_xlabel()) == (
        words, "distance of the tip at the end, mm",
    )  # fmt: skip
    episodes["distance"] = np.full(4, np.nan)
    assert outcomes.finding({"env": RPRP}, episodes) == "Half of 4 episodes return at least 0"


def test_what_cannot_be_drawn_is_refused(tmp_path):
    first, later = write_run(tmp_path / "0", 0), [(n, s + 100.0, *more) for n, s, *more in CURVE]
    for name, curve, words in (("1", [], "has no row in selection.csv"), ("2", later, "ends before another")):
        with says(f"{tmp_path / name} {words}"):
            curves([first, write_run(tmp_path / name, 1, curve=curve)], tmp_path / "a.png")
