"""The table of a task's numbers on the page of an environment: default, unit, allowed range, meaning."""

import dataclasses
import re

import gymnasium as gym
import pytest
import track

import redundant_envs as rde
from redundant_envs.envs.pages import task_table
from redundant_envs.scene import load_scene
from redundant_envs.tasks.checks import check_task


def rows_of(text):
    cells = [[c.strip() for c in line[1:-1].split("|")] for line in text.splitlines()[2:]]
    return {name.strip("`"): rest for name, *rest in cells}


@pytest.mark.parametrize("kind", [rde.ReachTask, rde.tasks.GoalReachTask])
def test_every_number_has_a_default_a_unit_a_range_and_a_sentence(kind):
    rows = rows_of(task_table(kind()))
    assert list(rows) == [f.name for f in dataclasses.fields(kind)]
    assert set(kind.units) == set(rows)
    for name, (default, unit, allowed, meaning) in rows.items():
        assert float(default) == getattr(kind(), name)
        assert unit == kind.units[name]
        assert re.fullmatch(r"positive|\S+ to \S+|above \S+, at most \S+", allowed)
        assert meaning.endswith(".")
        assert len(meaning.split()) > 3
    assert rows["hold_speed"][1:3] == ["reaches/s", "1e-09 to 1e+09"]
    assert rows["start_angle"][1:3] == ["rad", "above 0, at most 1e+06"]


@pytest.mark.parametrize("env_id", ["redundant_envs/RPRPReach-v0", "redundant_envs/FourRGoalReach-v0"])
def test_the_page_of_an_id_has_the_table(env_id):
    page = type(gym.make(env_id).unwrapped).__doc__
    assert "| `goal_tolerance` | 0.02 | reaches | 1e-09 to 2 | Largest distance from the goal" in page


def test_a_task_from_outside_declares_units_and_sentences_where_its_numbers_are():
    rows = rows_of(task_table(track.TrackTask()))
    assert rows["period"] == ["8.0", "s", "positive", "Time of a turn."]
    assert rows["inner"] == rows_of(task_table(rde.ReachTask()))["inner"]


def test_a_number_without_a_unit_and_a_sentence_is_on_the_page_too():
    kind = dataclasses.make_dataclass("Odd", [("odd", float, 3.0)], bases=(rde.ReachTask,), frozen=True)
    assert rows_of(task_table(kind()))["odd"] == ["3.0", "", "positive", ""]


def test_a_unit_of_no_number_is_refused():
    kind = type("Odd", (rde.ReachTask,), {"units": {"perod": "s"}})
    with pytest.raises(
        ValueError, match=r"Odd\.units has 'perod'; choose start_angle, speed_bound, goal_tol"
    ):
        check_task(kind(), load_scene("rprp_reach"))
