"""States that change by themselves: steps evaluate them apart from the arm, with the same result."""

import dataclasses

import numpy as np
import pytest
from catalogue import ARMS, FOUR_R, advanced

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.language.algebra import exp, physics
from redundant_envs.simulator.lane.dynamics import Dynamics

PACE = 40.0
START = np.array([[0.3, 0.5, -0.2, 0.4]]), np.array([[2.0, -1.0, 1.5, 0.5]])


@physics
def forwards(c, pace):
    return pace * c


@physics
def back(s, pace):
    return -pace * s


@physics
def with_rate(s, pace, rate):
    """The same as long as the rate is finite, but it waits for the arm."""
    return -pace * s + 0.0 * rate


@physics
def push(s, strength):
    return strength * s


@physics
def shake(s, strength):
    return strength * s, -strength * s


@dataclasses.dataclass(frozen=True)
class Oscillator(e.Effect):
    """A sine and a cosine that push the last joint, or shake the base."""

    pace: float = PACE
    strength: float = 2.0
    field: bool = False
    alone: bool = True

    static = ("field", "alone")

    def hooks(self, arm):
        own = {"pace": ".pace"}
        bind = {"s": ".s", **own} | ({} if self.alone else {"rate": "phid1"})
        states = (
            e.State("s", "1", forwards, bind={"c": ".c", **own}),
            e.State("c", "1", back if self.alone else with_rate, bind=bind, initial=1.0),
        )
        taken = {"s": ".s", "strength": ".strength"}
        return (e.Field(shake, taken, states) if self.field else e.Force(3, push, taken, states=states),)


def test_which_states_are_autonomous():
    arm = FOUR_R
    motors = e.Lag(0.1), e.JointTorque(amplitude=0.5, frequency=2.0), e.MovingBase((0.01, 0.0), 9.0)
    assert Dynamics(rde.Scene(arm, motors)).autonomous == ("joint_torque.angle", "moving_base.angle")
    for alone, found in ((True, ("oscillator.s", "oscillator.c")), (False, ())):
        assert Dynamics(rde.Scene(arm, (Oscillator(alone=alone),))).autonomous == found


@pytest.mark.quick("4R-False-how0")
@pytest.mark.parametrize(
    "how", [{"integrator": "rk4", "substeps": 20}, {"integrator": "rk8"}, {"tolerance": 1e-9}]
)
@pytest.mark.parametrize("field", [False, True])
@pytest.mark.parametrize("name", ["4R", "RPRP"])
def test_they_have_the_same_motion_as_states_that_wait_for_the_arm(name, field, how):
    effects = ((e.Gravity(), Oscillator(field=field, alone=alone)) for alone in (True, False))
    one, other = (
        advanced(rde.Scene(ARMS[name], own, **how), *START, np.ones((1, 4)), intervals=20)[0]
        for own in effects
    )
    for found, expected in ((one.q, other.q), (one.qd, other.qd), (one.z, other.z)):
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(one.z, [[np.sin(PACE * 0.4), np.cos(PACE * 0.4)]], atol=2e-5)


@physics
def decay(first):
    return -first


@physics
def decayed(first, elapsed):
    return first * exp(-elapsed)


@physics
def sum_of(first):
    return first


@dataclasses.dataclass(frozen=True)
class Followed(e.Effect):
    """A state in closed form, and another that follows it and pushes the first joint a little."""

    def hooks(self, arm):
        first = e.State("first", "1", decay, bind={"first": ".first"}, initial=1.0, closed=decayed)
        second = e.State("second", "1", sum_of, bind={"first": ".first"})
        return (e.Force(0, push, {"s": ".second", "strength": "m1"}, states=(first, second)),)


def test_a_state_that_follows_one_in_closed_form_follows_it_within_a_step():
    scene = rde.Scene(FOUR_R, (Followed(),), "rk8", 1.0)
    batch, _ = advanced(scene, *START, np.zeros((1, 4)))
    np.testing.assert_allclose(sorted(batch.z[0]), [np.exp(-1.0), 1.0 - np.exp(-1.0)], rtol=1e-9)


@physics
def even(pace):
    return pace


@physics
def later(angle, pace, elapsed):
    return angle + pace * elapsed


@dataclasses.dataclass(frozen=True)
class Clock(e.Effect):
    """Two clocks that push a joint; one has a closed form."""

    pace: float = PACE

    def hooks(self, arm):
        own = {"pace": ".pace"}
        first = e.State("first", "rad", even, bind={"angle": ".first", **own}, closed=later)
        second = e.State("second", "rad", even, bind=own)
        taken = {"s": ".first", "strength": ".second"}
        return (e.Force(0, push, taken, states=(first, second)),)


def test_a_clock_in_closed_form_goes_beside_one_without():
    scene = rde.Scene(FOUR_R, (Clock(),), "rk8", 0.02)
    batch, _ = advanced(scene, *START, np.zeros((1, 4)), intervals=2)
    np.testing.assert_allclose(batch.z[0], [0.04 * PACE] * 2, rtol=1e-14)


def test_a_clock_is_as_exact_as_one_sum():
    """Equal slopes are added as one: an interval adds its length to rounding."""
    scene = rde.Scene(FOUR_R, (e.MovingBase((0.0, 0.0), 1.0),), "rk8", 0.02)
    batch, _ = advanced(scene, *START, np.zeros((1, 4)), intervals=500)
    assert batch.z.item() == pytest.approx(np.cumsum(np.full(500, 0.02))[-1], abs=1e-13)


def test_all_evaluators_have_the_same_motion():
    torch = pytest.importorskip("torch", reason="torch is in the extra 'train'")
    for field in (False, True):
        scene = rde.Scene(FOUR_R, (Oscillator(field=field), e.MovingBase((0.01, 0.02), 9.0)), "rk8")
        batch, _ = advanced(scene, *START, np.ones((1, 4)))
        given = [torch.tensor(x, dtype=torch.float64) for x in (*START, np.ones((1, 4)))]
        found = rde.torch_step(scene)(*given, z=torch.tensor([[0.0, 1.0, 0.0]], dtype=torch.float64))
        for one, other in zip(found, (batch.q, batch.qd, batch.z), strict=True):
            np.testing.assert_allclose(one.numpy(), other, rtol=0.0, atol=1e-12)
