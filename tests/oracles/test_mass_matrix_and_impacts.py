"""Oracles O13 to O15 and O17: the mass matrix, impacts, bounces, locked joints, identities."""

import numpy as np
from oracle_cases import EVERY, UNEQUAL, G, along, assert_within, largest, motion, states

import redundant_envs as rde
from redundant_envs.effects import Gravity, PrismaticStop

INSTANT = 1e-300
"""An interval in which nothing but an impact happens, s."""


def product(matrices, vectors):
    """Of each matrix with its vector, (n, 4)."""
    return np.einsum("nij,nj->ni", matrices, vectors)


def large(matrices):
    """Largest entry of each, (n, 1, 1)."""
    return np.abs(matrices).max((1, 2))[:, None, None]


def closed_determinant(robot, q):
    """det M of masses on massless links, (...): products and sums of positive numbers alone."""
    m = robot.masses
    if robot.kind == "FourR":
        tension = np.full(q.shape[:-1], m[3])
        det = tension.copy()
        for k in (2, 1, 0):
            s = np.sin(q[..., k + 1] - q[..., k])
            det = det * (m[k] + tension * s**2)
            tension = m[k] * (m[k] + tension) / (m[k] + tension * s**2)
        return det * np.prod(robot.lengths) ** 2
    (l1, l2), (_, r1, _, r2) = robot.lengths, np.moveaxis(q, -1, 0)
    s, c = np.sin(q[..., 0] - q[..., 2]), np.cos(q[..., 0] - q[..., 2])
    inertia = m[2] * l2**2 + m[3] * (l2 + r2) ** 2
    mu = m[2] * m[3] * r2**2 / inertia
    across = m[1] + m[2] * c**2 + mu * s**2
    return m[3] * inertia * (across * m[0] * l1**2 + (l1 + r1) ** 2 * (m[1] + m[2]) * (m[1] + mu))


def test_o13_determinant_and_impact_map():
    """det M by closed forms and by LU; at e = 1 the impact map keeps T and is its own inverse.

    All of M qd but the component of the slider stays. 1000 random poses and velocities; each slider in half
    of the lanes at its upper or lower stop. An interval of no length is nothing but the impact.
    """
    found = {}
    for name, robot in UNEQUAL.items():
        q = states(robot, 1000)[0]
        det = closed_determinant(robot, q)
        found[f"det M {name}"] = largest(np.linalg.det(robot.mass_matrix(q)) - det, det)
    arm = UNEQUAL["RPRP"]
    q, qd = states(arm, 1000)
    lanes = np.arange(1000)
    slider, side = np.where(lanes % 2, 1, 3), np.where(lanes % 4 < 2, 1.0, -1.0)
    q[lanes, slider] = side * 0.3
    qd[lanes, slider] = side * (0.05 + np.abs(qd[lanes, slider]))
    stops = PrismaticStop((-0.3, -0.3), (0.3, 0.3), 1.0)
    batch = rde.BatchSimulator(rde.Scene(arm, (Gravity(0.0), stops), tolerance=1e-12), 1000)

    def impact(velocities):
        batch.set_state(q, velocities)
        status = batch.advance_partly(None, INSTANT)
        assert (status.events == 1).all()
        assert not status.numerics.any()
        assert (batch.q == q).all()
        return batch.qd

    after = impact(qd)
    back = -impact(-after)
    M, T = arm.mass_matrix(q), arm.kinetic_energy(q, qd)
    momenta = product(np.abs(M), np.abs(qd)).max(1, keepdims=True)
    jump = product(M, after - qd)
    jump[lanes, slider] = 0.0
    speed = np.abs(qd).max(1, keepdims=True)
    found |= {
        "kinetic energy": largest(arm.kinetic_energy(q, after) - T, T),
        "restitution": largest((after + qd)[lanes, slider], speed[:, 0]),
        "other momenta": largest(jump, momenta),
        "twice": largest(back - qd, speed),
    }
    bounds = {"det M RPRP": 7e-15, "det M FourR": 1e-14, "kinetic energy": 4e-15, "restitution": 1e-16}
    assert_within(bounds | {"other momenta": 3e-15, "twice": 2e-15}, found)


