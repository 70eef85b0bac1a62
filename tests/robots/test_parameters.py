"""Masses and lengths that are refused, with the field and its value in the message."""

import re

import numpy as np
import pytest

import redundant_envs as rde

MASSES = (2.0, 1.5, 1.0, 0.5)
LENGTHS = {rde.RPRP: (1.0, 0.8), rde.FourR: (1.0, 0.8, 0.6, 0.4)}
ARMS = pytest.mark.parametrize("arm", [rde.RPRP, rde.FourR], ids=["RPRP", "FourR"])


def says(*parts):
    """A pattern with these parts in order."""
    return ".*".join(re.escape(p) for p in parts)


@ARMS
def test_good_parameters_become_floats(arm):
    """Whole numbers, lists and arrays are taken; the stored values are tuples of floats."""

    robot = arm(np.array([2, 1, 3, 1]), [int(i + 1) for i in range(len(LENGTHS[arm]))])
    assert robot.masses == (2.0, 1.0, 3.0, 1.0)
    assert all(type(x) is float for x in robot.masses + robot.lengths)
    assert robot == arm((2, 1, 3, 1), robot.lengths)


@ARMS
@pytest.mark.parametrize("field", ["masses", "lengths"])
@pytest.mark.parametrize(
    "value", [0.0, -0.5, float("nan"), float("inf"), "1", True, None, [1.0], 1j], ids=repr
)
def test_an_entry_that_is_no_positive_number_is_named_with_its_index_and_value(arm, field, value):
    for i in (0, 1):
        values = {"masses": list(MASSES), "lengths": list(LENGTHS[arm])}
        values[field][i] = value
        with pytest.raises(ValueError, match=says(f"{field}[{i}]", f"is {value!r}")):
            arm(**values)


@ARMS
@pytest.mark.parametrize("field", ["masses", "lengths"])
def test_bad_count(arm, field):
    """Too few, too many, none, and not a sequence."""
    good = {"masses": MASSES, "lengths": LENGTHS[arm]}
    needed = len(good[field])
    refused = {
        (1.0,) * n: (f"{field} has {n} entries", f"give {needed}") for n in (0, needed - 1, needed + 1)
    }
    refused |= {value: (f"{field} is {value!r}", f"{needed} numbers") for value in (1.0, "1111", None)}
    for value, said in refused.items():
        with pytest.raises(ValueError, match=says(*said)):
            arm(**{**good, field: value})


@ARMS
@pytest.mark.parametrize("field", ["masses", "lengths"])
@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_scale(arm, field, scale):
    """Every allowed scale gives the accelerations of scale 1; one beyond is refused."""
    good = {"masses": MASSES, "lengths": LENGTHS[arm]}
    q, qd, Q = np.array([0.3, 0.0, -0.4, 0.0]), np.array([1.0, 0.0, -2.0, 0.0]), np.zeros(4)
    robot = arm(**{**good, field: (scale,) * len(good[field])})
    assert np.isfinite(robot.forward_dynamics(q, qd, Q)).all()
    if field == "masses":
        usual = arm(**{**good, field: (1.0,) * 4}).forward_dynamics(q, qd, Q)
        np.testing.assert_allclose(robot.forward_dynamics(q, qd, Q), usual, rtol=1e-13)
    if scale != 1.0:
        beyond = scale * (10.0 if scale > 1.0 else 0.1)
        with pytest.raises(ValueError, match=says(f"{field}[0] is {beyond}", "1e-30 to 1e+30")):
            arm(**{**good, field: (beyond,) * len(good[field])})


@ARMS
@pytest.mark.parametrize("field", ["masses", "lengths"])
def test_bad_ratio(arm, field):
    """A ratio of 1e12 is the largest; beyond it the message says what to change."""
    good = {"masses": MASSES, "lengths": LENGTHS[arm]}
    rest = (1.0,) * (len(good[field]) - 1)
    arm(**{**good, field: (1e-12, *rest)})
    with pytest.raises(ValueError, match=says(f"{field} spans a ratio of 2.0e+12", "1e+12")):
        arm(**{**good, field: (*rest, 0.5e-12)})


@ARMS
def test_frozen(arm):
    """Parameters cannot be changed after validation."""
    robot = arm(MASSES, LENGTHS[arm])
    with pytest.raises(AttributeError):
        robot.masses = (1.0, 1.0, 1.0, 1.0)


@ARMS
def test_joint_names(arm):
    """An unknown joint lists the valid ones."""
    robot = arm(MASSES, LENGTHS[arm])
    assert [robot.joint_index(n) for n in robot.joints] == [0, 1, 2, 3]
    with pytest.raises(ValueError, match=says("'elbow'", robot.kind, *robot.joints)):
        robot.joint_index("elbow")
