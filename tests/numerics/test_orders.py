"""Orders of steps and of their estimates, in 40 digits; verify measures those of compiled motions."""

import itertools

import pytest
from lanes_of_numbers import lane_of

import redundant_envs as rde
from redundant_envs.effects import Gravity, ViscousFriction
from redundant_envs.lane.common_step import lane_step
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.numerics.methods import explicit_step
from redundant_envs.numerics.tableaus import METHODS


@pytest.fixture
def mpmath():
    found = pytest.importorskip("mpmath", reason="mpmath is in the extra 'verify'")
    import exact_numbers  # noqa: F401

    return found


def test_rk8_has_order_8(mpmath):
    """Of motions of an arm with gravity and friction."""
    arm = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))
    dynamics = Dynamics(rde.Scene(arm, (Gravity(9.81), ViscousFriction((0.3, 0.1, 0.2, 0.05)))))
    with mpmath.workdps(40):

        def run(count):
            state, h = (-1.2, -0.9, -1.8, -0.4, 0.5, -0.3, 0.2, 0.4), mpmath.mpf("0.48") / count
            for _ in range(count):
                step = lane_step(dynamics, lane_of(dynamics, state, (1.5, -0.7, 0.4, 0.2), mpmath.mpf), h)
                state = [*step.positions, *step.velocities]
            return state

        exact = run(48)
        errors = {n: max(abs(a - b) for a, b in zip(run(n), exact, strict=True)) for n in (6, 8, 12)}
        for m, n in itertools.pairwise(errors):
            order = float(mpmath.log(errors[m] / errors[n]) / mpmath.log(mpmath.mpf(n) / m))
            assert 7.8 <= order <= 9.5


def on_a_circle(q, v, z):
    """y'' = -y, with y' a state of first order as well, and a watched number."""
    return -q[0], v[0], 7.0


def not_linear(q, v, z):
    """y'' = -y^3 - y'^2: on linear equations the estimate of order 6 falls faster."""
    return -(q[0] ** 3) - v[0] ** 2, v[0], 7.0


@pytest.mark.parametrize(
    ("method", "slope", "steps", "orders"),
    [
        ("rk4", on_a_circle, (4, 8), (4,)),
        ("rk8", on_a_circle, (4, 8), (8, None, 5, 3)),
        ("rk8", not_linear, (8, 16), (None, 6)),
    ],
)
def test_a_step_and_its_estimates_have_the_orders_that_they_are_for(mpmath, method, slope, steps, orders):
    """An estimate of order p is one of h^p in its sum. In 40 digits, but for the weights, which are those of
    double precision."""
    with mpmath.workdps(40):

        def defects(h):
            y, v = mpmath.mpf("0.8"), mpmath.mpf("0.6")
            step = explicit_step(METHODS[method], slope, [y], [v], [y], h)
            assert step.others[0] == step.positions[0]
            assert {*step.watched[0]} == {7.0}
            wrong = step.positions[0] - (y * mpmath.cos(h) + v * mpmath.sin(h))
            return [abs(wrong), *(abs(h * error[0]) for error, h in step.errors)]

        pairs = zip(*(defects(mpmath.mpf(1) / n) for n in steps), orders, strict=False)
        measured = {p: float(mpmath.log(a / b, 2)) for a, b, p in pairs if p}
    # A step of order p is off by h^(p + 1).
    assert measured == pytest.approx({p: p + 1 for p in orders if p}, abs=0.25)
