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
SCENES = {name: load_scene(name) for name in ("four_r_reach", "rprp_reach")}


def helper(name, takes):
    return physics(gives=name, takes=takes)(lambda x: 0.1 * x)


def full_scene():
    """With stops, a spring's end, states of an effect and error control: it has fields of all kinds."""
    more = (e.LimitSpring("joint2", -1.0, 1.0, 500.0, 1.0), actuator_lag.ActuatorLag(0.04))
    return rde.Scene(SCENES["rprp_reach"].robot, (*SCENES["rprp_reach"].effects, *more), tolerance=1e-6)


def laid_out(task, scene):
    check_task(task, scene)
    return Episode(Interval(Dynamics(scene)), task).layout()


def some(names, count=60):
    """A sample of names, as the search over all of them takes a minute."""
    names = sorted(names)
    return random.Random(3).sample(names, min(count, len(names)))


# ---- tasks ---------------------------------------------------------------------------------------------


def task_of(base=ReachTask, **body):
    return type("OddTask", (base,), {"name": "OddTask", **body})()


def with_number(name):
    return dataclasses.make_dataclass(
        "OddTask", [(name, float, 1.0)], bases=(ReachTask,), frozen=True, namespace={"name": "OddTask"}
    )()


def with_memory(name):
    return task_of(memory=(*ReachTask.memory, name), updates={**ReachTask.updates, name: "distance"})


def with_function(name):
    return task_of(functions=lambda self, scene: (*ReachTask.functions(self, scene), helper(name, "speed")))


def with_term(name):
    def reward_functions(self, scene):
        return (*ReachTask.reward_functions(self, scene), helper(name, "speed"))

    return task_of(reward_functions=reward_functions)


def with_angle(name):
    return task_of(angles={**ReachTask.angles, "speed": (name, "odd_c")})


OF_EQUATIONS = ("ax", "ay", "ended", "paid", "low2", "high4", "t1", "held2", "hold2", "Q1", "qdd1", "tip_x")
OWNERS = r"a name of (the (engine: .|arm RPRP|effect [A-Z]\w+: .)|(OddTask|ReachTask)\.)"
OF_THE_ENGINE = (
    "steps", "interval", "ax", "ay", "effort_limits_limits_0", "action1", "command2", "ended", "paid", "h",
    "draw1", "u1", "truncated", "far_term_sum", "error", "gravity_g",
)  # fmt: skip


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize("name", OF_THE_ENGINE)
def test_a_task_may_not_call_a_quantity_by_the_name_of_something_else(name, scene):
    said = f"OddTask.functions has '{name}', a name of the (engine|arm|effect)"
    with pytest.raises(ValueError, match=said):
        laid_out(with_function(name), scene)


@pytest.mark.parametrize("role", [with_number, with_memory, with_function, with_term, with_angle])
def test_no_name_of_a_lane_is_given_twice_and_the_message_says_whose_it_is(role):
    scene = full_scene()
    own = set(ReachTask().parameters()) if role is with_number else set()
    fields = laid_out(ReachTask(), scene).fields
    assert len(fields) > 180
    for name in (*some(set(fields) - own), *OF_EQUATIONS):
        with pytest.raises(ValueError, match=rf"'{name}'.*({OWNERS}|is given by both|task OddTask)"):
            laid_out(role(name), scene)


@pytest.mark.parametrize(
    ("task", "said"),
    [
        (with_memory("steps"), "OddTask.memory has 'steps', a name of the engine: control steps of the epis"),
        (with_function("low2"), "'low2', a name of the engine: an end of the travel"),
    ],
)
def test_the_message_says_what_a_name_means(task, said):
    with pytest.raises(ValueError, match=said):
        laid_out(task, full_scene())


@pytest.mark.parametrize("name", ["unused", "achieved_x", "desired_y", "work", "logged"])
def test_a_number_may_have_a_name_that_only_another_program_uses(name):
    environment_simulator(full_scene(), with_number(name))


INFO = (
    "error_estimate",
    "evaluations",
    "events",
    "saturated_actions",
    "episode_steps",
    "numerics",
    "return_far",
)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        *((name, "info has already") for name in INFO),
        ("truncated", "of the engine: of the last step"),
        ("saturated", "of the engine: entries of actions"),
        ("steps", "of the engine: control steps of"),
        ("reward", "of the engine"),
        ("far_term_sum", "of the engine: sum of a reward term"),
    ],
)
def test_a_metric_has_a_name_that_info_has_not(name, said):
    base = ReachTask if name == "far_term_sum" else type(with_function(name))
    with pytest.raises(ValueError, match=said):
        laid_out(task_of(base, metrics=(*ReachTask.metrics, name)), SCENES["four_r_reach"])


def test_a_metric_is_no_name_of_the_engine():
    scene = full_scene()
    fields = laid_out(ReachTask(), scene).fields
    names = [name for name, field in fields.items() if field.owner == "the engine"]
    assert len(names) > 120
    for name in (*some(names), "ended", "low2", "tip_x", "goal_x"):
        with pytest.raises(ValueError, match=rf"'{name}', (a name of the engine: |which info has already)"):
            laid_out(task_of(metrics=(*ReachTask.metrics, name)), scene)


