"""check_vec_env catches a broken environment for every rule it states."""

import copy

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

import redundant_envs as rde
from redundant_envs.envs.check import SB3_RULES, VECTOR_RULES, BrokenRule
from redundant_envs.envs.sb3 import SB3VecEnv
from redundant_envs.envs.vector_env import ArmVectorEnv

KWARGS = {"scene": "four_r_reach", "num_envs": 3, "max_episode_steps": 6}


class Broken(ArmVectorEnv):
    """A vector environment whose results pass through ``spoil`` functions."""

    def __init__(self, mode="next_step", spoil_reset=None, spoil_step=None):
        super().__init__(**KWARGS, autoreset_mode=mode)
        self.spoil_reset, self.spoil_step = spoil_reset, spoil_step
        self.calls = 0
        self.kept = None

    def reset(self, *, seed=None, options=None):
        self.calls += 1
        if self.spoil_reset:
            return self.spoil_reset(self, super().reset, seed, options)
        return super().reset(seed=seed, options=options)

    def step(self, actions):
        self.calls += 1
        result = super().step(actions)
        return self.spoil_step(self, list(result)) if self.spoil_step else result


def changed(index, change):
    def spoil(env, result):
        result[index] = change(result[index])
        return tuple(result)

    return spoil


def reward_after_the_end(env, result):
    begun = env.core.begun
    if begun is not None:
        result[1] = result[1] + begun
    return tuple(result)


def same_buffer(env, result):
    if env.kept is None:
        env.kept = result[0].copy()
    env.kept[:] = result[0]
    result[0] = env.kept
    return tuple(result)


def noisy_later(env, result):
    result[1] = result[1] + 1e-9 * env.calls
    return tuple(result)


def without_final(env, result):
    result[4] = {k: v for k, v in result[4].items() if "final" not in k}
    return tuple(result)


def outside_final(env, result):
    if "final_obs" in result[4]:
        for n in np.flatnonzero(result[4]["_final_obs"]):
            result[4]["final_obs"][n] = result[4]["final_obs"][n] + 9
    return tuple(result)


def ignores_mask(env, reset, seed, options):
    return reset(seed=seed)


def ignores_lists(env, reset, seed, options):
    return reset(seed=7 if isinstance(seed, list) else seed, options=options)


def ignores_seeds(env, reset, seed, options):
    return reset(seed=env.calls, options=options)


def wrong_mode():
    env = Broken()
    env.metadata = {**env.metadata, "autoreset_mode": "next_step"}
    return env


def wrong_spaces():
    env = Broken()
    env.action_space = spaces.Box(-2.0, 2.0, (3, 4), np.float32)
    return env


VECTOR_CASES = {
    "spaces": [wrong_spaces],
    "autoreset_mode": [wrong_mode],
    "reset": [
        lambda: Broken(spoil_reset=lambda e, r, s, o: r(seed=s, options=o)[0]),
        lambda: Broken(spoil_reset=lambda e, r, s, o: (r(seed=s, options=o)[0] + 5, {})),
    ],
    "seed": [lambda: Broken(spoil_reset=ignores_seeds)],
    "seed_list": [lambda: Broken(spoil_reset=ignores_lists)],
    "step": [
        lambda: Broken(spoil_step=lambda e, r: tuple(r[:4])),
        lambda: Broken(spoil_step=changed(0, lambda o: o.astype(np.float64) + 3)),
    ],
    "reward": [
        lambda: Broken(spoil_step=changed(1, lambda r: r[:, None])),
        lambda: Broken(spoil_step=changed(1, lambda r: r * np.nan)),
    ],
    "flags": [lambda: Broken(spoil_step=changed(2, lambda t: t.astype(int)))],
    "infos": [
        lambda: Broken(spoil_step=changed(4, lambda i: [i])),
        lambda: Broken(spoil_step=changed(4, lambda i: {"x": 1})),
    ],
    "fresh": [lambda: Broken(spoil_step=same_buffer)],
    "determinism": [lambda: Broken(spoil_step=noisy_later)],
    "next_step": [lambda: Broken(spoil_step=reward_after_the_end)],
    "same_step": [
        lambda: Broken("same_step", spoil_step=without_final),
        lambda: Broken("same_step", spoil_step=outside_final),
    ],
    "reset_mask": [lambda: Broken("disabled", spoil_reset=ignores_mask)],
}


