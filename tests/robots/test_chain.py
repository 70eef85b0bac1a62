"""Chains of revolute joints and sliders: all of it follows from the positions of the point masses."""

import copy
import json
import pickle

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP
from foreign import states

import redundant_envs as rde
from redundant_envs.verify.subjects import subject_of

e = rde.effects
BY_HAND = {"RPRP": RPRP, "RRRR": FOUR_R}
WORDS = ["R", "PP", "RPP", "PRRP", "RPRRPRRPRR"]


def chain_of(types):
    rng = np.random.default_rng(len(types))
    return rde.Chain(types, rng.uniform(0.5, 2.0, len(types)), rng.uniform(0.3, 1.0, types.count("R")))


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


@pytest.mark.parametrize("types", WORDS)
def test_mass_points_are_where_the_joints_put_them(types):
    """A revolute joint begins a direction; a slider goes along the one before it, +x at the base."""
    chain = chain_of(types)
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
