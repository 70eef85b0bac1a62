"""Check that a function belongs to the physics dialect, by running it on traced numbers."""

import ast
import contextlib
import functools
import linecache
import random
import traceback
from typing import Any

import numpy as np

from redundant_envs.compiler.tracing.graph import Graph
from redundant_envs.compiler.tracing.listing import result_lines
from redundant_envs.compiler.tracing.number import Condition, Number, value_of
from redundant_envs.language.algebra import PRIMITIVES, arguments_of, is_physics

ALLOWED = (
    f"+ - * /, ** 2 to 4, comparisons of two, numbers, tuples, and calls of {', '.join(PRIMITIVES)} "
    "(from redundant_envs.algebra), abs, and functions marked @physics"
)
SINES = "take the sine and cosine as arguments, such as s1 and c1, or write s, c = sincos(x) with sincos of"
CONDITIONS = "join conditions by & and |, and write logical_not(condition) of redundant_envs.algebra"
INSTEAD = {
    "sqrt exp expm1 log floor where": "take the function of this name from redundant_envs.algebra",
    "abs absolute fabs": "write abs(x)",
    "max amax fmax maximum": "write maximum(a, b) with maximum of redundant_envs.algebra",
    "min amin fmin minimum": "write minimum(a, b) with minimum of redundant_envs.algebra",
    "clip clamp": "write clamp(x, lower, upper) with clamp of redundant_envs.algebra",
    "sin cos tan": f"{SINES} redundant_envs.algebra; a tangent is s / c",
    "tanh": "write 1.0 - 2.0 / (exp(2.0 * x) + 1.0), or squash(x, scale) of redundant_envs.algebra",
    "sign": "write where(x > 0.0, 1.0, where(x < 0.0, -1.0, 0.0))",
    "round rint around": "write floor(x + 0.5), which rounds halves up",
    "ceil": "write -floor(-x)",
    "int trunc fix": "write where(x < 0.0, -floor(-x), floor(x))",
    "mod fmod remainder": "write a - b * floor(a / b), which has the sign of b",
    "hypot norm dist": "write sqrt(x * x + y * y)",
    "square": "write x**2",
    "pow power float_power": "write a product, x**2 to x**4, 1.0 / x, sqrt(x) or exp(k * log(x))",
    "asin acos atan atan2 arcsin arccos arctan arctan2":
        "angles are arguments, such as phi1 of joint 1: there is no inverse of a sine here",
    "isnan": "write x != x",
    "bool any all logical_and logical_or logical_not": CONDITIONS,
    "select piecewise interp": "write where(condition, a, b), one inside the other for several pieces",
    "sort sorted": "write minimum(a, b) and maximum(a, b)",
    "range": "loop over plain numbers only, known before the motion",
}  # fmt: skip
"""Functions of Python, NumPy and math that are called by habit, and what to do instead."""
_INSTEAD = {name: what for names, what in INSTEAD.items() for name in names.split()}
TRACES = 8
"""How often a function from outside is traced: one that throws a coin is found but once in 128 times."""


def check(function: Any) -> int:
    """How many values a function returns; a ValueError that says what to write if it is outside the dialect,
    or computes something else when it is run again."""
    first = _traced(function)
    if is_own(function):
        return first[0]
    before = random_states()
    again = [_traced(function) for _ in range(TRACES - 1)]
    if any(other != first for other in again) or random_states() != before:
        raise ValueError(f"{_name(function)} {CHANGES}")
    return first[0]


CHANGES = (
    "draws a random number, or asks for the time, a counter or the like: it is run only once, and what it "
    "then got would stay for all steps and environments; draw outside, and give what you drew as a number: "
    "a field, which set_parameters and options of a reset set. What changes with the motion is a State or "
    "an argument"
)
"""What is said of functions that are not the same when they are run again."""


def computed_by(function: Any) -> str:
    """What a function of the dialect computes: texts are equal if all operations and constants are."""
    return _traced(function)[1]


def _traced(function: Any) -> tuple[int, str]:
    """Number of the values that a function returns, and the text of its operations."""
    if is_own(function) and getattr(function, "__closure__", function) is None:
        return _traced_once(function)  # what it computes cannot change
    return _trace(function)


def _trace(function: Any) -> tuple[int, str]:
    if not callable(function):
        raise ValueError(f"{function!r:.80} is no function; write one with 'def', marked @physics")
    name = _name(function)
    if not is_physics(function):
        raise ValueError(f"{name} is not marked; write @physics above its 'def'")
    try:
        names = arguments_of(function)
        graph = Graph()
        results = function(*(Number(graph, graph.load("argument", k)) for k in range(len(names))))
    except RecursionError:
        raise ValueError(f"{name} calls itself; write it without recursion") from None
    except Exception as error:
        file = getattr(getattr(function, "__code__", None), "co_filename", None)
        frame = next((f for f in traceback.extract_tb(error.__traceback__)[::-1] if f.filename == file), None)
        asked = (frame and _called(frame), getattr(error, "name", None))
        called = next((name for name in asked if name in _INSTEAD), None)
        what = str(error) if called is None or isinstance(error, NameError) else f"it calls {called}"
        fix = "write" if called is None else f"{_INSTEAD[called]}. Write"
        place = f" ({file}:{frame.lineno})" if frame else ""
        raise ValueError(f"{name}{place} is outside the physics dialect: {what}; {fix} {ALLOWED}") from None
    values = results if isinstance(results, tuple) else (results,)
    for value in values:
        if isinstance(value, bool | Condition):
            raise ValueError(
                f"{name} returns a condition; return numbers, such as where(condition, 1.0, 0.0)"
            )
        if not isinstance(value, Number | float | int):
            raise ValueError(
                f"{name} returns a {type(value).__name__}; return numbers: one, or a tuple, such as a, b"
            )
    return len(values), "\n".join(result_lines([*map(value_of, values)]))


_traced_once = functools.lru_cache(maxsize=512)(_trace)


def _name(function: Any) -> str:
    return f"{getattr(function, '__module__', '')}.{getattr(function, '__qualname__', repr(function))}"


def is_own(what: Any) -> bool:
    """Whether a function or a class is one of this package."""
    return str(getattr(what, "__module__", "")).partition(".")[0] == __name__.partition(".")[0]


def random_states() -> Any:
    """Where the random numbers stand that all modules share."""
    state: Any = np.random.get_state(legacy=False)
    inside = state["state"]
    return random.getstate(), state.get("has_gauss"), str(inside.get("pos", inside))


def _called(frame: traceback.FrameSummary) -> str | None:
    """Name of the function whose call a frame waits for, if its text is known and is a call."""
    text = linecache.getline(frame.filename, frame.lineno or 0)[frame.colno : frame.end_colno]
    with contextlib.suppress(SyntaxError):
        call = ast.parse(text.strip(), mode="eval").body
        if isinstance(call, ast.Call):
            return getattr(call.func, "attr", getattr(call.func, "id", None))
    return None
