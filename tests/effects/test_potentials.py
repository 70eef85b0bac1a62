"""Potentials and their forces: slopes, pieces and signs, symbolically and on arrays; springs in a motion."""

import math

import numpy as np
import pytest
from sample_effects import Q0, QD0, ROBOTS, RPRP, SoftJoint, StiffeningSpring, all_effects

import redundant_envs as rde
from redundant_envs.algebra import arguments_of
from redundant_envs.effects import CentringSpring, LimitSpring, limit_spring
from redundant_envs.effects.hooks import Force
from redundant_envs.events.boundary import side_beyond
from redundant_envs.model.energy import potential_energy


def potential_hooks():
    for kind, robot in ROBOTS.items():
        for effect in (*all_effects(robot), StiffeningSpring(2.0), SoftJoint()):
            for hook in effect.hooks(robot):
                if isinstance(hook, Force) and hook.potential is not None:
                    name = f"{kind}-{effect.key}-joint{hook.joint + 1}"
                    yield pytest.param(effect, hook, id=name)


@pytest.mark.parametrize(("effect", "hook"), list(potential_hooks()))
def test_force_is_minus_the_slope_of_the_potential(effect, hook):
    """Symbolically, on every piece of the travel."""
    sp = pytest.importorskip("sympy", reason="sympy is in the extra 'verify'")
    import redundant_envs.backends.sympy  # noqa: F401 - lets expressions be numbers

    names = {*arguments_of(hook.potential), *arguments_of(hook.conservative)}
    values = {a: sp.Symbol(a, real=True) for a in names}
    x = values["position"]
    own = effect.parameters()
    if "side" in values:
        lower, upper = (sp.Rational(str(own[name[1:]])) for name in hook.switch)
        values["side"] = sp.Piecewise((1, x > upper), (-1, x < lower), (0, True))
    numbers = {
        values[a]: sp.Rational(str(own[hook.bind[a][1:]]))
        for a in values
        if hook.bind.get(a, "").startswith(".")
    }
    U, F = (f(*(values[a] for a in arguments_of(f))) for f in (hook.potential, hook.conservative))
    # 0.5 and 1.0 as exact fractions
    U, F = (e.xreplace({f: sp.Rational(f) for f in e.atoms(sp.Float)}) for e in (U, F))
    slope, F = sp.diff(U, x).subs(numbers), F.subs(numbers)
    tried = [F.subs(x, sp.Rational(k, 7)) for k in (-20, -5, -1, 1, 3, 30)]
    assert any(f != 0 for f in tried)
    for k in (-20, -5, -1, 0, 1, 3, 30):
        at = sp.Rational(k, 7)
        assert slope.subs(x, at) + F.subs(x, at) == 0
    # On each piece as functions: the Piecewise of clamp resolved by where x lies.
    for low, high in ((None, -10), (-sp.Rational(1, 1000), sp.Rational(1, 1000)), (10, None)):
        inside = sp.Symbol("inside", positive=True)
        at = high - inside if low is None else low + inside if high is None else sp.Rational(1, 2000)
        assert sp.simplify((slope + F).subs(x, at)) == 0


@pytest.mark.parametrize(("effect", "hook"), list(potential_hooks()))
def test_force_is_conservative_part_plus_dissipation(effect, hook):
    """The part of the force beyond its conservative part takes power out, at any rate."""
    own = effect.parameters()
    rng = np.random.default_rng(2)
    values = {"position": rng.uniform(-3.0, 3.0, 500), "rate": rng.uniform(-9.0, 9.0, 500)}
    if hook.switch is not None:
        values["side"] = side_beyond(values["position"], *(own[name[1:]] for name in hook.switch))

    def value(f):
        get = [
            own[hook.bind[a][1:]] if hook.bind.get(a, "").startswith(".") else values[a]
            for a in arguments_of(f)
        ]
        return f(*get)

    rest = value(hook.function) - value(hook.conservative)
    assert (rest * values["rate"] <= 1e-9).all()


def spring_force(position, rate, lower=-0.2, upper=0.3, stiffness=400.0, damping=7.0):
    side = side_beyond(position, lower, upper)
    return limit_spring.force(position, rate, lower, upper, stiffness, damping, side)


