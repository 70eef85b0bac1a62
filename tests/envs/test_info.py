"""``info`` of a step: it is a dict to everyone, with the values of its step whenever they are read."""

import copy
import json
import pickle
from collections import ChainMap

import gymnasium as gym
import numpy as np
import pytest
from catalogue import COPIES
from faces import FOUR_R, ID
from gymnasium.wrappers import RecordEpisodeStatistics
from gymnasium.wrappers.vector import DictInfoToList
from gymnasium.wrappers.vector import RecordEpisodeStatistics as VectorStatistics
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from redundant_envs.envs.outputs import UNREAD, Info

ENV = gym.make(ID)
ENV.reset(seed=0)
EXTRA = {"episode": {"r": 1.0}}


def fresh():
    """An unread info, and the same numbers as a plain dict."""
    lane = ENV.unwrapped._lane
    info, plain = lane.info(), dict(lane.info().items())
    assert type(plain) is dict
    assert list(dict.items(info)) == [(name, UNREAD) for name in plain]
    assert UNREAD not in plain.values()
    assert all(type(v) in (bool, int, float) for v in plain.values())
    return info, plain


def changed(do):
    """What a change leaves, and what it returns."""

    def use(info):
        result = do(info)
        return type(info)(info) if type(info) is dict else dict(info.items()), result

    return use


USES = {
    "index": lambda d: d["distance"],
    "get": lambda d: (d.get("distance"), d.get("nothing"), d.get("nothing", 3)),
    "in": lambda d: ("distance" in d, "nothing" in d),
    "len": len,
    "bool": bool,
    "list": list,
    "reversed": lambda d: list(reversed(d)),
    "keys": lambda d: list(d.keys()),
    "values": lambda d: list(d.values()),
    "items": lambda d: list(d.items()),
    "dict": dict,
    "dict and more": lambda d: dict(d, more=1),
    "display": lambda d: {**d, "more": 1},
    "arguments": lambda d: (lambda **named: named)(**d),
    "or": lambda d: d | EXTRA,
    "or of a dict": lambda d: EXTRA | d,
    "or itself": lambda d: d | d,
    "update of a dict": lambda d: (made := {"more": 1}, made.update(d))[0],
    "or in place of a dict": lambda d: {"more": 1}.__ior__(d),
    "chain map": lambda d: dict(ChainMap(EXTRA, d)),
    "json": json.dumps,
    "json of a list": lambda d: json.dumps([d, {"info": d}]),
    "indented json": lambda d: json.dumps(d, indent=1, sort_keys=True),
    **COPIES,
    "own copy": lambda d: d.copy(),
    "deep copy of a list": lambda d: copy.deepcopy([d]),
    "pickle of a list": lambda d: pickle.loads(pickle.dumps([d, d], protocol=2)),
    "repr": repr,
    "str": str,
    "format": lambda d: "{distance:.17g} %(distance).17g".format(**d) % d,
    "format_map": lambda d: "{distance!r}".format_map(d),
    "equal": lambda d: (d == fresh()[1], fresh()[1] == d, d == {}, [d] == [fresh()[1]]),
    "unequal": lambda d: (d != fresh()[1], fresh()[1] != d, d != {}, d == fresh()[0], d != fresh()[0]),
    "set": changed(lambda d: d.__setitem__("episode", 1)),
    "set a value of its own": changed(lambda d: d.__setitem__("distance", -1.0)),
    "delete": changed(lambda d: d.__delitem__("distance")),
    "pop": changed(lambda d: (d.pop("distance"), d.pop("nothing", 4))),
    "popitem": changed(lambda d: d.popitem()),
    "setdefault": changed(lambda d: (d.setdefault("distance", 0.0), d.setdefault("new", 1))),
    "update": changed(lambda d: d.update(EXTRA, distance=2.0)),
    "update in place": changed(lambda d: d.__ior__(EXTRA) and None),
    "clear": changed(lambda d: d.clear()),
    "match": lambda d: matched(d),
}


def matched(given):
    match given:
        case {"distance": distance, **rest}:
            return distance, rest


@pytest.mark.parametrize("use", USES.values(), ids=USES)
def test_an_unread_info_is_used_as_a_dict(use):
    info, plain = fresh()
    assert isinstance(info, dict)
    assert repr(use(info)) == repr(use(plain))


def test_every_method_of_dict_reads_first_or_tells_no_value():
    tell_no_value = {"__contains__", "__len__", "keys", "__sizeof__", "fromkeys", "__class_getitem__"}
    made = {"__new__", "__init__", "__getattribute__", "__doc__", "__hash__"}
    refused = {"__lt__", "__le__", "__gt__", "__ge__"}
    assert set(vars(dict)) - set(vars(Info)) <= tell_no_value | made | refused


def test_a_copy_is_a_plain_dict_and_an_info_of_ones_own_works():
    for way in (*COPIES.values(), USES["own copy"]):
        assert type(way(fresh()[0])) is dict
    assert Info(a=1)["a"] == 1
    assert json.dumps(Info({"a": 1})) == '{"a": 1}'


def test_an_info_keeps_the_values_of_its_step():
    env = gym.make(FOUR_R)
    _, first = env.reset(seed=0)
    infos = [env.step(np.full(4, 0.3, np.float32))[4] for _ in range(4)]
    env.reset(seed=1)
    assert [first["episode_steps"], *(info["episode_steps"] for info in infos)] == [0, 1, 2, 3, 4]
    assert len({info["distance"] for info in infos}) == 4


def test_infos_of_many_environments_keep_the_values_of_their_step():
    envs = gym.make_vec(FOUR_R, num_envs=9)
    envs.reset(seed=0)
    infos = [envs.step(envs.action_space.sample())[4] for _ in range(3)]
    envs.reset(seed=1)
    assert [dict.get(infos[0], name) for name in ("distance", "_distance")] == [UNREAD, UNREAD]
    for k, info in enumerate(infos, start=1):
        assert info["episode_steps"].tolist() == [k] * 9
        assert info["_distance"].tolist() == [True] * 9
        assert type(pickle.loads(pickle.dumps(info))) is dict
    assert len({float(info["distance"][8]) for info in infos}) == 3


def test_programs_that_write_into_infos_take_them():
    env = RecordEpisodeStatistics(gym.make(FOUR_R, max_episode_steps=2))
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


def test_a_program_that_reads_past_the_methods_gets_no_number():
    with pytest.raises(TypeError, match="not JSON serializable"):
        json.dumps(dict.copy(Info(dict.fromkeys(["a"], UNREAD))))
