"""Names from outside that mean something else inside are refused, whatever they are."""

import dataclasses

import pytest
import three_r

import redundant_envs as rde
from redundant_envs.algebra import physics
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
    ["error", "h", "interval", "steady", "command1", "gravity_g", "tip_tolerance", "step", "left", "phase",
     "elapsed", "fault", "theta1_start", "effort_limits_limits_0", "ax", "evaluations"],
)  # fmt: skip
def test_an_arm_may_not_call_a_quantity_by_the_name_of_a_number_of_lanes(name):
    with pytest.raises(ValueError, match=f"Odd calls a quantity '{name}'|given by both|name of something"):
        rde.BatchSimulator(scene_of(name), 1)


def test_an_arm_may_call_a_quantity_by_a_name_of_its_own():
    rde.BatchSimulator(scene_of("span"), 1)


@pytest.mark.parametrize("name", ["limit", "resetting", "speed_bound", "saturated", "paid", "hold"])
def test_an_arm_may_not_call_a_quantity_by_the_name_of_a_number_of_episodes(name):
    scene = scene_of(name)
    rde.BatchSimulator(scene, 1)
    with pytest.raises(ValueError, match=f"'{name}', which is the name of"):
        made(ReachTask(), scene)


def task_of(**body):
    return type("OddTask", (ReachTask,), {"name": "OddTask", **body})


def made(task, scene):
    check_task(task, scene)
    return environment_simulator(scene, task)


@pytest.mark.parametrize("arm", ["four_r_reach", "rprp_reach"])
@pytest.mark.parametrize(
    "name",
    ["steps", "interval", "ax", "ay", "effort_limits_limits_0", "action1", "command2", "ended", "paid", "h",
     "draw1", "u1", "truncated", "far_term_sum", "error", "gravity_g"],
)  # fmt: skip
def test_a_task_may_not_call_a_quantity_by_the_name_of_something_else(name, arm):
    scene = load_scene(arm)

    def functions(self, scene):
        return (*ReachTask.functions(self, scene), helper(name, "distance"))

    with pytest.raises(ValueError, match=f"'{name}', which is the name of"):
        made(task_of(functions=functions)(), scene)


def test_a_task_may_not_call_a_quantity_by_an_end_of_travel():
    def functions(self, scene):
        return (*ReachTask.functions(self, scene), helper("low2", "distance"))

    with pytest.raises(ValueError, match="'low2', which is the name of"):
        made(task_of(functions=functions)(), load_scene("rprp_reach"))


@pytest.mark.parametrize("name", ["ended", "paid", "ax", "low2", "error", "limit"])
def test_a_number_of_a_task_has_a_name_of_its_own(name):
    kind = dataclasses.make_dataclass(
        "OddTask", [(name, float, 1.0)], bases=(ReachTask,), frozen=True, namespace={"name": "OddTask"}
    )
    with pytest.raises(ValueError, match=f"'{name}'"):
        made(kind(), load_scene("rprp_reach"))


@pytest.mark.parametrize(
    ("name", "said"),
    [("error_estimate", "info has already"), ("evaluations", "info has already"),
     ("events", "info has already"), ("saturated_actions", "info has already"),
     ("episode_steps", "info has already"), ("truncated", "name of"), ("saturated", "name of"),
     ("steps", "name of"), ("numerics", "name of"), ("reward", "name of"), ("far_term_sum", "name of"),
     ("return_far", "info has already")],
)  # fmt: skip
def test_a_metric_has_a_name_that_info_has_not(name, said):
    body = {"metrics": (*ReachTask.metrics, name)}
    if name != "far_term_sum":
        body["functions"] = lambda self, scene: (
            *ReachTask.functions(self, scene),
            helper(name, "distance"),
        )
    with pytest.raises(ValueError, match=said):
        made(task_of(**body)(), load_scene("four_r_reach"))