def test_a_metric_may_be_a_quantity_of_the_arm_an_effect_or_the_task():
    shown = ("theta1", "m1", "gravity_g", "actuator_lag__effort__2", "hold", "start_angle", "phid2")
    rde.register_task(type(task_of(metrics=(*ReachTask.metrics, *shown), name="Shown")))
    scene = dataclasses.replace(full_scene(), tolerance=None)
    env = gym.make("redundant_envs/RPRPShown-v0", scene=scene.to_dict()).unwrapped
    env.reset(seed=0)
    *_, info = env.step(np.full(4, 0.5, np.float32))
    expected = {name: env.core.memory.read((name,))[0, 0] for name in shown[:-1]}
    assert {name: info[name] for name in expected} == expected
    assert info["phid2"] == env.qd[1]
    assert info["actuator_lag__effort__2"] > 0.1


# ---- arms ----------------------------------------------------------------------------------------------


@physics(gives="x1 y1 x2 y2")
def points(l1, l2, s1, c1, s2, c2):
    x1, y1 = l1 * c1, l1 * s1
    return x1, y1, x1 + l2 * c2, y1 + l2 * s2


def scene_with_quantity(name):
    functions = (*three_r.ThreeR.functions, helper(name, "l1"))
    arm = type("Odd", (three_r.ThreeR,), {"functions": functions})((1.0,) * 3, (0.5,) * 3)
    spring = e.LimitSpring("joint2", -1.0, 1.0, 500.0, 1.0)
    return rde.Scene(arm, (e.Gravity(), spring, e.EffortLimits((3.0,) * 3)), tolerance=1e-6)


def scene_with_coordinate(name):
    names = {"coordinates": ("theta1", name), "rates": ("w1", "w2"), "joints": ("a", "b")}
    angles = {"theta1": ("s1", "c1"), name: ("s2", "c2")}
    facts = {"prismatic": (False, False), "sincos": angles, "num_lengths": 2, "functions": (points,)}
    arm = type("Odd", (rde.Arm,), {**names, **facts})((1.0, 1.0), (0.5, 0.5))
    return rde.Scene(arm, (e.Gravity(), e.EffortLimits(3.0), actuator_lag.ActuatorLag(0.04)), tolerance=1e-6)


OF_LANES = (
    "error", "h", "interval", "least_step_rate", "command1", "gravity_g", "tip_tolerance", "step", "left",
    "state", "elapsed", "fault", "theta1_start", "effort_limits_limits_0", "ax", "evaluations",
)  # fmt: skip


@pytest.mark.parametrize("name", OF_LANES)
def test_an_arm_may_not_call_a_quantity_by_the_name_of_a_number_of_lanes(name):
    with pytest.raises(ValueError, match=f"'{name}', a name of the|given by both"):
        rde.BatchSimulator(scene_with_quantity(name), 1)


@pytest.mark.parametrize("name", ["limit", "resetting", "speed_bound", "saturated", "paid", "hold"])
def test_an_arm_may_not_call_a_quantity_by_the_name_of_a_number_of_episodes(name):
    scene = scene_with_quantity(name)
    rde.BatchSimulator(scene, 1)
    with pytest.raises(ValueError, match=f"has '{name}', a name of the (engine: |arm Odd)"):
        laid_out(ReachTask(), scene)


@pytest.mark.parametrize("made", [scene_with_quantity, scene_with_coordinate])
def test_names_of_an_arm_are_no_names_of_a_lane(made):
    fields = laid_out(ReachTask(), made("span")).fields.values()
    names = [f.name for f in fields if f.owner != "the arm Odd" and not f.name.startswith("span_")]
    for name in some(names):
        with pytest.raises(ValueError, match=rf"'{name}'.*(a name of|is given by both)"):
            laid_out(ReachTask(), made(name))


# ---- effects -------------------------------------------------------------------------------------------


def test_fields_of_effects_from_outside_have_two_underscores_whatever_was_imported_first():
    assert "actuator_lag__time_constant" in laid_out(ReachTask(), full_scene()).fields


@pytest.mark.parametrize("form", ["effort__0_start", "effort__0_trial", "effort__0_slope"])
def test_a_number_of_an_effect_has_no_name_that_the_engine_gives_to_its_states(form):
    shifted = physics(gives="effort", takes=f"effort {form}")(lambda effort, shift: effort + shift)

    def link(self, k, unit):
        hook = actuator_lag.ActuatorLag.link(self, k, unit)
        return dataclasses.replace(hook, function=shifted, bind={**hook.bind, form: f".{form}"})

    bases = (actuator_lag.ActuatorLag,)
    kind = dataclasses.make_dataclass(
        "Odd", [(form, float)], bases=bases, frozen=True, namespace={"link": link}
    )
    scene = SCENES["rprp_reach"]
    odd = rde.Scene(scene.robot, (*scene.effects, kind(0.1, 0.0)), tolerance=1e-6)
    with pytest.raises(ValueError, match=f"'odd__{form}' is a name of the effect Odd: .*, and of the engine"):
        laid_out(ReachTask(), odd)
