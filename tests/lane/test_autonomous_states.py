"""States that change by themselves: steps evaluate them apart from the arm, with the same result."""

import dataclasses

import numpy as np
import pytest
from catalogue import FOUR_R, advanced

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.language.algebra import physics

PACE = 40.0
START = np.array([[0.3, 0.5, -0.2, 0.4]]), np.array([[2.0, -1.0, 1.5, 0.5]])

forwards = physics(lambda c, pace: pace * c)
back = physics(lambda s, pace: -pace * s)
with_rate = physics(lambda s, pace, rate: -pace * s + 0.0 * rate)
"""The same as ``back`` as long as the rate is finite, but it waits for the arm."""
push = physics(lambda s, strength: strength * s)
shake = physics(lambda s, strength: (strength * s, -strength * s))


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


@pytest.mark.quick("rk4")
@pytest.mark.parametrize(
    ("field", "how"),
    [(False, {"integrator": "rk4", "substeps": 20}), (True, {}), (False, {"tolerance": 1e-9})],
    ids=["rk4", "a field, rk8", "1e-9"],
)
def test_they_have_the_same_motion_as_states_that_wait_for_the_arm(field, how):
    one, other = (
        advanced(rde.Scene(FOUR_R, (e.Gravity(), effect), **how), *START, np.ones((1, 4)), intervals=20)[0]
        for effect in (Oscillator(field=field), Oscillator(field=field, alone=False))
    )
    for found, expected in ((one.q, other.q), (one.qd, other.qd), (one.z, other.z)):
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(one.z, [[np.sin(PACE * 0.4), np.cos(PACE * 0.4)]], atol=2e-5)


def test_a_clock_is_as_exact_as_one_sum():
    """Equal slopes are added as one: an interval adds its length to rounding."""
    scene = rde.Scene(FOUR_R, (e.MovingBase((0.0, 0.0), 1.0),), "rk8", 0.02)
    batch, _ = advanced(scene, *START, intervals=500)
    assert batch.z.item() == pytest.approx(np.cumsum(np.full(500, 0.02))[-1], abs=1e-13)
