"""What is written instead of functions of Python and NumPy that are called by habit is the same function."""

import math
import re

import numpy as np
import pytest

from redundant_envs.compiler import dialect
from redundant_envs.language import algebra
from redundant_envs.language.algebra import PRIMITIVES, physics


def made(text, **names):
    known = {p: getattr(algebra, p) for p in (*PRIMITIVES, "clamp", "squash", "sincos", "logical_not")}
    known |= {"np": np, "math": math, "__name__": "prompt", **names}
    exec(text, known)
    return known["f"]


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
