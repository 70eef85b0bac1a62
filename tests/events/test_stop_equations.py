"""The equations of sliders at stops: held, struck, pressed, against dense systems and tried sets."""

import numpy as np
import pytest
from contact_problems import SLIDERS, complementary, contact, mobility, resolved

import redundant_envs as rde
from redundant_envs.events import complementarity
from redundant_envs.lane.dynamics import Dynamics

UNEQUAL = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))
STOPPED = Dynamics(rde.Scene(UNEQUAL, (rde.effects.PrismaticStop((0.0, 0.0), (0.3, 0.3)),)))


@pytest.mark.parametrize("held", [(0, 0), (1, 0), (0, 1), (1, 1)])
def test_held_dynamics_is_the_constrained_system(held):
    """M qdd + h + G = Q + hold, with qdd = 0 of the held sliders: solved as a dense system."""
    rng = np.random.default_rng(0)
    arm = UNEQUAL
    for _ in range(50):
        q, qd, Q = rng.uniform(-3, 3, 4), rng.uniform(-4, 4, 4), rng.uniform(-20, 20, 4)
        qd[[1, 3]] *= 1 - np.array(held)
        known = {**arm.parameter_values(), "ax": 0.0, "ay": 9.81, "held2": held[0], "held4": held[1]}
        known |= {f"Q{k + 1}": Q[k] for k in range(4)}
        x = STOPPED.quantities([*q, *qd], known, held=True)
        free = arm.bias_forces(q, qd) + arm.gravity_forces(q) - Q
        system = np.zeros((6, 6))
        system[:4, :4] = arm.mass_matrix(q)
        right = np.zeros(6)
        right[:4] = -free
        for k, joint in enumerate((1, 3)):
            if held[k]:
                system[4 + k, joint] = 1.0
                system[joint, 4 + k] = -1.0
            else:
                system[4 + k, 4 + k] = 1.0
        expected = np.linalg.solve(system, right)
        got = x.each(f"qdd{k}" for k in range(1, 5))
        np.testing.assert_allclose(got, expected[:4], rtol=0, atol=1e-12 * np.abs(expected).max())
        for k, name in enumerate(("hold2", "hold4")):
            if held[k]:
                assert x[name] == pytest.approx(expected[4 + k], abs=1e-12 * np.abs(expected).max())


def test_slider_mobility_is_two_columns_of_the_inverse():
    arm = UNEQUAL
    q = np.random.default_rng(1).uniform(-3, 3, (50, 4))
    x = STOPPED.quantities(q.T, arm.parameter_values(), held=True)
    names = [f"W{i}{k}" for k in (2, 4) for i in range(1, 5)]
    inverse = np.linalg.inv(arm.mass_matrix(q))
    got = np.stack(x.each(names), axis=1).reshape(-1, 2, 4)
    expected = np.stack([inverse[:, :, 1], inverse[:, :, 3]], axis=1)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


# ---- impulses ------------------------------------------------------------------------------------


@SLIDERS
def test_impulses_solve_the_complementarity_problem(count):
    """No stop pulls, no slider moves into one, and only those that act matter; away from stops there is no
    impulse."""
    rng = np.random.default_rng(2)
    struck = set()
    for _ in range(2000):
        w = mobility(rng, count)
        sides = rng.choice([-1.0, 0.0, 1.0], count)
        u, restitution = np.abs(sides) * rng.normal(size=count), rng.uniform(0, 1)
        if not (u > 0).any():
            continue  # nothing strikes: the result is not used
        at = np.flatnonzero(sides)
        outward = np.outer(sides, sides) * w
        d = u + restitution * np.maximum(u, 0.0)
        expected = np.zeros(count)
        expected[at] = complementary(outward[np.ix_(at, at)], d[at])
        p = complementarity.impulses(u.tolist(), sides.tolist(), w.tolist(), [restitution] * count)
        np.testing.assert_allclose(p, expected, rtol=1e-9, atol=1e-12)
        struck.add(tuple(expected > 0.0))
    assert len(struck) == 2**count - 1


