"""Functions of users that are allowed act as their code says, also when they are defined again, and what a
message says to write instead of a function of Python or NumPy is the same function."""

import functools
import re

import numpy as np
import pytest
from catalogue import advanced
from one_force import ARM, with_force

import redundant_envs as rde
from redundant_envs.compiler import dialect
from redundant_envs.language import algebra
from redundant_envs.language.algebra import PRIMITIVES, exp, physics, sincos, where

Q0, QD0 = np.array([-1.2, 0.4, -0.4, 0.9]), np.array([0.5, -0.6, 0.9, 0.8])
PHI2 = Q0[1] - Q0[0]
KS = np.array([3.0, 5.0])


def acts_as(function, force_on_joint_2, bind=None):
    """Whether a function, as the force on joint 2, begins a motion with the acceleration of a force."""
    effects = with_force(function, bind).effects
    begun, _ = advanced(rde.Scene(ARM, effects, "euler", control_dt=1e-3), Q0, QD0)
    qdd = ARM.forward_dynamics(Q0, QD0, ARM.motor_map @ (0.0, force_on_joint_2, 0.0, 0.0), 0.0)
    return np.abs((begun.qd[0] - QD0) / 1e-3 - qdd).max() <= 1e-11 * np.abs(qdd).max()


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


def twice(x, k=2.0):
    return -k * x


ALLOWED = {
    "array": (lambda x: x * KS[1] - KS[0] * x, 2.0 * PHI2),
    "default of a helper": (lambda x: twice(x), -2.0 * PHI2),
    "python": (in_other_words, 4.0 * PHI2),
    "closure": ((lambda k: lambda x: -k * x)(5.0), -5.0 * PHI2),
    "object": (Holder(), -7.0 * PHI2),
    "partial": (functools.partial(lambda k, x: k * x, 6.0), 6.0 * PHI2),
    "whole number": (lambda x: 3, 3.0),
    "tanh": (lambda x: 1.0 - 2.0 / (exp(2.0 * x) + 1.0), np.tanh(PHI2)),
    "sine": (lambda x: sincos(x)[0] * where(x > 0.0, 2.0, 3.0), 2.0 * np.sin(PHI2)),
}


@pytest.mark.parametrize("what", ["method", *ALLOWED])
def test_a_function_does_what_its_code_says(what):
    function, force = ALLOWED.get(what, (None, -7.0 * PHI2))
    function = Holder().method if function is None else physics(function)
    assert acts_as(function, force)
    assert function(PHI2) == pytest.approx(force)


class Callable:
    """What a tool that reloads modules keeps, while it replaces the method of the class."""

    def __call__(self, x):
        return x


def wrapped():
    """A function of another one, whose arguments it shows."""
    function = functools.wraps(lambda x: x)(lambda *given: function.__wrapped__(*given))
    return function


REPLACED = {
    "code": (lambda: lambda x: x, lambda f, new, method: setattr(f, "__code__", new.__code__)),
    "call": (Callable, lambda f, new, method: setattr(Callable, "__call__", method)),
    "wrapped": (wrapped, lambda f, new, method: setattr(f, "__wrapped__", new)),
}


@pytest.mark.parametrize(("made", "replace"), REPLACED.values(), ids=REPLACED)
def test_a_function_whose_code_is_replaced_is_the_new_one(made, replace, monkeypatch):
    """Tools that reload modules keep the function and replace its code, and its arguments."""
    monkeypatch.setattr(Callable, "__call__", Callable.__call__)  # to be as it was
    shape = physics(made())
    assert acts_as(shape, PHI2)
    for new, method, bind, force in (
        (lambda x: 7.0 * x, lambda self, x: 7.0 * x, {"x": "phi2"}, 7.0 * PHI2),
        (
            lambda rate, x: rate - x, lambda self, rate, x: rate - x, {"x": "phi2", "rate": "phid2"},
            QD0[1] - QD0[0] - PHI2,
        ),
    ):  # fmt: skip
        replace(shape, new, method)
        assert acts_as(shape, force, bind)


# ---- what is written instead of functions that are called by habit ---------------------------------

NAMES = {name: getattr(algebra, name) for name in (*PRIMITIVES, "clamp", "squash", "sincos", "logical_not")}
INSTEAD = {
    "tanh": np.tanh, "sign": np.sign, "ceil": np.ceil, "int": np.trunc, "square": np.square,
    "round": lambda x: np.floor(x + 0.5), "fabs": np.abs,
    "mod": np.mod, "hypot": np.hypot, "max": np.maximum, "min": np.minimum,
}  # fmt: skip


@pytest.mark.parametrize("name", INSTEAD)
def test_what_is_written_instead_is_the_same_function(name):
    written = re.match(r"write (.*?)(, (or|which) .*| with .*)?$", dialect._INSTEAD[name])[1]
    names = [n for n in "abxy" if re.search(rf"\b{n}\b", written)]
    function = physics(eval(f"lambda {', '.join(names)}: {written}", {**NAMES, "__name__": "prompt"}))
    dialect.check(function)
    values = (
        np.array([-3.7, -1.0, -0.4, 0.3, 0.5, 2.0, 6.2]),
        np.array([2.0, -0.7, -0.4, 3.0, 1.0, 2.0, -5.0]),
    )
    given = values[: len(names)]
    np.testing.assert_allclose(function(*given), INSTEAD[name](*given), rtol=1e-13, atol=1e-15)
    assert isinstance(function(*(0.3, 0.7)[: len(names)]), float)
