"""Identities between the methods of the model, and the states where elimination could lose digits."""

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


def complex_step(robot, wanted, q, qd, step=1e-30):
    """Exact derivatives of named quantities along q + t qd: the functions on complex numbers."""
    values = {**robot.parameter_values(), "ax": 0.0, "ay": G}
    values.update({n: q[..., k] + 1j * step * qd[..., k] for k, n in enumerate(robot.coordinates)})
    values.update({n: qd[..., k] for k, n in enumerate(robot.rates)})
    parts = robot.evaluate(wanted.split(), values)
    return np.stack([np.broadcast_to(np.imag(p) / step, q.shape[:-1]) for p in parts], axis=-1)


@EVERY
def test_inverse_undoes_forward(robot):
    """Accelerations -> forces -> accelerations."""
    q, qd, Q = states(robot)
    again = robot.forward_dynamics(q, qd, robot.inverse_dynamics(q, qd, Q, G), G)
    force = np.abs(robot.inverse_dynamics(q, qd, Q, G)).max(-1)
    force += np.abs(robot.bias_forces(q, qd)).max(-1)
    smallest = np.linalg.eigvalsh(robot.mass_matrix(q))[..., 0]
    assert (np.abs(again - Q).max(-1) <= 1e-14 * force / smallest).all()


@EVERY
@pytest.mark.parametrize("g", [0.0, 1.62, -9.81])
def test_elimination_agrees_with_a_linear_solve(robot, g):
    """M qdd = Q - h - G by LU."""
    q, qd, Q = states(robot)
    M = robot.mass_matrix(q)
    right = Q - robot.bias_forces(q, qd) - robot.gravity_forces(q, g)
    solved = np.linalg.solve(M, right[..., None])[..., 0]
    assert relative(robot.forward_dynamics(q, qd, Q, g), solved) <= 1e-12


@EVERY
def test_mass_matrix_is_symmetric_positive_definite(robot):
    """Exactly symmetric; det M at or above the bound for parallel links (4R)."""
    M = robot.mass_matrix(states(robot)[0])
    assert (np.swapaxes(M, -1, -2) == M).all()
    assert np.linalg.eigvalsh(M).min() > 0.0
    if robot.kind == "FourR":
        bound = np.prod(robot.lengths) ** 2 * np.prod(robot.masses)
        assert (np.linalg.det(M) >= bound * (1.0 - 1e-12)).all()


@EVERY
def test_derivatives_by_complex_step(robot):
    """J is the derivative of the tip, G that of U."""
    q = states(robot)[0]
    J, G_forces = robot.jacobian(q), robot.gravity_forces(q, G)
    for k in range(4):
        along = np.broadcast_to(np.eye(4)[k], q.shape)
        assert relative(complex_step(robot, "tip_x tip_y", q, along), J[..., k]) <= 1e-14
        scale = np.abs(G_forces).max(-1)
        slope = complex_step(robot, "U", q, along)[..., 0]
        assert (np.abs(slope - G_forces[..., k]) <= 1e-14 * scale).all()


@EVERY
def test_gravity_forces_in_a_field_of_any_direction(robot):
    """G is the slope of U with both components of the field, as the simulator's equations have it."""
    q = states(robot)[0]
    field = {**robot.parameter_values(), "ax": 3.1, "ay": -2.3}
    names = robot.coordinates
    forces = robot.evaluate(["G1", "G2", "G3", "G4"], {**field, **dict(zip(names, q.T, strict=True))})
    scale = np.abs(forces).max(0)
    for k in range(4):
        shifted = dict(zip(names, (q + 1e-30j * np.eye(4)[k]).T, strict=True))
        slope = np.imag(robot.evaluate(["U"], {**field, **shifted})[0]) / 1e-30
        assert (np.abs(slope - forces[k]) <= 1e-14 * scale).all()


@EVERY
def test_tip_velocity(robot):
    """J qd is the rate of the tip."""
    q, qd, _ = states(robot)
    J = robot.jacobian(q)
    rate = complex_step(robot, "tip_x tip_y", q, qd)
    assert relative(np.einsum("...ij,...j->...i", J, qd), rate) <= 1e-13


