"""What the exact equations leave: shapes, batches, and states where elimination could lose digits."""

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


def relative(value, reference, axes=-1):
    """Largest difference over the entries, relative to the largest entry, worst of the batch."""
    return (np.abs(value - reference).max(axes) / np.abs(reference).max(axes)).max()


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


# ---- states and masses where elimination could lose digits, against 50 digits ---------------------


def reference(robot, q, qd, Q, g):
    """qdd from the Jacobians of the four masses alone, by LU with 60 digits."""
    mpmath = pytest.importorskip("mpmath", reason="mpmath is in the extra 'verify'")
    with mpmath.workdps(60):
        q, qd, Q = ([mpmath.mpf(float(x)) for x in v] for v in (q, qd, Q))
        l = [mpmath.mpf(x) for x in robot.lengths]
        # For each mass the links up to it: index of the angle, length, whether a slider ends it.
        if robot.kind == "RPRP":
            first, second = (0, l[0] + q[1], True), (2, l[1] + q[3], True)
            links = [[(0, l[0], False)], [first], [first, (2, l[1], False)], [first, second]]
        else:
            links = [[(i, l[i], False) for i in range(k + 1)] for k in range(4)]
        M, right = mpmath.zeros(4), mpmath.matrix(Q)
        for mass, chain in zip(robot.masses, links, strict=True):
            J, bias = mpmath.zeros(2, 4), mpmath.matrix([0, float(g)])
            for i, span, slides in chain:
                c, s = mpmath.cos(q[i]), mpmath.sin(q[i])
                J[0, i], J[1, i] = -span * s, span * c
                bias -= span * qd[i] ** 2 * mpmath.matrix([c, s])
                if slides:
                    J[0, i + 1], J[1, i + 1] = c, s
                    bias += 2 * qd[i + 1] * qd[i] * mpmath.matrix([-s, c])
            M += mpmath.mpf(mass) * J.T * J
            right -= mpmath.mpf(mass) * J.T * bias
        return np.array([float(x) for x in mpmath.lu_solve(M, right)])


def hard_cases():
    four, two = (1.1, 0.6, 0.9, 0.35), (1.1, 0.6)
    masses = (2.3, 0.7, 1.9, 0.4)
    rates, forces = (1.0, -2.0, 3.0, -4.0), (5.0, -3.0, 2.0, 0.7)
    tenth = (0.1,) * 4
    light = (1e-12, 1e-12, 1e-12, 1.0)
    pi = np.pi
    yield "4R light chain", rde.FourR(light, (1.0,) * 4), (0.3, 1.2, -2.0, 0.8), rates, tenth
    yield "4R light chain, lengths", rde.FourR(light, four), (0.3, 1.2, -2.0, 0.8), rates, tenth
    yield "4R light tip", rde.FourR(light[::-1], four), (0.3, 1.2, -2.0, 0.8), rates, (1.0, 1.0, 0.0, 0.0)
    near = (0.3, 0.3 + 1e-6, 0.3 + 3e-6, 0.3 + 2e-6)
    yield "4R light chain, nearly straight", rde.FourR(light, four), near, rates, tenth
    yield "4R light chain, straight", rde.FourR(light, four), (0.3,) * 4, rates, tenth
    yield "4R straight", rde.FourR(masses, four), (0.7,) * 4, rates, forces
    yield "4R nearly straight", rde.FourR(masses, four), (0.7, 0.7 + 1e-9, 0.7, 0.7 - 1e-8), rates, forces
    yield "4R folded", rde.FourR(masses, four), (0.7, 0.7 + pi, 0.7, 0.7 + pi), rates, forces
    yield "4R folded once", rde.FourR(masses, four), (0.0, 0.0, pi, pi), rates, forces
    yield "4R right angles", rde.FourR(masses, four), (0.0, pi / 2, pi, -pi / 2), rates, forces
    yield "4R short link", rde.FourR(masses, (1.0, 1e-6, 1.0, 0.5)), (0.3, 1.2, -2.0, 0.8), rates, tenth
    yield "4R wound up", rde.FourR(masses, four), (300.1, -512.7, 77.0, 903.3), rates, forces
    yield "RPRP light chain", rde.RPRP(light, two), (0.3, 0.2, -2.0, 0.1), rates, tenth
    yield "RPRP straight", rde.RPRP(masses, two), (0.7, 0.2, 0.7, 0.1), rates, forces
    yield "RPRP folded", rde.RPRP(masses, two), (0.7, 0.2, 0.7 + pi, 0.1), rates, forces
    yield "RPRP r2 = -l2", rde.RPRP(masses, two), (0.7, 0.2, -0.4, -0.6), rates, forces
    yield "RPRP r2 near -l2", rde.RPRP(masses, two), (0.7, 0.2, -0.4, -0.6 + 1e-9), rates, forces
    yield "RPRP r1 = -l1", rde.RPRP(masses, two), (0.7, -1.1, -0.4, 0.2), rates, forces
    yield "RPRP both at the pivots", rde.RPRP(masses, two), (0.7, -1.1, 0.7, -0.6), rates, forces
    yield "RPRP r2 = 0", rde.RPRP(masses, two), (0.7, 0.2, 0.7 + pi / 2, 0.0), rates, forces
    yield "RPRP heavy slider", rde.RPRP((1.0, 1e6, 1e-6, 1.0), two), (0.7, 0.2, -0.4, 0.3), rates, forces


@pytest.mark.parametrize(("robot", "q", "qd", "Q"), [pytest.param(*c[1:], id=c[0]) for c in hard_cases()])
def test_hard_cases(robot, q, qd, Q):
    """qdd to 1e-13 of its largest entry, whatever the pose and the masses."""
    expected = reference(robot, q, qd, Q, G)
    assert relative(robot.forward_dynamics(q, qd, Q, G), expected) <= 1e-13


@EVERY
def test_the_reference_is_independent_and_agrees(robot):
    """On ordinary states too, so that the hard cases test the package and not the reference."""
    q, qd, Q = states(robot, (5,))
    for i in range(5):
        expected = reference(robot, q[i], qd[i], Q[i], G)
        assert relative(robot.forward_dynamics(q[i], qd[i], Q[i], G), expected) <= 1e-13
