"""Tables of many runs."""

import pytest
from run_folders import write_run

from redundant_envs_train.evidence.table import table
from redundant_envs_train.statistics import run_interval


def cells(text: str, number: int) -> list[dict[str, str]]:
    """The rows of a Markdown table by their columns; a repeated column gets the one before as prefix."""
    lines = text.split("\n\n")[number].split("\n")
    split = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]
    head = [split[0][i - 1] + name if name.startswith("...") else name for i, name in enumerate(split[0])]
    return [dict(zip(head, line, strict=True)) for line in split[2:]]


def test_a_row_has_median_worst_and_interquartile_mean_of_its_seeds(tmp_path):
    holds = [0.9, 0.97, 0.98, 0.99, 1.0]
    for seed, hold in enumerate(holds):
        write_run(tmp_path / str(seed), seed, hold_success=hold, train_seconds=100.0 + seed)
    low, high = run_interval(holds)
    (shown,) = cells(table(sorted(tmp_path.iterdir())), 0)
    assert shown["hold, median"] == "98.0 %"
    assert shown["hold, worst seed"] == "90.0 %"
    assert shown["hold, IQM [95 % interval]"] == f"98.0 % [{100 * low:.1f} to {100 * high:.1f}]"
    assert (shown["steps, millions"], shown["training, s"], shown["steps per s"]) == ("8", "102", "78431")


@pytest.mark.parametrize(
    ("holds", "verdict"),
    [
        ([0.98, 0.99, 0.995], "computed torque holds more"),
        ([0.995, 0.995, 0.995], "equal"),
        ([0.99, 0.995, 1.0], "equal (computed torque holds more in 1 of 3 seeds)"),
        ([1.0, 1.0, 0.996], "the learner holds more"),
        ([1.0, 1.0, 0.99], "the learner holds more (computed torque holds more in 1 of 3 seeds)"),
    ],
)
def test_a_loss_is_named(tmp_path, holds, verdict):
    for seed, hold in enumerate(holds):
        write_run(tmp_path / str(seed), seed, hold_success=hold, expert_hold_success=0.995)
    (shown,) = cells(table(sorted(tmp_path.iterdir())), 0)
    assert shown["hold compared"] == verdict


def test_a_rate_below_one_is_never_shown_as_100_percent(tmp_path):
    for seed, hold in enumerate([0.9996, 1.0]):
        write_run(tmp_path / str(seed), seed, hold_success=hold, touch_success=1.0)
    (shown,) = cells(table(sorted(tmp_path.iterdir())), 0)
    assert (shown["hold, median"], shown["touch, median"]) == ("99.9 %", "100.0 %")


def test_the_second_table_compares_with_computed_torque(tmp_path):
    folder = write_run(tmp_path / "a", time_to_hold=None)
    (shown,) = cells(table([folder]), 1)
    assert shown == {
        "environment": "RPRPReach-v0", "learner": "PPO", "time to hold, s": "-",
        "time to hold, s... of computed torque": "1.2", "effort": "0.2",
        "effort... of computed torque": "0.4", "smoothness": "0.1",
        "smoothness... of computed torque": "0.3", "machine": "Abacus",
    }  # fmt: skip


def test_the_table_tells_goals_machines_versions_and_dates(tmp_path):
    write_run(tmp_path / "a", 0)
    write_run(tmp_path / "b", 1, machine="Z|1", date="2026-03-09T10:00:00")
    text = table(sorted(tmp_path.iterdir()))
    end = "Goals of each seed: 1000. Machine: Abacus; Z|1. torch: 2.13.0. stable-baselines3: 2.9.2. "
    assert text.endswith(end + "Evaluated from 2026-03-04 to 2026-03-09.")
    assert "Abacus; Z/1 |" in text


def test_seeds_that_stopped_early_show_in_the_steps(tmp_path):
    write_run(tmp_path / "a", 0)
    write_run(tmp_path / "b", 1, env_steps=2_000_000)
    (shown,) = cells(table(sorted(tmp_path.iterdir())), 0)
    assert shown["steps, millions"] == "2 to 8"


def test_what_an_old_folder_lacks_is_a_dash_and_one_seed_has_no_interval(tmp_path):
    lacking = (
        "env_steps", "train_seconds", "time_to_hold", "effort", "smoothness", "expert_time_to_hold",
        "expert_effort", "expert_smoothness",
    )  # fmt: skip
    folder = write_run(tmp_path / "old", without=lacking)
    (first,), (second,) = (cells(table([folder]), k) for k in (0, 1))
    assert first["hold, IQM [95 % interval]"] == "99.0 % [unknown]"
    assert (first["training, s"], first["steps per s"], first["steps, millions"]) == ("-",) * 3
    assert (second["time to hold, s"], second["effort"], second["smoothness"]) == ("-",) * 3
