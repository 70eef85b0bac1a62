"""``info`` is a plain dict: of Python numbers in single environments and in stable-baselines3, of arrays with
masks in vectors; ``info_keys`` chooses what it has."""

import json

import gymnasium as gym
import numpy as np
import pytest
import yaml
from faces import FACES, FOUR_R, STEPS, actions, drawing, made
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.wrappers.vector import DictInfoToList
from gymnasium.wrappers.vector import RecordEpisodeStatistics as VectorStatistics
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

PLAIN = {dict, list, bool, int, float}


def infos_of(env, steps=STEPS):
    """All infos of some steps and the reset before them."""
    if isinstance(env, gym.Env | gym.vector.VectorEnv):
        return [env.reset(seed=0)[1], *(env.step(action)[-1] for action in actions(env, steps))]
    env.seed(0)
    env.reset()
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


CHOSEN = ("distance", "return_end", "is_success")


@pytest.mark.parametrize("kind", FACES)
def test_info_has_the_keys_that_were_asked_for_with_the_same_values(kind):
    of_sb3 = ("TimeLimit.truncated", "terminal_observation", "episode")
    few, whole = (made(kind, FOUR_R, info_keys=keys, max_episode_steps=3) for keys in (CHOSEN, "all"))
    names = set()
    for one, other in zip(infos_of(few), infos_of(whole), strict=True):
        own = {k: v for k, v in one.items() if k not in of_sb3}
        names |= {k for k in own if not k.startswith("_")}
        assert data_equivalence(own, {k: other[k] for k in own})
    assert names == {*CHOSEN}
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
