"""Measured orders of the methods, and the compiled step against the same text on floats."""

import itertools
import math

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs import algebra
from redundant_envs.effects import Gravity, LimitSpring, ViscousFriction
from redundant_envs.evaluators.assemble import assemble
from redundant_envs.integrators.tableaus import METHODS

FOUR_R = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))
RPRP = rde.RPRP((2.3, 0.7, 1.9, 0.4), (1.1, 0.6))
Q0, QD0 = (-1.2, -0.9, -1.8, -0.4), (0.5, -0.3, 0.2, 0.4)
EFFORTS = (1.5, -0.7, 0.4, 0.2)


def scene(method):
    """A smooth scene: gravity and friction."""
    return rde.Scene(FOUR_R, (Gravity(9.81), ViscousFriction((0.3, 0.1, 0.2, 0.05))), integrator=method)


def final(method, count, duration=0.5):
    """State after so many equal steps."""
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


def scalar_step(assembly, primitives):
    """The step of a lane with a meaning for the primitives, as a function of the names it reads."""
    names = dict(primitives)
    exec(assembly.scalar_text, names)
    code = names["step"].__code__
    return names["step"], code.co_varnames[: code.co_argcount]


def numbers_of(assembly):
    """Values of everything that is constant in a step."""
    values = dict(assembly.parameters)
    for call in assembly.prepared:
        results = call.function(*(values[a] for a in call.arguments))
        values.update(zip(call.names, results if len(call.names) > 1 else (results,), strict=True))
    return values


def test_rk8_has_order_8_in_mpmath():
    """The assembled text in 40-digit arithmetic, where round-off is out of the way."""
    mpmath = pytest.importorskip("mpmath", reason="mpmath is in the extra 'verify'")
    primitives = {
        "sqrt": mpmath.sqrt,
        "exp": mpmath.exp,
        "minimum": min,
        "maximum": max,
        "where": lambda condition, a, b: a if condition else b,
        "floor": mpmath.floor,
        "sincos": lambda x: (mpmath.sin(x), mpmath.cos(x)),
    }
    assembly = assemble(scene("rk8"))
    step, arguments = scalar_step(assembly, primitives)
    with mpmath.workdps(40):
        values = {k: mpmath.mpf(v) for k, v in numbers_of(assembly).items()}
        values.update({f"command{k + 1}": mpmath.mpf(e) for k, e in enumerate(EFFORTS)})

        def run(count):
            state = [mpmath.mpf(x) for x in (*Q0, *QD0)]
            values["h"] = values["interval"] = mpmath.mpf("0.48") / count
            for _ in range(count):
                values.update(zip(assembly.states, state, strict=True))
                state = step(*(values[a] for a in arguments))
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


@pytest.mark.parametrize("method", sorted(set(METHODS) - {"dop853"}))
@pytest.mark.parametrize("robot", [FOUR_R, RPRP], ids=["FourR", "RPRP"])
def test_compiled_step_is_the_scalar_text(method, robot):
    """The kernel's step is the text on plain floats to a few roundings."""
    joint = "r1" if robot.kind == "RPRP" else "joint2"
    effects = (
        Gravity(9.81),
        ViscousFriction((0.3, 0.1, 0.2, 0.05)),
        LimitSpring(joint, -0.1, 0.1, 300.0, 2.0),
    )
    made = rde.Scene(robot, effects, integrator=method, control_dt=0.004)
    assembly = assemble(made)
    primitives = {p: getattr(algebra, p) for p in algebra.PRIMITIVES}
    primitives["sincos"] = lambda x: (math.sin(x), math.cos(x))
    step, arguments = scalar_step(assembly, primitives)
    values = numbers_of(assembly)
    rng = np.random.default_rng(5)
    q, qd = rng.uniform(-3.0, 3.0, (20, 4)), rng.uniform(-4.0, 4.0, (20, 4))
    q[:, list(robot.prismatic)] /= 6.0
    efforts = rng.uniform(-5.0, 5.0, (20, 4))
    batch = rde.BatchSimulator(made, 20)
    batch.set_state(q, qd)
    batch.advance(efforts)
    compiled = np.concatenate([batch.q, batch.qd], axis=1)
    assert np.abs(compiled[:, 4:] - qd).max() > 0.01
    for i in range(20):
        values.update(zip(assembly.states, (*q[i].tolist(), *qd[i].tolist()), strict=True))
        values.update({f"command{k + 1}": float(efforts[i, k]) for k in range(4)})
        values.update(h=0.004, interval=0.004)
        plain = np.array(step(*(values[a] for a in arguments)))
        assert np.abs(compiled[i] - plain).max() <= 1e-14 * np.abs(plain).max()
