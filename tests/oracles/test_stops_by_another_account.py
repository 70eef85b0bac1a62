"""Impacts and rests at stops agree with an account that shares no code with the package."""

import pytest

from redundant_envs.studies.intervals import families
from tests.oracles.compared_stops import compared

FAMILIES = families("impacts", 0)


@pytest.mark.parametrize(
    "number", [k if k in (2, 5) else pytest.param(k, marks=pytest.mark.long) for k in range(len(FAMILIES))]
)
def test_no_interval_with_stops_is_missed(number):
    pytest.importorskip("scipy", reason="scipy is in the extra 'verify'")
    judged, missed = compared(FAMILIES[number], 8, seed=number)
    assert judged >= 7
    assert missed == 0
