"""Effects of users: functions, files, parameters and classes whose names are alike."""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from notebooks import ARM, Q0, QD0, cell, end_of, user_module

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects import Effect, Force, Gravity, LimitSpring, ViscousFriction
from redundant_envs.model.energy import kinetic_energy, potential_energy
from redundant_envs.model.programs import batch_simulator


def springs():
    """Forces, potentials and helpers of equal names in three cells, each with a different factor."""
    return [cell(k, f"Spring{k}", k, 2.0**k) for k in (1, 2, 3)]


def test_functions_of_one_name_in_two_cells_both_act():
    alike, apart = springs(), [cell(10 + k, f"Spring{k}", k, 2.0**k, apart=f"_{k}") for k in (1, 2, 3)]
    np.testing.assert_array_equal(end_of(*alike), end_of(*apart))
    assert not (end_of(*alike) == end_of(alike[0])).all()
    scene = rde.Scene(ARM, alike, tolerance=1e-9)
    motion = rde.simulate(scene, Q0, QD0, np.linspace(0.0, 1.0, 21)[1:])
    start = kinetic_energy(scene, Q0, QD0) + potential_energy(scene, Q0)
    assert np.abs(motion.kinetic_energy + motion.potential_energy - motion.work - start).max() < 1e-8


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
    class Drag(Effect):
        c: float = 0.3

        def hooks(self, arm):
            return (Force(1, force, {"rate": "phid2", "c": ".c"}),)
    """
    own, other = (user_module(tmp_path, name, text)["Drag"]() for name in ("viscous_friction", "drag"))
    packaged = ViscousFriction(0.5)
    np.testing.assert_array_equal(end_of(packaged, own), end_of(packaged, other))
    np.testing.assert_array_equal(end_of(own, packaged), end_of(other, packaged))


def test_functions_of_one_name_on_arrays_and_symbols():
    """Two functions with one name are two functions there, too."""
    sp = pytest.importorskip("sympy", reason="sympy is in the extra 'verify'")
    one, two = (cell(20 + k, "Spring", 1, float(k)).hooks(ARM)[0].function for k in (3, 5))
    x = sp.Symbol("x")
    for k, function in ((3, one), (5, two)):
        assert function(np.array([2.0]), 1.0) == -2.0 * k
        assert function(x, 1) == -float(k) * x


@physics
def push(value):
    return 1.0 * value


@dataclass(frozen=True)
class Pushes(Effect):
    """Pushes on the first joints."""

    def hooks(self, arm):
        numbers = enumerate(self.parameters())
        return tuple(Force(k, push, {"value": f".{name}"}) for k, name in numbers)


@dataclass(frozen=True)
class LimitSpringJoint1(Pushes):
    """Its parameter reads like limit_spring.joint1.lower without the dots."""

    lower: float = 0.7


@dataclass(frozen=True)
class Tip(Pushes):
    """Its parameters read like quantities of the arm."""

    x: float = 0.7
    vx: float = 0.2


@dataclass(frozen=True)
class W(Pushes):
    """A short name with numbers of short names, those of fields of lanes among them."""

    h: float = 0.7
    count: float = 0.2
    j: tuple[float, float] = (0.1, 0.3)


@dataclass(frozen=True)
class Plain(Pushes):
    """The same pushes under a name like no other."""

    a: tuple[float, ...]


@pytest.mark.parametrize("effect", [LimitSpringJoint1(), Tip(), W()], ids=["limit spring", "tip", "short"])
def test_parameters_that_read_like_others_are_rows_of_their_own(effect):
    beside, pushes = (Gravity(), LimitSpring("joint1", -2.0, 1.9)), tuple(effect.parameters().values())
    np.testing.assert_array_equal(end_of(*beside, effect), end_of(*beside, Plain(pushes)))


def test_a_subclass_with_another_function_is_itself():
    """The function of a subclass, which has the name of that of its base, is the one that acts."""
    base = cell(30, "Spring", 1, 2.0)
    force = cell(31, "Spring", 1, 7.0).hooks(ARM)[0]
    stiffer = type("Stiffer", (type(base),), {"hooks": lambda self, arm: (force,)})()
    apart = cell(32, "Spring", 1, 2.0, apart="_a"), cell(33, "Other", 1, 7.0, apart="_b")
    np.testing.assert_array_equal(end_of(base, stiffer), end_of(*apart))


def shown():
    """The listing of a scene, and the key of its compiled program."""
    scene = rde.Scene(ARM, springs())
    return f"{rde.listing(scene)}{batch_simulator(scene, False).key}"


@pytest.mark.parametrize("seed", ["1", "2"])
def test_a_program_and_its_key_do_not_depend_on_the_process(seed):
    """No address and no order of a set is in them."""
    code = "import sys; sys.path[:0] = sys.argv[1:]; from test_users_effects import shown; print(shown())"
    here = Path(__file__).parent
    run = subprocess.run(
        [sys.executable, "-c", code, str(here), str(here.parent)],
        capture_output=True, text=True, check=True, env={**os.environ, "PYTHONHASHSEED": seed},
    )  # fmt: skip
    assert run.stdout == shown() + "\n"


def test_scenes_that_differ_in_names_only_are_one_program():
    """Names of functions, classes and parameters do not change results."""
    other = type("Other", (Plain,), {})((0.1, 0.9))
    scenes = [rde.Scene(ARM, (effect,)) for effect in (Plain((0.7, 0.2)), Tip(), other, W())]
    *alike, last = (batch_simulator(scene, False).key for scene in scenes)
    assert len({*alike}) == 1
    assert last not in alike
