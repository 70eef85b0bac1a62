"""Sentences of the policy study agree with its numbers."""

import pytest

from redundant_envs_train.studies.policy.settings import Physics, Study
from redundant_envs_train.studies.policy.words import (
    LARGE,
    NONE,
    OPEN,
    SMALL,
    Difference,
    conclusion,
    physics_sentence,
    training_sentence,
)  # fmt: skip

STUDY = Study(
    physics={"exact": Physics(accuracy="exact"), "rk4": Physics(integrator="rk4")},
    arms={"A": {"preset": "rprp_reach_ppo"}},
    train_seeds=0,
)


@pytest.mark.parametrize(
    ("numbers", "verdict", "words"),
    [
        (
            (0.1, -0.2, 0.4, 1.0),
            NONE,
            ["no measurable difference", "+0.1", "-0.2 to +0.4", "0.6 points wide"],
        ),
        ((0.0, 0.0, 0.0, 1.0), NONE, ["no measurable difference", "0 points wide"]),
        ((-0.3, -0.5, -0.1, 1.0), SMALL, ["measurably lower", "less than 1 point ", "-0.5 to -0.1"]),
        ((0.5, -1.0, 2.0, 1.0), OPEN, ["not resolved", "contains 0", "-1 to +2"]),
        ((-9.0, -11.0, -7.0, 1.0), LARGE, ["lower by 9", "-11 to -7"]),
        ((2.0, 0.5, 3.5, 1.0), LARGE, ["higher by 2 points", "+0.5 to +3.5"]),
    ],
)
def test_wording_follows_the_interval(numbers, verdict, words):
    difference = Difference(*numbers)
    assert difference.verdict == verdict
    text = difference.sentence("Hold success", "points")
    for word in words:
        assert word in text
    assert ("no measurable" in text) == (verdict == NONE)


def row(physics, hold, hold_interval, gain, gain_interval, **more):
    return {
        "physics": physics, "reference": "exact", "episodes": 1000, "hold_success": 0.98 + hold,
        "hold_difference": hold, "hold_difference_low": hold_interval[0],
        "hold_difference_high": hold_interval[1], "lost": 3, "won": 1, "sign_test_p": 1e-9,
        "mean_return": 60.0 + gain,
        "return_difference": gain, "return_difference_low": gain_interval[0],
        "return_difference_high": gain_interval[1], "median_abs_return_difference": 0.02, "ended": 0,
        "half_from": 100,
        "control_steps": 100_000, "numerics": "", **more,
    }  # fmt: skip


REFERENCE = row("exact", 0.0, (0.0, 0.0), 0.0, (0.0, 0.0))
SAME = row("rk8", -0.002, (-0.006, 0.002), 0.01, (-0.02, 0.04))
WORSE = row("euler", -0.3, (-0.33, -0.27), -20.0, (-22.0, -18.0), ended=250, numerics="SPEED_BOUND 250")


def test_a_physics_that_costs_nothing_is_said_to():
    text = physics_sentence(SAME, REFERENCE, STUDY)
    assert "Hold success: no measurable difference (-0.2 points" in text
    assert "0.8 points wide: it contains 0)" in text
    assert "Return: no measurable difference" in text
    assert "held only under exact: 3, only here: 1." in text
    assert "makes no measurable difference to this policy between exact and rk8." in conclusion(
        [SAME, REFERENCE], STUDY
    )
    unchanged = physics_sentence({**SAME, "lost": 0, "won": 0}, REFERENCE, STUDY)
    assert "no measurable difference: not one of 1000 episodes changes" in unchanged
    assert "0.4 % of all could" in unchanged


def test_a_physics_that_costs_is_said_to():
    text = physics_sentence(WORSE, REFERENCE, STUDY)
    assert "Hold success: lower by 30 points (95 % interval -33 to -27)" in text
    assert "Return: lower by 20 (" in text
    assert "Numerics end 250 episodes early" in text
    assert "SPEED_BOUND 250" in text
    text = conclusion([WORSE, SAME, REFERENCE], STUDY)
    assert "Hold success against exact: no measurable difference: rk8; a difference: euler." in text
    assert "Return against exact: no measurable difference: rk8; a difference: euler." in text
    assert "between exact and rk8." in text
    assert "So accuracy" not in conclusion([WORSE, REFERENCE], STUDY)


def test_few_flips_are_not_taken_for_a_difference():
    few = {**row("rk4", -0.005, (-0.01, -0.001), 0.0, (0.0, 0.0)), "lost": 5, "won": 0, "sign_test_p": 0.0625}
    text = physics_sentence(few, REFERENCE, STUDY)
    assert "no measurable difference (-0.5 points" in text
    assert "5 flips are few" in text
    assert "p = 0.06" in text
    one = {**row("rk8", 0.0, (0.0, 0.0), 0.02, (0.01, 0.06)), "half_from": 3}
    text = physics_sentence(one, REFERENCE, STUDY)
    assert "Return: no measurable difference (+0.02, " in text
    assert "3 episodes make half of all the difference" in text
    assert "measurably higher" in physics_sentence({**one, "half_from": 300}, REFERENCE, STUDY)


def test_a_policy_that_holds_nothing_says_nothing():
    reference = {**REFERENCE, "hold_success": 0.0}
    text = physics_sentence({**SAME, "hold_success": 0.0}, reference, STUDY)
    assert "says nothing" in text
    assert "Hold success: no measurable" not in text


def test_a_refused_physics_is_told():
    refused = {"physics": "euler", "refused": "only rk8 finds stops"}
    assert "only rk8 finds stops" in physics_sentence(refused, REFERENCE, STUDY)
    assert "euler" not in conclusion([refused, SAME, REFERENCE], STUDY)


def test_few_seeds_are_called_few():
    data = {
        "measure": "hold_success", "cheap": "euler", "reference": "exact", "policies_each": 5,
        "mean_preset": 0.98, "difference": -0.2, "low": -0.3, "high": -0.1, "permutation_p": 0.01,
    }  # fmt: skip
    text = training_sentence(data, STUDY)
    assert "lower by 20 points" in text
    assert "5 policies against 5 are few" in text
    assert "few" not in training_sentence({**data, "policies_each": 20, "permutation_p": ""}, STUDY)
    doubted = training_sentence({**data, "permutation_p": 0.33}, STUDY)
    assert "not resolved (-20 points" in doubted
    assert "p = 0.33" in doubted
