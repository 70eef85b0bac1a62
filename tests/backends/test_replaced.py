"""A replaced function, class or number is followed by the next simulator and the next process."""

import dataclasses
import importlib
import sys

import pytest

import redundant_envs as rde
from redundant_envs.compiler.backends.loaded import loaded_code
from redundant_envs.language.algebra import physics, tolerance
from redundant_envs.model import programs
from redundant_envs.model.programs import batch_simulator, environment_simulator
from redundant_envs.scenes.tableaus import METHODS
from redundant_envs.simulator.lane import faults
from redundant_envs.tasks import reach
from redundant_envs.tasks.reach import ReachTask

e = rde.effects
SCENE = rde.Scene(rde.FourR((1.0,) * 4, (1.0,) * 4), (e.EffortLimits((1.0,) * 4),), integrator="rk4")
NEAR, TERMS = reach.near_term, ReachTask.reward_functions
SCALE = 1.0


def as_near(function):
    return physics(function, gives="near_term", takes=("distance", "reach"))


def reads_a_global(scale):
    globals()["SCALE"] = scale
    return as_near(lambda distance, reach: SCALE * tolerance(distance, reach))


def has_a_cell(scale):
    return as_near(lambda distance, reach: scale * tolerance(distance, reach))


def made_by_the_module(scale):
    own = {}
    exec(f"def near_term(distance, reach): return {scale} * tolerance(distance, reach)", vars(reach), own)
    return as_near(own["near_term"])


def of_a_class(scale):
    """A term of the reward in its place among the others."""
    return lambda self, scene: tuple(has_a_cell(scale) if f is NEAR else f for f in TERMS(self, scene))


MEMBERS = {
    **{
        made.__name__: (reach, "near_term", made) for made in (reads_a_global, has_a_cell, made_by_the_module)
    },
    "code": (NEAR, "__code__", lambda scale: made_by_the_module(scale).__code__),
    "method": (ReachTask, "reward_functions", of_a_class),
    "constant": (faults, "LARGEST_ANGLE", lambda scale: scale),
    "entry of a table": (METHODS, "rk4", lambda scale: dataclasses.replace(METHODS["rk4"], b=(scale,) * 4)),
}


def put(monkeypatch, owner, name, value):
    if isinstance(owner, dict):
        monkeypatch.setitem(owner, name, value)
    else:
        monkeypatch.setattr(owner, name, value)


def code():
    return loaded_code(programs.__name__).digest


@pytest.mark.parametrize("member", MEMBERS)
def test_a_replacement_is_followed_in_this_process_and_the_next_one(member, monkeypatch):
    owner, name, made = MEMBERS[member]
    before = environment_simulator(SCENE, ReachTask()).identity
    found = {before}
    names = {(code(), METHODS["rk4"])}
    assert code()
    for scale in (0.5, 0.25):
        with monkeypatch.context() as context:
            put(context, owner, name, made(scale))
            found.add(environment_simulator(SCENE, ReachTask()).identity)
            names.add((code() or f"traced with {scale}", METHODS["rk4"]))
    assert len(found) == 1 + 2
    assert len(names) == 3
    assert environment_simulator(SCENE, ReachTask()).identity == before


def law(x):
    return x


def drag_with(cell):
    @physics
    def drag(phid1, k):
        return -cell * SCALE * law(k * phid1)

    return drag


drag = drag_with(1.0)


@dataclasses.dataclass(frozen=True)
class Drag(e.Effect):
    k: float = 1.0

    def hooks(self, arm):
        return (e.Force(0, drag, {"k": ".k"}),)


def test_functions_from_outside_are_followed_too(monkeypatch):
    """Also by simulators of a scene that was made before."""
    here, scene = sys.modules[__name__], rde.Scene(SCENE.robot, (Drag(),), integrator="euler")
    found = [batch_simulator(scene, False).identity]
    for owner, name, value in (
        (here, "SCALE", 3.0), (here, "law", lambda x: x + x), (here, "drag", drag_with(5.0)),
        (Drag, "hooks", lambda self, arm: (e.Force(1, drag, {"k": ".k"}),)),
    ):  # fmt: skip
        monkeypatch.setattr(owner, name, value)
        found.append(batch_simulator(scene, False).identity)
    assert len({*found}) == len(found)


def test_a_file_that_has_the_name_of_a_module_of_python_is_followed(monkeypatch, tmp_path):
    assert code()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "pyclbr", raising=False)
    (tmp_path / "pyclbr.py").write_text("def near(distance, reach): return 2.0 * distance / reach")
    monkeypatch.setattr(reach, "near_term", as_near(importlib.import_module("pyclbr").near))
    assert not code()
    monkeypatch.delitem(sys.modules, "pyclbr")
    assert not code()


def test_effects_that_users_register_leave_what_is_told_of_the_package_as_it_was(monkeypatch):
    before = code()
    monkeypatch.setitem(e.REGISTRY, "Drag", Drag)
    assert before == code() != ""
