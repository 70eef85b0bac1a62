"""Names from outside that mean something else inside are refused, whatever they are."""

import dataclasses
import functools
import itertools
import random

import gymnasium as gym
import numpy as np
import pytest
import rrp
from lag_chain import LagChain

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.model.programs import environment_simulator
from redundant_envs.simulator.lane.direct import fields_of
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.episode import Episode
from redundant_envs.simulator.lane.interval import Interval
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.tasks import ReachTask
from redundant_envs.tasks.checks import check_task

e = rde.effects


def helper(name, takes):
    @physics(gives=name, takes=takes)
    def helper(x):
        return 0.1 * x

    return helper


@functools.cache
def scene_of(quantity="odd", coordinate="turn"):
    """An arm with a quantity and a coordinate of some names, and effects that add fields of all kinds."""
    body = {
        "functions": (*rrp.RRP.functions, helper(quantity, "l1")),
        "coordinates": ("alpha1", coordinate, "r"),
        "sincos": {"alpha1": ("s1", "c1"), coordinate: ("s21", "c21")},
    }
    arm = type("Odd", (rrp.RRP,), body)((1.0,) * 3, (0.5,) * 2)
    effects = e.Gravity(), e.EffortLimits(3.0), e.PrismaticStop((0.0,), (0.3,)), LagChain(0.04)
    return rde.Scene(arm, (*effects, e.LimitSpring("joint2", -1.0, 1.0, 500.0, 1.0)), tolerance=1e-6)


def task_of(**body):
    return type("OddTask", (ReachTask,), {"name": "OddTask", **body})()


def episode_of(task, scene):
    check_task(task, scene)
    return Episode(Interval(Dynamics(scene)), task)


def with_number(name):
    body = {"namespace": {"name": "OddTask"}, "frozen": True}
    return dataclasses.make_dataclass("OddTask", [(name, float, 1.0)], bases=(ReachTask,), **body)()


def with_function(name, **body):
    return task_of(functions=lambda *own: (*ReachTask.functions(*own), helper(name, "distance")), **body)


def with_metric(*names, given=False):
    metrics = {"metrics": (*ReachTask.metrics, *names)}
    return with_function(names[0], **metrics) if given else task_of(**metrics)


ROLES = {
    "number": with_number,
    "memory": lambda name: task_of(
        memory=(*ReachTask.memory, name), updates={**ReachTask.updates, name: "distance"}
    ),
    "function": with_function,
    "term": lambda name: task_of(
        reward_functions=lambda *own: (*ReachTask.reward_functions(*own), helper(name, "speed"))
    ),
    "angle": lambda name: task_of(angles={**ReachTask.angles, "speed": (name, "odd_c")}),
}
TAKEN = (
    "steps", "interval", "ax", "ay", "effort_limits_limits_0", "action1", "ended", "paid", "low3", "draw1",
    "gravity_g", "tip_x", "t1", "held3", "hold3", "Q1", "qdd1", "high3",
)  # fmt: skip
"""Names that functions take."""
OF_ARM = "command1", "ax", "ay", "m1", "speed_bound", "paid", "hold", "interval", "gravity_g", "action2"
"""Those that a function of an arm may not give."""


def laid_out(role, name):
    if role in ROLES:
        return episode_of(ROLES[role](name), scene_of()).layout()
    return episode_of(ReachTask(), scene_of(**{role: name})).layout()


@pytest.mark.long
@pytest.mark.parametrize("role", [*ROLES, "quantity", "coordinate"])
def test_a_name_is_given_once_and_the_message_says_whose_it_is(role):
    """Those that functions take; numbers, memory and coordinates have the name of no other field."""
    task = ReachTask()
    fields = episode_of(task, scene_of()).layout().fields
    assert len(fields) > 140
    assert {"lag_chain.time_constant", "gravity.g", "effort_limits.limits[2]"} <= {*fields}
    own = {*task.parameters(), *task.memory, *(n for n, f in fields.items() if f.owner == "the arm Odd")}
    names = random.Random(3).sample(sorted(name for name in {*fields} - own if name.isidentifier()), 12)
    names = {"number": (*TAKEN, *names), "memory": (*TAKEN, *names), "coordinate": names, "quantity": OF_ARM}
    whose = r"the (engine|arm Odd|effect EffortLimits|effect Gravity)|OddTask\.|every arm"
    for name in names.get(role, TAKEN):
        with pytest.raises(ValueError, match=rf"'{name}'.* of ({whose})|is given by both"):
            laid_out(role, name)


ENGINES = "error", "h", "step", "fault", "tip_tolerance", "least_step_rate"
"""Names of numbers that only the engine has."""


@pytest.mark.quick("error-False")
@pytest.mark.parametrize(
    ("name", "of_arm"), [*itertools.product(ENGINES, (False, True)), ("command2", False)]
)
def test_a_quantity_may_have_the_name_of_a_number_that_only_the_engine_has(name, of_arm):
    episode = episode_of(with_metric(name, given=not of_arm), scene_of(name if of_arm else "odd"))
    numbers = fields_of(episode.dynamics) | dict.fromkeys(("h", "tip_tolerance", "least_step_rate"), 0.3)
    shown = episode.observe(Lane(episode.layout(), lambda name: numbers.get(name, 0.3)))
    values = {one: shown["values", "f64", k, 0] for k, one in enumerate(episode.tables["values"])}
    assert values[name] == 0.1 * (0.5 if of_arm else values["distance"]) > 0.0


IN_INFO = (
    "error_estimate", "evaluations", "numerics", "events", "saturated_actions", "episode_steps",
    "return_far", "truncated", "saturated", "reward",
)  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("given", [False, True])
def test_a_metric_has_no_name_of_what_every_step_shows(given):
    """Also where a function of the task gives it."""
    scene = scene_of()
    columns = episode_of(ReachTask(), scene).tables.values()
    names = {name for table in columns for name in table} - {*ReachTask.metrics}
    for name in {*names, *IN_INFO} if given else {*names, "goal_x"}:
        with pytest.raises(ValueError, match=r"of the (engine|arm)|info has already|is given by both"):
            episode_of(with_metric(name, given=given), scene).layout()


@pytest.mark.long
def test_a_metric_may_be_a_quantity_of_the_arm_an_effect_or_the_task():
    shown = ("alpha1", "m1", "gravity_g", "lag_chain__effort__2", "hold", "start_angle", "phid2")
    rde.register_task(type("ShownTask", (type(with_metric(*shown)),), {"name": "Shown"}))
    data = rde.load_scene(rrp.SCENE).to_dict()
    data["effects"].append({"type": "LagChain", "time_constant": 0.04})
    env = gym.make("redundant_envs/RRPShown-v0", scene=data).unwrapped
    env.reset(seed=0)
    *_, info = env.step(np.full(3, 0.5, np.float32))
    fields = {"gravity_g": "gravity.g", "lag_chain__effort__2": "lag_chain.effort[2]"}
    for name in shown[:-1]:
        assert info[name] == env.core.memory.read((fields.get(name, name),))[0, 0]
    assert info["phid2"] == env.qd[1]
    assert info["lag_chain__effort__2"] > 0.1


def test_the_message_says_what_a_name_means():
    said = (
        "'error' is a name of the engine: estimated tip error .*, and of the task OddTask: memory; rename one"
    )
    with pytest.raises(ValueError, match=said):
        laid_out("memory", "error")


@pytest.mark.quick("unused")
@pytest.mark.parametrize("name", ["unused", "achieved_x", "work"])
def test_a_number_may_have_a_name_that_only_another_program_uses(name):
    environment_simulator(scene_of(), with_number(name))
