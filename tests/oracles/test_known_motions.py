"""Motions that are known without the package: closed forms, mirrors and bounces.

Hard cases have more (10, 13, 20, 25), and ``verify`` checks energy, momentum, units and MuJoCo's motions.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.effects import Gravity, PrismaticStop

G = 9.81
UNEQUAL = {
    "RPRP": rde.RPRP((2.3, 0.7, 1.9, 0.4), (1.1, 0.6)),
    "FourR": rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35)),
}
LAB = {"RPRP": rde.RPRP((1.0,) * 4, (0.5,) * 2), "FourR": rde.FourR((1.0,) * 4, (0.5,) * 4)}
"""Equal masses of 1 kg and links of 0.5 m."""
EVERY = pytest.mark.parametrize("robot", UNEQUAL.values(), ids=UNEQUAL)


def assert_within(bounds, residuals):
    """Every residual is at most its bound."""
    assert residuals.keys() == bounds.keys()
    assert {n: (residuals[n], most) for n, most in bounds.items() if not residuals[n] <= most} == {}


def exact(robot, g=G, **changes):
    """A scene of gravity at the preset "exact"."""
    return rde.Scene(robot, (Gravity(g),), **{"tolerance": 1e-12, "control_dt": 0.02, **changes})


def motion(scene, q, qd, seconds, efforts=None):
    """Coordinates and velocities after some time, (count, 4) each; no lane reports a fault."""
    q, qd = np.broadcast_arrays(np.atleast_2d(q), np.atleast_2d(qd))
    batch = rde.BatchSimulator(scene, len(q))
    batch.set_state(q, qd)
    efforts = None if efforts is None else np.broadcast_to(np.asarray(efforts, float), q.shape)
    for _ in range(round(seconds / scene.control_dt)):
        assert not batch.advance(efforts).numerics.any()
    return batch.q, batch.qd


def largest(difference, scale=1.0):
    """Largest absolute entry, in units of the scale."""
    return float((np.abs(difference) / scale).max())


# ---- frequencies and motions that have closed forms ----------------------------------------------------


def test_hanging_arm_has_laguerre_frequencies():
    """4R, equal masses and lengths: omega_k^2 = (g/l) x_k with x_k the zeros of Laguerre's L_4.

    A second of compiled motion in each mode, in units of its amplitude of 1e-6 rad; rounding of pi/2 is 2e-10
    of it. The printed zeros are rounded.
    """
    arm, l = LAB["FourR"], 0.5
    polynomial = np.polynomial.Polynomial([24.0, -96.0, 72.0, -16.0, 1.0])  # 24 L_4
    zeros = np.sort(polynomial.roots().real)
    zeros -= polynomial(zeros) / polynomial.deriv()(zeros)
    hanging, amplitude = np.full((4, 4), -0.5 * np.pi), 1e-6
    stiffness = G * l * np.diag([4.0, 3.0, 2.0, 1.0])  # masses beyond each joint
    squares, modes = np.linalg.eig(np.linalg.solve(arm.mass_matrix(hanging[0]), stiffness))
    modes = (modes / np.abs(modes).max(axis=0))[:, np.argsort(squares)].T
    q, qd = motion(exact(arm), hanging + amplitude * modes, np.zeros((4, 4)), 1.0)
    omega = np.sqrt(zeros * G / l)[:, None]
    assert_within(
        {"printed": 1e-12, "motion": 5e-9, "velocity": 5e-8},
        {
            "printed": largest(zeros - [0.322547689619, 1.745761101158, 4.536620296921, 9.395070912301]),
            "motion": largest((q - hanging) / amplitude - modes * np.cos(omega)),
            "velocity": largest(qd / amplitude + modes * omega * np.sin(omega)),
        },
    )


def test_light_links_leave_a_pendulum():
    """m_2 .. m_4 = eps: released at A = 2 rad, theta_1 is at A cd's closed values after each eighth period.

    T = 4 K sqrt(l/g) with K by the arithmetic-geometric mean; sin(theta/2) = k cd, which after T/8 is
    k / sqrt(1 + k'). The rest is linear in eps: after a period 4.5e-5 rad (4R) at eps = 1e-6, on the way up
    to twice that. The sliders of the RPRP arm are kept on their links by stops without restitution.
    """
    amplitude, l = 2.0, 0.5
    k, complement = math.sin(0.5 * amplitude), math.cos(0.5 * amplitude)
    a, b = 1.0, complement
    for _ in range(8):
        a, b = 0.5 * (a + b), math.sqrt(a * b)
    period = 4.0 * (0.5 * math.pi / a) * math.sqrt(l / G)
    eighth = 2.0 * math.asin(k / math.sqrt(1.0 + complement))
    expected = np.array([eighth, 0.0, -eighth, -amplitude, -eighth, 0.0, eighth, amplitude])
    eps = np.array([1e-6, 1e-9, 1e-12])
    masses = np.column_stack([np.ones(3), eps, eps, eps])
    found = {"printed period": abs(period - 1.885055421)}
    for name, start, kept in (
        ("FourR", [amplitude - 0.5 * math.pi] * 4, ()),
        ("RPRP", [amplitude - 0.5 * math.pi, 0.1] * 2, (PrismaticStop((0.0, 0.0), (0.2, 0.2), 0.0),)),
    ):
        made = exact(LAB[name])
        batch = rde.BatchSimulator(replace(made, effects=(*made.effects, *kept)), 3)
        batch.set_parameters({"masses": masses})
        batch.set_state(start, np.zeros(4))
        errors = []
        for step in range(80):
            assert not batch.advance_partly(None, period / 80.0).numerics.any()
            if step % 10 == 9:
                errors.append(batch.q[:, 0] + 0.5 * math.pi - expected[step // 10])
        worst = np.abs(errors).max(axis=0)
        found[f"{name}, in eps"] = largest(worst, eps)
        found[f"{name}, after T"] = abs(float(errors[-1][0]))
        found[f"{name}, power of eps"] = largest(np.log10(worst[:2] / worst[1:]) / 3.0 - 1.0)
    assert_within(
        {
            "FourR, in eps": 330.0, "FourR, after T": 1.4e-4, "FourR, power of eps": 1e-4,
            "RPRP, in eps": 100.0, "RPRP, after T": 1e-4, "RPRP, power of eps": 1e-3,
            "printed period": 1.5e-9,
        },
        found,
    )  # fmt: skip


def test_upright_and_hanging_sliders_move_on_parabolas():
    """RPRP, theta_1 = theta_2 = +-pi/2 at rest: constant forces give r_1, r_2 constant accelerations.

    m_234 r_1'' + m_4 r_2'' = F_1 -+ m_234 g and m_4 (r_1'' + r_2'') = F_2 -+ m_4 g. Upright is unstable:
    the rounding of pi/2 grows there.
    """
    arm, seconds, force, sides = UNEQUAL["RPRP"], 0.4, np.array([5.0, -3.0]), np.array([[1.0], [-1.0]])
    m234, m4 = sum(arm.masses[1:]), arm.masses[3]
    faster = np.linalg.solve([[m234, m4], [m4, m4]], (force - sides * G * np.array([m234, m4])).T).T
    start = np.array([0.0, 0.2, 0.0, 0.1]) + 0.5 * np.pi * sides * [1.0, 0.0, 1.0, 0.0]
    q, qd = motion(exact(arm), start, np.zeros(4), seconds, [0.0, force[0], 0.0, force[1]])
    found = {
        "r": largest((q - start)[:, [1, 3]] - 0.5 * faster * seconds**2),
        "rate of r": largest(qd[:, [1, 3]] - faster * seconds),
        "theta": largest((q - start)[:, [0, 2]]),
    }
    assert_within({"r": 2e-15, "rate of r": 1e-14, "theta": 1e-15}, found)


# ---- mirrors -------------------------------------------------------------------------------------------


@EVERY
def test_mirrors_and_turns_are_symmetries(robot):
    """g = 0: theta -> -theta bitwise, theta + alpha and theta + 2 pi to rounding; g: theta -> pi - theta.

    The last rounds the start by 4e-16 rad, which grows to 1.5e-14 in a typical motion of 0.2 s and a little
    more in the worst of 100.
    """
    angles, rng = np.where(robot.prismatic, 0.0, 1.0), np.random.default_rng(7)
    sign = 1.0 - 2.0 * angles
    q = rng.uniform(-np.pi, np.pi, (100, 4)) * np.where(robot.prismatic, 0.25 / np.pi, 1.0)
    qd, efforts = rng.uniform(-1.0, 1.0, (100, 4)), rng.uniform(-2.0, 2.0, (100, 4))
    found = {"alpha": 0.0, "2 pi": 0.0}
    for scene in (rde.Scene(robot, (Gravity(0.0),), "rk4", control_dt=0.01), exact(robot, 0.0)):
        path = motion(scene, q, qd, 0.2, efforts)
        mirrored = motion(scene, sign * q, sign * qd, 0.2, sign * efforts)
        assert (np.array(mirrored) == sign * np.array(path)).all()
        for name, turn in (("alpha", 0.7 * angles), ("2 pi", 2.0 * np.pi * angles)):
            turned = motion(scene, q + turn, qd, 0.2, efforts)
            error = max(largest(turned[0] - turn - path[0]), largest(turned[1] - path[1]))
            found[name] = max(found[name], error)
    path = motion(exact(robot), q, qd, 0.2, efforts)
    mirrored = motion(exact(robot), np.pi * angles + sign * q, sign * qd, 0.2, sign * efforts)
    back = np.pi * angles + sign * mirrored[0], sign * mirrored[1]
    found["pi - theta"] = max(largest(x - y) for x, y in zip(back, path, strict=True))
    assert_within({"alpha": 2e-14, "2 pi": 3e-14, "pi - theta": 8e-14}, found)


# ---- bounces -------------------------------------------------------------------------------------------


def test_bounces_shrink_by_e_squared():
    """RPRP hanging, r_1 falls 0.3 m: heights h_n = e^(2n) h_0. Hard case 25 has the end of all bounces.

    m_4 is next to nothing and r_2 has no stop, so that r_1 falls freely.
    """
    drop, e = 0.3, 0.9
    stops = PrismaticStop((-1.0, None), (drop, None), e)
    made = rde.Scene(rde.RPRP((1.0, 1.0, 1.0, 1e-12), (0.5, 0.5)), (Gravity(G), stops), tolerance=1e-12)
    run = rde.simulate(made, [-0.5 * np.pi, 0.0, -0.5 * np.pi, 0.1], np.zeros(4), [4.8])
    *hits, rest = run.events
    assert ({x.kind for x in hits}, rest.kind) == ({"upper impact"}, "rest")
    speeds, times = np.array([x.speed for x in hits]), np.array([x.time for x in hits])
    n, fall = np.arange(len(hits)), np.sqrt(2.0 * drop / G)
    found = {
        "heights": largest(speeds**2 / (2.0 * G) - drop * e ** (2 * n), drop),
        "times": largest(times - fall * (1.0 + 2.0 * e * (1.0 - e**n) / (1.0 - e))),
        "early": fall * (1.0 + e) / (1.0 - e) - rest.time,
        "away": abs(run.q[-1, 1] - drop),
    }
    assert_within({"heights": 1e-14, "times": 2e-12, "early": 1e-3, "away": 0.0}, found)
