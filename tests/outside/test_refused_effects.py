"""Effects from outside that contradict their own declarations are refused when a scene is made."""

from dataclasses import dataclass, field

import pytest

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.backends.torch import torch
from redundant_envs.effects import Effect

ARM = rde.FourR((1.0,) * 4, (0.5,) * 4)


@physics
def upwards(phid1):
    return 0.0 * phid1, 9.81


def test_a_uniform_field_depends_on_parameters_alone():
    class Odd(Effect):
        def hooks(self, arm):
            return (rde.effects.Field(upwards),)

    with pytest.raises(ValueError, match=r"upwards depends on phid1; a uniform field .* parameters alone"):
        rde.Scene(ARM, (Odd(),))


@dataclass(frozen=True)
class Derived(Effect):
    k: float = 1.0
    twice: float = field(init=False, default=2.0)

    def hooks(self, arm):
        return ()


def test_a_number_that_follows_from_others_is_no_field():
    with pytest.raises(ValueError, match=r"Derived\).twice is not an argument of its class"):
        rde.Scene(ARM, (Derived(),))


@physics
def one():
    return 1.0


def test_a_torch_step_takes_constant_updates_and_refuses_what_is_no_real_number():
    @dataclass(frozen=True)
    class Latch(Effect):
        def hooks(self, arm):
            states = (rde.effects.State("z", "", update=one),)
            return (rde.effects.Force(0, zero, states=states),)

    step = rde.torch_step(rde.Scene(ARM, (Latch(),), "rk4"))
    q = torch.zeros((2, 4), dtype=torch.float64)
    assert step(q, q, q, z=torch.zeros((2, 1)))[2].tolist() == [[1.0], [1.0]]
    plain = rde.torch_step(rde.Scene(ARM, (), "rk4"))
    with pytest.raises(ValueError, match=r"masses has shape \(\); the last axis must have 4"):
        plain(q, q, q, {"masses": torch.tensor(2.0)})
    with pytest.raises(ValueError, match=r"is of torch\.complex128; give real numbers"):
        plain(q, q, q.to(torch.complex128))


@physics
def zero():
    return 0.0


@dataclass(frozen=True)
class Wall(rde.effects.LimitSpring):
    """A limit spring that declares which of its numbers limit the travel."""

    ends: tuple = ("lower", "upper")
    static = ("coordinate", "ends")

    def travel(self, arm):
        return dict.fromkeys(super().travel(arm), self.ends)


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        (("upper", "lower"), r"of 'joint2' is .upper to .lower, which are 1.0 and -1.0; the first must"),
        (("lower", "lower"), "which are -1.0 and -1.0; the first must be below the second"),
        (("lower", "top"), "travel gives 'top', which is not a number of this effect; it has lower, upper"),
    ],
)
def test_a_travel_in_the_wrong_order_or_of_unknown_numbers_is_refused(ends, words):
    with pytest.raises(ValueError, match=words):
        rde.Scene(ARM, (Wall("joint2", -1.0, 1.0, ends=ends),))


def test_a_travel_that_other_numbers_bring_into_the_wrong_order_is_refused():
    class Slack(Wall):
        """Limits that its class does not compare."""

        def __post_init__(self):
            pass

        def hooks(self, arm):
            return tuple(h for h in super().hooks(arm) if h.switch is None)

    batch = rde.BatchSimulator(rde.Scene(ARM, (Slack("joint2", -1.0, 1.0),)), 2)
    with pytest.raises(ValueError, match=r"travel of 'joint2' is .lower to .upper, which are 3.0 and 1.0"):
        batch.set_parameters({"limit_spring.joint2.lower": 3.0})
