"""An environment says what it simulates: its scene, and all numbers with their units, on every face."""

from dataclasses import dataclass

import numpy as np
import pytest
from faces import FACES, every_face, sb3, single, vector
from test_task_numbers import begin

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.envs.core import Core
from redundant_envs.envs.parameters import parameters_of
from redundant_envs.tasks.checks import check_task

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


def values(parameters):
    return {name: parameter.value for name, parameter in parameters.items()}


@every_face
@pytest.mark.parametrize("env_id", ["redundant_envs/RPRPReach-v0", "redundant_envs/RPRPGoalReach-v0"])
def test_every_number_is_there_with_its_unit(make, env_id):
    env = make(id=env_id)
    assert env.scene == rde.load_scene("rprp_reach")
    assert {name: parameter.unit for name, parameter in env.parameters.items()} == UNITS
    assert (env.parameters["masses"].value == env.scene.robot.masses).all()
    assert (env.parameters["goal_tolerance"].value == 0.02).all()


def test_shapes_are_those_of_the_face():
    one, many = single().parameters, vector(3).parameters
    assert one["masses"].value.shape == (4,)
    assert many["masses"].value.shape == sb3(3).parameters["masses"].value.shape == (3, 4)
    assert one["gravity.g"].value == 9.81
    np.testing.assert_array_equal(many["gravity.g"].value, [9.81] * 3)


@every_face
def test_they_are_copies(make):
    env = make()
    env.parameters["masses"].value[:] = 7.0
    assert (env.parameters["masses"].value == env.scene.robot.masses).all()


@every_face
def test_they_follow_the_options_of_a_reset_and_are_options_of_the_next(make):
    env = make()
    given = {"masses": (1, 2, 3, 4), "viscous_friction.coefficients": 0.3, "hold_steps": 4, "gravity.g": 1.6}
    begin(env, {"parameters": given})
    for name, value in given.items():
        assert (env.parameters[name].value == value).all()
    before = values(env.parameters)
    begin(env, {"parameters": {}})
    assert (env.parameters["masses"].value == env.scene.robot.masses).all()
    begin(env, {"parameters": before})
    for name, value in values(env.parameters).items():
        np.testing.assert_array_equal(value, before[name])


def of_lanes(count):
    """A row for each environment."""
    rng = np.random.default_rng(0)
    return {
        "masses": rng.uniform(0.3, 0.8, (count, 4)),
        "gravity.g": rng.uniform(9, 10, count),
        "viscous_friction.coefficients": rng.uniform(0.1, 0.2, (1, 4)),  # one for all
        "hold_steps": np.arange(count) + 3,
    }


@pytest.mark.parametrize("face", ["vector", "sb3"])
@pytest.mark.parametrize("count", [1, 3, 4])
def test_arrays_of_options_have_one_row_for_each_environment(face, count):
    env, given = FACES[face](count), of_lanes(count)
    begin(env, {"parameters": given, "goal": np.full((count, 2), 0.1)})
    for name, value in given.items():
        np.testing.assert_array_equal(
            env.parameters[name].value, np.broadcast_to(value, env.parameters[name].value.shape)
        )
    np.testing.assert_array_equal(env.goal, np.full((count, 2), 0.1))


def test_options_of_stable_baselines3_give_the_bits_of_a_list_of_them():
    given = of_lanes(3)
    rows = [{"parameters": {k: v[min(lane, len(v) - 1)] for k, v in given.items()}} for lane in range(3)]
    together, apart = sb3(3), sb3(3)
    observations = [
        begin(env, options, seed=5) for env, options in ((together, {"parameters": given}), (apart, rows))
    ]
    np.testing.assert_array_equal(*observations)
    actions = np.full((3, 4), 0.3, np.float32)
    np.testing.assert_array_equal(together.step(actions)[0], apart.step(actions)[0])


def test_options_of_stable_baselines3_with_another_number_of_rows_are_refused_and_forgotten():
    env = sb3(3)
    env.set_options({"parameters": {"masses": np.ones((2, 4))}})
    with pytest.raises(ValueError, match=r"masses has shape \(2, 4\); give \(4,\) or \(3, 4\)"):
        env.reset()
    env.reset()
    assert (env.parameters["masses"].value == env.scene.robot.masses).all()


