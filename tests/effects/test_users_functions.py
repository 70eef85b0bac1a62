"""Functions of users that are allowed, and messages for those that are not; they act as their code says."""

import functools
import math

import numpy as np
import pytest
from notebooks import ARM, Q0, QD0, acts_as, cell, end_of, notebook, user_module, with_force

import redundant_envs as rde
from redundant_envs.algebra import exp, physics, sincos, where
from redundant_envs.effects.hooks import Effect, Force
from redundant_envs.model.energy import kinetic_energy, potential_energy

PHI2 = Q0[1] - Q0[0]
K = 3.0
KS = np.array([3.0, 5.0])


# ---- allowed functions ---------------------------------------------------------------------------


@physics
def with_constant(x):
    return -K * x


@physics
def with_array_constant(x):
    return x * KS[1] - KS[0] * x


@physics
def with_default_of_a_helper(x):
    return twice(x)


def twice(x, k=2.0):
    return -k * x


@physics
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
    @physics
    def force(x):
        return -k * x

    return force


from_exec = {"physics": physics}
exec("@physics\ndef force(x):\n    return -11.0 * x", from_exec)


@pytest.mark.parametrize(
    ("function", "factor"),
    [
        (with_constant, -3.0),
        (with_array_constant, 2.0),
        (with_default_of_a_helper, -2.0),
        (in_other_words, 4.0),
        (closure(5.0), -5.0),
        (physics(lambda x: 2.0 * x), 2.0),
        (Holder().method, -7.0),
        (physics(Holder()), -7.0),
        (physics(functools.partial(lambda k, x: k * x, 6.0)), 6.0),
        (from_exec["force"], -11.0),
    ],
    ids=["constant", "array", "helper", "python", "closure", "lambda", "method", "object", "partial", "exec"],
)
def test_a_function_does_what_its_code_says(function, factor):
    assert acts_as(function, factor * PHI2)
    assert function(PHI2) == pytest.approx(factor * PHI2)


def test_a_constant_is_that_of_the_time_when_the_simulator_is_made():
    names, run = notebook()
    run(20, "k = 2.0\n@physics\ndef force(x):\n    return -k * x")
    assert acts_as(names["force"], -2.0 * PHI2)
    run(21, "k = 3.0")
    assert acts_as(names["force"], -3.0 * PHI2)


def test_a_force_may_be_a_constant():
    assert acts_as(physics(lambda x: 3), 3.0)
    assert acts_as(physics(lambda x: -2.5), -2.5)


def test_marked_functions_may_be_written_inside_a_function():
    @physics
    def twice(x):
        return 2.0 * x

    @physics
    def force(x):
        return -twice(
            x
        ) + 0.0 * twice (x)  # fmt: skip

    assert acts_as(force, -2.0 * PHI2)


def test_a_file_changed_after_its_import_is_what_was_imported(tmp_path):
    """Motion and energy alike, and so it is in a closure that is made later."""
    text = """
    from redundant_envs.algebra import physics

    def made(k):
        @physics
        def force(x):
            return -{} * k * x

        return force

    force = made(1.0)
    """
    names = user_module(tmp_path, "changing", text.format("2.0"))
    (tmp_path / "changing.py").write_text(text.format("100.0"))
    assert acts_as(names["force"], -2.0 * PHI2)
    assert acts_as(names["made"](3.0), -6.0 * PHI2)
    assert names["force"](PHI2) == -2.0 * PHI2


# ---- functions that are defined again ------------------------------------------------------------

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
        ("def shape(x):\n    if x > 0.0:\n        x = 2.0 * x\n    return x", "where\\(condition, a, b\\)"),
        ("def shape(x):\n    return force(x, x)", "calls itself"),
        ("shape = 3.0", "'float' object is not callable"),
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


