"""Keys of programs: equal where machine code may be shared, in every process, and different otherwise.

A replaced function, class or number is followed by the next simulator and the next process.
"""

import dataclasses
import importlib
import sys
from pathlib import Path

import pytest

import redundant_envs as rde
from redundant_envs.compiler.backends import cache, llvm
from redundant_envs.compiler.backends.loaded import loaded_code
from redundant_envs.compiler.tracing.flow import Kernel, Program
from redundant_envs.compiler.tracing.passes.stages import Subroutine
from redundant_envs.language.algebra import physics, tolerance
from redundant_envs.model import programs
from redundant_envs.model.programs import batch_simulator, environment_simulator
from redundant_envs.scenes.scene import Scene
from redundant_envs.scenes.tableaus import METHODS
from redundant_envs.simulator.lane import faults
from redundant_envs.simulator.lane.fields import STATE, Layout, Variable
from redundant_envs.simulator.lane.memory import traced
from redundant_envs.tasks import reach
from redundant_envs.tasks.reach import ReachTask

e = rde.effects
ROOT = Path(rde.__file__).parents[1]
FOUR_R = rde.FourR((1,) * 4, (1,) * 4)
BASE = Scene(FOUR_R, (e.Gravity(9.81), e.ViscousFriction(0.1)), control_dt=0.01, substeps=2)


def key(scene, track_work=False):
    return batch_simulator(scene, track_work).key()


def test_scenes_that_differ_in_numbers_have_one_program():
    other = rde.FourR((1, 2, 3, 4), (0.5,) * 4)
    effects = (e.Gravity(1.6, (0.6, -0.7)), e.ViscousFriction((0.1, 0.2, 0.3, 0.4)))
    assert key(Scene(other, effects, control_dt=0.02, substeps=5)) == key(BASE)


def test_scenes_that_differ_otherwise_have_programs_of_their_own():
    gravity, friction = BASE.effects
    changes = [
        {}, {"effects": (gravity,)}, {"effects": (friction, gravity)}, {"substeps": 1}, {"integrator": "rk4"},
        {"integrator": "euler"}, {"integrator": "dop853", "substeps": 1}, {"actuation": "generalized"},
        {"tolerance": 1e-6, "substeps": 1}, {"robot": rde.RPRP((1,) * 4, (1, 1))},
    ]  # fmt: skip
    keys = [key(dataclasses.replace(BASE, **change)) for change in changes] + [key(BASE, True)]
    limited = Scene(FOUR_R, (gravity, e.EffortLimits((1.0,) * 4)), "euler")
    keys += [key(limited), environment_simulator(limited, ReachTask()).key()]
    assert len(set(keys)) == len(keys)


def test_programs_are_told_apart_by_the_places_of_arguments_whatever_they_are_called():
    """A listing with their names takes them for one."""
    fields = Layout([Variable(name, "", "", STATE) for name in ("x", "v")])

    def printed(function, names):
        rate = Subroutine(function, 1, 1, names)
        p = Kernel("probe", {"x": "f64"})
        p.call(traced("work", fields, lambda lane: lane.set(["v"], rate(lane.x, lane.v))), x=p["x"])
        return cache.identity(Program([p]))

    one = printed(lambda k, g: (2.0 * k,), ("k", "g"))
    assert one == printed(lambda g, k: (2.0 * g,), ("k", "g"))
    assert one != printed(lambda k, g: (2.0 * g,), ("g", "k"))


def test_what_compiles_and_for_which_processor_is_part_of_the_key(monkeypatch):
    before = key(BASE)
    for owner, name in ((llvm, "facts"), (cache, "_sources")):
        with monkeypatch.context() as context:
            context.setattr(owner, name, lambda: ["another"])
            assert key(BASE) != before


@pytest.mark.long
def test_no_function_that_runs_while_a_scene_is_traced_is_replaced_unnoticed(monkeypatch):
    """One of each module: what a process puts there leaves nothing for later ones."""
    scene, ran = rde.load_scene("rprp_reach"), {}
    scene = dataclasses.replace(scene, effects=(*scene.effects, e.SensorNoise(0.01)))
    made = programs.traced_environment(scene, ReachTask())

    def noted(frame, event, _):
        module, name = frame.f_globals["__name__"], frame.f_code.co_qualname.partition(".")[0]
        if event == "call" and module.startswith("redundant_envs.") and name in frame.f_globals:
            ran[module] = name

    sys.setprofile(noted)
    try:
        made._trace()
    finally:
        sys.setprofile(None)
    assert {
        "redundant_envs.language.draws",
        "redundant_envs.language.philox",
        "redundant_envs.simulator.events.boundary",
    } <= ran.keys()
    assert loaded_code(programs.__name__).digest
    for module, name in ran.items():
        with monkeypatch.context() as context:
            context.setattr(sys.modules[module], name, lambda: None)
            assert not loaded_code(programs.__name__).digest, f"{module}.{name}"


# ---- what a process replaces ---------------------------------------------------------------------------

SCENE = rde.Scene(FOUR_R, (e.EffortLimits((1.0,) * 4),), integrator="rk4")
SETTLE, TERMS = reach.settle_term, ReachTask.reward_functions
SCALE = 1.0


def as_settling(function):
    return physics(function, gives="settle_term", takes=("distance", "reach"))


def reads_a_global(scale):
    globals()["SCALE"] = scale
    return as_settling(lambda distance, reach: SCALE * tolerance(distance, reach))


def has_a_cell(scale):
    return as_settling(lambda distance, reach: scale * tolerance(distance, reach))


def made_by_the_module(scale):
    own = {}
    exec(f"def settle_term(distance, reach): return {scale} * tolerance(distance, reach)", vars(reach), own)
    return as_settling(own["settle_term"])


def of_a_class(scale):
    """A term of the reward in its place among the others."""
    return lambda self, scene: tuple(has_a_cell(scale) if f is SETTLE else f for f in TERMS(self, scene))


MEMBERS = {
    **{m.__name__: (reach, "settle_term", m) for m in (reads_a_global, has_a_cell, made_by_the_module)},
    "code": (SETTLE, "__code__", lambda scale: made_by_the_module(scale).__code__),
    "method": (ReachTask, "reward_functions", of_a_class),
    "constant": (faults, "LARGEST_ANGLE", lambda scale: scale),
    "entry of a table": (METHODS, "rk4", lambda scale: dataclasses.replace(METHODS["rk4"], b=(scale,) * 4)),
}


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
            (context.setitem if isinstance(owner, dict) else context.setattr)(owner, name, made(scale))
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
    here, scene = sys.modules[__name__], rde.Scene(FOUR_R, (Drag(),), integrator="euler")
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
    monkeypatch.setattr(reach, "settle_term", as_settling(importlib.import_module("pyclbr").near))
    assert not code()
    monkeypatch.delitem(sys.modules, "pyclbr")
    assert not code()


def test_effects_that_users_register_leave_what_is_told_of_the_package_as_it_was(monkeypatch):
    before = code()
    monkeypatch.setitem(e.REGISTRY, "Drag", Drag)
    assert before == code() != ""
