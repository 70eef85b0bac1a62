"""Oracles O1, O2, O3, O5 and O7: frequencies and motions that have closed forms."""

import math
from dataclasses import replace

import numpy as np
from oracle_cases import EVERY, LAB, G, assert_within, exact, largest, motion

import redundant_envs as rde
from redundant_envs.effects import PrismaticStop

TINY = 1e-12
"""Mass that represents an absent one: the least that a chain with a mass of 1 kg may have."""


def test_o01_hanging_arm_has_laguerre_frequencies():
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


@EVERY
def test_o02_straight_arm_turns_uniformly(robot):
    """g = 0, all links in line at one rate: theta = theta_0 + omega t; sliders held by constant forces.

    The forces are those that turn the masses beyond each slider on circles.
    """
    omega, seconds = 2.0, 10.0
    q0, qd0 = np.full(4, 0.3), np.full(4, omega)
    efforts = np.zeros(4)
    if robot.kind == "RPRP":
        q0[1], q0[3], qd0[1], qd0[3] = 0.2, 0.1, 0.0, 0.0
        m, l = robot.masses, robot.lengths
        r2, r3, r4 = l[0] + q0[1], l[0] + q0[1] + l[1], l[0] + q0[1] + l[1] + q0[3]
        efforts[1] = -(omega**2) * (m[1] * r2 + m[2] * r3 + m[3] * r4)
        efforts[3] = -(omega**2) * m[3] * r4
    q, qd = motion(exact(robot, 0.0), q0, qd0, seconds, efforts)
    assert_within(
        {"q": 1e-12, "qd": 1e-15},
        {"q": largest(q - (q0 + qd0 * seconds)), "qd": largest(qd - qd0)},
    )


def test_o03_light_links_leave_a_pendulum():
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


def test_o05_a_free_mass_passes_the_base_on_a_straight_line():
    """RPRP, g = 0, m_2 alone has mass: rho^2 = (x_0 + v t)^2 + b^2, theta_1 = atan2, however near it passes.

    The link length is 1 mm, so that m_1 has a moment of inertia of 1e-18 kg m^2 only.
    """
    arm, seconds = rde.RPRP((TINY, 1.0, TINY, TINY), (1e-3, 0.5)), 2.0
    b = np.array([0.1, 0.01, 0.001])
    x = np.full(3, -1.0)
    theta, rho = np.arctan2(b, x), np.hypot(x, b)
    q0 = np.column_stack([theta, rho - 1e-3, np.zeros(3), np.full(3, 0.1)])
    qd0 = np.column_stack([-np.sin(theta) / rho, np.cos(theta), np.zeros(3), np.zeros(3)])
    q, _ = motion(exact(arm, 0.0), q0, qd0, seconds)
    place = (q[:, 1] + 1e-3) * np.array([np.cos(q[:, 0]), np.sin(q[:, 0])])
    error = np.hypot(*(place - [x + seconds, b]))
    found = {f"b = {n} m": float(e) for n, e in zip(b, error, strict=True)}
    assert_within(dict.fromkeys(found, 4e-12), found)


def test_o07_a_mass_on_a_turning_rod_leaves_by_cosh():
    """RPRP, g = 0, theta_1 at constant omega: rho = rho_0 cosh(omega t) + (v_0/omega) sinh(omega t).

    A heavy m_1 = 1/eps keeps omega, m_3 = m_4 = eps weigh nothing. The rest is linear in eps, and what
    remains beside the linear part is judged.
    """
    omega, seconds, l1 = 2.0, 0.7, 0.5
    eps = np.array([2e-6, 1e-6])
    masses = np.column_stack([1.0 / eps, np.ones(2), eps, eps])
    rho0, v0 = 0.7, 0.3
    q, qd = motion(
        exact(LAB["RPRP"], 0.0), [[0.3, rho0 - l1, 0.0, 0.1]] * 2, [omega, v0, 0.0, 0.0], seconds,
        parameters={"masses": masses},
    )  # fmt: skip
    grown = rho0 * math.cosh(omega * seconds) + v0 / omega * math.sinh(omega * seconds)
    speed = rho0 * omega * math.sinh(omega * seconds) + v0 * math.cosh(omega * seconds)
    rho = l1 + q[:, 1]
    found = {
        "rho": largest(rho[1] - grown),
        "rho without the linear part": largest(2.0 * rho[1] - rho[0] - grown),
        "rate without the linear part": largest(2.0 * qd[1, 1] - qd[0, 1] - speed),
    }
    bounds = {"rho": 1e-5, "rho without the linear part": 3e-10, "rate without the linear part": 3e-9}
    assert_within(bounds, found)
