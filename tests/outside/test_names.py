"""Names from outside that mean something else inside are refused, whatever they are."""

import dataclasses
import random

import actuator_lag
import gymnasium as gym
import numpy as np
import pytest
import three_r

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.lane.direct import fields_of
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.episode import Episode
from redundant_envs.lane.interval import Interval
from redundant_envs.lane.memory import Lane
from redundant_envs.model.programs import environment_simulator
from redundant_envs.scene import load_scene
from redundant_envs.tasks import ReachTask
from redundant_envs.tasks.checks import check_task

e = rde.effects


def helper(name, takes):
    @physics(gives=name, takes=takes)
    def helper(x):
        return 0.1 * x

    return helper


def scene_of(name):
    functions = (*three_r.ThreeR.functions, helper(name, "l1"))
    arm = type("Odd", (three_r.ThreeR,), {"functions": functions})((1.0,) * 3, (0.5,) * 3)
    friction = e.LimitSpring("joint2", -1.0, 1.0, 500.0, 1.0)
    return rde.Scene(arm, (e.Gravity(), friction, e.EffortLimits((3.0,) * 3)), tolerance=1e-6)


@pytest.mark.parametrize(
    "name",
    ["command1", "ax", "ay", "m1", "speed_bound", "paid", "hold", "interval", "gravity_g", "action2"],
)
def test_an_arm_may_not_call_a_quantity_by_a_name_that_it_or_its_task_takes(name):
    with pytest.raises(ValueError, match=rf"'{name}', a name of the (engine: |effect|arm Odd)|given by both"):
        made(ReachTask(), scene_of(name))


def task_of(**body):
    return type("OddTask", (ReachTask,), {"name": "OddTask", **body})


def made(task, scene):
    check_task(task, scene)
    return environment_simulator(scene, task)


@pytest.mark.parametrize("name", ["error", "h", "step", "left", "state", "fault", "u1", "command2", "limit"])
def test_a_quantity_of_a_task_may_have_the_name_of_a_number_that_only_the_engine_has(name):
    task = task_of(
        metrics=(*ReachTask.metrics, name),
        functions=lambda self, scene: (*ReachTask.functions(self, scene), helper(name, "distance")),
    )()
    shown = observed(load_scene("rprp_reach"), task)
    assert shown[name] == 0.1 * shown["distance"] > 0.0


@pytest.mark.parametrize("name", ["error", "h", "step", "theta1_start", "tip_tolerance", "least_step_rate"])
def test_a_quantity_of_an_arm_may_have_the_name_of_a_number_that_only_the_engine_has(name):
    assert observed(scene_of(name), task_of(metrics=(*ReachTask.metrics, name))())[name] == 0.05


def observed(scene, task):
    """What an environment shows, from fields of 0.3 beside the numbers of the scene."""
    check_task(task, scene)
    episode = Episode(Interval(Dynamics(scene)), task)
    numbers = fields_of(episode.dynamics) | dict.fromkeys(("h", "tip_tolerance", "least_step_rate"), 0.3)
    shown = episode.observe(Lane(episode.layout(), lambda name: numbers.get(name, 0.3)))
    return {name: shown["values", "f64", k, 0] for k, name in enumerate(episode.tables["values"])}


# ---- every name that the lanes of an environment have ----------------------------------------------------


def full_scene():
    """With stops, a spring's end, states of an effect and error control: it has fields of all kinds."""
    scene = load_scene("rprp_reach")
    more = (e.LimitSpring("joint2", -1.0, 1.0, 500.0, 1.0), actuator_lag.ActuatorLag(0.04))
    return rde.Scene(scene.robot, (*scene.effects, *more), tolerance=1e-6)


def some(names):
    """A sample of names, as the search over all of them takes a minute."""
    return random.Random(3).sample(sorted(names), 25)


def laid_out(task, scene):
    check_task(task, scene)
    return Episode(Interval(Dynamics(scene)), task).layout()


def with_number(name):
    return dataclasses.make_dataclass(
        "OddTask", [(name, float, 1.0)], bases=(ReachTask,), frozen=True, namespace={"name": "OddTask"}
    )()


def with_memory(name):
    updates = {**ReachTask.updates, name: "distance"}
    return task_of(memory=(*ReachTask.memory, name), updates=updates)()


def with_function(name):
    return task_of(functions=lambda self, scene: (*ReachTask.functions(self, scene), helper(name, "speed")))()


def with_term(name):
    def reward_functions(self, scene):
        return (*ReachTask.reward_functions(self, scene), helper(name, "speed"))

    return task_of(reward_functions=reward_functions)()


def with_angle(name):
    return task_of(angles={**ReachTask.angles, "speed": (name, "odd_c")})()


ROLES = {
    "number": with_number, "memory": with_memory, "function": with_function, "term": with_term,
    "angle": with_angle,
}  # fmt: skip