@SLIDERS
def test_impulses_do_not_know_the_order_of_the_sliders(count):
    rng = np.random.default_rng(12)
    for _ in range(300):
        w, order = mobility(rng, count), rng.permutation(count)
        sides, u = rng.choice([-1.0, 1.0], count), rng.normal(size=count)
        if not (u > 0).any():
            continue
        p = complementarity.impulses(u.tolist(), sides.tolist(), w.tolist(), [0.5] * count)
        others = w[np.ix_(order, order)].tolist()
        again = complementarity.impulses(u[order].tolist(), sides[order].tolist(), others, [0.5] * count)
        np.testing.assert_allclose(np.array(p)[order], again, rtol=1e-9, atol=1e-12)


@SLIDERS
def test_halting_stops_those_that_must_stand_still_and_pushes_no_other(count):
    rng = np.random.default_rng(3)
    for _ in range(500):
        w, v = mobility(rng, count), rng.normal(size=count)
        still = rng.random(count) < 0.5
        push = np.array(complementarity.halting(v.tolist(), still.tolist(), w))
        assert (push[~still] == 0.0).all()
        scale = np.abs(w).max() * np.abs(push).max(initial=1.0)
        np.testing.assert_allclose((v + w @ push)[still], 0.0, atol=1e-12 * scale)


@SLIDERS
def test_pressed_is_the_one_set_in_which_no_stop_pulls_and_none_is_entered(count):
    rng = np.random.default_rng(4)
    seen = set()
    for _ in range(2000):
        w, free = mobility(rng, count), rng.normal(size=count)
        expected = complementary(w, free) > 0.0
        assert complementarity.pressed(free.tolist(), w) == expected.tolist()
        seen.add(tuple(expected))
    assert len(seen) == 2**count


@SLIDERS
def test_the_equations_on_arrays_are_those_on_numbers(count):
    rng = np.random.default_rng(5)
    many = [mobility(rng, count) for _ in range(64)]
    w = np.moveaxis(many, 0, -1)
    v, sides = rng.normal(size=(count, 64)), rng.choice([-1.0, 1.0], (count, 64))
    v[0] = np.abs(v[0])
    still = rng.random((count, 64)) < 0.5

    def table(columns):
        return np.array(np.broadcast_arrays(*columns, np.zeros(64))[:-1], dtype=float)

    got = (
        complementarity.impulses(v, sides, list(w), [0.3] * count),
        complementarity.halting(v, still, w),
        complementarity.pressed(v, w),
    )
    for k in range(64):
        one = (
            complementarity.impulses(v[:, k].tolist(), sides[:, k].tolist(), many[k].tolist(), [0.3] * count),
            complementarity.halting(v[:, k].tolist(), still[:, k].tolist(), many[k]),
            complementarity.pressed(v[:, k].tolist(), many[k]),
        )
        for columns, numbers in zip(got, one, strict=True):
            np.testing.assert_allclose(table(columns)[:, k], np.array(numbers, dtype=float), rtol=1e-12)


def test_the_energy_of_an_impact_to_rounding():
    """(1 - e^2) v_j^2 / (2 W_jj), on the equation itself, without any motion."""
    rng = np.random.default_rng(4)
    for _ in range(1000):
        q, qd, restitution = rng.uniform(-3, 3, 4), rng.normal(0, 2, 4), rng.uniform(0, 1)
        qd[1] = abs(qd[1]) + 0.01
        M = UNEQUAL.mass_matrix(q)
        W = np.linalg.inv(M)
        pair = [contact(qd[1], 1.0), contact(qd[3], away=True)]
        got = resolved(pair, W[np.ix_((1, 3), (1, 3))], restitution)
        after = qd + W[:, [1, 3]] @ got.impulses
        assert got.velocities[0] == pytest.approx(after[1], abs=1e-12 * np.abs(qd).max())
        before = 0.5 * qd @ M @ qd
        lost = (1.0 - restitution**2) * qd[1] ** 2 / (2.0 * W[1, 1])
        assert abs(before - 0.5 * after @ M @ after - lost) <= 1e-12 * before
