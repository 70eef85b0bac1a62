"""Families of intervals: the tolerance is kept in each, and the study reports a family that misses it."""

import contextlib
import dataclasses
import pickle

import numpy as np
import pytest

from redundant_envs.verify import judging
from studies import estimates, intervals
from studies.__main__ import main
from studies.interval_families import FAMILIES, Family

QUICK = (
    "4R, limit springs",
    "RPRP, stops and springs",
    "4R, singular starts",
    "RPRP, lengths over six decades",
    "RPRP, strong dampers",
    "RPRP, smooth friction, 1e-09 m",
)


@pytest.mark.long
@pytest.mark.parametrize(
    "family",
    [pytest.param(f, id=f.name, marks=() if f.name in QUICK else pytest.mark.long) for f in FAMILIES],
)
def test_no_interval_of_a_family_is_off_without_a_flag(family):
    """``study intervals`` judges a million."""
    tally = intervals.judge_family(family, 1024, seed=12)
    assert tally.missed == 0
    assert tally.judged >= 0.8 * tally.intervals
    assert tally.flagged <= 1
    assert tally.largest_error <= 1.0


@pytest.fixture(autouse=True)
def without_drawn_families(monkeypatch):
    monkeypatch.setitem(intervals.DRAWN, "intervals", 0)


class Loose(Family):
    """A scene of equal steps that are too long."""

    def scene(self, **how):
        return super().scene(**(how or {"integrator": "rk4"}))


@pytest.mark.long
def test_a_tolerance_that_is_not_kept_is_told_with_the_intervals():
    fast = next(f for f in FAMILIES if f.name == "4R, fast")
    loose = Loose(**{f.name: getattr(fast, f.name) for f in dataclasses.fields(Family)})
    misses = []
    tally = intervals.judge_family(loose, 512, seed=1, misses=misses)
    assert tally.missed > 20
    assert tally.largest_error > judging.LIMIT
    drawn = np.concatenate([one.joints for one in misses])
    assert drawn.shape == (tally.missed, 4)


def test_families_have_names_of_their_own_and_draw_the_same_again():
    assert len({f.name for f in FAMILIES}) == len(FAMILIES) >= 10
    one, other = (FAMILIES[5].draw(8, np.random.default_rng(3)) for _ in range(2))
    assert (one.joints == other.joints).all()
    assert all((one.parameters[k] == other.parameters[k]).all() for k in one.parameters)


class Sends(contextlib.nullcontext):
    """A pool that sends what processes get, and runs it here."""

    def __enter__(self):
        return self

    def map(self, function, *columns):
        sent, arguments = pickle.loads(pickle.dumps((function, [list(c) for c in columns])))
        return map(sent, *arguments)


@pytest.mark.long
def test_processes_find_what_one_finds(monkeypatch):
    monkeypatch.setattr(intervals, "FAMILIES", [f for f in FAMILIES if f.name in (*QUICK, "4R, friction")])
    alone = intervals.run("intervals", 300, seed=3)
    monkeypatch.setattr(intervals, "ProcessPoolExecutor", lambda *_: Sends())
    assert intervals.run("intervals", 300, seed=3, processes=2) == alone
    assert len(alone) == len(QUICK) + 1


def test_the_same_intervals_are_judged_at_several_tolerances(monkeypatch):
    monkeypatch.setattr(intervals, "FAMILIES", [f for f in FAMILIES if f.name == "4R, 1e-9 m"])
    loose, tight = intervals.run("intervals", 300, seed=3, tolerances=(1e-3, 1e-9))
    (own,) = intervals.run("intervals", 300, seed=3)
    assert tight == own
    assert (loose["tolerance"], loose["family"]) == (1e-3, own["family"])
    assert loose["evaluations"] < tight["evaluations"]


@pytest.mark.long
def test_estimates_are_compared_with_errors_and_drawn(monkeypatch):
    monkeypatch.setattr(estimates, "FAMILIES", [f for f in FAMILIES if f.name == "4R, smooth"])
    rows = estimates.run(4096, seed=3)
    assert [tuple(row) for row in rows] == [estimates.COLUMNS] * len(rows)
    assert sum(row["steps"] for row in rows) > 2000
    assert all(float(row["median"]) <= float(row["q999"]) <= float(row["estimate"]) for row in rows)
    assert not any(row["beyond"] for row in rows)
    (panel,) = estimates.figure(rows).axes
    assert panel.get_title() == "now"


def test_the_command_refuses_no_intervals(capsys):
    assert main(["intervals", "--intervals", "0"]) == 2
    assert "intervals is 0; give at least 1" in capsys.readouterr().err
