"""Effects of users: names that are alike, what a function may be, and where it may attach."""

import importlib.util
import linecache
import math
import os
import subprocess
import sys
import textwrap
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs import dialect
from redundant_envs.algebra import exp, physics
from redundant_envs.effects import Gravity, LimitSpring, ViscousFriction
from redundant_envs.effects.hooks import Actuation, Effect, Field, Force, Impact
from redundant_envs.evaluators import assemble, source
from redundant_envs.evaluators.arrays import PRIMITIVES
from redundant_envs.evaluators.binding import bind
from redundant_envs.evaluators.symbols import primitives as symbols
from redundant_envs.model.energy import kinetic_energy, potential_energy

ARM = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))
Q0 = np.array([-1.2, 0.4, -0.4, 0.9])
QD0 = np.array([0.5, -0.6, 0.9, 0.8])

CELL = """
from dataclasses import dataclass
from redundant_envs.algebra import physics
from redundant_envs.effects.hooks import Effect, Force

@physics
def {helper}(x, k):
    return {factor} * k * x

@physics
def {force}(position, k):
    return -{helper}(position, k)

@physics
def {energy}(position, k):
    return 0.5 * {helper}(position, k) * position

@dataclass(frozen=True)
class {kind}(Effect):
    k: float = 1.5

    def hooks(self, arm):
        bind = {{"position": "phi{joint}", "k": ".k"}}
        return (Force({joint} - 1, {force}, bind, potential={energy}),)
"""


def notebook_cell(number, text, module="__main__"):
    """What a notebook does with a cell: its text is known to linecache, its module is __main__."""
    name = f"<cell {number}>"
    text = textwrap.dedent(text)
    linecache.cache[name] = (len(text), None, text.splitlines(keepends=True), name)
    names = {"__name__": module}
    exec(compile(text, name, "exec"), names)
    return names


def user_module(folder, name, text):
    """A file of a user, imported."""
    path = folder / f"{name}.py"
    path.write_text(textwrap.dedent(text))
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return vars(module)


def cell(number, kind, joint, factor, module="__main__", apart=""):
    names = {n: f"{n}{apart}" for n in ("helper", "force", "energy")}
    text = CELL.format(kind=kind, joint=joint, factor=factor, **names)
    return notebook_cell(number, text, module)[kind]()


def end_of(*effects):
    batch = rde.BatchSimulator(rde.Scene(ARM, effects), 1)
    batch.set_state(Q0, QD0)
    for _ in range(5):
        batch.advance(np.zeros((1, 4)))
    return np.concatenate([batch.q, batch.qd])


def book(*effects):
    """Largest gap of the energy book of a second, J."""
    scene = rde.Scene(ARM, effects, tolerance=1e-9)
    motion = rde.simulate(scene, Q0, QD0, np.linspace(0.0, 1.0, 21)[1:])
    start = kinetic_energy(scene, Q0, QD0) + potential_energy(scene, Q0)
    return np.abs(motion.kinetic_energy + motion.potential_energy - motion.work - start).max()


# ---- functions and parameters of one name --------------------------------------------------------


@pytest.mark.long
def test_functions_of_one_name_in_two_cells_both_act():
    """Forces, potentials and helpers of equal names, each with a factor of its own."""
    alike = [cell(k, f"Spring{k}", k, 2.0**k) for k in (1, 2, 3)]
    apart = [cell(10 + k, f"Spring{k}", k, 2.0**k, apart=f"_{k}") for k in (1, 2, 3)]
    np.testing.assert_array_equal(end_of(*alike), end_of(*apart))
    assert not (end_of(*alike) == end_of(alike[0])).all()
    assert book(*alike) < 1e-8


def test_a_file_named_like_one_of_the_package(tmp_path):
    """A user's viscous_friction.force beside the one of the package, and its helper beside algebra's."""
    text = """
    from dataclasses import dataclass
    from redundant_envs.algebra import physics
    from redundant_envs.effects.hooks import Effect, Force

    @physics
    def force(rate, c):
        return -c * rate * rate * rate

    @dataclass(frozen=True)
    class {}(Effect):
        c: float = 0.3

        def hooks(self, arm):
            return (Force(1, force, {{"rate": "phid2", "c": ".c"}}),)
    """
    own = user_module(tmp_path, "viscous_friction", text.format("Drag"))["Drag"]()
    other = user_module(tmp_path, "drag", text.format("Drag"))["Drag"]()
    packaged = ViscousFriction(0.5)
    np.testing.assert_array_equal(end_of(packaged, own), end_of(packaged, other))
    np.testing.assert_array_equal(end_of(own, packaged), end_of(other, packaged))


