"""Names from outside that mean something else inside are refused, whatever they are."""

import dataclasses
import functools

import gymnasium as gym
import numpy as np
import pytest
import rrp
from lag_chain import LagChain

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.episode import Episode
from redundant_envs.tasks import ReachTask
from redundant_envs.tasks.checks import check_task

e = rde.effects


def helper(name, takes):
    return physics(gives=name, takes=takes)(lambda x: 0.1 * x)


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


def with_number(name):
    body = {"namespace": {"name": "OddTask"}, "frozen": True}
    return dataclasses.make_dataclass("OddTask", [(name, float, 1.0)], bases=(ReachTask,), **body)()


TASKS = {
    "number": with_number,
    "memory": lambda name: task_of(
        memory=(*ReachTask.memory, name), updates={**ReachTask.updates, name: "distance"}
    ),
    "function": lambda name: task_of(
        functions=lambda *own: (*ReachTask.functions(*own), helper(name, "distance"))
    ),
    "term": lambda name: task_of(
        reward_functions=lambda *own: (*ReachTask.reward_functions(*own), helper(name, "speed"))
    ),
    "metric": lambda name: task_of(metrics=(*ReachTask.metrics, name)),
    "angle": lambda name: task_of(angles={**ReachTask.angles, "speed": (name, "odd_c")}),
}


def laid_out(role, name):
    """The fields of an environment in which something is called so."""
    own = role in TASKS
    task, scene = (TASKS[role](name), scene_of()) if own else (ReachTask(), scene_of(**{role: name}))
    check_task(task, scene)
    return Episode(Dynamics(scene), task).layout()


TAKEN = "interval", "ax", "gravity_g", "action1", "held3", "paid"
OF_ARM = "command1", "ax", "m1", "speed_bound", "paid", "gravity_g"
NAMES = {
    **{role: TAKEN for role in TASKS if role != "metric"},
    "quantity": OF_ARM,
    "coordinate": ("error", "held3"),
}


@pytest.mark.long
@pytest.mark.parametrize("role", NAMES)
def test_a_name_is_given_once_and_the_message_says_whose_it_is(role):
    whose = r"the (engine|arm Odd|effect EffortLimits|effect Gravity)|OddTask\.|every arm"
    for name in NAMES[role]:
        with pytest.raises(ValueError, match=rf"'{name}'.* of ({whose})|is given by both"):
            laid_out(role, name)


def test_the_message_says_what_a_name_means():
    said = (
        "'error' is a name of the engine: estimated tip error .*, and of the task OddTask: memory; rename one"
    )
    with pytest.raises(ValueError, match=said):
        laid_out("memory", "error")


@pytest.mark.parametrize("name", ["evaluations", "saturated_actions", "return_far", "truncated", "goal_x"])
def test_a_metric_has_no_name_of_what_every_step_shows(name):
    with pytest.raises(ValueError, match=r"of the (engine|arm)|info has already|is given by both"):
        laid_out("metric", name)


@pytest.mark.long
def test_a_metric_may_be_a_quantity_of_the_arm_an_effect_or_the_task():
    shown = ("alpha1", "m1", "gravity_g", "lag_chain__effort__2", "hold", "start_angle", "phid2")
    body = {"name": "Shown", "metrics": (*ReachTask.metrics, *shown)}
    rde.register_task(type("ShownTask", (ReachTask,), body))
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
