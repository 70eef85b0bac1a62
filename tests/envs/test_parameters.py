"""An environment says what it simulates: its scene, all numbers with their units; numbers of every size."""

import operator
from dataclasses import dataclass, make_dataclass

import numpy as np
import pytest
from faces import begin, running

import redundant_envs as rde
from redundant_envs.envs.core import Core
from redundant_envs.envs.face import parameters_of
from redundant_envs.language.algebra import physics

e = rde.effects
SCENE = rde.load_scene("rprp_reach")
UNITS = {
    "masses": "kg",
    "lengths": "m",
    "gravity.g": "m/s^2",
    "gravity.down": "",
    "viscous_friction.coefficients": ("N m s/rad", "N s/m", "N m s/rad", "N s/m"),
    "effort_limits.limits": ("N m", "N", "N m", "N"),
    "prismatic_stop.lower": "m",
    "prismatic_stop.upper": "m",
    "prismatic_stop.restitution": "",
    "start_angle": "rad",
    "speed_bound": "rad/s or m/s",
    "goal_tolerance": "reaches",
    "hold_speed": "reaches/s",
    "hold_steps": "control steps",
    "inner": "reaches",
    "outer": "reaches",
    "rate_scale": "rad/s or m/s",
}


def test_every_number_is_there_with_its_unit_as_a_copy_and_is_an_option_of_the_next_reset(face):
    env = running(face)
    assert env.scene == SCENE
    assert {name: parameter.unit for name, parameter in env.parameters.items()} == UNITS
    given = {"masses": (1, 2, 3, 4), "viscous_friction.coefficients": 0.3, "hold_steps": 4, "gravity.g": 1.6}
    begin(env, {"parameters": given})
    for name, value in given.items():
        assert (env.parameters[name].value == value).all()
    before = {name: parameter.value for name, parameter in env.parameters.items()}
    begin(env, {"parameters": {}})
    lanes = () if face == "single" else (3,)
    np.testing.assert_array_equal(env.parameters["gravity.g"].value, np.full(lanes, 9.81))
    for write in (
        lambda: env.parameters["masses"].value.__setitem__(0, 7.0),
        lambda: operator.setitem(env.parameters, "masses", 7.0),
        lambda: setattr(env.parameters["masses"], "value", 7.0),
    ):
        with pytest.raises((ValueError, AttributeError, TypeError), match=r"read-only|assign"):
            write()
    begin(env, {"parameters": before})
    for name, parameter in env.parameters.items():
        np.testing.assert_array_equal(parameter.value, before[name])


@pytest.mark.parametrize("kind", ["next_step", "sb3"])
@pytest.mark.parametrize("count", [1, 4])
def test_arrays_of_options_have_one_row_for_each_environment(kind, count):
    rng = np.random.default_rng(0)
    given = {
        "masses": rng.uniform(0.3, 0.8, (count, 4)),
        "gravity.g": rng.uniform(9, 10, count),
        "viscous_friction.coefficients": rng.uniform(0.1, 0.2, (1, 4)),  # one for all
    }
    env = running(kind, count=count)
    first = begin(env, {"parameters": given, "goal": np.full((count, 2), 0.1)}, seed=5)
    for name, value in given.items():
        found = env.parameters[name].value
        np.testing.assert_array_equal(found, np.broadcast_to(value, found.shape))
    np.testing.assert_array_equal(env.goal, np.full((count, 2), 0.1))
    if kind == "sb3":  # a list of options for each gives the same bits
        rows = [{k: v[min(lane, len(v) - 1)] for k, v in given.items()} for lane in range(count)]
        again = begin(env, [{"parameters": row, "goal": (0.1, 0.1)} for row in rows], seed=5)
        np.testing.assert_array_equal(again, first)


@physics
def blown(strength):
    return strength


@dataclass(frozen=True)
class Wind(e.Effect):
    strength: float = 0.0
    carried: float = 0.1

    def hooks(self, arm):
        push = e.Force(0, blown, {"strength": ".strength"})
        return (push, e.PointMass(e.Point(arm.num_masses - 1), ".carried"))


def test_numbers_from_outside_have_the_units_that_are_given_or_that_hooks_show():
    scene = rde.load_scene("four_r_reach")
    scene = rde.Scene(scene.robot, (*scene.effects, Wind()), "rk4")
    patient = make_dataclass("PatientTask", [("patience", float, 8.0)], bases=(rde.ReachTask,), frozen=True)
    found = parameters_of(Core(scene, 2, patient()))
    assert found["wind.strength"].unit == found["patience"].unit == ""
    assert found["wind.carried"].unit == "kg"
    np.testing.assert_array_equal(found["patience"].value, [8.0, 8.0])
    assert (found["masses"].value == scene.robot.masses).all()  # the arm's own, without what it carries
    misspelt = type("Draught", (Wind,), {"units": lambda self, arm: {"strenght": "N"}})
    with pytest.raises(ValueError, match=r"\(Draught\).units has 'strenght'.*strength, carried"):
        rde.Scene(SCENE.robot, (misspelt(),))
    heavy = make_dataclass("HeavyTask", [("masses", float, 1.0)], bases=(rde.ReachTask,), frozen=True)
    with pytest.raises(ValueError, match=r"HeavyTask\.parameters has 'masses'"):
        Core(SCENE, 1, heavy())