def test_functions_of_one_name_on_arrays_and_symbols():
    """Identity decides there too: two functions with one name are two functions."""
    import sympy as sp

    one, two = (cell(20 + k, "Spring", 1, float(k)).hooks(ARM)[0].function for k in (3, 5))
    x = sp.Symbol("x")
    for k, function in ((3, one), (5, two)):
        assert bind(function, PRIMITIVES)(np.array([2.0]), 1.0) == -2.0 * k
        assert bind(function, symbols())(x, 1) == -float(k) * x


@physics
def push(value):
    return 1.0 * value


@dataclass(frozen=True)
class LimitSpringJoint1(Effect):
    """Its parameter reads like limit_spring.joint1.lower without the dots."""

    lower: float = 0.7

    def hooks(self, arm):
        return (Force(0, push, {"value": ".lower"}),)


@dataclass(frozen=True)
class Tip(Effect):
    """Its parameters read like quantities of the arm, its function like one of its parameters."""

    x: float = 0.7
    vx: float = 0.2

    def hooks(self, arm):
        return (Force(0, push, {"value": ".x"}), Force(1, push, {"value": ".vx"}))


@dataclass(frozen=True)
class W(Effect):
    """A short name with numbers of short names."""

    h: float = 0.7
    count: float = 0.2
    j: tuple[float, float] = (0.1, 0.3)

    def hooks(self, arm):
        return tuple(
            Force(k, push, {"value": name}) for k, name in enumerate((".h", ".count", ".j[0]", ".j[1]"))
        )


@dataclass(frozen=True)
class Plain(Effect):
    """The same pushes under a name like no other."""

    a: tuple[float, ...]

    def hooks(self, arm):
        return tuple(Force(k, push, {"value": f".a[{k}]"}) for k in range(len(self.a)))


@pytest.mark.parametrize(
    ("effect", "pushes"),
    [(LimitSpringJoint1(), (0.7,)), (Tip(), (0.7, 0.2)), (W(), (0.7, 0.2, 0.1, 0.3))],
    ids=["limit spring", "tip", "short"],
)
def test_parameters_that_read_like_others_are_rows_of_their_own(effect, pushes):
    beside = (Gravity(), LimitSpring("joint1", -2.0, 1.9))
    np.testing.assert_array_equal(end_of(*beside, effect), end_of(*beside, Plain(pushes)))


def test_parameters_of_one_identifier_are_refused():
    def named(key, field):
        own = {"key": key, "parameters": lambda self: {field: 1.0}, "hooks": lambda self, arm: ()}
        return type("Odd", (Plain,), own)((1.0,))

    with pytest.raises(ValueError, match=r"'a.b__c' and 'a.b.c'.*rename a field"):
        rde.Scene(ARM, (named("a", "b__c"), named("a.b", "c")))


def test_two_classes_of_one_name_are_told_apart_in_the_message():
    other = type("Gravity", (Plain,), {})
    with pytest.raises(ValueError, match=r"second 'gravity'; two classes share .* 'key' of its own"):
        rde.Scene(ARM, (Gravity(), other((1.0,))))
    with pytest.raises(ValueError, match=r"second 'gravity'; combine the two"):
        rde.Scene(ARM, (Gravity(), Gravity(1.0)))


def test_a_subclass_with_another_function_is_itself():
    """The function of a subclass, which has the name of that of its base, is the one that acts."""
    base = cell(30, "Spring", 1, 2.0)
    force = cell(31, "Spring", 1, 7.0).hooks(ARM)[0]
    stiffer = type("Stiffer", (type(base),), {"hooks": lambda self, arm: (force,)})()
    apart = cell(32, "Spring", 1, 2.0, apart="_a"), cell(33, "Other", 1, 7.0, apart="_b")
    np.testing.assert_array_equal(end_of(base, stiffer), end_of(*apart))


