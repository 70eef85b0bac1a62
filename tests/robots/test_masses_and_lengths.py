"""Masses and lengths that are refused, with the field and its value in the message."""

import re

import numpy as np
import pytest

import redundant_envs as rde

GOOD = {
    rde.RPRP: {"masses": (2.0, 1.5, 1.0, 0.5), "lengths": (1.0, 0.8)},
    rde.FourR: {"masses": (2.0, 1.5, 1.0, 0.5), "lengths": (1.0, 0.8, 0.6, 0.4)},
}
ARMS = pytest.mark.parametrize("arm", GOOD, ids=["RPRP", "FourR"])
FIELDS = pytest.mark.parametrize("field", ["masses", "lengths"])


def refused(arm, field, value, *parts):
    """A value of a field is refused, with these parts in order."""
    with pytest.raises(ValueError, match=".*".join(map(re.escape, parts))):
        arm(**{**GOOD[arm], field: value})


@ARMS
def test_whole_numbers_lists_and_arrays_become_tuples_of_floats_that_cannot_be_changed(arm):
    count = len(GOOD[arm]["lengths"])
    robot = arm(np.array([2, 1, 3, 1]), [int(i + 1) for i in range(count)])
    assert robot.masses == (2.0, 1.0, 3.0, 1.0)
    assert {type(x) for x in robot.masses + robot.lengths} == {float}
    assert robot == arm((2, 1, 3, 1), robot.lengths)
    with pytest.raises(AttributeError):
        robot.masses = (1.0,) * 4


@ARMS
@FIELDS
@pytest.mark.parametrize(
    "value", [0.0, -0.5, float("nan"), float("inf"), "1", True, None, [1.0], 1j], ids=repr
)
def test_an_entry_that_is_no_positive_number_is_named_with_its_index_and_value(arm, field, value):
    for i in (0, 1):
        values = [*GOOD[arm][field]]
        values[i] = value
        refused(arm, field, values, f"{field}[{i}]", f"is {value!r}")


@ARMS
@FIELDS
def test_too_few_too_many_and_none_are_refused_with_how_many_are_needed(arm, field):
    needed = len(GOOD[arm][field])
    for n in (0, needed - 1, needed + 1):
        refused(arm, field, (1.0,) * n, f"{field} has {n} entries", f"give {needed}")
    for value in (1.0, "1111", None):
        refused(arm, field, value, f"{field} is {value!r}", f"{needed} numbers")


@ARMS
@FIELDS
@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_every_allowed_scale_gives_the_accelerations_of_scale_1_and_one_beyond_is_refused(arm, field, scale):
    q, qd, Q = np.array([0.3, 0.0, -0.4, 0.0]), np.array([1.0, 0.0, -2.0, 0.0]), np.zeros(4)
    count = len(GOOD[arm][field])
    found, usual = (
        arm(**{**GOOD[arm], field: (x,) * count}).forward_dynamics(q, qd, Q) for x in (scale, 1.0)
    )
    assert np.isfinite(found).all()
    if field == "masses":
        np.testing.assert_allclose(found, usual, rtol=1e-13)
    if scale != 1.0:
        beyond = scale * (10.0 if scale > 1.0 else 0.1)
        refused(arm, field, (beyond,) * count, f"{field}[0] is {beyond}", "1e-30 to 1e+30")


@ARMS
@FIELDS
def test_a_ratio_beyond_1e12_is_refused_with_what_to_change(arm, field):
    rest = (1.0,) * (len(GOOD[arm][field]) - 1)
    arm(**{**GOOD[arm], field: (1e-12, *rest)})
    refused(arm, field, (*rest, 0.5e-12), f"{field} spans a ratio of 2.0e+12", "1e+12")


@ARMS
def test_an_unknown_joint_lists_the_valid_ones(arm):
    robot = arm(**GOOD[arm])
    assert [robot.joint_index(n) for n in robot.joints] == [0, 1, 2, 3]
    with pytest.raises(ValueError, match=".*".join(["'elbow'", robot.kind, *robot.joints])):
        robot.joint_index("elbow")
