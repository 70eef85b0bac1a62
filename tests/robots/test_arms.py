"""The class of an arm: shapes and batches, numbers that are refused by name, and equations of the class."""

import functools
import itertools
import re

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.language.algebra import physics

GOOD = {
    rde.RPRP: {"masses": (2.3, 0.7, 1.9, 0.4), "lengths": (1.1, 0.6)},
    rde.FourR: {"masses": (2.3, 0.7, 1.9, 0.4), "lengths": (1.1, 0.6, 0.9, 0.35)},
}
KINDS = pytest.mark.parametrize("kind", GOOD, ids=["RPRP", "FourR"])
FIELDS = pytest.mark.parametrize("field", ["masses", "lengths"])


def test_motors_act_between_a_link_and_the_one_before():
    """RPRP's second motor reacts on the first angle."""
    four_r = [[1, -1, 0, 0], [0, 1, -1, 0], [0, 0, 1, -1], [0, 0, 0, 1]]
    rprp = [[1, 0, -1, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    assert [kind(**GOOD[kind]).motor_map.tolist() for kind in GOOD] == [rprp, four_r]


def test_batches_of_any_shape_broadcast():
    """Each entry is the single evaluation."""
    robot, rng = rde.RPRP(**GOOD[rde.RPRP]), np.random.default_rng(7)
    q, qd, Q = (rng.uniform(-0.5, 5.0, (*shape, 4)) for shape in ((3, 1, 1), (4, 1), (2,)))
    qdd = robot.forward_dynamics(q, qd, Q, 9.81)
    assert qdd.shape == (3, 4, 2, 4)
    for i, j, k in ((0, 0, 0), (2, 3, 1), (1, 2, 0)):
        assert np.allclose(qdd[i, j, k], robot.forward_dynamics(q[i, 0, 0], qd[j, 0], Q[k], 9.81), 1e-13, 0)
    of_q = {"mass_matrix": (4, 4), "points": (4, 2), "forward_kinematics": (2,), "jacobian": (2, 4),
            "manipulability": (), "gravity_forces": (4,), "potential_energy": ()}  # fmt: skip
    of_rates = {"bias_forces": (4,), "coriolis_matrix": (4, 4), "jacobian_dot_qd": (2,),
                "kinetic_energy": (), "angular_momentum": ()}  # fmt: skip
    for name, tail in of_q.items():
        for leading in ((), (0,), (3, 1, 2)):
            assert getattr(robot, name)(np.full((*leading, 4), 0.3)).shape == (*leading, *tail)
    for name, tail in of_rates.items():
        assert getattr(robot, name)(q, qd).shape == (3, 4, 1, *tail)
    assert robot.inverse_dynamics(q, qd, Q).shape == (3, 4, 2, 4)


@pytest.mark.parametrize(
    ("name", "shapes", "said"),
    [
        ("mass_matrix", [(3,)], r"q has shape \(3,\).*4 entries"),
        ("bias_forces", [4, (2, 5)], r"qd has shape \(2, 5\)"),
        ("forward_dynamics", [4, 4, 1], r"Q has shape \(1,\)"),
        ("bias_forces", [(2, 4), (3, 4)], "broadcast"),
    ],
)
def test_wrong_shapes_are_refused_with_the_name_of_the_argument(name, shapes, said):
    with pytest.raises(ValueError, match=said):
        getattr(rde.RPRP(**GOOD[rde.RPRP]), name)(*map(np.zeros, shapes))


def refused(kind, field, value, *parts):
    """A value of a field is refused, with these parts in order."""
    with pytest.raises(ValueError, match=".*".join(map(re.escape, parts))):
        kind(**{**GOOD[kind], field: value})


@KINDS
def test_numbers_become_tuples_that_cannot_be_changed_and_joints_have_names(kind):
    robot = kind(np.array([2, 1, 3, 1]), [1] * len(GOOD[kind]["lengths"]))
    assert robot.masses == (2.0, 1.0, 3.0, 1.0)
    with pytest.raises(AttributeError):
        robot.masses = (1.0,) * 4
    assert [robot.joint_index(n) for n in robot.joints] == [0, 1, 2, 3]
    with pytest.raises(ValueError, match=".*".join(["'elbow'", robot.kind, *robot.joints])):
        robot.joint_index("elbow")


@KINDS
@FIELDS
def test_scales_of_30_decades_and_ratios_of_12_are_allowed_and_none_beyond(kind, field):
    q, qd, Q = np.array([0.3, 0.0, -0.4, 0.0]), np.array([1.0, 0.0, -2.0, 0.0]), np.zeros(4)
    count = len(GOOD[kind][field])
    small, usual, large = (
        kind(**{**GOOD[kind], field: (x,) * count}).forward_dynamics(q, qd, Q) for x in (1e-30, 1.0, 1e30)
    )
    assert np.isfinite([small, usual, large]).all()
    if field == "masses":
        np.testing.assert_allclose([small, large], [usual, usual], rtol=1e-13)
    for beyond in (1e-30 * 0.1, 1e30 * 10.0):
        refused(kind, field, (beyond,) * count, f"{field}[0] is {beyond}", "1e-30 to 1e+30")
    rest = (1.0,) * (count - 1)
    kind(**{**GOOD[kind], field: (1e-12, *rest)})
    refused(kind, field, (*rest, 0.5e-12), f"{field} spans a ratio of 2.0e+12", "1e+12")


@KINDS
@FIELDS
def test_what_is_no_positive_number_or_one_too_few_is_named(kind, field):
    for i, value in itertools.product((0, 1), (0.0, -0.5, np.nan, np.inf, "1", True, None, [1.0])):
        values = [*GOOD[kind][field]]
        values[i] = value
        refused(kind, field, values, f"{field}[{i}]", f"is {value!r}")
    needed = len(GOOD[kind][field])
    for n in (0, needed - 1, needed + 1):
        refused(kind, field, (1.0,) * n, f"{field} has {n} entries", f"give {needed}")
    for value in (1.0, "1111", None):
        refused(kind, field, value, f"{field} is {value!r}", f"{needed} numbers")


@physics(gives="x1 y1")
def points(l1, s1, c1):
    return l1 * c1, l1 * s1


def arm(**body):
    return type("Swing", (rde.Arm,), {"joint_types": "R", "functions": (points,), **body})


def test_a_property_is_refused_with_the_class():
    for kind in (property, functools.cached_property):
        with pytest.raises(ValueError, match=r"Swing\.functions is a .*property; .* m1, l1 .* as arguments"):
            arm(functions=kind(lambda self: (points,)))


def test_an_equation_of_one_arm_is_refused_with_the_scene():
    def made(self):
        rde.Arm.__post_init__(self)
        mass = self.masses[0]
        own = physics(gives="T")(lambda w1: 0.5 * mass * w1 * w1)
        object.__setattr__(self, "functions", (own, *type(self).functions))

    with pytest.raises(ValueError, match=r"robot\.functions is that of one Swing; .* m1, l1 .* as arguments"):
        rde.Scene(arm(__post_init__=made)((1.0,), (1.0,)))