def test_names_do_not_depend_on_the_process():
    """The text is the key of the compiled module: no address and no order of a set is in it."""
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from test_users_effects import ARM, cell, rde, source\n"
        "print(source(rde.Scene(ARM, [cell(k, f'Spring{k}', k, 2.0**k) for k in (1, 2, 3)])))"
    )
    here = source(rde.Scene(ARM, [cell(k, f"Spring{k}", k, 2.0**k) for k in (1, 2, 3)]))
    for seed in ("1", "2"):
        run = subprocess.run(
            [sys.executable, "-c", code, str(Path(__file__).parent)],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        )
        assert run.stdout == here + "\n"


def test_readable_names_stay_where_nothing_clashes():
    text = source(rde.Scene(ARM, (Gravity(), ViscousFriction(0.1), cell(40, "Spring", 1, 2.0))))
    assert "def viscous_friction__force(" in text
    assert "def __main____force(" in text
    assert "__2(" not in text


def test_two_givers_of_one_quantity_are_refused():
    from redundant_envs.evaluators.quantities import calls

    @physics(gives="a")
    def first(x):
        return x

    @physics(gives="a")
    def second(x):
        return -x

    with pytest.raises(ValueError, match=r"'a' is given by both .*first and .*second"):
        calls(["a"], ["x"], (first, second), {})


# ---- what a function may be ----------------------------------------------------------------------


def with_force(function):
    """A scene whose one effect has a force on joint 2."""

    @dataclass(frozen=True)
    class Odd(Effect):
        def hooks(self, arm):
            return (Force(1, function, {"x": "phi2"}),)

    return rde.Scene(ARM, (Odd(),))


K = 3.0


@physics
def with_constant(x):
    return -K * x


@physics
def with_tanh(x):
    return math.tanh(x)


tanh = math.tanh


@physics
def with_bare_tanh(x):
    return tanh(x)


@physics
def with_sine(x):
    return math.sin(x)


@physics
def with_default(x, k=2.0):
    return -k * x


@physics
def with_branch(x):
    if x > 0.0:
        x = -x
    return x


@physics
def with_recursion(x):
    return with_recursion(-x)


def unmarked(x):
    return -x


@physics
def two_values(x):
    return x, x


class Holder:
    @physics
    def method(self, x):
        return -x


def closure(k):
    @physics
    def force(x):
        return -k * x

    return force


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (with_constant, ["with_constant", "test_users_effects.py:", "name K", "field", "{'k': '.k'}"]),
        (closure(3.0), ["closure", "name k", "argument"]),
        (with_tanh, ["math.tanh", "sqrt, exp", "exp(2.0 * x)"]),
        (with_bare_tanh, ["a call of tanh", "exp(2.0 * x)"]),
        (with_sine, ["math.sin", "s1 and c1"]),
        (with_default, ["without defaults"]),
        (with_branch, ["If", "where(condition, a, b)"]),
        (with_recursion, ["calls itself"]),
        (unmarked, ["not marked", "@physics"]),
        (two_values, ["returns 2 values", "Force needs 1"]),
        (physics(lambda x: -x), ["lambda", "def"]),
        (Holder().method, ["method", "plain function"]),
        (physics(type("Callable", (), {"__call__": lambda self, x: -x})()), ["def"]),
        (3.0, ["3.0", "def"]),
    ],
    ids=lambda v: "" if isinstance(v, list) else getattr(v, "__name__", "object"),
)
def test_a_function_outside_the_dialect_says_what_to_write(function, words):
    with pytest.raises(ValueError) as error:
        with_force(function)
    message = str(error.value)
    for word in ["effects[0] (Odd), hook 0 (Force)", *words]:
        assert word in message
    assert len(message.splitlines()) <= 10


def test_what_the_message_on_tanh_says_works():
    @physics
    def force(x):
        return 1.0 - 2.0 / (exp(2.0 * x) + 1.0)

    x = np.linspace(-3.0, 3.0, 7)
    np.testing.assert_allclose(bind(force, PRIMITIVES)(x), np.tanh(x), rtol=1e-14, atol=1e-16)


def test_marked_functions_may_be_written_inside_a_function():
    """A helper of the enclosing function is found, and both are indented."""

    @physics
    def twice(x):
        """A docstring
        of two lines."""
        return 2.0 * x  # twice(x) here is no call

    @physics
    def force(position):
        return -twice(
            position
        ) + 0.0 * twice (position)  # fmt: skip

    @dataclass(frozen=True)
    class Inner(Effect):
        def hooks(self, arm):
            return (Force(1, force, {"position": "phi2"}),)

    np.testing.assert_array_equal(end_of(Inner()), end_of(cell(50, "Spring", 2, 2.0 / 1.5)))