def test_o14_bounces_shrink_by_e_squared_and_end_in_zeno_time():
    """RPRP hanging, r_1 falls 0.3 m: heights h_n = e^(2n) h_0, at rest after sqrt(2 h/g) (1 + e)/(1 - e).

    m_4 is next to nothing and r_2 has no stop, so that r_1 falls freely. That time is of the last impact and
    of all bounces that it leaves out; the slider is put to rest sooner, at bounces of a nanometre, and then
    is at its stop to the last bit. Without gravity and at e = 1 impacts on a stop are 2 d / v apart.
    """
    masses, drop = (1.0, 1.0, 1.0, 1e-12), 0.3
    arm = rde.RPRP(masses, (0.5, 0.5))
    q0 = np.array([-0.5 * np.pi, 0.0, -0.5 * np.pi, 0.1])
    found = {}
    for e, seconds in ((0.5, 0.8), (0.9, 4.8)):
        stops = PrismaticStop((-1.0, None), (drop, None), e)
        made = rde.Scene(arm, (Gravity(G), stops), tolerance=1e-12)
        run = rde.simulate(made, q0, np.zeros(4), [seconds])
        hits = [x for x in run.events if x.kind == "upper impact"]
        rest = [x for x in run.events if x.kind == "rest"]
        speeds, times = np.array([x.speed for x in hits]), np.array([x.time for x in hits])
        n = np.arange(len(hits))
        fall = np.sqrt(2.0 * drop / G)
        end = fall * (1.0 + e) / (1.0 - e)
        # The last impact leaves a speed of e v: what it would still have bounced counts.
        last = times[-1] + 2.0 * e * speeds[-1] / (G * (1.0 - e))
        assert len(rest) == 1
        found |= {
            f"heights, e = {e}": largest(speeds**2 / (2.0 * G) - drop * e ** (2 * n), drop),
            f"times, e = {e}": largest(times - fall * (1.0 + 2.0 * e * (1.0 - e**n) / (1.0 - e))),
            f"end, e = {e}": abs(last - end),
            f"early, e = {e}": end - rest[0].time,
            f"away, e = {e}": abs(run.q[-1, 1] - drop),
        }
    d, v = 0.4, 1.3
    stops = PrismaticStop((0.0, None), (d, None), 1.0)
    made = rde.Scene(arm, (Gravity(0.0), stops), tolerance=1e-12)
    run = rde.simulate(made, [0.0, 0.1, 0.0, 0.1], [0.0, v, 0.0, 0.0], [2.0])
    times = np.array([x.time for x in run.events])
    assert len(times) == 6
    found["elastic period"] = largest(times - ((d - 0.1) + d * np.arange(6)) / v)
    bounds = {
        "heights, e = 0.5": 2e-15, "times, e = 0.5": 5e-13, "end, e = 0.5": 2e-12, "early, e = 0.5": 1e-4,
        "heights, e = 0.9": 1e-14, "times, e = 0.9": 2e-12, "end, e = 0.9": 1.5e-11, "early, e = 0.9": 1e-3,
        "away, e = 0.5": 0.0, "away, e = 0.9": 0.0, "elastic period": 5e-15,
    }  # fmt: skip
    assert_within(bounds, found)


def double_pendulum(first, second, q, qd):
    """Two links with masses at distances ``{distance: mass}`` along them: angles from +x, (..., 2)."""
    (a, b), (wa, wb) = np.moveaxis(q, -1, 0), np.moveaxis(qd, -1, 0)
    length = max(first)
    carried = sum(second.values())
    inertia_a = sum(m * x**2 for x, m in first.items()) + carried * length**2
    moment_a = sum(m * x for x, m in first.items()) + carried * length
    inertia_b, moment_b = (sum(m * x**k for x, m in second.items()) for k in (2, 1))
    c, s = length * moment_b * np.cos(a - b), length * moment_b * np.sin(a - b)
    fa, fb = -s * wb**2 - moment_a * G * np.cos(a), s * wa**2 - moment_b * G * np.cos(b)
    det = inertia_a * inertia_b - c**2
    return np.stack([(inertia_b * fa - c * fb) / det, (inertia_a * fb - c * fa) / det], axis=-1)


