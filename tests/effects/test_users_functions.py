"""Functions of users that are allowed act as their code says; ``test_refused_effects.py`` has the others."""

import functools

import numpy as np
import pytest
from notebooks import ARM, HELPER, Q0, QD0, SPRING, acts_as, notebook, user_module

import redundant_envs as rde
from redundant_envs.algebra import exp, physics, sincos, where
from redundant_envs.model.energy import kinetic_energy, potential_energy

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


def test_a_sine_may_be_an_argument():
    assert acts_as(physics(lambda s1, c1: s1 * c1), np.sin(Q0[0]) * np.cos(Q0[0]), s1="s1")


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


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "def shape(x, k):\n    if x > 0.0:\n        x = 2.0 * x\n    return x",
            "where\\(condition, a, b\\)",
        ),
        ("def shape(x, k):\n    return force(x, x)", "calls itself"),
        ("shape = 3.0", "'float' object is not callable"),
    ],
)
def test_a_helper_that_is_defined_again_outside_the_dialect_is_refused(text, words):
    names, run = redone(1.0)
    rde.Scene(ARM, (names["Redone"](),))
    run(8, text)
    with pytest.raises(ValueError, match=words):
        rde.Scene(ARM, (names["Redone"](),))


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