def test_a_function_without_source_says_what_to_do():
    names = {"physics": physics}
    exec("@physics\ndef force(x):\n    return -x", names)
    with pytest.raises(ValueError, match=r"no readable source.*file or a notebook cell"):
        with_force(names["force"])


def test_a_file_changed_after_its_import_is_noticed(tmp_path):
    """The text of the new file and the code of the old one would be two different forces."""
    text = "from redundant_envs.algebra import physics\n\n@physics\ndef force(x):\n    return {} * x\n"
    force = user_module(tmp_path, "changing", text.format("-1.0"))["force"]
    (tmp_path / "changing.py").write_text(text.format("100.0"))
    with pytest.raises(ValueError, match=r"changed after it was imported.*import it anew"):
        with_force(force)


def test_a_file_changed_after_a_closure_of_it_was_made_is_noticed(tmp_path):
    text = """\
from redundant_envs.algebra import physics

def made():
    @physics
    def helper(x):
        return {0} * x

    @physics
    def another(x):
        return 2.0 * x

    @physics
    def force(x):
        return {1} * {2}(x) + 0.0 * another(x) + 0.0 * helper(x)

    return force
"""
    path = tmp_path / "closures.py"
    force = user_module(tmp_path, "closures", text.format("2.0", "-1.0", "helper"))["made"]()
    with_force(force)
    for k, change in enumerate((("2.0", "100.0", "helper"), ("2.0", "-1.0", "another"))):
        force = user_module(tmp_path, f"closures{k}", text.format("2.0", "-1.0", "helper"))["made"]()
        (tmp_path / f"closures{k}.py").write_text(text.format(*change))
        with pytest.raises(ValueError, match=r"changed after it was imported.*import it anew"):
            with_force(force)
    with_force(user_module(tmp_path, "closures", path.read_text())["made"]())


AGAIN = {
    "helper": """
        @physics
        def shape(x):
            return {} * x
        """,
    "effect": """
        @physics
        def force(position, k):
            return -k * shape(position)

        @physics
        def energy(position, k):
            return 0.5 * k * shape(position) * position

        @dataclass(frozen=True)
        class Redone(Effect):
            k: float = 1.5

            def hooks(self, arm):
                return (Force(1, force, {"position": "phi2", "k": ".k"}, potential=energy),)
        """,
}


def notebook():
    """Cells of a notebook, which have their names in common; returns them and what runs one."""
    names = {
        "__name__": "__main__",
        "physics": physics,
        "Effect": Effect,
        "Force": Force,
        "dataclass": dataclass,
    }

    def run(number, text):
        cell_name = f"<redefined {number}>"
        text = textwrap.dedent(text)
        linecache.cache[cell_name] = (len(text), None, text.splitlines(keepends=True), cell_name)
        exec(compile(text, cell_name, "exec"), names)

    return names, run


def test_a_helper_that_is_defined_again_is_the_same_for_motion_and_energy():
    names, run = notebook()
    run(1, AGAIN["helper"].format("1.0"))
    run(2, AGAIN["effect"])
    energies = []
    for number, factor in ((3, "100.0"), (4, "1.0"), (5, None)):
        scene = rde.Scene(ARM, (names["Redone"](),), "dop853")
        motion = rde.simulate(scene, Q0, QD0, times=[0.0, 0.1, 0.2])
        q, qd = motion.q[..., :], motion.qd[..., :]
        total = kinetic_energy(scene, q, qd) + potential_energy(scene, q)
        np.testing.assert_allclose(total, total[0], rtol=1e-9)
        energies.append(potential_energy(scene, Q0))
        if factor:
            run(number, AGAIN["helper"].format(factor))
    plain = potential_energy(rde.Scene(ARM), Q0)
    np.testing.assert_allclose(energies[1] - plain, 100.0 * (energies[0] - plain), rtol=1e-12)
    assert energies[2] == energies[0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("@physics\ndef shape(x):\n    if x > 0.0:\n        x = 2.0 * x\n    return x", "If"),
        ("def shape(x):\n    return x", "a call of shape"),
        ("@physics\ndef shape(x):\n    return force(x, x)", "calls itself"),
        ("shape = 3.0", "a call of shape"),
    ],
)
def test_a_helper_that_is_defined_again_outside_the_dialect_is_refused(text, words):
    names, run = notebook()
    run(6, AGAIN["helper"].format("1.0"))
    run(7, AGAIN["effect"])
    rde.Scene(ARM, (names["Redone"](),))
    run(8, text)
    with pytest.raises(ValueError, match=words):
        rde.Scene(ARM, (names["Redone"](),))