def test_every_vector_rule_has_a_case():
    assert set(VECTOR_CASES) == set(VECTOR_RULES)


@pytest.mark.parametrize(("rule", "make"), [(r, m) for r, ms in VECTOR_CASES.items() for m in ms])
def test_a_broken_vector_environment_is_caught(rule, make):
    with pytest.raises(BrokenRule) as error:
        rde.check_vec_env(make())
    assert error.value.rule == rule
    assert VECTOR_RULES[rule] in str(error.value)


def core():
    return rde.make_sb3("FourRReach-v0", **KWARGS).core


class BrokenSB3(SB3VecEnv):
    """An SB3 environment whose results pass through ``spoil`` functions."""

    def __init__(self, spoil_reset=None, spoil_step=None):
        self.spoil_reset, self.spoil_step = spoil_reset, spoil_step
        self.calls = 0
        self.kept = None
        super().__init__(core())

    def reset(self):
        self.calls += 1
        if self.spoil_reset:
            return self.spoil_reset(self, super().reset)
        return super().reset()

    def step_wait(self):
        result = list(super().step_wait())
        return self.spoil_step(self, result) if self.spoil_step else tuple(result)


def forget_seeds(env, reset):
    env.seed(env.calls)
    return reset()


def no_reset_infos(env, reset):
    obs = reset()
    env.reset_infos = None
    return obs


def spoil_info(change):
    def spoil(env, result):
        infos = copy.deepcopy(result[3])
        for info, done in zip(infos, result[2], strict=True):
            if done:
                change(info)
        result[3] = infos
        return tuple(result)

    return spoil


class ShortAttributes(SB3VecEnv):
    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False]


SB3_CASES = {
    "reset": [lambda: BrokenSB3(spoil_reset=lambda e, r: (r(), {}))],
    "reset_infos": [lambda: BrokenSB3(spoil_reset=no_reset_infos)],
    "seed": [lambda: BrokenSB3(spoil_reset=forget_seeds)],
    "step": [
        lambda: BrokenSB3(spoil_step=lambda e, r: (*r, {})),
        lambda: BrokenSB3(spoil_step=changed(0, lambda o: o + 3)),
    ],
    "reward": [lambda: BrokenSB3(spoil_step=changed(1, lambda r: r.astype(np.float64)))],
    "dones": [lambda: BrokenSB3(spoil_step=changed(2, lambda d: d.astype(float)))],
    "infos": [lambda: BrokenSB3(spoil_step=changed(3, lambda i: {}))],
    "fresh": [lambda: BrokenSB3(spoil_step=same_buffer)],
    "terminal": [
        lambda: BrokenSB3(spoil_step=spoil_info(lambda i: i.pop("terminal_observation"))),
        lambda: BrokenSB3(spoil_step=spoil_info(lambda i: i.update(terminal_observation=np.full(20, 9.0)))),
    ],
    "truncated": [lambda: BrokenSB3(spoil_step=spoil_info(lambda i: i.update({"TimeLimit.truncated": 1})))],
    "attributes": [lambda: ShortAttributes(core())],
}


def test_every_sb3_rule_has_a_case():
    assert set(SB3_CASES) == set(SB3_RULES)


@pytest.mark.parametrize(("rule", "make"), [(r, m) for r, ms in SB3_CASES.items() for m in ms])
def test_a_broken_sb3_environment_is_caught(rule, make):
    with pytest.raises(BrokenRule) as error:
        rde.check_vec_env(make())
    assert error.value.rule == rule


@pytest.mark.parametrize("mode", ["next_step", "same_step", "disabled"])
def test_the_unbroken_ones_pass(mode):
    rde.check_vec_env(Broken(mode))
    rde.check_vec_env(BrokenSB3())


def test_something_else_is_refused():
    with pytest.raises(ValueError, match=r"env is .*; give a gymnasium.vector.VectorEnv"):
        rde.check_vec_env(gym.make("CartPole-v1"))
