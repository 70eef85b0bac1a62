"""A replaced function, class or number is followed by the next simulator and the next process."""

import dataclasses
import importlib
import sys

import pytest

import redundant_envs as rde
from redundant_envs.compiler.backends.loaded import scene_key
from redundant_envs.language.algebra import physics, tolerance
from redundant_envs.model import programs
from redundant_envs.model.programs import environment_simulator
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


@pytest.mark.parametrize("member", MEMBERS)
def test_a_replacement_is_followed_in_this_process_and_the_next_one(member, monkeypatch):
    owner, name, made = MEMBERS[member]
    before = environment_simulator(SCENE, ReachTask()).identity
    found = {before}
    names = {scene_key(f"{METHODS['rk4']}", programs.__name__)}
    assert "" not in names
    for scale in (0.5, 0.25):
        with monkeypatch.context() as context:
            put(context, owner, name, made(scale))
            found.add(environment_simulator(SCENE, ReachTask()).identity)
            names.add(scene_key(f"{METHODS['rk4']}", programs.__name__) or f"traced with {scale}")
    assert len(found) == 1 + 2
    assert len(names) == 3
    assert environment_simulator(SCENE, ReachTask()).identity == before


def test_a_file_that_has_the_name_of_a_module_of_python_is_followed(monkeypatch, tmp_path):
    assert scene_key("", programs.__name__)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "pyclbr", raising=False)
    (tmp_path / "pyclbr.py").write_text("def near(distance, reach): return 2.0 * distance / reach")
    monkeypatch.setattr(reach, "near_term", as_near(importlib.import_module("pyclbr").near))
    assert scene_key("", programs.__name__) == ""
    monkeypatch.delitem(sys.modules, "pyclbr")
    assert scene_key("", programs.__name__) == ""
