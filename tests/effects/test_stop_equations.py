"""The equations of sliders at stops: held, struck, against dense systems."""

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs import algebra
from redundant_envs.evaluators.binding import bind
from redundant_envs.evaluators.quantities import calls
from redundant_envs.integrators import contacts

UNEQUAL = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))


@pytest.mark.parametrize("held", [(0, 0), (1, 0), (0, 1), (1, 1)])
def test_held_dynamics_is_the_constrained_system(held):
    """M qdd + h + G = Q + hold, with qdd = 0 of the held sliders: solved as a dense system."""
    rng = np.random.default_rng(0)
    arm = UNEQUAL
    order = calls(
        ["qdd1", "hold2"],
        {
            *arm.coordinates,
            *arm.rates,
            *arm.parameter_values(),
            "ax",
            "ay",
            "Q1",
            "Q2",
            "Q3",
            "Q4",
            "held2",
            "held4",
        },
        (*(f for f in arm.functions if f.__name__ != "forward_dynamics"), arm.held_dynamics),
        arm.sincos,
    )
    from redundant_envs.evaluators import arrays
    from redundant_envs.evaluators.binding import run

    for _ in range(50):
        q, qd, Q = rng.uniform(-3, 3, 4), rng.uniform(-4, 4, 4), rng.uniform(-20, 20, 4)
        qd[[1, 3]] *= 1 - np.array(held)
        values = {**arm.parameter_values(), "ax": 0.0, "ay": 9.81, "held2": held[0], "held4": held[1]}
        values |= dict(zip((*arm.coordinates, *arm.rates), (*q, *qd), strict=True))
        values |= {f"Q{k + 1}": Q[k] for k in range(4)}
        run(order, values, arrays.PRIMITIVES)
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
        got = [values[f"qdd{k}"] for k in range(1, 5)]
        np.testing.assert_allclose(got, expected[:4], rtol=0, atol=1e-12 * np.abs(expected).max())
        for k, name in enumerate(("hold2", "hold4")):
            if held[k]:
                assert values[name] == pytest.approx(expected[4 + k], abs=1e-12 * np.abs(expected).max())


def test_slider_mobility_is_two_columns_of_the_inverse():
    from redundant_envs.evaluators import arrays
    from redundant_envs.evaluators.binding import run

    arm = UNEQUAL
    q = np.random.default_rng(1).uniform(-3, 3, (50, 4))
    names = [f"W{i}{k}" for k in (2, 4) for i in range(1, 5)]
    values = {**arm.parameter_values(), **{c: q[:, k] for k, c in enumerate(arm.coordinates)}}
    run(calls(names, values, (*arm.functions, arm.slider_mobility), arm.sincos), values, arrays.PRIMITIVES)
    inverse = np.linalg.inv(arm.mass_matrix(q))
    got = np.stack([values[n] for n in names], axis=1).reshape(-1, 2, 4)
    expected = np.stack([inverse[:, :, 1], inverse[:, :, 3]], axis=1)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_impulses_solve_the_complementarity_problem():
    """p >= 0, residual >= 0, p residual = 0, and the answer does not know which slider comes first."""
    impulses = bind(contacts.impulses, {p: getattr(algebra, p) for p in algebra.PRIMITIVES})
    rng = np.random.default_rng(2)
    both = 0
    for _ in range(2000):
        A = rng.normal(size=(2, 2))
        W = A @ A.T + 0.01 * np.eye(2)
        u, restitution = rng.normal(size=2), rng.uniform(0, 1)
        if (u <= 0).all():
            continue
        sa, sb = rng.choice([-1.0, 1.0], 2)
        wab = sa * sb * W[0, 1]  # W is of outward speeds
        p = np.array(impulses(u[0], u[1], sa, sb, W[0, 0], wab, W[1, 1], restitution))
        residual = W @ p - (u + restitution * np.maximum(u, 0.0))
        assert (p >= -1e-12).all()
        assert (residual >= -1e-9).all()
        assert abs(p @ residual) < 1e-9
        swapped = impulses(u[1], u[0], sb, sa, W[1, 1], wab, W[0, 0], restitution)
        np.testing.assert_allclose(p, swapped[::-1], rtol=1e-9, atol=1e-12)
        both += (p > 0).all()
    assert both > 100


def struck_by_turns(u, W, restitution, most=100_000):
    """Outward speeds after impacts of one slider at a time, at stops without any gap; None if they go on."""
    u = u.copy()
    for _ in range(most):
        if (u <= 1e-13).all():
            return u
        k = int(np.argmax(u))
        u -= W[:, k] * (1.0 + restitution) * u[k] / W[k, k]
    return None


@pytest.mark.parametrize("restitution", [0.0, 0.02, 0.1, 0.3, 0.9, 1.0])
def test_sliders_that_strike_by_turns_end_where_single_impacts_end(restitution):
    """One moves onto its stop, the other away from its own: never struck together, but by turns; a chain that
    never ends stops both."""
    touch = bind(contacts.touch, {p: getattr(algebra, p) for p in algebra.PRIMITIVES})
    names = algebra.gives_of(contacts.touch)
    rng = np.random.default_rng(5)
    chains = ended = 0
    for _ in range(400):
        angle = rng.uniform(0.05, np.pi - 0.05)
        scale = 10.0 ** rng.uniform(-2.0, 2.0, 2)
        W = np.outer(scale, scale) * [[1.0, np.cos(angle)], [np.cos(angle), 1.0]]
        sides = rng.choice([-1.0, 1.0], 2)
        u = scale * rng.permutation([1.0, -(10.0 ** rng.uniform(-3.0, 0.5))])
        expected = struck_by_turns(u, W, restitution)
        rates = sides * u
        for _ in range(300):
            mobility = W[0, 0], sides[0] * sides[1] * W[0, 1], W[1, 1]
            ends = [v for s in sides for v in ((0.0, 0.3) if s > 0 else (0.3, 0.5))]
            got = dict(
                zip(
                    names,
                    touch(
                        1.0, 0.0, 0.0, 0.3, 0.3, *rates, 0.0, 0.0, ends[0], ends[2], ends[1], ends[3],
                        restitution, 0.0, 0.0, -sides[0], -sides[1], 0.0, 0.0, *mobility,
                    ),
                    strict=True,
                )
            )  # fmt: skip
            if not got["strikes"]:
                break
            rates = np.array([got["struck_a"], got["struck_b"]])
            chains += 1
        u_end = sides * rates
        assert (u_end <= 1e-13 * max(1.0, scale.max())).all()
        if expected is None:  # slower than any count: it tends to rest at both stops
            continue
        ended += 1
        np.testing.assert_allclose(u_end / scale, expected / scale, atol=1e-9)
    assert chains >= 400
    assert ended > 300
