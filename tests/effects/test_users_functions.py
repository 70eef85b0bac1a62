"""Functions and effects of users that are allowed act as their code says, whatever they are called.

``test_refused_effects.py`` has the others.
"""

import functools
import os
import subprocess
import sys
from dataclasses import dataclass, make_dataclass
from pathlib import Path

import numpy as np
import pytest
from notebooks import ARM, HELPER, Q0, QD0, SPRING, acts_as, cell, end_of, notebook, user_module

import redundant_envs as rde
from redundant_envs.algebra import exp, physics, sincos, where
from redundant_envs.effects import Effect, Force, Gravity, LimitSpring, ViscousFriction
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


# ---- names that are alike -----------------------------------------------------------------------------


def springs():
    """Forces, potentials and helpers of equal names in three cells, each with a different factor."""
    return [cell(k, f"Spring{k}", k, 2.0**k) for k in (1, 2, 3)]


def test_functions_of_one_name_in_two_cells_both_act():
    alike, apart = springs(), [cell(10 + k, f"Spring{k}", k, 2.0**k, apart=f"_{k}") for k in (1, 2, 3)]
    np.testing.assert_array_equal(end_of(*alike), end_of(*apart))
    assert not (end_of(*alike) == end_of(alike[0])).all()
    scene = rde.Scene(ARM, alike, tolerance=1e-9)
    motion = rde.simulate(scene, Q0, QD0, np.linspace(0.0, 1.0, 21)[1:])
    start = kinetic_energy(scene, Q0, QD0) + potential_energy(scene, Q0)
    assert np.abs(motion.kinetic_energy + motion.potential_energy - motion.work - start).max() < 1e-8


def test_a_file_named_like_one_of_the_package(tmp_path):
    """A user's viscous_friction.force beside the one of the package, and its helper beside algebra's."""
    text = """
    from dataclasses import dataclass, make_dataclass
    from redundant_envs.algebra import physics
    from redundant_envs.effects.hooks import Effect, Force

    @physics
    def force(rate, c):
        return -c * rate * rate * rate

    @dataclass(frozen=True)
    class Drag(Effect):
        c: float = 0.3

        def hooks(self, arm):
            return (Force(1, force, {"rate": "phid2", "c": ".c"}),)
    """
    own, other = (user_module(tmp_path, name, text)["Drag"]() for name in ("viscous_friction", "drag"))
    packaged = ViscousFriction(0.5)
    np.testing.assert_array_equal(end_of(packaged, own), end_of(packaged, other))
    np.testing.assert_array_equal(end_of(own, packaged), end_of(other, packaged))


def test_functions_of_one_name_on_arrays_and_symbols():
    """Two functions with one name are two functions there, too."""
    sp = pytest.importorskip("sympy", reason="sympy is in the extra 'verify'")
    one, two = (cell(20 + k, "Spring", 1, float(k)).hooks(ARM)[0].function for k in (3, 5))
    x = sp.Symbol("x")
    for k, function in ((3, one), (5, two)):
        assert function(np.array([2.0]), 1.0) == -2.0 * k
        assert function(x, 1) == -float(k) * x


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


def test_a_subclass_with_another_function_is_itself():
    """The function of a subclass, which has the name of that of its base, is the one that acts."""
    base = cell(30, "Spring", 1, 2.0)
    force = cell(31, "Spring", 1, 7.0).hooks(ARM)[0]
    stiffer = type("Stiffer", (type(base),), {"hooks": lambda self, arm: (force,)})()
    apart = cell(32, "Spring", 1, 2.0, apart="_a"), cell(33, "Other", 1, 7.0, apart="_b")
    np.testing.assert_array_equal(end_of(base, stiffer), end_of(*apart))


def shown():
    """The listing of a scene, and the key of its compiled program."""
    scene = rde.Scene(ARM, springs())
    return f"{rde.listing(scene)}{batch_simulator(scene, False).key}"


@pytest.mark.parametrize("seed", ["1", "2"])
def test_a_program_and_its_key_do_not_depend_on_the_process(seed):
    """No address and no order of a set is in them."""
    code = "import sys; sys.path[:0] = sys.argv[1:]; from test_users_functions import shown; print(shown())"
    here = Path(__file__).parent
    run = subprocess.run(
        [sys.executable, "-c", code, str(here), str(here.parent)],
        capture_output=True, text=True, check=True, env={**os.environ, "PYTHONHASHSEED": seed},
    )  # fmt: skip
    assert run.stdout == shown() + "\n"


def test_scenes_that_differ_in_names_only_are_one_program():
    """Names of functions, classes and parameters do not change results."""
    effects = pushing("Plain", a=(0.7, 0.2)), TIP, pushing("Other", a=(0.1, 0.9)), W
    scenes = [rde.Scene(ARM, (effect,)) for effect in effects]
    *alike, last = (batch_simulator(scene, False).key for scene in scenes)
    assert len({*alike}) == 1
    assert last not in alike
