"""Measured orders of the methods, and the compiled step against the same functions on plain floats."""

import itertools
import math

import numpy as np
import pytest
from lanes_of_numbers import lane_of

import redundant_envs as rde
from redundant_envs.effects import Gravity, LimitSpring, ViscousFriction
from redundant_envs.lane.common_step import lane_step, step_error
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.numerics.methods import explicit_step
from redundant_envs.numerics.tableaus import METHODS

FOUR_R = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))
RPRP = rde.RPRP((2.3, 0.7, 1.9, 0.4), (1.1, 0.6))
Q0, QD0 = (-1.2, -0.9, -1.8, -0.4), (0.5, -0.3, 0.2, 0.4)
EFFORTS = (1.5, -0.7, 0.4, 0.2)


def scene(method):
    """A smooth scene: gravity and friction."""
    return rde.Scene(FOUR_R, (Gravity(9.81), ViscousFriction((0.3, 0.1, 0.2, 0.05))), integrator=method)


def final(method, count, duration=0.5):
    """State after a number of equal steps."""
    batch = rde.BatchSimulator(scene(method))
    batch.set_state(Q0, QD0)
    for _ in range(count):
        batch.advance_partly(EFFORTS, duration / count)
    return np.concatenate([batch.q[0], batch.qd[0]])


def slopes(errors, ratio=2.0):
    """Measured orders of successive errors."""
    return [math.log(a / b, ratio) for a, b in itertools.pairwise(errors)]


@pytest.fixture(scope="module")
def exact():
    """The state that rk8 reaches in many steps."""
    reference = final("rk8", 200)
    assert np.abs(final("rk8", 100) - reference).max() <= 1e-12
    return reference


@pytest.mark.parametrize(
    ("method", "counts", "tolerance"), [("euler", (1000, 2000, 4000), 0.02), ("rk4", (20, 40, 80), 0.15)]
)
def test_order_in_float64(exact, method, counts, tolerance):
    """Halving the step divides the error by 2^order."""
    errors = [np.abs(final(method, n) - exact).max() for n in counts]
    assert slopes(errors) == pytest.approx([METHODS[method].order] * 2, abs=tolerance)


def test_rk8_has_order_8_in_mpmath():
    """The step in 40-digit arithmetic, where round-off is out of the way."""
    mpmath = pytest.importorskip("mpmath", reason="mpmath is in the extra 'verify'")
    import exact_numbers  # noqa: F401

    dynamics = Dynamics(scene("rk8"))
    with mpmath.workdps(40):

        def run(count):
            state, h = (*Q0, *QD0), mpmath.mpf("0.48") / count
            for _ in range(count):
                step = lane_step(dynamics, lane_of(dynamics, state, EFFORTS, mpmath.mpf), h)
                state = [*step.positions, *step.velocities]
            return state

        exact = run(48)
        counts = (6, 8, 12)
        errors = [max(abs(a - b) for a, b in zip(run(n), exact, strict=True)) for n in counts]
        measured = [
            float(mpmath.log(a / b) / mpmath.log(mpmath.mpf(n) / m))
            for a, b, m, n in zip(errors, errors[1:], counts, counts[1:], strict=False)
        ]
    assert min(measured) >= 7.8
    assert max(measured) <= 9.5


@pytest.mark.parametrize(("method", "orders"), [("rk4", (4,)), ("rk8", (8, 5, 3))])
def test_a_step_and_its_estimates_have_the_orders_that_they_are_for(method, orders):
    """On y'' = -y, with y' a state of first order as well; an estimate of order p is one of h^p in its sum.

    The estimate of order 6 has its own test. In 40 digits, but for the weights, which are those of double
    precision.
    """
    mpmath = pytest.importorskip("mpmath", reason="mpmath is in the extra 'verify'")
    import exact_numbers  # noqa: F401

    with mpmath.workdps(40):

        def defects(h):
            y, v = mpmath.mpf("0.8"), mpmath.mpf("0.6")
            step = explicit_step(METHODS[method], lambda q, v, z: (-q[0], v[0], 7.0), [y], [v], [y], h)
            assert step.others[0] == step.positions[0]
            assert {*step.watched[0]} == {7.0}
            wrong = abs(step.positions[0] - (y * mpmath.cos(h) + v * mpmath.sin(h)))
            found = [wrong]
            if METHODS[method].error5:
                found += [abs(step.h5 * step.error5[0]), abs(step.h3 * step.error3[0])]
            return found

        steps = [mpmath.mpf(1) / 4, mpmath.mpf(1) / 8]
        pairs = zip(*(defects(h) for h in steps), strict=True)
        measured = [float(mpmath.log(a / b, 2)) for a, b in pairs]
    # A step of order p is off by h^(p + 1).
    assert measured == pytest.approx([p + 1 for p in orders], abs=0.25)


def test_the_estimate_of_order_6_falls_with_the_seventh_power_of_the_step():
    """On y'' = -y^3 - y'^2, as in the test above; on linear equations it falls faster."""
    mpmath = pytest.importorskip("mpmath", reason="mpmath is in the extra 'verify'")
    import exact_numbers  # noqa: F401

    with mpmath.workdps(40):
        found = []
        for h in (mpmath.mpf(1) / 8, mpmath.mpf(1) / 16):
            y, v = mpmath.mpf("0.8"), mpmath.mpf("0.6")
            step = explicit_step(
                METHODS["rk8"], lambda q, v, z: (-(q[0] ** 3) - v[0] ** 2, v[0]), [y], [v], [y], h
            )
            assert step.error6[2] == step.error6[0]
            found.append(abs(step.h6 * step.error6[0]))
        assert float(mpmath.log(found[0] / found[1], 2)) == pytest.approx(7.0, abs=0.25)


@pytest.mark.parametrize("method", sorted(set(METHODS) - {"dop853"}))
@pytest.mark.parametrize("robot", [FOUR_R, RPRP], ids=["FourR", "RPRP"])
def test_compiled_step_is_the_step_on_plain_floats(method, robot):
    """The kernel's step is that of the same functions on floats to a few roundings, in a step whose
    estimates are far above rounding."""
    joint = "r1" if robot.kind == "RPRP" else "joint2"
    effects = (
        Gravity(9.81),
        ViscousFriction((0.3, 0.1, 0.2, 0.05)),
        LimitSpring(joint, -0.1, 0.1, 300.0, 2.0),
    )
    made = rde.Scene(robot, effects, integrator=method, control_dt=0.01)
    dynamics = Dynamics(made)
    rng = np.random.default_rng(5)
    q, qd = rng.uniform(-3.0, 3.0, (20, 4)), rng.uniform(-4.0, 4.0, (20, 4))
    q[:, list(robot.prismatic)] /= 6.0
    efforts = rng.uniform(-5.0, 5.0, (20, 4))
    batch = rde.BatchSimulator(made, 20)
    batch.set_state(q, qd)
    status = batch.advance(efforts)
    compiled = np.concatenate([batch.q, batch.qd], axis=1)
    assert np.abs(compiled[:, 4:] - qd).max() > 0.01
    for i in range(20):
        lane = lane_of(dynamics, (*q[i], *qd[i]), efforts[i], float)
        step = lane_step(dynamics, lane, 0.01)
        plain = np.array([*step.positions, *step.velocities])
        assert np.abs(compiled[i] - plain).max() <= 1e-14 * np.abs(plain).max()
        if METHODS[method].error5:
            lane.interval = 0.01
            error = step_error(dynamics, lane, step)
            assert status.error_estimate[i] == pytest.approx(error, rel=1e-4, abs=1e-20)
