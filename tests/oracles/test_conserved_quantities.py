"""Oracles O8 and O9: energy and angular momentum, and the book of what motors and friction do."""

import itertools

import numpy as np
from oracle_cases import ANGLES, EVERY, LAB, G, assert_within, exact, largest, motion, states

import redundant_envs as rde
from redundant_envs.effects import Gravity, ViscousFriction

WHIRLS = {
    "FourR": ((0.2, 1.0, -0.5, 2.0), (6.0, -4.0, 8.0, -10.0)),
    "RPRP": ((0.2, 0.1, -0.5, 0.2), (6.0, -0.5, 8.0, -1.0)),
}
"""Fast starts of the arms of equal links."""
AFTER_20_S = {
    "FourR": {
        "rk4, momentum after 20 s": 4.5e-7, "rk4, energy after 20 s": 2e-6,
        "rk8, momentum after 20 s": 2e-7, "rk8, energy after 20 s": 2e-6,
    },
    "RPRP": {
        "rk4, momentum after 20 s": 1.5e-10, "rk4, energy after 20 s": 6e-11,
        "rk8, momentum after 20 s": 4e-14, "rk8, energy after 20 s": 5e-14,
    },
}  # fmt: skip


@EVERY
def test_o08_energy_and_momentum_stay_without_gravity(robot):
    """g = 0: E and L are constant; under constant motor efforts dL/dt is that of the shoulder's motor.

    A second after random starts at the preset "exact"; then 20 s after a fast start by RK4 of 1 ms and RK8
    of 5 ms, relative. The RPRP arm flies apart then, and turns ever more slowly.
    """
    seconds, count = 1.0, 64
    q, qd = states(robot, count)
    momenta = np.einsum("nij,nj->ni", np.abs(robot.mass_matrix(q)), np.abs(qd))
    L0, E0 = robot.angular_momentum(q, qd), robot.kinetic_energy(q, qd)
    scale = (momenta * ANGLES[robot.kind]).sum(1)
    efforts = np.random.default_rng(3).uniform(-2.0, 2.0, (count, 4))
    batch = rde.BatchSimulator(exact(robot, 0.0), 2 * count)
    batch.set_state(np.vstack([q, q]), np.vstack([qd, qd]))
    work = np.vstack([np.zeros((count, 4)), efforts])
    for _ in range(round(seconds / 0.02)):
        assert not batch.advance(work).numerics.any()
    L = robot.angular_momentum(batch.q, batch.qd)
    E = robot.kinetic_energy(batch.q, batch.qd)
    found = {
        "energy": largest(E[:count] - E0, E0),
        "momentum": largest(L[:count] - L0, scale),
        "momentum under efforts": largest(L[count:] - L0 - efforts[:, 0] * seconds, scale),
    }
    arm = LAB[robot.kind]
    q, qd = WHIRLS[robot.kind]
    start = {"momentum": arm.angular_momentum(q, qd), "energy": arm.kinetic_energy(q, qd)}
    for method, substeps in (("rk4", 20), ("rk8", 4)):
        made = rde.Scene(arm, (Gravity(0.0),), method, control_dt=0.02, substeps=substeps)
        end = motion(made, q, qd, 20.0)
        now = {"momentum": arm.angular_momentum(*end)[0], "energy": arm.kinetic_energy(*end)[0]}
        found |= {f"{method}, {k} after 20 s": abs(now[k] / start[k] - 1.0) for k in now}
    bounds = {"energy": 5e-13, "momentum": 1.5e-13, "momentum under efforts": 6e-13}
    assert_within(bounds | AFTER_20_S[robot.kind], found)


@EVERY
def test_o09_the_energy_book_closes_to_the_order_of_the_method(robot):
    """E - W, with W the work of motors and friction as one more state, changes by the method's order.

    Orders are those of medians over random lanes; then the largest change at the preset "exact", J.
    """
    count, seconds = 256, 0.48
    q, qd = states(robot, count, speed=1.0)
    efforts = np.random.default_rng(3).uniform(-2.0, 2.0, (count, 4))
    effects = (Gravity(G), ViscousFriction((0.3, 0.1, 0.2, 0.05)))

    def gap(steps, **kwargs):
        made = rde.Scene(robot, effects, **kwargs)
        batch = rde.BatchSimulator(made, count, track_work=True)
        batch.set_state(q, qd)
        for _ in range(steps):
            assert not batch.advance_partly(efforts, seconds / steps).numerics.any()
        E = [
            robot.kinetic_energy(*x) + robot.potential_energy(x[0], G) for x in ((q, qd), (batch.q, batch.qd))
        ]
        assert (np.abs(batch.work) > 1e-3).any()
        return np.abs(E[1] - E[0] - batch.work)

    found = {}
    for integrator, steps, order in (("rk4", (96, 192, 384), 4), ("rk8", (12, 24), 8)):
        gaps = [np.median(gap(n, integrator=integrator)) for n in steps]
        orders = [np.log2(a / b) for a, b in itertools.pairwise(gaps)]
        found[f"{integrator} less than order {order}"] = max(order - x for x in orders)
    found["exact"] = float(gap(24, tolerance=1e-12).max())
    assert_within({"rk4 less than order 4": 0.1, "rk8 less than order 8": 0.1, "exact": 4e-11}, found)
