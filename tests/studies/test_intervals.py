"""Families of intervals: the tolerance is kept in each, and the study reports a family that misses it.

Families drawn by a seed have every effect that moves an arm, and another account of their intervals.
"""

import numpy as np
import pytest
from catalogue import by_another_account

from redundant_envs.effects import CommandDelay, CoulombFriction, JointStop
from redundant_envs.robots import Chain
from redundant_envs.scenes.scene import Scene
from studies import drawn_families, intervals
from studies.another_account import Account
from studies.drawn_families import DrawnFamily, moving_effects
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


def test_every_effect_that_moves_an_arm_is_drawn_alone_then_beside_another():
    kinds = [*moving_effects()]
    for number in (0, len(kinds) + 3):
        names = {type(e).__name__ for e in DrawnFamily(0, number).variants[0].effects}
        assert kinds[number % len(kinds)] in names
        assert len(names - {"Gravity"}) <= 1 + number // len(kinds)
    assert {DrawnFamily(0, n).variants[0].actuation for n in (1, 2)} == {"joint", "generalized"}


def test_another_account_crosses_an_instant():
    """A slider of 2 kg at 1 m/s: for 6 ms the command before acts, which pulls with 1 N, then 3 N."""
    pytest.importorskip("scipy", reason="scipy is in the extra 'verify'")
    scene = Scene(Chain("P", (2.0,)), (CommandDelay(0.006, 0.006),), control_dt=0.02)
    numbers = {name: np.array([value]) for name, value in scene.parameters().items()}
    account, sent = Account(scene, numbers, np.array([[3.0]])), {"command_delay.sent[0]": np.array([-1.0])}
    tip = account.after(np.zeros((1, 1)), np.ones((1, 1)), sent, 1e-13)
    first = 0.006 - 0.25 * 0.006**2
    assert tip[0, 0] == pytest.approx(first + (1.0 - 0.5 * 0.006) * 0.014 + 0.75 * 0.014**2, abs=1e-15)


def test_another_account_strikes_a_stop_slips_and_rests():
    """A slider of 2 kg at 1 m/s is slowed by 3 N, turns back from its stop with half its rate, and stays
    where it comes to rest. Another one, which 5 N press onto its stop, rests there after 0.6 s of bounces."""
    pytest.importorskip("scipy", reason="scipy is in the extra 'verify'")
    arm, end = Chain("P", (2.0,)), 0.1
    scene = Scene(arm, (CoulombFriction(3.0), JointStop((None,), (end,), 0.5)), control_dt=0.5)
    q, qd = by_another_account(scene, np.zeros((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))[0]
    assert q[0] == pytest.approx(end - 0.25 * (1.0 - 2.0 * 1.5 * end) / (2.0 * 1.5), abs=1e-13)
    assert qd[0] == 0.0
    scene = Scene(arm, (JointStop((None,), (end,), 0.5),), control_dt=0.7)
    q, qd = by_another_account(scene, np.full((1, 1), 0.05), np.zeros((1, 1)), np.full((1, 1), 5.0))[0]
    assert (q[0], qd[0]) == (end, 0.0)


class Loose(DrawnFamily):
    """A scene of equal steps that are too long."""

    def scene(self, **how):
        return super().scene(**(how or {"integrator": "euler"}))


@pytest.mark.long
def test_lanes_that_are_off_are_judged_by_another_account(monkeypatch):
    loose = Loose(0, 2, tolerance=1e-9)
    tally = intervals.judge_family(loose, 100, seed=1)
    assert (tally.judged, tally.missed > 80, tally.told >= intervals.MAX_TOLD) == (100, True, True)
    monkeypatch.setattr(drawn_families, "MAX_EVALUATIONS", 0)
    assert intervals.judge_family(loose, 100, seed=1).intervals == 0