def test_limit_spring_is_one_sided_and_continuous():
    """Nothing inside; no step at the limit at any rate; always towards the inside."""
    rates = np.linspace(-200.0, 200.0, 81)
    inside = np.linspace(-0.2, 0.3, 41)[:, None]
    assert (spring_force(inside, rates) == 0.0).all()
    for limit, side in ((-0.2, -1.0), (0.3, 1.0)):
        for depth in (1e-12, 1e-9, 1e-3, 0.5):
            force = spring_force(limit + side * depth, rates)
            assert (side * force <= 0.0).all()
            assert (np.abs(force) <= 1.01 * (400.0 + 7.0 * 200.0) * depth).all()
    # resting: the spring alone; entering: more; leaving: less, then nothing, never a pull
    assert spring_force(0.4, 0.0) == pytest.approx(-40.0, rel=1e-14)
    assert spring_force(0.4, 10.0) == pytest.approx(-47.0, rel=1e-14)
    assert spring_force(0.4, -10.0) == pytest.approx(-33.0, rel=1e-14)
    assert spring_force(0.4, -1000.0) == 0.0
    assert spring_force(-0.3, -10.0) == pytest.approx(47.0, rel=1e-14)
    assert spring_force(-0.3, 10.0) == pytest.approx(33.0, rel=1e-14)
    assert spring_force(-0.3, 1000.0) == 0.0


def test_limit_spring_limits():
    """A slider pushed outwards turns round near its limit; with the limit far away it goes on."""
    batch = rde.BatchSimulator(rde.Scene(RPRP, (LimitSpring("r1", 0.0, 0.3, 20000.0),), control_dt=0.002), 2)
    batch.set_parameters({"limit_spring.r1.upper": 1e6}, index=[1])
    batch.set_state(Q0, np.zeros(4))
    furthest = np.full(2, -np.inf)
    for _ in range(500):
        batch.advance((0.0, 30.0, 0.0, 0.0))
        furthest = np.maximum(furthest, batch.q[:, 1])
    assert 0.3 < furthest[0] < 0.34
    assert furthest[1] > 1.0


def test_centring_spring_is_the_printed_one():
    """k (r - r_max) + k (r - r_min) on the left-hand side of the printed H2 and H4 (report 1.3)."""
    k, lower, upper = (20.0, 31.0), (0.05, -0.1), (0.3, 0.25)
    scene = rde.Scene(RPRP, (CentringSpring(k, lower, upper),), "euler", control_dt=1e-3)
    batch = rde.BatchSimulator(scene)
    batch.set_state(Q0, QD0)
    batch.advance()
    r = Q0[[1, 3]]
    printed = np.zeros(4)
    printed[[1, 3]] = [k[i] * (r[i] - upper[i]) + k[i] * (r[i] - lower[i]) for i in range(2)]
    qdd = RPRP.forward_dynamics(Q0, QD0, -printed, 0.0)
    assert np.abs((batch.qd[0] - QD0) / 1e-3 - qdd).max() <= 1e-11 * np.abs(qdd).max()
    # PE of report 1.1
    book = potential_energy(scene, Q0)
    terms = [0.5 * k[i] * (x[i] - r[i]) ** 2 for i in range(2) for x in (lower, upper)]
    assert book == pytest.approx(sum(terms), rel=1e-14)


def test_centring_spring_frequency():
    """About the middle of the travel with omega^2 = 2 k1 / (m2 + m3), the arm in line, no m4."""
    arm = rde.RPRP((2.0, 0.7, 1.9, 1e-9), (1.1, 0.6))
    scene = rde.Scene(arm, (CentringSpring((50.0, 0.0), (-0.1, -0.1), (0.3, 0.1)),), control_dt=0.002)
    times = np.linspace(0.05, 2.0, 40)
    r1 = rde.simulate(scene, (0.4, 0.15, 0.4, 0.0), np.zeros(4), times).q[:, 1]
    omega = math.sqrt(2.0 * 50.0 / (0.7 + 1.9))
    assert np.abs(r1 - (0.1 + 0.05 * np.cos(omega * times))).max() <= 1e-8
