"""The physics dialect: what a function marked @physics may say, and that the checker sees the rest."""

import ast
import importlib
import inspect
import pkgutil
import textwrap

import pytest

import redundant_envs
from redundant_envs import algebra, dialect
from redundant_envs.algebra import PRIMITIVES, gives_of, is_physics, physics, sqrt

PLACES = ("algebra", "robots", "effects", "tasks", "evaluators.assemble")


def marked_functions():
    """Every function marked @physics in the package, by its full name."""
    found = {}
    for place in PLACES:
        module = importlib.import_module(f"redundant_envs.{place}")
        modules = [module]
        if hasattr(module, "__path__"):
            modules += [
                importlib.import_module(m.name)
                for m in pkgutil.walk_packages(module.__path__, f"{module.__name__}.")
            ]
        for m in modules:
            for value in vars(m).values():
                if inspect.isfunction(value) and is_physics(value) and value.__module__ == m.__name__:
                    found[f"{m.__name__}.{value.__name__}"] = value
    return found


FUNCTIONS = marked_functions()


def violations(source, names):
    """What a function's text has that the dialect does not allow, as "line: what"."""
    function = ast.parse(textwrap.dedent(source)).body[0]
    return [f"{line}: {what}" for line, what in dialect.violations(function, names)]


def test_the_scan_finds_the_physics():
    """The functions of both arms, of the effects and of the task are all looked at."""
    from redundant_envs.model.arms import RPRP, FourR
    from redundant_envs.tasks.reach import ReachTask

    scanned = set(FUNCTIONS.values())
    arms = (*RPRP.functions, *FourR.functions)
    assert set(arms) <= scanned
    for arm in (RPRP, FourR):
        assert {arm.column_norms, arm.coordinates_of_joints} <= scanned
        robot = arm((1, 1, 1, 1), (1,) * arm.num_lengths)
        for effect in effects_of(robot):
            for hook in effect.hooks(robot):
                used = [hook.function, getattr(hook, "potential", None), getattr(hook, "conservative", None)]
                assert {f for f in used if f is not None} <= scanned
    assert set(ReachTask.begin_functions) <= scanned
    assert {algebra.clamp, algebra.squash, algebra.tolerance} <= scanned


def effects_of(robot):
    """One of every effect that fits an arm."""
    effects = redundant_envs.effects
    joint = "r1" if robot.kind == "RPRP" else "joint1"
    found = [
        effects.Gravity(),
        effects.ViscousFriction(0.1),
        effects.EffortLimits(1.0),
        effects.LimitSpring(joint, -1.0, 1.0),
    ]
    if robot.kind == "RPRP":
        found.append(effects.CentringSpring((1.0, 1.0), (0.0, 0.0), (1.0, 1.0)))
    return found


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_function_is_dialect(name):
    """Every marked function keeps to the dialect."""
    function = FUNCTIONS[name]
    assert violations(inspect.getsource(function), function.__globals__) == []


@pytest.mark.parametrize("name", sorted(n for n, f in FUNCTIONS.items() if gives_of(f)))
def test_function_returns_what_it_gives(name):
    """As many values are returned as quantities are named, and no quantity twice."""
    function = FUNCTIONS[name]
    gives = gives_of(function)
    assert len(set(gives)) == len(gives)
    last = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0].body[-1]
    if isinstance(last.value, ast.Tuple):
        assert len(last.value.elts) == len(gives)
    elif not isinstance(last.value, ast.Call):
        assert len(gives) == 1


