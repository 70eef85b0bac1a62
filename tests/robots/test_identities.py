"""What the exact equations leave: shapes, batches, the motor map, and poses without manipulability."""

import itertools

import numpy as np
import pytest

import redundant_envs as rde

ROBOTS = {
    "RPRP": rde.RPRP((2.3, 0.7, 1.9, 0.4), (1.1, 0.6)),
    "FourR": rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35)),
}
EVERY = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
G = 9.81


def states(robot, shape=(50,), seed=7):
    """Random coordinates, rates and forces."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-10.0, 10.0, (*shape, 4))
    q[..., list(robot.prismatic)] /= 20.0
    return q, rng.uniform(-5.0, 5.0, (*shape, 4)), rng.uniform(-30.0, 30.0, (*shape, 4))


def test_motor_map():
    """Motor i acts between link i-1 and link i; RPRP's second motor reacts on the first angle."""
    four_r = [[1, -1, 0, 0], [0, 1, -1, 0], [0, 0, 1, -1], [0, 0, 0, 1]]
    rprp = [[1, 0, -1, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    assert (ROBOTS["FourR"].motor_map == four_r).all()
    assert (ROBOTS["RPRP"].motor_map == rprp).all()


def test_manipulability_vanishes_only_in_line():
    """4R: all links parallel; RPRP: both sliders at their pivots and the links parallel."""
    assert ROBOTS["FourR"].manipulability([0.3, 0.3, 0.3 + np.pi, 0.3]) <= 1e-15
    assert ROBOTS["FourR"].manipulability([0.3, 0.3, 0.3, 0.4]) > 0.01
    rprp = ROBOTS["RPRP"]
    assert rprp.manipulability([0.3, -1.1, 0.3, -0.6]) == 0.0
    assert rprp.manipulability([0.3, -1.1, 0.8, -0.6]) > 0.4


@EVERY
def test_batches_broadcast(robot):
    """Any batch shape; arguments broadcast; each entry is the single evaluation."""
    q, qd, Q = states(robot, (3, 1, 2)), states(robot, (4, 1), 8), states(robot, (2,), 9)
    q, qd, Q = q[0], qd[1], Q[2]
    qdd = robot.forward_dynamics(q, qd, Q, G)
    assert qdd.shape == (3, 4, 2, 4)
    for i, j, k in ((0, 0, 0), (2, 3, 1), (1, 2, 0)):
        assert np.allclose(qdd[i, j, k], robot.forward_dynamics(q[i, 0, k], qd[j, 0], Q[k], G), 1e-13, 0)
    tails = {"mass_matrix": (4, 4), "points": (4, 2), "forward_kinematics": (2,), "jacobian": (2, 4),
             "manipulability": (), "gravity_forces": (4,), "potential_energy": ()}  # fmt: skip
    for (name, tail), leading in itertools.product(tails.items(), ((), (0,), (5,), (3, 1, 2))):
        value = getattr(robot, name)(np.full((*leading, 4), 0.3))
        assert (value.shape, value.dtype) == ((*leading, *tail), np.float64)
    tails = {"bias_forces": (4,), "coriolis_matrix": (4, 4), "jacobian_dot_qd": (2,), "kinetic_energy": (),
             "angular_momentum": ()}  # fmt: skip
    for name, tail in tails.items():
        assert getattr(robot, name)(q, qd).shape == (3, 4, 2, *tail)
    assert robot.inverse_dynamics(q, qd, Q).shape == (3, 4, 2, 4)


@EVERY
@pytest.mark.parametrize(
    ("name", "shapes", "said"),
    [
        ("mass_matrix", [(3,)], r"q has shape \(3,\).*4 entries"),
        ("forward_kinematics", [()], r"q has shape \(\)"),
        ("bias_forces", [4, (2, 5)], r"qd has shape \(2, 5\)"),
        ("forward_dynamics", [4, 4, 1], r"Q has shape \(1,\)"),
        ("inverse_dynamics", [4, 4, (4, 1)], r"qdd has shape \(4, 1\)"),
        ("bias_forces", [(2, 4), (3, 4)], "broadcast"),
    ],
)
def test_wrong_shapes_are_refused_with_the_name_of_the_argument(robot, name, shapes, said):
    with pytest.raises(ValueError, match=said):
        getattr(robot, name)(*map(np.zeros, shapes))