TAKEN = (
    "steps", "interval", "ax", "ay", "effort_limits_limits_0", "action1", "ended", "paid", "low2", "draw1",
    "gravity_g", "tip_x", "t1", "held2", "hold2", "Q1", "qdd1", "high4",
)  # fmt: skip
"""Names that functions take."""
IN_INFO = (
    "error_estimate",
    "evaluations",
    "numerics",
    "events",
    "saturated_actions",
    "episode_steps",
    "return_far",
    "truncated",
    "saturated",
    "reward",
)


@pytest.mark.parametrize("role", ROLES)
def test_a_name_is_given_once_and_the_message_says_whose_it_is(role):
    """Those that functions take; numbers and memory have the name of no other field."""
    scene, task = full_scene(), ReachTask()
    fields = laid_out(task, scene).fields
    assert len(fields) > 180
    of_effects = {name for name in fields if "." in name}
    assert {"actuator_lag.time_constant", "gravity.g", "effort_limits.limits[3]"} <= of_effects
    more = some(set(fields) - of_effects - {*task.parameters(), *task.memory})
    whose = "engine: [a-z]|arm RPRP|effect EffortLimits|effect Gravity"
    for name in (*TAKEN, *(more if role in ("number", "memory") else ())):
        said = rf"'{name}'.*of (the ({whose})|OddTask\.)|is given by both"
        with pytest.raises(ValueError, match=said):
            laid_out(ROLES[role](name), scene)


@pytest.mark.parametrize("given", [False, True])
def test_a_metric_has_no_name_of_what_every_step_shows(given):
    """Also where a function of the task gives it."""
    scene = full_scene()
    columns = Episode(Interval(Dynamics(scene)), ReachTask()).tables.values()
    names = {name for table in columns for name in table} - {*ReachTask.metrics}
    for name in {*names, *IN_INFO} if given else {*names, "goal_x"}:
        body = {"metrics": (*ReachTask.metrics, name)}
        if given:
            body["functions"] = with_function(name).functions
        with pytest.raises(ValueError, match=r"of the (engine|arm)|info has already|is given by both"):
            laid_out(task_of(**body)(), scene)


def test_a_metric_may_be_a_quantity_of_the_arm_an_effect_or_the_task():
    shown = ("theta1", "m1", "gravity_g", "actuator_lag__effort__2", "hold", "start_angle", "phid2")
    kind = task_of(metrics=(*ReachTask.metrics, *shown))
    kind = type("ShownTask", (kind,), {"name": "Shown"})
    rde.register_task(kind)
    scene = dataclasses.replace(full_scene(), tolerance=None)
    env = gym.make("redundant_envs/RPRPShown-v0", scene=scene.to_dict()).unwrapped
    env.reset(seed=0)
    *_, info = env.step(np.full(4, 0.5, np.float32))
    memory = env.core.memory
    fields = {"gravity_g": "gravity.g", "actuator_lag__effort__2": "actuator_lag.effort[2]"}
    expected = {name: memory.read((fields.get(name, name),))[0, 0] for name in shown[:-1]}
    assert {name: info[name] for name in expected} == expected
    assert info["phid2"] == env.qd[1]
    assert info["actuator_lag__effort__2"] > 0.1


def test_the_message_says_what_a_name_means():
    said = (
        "'error' is a name of the engine: estimated tip error .*, and of the task OddTask: memory; rename one"
    )
    with pytest.raises(ValueError, match=said):
        laid_out(with_memory("error"), full_scene())


@pytest.mark.parametrize("name", ["unused", "achieved_x", "desired_y", "work", "logged"])
def test_a_number_may_have_a_name_that_only_another_program_uses(name):
    environment_simulator(full_scene(), with_number(name))


@physics(gives="x1 y1 x2 y2")
def points(l1, l2, s1, c1, s2, c2):
    x1, y1 = l1 * c1, l1 * s1
    return x1, y1, x1 + l2 * c2, y1 + l2 * s2


def scene_with_coordinate(name):
    names = {"coordinates": ("theta1", name), "rates": ("w1", "w2"), "joints": ("a", "b")}
    angles = {"theta1": ("s1", "c1"), name: ("s2", "c2")}
    facts = {"prismatic": (False, False), "sincos": angles, "num_lengths": 2, "functions": (points,)}
    arm = type("Odd", (rde.Arm,), {**names, **facts})((1.0, 1.0), (0.5, 0.5))
    return rde.Scene(arm, (e.Gravity(), e.EffortLimits(3.0), actuator_lag.ActuatorLag(0.04)), tolerance=1e-6)


def test_a_coordinate_of_an_arm_has_no_name_of_a_lane():
    fields = laid_out(ReachTask(), scene_with_coordinate("turn")).fields.values()
    names = [f.name for f in fields if f.owner != "the arm Odd" and f.name.isidentifier()]
    for name in some({name for name in names if not name.startswith("turn_")}):
        with pytest.raises(ValueError, match=rf"'{name}'.*a name of"):
            laid_out(ReachTask(), scene_with_coordinate(name))
