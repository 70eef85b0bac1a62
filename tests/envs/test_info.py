"""``info`` is a plain dict: of Python numbers in single environments and in stable-baselines3, of arrays with
masks in vectors; ``info_keys`` chooses what it has."""

import json
import operator
from dataclasses import dataclass, make_dataclass

import gymnasium as gym
import numpy as np
import pytest
import yaml
from faces import FACES, FOUR_R, ID, STEPS, actions, begin, drawing, made, running
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.wrappers.vector import DictInfoToList
from gymnasium.wrappers.vector import RecordEpisodeStatistics as VectorStatistics
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

import redundant_envs as rde
from redundant_envs.envs.core import Core
from redundant_envs.envs.face import parameters_of
from redundant_envs.language.algebra import physics

PLAIN = {dict, list, bool, int, float}


def infos_of(env, steps=STEPS):
    """All infos of some steps and the reset before them."""
    if isinstance(env, gym.Env | gym.vector.VectorEnv):
        return [env.reset(seed=0)[1], *(env.step(action)[-1] for action in actions(env, steps))]
    begin(env, seed=0)
    told = [info for action in actions(env, steps) for info in env.step(action)[-1]]
    return [*env.reset_infos, *told]


def types(value):
    """The types of all that a value holds."""
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return {type(value)}.union(*map(types, inner))


@pytest.mark.quick("drawing-None", "fixed-all")
@pytest.mark.parametrize("info_keys", [None, "all"])
@pytest.mark.parametrize("data", [None, drawing()], ids=["fixed", "drawing"])
def test_info_is_plain_data(data, info_keys):
    scene = {} if data is None else {"scene": data}
    for info in infos_of(made("single", FOUR_R, info_keys=info_keys, **scene)):
        assert types(info) <= PLAIN
        assert json.loads(json.dumps(info)) == yaml.safe_load(yaml.safe_dump(info)) == info
    for info in infos_of(made("sb3", FOUR_R, **scene)):
        assert types(info) <= {*PLAIN, np.ndarray}  # of SB3's terminal observation
    for infos in infos_of(made("same_step", FOUR_R, info_keys=info_keys, max_episode_steps=3, **scene)):
        assert types(infos) == {dict, np.ndarray}
        for name, value in infos.items():
            there = infos["_" + name.removeprefix("_")]
            assert (there.shape, there.dtype) == ((3,), np.bool_)
            assert isinstance(value, dict) or len(value) == 3


def test_an_info_keeps_the_values_of_its_step():
    assert [info["episode_steps"] for info in infos_of(made("single", FOUR_R), 4)] == [0, 1, 2, 3, 4]
    env = made("next_step", FOUR_R)
    infos = infos_of(env, 4)
    assert [info["episode_steps"].tolist() for info in infos] == [[k] * 3 for k in range(5)]
    masks = [name for name in infos[-1] if name.startswith("_")]
    infos[-1][masks[0]][:] = False  # it is one's own
    assert all(infos[-1][name].all() for name in masks[1:])
    assert env.step(actions(env, 1)[0])[4][masks[0]].all()


@pytest.mark.parametrize("kind", FACES)
def test_info_has_the_keys_that_were_asked_for_with_the_same_values(kind):
    of_sb3 = ("TimeLimit.truncated", "terminal_observation", "episode")
    chosen = ("distance", "return_end", "is_success")
    few, whole = (made(kind, FOUR_R, info_keys=keys, max_episode_steps=3) for keys in (chosen, "all"))
    names = set()
    for one, other in zip(infos_of(few), infos_of(whole), strict=True):
        own = {k: v for k, v in one.items() if k not in of_sb3}
        names |= {k for k in own if not k.startswith("_")}
        assert data_equivalence(own, {k: other[k] for k in own})
    assert names == {*chosen}
    assert not infos_of(made(kind, FOUR_R, info_keys=()))[0]


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (("distanze",), "info_keys has 'distanze'; valid: is_success, .*return_end$"),
        (("parameters",), "info_keys has 'parameters'; valid"),  # of scenes that draw some
        ((["distance"],), r"info_keys has \['distance'\]; valid"),
        ("distance", "info_keys is 'distance'; give a list of names"),
        ({"distance"}, "info_keys is .*; give a list of names"),
    ],
)
def test_unknown_keys_are_refused(face, keys, words):
    with pytest.raises(ValueError, match=words):
        made(face, FOUR_R, info_keys=keys)


