"""Functions of Python and NumPy that are called by habit: the message says what to write, and it is right."""

import math
import re

import numpy as np
import pytest
from refusals import refusal, short

from redundant_envs.compiler import dialect
from redundant_envs.language import algebra
from redundant_envs.language.algebra import PRIMITIVES, physics

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
    exec(text, known)
    return known["f"]


def calls():
    """Every function of the table in every module that has it."""
    for name in dialect._INSTEAD:
        arguments = ARGUMENTS.get(name, "x, y" if name in OF_TWO.split() else "x")
        for module in ("math", "np", "np.linalg", ""):
            there = eval(module, {"math": math, "np": np}) if module else None
            if hasattr(there, name) if module else name in dir(__import__("builtins")):
                yield name, module, arguments


def test_every_function_of_the_table_is_refused_with_what_to_write():
    silent = set()
    for name, module, arguments in calls():
        call = f"{module}{'.' if module else ''}{name}({arguments})"
        message = refusal(dialect.check, physics(made(f"def f(x, y):\n    return abs(x - {call}) + y")))
        if message is None:
            silent.add(call)
            continue
        assert f"it calls {name}; {dialect._INSTEAD[name]}" in message, call
        assert short(message)
    assert silent <= {"np.abs(x)", "abs(x)", "np.mean(x)", "np.average(x)"}


REPLACED = {
    "tanh": np.tanh, "sinh": np.sinh, "cosh": np.cosh, "sign": np.sign,
    "ceil": np.ceil, "int": np.trunc, "square": np.square, "radians": np.radians, "degrees": np.degrees,
    "reciprocal": np.reciprocal, "negative": np.negative, "heaviside": lambda x: np.heaviside(x, 1.0),
    "round": lambda x: np.floor(x + 0.5), "fabs": np.abs,
    "mod": np.mod, "hypot": np.hypot, "max": np.maximum, "min": np.minimum,
}  # fmt: skip


@pytest.mark.parametrize("name", REPLACED)
def test_what_is_written_instead_is_the_same_function(name):
    written = re.match(r"write (.*?)(, (or|which) .*| with .*)?$", dialect._INSTEAD[name])[1]
    names = [n for n in "abxy" if re.search(rf"\b{n}\b", written)]
    function = physics(made(f"def f({', '.join(names)}):\n    return {written}"))
    dialect.check(function)
    values = (
        np.array([-3.7, -1.0, -0.4, 0.3, 0.5, 2.0, 6.2]),
        np.array([2.0, -0.7, -0.4, 3.0, 1.0, 2.0, -5.0]),
    )
    given = values[: len(names)]
    np.testing.assert_allclose(function(*given), REPLACED[name](*given), rtol=1e-13, atol=1e-15)
    assert isinstance(function(*(0.3, 0.7)[: len(names)]), float)
