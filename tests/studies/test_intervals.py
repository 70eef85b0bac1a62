"""Families of intervals: the tolerance is kept in each, and the study reports a family that misses it."""

import pytest

from studies import intervals
from studies.interval_families import FAMILIES


@pytest.mark.long
@pytest.mark.parametrize("family", FAMILIES, ids=[family.name for family in FAMILIES])
def test_no_interval_of_a_family_is_off_without_a_flag(family):
    """``studies intervals`` judges a million."""
    tally = intervals.judge_family(family, 1024, seed=12)
    assert tally.missed == 0
    assert tally.judged >= 0.8 * tally.intervals
    assert tally.flagged <= 1
    assert tally.largest_error <= 1.0


@pytest.fixture
def only(monkeypatch):
    """Let the study have some families, and none that are drawn."""

    def of_names(*names):
        monkeypatch.setattr(intervals, "FAMILIES", [f for f in FAMILIES if f.name in names])
        monkeypatch.setitem(intervals.DRAWN, "intervals", 0)

    return of_names


@pytest.mark.long
def test_processes_find_what_one_finds(only):
    only(*(family.name for family in FAMILIES[:3]))  # processes know all families, by their numbers
    alone = intervals.run("intervals", 300, seed=3)
    assert intervals.run("intervals", 300, seed=3, processes=2) == alone
    assert len(alone) == 3


def test_the_same_intervals_are_judged_at_several_tolerances(only):
    only("4R, 1e-9 m")
    loose, tight = intervals.run("intervals", 300, seed=3, tolerances=(1e-3, 1e-9))
    (own,) = intervals.run("intervals", 300, seed=3)
    assert tight == own
    assert (loose["tolerance"], loose["family"]) == (1e-3, own["family"])
    assert loose["evaluations"] < tight["evaluations"]
