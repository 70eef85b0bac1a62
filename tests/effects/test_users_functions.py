"""Functions and effects of users that are allowed act as their code says, whatever they are called.

``test_refused_effects.py`` has the others.
"""

import functools
from dataclasses import dataclass, make_dataclass

import numpy as np
import pytest
from notebooks import ARM, Q0, QD0, acts_as, end_of, notebook

import redundant_envs as rde
from redundant_envs.algebra import exp, physics, sincos, where
from redundant_envs.effects import Effect, Force, Gravity, LimitSpring
from redundant_envs.model.energy import kinetic_energy, potential_energy
from redundant_envs.model.programs import batch_simulator

PHI2 = Q0[1] - Q0[0]
K = 3.0
KS = np.array([3.0, 5.0])


def in_other_words(x):
    """Loops and branches on plain numbers, assignments, lists."""
    total = 0.0
    for k in range(4):
        if k % 2:
            total += [x, -x][0] * k
    return total


class Holder:
    k = 7.0

    @physics
    def method(self, x):
        return -self.k * x

    def __call__(self, x):
        return -self.k * x


def closure(k):
    return lambda x: -k * x


def twice(x, k=2.0):
    return -k * x


ALLOWED = {
    "constant": (lambda x: -K * x, -3.0 * PHI2),
    "array": (lambda x: x * KS[1] - KS[0] * x, 2.0 * PHI2),
    "default of a helper": (lambda x: twice(x), -2.0 * PHI2),
    "python": (in_other_words, 4.0 * PHI2),
    "closure": (closure(5.0), -5.0 * PHI2),
    "object": (Holder(), -7.0 * PHI2),
    "partial": (functools.partial(lambda k, x: k * x, 6.0), 6.0 * PHI2),
    "whole number": (lambda x: 3, 3.0),
    "number": (lambda x: -2.5, -2.5),
    "tanh": (lambda x: 1.0 - 2.0 / (exp(2.0 * x) + 1.0), np.tanh(PHI2)),
    "sine": (lambda x: sincos(x)[0] * where(x > 0.0, 2.0, 3.0), 2.0 * np.sin(PHI2)),
}


@pytest.mark.parametrize("what", ["method", *ALLOWED])
def test_a_function_does_what_its_code_says(what):
    function, force = ALLOWED.get(what, (None, -7.0 * PHI2))
    function = Holder().method if function is None else physics(function)
    assert acts_as(function, force)
    assert function(PHI2) == pytest.approx(force)


def test_a_constant_is_that_of_the_time_when_the_simulator_is_made():
    names, run = notebook()
    run(20, "k = 2.0\n@physics\ndef force(x):\n    return -k * x")
    assert acts_as(names["force"], -2.0 * PHI2)
    run(21, "k = 3.0")
    assert acts_as(names["force"], -3.0 * PHI2)


# ---- functions that are defined again ------------------------------------------------------------


SHAPE = "@physics\ndef shape(x, k):\n    return {factor} * k * x\n"
SPRING = """
@physics
def force(position, k):
    return -shape(position, k)

@physics
def energy(position, k):
    return 0.5 * shape(position, k) * position

@dataclass(frozen=True)
class Spring(Effect):
    k: float = 1.5

    def hooks(self, arm):
        return (Force(1, force, {"position": "phi2", "k": ".k"}, potential=energy),)
"""


def test_a_helper_that_is_defined_again_is_the_same_for_motion_and_energy():
    names, run = notebook()
    run(1, SHAPE.format(factor=1.0))
    run(2, SPRING)
    energies = []
    for number, factor in ((3, 100.0), (4, 1.0), (5, 1.0)):
        scene = rde.Scene(ARM, (names["Spring"](),), "dop853")
        motion = rde.simulate(scene, Q0, QD0, times=[0.0, 0.1, 0.2])
        total = kinetic_energy(scene, motion.q, motion.qd) + potential_energy(scene, motion.q)
        np.testing.assert_allclose(total, total[0], rtol=1e-9)
        energies.append(potential_energy(scene, Q0))
        run(number, SHAPE.format(factor=factor))
    plain = potential_energy(rde.Scene(ARM), Q0)
    np.testing.assert_allclose(energies[1] - plain, 100.0 * (energies[0] - plain), rtol=1e-12)
    assert energies[2] == energies[0]


def test_a_function_whose_code_is_replaced_is_the_new_one():
    """Tools that reload modules keep the function and replace its code, and its arguments."""
    names, run = notebook()
    shape = physics(lambda x: x)
    assert acts_as(shape, PHI2)
    for number, text, force in (
        (10, "shape = lambda x: 7.0 * x", 7.0 * PHI2),
        (11, "shape = lambda rate, x: rate - x", QD0[1] - QD0[0] - PHI2),
    ):
        run(number, text)
        shape.__code__ = names["shape"].__code__
        bind = {"x": "phi2"} if number == 10 else {"x": "phi2", "rate": "phid2"}
        assert acts_as(shape, force, **bind)


# ---- names that are alike -----------------------------------------------------------------------------


@physics
def push(value):
    return 1.0 * value


@dataclass(frozen=True)
class Pushes(Effect):
    """Pushes on the first joints."""

    def hooks(self, arm):
        numbers = enumerate(self.parameters())
        return tuple(Force(k, push, {"value": f".{name}"}) for k, name in numbers)


def pushing(kind, **numbers):
    """Such an effect with numbers of these names."""
    fields = [(n, float if isinstance(x, float) else tuple[float, ...], x) for n, x in numbers.items()]
    return make_dataclass(kind, fields, bases=(Pushes,), frozen=True)()


TIP = pushing("Tip", x=0.7, vx=0.2)
W = pushing("W", h=0.7, count=0.2, j=(0.1, 0.3))
"""A short name with numbers of short names, those of fields of lanes among them."""


@pytest.mark.parametrize(
    "effect", [pushing("LimitSpringJoint1", lower=0.7), TIP, W], ids=["limit spring", "tip", "short"]
)
def test_parameters_that_read_like_others_are_rows_of_their_own(effect):
    beside, pushes = (Gravity(), LimitSpring("joint1", -2.0, 1.9)), tuple(effect.parameters().values())
    np.testing.assert_array_equal(end_of(*beside, effect), end_of(*beside, pushing("Plain", a=pushes)))


def test_scenes_that_differ_in_names_only_are_one_program():
    """Names of functions, classes and parameters do not change results."""
    effects = pushing("Plain", a=(0.7, 0.2)), TIP, pushing("Other", a=(0.1, 0.9)), W
    scenes = [rde.Scene(ARM, (effect,)) for effect in effects]
    *alike, last = (batch_simulator(scene, False).key() for scene in scenes)
    assert len({*alike}) == 1
    assert last not in alike
