"""Functions of Python and NumPy that are called by habit: the message says what to write, and it is right."""

import math
import re
import textwrap

import numpy as np
import pytest
from refusals import refusal, short

from redundant_envs import algebra, dialect
from redundant_envs.algebra import PRIMITIVES, physics

ARGUMENTS = {
    "clip": "x, -1.0, 1.0", "clamp": "x, -1.0, 1.0", "select": "[x > 0.0], [x], y",
    "piecewise": "x, [x > 0.0], [1.0]", "interp": "x, [0.0, 1.0], [0.0, 1.0]", "where": "x > 0.0, x, y",
    "any": "[x > 0.0]", "all": "[x > 0.0]", "logical_and": "x > 0.0, y > 0.0",
    "logical_or": "x > 0.0, y > 0.0", "logical_not": "x > 0.0", "dist": "[x, y], [0.0, 0.0]",
    "sorted": "[x, y]", "sort": "[x, y]", "fsum": "[x, y]", "range": "x", "norm": "[x, y]",
    "amax": "[x, y]", "amin": "[x, y]", "heaviside": "x, 0.0", "isclose": "x, y",
}  # fmt: skip
OF_TWO = (
    "max fmax maximum min fmin minimum copysign mod fmod remainder hypot pow power float_power atan2 arctan2"
)


def made(text, **names):
    known = {p: getattr(algebra, p) for p in (*PRIMITIVES, "clamp", "squash", "sincos", "logical_not")}
    known |= {"np": np, "math": math, "__name__": "prompt", **names}
    exec(textwrap.dedent(text), known)
    return known["f"]


def calls():
    """Every function of the table in every module that has it."""
    for name in dialect._INSTEAD:
        arguments = ARGUMENTS.get(name, "x, y" if name in OF_TWO.split() else "x")
        for module in ("math", "np", "np.linalg", ""):
            there = eval(module, {"math": math, "np": np}) if module else None
            if hasattr(there, name) if module else name in dir(__import__("builtins")):
                yield name, module, arguments


FORMS = {
    "plain": "def f(x, y):\n    return 2.0 * {call} + y",
    "nested": "def f(x, y):\n    return abs(x - {call}) / (1.0 + abs(y))",
    "of several lines": "def f(x, y):\n    return (\n        x\n        * {call}\n    )",
    "in a helper": "def g(x, y):\n    return {call}\n\ndef f(x, y):\n    return g(x, y) + 1.0",
    "in a lambda": "f = lambda x, y: {call} * y",
    "in a loop": "def f(x, y):\n    for _ in (1, 2):\n        x = x + {call}\n    return x",
    "alone": "there = {module}{name}\n{name} = there\ndef f(x, y):\n    return {name}({arguments})",
    "in an inner function": "def f(x, y):\n    def g():\n        return {call}\n    return g()",
}


def test_a_seeded_search_names_every_function_in_every_form():
    draw = np.random.default_rng(16)
    found, silent = 0, set()
    for name, module, arguments in calls():
        for form in draw.choice(list(FORMS), 3, replace=False):
            dot = f"{module}." if module else ""
            call = f"{dot}{name}({arguments})"
            function = physics(
                made(FORMS[form].format(call=call, name=name, module=dot, arguments=arguments))
            )
            message = refusal(dialect.check, function)
            if message is None:
                silent.add(call)
                continue
            assert f"it calls {name}; {dialect._INSTEAD[name]}" in message, (call, form)
            assert short(message)
            found += 1
    assert found > 150
    assert silent <= {"np.abs(x)", "abs(x)", "np.mean(x)", "np.average(x)"}


REPLACED = {
    "tanh": np.tanh, "sinh": np.sinh, "cosh": np.cosh, "expm1": np.expm1, "sign": np.sign,
    "ceil": np.ceil, "int": np.trunc, "square": np.square, "radians": np.radians, "degrees": np.degrees,
    "reciprocal": np.reciprocal, "negative": np.negative, "heaviside": lambda x: np.heaviside(x, 1.0),
    "round": lambda x: np.floor(x + 0.5), "fabs": np.abs,
}  # fmt: skip


@pytest.mark.parametrize("name", REPLACED)
def test_what_is_written_instead_is_the_same_function(name):
    written = re.match(r"write (.*?)(, (or|which) .*)?$", dialect._INSTEAD[name])[1]
    function = physics(made(f"def f(x):\n    return {written}"))
    dialect.check(function)
    x = np.array([-3.7, -1.0, -0.4, 0.3, 0.5, 2.0, 6.2])
    np.testing.assert_allclose(function(x), REPLACED[name](x), rtol=1e-13, atol=1e-15)
    assert isinstance(function(0.3), float)


@pytest.mark.parametrize(
    ("name", "function"),
    [("mod", np.mod), ("hypot", np.hypot), ("max", np.maximum), ("min", np.minimum)],
)
def test_what_is_written_of_two_numbers_is_the_same_function(name, function):
    written = re.match(r"write (.*?)(, which .*| with .*)?$", dialect._INSTEAD[name])[1]
    names = "x, y" if "x" in written.replace("max", "") else "a, b"
    replaced = made(f"def f({names}):\n    return {written}", maximum=algebra.maximum)
    a, b = np.array([-3.7, 2.5, 1.0, 0.0]), np.array([2.0, -0.7, 1.0, 3.0])
    np.testing.assert_allclose(replaced(a, b), function(a, b), rtol=1e-14)


def test_a_function_of_ones_own_with_such_a_name_is_not_blamed():
    """What stopped it is inside."""
    text = """
    def clip(x):
        return max(x, 0.0)

    def f(x, y):
        return clip(x)
    """
    with pytest.raises(ValueError, match="it calls max; write maximum"):
        dialect.check(physics(made(text)))
    with pytest.raises(ValueError, match="compare it first"):
        dialect.check(physics(made("def f(x, y):\n    return where(x, 1.0, y)")))
