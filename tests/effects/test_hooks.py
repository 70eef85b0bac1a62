"""Attaching effects: names, joints, results and keys that do not fit are refused by the scene."""

from dataclasses import dataclass

import pytest

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects.hooks import Actuation, Effect, Field, Force, Impact

ARM = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))


@physics
def spring(x, k):
    return -k * x


@physics
def energy(x, k):
    return 0.5 * k * x**2


@physics
def damped(x, rate, k):
    return -k * (x + rate)


@physics
def field_of(x):
    return 0.0 * x, 9.81


BIND = {"x": "phi2", "k": ".k"}


@pytest.mark.parametrize(
    ("hooks", "words"),
    [
        ((Force(4, spring, BIND),), ["joint is 4", "0 to 3", "joint1"]),
        ((Force("joint2", spring, BIND),), ["joint is 'joint2'", "0 to 3"]),
        ((Force(1, spring, {"x": "phi2", "k": ".stiffness"}),), ["'.stiffness'", "it has .k"]),
        ((Force(1, spring, {"x": "phi9", "k": ".k"}),), ["'phi9'", "phi1"]),
        ((Force(1, spring, {"x": "qdd1", "k": ".k"}),), ["'qdd1'", "follows from the forces"]),
        ((Force(1, spring, {"x": 2.0, "k": ".k"}),), ["2.0", "quotation marks"]),
        ((Force(1, spring, ["phi2", ".k"]),), ["bind", "mapping"]),
        (Force(1, spring, BIND), ["hooks gives", "tuple"]),
        ((Impact(1, ".lower", ".k", ".k"),), ["lower", "'.lower'", ".k"]),
        ((Force(1, damped, {**BIND, "rate": "phid2"}, potential=energy),), ["phid2", "conservative="]),
        ((Force(1, spring, BIND, conservative=spring),), ["no potential", "give the potential"]),
        ((Force(1, spring, BIND, potential=damped),), ["rate"]),
        ((Force(1, spring, BIND, potential=field_of),), ["field_of", "one value"]),
        ((Force(1, spring, BIND, stiffness=spring),), ["stiffness", "phi2", "parameters alone"]),
        ((Actuation(1, field_of, {"x": "command2"}),), ["returns 2 values", "Actuation needs 1"]),
        ((Field(spring, BIND),), ["returns 1 values", "Field needs 2"]),
    ],
)
def test_a_hook_that_does_not_fit_is_refused_by_the_scene(hooks, words):
    @dataclass(frozen=True)
    class Odd(Effect):
        k: float = 1.0

        def hooks(self, arm):
            return hooks

    with pytest.raises(ValueError) as error:
        rde.Scene(ARM, (Odd(),))
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize("key", ["my spring", "1st", "", "a..b", 3, "a-b"])
def test_a_key_that_cannot_be_a_name_is_refused(key):
    odd = type("Odd", (Effect,), {"key": key, "hooks": lambda self, arm: (Force(0, field_of, {}),)})
    with pytest.raises(ValueError, match="has the key"):
        rde.Scene(ARM, (odd(),))