def test_a_function_whose_code_is_replaced_is_read_anew():
    """Tools that reload a notebook's modules leave the function and give it other code."""
    names, run = notebook()
    run(9, AGAIN["helper"].format("1.0"))
    shape = names["shape"]
    assert bind(shape, PRIMITIVES)(1.0) == 1.0
    with_force(shape)
    run(10, AGAIN["helper"].format("7.0"))
    shape.__code__ = names["shape"].__code__
    assert bind(shape, PRIMITIVES)(1.0) == 7.0
    assert "7.0" in "".join(dialect.source_of(shape).lines)


# ---- where it may attach -------------------------------------------------------------------------


@physics
def spring(x, k):
    return -k * x


@physics
def energy(x, k):
    return 0.5 * k * x**2


@physics
def damped(x, rate, k):
    return -k * (x + rate)


@physics
def field_of(x):
    return 0.0 * x, 9.81


BIND = {"x": "phi2", "k": ".k"}


@pytest.mark.parametrize(
    ("hooks", "words"),
    [
        ((Force(4, spring, BIND),), ["joint is 4", "0 to 3", "joint1"]),
        ((Force("joint2", spring, BIND),), ["joint is 'joint2'", "0 to 3"]),
        ((Force(1, spring, {"x": "phi2", "k": ".stiffness"}),), ["'.stiffness'", "it has .k"]),
        ((Force(1, spring, {"x": "phi9", "k": ".k"}),), ["'phi9'", "phi1"]),
        ((Force(1, spring, {"x": "qdd1", "k": ".k"}),), ["'qdd1'", "follows from the forces"]),
        ((Force(1, spring, {"x": 2.0, "k": ".k"}),), ["2.0", "quotation marks"]),
        ((Force(1, spring, ["phi2", ".k"]),), ["bind", "mapping"]),
        (Force(1, spring, BIND), ["hooks gives", "tuple"]),
        ((Impact(1, ".lower", ".k", ".k", spring),), ["lower", "'.lower'", ".k"]),
        ((Force(1, damped, {**BIND, "rate": "phid2"}, potential=energy),), ["phid2", "conservative="]),
        ((Force(1, spring, BIND, conservative=spring),), ["no potential", "give the potential"]),
        ((Force(1, spring, BIND, potential=damped),), ["rate"]),
        ((Force(1, spring, BIND, stiffness=spring),), ["stiffness", "phi2", "parameters alone"]),
        ((Actuation(1, field_of, {"x": "command2"}),), ["returns 2 values", "Actuation needs 1"]),
        ((Field(spring, BIND),), ["returns 1 values", "Field needs 2"]),
    ],
)
def test_a_hook_that_does_not_fit_is_refused_by_the_scene(hooks, words):
    @dataclass(frozen=True)
    class Odd(Effect):
        k: float = 1.0

        def hooks(self, arm):
            return hooks

    with pytest.raises(ValueError) as error:
        rde.Scene(ARM, (Odd(),))
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize("key", ["my spring", "1st", "", "a..b", 3, "a-b"])
def test_a_key_that_cannot_be_a_name_is_refused(key):
    odd = type("Odd", (Plain,), {"key": key})
    with pytest.raises(ValueError, match="has the key"):
        rde.Scene(ARM, (odd((1.0,)),))


# ---- the energy book -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Spring(Effect):
    """A potential and nothing else said."""

    k: float = 8.0

    def hooks(self, arm):
        return (Force(1, spring, BIND, potential=energy),)


def test_a_force_that_is_its_potentials_derivative_is_booked_once():
    assert book(Spring()) < 1e-8
    assert assemble.assemble(rde.Scene(ARM, (Spring(),)), track_work=True).text.count("booked") == 0


@dataclass(frozen=True)
class Damped(Effect):
    """A force only part of which has a potential."""

    k: float = 8.0
    reserve: tuple[float, ...] = field(default=(1.0,))

    def hooks(self, arm):
        return (Force(1, damped, {**BIND, "rate": "phid2"}, potential=energy, conservative=spring),)


def test_a_force_that_is_partly_conservative_is_booked_in_both_places():
    assert book(Damped()) < 1e-8
