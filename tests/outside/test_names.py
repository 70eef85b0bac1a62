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
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.episode import Episode
from redundant_envs.lane.interval import Interval
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
    ["error", "h", "interval", "least_step_rate", "command1", "gravity_g", "tip_tolerance", "step", "left",
     "state", "elapsed", "fault", "theta1_start", "effort_limits_limits_0", "ax", "evaluations"],
)  # fmt: skip
def test_an_arm_may_not_call_a_quantity_by_the_name_of_a_number_of_lanes(name):
    with pytest.raises(ValueError, match=f"'{name}', a name of the|given by both"):
        rde.BatchSimulator(scene_of(name), 1)


def test_an_arm_may_call_a_quantity_by_a_name_of_its_own():
    rde.BatchSimulator(scene_of("span"), 1)


@pytest.mark.parametrize("name", ["limit", "resetting", "speed_bound", "saturated", "paid", "hold"])
def test_an_arm_may_not_call_a_quantity_by_the_name_of_a_number_of_episodes(name):
    scene = scene_of(name)
    rde.BatchSimulator(scene, 1)
    with pytest.raises(ValueError, match=f"has '{name}', a name of the (engine: |arm Odd)"):
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

    with pytest.raises(
        ValueError, match=f"OddTask.functions has '{name}', a name of the (engine|arm|effect)"
    ):
        made(task_of(functions=functions)(), scene)


def test_a_task_may_not_call_a_quantity_by_an_end_of_travel():
    def functions(self, scene):
        return (*ReachTask.functions(self, scene), helper("low2", "distance"))

    with pytest.raises(ValueError, match="'low2', a name of the engine: an end of the travel"):
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
     ("episode_steps", "info has already"), ("numerics", "info has already"),
     ("return_far", "info has already"), ("truncated", "of the engine: of the last step"),
     ("saturated", "of the engine: entries of actions"), ("steps", "of the engine: control steps of"),
     ("reward", "of the engine"), ("far_term_sum", "of the engine: sum of a reward term")],
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


# ---- every name that the lanes of an environment have ----------------------------------------------------

OF_EQUATIONS = ("ax", "ay", "ended", "paid", "low2", "high4", "t1", "held2", "hold2", "Q1", "qdd1", "tip_x")
OWNERS = r"a name of (the (engine: .|arm RPRP|effect [A-Z]\w+: .)|(OddTask|ReachTask)\.)"


def full_scene():
    """With stops, a spring's end, states of an effect and error control: it has fields of all kinds."""
    scene = load_scene("rprp_reach")
    more = (e.LimitSpring("joint2", -1.0, 1.0, 500.0, 1.0), actuator_lag.ActuatorLag(0.04))
    return rde.Scene(scene.robot, (*scene.effects, *more), tolerance=1e-6)


def some(names):
    """A sample of names, as the search over all of them takes a minute."""
    return random.Random(3).sample(sorted(names), 60)


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


ROLES = (with_number, with_memory, with_function, with_term, with_angle)


@pytest.mark.parametrize("role", ROLES)
def test_no_name_of_a_lane_is_given_twice_and_the_message_says_whose_it_is(role):
    scene = full_scene()
    own = set(ReachTask().parameters()) if role is with_number else set()
    fields = laid_out(ReachTask(), scene).fields
    assert len(fields) > 180
    for name in (*some(set(fields) - own), *OF_EQUATIONS):
        with pytest.raises(ValueError, match=rf"'{name}'.*({OWNERS}|is given by both|task OddTask)"):
            laid_out(role(name), scene)


def test_a_metric_is_no_name_of_the_engine():
    scene = full_scene()
    fields = laid_out(ReachTask(), scene).fields
    names = [name for name, field in fields.items() if field.owner == "the engine"]
    assert len(names) > 120
    for name in (*some(names), "ended", "low2", "tip_x", "goal_x"):
        with pytest.raises(ValueError, match=rf"'{name}', (a name of the engine: |which info has already)"):
            laid_out(task_of(metrics=(*ReachTask.metrics, name))(), scene)


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
    expected = {name: memory.read((name,))[0, 0] for name in shown[:-1]}
    assert {name: info[name] for name in expected} == expected
    assert info["phid2"] == env.qd[1]
    assert info["actuator_lag__effort__2"] > 0.1


def test_the_message_says_what_a_name_means():
    said = (
        "OddTask.memory has 'steps', a name of the engine: control steps of the episode before this one; ren"
    )
    with pytest.raises(ValueError, match=said):
        laid_out(with_memory("steps"), full_scene())


def test_fields_of_effects_from_outside_have_two_underscores_whatever_was_imported_first():
    assert "actuator_lag__time_constant" in laid_out(ReachTask(), full_scene()).fields


@pytest.mark.parametrize("name", ["unused", "achieved_x", "desired_y", "work", "logged"])
def test_a_number_may_have_a_name_that_only_another_program_uses(name):
    environment_simulator(full_scene(), with_number(name))


def test_quantities_of_an_arm_have_no_name_of_a_lane():
    odd = scene_of("span")
    for name in some(laid_out(ReachTask(), odd).fields):
        with pytest.raises(ValueError, match=rf"'{name}'.*(a name of |is given by both)"):
            laid_out(ReachTask(), scene_of(name))


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
    names = [f.name for f in fields if f.owner != "the arm Odd" and not f.name.startswith("turn_")]
    for name in some(names):
        with pytest.raises(ValueError, match=rf"'{name}'.*a name of"):
            laid_out(ReachTask(), scene_with_coordinate(name))


@pytest.mark.parametrize("form", ["effort__0_start", "effort__0_trial", "effort__0_slope"])
def test_a_number_of_an_effect_has_no_name_that_the_engine_gives_to_its_states(form):
    @physics(gives="effort", takes=f"effort {form}")
    def shifted(effort, shift):
        return effort + shift

    def link(self, k, unit):
        hook = actuator_lag.ActuatorLag.link(self, k, unit)
        return dataclasses.replace(hook, function=shifted, bind={**hook.bind, form: f".{form}"})

    bases = (actuator_lag.ActuatorLag,)
    kind = dataclasses.make_dataclass(
        "Odd", [(form, float)], bases=bases, frozen=True, namespace={"link": link}
    )
    scene = load_scene("rprp_reach")
    odd = rde.Scene(scene.robot, (*scene.effects, kind(0.1, 0.0)), tolerance=1e-6)
    with pytest.raises(ValueError, match=f"'odd__{form}' is a name of the effect Odd: .*, and of the engine"):
        laid_out(ReachTask(), odd)