@EVERY
def test_kinetic_energy_is_the_quadratic_form(robot):
    """T = qd M qd / 2, from another function."""
    q, qd, _ = states(robot)
    T = 0.5 * np.einsum("...i,...ij,...j", qd, robot.mass_matrix(q), qd)
    assert np.abs(robot.kinetic_energy(q, qd) / T - 1.0).max() <= 1e-13


@EVERY
def test_angular_momentum(robot):
    """The momenta conjugate to the angles, summed."""
    q, qd, _ = states(robot)
    p = np.einsum("...ij,...j->...i", robot.mass_matrix(q), qd)
    angles = [k for k in range(4) if not robot.prismatic[k]]
    scale = np.abs(p).max(-1) + np.abs(qd).max(-1)
    assert (np.abs(robot.angular_momentum(q, qd) - p[..., angles].sum(-1)) <= 1e-13 * scale).all()


@EVERY
def test_power_balance(robot):
    """dE/dt = qd Q: E = T + U, its rate along the motion that the forces cause."""
    q, qd, Q = states(robot)
    qdd = robot.forward_dynamics(q, qd, Q, G)
    at_constant_rates = complex_step(robot, "T U", q, qd).sum(-1)
    M = robot.mass_matrix(q)
    power = at_constant_rates + np.einsum("...i,...ij,...j", qd, M, qdd)
    scale = np.einsum("...i,...ij,...j", np.abs(qd), np.abs(M), np.abs(qdd))
    assert (np.abs(power - np.einsum("...i,...i", qd, Q)) <= 1e-13 * scale).all()


@EVERY
def test_angular_momentum_balance(robot):
    """dLz/dt is the sum of the forces on the angles less the moment of gravity about the base."""
    q, qd, Q = states(robot)
    qdd = robot.forward_dynamics(q, qd, Q, G)
    angles = [k for k in range(4) if not robot.prismatic[k]]
    M = robot.mass_matrix(q)
    rate = complex_step(robot, "Lz", q, qd)[..., 0]
    rate += np.einsum("...ij,...j->...i", M, qdd)[..., angles].sum(-1)
    moment = G * np.einsum("k,...k->...", np.array(robot.masses), robot.points(q)[..., 0])
    scale = np.abs(M).max((-1, -2)) * np.abs(qdd).max(-1)
    assert (np.abs(rate - (Q[..., angles].sum(-1) - moment)) <= 1e-13 * scale).all()