BROKEN = {
    "import": "import math\nreturn x",
    "import from": "from math import sin\nreturn x",
    "if": "if x > 0.0:\n    y = x\nreturn x",
    "conditional expression": "return x if x > 0.0 else y",
    "for": "for i in (1, 2):\n    x = x + i\nreturn x",
    "while": "while x > 0.0:\n    x = x - 1.0\nreturn x",
    "comprehension": "return (x for x in (x, y))",
    "subscript": "return x[0]",
    "attribute": "return x.real",
    "method": "return x.sum()",
    "lambda": "f = lambda z: z\nreturn x",
    "inner function": "def f(z):\n    return z\nreturn f(x)",
    "sin": "return sin(x)",
    "numpy": "return np.sin(x)",
    "and": "return where((x > 0.0) and (y > 0.0), x, y)",
    "not": "return where(not x, x, y)",
    "chained comparison": "return where(0.0 < x < 1.0, x, y)",
    "is": "return where(x is y, x, y)",
    "floor division": "return x // y",
    "modulo": "return x % y",
    "matrix product": "return x @ y",
    "unary plus": "return +x",
    "invert": "return where(~(x > 0.0), x, y)",
    "list": "return [x, y]",
    "text": "return 'x'",
    "true": "return where(True, x, y)",
    "complex": "return x + 1j",
    "augmented assignment": "x += 1.0\nreturn x",
    "annotated assignment": "z: float = x\nreturn z",
    "chained assignment": "z = w = x\nreturn z",
    "walrus": "return (z := x) + z",
    "global name": "return x * TWO",
    "name before it is assigned": "z = w + x\nw = y\nreturn z",
    "no return": "z = x",
    "empty return": "return",
    "early return": "return x\nreturn y",
    "assert": "assert x\nreturn x",
    "raise": "raise x",
    "unmarked function": "return unmarked(x)",
    "unmarked builtin": "return max(x, y)",
    "keyword": "return minimum(x, b=y)",
    "star": "return minimum(*x)",
    "variable exponent": "return x**y",
    "half exponent": "return x**0.5",
    "negative exponent": "return x**-1",
    "formatted": "return f'{x}'",
    "second docstring": "'one'\n'two'\nreturn x",
}

NAMES = {
    **{p: getattr(algebra, p) for p in PRIMITIVES},
    "clamp": algebra.clamp,
    "unmarked": lambda x: x,
    "TWO": 2.0,
}


@pytest.mark.parametrize("what", sorted(BROKEN))
def test_the_checker_sees(what):
    """Each deliberate break of the dialect is found."""
    source = "def f(x, y):\n" + textwrap.indent(BROKEN[what], "    ")
    assert violations(source, NAMES)


@pytest.mark.parametrize(
    "source",
    [
        "def f(x, y=1.0):\n    return x",
        "def f(*x):\n    return 1.0",
        "def f(**x):\n    return 1.0",
        "def f(*, x):\n    return x",
        "class f:\n    pass",
        "async def f(x):\n    return x",
    ],
)
def test_the_checker_sees_the_head(source):
    """Arguments are plain names."""
    assert violations(source, NAMES)


def test_the_checker_passes_the_whole_dialect():
    """Everything that is allowed, in one function."""
    source = '''
    def f(x, y):
        """Docstring."""
        a, b = clamp(x, -1.0, 1), -y
        z = where((a > 0.0) & (b <= 2.0) | (a == b), sqrt(abs(a)) / 2, exp(b) ** 2)
        return minimum(z, a), maximum(floor(z), b) - x * y + 1.0
    '''
    assert violations(source, NAMES) == []


def _plain(x):
    return 2.0 * x


@physics
def _calls_unmarked(x):
    return sqrt(_plain(x))


@physics
def _calls_marked(x):
    return sqrt(algebra_clamp(x, 0.0, 1.0))


algebra_clamp = algebra.clamp


def test_a_call_of_an_unmarked_function_is_found():
    """The callee is looked up where the function stands; the mark decides."""
    source = inspect.getsource(_calls_unmarked)
    assert violations(source, _calls_unmarked.__globals__) == ["3: a call of _plain"]
    assert violations(inspect.getsource(_calls_marked), _calls_marked.__globals__) == []


def test_a_primitive_of_another_library_is_found():
    """A name of a primitive must be the dialect's own."""
    import math

    source = "def f(x):\n    return sqrt(x)"
    assert violations(source, {"sqrt": math.sqrt})
    assert violations(source, {"sqrt": algebra.sqrt}) == []