def test_options_given_by_name_or_as_a_list_replace_each_other():
    env = sb3(2)
    env.set_options({"goal": (0.1, 0.2)})
    env.set_options([{"goal": (0.2, 0.1)}, {}])
    env.reset()
    assert (env.goal[0] == (0.2, 0.1)).all()
    assert (env.goal[1] != (0.1, 0.2)).all()
    env.set_options({"goal": (0.1, 0.2)})
    env.set_options(None)
    env.reset()
    assert (env.goal != (0.1, 0.2)).all()


def test_stable_baselines3_reaches_them_as_attributes_of_each_environment():
    env = sb3(3)
    begin(env, {"parameters": {"gravity.g": [1.0, 2.0, 3.0]}})
    found = env.get_attr("parameters", indices=[0, 2])
    assert [p["gravity.g"].value for p in found] == [1.0, 3.0]
    assert found[0]["masses"].value.shape == (4,)
    assert env.get_attr("scene") == [env.scene] * 3
    with pytest.raises(ValueError, match="set_options"):
        env.set_attr("parameters", {})


def test_the_table_is_for_reading():
    lines = repr(single().parameters).splitlines()
    assert lines[0].split() == ["name", "value", "unit"]
    assert ["gravity.g", "9.81", "m/s^2"] in [line.split() for line in lines]
    assert any(
        line.startswith("masses  ") and "  0.5, 0.5, 0.5, 0.5  " in line and line.endswith(" kg")
        for line in lines
    )
    env = vector(3)
    begin(env, {"parameters": {"gravity.g": [1.0, 2.0, 3.0]}})
    text = repr(env.parameters)
    assert "value in 3 environments" in text.splitlines()[0]
    assert "1 to 3" in text
    assert max(map(len, text.splitlines())) < 110


def test_an_unknown_name_is_a_key_error():
    with pytest.raises(KeyError):
        single().parameters["mass"]


@physics
def blown(strength):
    return strength


@dataclass(frozen=True)
class Wind(rde.effects.Effect):
    strength: float = 0.0
    carried: float = 0.1

    def hooks(self, arm):
        tip = rde.effects.Point(arm.num_masses - 1)
        push = rde.effects.Force(0, blown, {"strength": ".strength"})
        return (push, rde.effects.PointMass(tip, ".carried"))


class Draught(Wind):
    def units(self, arm):
        return {"strenght": "N"}


@dataclass(frozen=True)
class PatientTask(rde.ReachTask):
    patience: float = 8.0


def with_effect(effect):
    scene = rde.load_scene("rprp_reach")
    return rde.Scene(scene.robot, (*scene.effects, effect), tolerance=1e-6)


def test_numbers_from_outside_have_the_units_that_are_given_or_that_hooks_show():
    scene = with_effect(Wind())
    found = parameters_of(Core(scene, 2, PatientTask()))
    assert found["wind.strength"].unit == found["patience"].unit == ""
    assert found["wind.carried"].unit == "kg"
    np.testing.assert_array_equal(found["patience"].value, [8.0, 8.0])
    assert (found["masses"].value == scene.robot.masses).all()  # the arm's own, without what it carries
    with pytest.raises(ValueError, match=r"\(Draught\).units has 'strenght'.*strength, carried"):
        with_effect(Draught())


def test_springs_have_the_units_of_their_joints():
    spring = rde.effects.LimitSpring
    scene = rde.load_scene("rprp_reach")
    effects = (spring("joint1", -2, 2, 10.0, 1.0), spring("r1", 0, 0.1))
    assert effects[0].units(scene.robot)["stiffness"] == "N m/rad"
    assert effects[0].units(scene.robot)["damping"] == "N m s/rad^2"
    assert effects[1].units(scene.robot) == {
        "lower": "m", "upper": "m", "stiffness": "N/m", "damping": "N s/m^2",
    }  # fmt: skip
    centring = rde.effects.CentringSpring((1, 1), (0, 0), (1, 1))
    assert centring.units(scene.robot) == {"stiffness": "N/m", "lower": "m", "upper": "m"}


def test_a_task_gives_units_to_numbers_that_it_has():
    class Misspelt(rde.ReachTask):
        units = {"goal_tolerence": "m"}

    with pytest.raises(ValueError, match=r"Misspelt.units has 'goal_tolerence'; choose"):
        check_task(Misspelt(), rde.load_scene("rprp_reach"))
