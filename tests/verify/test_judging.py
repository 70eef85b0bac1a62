"""The judge of intervals: references that agree, errors in tolerances, lanes with a flag."""

from __future__ import annotations

import numpy as np

from redundant_envs.verify.judging import CONFIRMED, LIMIT, judge

TOLERANCE = 1e-6


def away(*tolerances):
    """Tips that are some tolerances away from the origin."""
    return np.stack([TOLERANCE * np.array(tolerances), np.zeros(len(tolerances))], axis=1)


def test_a_miss_is_judged_by_references_that_agree():
    off = LIMIT * np.array([0.9, 1.1, 1.1, np.nan, 1.1])
    other = CONFIRMED * np.array([0.9, 0.9, 1.1, 0.9, np.nan])
    known = np.ones(5, np.bool_)
    judged, missed, error = judge(away(*off), [away(0, 0, 0, 0, 0), away(*other)], TOLERANCE, known)
    assert judged.tolist() == [True, True, False, True, False]
    assert missed.tolist() == [False, True, False, True, False]
    np.testing.assert_allclose(error[:3], off[:3])


def test_lanes_with_a_flag_are_not_judged():
    judged, missed, _ = judge(away(5, 5), [away(0, 0)], TOLERANCE, np.array([True, False]))
    assert judged.tolist() == missed.tolist() == [True, False]