def test_motor_map():
    """Motor i acts between link i-1 and link i; RPRP's second motor reacts on the first angle."""
    four_r = [[1, -1, 0, 0], [0, 1, -1, 0], [0, 0, 1, -1], [0, 0, 0, 1]]
    rprp = [[1, 0, -1, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    assert (ROBOTS["FourR"].motor_map == four_r).all()
    assert (ROBOTS["RPRP"].motor_map == rprp).all()


@EVERY
def test_joint_coordinates(robot):
    """phi = B^T q, phi' = B^T qd, and back: motor power is t phi'."""
    q, qd, _ = states(robot)
    values = {n: q[..., k] for k, n in enumerate(robot.coordinates)}
    values.update({n: qd[..., k] for k, n in enumerate(robot.rates)})
    names = [f"phi{k}" for k in range(1, 5)] + [f"phid{k}" for k in range(1, 5)]
    phi = np.stack(robot.evaluate(names, values), axis=-1)
    B = robot.motor_map
    assert np.abs(phi[..., :4] - q @ B).max() <= 1e-15 * np.abs(q).max()
    assert np.abs(phi[..., 4:] - qd @ B).max() <= 1e-15 * np.abs(qd).max()
    back = np.stack(robot.coordinates_of_joints(*np.moveaxis(phi[..., :4], -1, 0)), axis=-1)
    assert np.abs(back - q).max() <= 1e-14 * np.abs(q).max()


@EVERY
def test_manipulability(robot):
    """sqrt(det J J^T)."""
    q = states(robot)[0]
    J = robot.jacobian(q)
    w = np.sqrt(np.linalg.det(J @ np.swapaxes(J, -1, -2)))
    assert np.abs(robot.manipulability(q) / w - 1.0).max() <= 1e-12


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
    shapes = {
        "mass_matrix": (4, 4), "points": (4, 2), "forward_kinematics": (2,), "jacobian": (2, 4),
        "manipulability": (), "gravity_forces": (4,), "potential_energy": (),
    }  # fmt: skip
    for name, tail in shapes.items():
        for leading in ((), (0,), (5,), (3, 1, 2)):
            value = getattr(robot, name)(np.full((*leading, 4), 0.3))
            assert value.shape == (*leading, *tail)
            assert value.dtype == np.float64
    shapes = {
        "bias_forces": (4,), "coriolis_matrix": (4, 4), "jacobian_dot_qd": (2,),
        "kinetic_energy": (), "angular_momentum": (),
    }  # fmt: skip
    for name, tail in shapes.items():
        assert getattr(robot, name)(q, qd).shape == (3, 4, 2, *tail)
    assert robot.inverse_dynamics(q, qd, Q).shape == (3, 4, 2, 4)


@EVERY
def test_wrong_shapes(robot):
    """The message names the argument and its shape."""
    good = np.zeros(4)
    with pytest.raises(ValueError, match=r"q has shape \(3,\).*4 entries"):
        robot.mass_matrix(np.zeros(3))
    with pytest.raises(ValueError, match=r"q has shape \(\)"):
        robot.forward_kinematics(1.0)
    with pytest.raises(ValueError, match=r"qd has shape \(2, 5\)"):
        robot.bias_forces(good, np.zeros((2, 5)))
    with pytest.raises(ValueError, match=r"Q has shape \(1,\)"):
        robot.forward_dynamics(good, good, [1.0])
    with pytest.raises(ValueError, match=r"qdd has shape \(4, 1\)"):
        robot.inverse_dynamics(good, good, np.zeros((4, 1)))
    with pytest.raises(ValueError, match="broadcast"):
        robot.bias_forces(np.zeros((2, 4)), np.zeros((3, 4)))


# ---- states and masses where elimination could lose digits, against 50 digits ---------------------


def reference(robot, q, qd, Q, g):
    """qdd from the Jacobians of the four masses alone, by LU with 60 digits."""
    mpmath = pytest.importorskip("mpmath", reason="mpmath is in the extra 'verify'")
    with mpmath.workdps(60):
        q, qd, Q = ([mpmath.mpf(float(x)) for x in v] for v in (q, qd, Q))
        l = [mpmath.mpf(x) for x in robot.lengths]
        if robot.kind == "RPRP":
            a, b = l[0] + q[1], l[1] + q[3]
            spans = [(l[0], 0), (a, 0), (a, l[1]), (a, b)]
            slides = [(0, 0), (1, 0), (1, 0), (1, 1)]
        M, right = mpmath.zeros(4), mpmath.matrix(4, 1)
        for k, mass in enumerate(robot.masses):
            J, bias = mpmath.zeros(2, 4), mpmath.matrix(2, 1)
            for i in range(2 if robot.kind == "RPRP" else k + 1):
                at = 2 * i if robot.kind == "RPRP" else i
                span = spans[k][i] if robot.kind == "RPRP" else l[i]
                c, s = mpmath.cos(q[at]), mpmath.sin(q[at])
                J[0, at], J[1, at] = -span * s, span * c
                bias[0] -= span * qd[at] ** 2 * c
                bias[1] -= span * qd[at] ** 2 * s
                if robot.kind == "RPRP" and slides[k][i]:
                    J[0, at + 1], J[1, at + 1] = c, s
                    bias[0] -= 2 * qd[at + 1] * qd[at] * s
                    bias[1] += 2 * qd[at + 1] * qd[at] * c
            bias[1] += mpmath.mpf(float(g))
            M += mpmath.mpf(mass) * J.T * J
            right -= mpmath.mpf(mass) * J.T * bias
        qdd = mpmath.lu_solve(M, right + mpmath.matrix(Q))
        return np.array([float(x) for x in qdd])


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
