"""The judge of intervals: references that agree, errors in tolerances, lanes with a flag."""

import numpy as np

from redundant_envs.verify.judging import CONFIRMED, LIMIT, judge

TOLERANCE = 1e-6


def away(*tolerances):
    """Tips that are some tolerances away from the origin."""
    return np.stack([TOLERANCE * np.array(tolerances), np.zeros(len(tolerances))], axis=1)


def test_a_miss_is_judged_by_references_that_agree_in_lanes_without_a_flag():
    off = LIMIT * np.array([0.9, 1.1, 1.1, np.nan, 1.1, 1.1])
    other = CONFIRMED * np.array([0.9, 0.9, 1.1, 0.9, np.nan, 0.9])
    known = np.arange(6) < 5
    judged, missed, error = judge(away(*off), [away(*[0.0] * 6), away(*other)], TOLERANCE, known)
    assert judged.tolist() == [True, True, False, True, False, False]
    assert missed.tolist() == [False, True, False, True, False, False]
    np.testing.assert_allclose(error[:3], off[:3])
