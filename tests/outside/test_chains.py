"""Chains in batches, gradients and environments; and hand-written forms that replace derived ones."""

import gymnasium as gym
import numpy as np
import pytest
from three_r import ThreeR, points
from three_r_by_hand import ThreeRByHand, mass_matrix

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.verify import equations, kinematics, verify
from redundant_envs.verify.checks import checks_of

e = rde.effects
MASSES = (2.0, 1.5, 1.0, 0.5)


class Cart(rde.Arm):
    """A pendulum of two links on a cart, from the types of its joints alone."""

    joint_types = "PRR"


SCENE = {
    "robot": {"type": "Cart", "masses": [1.0, 0.5, 0.5], "lengths": [0.4, 0.3]},
    "effects": [
        {"type": "Gravity"},
        {"type": "EffortLimits", "limits": [40.0, 10.0, 4.0]},
        {"type": "PrismaticStop", "lower": [-0.3], "upper": [0.3], "restitution": 0.5},
    ],
    "tolerance": 1e-6,
}
rde.register_arm(Cart, SCENE)


@pytest.mark.parametrize(
    ("types", "hand"),
    [("RPRP", rde.RPRP(MASSES, (0.3, 0.5))), ("RRRR", rde.FourR(MASSES, (0.3, 0.5, 0.4, 0.6)))],
)
def test_a_chain_moves_as_the_arm_written_by_hand(types, hand):
    """Through impacts, with separate masses for each lane."""
    effects = [e.Gravity(), e.ViscousFriction(0.1)]
    if hand.sliders():
        effects.append(e.PrismaticStop((0.0, 0.0), (0.3, 0.3), 0.7))
    rng = np.random.default_rng(4)
    q, qd, efforts = rng.uniform(-1.0, 1.0, (3, 16, 4))
    q[:, hand.sliders()] = rng.uniform(0.01, 0.29, (16, len(hand.sliders())))
    masses, ends = rng.uniform(0.5, 2.0, (16, 4)), []
    for arm in (hand, rde.Chain(types, hand.masses, hand.lengths)):
        batch = rde.BatchSimulator(rde.Scene(arm, effects, tolerance=1e-10), 16)
        batch.set_parameters({"masses": masses})
        batch.set_state(q, qd)
        for _ in range(10):
            status = batch.advance(efforts)
            assert status.finite.all()
        ends.append(np.concatenate([batch.q, batch.qd], axis=1))
    assert np.abs(ends[0] - ends[1]).max() < 1e-7


def test_gradients_go_through_a_chain():
    torch = pytest.importorskip("torch", reason="torch is in the extra 'train'")
    arm = rde.Chain("PRP", (1.0, 0.5, 0.5), (0.4,))
    scene = rde.Scene(arm, (e.Gravity(),), integrator="rk4")
    step = rde.torch_step(scene)
    q = torch.tensor([[0.1, 0.4, 0.2]], dtype=torch.float64, requires_grad=True)
    qd = torch.tensor([[0.3, -0.5, 0.1]], dtype=torch.float64)
    efforts = torch.tensor([[1.0, -2.0, 0.5]], dtype=torch.float64)
    after = step(q, qd, efforts)[0]
    batch = rde.BatchSimulator(scene, 1)
    batch.set_state(q.detach().numpy(), qd.numpy())
    batch.advance(efforts.numpy())
    assert np.abs(after.detach().numpy() - batch.q).max() < 1e-14
    after.sum().backward()
    assert np.isfinite(q.grad.numpy()).all()
    assert np.abs(q.grad.numpy()).max() > 0.5


def test_a_class_of_joint_types_alone_has_environments():
    env = gym.make("redundant_envs/CartReach-v0")
    env.reset(seed=0)
    envs = gym.make_vec("redundant_envs/CartReach-v0", num_envs=8)
    envs.reset(seed=0)
    action = env.action_space.sample()
    alone = env.step(action)[0]
    assert np.array_equal(envs.step(np.repeat(action[None], 8, axis=0))[0][0], alone)
    arm = env.unwrapped.core.scene.robot
    chain = rde.Chain("PRR", arm.masses, arm.lengths)
    assert np.array_equal(arm.points(env.unwrapped.q), chain.points(env.unwrapped.q))


def test_bounds_are_unknown_where_no_points_show_a_rate_and_the_message_says_so():
    @physics(gives="x1 y1 x2 y2")
    def swinging(l1, s1, c1, s2):
        return l1 * c1, l1 * s1, l1 * c1 + 0.1 * s2, l1 * s1

    kind = type("Swinging", (rde.Arm,), {"joint_types": "RR", "functions": (swinging,)})
    assert kind.mobility_bounds is None
    scene = rde.Scene(kind((1.0, 1.0), (0.5,)), (e.LimitSpring("joint1", -1.0, 1.0),), tolerance=1e-6)
    with pytest.raises(ValueError, match="Swinging has no mobility_bounds"):
        rde.BatchSimulator(scene, 1)


# ---- hand-written forms replace derived ones -------------------------------------------------------------


def test_the_arm_from_points_is_the_one_by_hand():
    arms = [kind((2.0, 1.5, 1.0), (0.3, 0.5, 0.4)) for kind in (ThreeR, ThreeRByHand)]
    rng = np.random.default_rng(0)
    q, qd, Q = rng.uniform(-3.0, 3.0, (3, 100, 3))
    known = {"mass_matrix": (q,), "bias_forces": (q, qd), "gravity_forces": (q,), "jacobian_dot_qd": (q, qd)}
    for name, arguments in known.items():
        found, expected = (getattr(arm, name)(*arguments) for arm in arms)
        assert np.abs(found - expected).max() <= 2e-15 * np.abs(expected).max()
    accelerations = [a.forward_dynamics(q, qd, Q) for a in arms]
    assert np.abs(np.subtract(*accelerations)).max() <= 1e-13 * np.abs(accelerations[0]).max()


def with_mass_matrix(factor, base=(points,)):
    @physics(gives="M11 M12 M13 M21 M22 M23 M31 M32 M33")
    def matrix(m1, m2, m3, l1, l2, l3, s1, c1, s2, c2, s3, c3):
        m23 = m2 + m3
        M12 = m23 * l1 * l2 * (c1 * c2 + s1 * s2)
        M13 = factor * m3 * l1 * l3 * (c1 * c3 + s1 * s3)
        M23 = m3 * l2 * l3 * (c2 * c3 + s2 * s3)
        return (m1 + m23) * l1 * l1, M12, M13, M12, m23 * l2 * l2, M23, M13, M23, m3 * l3 * l3

    return type("Mixed", (ThreeR,), {"functions": (*base, matrix)})((2.0, 1.5, 1.0), (0.3, 0.5, 0.4))


@pytest.mark.parametrize("base", [(points,), ThreeR.functions], ids=["points", "all of a base"])
def test_a_mass_matrix_by_hand_replaces_the_derived_one_and_is_compared_with_it(base):
    def missed(arm):
        scene = rde.Scene(arm, (e.Gravity(),), tolerance=1e-6)
        return {
            o.check
            for o in verify(scene, 24, checks=checks_of(equations, kinematics)).outcomes
            if o.verdict.value == "MISSED"
        }

    assert missed(with_mass_matrix(1.0, base)) == set()
    assert "mass matrix" in missed(with_mass_matrix(1.0 + 1e-6, base))
    names = [f.__name__ for f in type(with_mass_matrix(1.0, base)).functions]
    assert names.count("matrix") == 1
    assert mass_matrix.__name__ not in names