def test_programs_that_write_into_infos_take_them():
    env = gym.wrappers.RecordEpisodeStatistics(gym.make(FOUR_R, max_episode_steps=2))
    envs = DictInfoToList(VectorStatistics(gym.make_vec(FOUR_R, num_envs=3, max_episode_steps=2)))
    venv = DummyVecEnv([lambda: Monitor(gym.make(FOUR_R, max_episode_steps=2))])
    env.reset(seed=0)
    envs.reset(seed=0)
    venv.reset()
    for steps in (1, 2):
        infos = [
            env.step(env.action_space.sample())[4], *envs.step(envs.action_space.sample())[4],
            *venv.step(np.zeros((1, 4), np.float32))[3],
        ]  # fmt: skip
        assert [info["episode_steps"] for info in infos] == [steps] * 5
    assert [int(info["episode"]["l"]) for info in infos] == [2] * 5


# ---- stable-baselines3 -------------------------------------------------------------------------------


def test_attributes_are_given_per_environment(env_id):
    env = running("sb3", env_id, 4)
    begin(env, {"parameters": {"gravity.g": [1.0, 2.0, 3.0, 4.0]}})
    for name in ("q", "qd", "tip", "goal"):
        for chosen in (None, [2, 0], 1):
            rows = np.arange(4)[slice(None) if chosen is None else np.atleast_1d(chosen)]
            np.testing.assert_array_equal(env.get_attr(name, indices=chosen), getattr(env, name)[rows])
    found = env.get_attr("parameters", indices=[0, 2])
    assert [p["gravity.g"].value for p in found] == [1.0, 3.0]
    assert found[0]["masses"].value.shape == (env.scene.robot.num_masses,)
    for name, value in (("q", 0.0), ("parameters", {})):
        with pytest.raises(ValueError, match="set_options"):
            env.set_attr(name, value)
    with pytest.raises(ValueError, match="set_options"):  # all share it
        env.set_attr("on_bad_action", "raise", [0])
    env.set_attr("on_bad_action", "raise")
    assert env.get_attr("on_bad_action") == ["raise"] * 4
    assert env.env_is_wrapped(VecMonitor) == [False] * 4
    assert len(env.env_method("get_state", indices=[0, 2])) == 2
    assert not env.has_attr("nothing_of_that_name")


@pytest.mark.quick(ID)
@pytest.mark.parametrize("env_id", [ID, "redundant_envs/RPRPGoalReach-v0"])
def test_episodes_are_those_that_vec_monitor_counts(env_id):
    own = made("sb3", env_id, 5, max_episode_steps=7)
    other = VecMonitor(made("sb3", env_id, 5, monitor=False, max_episode_steps=7))
    for env in (own, other):
        env.seed(3)
        env.reset()
        assert env.env_is_wrapped(Monitor) == [env is own] * 5
    ended = 0
    for step, action in enumerate(actions(own, 20)):
        if step == 10:
            action[2] = np.nan  # ends that episode
        (*_, dones, infos), (*_, expected) = own.step(action), other.step(action)
        for done, info, theirs in zip(dones, infos, expected, strict=True):
            assert ("episode" in info) == bool(done)
            if done:
                ended += 1
                assert info["episode"]["l"] == theirs["episode"]["l"]
                assert info["episode"]["r"] == pytest.approx(float(theirs["episode"]["r"]), abs=2e-6)
                assert info["episode"]["t"] >= 0.0
                assert [type(info["episode"][k]) for k in "rlt"] == [float, int, float]
    assert ended == 11


# ---- numbers with their units ------------------------------------------------------------------------

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
        with pytest.raises((ValueError, AttributeError, TypeError), match=r"set_options|assign"):
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


@dataclass(frozen=True)
class Wind(e.Effect):
    strength: float = 0.0
    carried: float = 0.1

    def hooks(self, arm):
        push = e.Force(0, physics(lambda strength: strength), {"strength": ".strength"})
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