def test_a_function_whose_code_is_replaced_is_the_new_one():
    """Tools that reload modules keep the function and replace its code, and its arguments."""
    names, run = notebook()
    run(9, "@physics\ndef shape(x):\n    return 1.0 * x")
    shape = names["shape"]
    assert acts_as(shape, PHI2)
    run(10, "@physics\ndef shape(x):\n    return 7.0 * x")
    shape.__code__ = names["shape"].__code__
    assert acts_as(shape, 7.0 * PHI2)
    run(11, "@physics\ndef shape(rate, x):\n    return rate - x")
    shape.__code__ = names["shape"].__code__
    assert acts_as(shape, QD0[1] - QD0[0] - PHI2, x="phi2", rate="phid2")


# ---- refused functions ---------------------------------------------------------------------------


@physics
def with_tanh(x):
    return math.tanh(x)


tanh = math.tanh


@physics
def with_bare_tanh(x):
    return tanh(x)


@physics
def with_numpy(x):
    return np.tanh(x)


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


@physics
def calls_one_with_a_branch(x):
    y = 2.0 * x
    return with_branch(y)


@physics
def a_list(x):
    return [x]


@physics
def a_condition(x):
    return x > 0.0


OF_ALGEBRA = "of redundant_envs.algebra"
TANH = "it calls tanh; write 1.0 - 2.0 / (exp(2.0 * x) + 1.0)"


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (
            with_tanh,
            ["with_tanh (", "test_users_functions.py:", "sqrt, exp", OF_ALGEBRA, TANH],
        ),
        (with_bare_tanh, ["with_bare_tanh (", TANH]),
        (with_numpy, ["with_numpy (", TANH, OF_ALGEBRA]),
        (with_default, ["'k'", "bind a number of the effect"]),
        (with_branch, ["where(condition, a, b)", "instead of if"]),
        (calls_one_with_a_branch, ["calls_one_with_a_branch (", "where(condition, a, b)"]),
        (with_recursion, ["with_recursion calls itself"]),
        (unmarked, ["not marked", "@physics"]),
        (two_values, ["returns 2 values", "Force needs 1"]),
        (a_list, ["a_list returns a list", "return numbers"]),
        (a_condition, ["returns a condition", "where(condition, 1.0, 0.0)"]),
        (3.0, ["3.0", "def"]),
    ],
    ids=lambda v: "" if isinstance(v, list) else getattr(v, "__name__", "number"),
)
def test_a_function_outside_the_dialect_says_what_to_write(function, words):
    with pytest.raises(ValueError) as error:
        with_force(function)
    message = str(error.value)
    for word in ["effects[0] (Odd), hook 0 (Force)", *words]:
        assert word in message
    assert len(message.splitlines()) <= 10


@pytest.mark.parametrize("function", [with_branch, calls_one_with_a_branch])
def test_the_line_is_that_of_the_mistake(function):
    with pytest.raises(
        ValueError, match=f"test_users_functions.py:{with_branch.__code__.co_firstlineno + 2}"
    ):
        with_force(function)


def test_tanh_and_sines_can_be_written():
    @physics
    def force(x):
        return 1.0 - 2.0 / (exp(2.0 * x) + 1.0)

    x = np.linspace(-3.0, 3.0, 7)
    np.testing.assert_allclose(force(x), np.tanh(x), rtol=1e-14, atol=1e-16)
    assert acts_as(force, np.tanh(PHI2))
    assert acts_as(physics(lambda x: sincos(x)[0] * where(x > 0.0, 2.0, 3.0)), 2.0 * np.sin(PHI2))
    assert acts_as(physics(lambda s1, c1: s1 * c1), np.sin(Q0[0]) * np.cos(Q0[0]), s1="s1")


def test_an_effect_may_be_all_of_a_users_own():
    """Its force is that of another one of the same numbers, written in another way."""

    class Inner(Effect):
        def hooks(self, arm):
            return (Force(1, physics(lambda position: -2.0 * position), {"position": "phi2"}),)

    np.testing.assert_array_equal(end_of(Inner()), end_of(cell(50, "Spring", 2, 2.0 / 1.5)))
