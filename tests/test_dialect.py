"""The physics dialect: the package keeps to it, and functions outside it are refused."""

import importlib
import inspect
import linecache
import math
import pkgutil
import textwrap

import numpy as np
import pytest

from redundant_envs.compiler import dialect
from redundant_envs.language import algebra
from redundant_envs.language.algebra import PRIMITIVES, gives_of, is_physics, physics

PLACES = (
    *(f"redundant_envs.{name}" for name in ("language.algebra", "language.draws", "scenes.ranges")),
    *(f"redundant_envs.{name}" for name in ("robots", "effects", "tasks")),
    "tests.verify.aimed",
    "studies.kinked_effects",
)


def marked_functions():
    """Every function marked @physics in the package, by its full name."""
    modules = [importlib.import_module(place) for place in PLACES]
    for package in [m for m in modules if hasattr(m, "__path__")]:
        inside = pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
        modules += [importlib.import_module(m.name) for m in inside]
    return {
        f"{m.__name__}.{name}": value
        for m in modules for name, value in vars(m).items()
        if inspect.isfunction(value) and is_physics(value) and value.__module__ == m.__name__
    }  # fmt: skip


FUNCTIONS = marked_functions()


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_every_marked_function_is_in_the_dialect_and_returns_what_it_gives(name):
    """As many values are returned as quantities are named, and no quantity twice."""
    gives = gives_of(FUNCTIONS[name])
    assert len(set(gives)) == len(gives)
    assert dialect.check(FUNCTIONS[name]) == len(gives) or not gives  # a helper names none


BRANCH = "where(condition, a, b)"
OPERATIONS = "write + - * /, ** 2 to 4"
REFUSED = {
    "if": ("if x > 0.0:\n    y = x\nreturn y", BRANCH),
    "and": ("return where((x > 0.0) and (y > 0.0), x, y)", BRANCH),
    "not of a condition": ("return where(not x > 0.0, x, y)", BRANCH),
    "chained comparison": ("return where(0.0 < x < 1.0, x, y)", BRANCH),
    "max": ("return max(x, y)", "it calls max; write maximum(a, b)"),
    "numpy's where": ("return np.where(x > 0.0, x, y)", "take the function of this name from redundant_envs"),
    "equal conditions": ("return where((x > 0.0) == (y > 0.0), x, y)", "conditions"),
    "invert": ("return where(~(x > 0.0), x, y)", "logical_not"),
    "math": ("return math.sin(x)", "it calls sin; take the sine and cosine as arguments"),
    "range": ("return sum(x for _ in range(x))", "it calls range; loop over plain numbers"),
    "floor division": ("return x // y", "write floor(a / b) instead of a // b"),
    "product with a condition": ("return (x > 0.0) * x", OPERATIONS),
    "unknown name": ("return sin(x)", "name 'sin' is not defined; take the sine and cosine"),
    "power of a constant": ("return 2.0**x", "write exp(k * x) instead of a**x"),
    "recursion": ("return f(y, x)", "f calls itself"),
    "condition": ("return x > 0.0", "returns a condition; return numbers, such as where(condition, 1.0, "),
    "variable exponent": ("return x**y", "the exponent is no constant; write"),
    "negative exponent": ("return x**-1", "the exponent is -1"),
    "list": ("return [x, y]", "returns a list; return numbers: one, or a tuple"),
    "nothing": ("z = x", "returns a NoneType"),
    "division of constants": ("return x * (1.0 / 0.0)", "division by zero"),
}


def made(body):
    """A marked function of x and y, as a notebook makes it."""
    text = f"def f(x, y):\n{textwrap.indent(body, '    ')}"
    linecache.cache["prompt"] = len(text), None, text.splitlines(True), "prompt"
    names = {**{p: getattr(algebra, p) for p in PRIMITIVES}, "np": np, "math": math, "__name__": "prompt"}
    exec(compile(text, "prompt", "exec"), names)
    return physics(names["f"])


@pytest.mark.parametrize("what", sorted(REFUSED))
def test_what_is_outside_the_dialect_is_refused_and_said(what):
    body, words = REFUSED[what]
    with pytest.raises(ValueError) as error:
        dialect.check(made(body))
    message = str(error.value)
    assert message.startswith("prompt.f ")
    assert words in message


ALLOWED = {
    "for": "for i in (1, 2):\n    x = x + i\nreturn x",
    "branch on what is known": "return x if 2.0 > 1.0 else y",
    "numbers of numpy": "return x * np.float64(2.0) + np.float64(3.0) * y + np.int64(2) * x",
    "conditions": "return where((x > 0.0) & (y <= 2.0) | (x == y), sqrt(abs(x)) / 2, log(exp(y)) ** 2)",
}


@pytest.mark.parametrize("body", ALLOWED.values(), ids=ALLOWED)
def test_python_that_comes_to_the_same_is_allowed(body):
    dialect.check(made(body))


def test_what_is_no_marked_function_is_refused():
    for function, words in (
        (3.0, r"3\.0 is no function; write one with 'def', marked @physics"),
        (None, "None is no function"),
        (made, r"test_dialect\.made is not marked; write @physics above its 'def'"),
    ):
        with pytest.raises(ValueError, match=words):
            dialect.check(function)
