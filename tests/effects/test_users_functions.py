"""Functions and effects of users that are allowed act as their code says, whatever they are called.

``test_refused_effects.py`` has the others.
"""

import functools
from dataclasses import dataclass, make_dataclass

import numpy as np
import pytest
from notebooks import ARM, HELPER, Q0, QD0, SPRING, acts_as, cell, end_of, notebook, user_module

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


@physics
def marked(x):
    return 2.0 * x


def badly_wrapped(x):
    return -marked(
        x
    ) + 0.0 * marked (x)  # fmt: skip


from_exec = {}
exec("def force(x):\n    return -11.0 * x", from_exec)
ALLOWED = {
    "constant": (lambda x: -K * x, -3.0 * PHI2),
    "array": (lambda x: x * KS[1] - KS[0] * x, 2.0 * PHI2),
    "default of a helper": (lambda x: twice(x), -2.0 * PHI2),
    "python": (in_other_words, 4.0 * PHI2),
    "closure": (closure(5.0), -5.0 * PHI2),
    "object": (Holder(), -7.0 * PHI2),
    "partial": (functools.partial(lambda k, x: k * x, 6.0), 6.0 * PHI2),
    "exec": (from_exec["force"], -11.0 * PHI2),
    "marked function inside": (badly_wrapped, -2.0 * PHI2),
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


def test_a_file_changed_after_its_import_is_what_was_imported(tmp_path):
    """Motion and energy alike, and so it is in a closure that is made later."""
    text = """
    from redundant_envs.algebra import physics

    def made(k):
        return physics(lambda x: -{} * k * x)

    force = made(1.0)
    """
    names = user_module(tmp_path, "changing", text.format("2.0"))
    (tmp_path / "changing.py").write_text(text.format("100.0"))
    assert acts_as(names["force"], -2.0 * PHI2)
    assert acts_as(names["made"](3.0), -6.0 * PHI2)
    assert names["force"](PHI2) == -2.0 * PHI2


# ---- functions that are defined again ------------------------------------------------------------


def redone(factor):
    """A notebook with a spring of a user on joint 2, whose helper is in a cell of its own."""
    names, run = notebook()
    run(1, shape_of(factor))
    run(2, SPRING.format(helper="shape", force="force", energy="energy", kind="Redone", joint=2))
    return names, run


def shape_of(factor):
    return HELPER.format(helper="shape", factor=factor)


def test_a_helper_that_is_defined_again_is_the_same_for_motion_and_energy():
    names, run = redone(1.0)
    energies = []
    for number, factor in ((3, 100.0), (4, 1.0), (5, 1.0)):
        scene = rde.Scene(ARM, (names["Redone"](),), "dop853")
        motion = rde.simulate(scene, Q0, QD0, times=[0.0, 0.1, 0.2])
        total = kinetic_energy(scene, motion.q, motion.qd) + potential_energy(scene, motion.q)
        np.testing.assert_allclose(total, total[0], rtol=1e-9)
        energies.append(potential_energy(scene, Q0))
        run(number, shape_of(factor))
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


def test_functions_of_one_name_in_two_cells_both_act():
    """Forces, potentials and helpers, each with a different factor."""
    alike, apart = (
        [cell(first + k, f"Spring{k}", k, 2.0**k, f"_{k}" if first else "") for k in (1, 2, 3)]
        for first in (0, 10)
    )
    np.testing.assert_array_equal(end_of(*alike), end_of(*apart))
    assert not (end_of(*alike) == end_of(alike[0])).all()


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
