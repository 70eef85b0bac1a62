"""What a function of the physics dialect may say, read from its text and checked with its names.

The compiled core copies the text of a function, the other evaluators run its code. Both are right only
if the text is that of the code and says nothing outside the dialect, so functions of users are checked
before a scene takes them, and the message says what to write instead.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import inspect
import types
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from redundant_envs import algebra
from redundant_envs.algebra import PRIMITIVES, is_physics

OPERATORS = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow, ast.BitAnd, ast.BitOr)
COMPARISONS = (ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.Eq, ast.NotEq)
EXPONENTS = (2, 3, 4)
"""The exponents that the compiled dialect knows."""

ALLOWED = f"{', '.join(PRIMITIVES)} (from redundant_envs.algebra), abs, and functions marked @physics"


class Source(NamedTuple):
    """The text of a function.

    Attributes
    ----------
    lines : its lines from ``def`` on
    node : its syntax tree; lines are counted from 1 at ``def``
    place : file and line of ``def``
    """

    lines: tuple[str, ...]
    node: ast.FunctionDef
    place: str


def source_of(function: Callable[..., Any]) -> Source:
    """The text of a function, read once; ValueError if there is none."""
    return _source_of(function, getattr(function, "__code__", None))


@functools.cache
def _source_of(function: Any, code: Any) -> Source:
    """The text of a function as long as it has this code, which notebooks may replace."""
    name = f"{function.__module__}.{function.__qualname__}"
    if function.__name__ == "<lambda>":
        raise ValueError(
            f"{name} is a lambda; write it with 'def' and the mark @physics: the simulator is compiled "
            "from its text"
        )
    try:
        text = inspect.getsource(function)
        first = inspect.getsourcelines(function)[1]
        file = inspect.getsourcefile(function)
    except (OSError, TypeError):
        raise ValueError(
            f"{name} has no readable source, and the simulator is compiled from it; define the function in "
            "a file or a notebook cell, not in exec or an interactive prompt"
        ) from None
    # A function that stands inside another one is indented: it is read as part of a block.
    indented = text[:1].isspace()
    node: Any = None
    with contextlib.suppress(SyntaxError):
        tree: Any = ast.parse("if True:\n" + text if indented else text)
        node = tree.body[0].body[0] if indented else tree.body[0]
    if not isinstance(node, ast.FunctionDef):
        raise ValueError(changed(function, f"{file}:{first}"))
    shift = node.lineno - 1
    place = f"{file}:{first + shift - indented}"
    lines = text.splitlines()[shift - indented :]
    for part in ast.walk(node):
        if isinstance(part, ast.expr | ast.stmt):
            part.lineno -= shift
    return Source(tuple(lines), node, place)


def changed(function: Any, place: str) -> str:
    """The message on a function whose text is that of another one."""
    return (
        f"{function.__module__}.{function.__qualname__} is not what stands at {place}; the file was changed "
        "after it was imported, or another decorator wraps the function: import it anew, with @physics as "
        "its only decorator"
    )


def same_code(function: Any, node: ast.FunctionDef) -> bool:
    """Whether some text of the dialect compiles to the code of a function."""
    code = function.__code__

    def facts(c: types.CodeType) -> Any:
        constants = [repr(x) for x in c.co_consts if x is not None and not isinstance(x, str)]
        return c.co_name, c.co_code, c.co_names, c.co_varnames, c.co_freevars, constants

    statement: Any = node
    if code.co_freevars:  # as it stood in a function that has these names
        around: Any = ast.parse(f"def around({', '.join(code.co_freevars)}):\n    pass").body[0]
        around.body = [node]
        statement = around
    compiled = compile(ast.Module([statement], []), code.co_filename, "exec", dont_inherit=True)
    for _ in range(2 if code.co_freevars else 1):
        compiled = [c for c in compiled.co_consts if isinstance(c, types.CodeType)][-1]
    return facts(compiled) == facts(code)


def names_in(function: Any) -> dict[str, Any]:
    """What the names of a function that it does not assign itself stand for, where they are known."""
    code = function.__code__
    found = {n: function.__globals__[n] for n in code.co_names if n in function.__globals__}
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        try:
            found[name] = cell.cell_contents
        except ValueError:  # not assigned yet
            continue
    return found


def meanings(function: Any) -> tuple[Any, ...]:
    """The code of a function and what it calls now, all that the dialect needs to know of it.

    Names are looked up anew each time: a notebook may define a helper again after the function that calls
    it. Whatever is kept of a function is kept by its meaning; a name that may not be called is None there.
    """
    names = names_in(function)
    return function.__code__, tuple((n, x if may_call(n, names) else None) for n, x in names.items())


def callees(function: Any) -> tuple[Callable[..., Any], ...]:
    """The marked functions that a function calls now."""
    return tuple(x for n, x in names_in(function).items() if n not in PRIMITIVES and is_physics(x))


def may_call(name: str, names: Mapping[str, Any]) -> bool:
    """Whether the dialect may call ``name``, given what names stand for."""
    if name == "abs":
        return "abs" not in names
    if name in PRIMITIVES:
        return names.get(name) is getattr(algebra, name)
    return is_physics(names.get(name))


def violations(function: ast.stmt, names: Mapping[str, Any]) -> list[tuple[int, str]]:
    """What the text of a function has that the dialect does not allow: its line, and what it is."""
    found: list[tuple[int, str]] = []

    def complain(node: Any, what: str) -> None:
        found.append((getattr(node, "lineno", 0), what))

    if not isinstance(function, ast.FunctionDef):
        return [(0, f"{type(function).__name__} is not a function")]
    a = function.args
    if a.defaults or a.kw_defaults or a.vararg or a.kwarg or a.kwonlyargs or a.posonlyargs:
        complain(function, "arguments other than plain ones")
    known = {x.arg for x in a.args}

    def expression(node: ast.expr) -> None:
        if isinstance(node, ast.Constant):
            if type(node.value) not in (int, float):
                complain(node, f"constant {node.value!r}")
        elif isinstance(node, ast.Name):
            if node.id not in known:
                complain(node, f"name {node.id} is neither an argument nor assigned before")
        elif isinstance(node, ast.Tuple):
            for x in node.elts:
                expression(x)
        elif isinstance(node, ast.BinOp):
            if not isinstance(node.op, OPERATORS):
                complain(node, f"operator {type(node.op).__name__}")
            if isinstance(node.op, ast.Pow) and not (
                isinstance(node.right, ast.Constant) and node.right.value in EXPONENTS
            ):
                complain(node, "an exponent other than 2, 3, 4")
            expression(node.left)
            expression(node.right)
        elif isinstance(node, ast.UnaryOp):
            if not isinstance(node.op, ast.USub):
                complain(node, f"operator {type(node.op).__name__}")
            expression(node.operand)
        elif isinstance(node, ast.Compare):
            if len(node.ops) != 1 or not isinstance(node.ops[0], COMPARISONS):
                complain(node, "a comparison that is chained or not of numbers")
            expression(node.left)
            for x in node.comparators:
                expression(x)
        elif isinstance(node, ast.Call):
            if not isinstance(node.func, ast.Name):
                complain(node, f"a call of {ast.unparse(node.func)}, which is no plain name")
            elif node.func.id in known or not may_call(node.func.id, names):
                complain(node, f"a call of {node.func.id}")
            if node.keywords:
                complain(node, "keyword arguments")
            for x in node.args:
                expression(x)
        else:
            complain(node, type(node).__name__)

    body = list(function.body)
    if body and isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant):
        if not isinstance(body[0].value.value, str):
            complain(body[0], "an expression that does nothing")
        body = body[1:]
    if not body or not isinstance(body[-1], ast.Return) or body[-1].value is None:
        complain(function, "no value returned at the end")
    for i, statement in enumerate(body):
        if isinstance(statement, ast.Assign):
            expression(statement.value)
            targets = statement.targets
            if len(targets) != 1:
                complain(statement, "two assignments in one")
            parts = targets[0].elts if isinstance(targets[0], ast.Tuple) else [targets[0]]
            for t in parts:
                if isinstance(t, ast.Name):
                    known.add(t.id)
                else:
                    complain(statement, f"assignment to {type(t).__name__}")
        elif isinstance(statement, ast.Return) and statement.value is not None:
            if i != len(body) - 1:
                complain(statement, "a return before the end")
            expression(statement.value)
        else:
            complain(statement, type(statement).__name__)
    return found


def check(function: Any) -> None:
    """Refuse a function that is outside the dialect, or that calls one; the message says what to write."""
    waiting: list[tuple[Any, tuple[Any, ...]]] = [(function, ())]
    seen: set[Any] = set()
    while waiting:
        one, callers = waiting.pop()
        if one in callers:
            raise ValueError(f"{one.__module__}.{one.__qualname__} calls itself; write it without recursion")
        if one not in seen:
            seen.add(one)
            waiting += [(called, (*callers, one)) for called in _check_alone(one)]


def _check_alone(function: Any) -> tuple[Callable[..., Any], ...]:
    """Refuse a function that is outside the dialect; returns the marked functions that it calls."""
    if isinstance(function, types.MethodType):
        raise ValueError(
            f"{function.__qualname__} is a method; write a plain function and bind the effect's numbers to "
            "its arguments, as in Force(joint, function, {'k': '.k'})"
        )
    if not isinstance(function, types.FunctionType):
        raise ValueError(f"{function!r:.80} is no function written with 'def'; write one, marked @physics")
    _check_text(function, meanings(function))
    return callees(function)


@functools.cache
def _check_text(function: Any, meaning: tuple[Any, ...]) -> None:
    """Refuse a function that is outside the dialect as long as it means this."""
    name = f"{function.__module__}.{function.__qualname__}"
    source = source_of(function)
    if not is_physics(function):
        raise ValueError(f"{name} ({source.place}) is not marked; write @physics above its 'def'")
    names = names_in(function)
    found = violations(source.node, names)
    if found:
        line, what = found[0]
        file, _, first = source.place.rpartition(":")
        raise ValueError(
            f"{name} ({file}:{int(first) + max(line, 1) - 1}) has {what}, which is outside the physics "
            f"dialect; {_instead(what)}"
        )
    if not same_code(function, source.node):
        raise ValueError(changed(function, source.place))


def _instead(what: str) -> str:
    """What to write instead of something that the dialect does not allow."""
    if what.startswith("a call of"):
        if any(what.endswith(end) or f"{end}," in what for end in ("sin", "cos")):
            return "take sines and cosines of the arm's angles as arguments of their names, such as s1 and c1"
        more = " (tanh(x) is 1.0 - 2.0 / (exp(2.0 * x) + 1.0))" if "tanh" in what else ""
        return f"call only {ALLOWED}{more}"
    if what.startswith("name "):
        return (
            "make it an argument: a number of the effect is a field k of its class, bound by {'k': '.k'}, "
            "and a constant is written as a number"
        )
    if what.startswith("arguments"):
        return "give it plain arguments without defaults; bind numbers of the effect by {'k': '.k'}"
    if what.startswith(("If", "For", "While")):
        return "write where(condition, a, b), and everything else in straight lines"
    if "exponent" in what:
        return "write a product, sqrt or exp"
    return f"write + - * /, ** 2 to 4, comparisons of two, numbers, tuples, and calls of {ALLOWED}"


def results_of(function: Any) -> int:
    """Number of values that a function of the dialect returns."""
    last: Any = source_of(function).node.body[-1]
    value = last.value
    if isinstance(value, ast.Tuple):
        return len(value.elts)
    if isinstance(value, ast.Call) and isinstance(value.func, ast.Name):
        called = names_in(function).get(value.func.id)
        if value.func.id not in PRIMITIVES and is_physics(called):
            return results_of(called)
    return 1


def renamed(function: Any, name: str, name_of: Callable[[Any], str]) -> str:
    """The text of a function under another name, and so the marked functions that it calls."""
    source, names = source_of(function), names_in(function)
    places = [
        (part.func.lineno, part.func.col_offset, part.func.id, name_of(names[part.func.id]))
        for part in ast.walk(source.node)
        if isinstance(part, ast.Call) and isinstance(part.func, ast.Name)
        if part.func.id not in PRIMITIVES and is_physics(names.get(part.func.id))
    ]
    lines = list(source.lines)
    for line, column, old, new in sorted(places, reverse=True):
        raw = lines[line - 1].encode()  # columns of the syntax tree count bytes
        lines[line - 1] = (raw[:column] + new.encode() + raw[column + len(old.encode()) :]).decode()
    lines[0] = lines[0].lstrip().replace(f"def {function.__name__}", f"def {name}", 1)
    return "\n".join(lines) + "\n"