def test_o15_locked_joints_leave_a_double_pendulum():
    """4R with theta_2 = theta_3 = theta_4 welded, RPRP with both sliders locked, are the textbook's.

    4R: the accelerations under the forces of the weld, which do no work. RPRP: a compiled motion of 0.25 s
    whose sliders rest at stops, pressed there, against short classical Runge-Kutta steps of the textbook's.
    """
    rng = np.random.default_rng(5)
    pose, rates = rng.uniform(-np.pi, np.pi, (200, 2)), rng.uniform(-2.0, 2.0, (200, 2))
    arm = UNEQUAL["FourR"]
    m, l = arm.masses, arm.lengths
    weld = np.array([[1, 0], [0, 1], [0, 1], [0, 1]], float)
    expected = double_pendulum({l[0]: m[0]}, {sum(l[1 : k + 1]): m[k] for k in (1, 2, 3)}, pose, rates)
    q, qd, qdd = (x @ weld.T for x in (pose, rates, expected))
    forces = arm.inverse_dynamics(q, qd, qdd, G)
    scale = np.abs(expected).max(1, keepdims=True)
    size = product(np.abs(arm.mass_matrix(q)), np.abs(qdd)).max(1, keepdims=True)
    found = {
        "4R acceleration": largest(arm.forward_dynamics(q, qd, forces, G) - qdd, scale),
        "4R work of the weld": largest(forces @ weld, size),
    }
    arm = UNEQUAL["RPRP"]
    m, l = arm.masses, arm.lengths
    first, second = {l[0]: m[0], l[0] + 0.2: m[1]}, {l[1]: m[2], l[1] + 0.1: m[3]}
    stops = PrismaticStop((-0.2, -0.2), (0.2, 0.1), 0.0)
    made = rde.Scene(arm, (Gravity(G), stops), tolerance=1e-12)
    start = np.column_stack([pose[:, 0], np.full(200, 0.2), pose[:, 1], np.full(200, 0.1)])
    going = np.column_stack([rates[:, 0], np.zeros(200), rates[:, 1], np.zeros(200)])
    q, qd = motion(made, start, going, 0.25, [0.0, 500.0, 0.0, 500.0], duration=0.25 / 16)

    def slope(y):
        return np.stack([y[1], double_pendulum(first, second, *y)])

    y, h = np.stack([pose, rates]), 0.25 / 1000
    for _ in range(1000):
        k1 = slope(y)
        k2 = slope(y + 0.5 * h * k1)
        k3 = slope(y + 0.5 * h * k2)
        k4 = slope(y + h * k3)
        y = y + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    found |= {
        "RPRP angles": largest(q[:, [0, 2]] - y[0]),
        "RPRP rates": largest(qd[:, [0, 2]] - y[1]),
        "RPRP sliders": largest(q[:, [1, 3]] - [0.2, 0.1]),
    }
    bounds = {"4R acceleration": 2e-14, "4R work of the weld": 4e-15, "RPRP sliders": 0.0}
    assert_within(bounds | {"RPRP angles": 2e-12, "RPRP rates": 6e-11}, found)


@EVERY
def test_o17_identities_of_the_equations(robot):
    """M qdd + h + G = Q; M' - 2 C is skew; M is the sum of m_k J_k^T J_k; J' qd by complex step."""
    q, qd = states(robot, 200, speed=5.0)
    Q = np.random.default_rng(3).uniform(-30.0, 30.0, q.shape)
    qdd = robot.forward_dynamics(q, qd, Q, G)
    M, h, C = robot.mass_matrix(q), robot.bias_forces(q, qd), robot.coriolis_matrix(q, qd)
    weight = robot.gravity_forces(q, G)
    residual = robot.inverse_dynamics(q, qd, qdd, G) - Q
    terms = product(np.abs(M), np.abs(qdd)) + np.abs(h) + np.abs(weight) + np.abs(Q)
    rest = np.zeros_like(q)
    names = [f"M{i}{j}" for i in range(1, 5) for j in range(1, 5)]
    Mdot = along(robot, names, q, qd, qd, rest).reshape(-1, 4, 4)
    skew = Mdot - 2.0 * C
    points = [f"{axis}{k}" for k in range(1, 5) for axis in "xy"]
    J = np.stack([along(robot, points, q, qd, np.broadcast_to(e, q.shape), rest) for e in np.eye(4)], axis=-1)
    masses = np.repeat(robot.masses, 2)
    tip = along(robot, ["tip_vx", "tip_vy"], q, qd, qd, rest)
    found = {
        "M qdd + h + G = Q": largest(residual, terms.max(1, keepdims=True)),
        "C qd = h": largest(product(C, qd) - h, product(np.abs(C), np.abs(qd)).max(1, keepdims=True)),
        "M' - 2 C skew": largest(skew + np.swapaxes(skew, 1, 2), large(C)),
        "M from J": largest(np.einsum("nki,k,nkj->nij", J, masses, J) - M, large(M)),
        "J' qd": largest(tip - robot.jacobian_dot_qd(q, qd), np.abs(tip).max(1, keepdims=True)),
    }
    bounds = {"M qdd + h + G = Q": 1e-15, "C qd = h": 1.5e-15, "M' - 2 C skew": 6e-15}
    assert_within(bounds | {"M from J": 2.5e-15, "J' qd": 1e-14}, found)
