"""The class of an arm: shapes and batches, numbers that are refused by name, and equations of the class.

Chains of revolute joints and sliders: all of it follows from the positions of the point masses.
"""

import copy
import functools
import itertools
import json
import pickle
import re

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP
from foreign import states

import redundant_envs as rde
from redundant_envs.language.algebra import physics
from redundant_envs.verify.subjects import subject_of

GOOD = {
    rde.RPRP: {"masses": (2.3, 0.7, 1.9, 0.4), "lengths": (1.1, 0.6)},
    rde.FourR: {"masses": (2.3, 0.7, 1.9, 0.4), "lengths": (1.1, 0.6, 0.9, 0.35)},
    rde.TwoR: {"masses": (2.3, 0.7), "lengths": (1.1, 0.6)},
}
KINDS = pytest.mark.parametrize("kind", GOOD, ids=["RPRP", "FourR", "TwoR"])
FIELDS = pytest.mark.parametrize("field", ["masses", "lengths"])


def test_motors_act_between_a_link_and_the_one_before():
    """RPRP's second motor reacts on the first angle."""
    four_r = [[1, -1, 0, 0], [0, 1, -1, 0], [0, 0, 1, -1], [0, 0, 0, 1]]
    rprp = [[1, 0, -1, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    assert [kind(**GOOD[kind]).motor_map.tolist() for kind in GOOD] == [rprp, four_r, [[1, -1], [0, 1]]]


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
    count = len(GOOD[kind]["masses"])
    robot = kind(np.array([2, 1, 3, 1][:count]), [1] * len(GOOD[kind]["lengths"]))
    assert robot.masses == (2.0, 1.0, 3.0, 1.0)[:count]
    with pytest.raises(AttributeError):
        robot.masses = (1.0,) * count
    assert [robot.joint_index(n) for n in robot.joints] == [*range(count)]
    with pytest.raises(ValueError, match=".*".join(["'elbow'", robot.kind, *robot.joints])):
        robot.joint_index("elbow")


@KINDS
@FIELDS
def test_scales_of_30_decades_and_ratios_of_12_are_allowed_and_none_beyond(kind, field):
    motion = np.array([0.3, 0.0, -0.4, 0.0]), np.array([1.0, 0.0, -2.0, 0.0]), np.zeros(4)
    q, qd, Q = (part[: len(kind.joint_types)] for part in motion)
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


# ---- chains ---------------------------------------------------------------------------------------------

e = rde.effects
BY_HAND = {"RPRP": RPRP, "RRRR": FOUR_R}


OF_Q = "mass_matrix gravity_forces points forward_kinematics jacobian potential_energy manipulability"
OF_RATES = "bias_forces coriolis_matrix jacobian_dot_qd kinetic_energy angular_momentum"


@pytest.mark.parametrize("types", BY_HAND)
def test_a_chain_is_the_arm_written_by_hand_to_rounding(types):
    hand = BY_HAND[types]
    chain = rde.Chain(types, hand.masses, hand.lengths)
    q, qd, Q = states(hand, 500)
    for names, known, most in (
        (OF_Q, (q,), 2e-15), (OF_RATES, (q, qd), 2e-15), ("forward_dynamics", (q, qd, Q), 1e-14),
    ):  # fmt: skip
        for name in names.split():
            found, expected = getattr(chain, name)(*known), getattr(hand, name)(*known)
            assert np.abs(found - expected).max() <= most * np.abs(expected).max(), name
    assert np.array_equal(chain.motor_map, hand.motor_map)
    names = "coordinates", "rates", "joints", "prismatic", "num_masses", "num_lengths"
    assert [getattr(chain, name) for name in names] == [getattr(hand, name) for name in names]


@pytest.mark.parametrize("types", ["R", "PP", "RPP", "PRRP", "RPRRPRRPRR"])
def test_mass_points_are_where_the_joints_put_them(types):
    """A revolute joint begins a direction; a slider goes along the one before it, +x at the base."""
    rng = np.random.default_rng(len(types))
    chain = rde.Chain(types, rng.uniform(0.5, 2.0, len(types)), rng.uniform(0.3, 1.0, types.count("R")))
    q, *_ = states(chain, 5)
    lengths, direction, place, expected = iter(chain.lengths), np.ones(5, complex), np.zeros(5, complex), []
    for kind, x in zip(types, q.T, strict=True):
        if kind == "R":
            direction, x = np.exp(1j * x), next(lengths)
        place = place + x * direction
        expected.append(np.stack([place.real, place.imag], axis=-1))
    np.testing.assert_allclose(chain.points(q), np.stack(expected, axis=1), atol=1e-14)
    np.testing.assert_allclose([chain.points(one) for one in q], chain.points(q), atol=1e-14)


def test_equal_chains_are_equal_after_pickles_and_plain_data():
    chain = rde.Chain("RPR", (1.0, 2.0, 3.0), (0.1, 0.2))
    evaluated = eval(repr(chain), vars(rde) | {"Chain": rde.Chain})
    for same in (copy.deepcopy(chain), pickle.loads(pickle.dumps(chain)), evaluated):
        assert (same, hash(same), type(same)) == (chain, hash(chain), type(chain))
    assert chain != rde.Chain("RRP", (1.0, 2.0, 3.0), (0.1, 0.2))
    scene = rde.Scene(chain, (e.Gravity(), e.PrismaticStop((0.0,), (0.3,), 0.5)), tolerance=1e-6)
    data = json.loads(json.dumps(scene.to_dict()))
    numbers = {"masses": [1.0, 2.0, 3.0], "lengths": [0.1, 0.2]}
    assert data["robot"] == {"type": "Chain", "joint_types": "RPR", **numbers}
    assert rde.Scene.from_dict(data) == scene == pickle.loads(pickle.dumps(scene))


@pytest.mark.parametrize(
    ("types", "masses", "lengths", "said"),
    [
        ("RXP", (1.0,) * 3, (1.0,), "joint_types is 'RXP'; give 1 to 10 letters"),
        ("", (), (), "joint_types is ''"),
        (None, (1.0,), (1.0,), "joint_types is None"),
        ("RPR", (1.0,) * 2, (1.0,) * 2, "masses has 2 entries; give 3"),
        ("RPR", (1.0, -1.0, 1.0), (1.0,) * 2, r"masses\[1\] is -1.0 kg"),
    ],
)
def test_what_is_no_chain_is_refused(types, masses, lengths, said):
    with pytest.raises(ValueError, match=said):
        rde.Chain(types, masses, lengths)


def test_the_class_of_all_chains_is_no_base_no_kind_and_no_subject():
    mine, untyped = type("Mine", (rde.Chain,), {}), {"type": "Chain", "masses": [1.0], "lengths": [1.0]}
    for refused, said in (
        (lambda: mine("RPR", (1.0,) * 3, (1.0,) * 2), r"derive it from redundant_envs\.Arm, with joint"),
        (lambda: rde.register_arm(rde.Chain), r"class RPR\(rde\.Arm\): joint_types = 'RPR'"),
        (lambda: subject_of("Chain"), "Chain has no default of .*joint_types; name one"),
        (lambda: rde.Scene.from_dict({"robot": untyped}), "lacks 'joint_types'"),
    ):
        with pytest.raises(ValueError, match=said):
            refused()
