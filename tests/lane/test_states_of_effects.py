"""States of effects: in closed form, and evaluated apart from the arm; the orders of convergence."""

import dataclasses

import mpmath
import numpy as np
import pytest
from catalogue import FOUR_R, advanced

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects import Effect, Force, State, lu_gre
from redundant_envs.effects.hooks import at_each_joint
from redundant_envs.language.algebra import exp, physics
from redundant_envs.simulator.lane.closed_forms import share

approach = physics(lambda value, aim, rate: rate * (aim - value))
approached = physics(lambda value, aim, rate, elapsed: aim + (value - aim) * exp(-(rate * elapsed)))
itself = physics(lambda rate: rate)
drag = physics(lambda value, coefficient: -coefficient * value)


@dataclasses.dataclass(frozen=True)
class LaggingDrag(Effect):
    """A drag on every joint in proportion to a rate that lags behind the joint's own."""

    rate: float
    coefficient: float = 0.3
    declared: bool = True
    closed: bool = True

    static = ("declared", "closed")

    @at_each_joint
    def hooks(self, k, arm):
        bind = {"value": f".value[{k}]", "aim": f"phid{k + 1}", "rate": ".rate"}
        state = State(
            f"value[{k}]", "rad/s", derivative=approach, bind=bind, rate=itself if self.declared else None,
            closed=approached if self.closed else None,
        )  # fmt: skip
        own = {"value": f".value[{k}]", "coefficient": ".coefficient"}
        return Force(k, drag, own, states=(state,))


START = [0.3, 0.5, -0.2, 0.4], [2.0, -1.0, 1.5, 0.5]


def after(effect, method, substeps=8):
    """A simulator after 0.2 s; the states of a lag begin at the rates of the joints."""
    batch = rde.BatchSimulator(rde.Scene(FOUR_R, (effect,), method, 0.2, substeps), 1)
    batch.set_state(*START)
    if names := tuple(batch.simulator.dynamics.effect_states):
        batch._memory.write(names, np.array([START[1]]) @ FOUR_R.motor_map)
    batch.advance()
    return batch


def off(one, other):
    return np.abs(one.qd - other.qd).max()


@pytest.mark.quick("without a rate")
@pytest.mark.parametrize(
    ("method", "declared", "order"),
    [("euler", True, 1.0), ("rk4", True, 2.0), ("rk8", True, 2.0), ("rk8", False, 1.0)],
    ids=["euler", "rk4", "rk8", "without a rate"],
)
def test_steps_shorter_than_the_time_constant_converge(method, declared, order):
    """With the second order at most; without a rate quantities are those of the stage."""
    effect = LaggingDrag(20.0, declared=declared)
    exact = after(effect, "dop853", 1)
    wrong = [off(after(effect, method, steps), exact) for steps in (32, 64)]
    assert np.log2(wrong[0] / wrong[1]) == pytest.approx(order, abs=0.2)


@pytest.mark.long
def test_steps_of_a_thousand_time_constants_are_as_exact_as_the_state_is_fast():
    """A state that follows its joint at once leaves a drag, which rk8 integrates."""
    at_once = after(rde.effects.ViscousFriction(0.3), "rk8")
    for rate in (1e5, 1e6, 1e8):
        stiff = after(LaggingDrag(rate), "rk8")
        assert off(stiff, at_once) < 200.0 / rate
        assert np.isfinite(stiff.z).all()
    assert not np.isfinite(after(LaggingDrag(1e6, closed=False), "rk8").qd).all()


def test_a_state_lags_by_its_time_constant_behind_a_quantity_that_changes():
    """Taken at the stages, the quantity would not be followed with a lag at all."""
    exact = after(LaggingDrag(1e4), "dop853", 1)
    assert off(after(LaggingDrag(1e4), "rk8"), exact) < 3e-5
    assert off(after(LaggingDrag(1e4, declared=False), "rk8"), exact) > 2e-4


@pytest.mark.parametrize("dt", [1e-9, 1e-6, 1e-3, 1.0])
def test_closed_forms_keep_their_digits_in_short_steps(dt):
    """Nearly all of a state is still to come after a nanosecond; with exp(-x) - 1 in place of expm1(-x) the
    last digits of what has come would be lost, seven of them after a microsecond."""
    heavy = rde.Chain("R", (1e15,), (1.0,))
    motor = rde.effects.DCMotor(resistance=2.0, inductance=0.05, constant=0.1, gear=1.0)
    for effect, steady, rate in ((rde.effects.Lag(0.03), 3.0, 1.0 / 0.03), (motor, 1.5, 40.0)):
        scene = rde.Scene(heavy, (effect,), "rk8", dt)
        batch, _ = advanced(scene, [0.0], [0.0], [[3.0]])
        np.testing.assert_allclose(batch.z, -steady * np.expm1(-rate * dt), rtol=1e-15)


def test_bristles_keep_their_digits_in_short_steps():
    rng = np.random.default_rng(0)
    rate, z, stiffness, low, vs, t = 10.0 ** rng.uniform(-9.0, 2.0, (6, 400))
    rate, z, high = rate * rng.choice([-1.0, 1.0], 400), z * 1e-9 * rng.choice([-1.0, 1.0], 400), low * 1.5
    found = lu_gre.bent(rate, z, stiffness, low, high, vs, t)
    for k in range(400):
        v, z0, s, f, g, w, dt = map(mpmath.mpf, (rate[k], z[k], stiffness[k], low[k], high[k], vs[k], t[k]))
        slid = mpmath.sign(v) * (f + (g - f) * mpmath.exp(-((v / w) ** 2))) / s
        gone = -mpmath.expm1(-abs(v / slid) * dt)
        assert found[k] - z[k] == pytest.approx(float((slid - z0) * gone), rel=1e-12, abs=4e-16 * abs(z[k]))


def test_the_time_at_which_a_changing_quantity_is_taken_is_between_a_half_and_one():
    decays = np.concatenate([10.0 ** np.linspace(-300.0, 300.0, 6001), [0.0]])
    shares = share(decays)
    assert ((shares >= 0.5) & (shares <= 1.0)).all()
    with mpmath.workdps(40):
        exact = [1 / -mpmath.expm1(-mpmath.mpf(x)) - 1 / mpmath.mpf(x) for x in decays[2900:3200]]
    np.testing.assert_allclose(shares[2900:3200], np.array(exact, float), rtol=0.0, atol=1.5e-12)


def test_a_clock_is_as_exact_as_one_sum():
    """Equal slopes are added as one: an interval adds its length to rounding."""
    scene = rde.Scene(FOUR_R, (e.MovingBase((0.0, 0.0), 1.0),), "rk8", 0.02)
    batch, _ = advanced(scene, *START, intervals=500)
    assert batch.z.item() == pytest.approx(np.cumsum(np.full(500, 0.02))[-1], abs=1e-13)
