"""check_vec_env catches a broken environment for every rule it states."""

import itertools

import gymnasium as gym
import numpy as np
import pytest
from faces import FOUR_R, MODES, made
from gymnasium import spaces

import redundant_envs as rde
from redundant_envs.envs.check import SB3_RULES, VECTOR_RULES, BrokenRule


def changed(index, change):
    """Steps with another entry in their results."""

    def spoil(env, result):
        return (*result[:index], change(result[index]), *result[index + 1 :])

    return spoil


CALLS = itertools.count()


def broken(mode="next_step", reset=None, step=None, **values):
    """A vector environment, or one of stable-baselines3, whose results pass through functions.

    Those of resets take (environment, reset, seed, options), those of steps (environment, results).
    """
    env = made(mode, FOUR_R, max_episode_steps=6)
    name = "step_wait" if mode == "sb3" else "step"
    plain_reset, plain_step = env.reset, getattr(env, name)
    if reset:
        env.reset = lambda seed=None, options=None: reset(env, plain_reset, seed, options)
    if step:
        setattr(env, name, lambda *actions: step(env, plain_step(*actions)))
    vars(env).update(values)
    return env


def same_buffer(env, result):
    kept = vars(env).setdefault("kept", result[0].copy())
    kept[:] = result[0]
    return (kept, *result[1:])


def of_ends(**changes):
    """Steps whose infos have other entries where an episode ended."""

    def spoil(env, result):
        infos = [{**info, **changes} if ended else info for ended, info in zip(*result[2:], strict=True)]
        return (*result[:3], infos)

    return spoil


WIDE = spaces.Box(-2.0, 2.0, (3, 4), np.float32)
VECTOR = [
    ("spaces", {"action_space": WIDE}),
    ("autoreset_mode", {"metadata": {"autoreset_mode": "next_step"}}),
    ("reset", {"reset": lambda e, reset, s, o: (reset(seed=s, options=o)[0] + 5, {})}),
    ("seed", {"reset": lambda e, reset, s, o: reset(seed=next(CALLS), options=o)}),
    ("seed_list", {"reset": lambda e, reset, s, o: reset(seed=7 if isinstance(s, list) else s, options=o)}),
    ("step", {"step": lambda e, result: result[:4]}),
    ("step", {"step": changed(0, lambda obs: obs.astype(np.float64) + 3)}),
    ("reward", {"step": changed(1, lambda reward: reward[:, None])}),
    ("reward", {"step": changed(1, lambda reward: reward * np.nan)}),
    ("flags", {"step": changed(2, lambda terminated: terminated.astype(int))}),
    ("infos", {"step": changed(4, lambda infos: {"x": 1})}),
    ("fresh", {"step": same_buffer}),
    ("determinism", {"step": lambda e, result: (result[0], result[1] + 1e-9 * next(CALLS), *result[2:])}),
    ("next_step", {"step": lambda e, r: r if e.core.begun is None else (r[0], r[1] + e.core.begun, *r[2:])}),
    ("same_step", {"step": changed(4, lambda infos: {k: v for k, v in infos.items() if "final" not in k})}),
    ("reset_mask", {"reset": lambda e, reset, s, o: reset(seed=s)}),
]
MODE_OF = {"same_step": "same_step", "reset_mask": "disabled"}
SB3 = [
    ("reset", {"reset": lambda e, reset, s, o: (reset(), {})}),
    ("reset_infos", {"reset": lambda e, reset, s, o: (reset(), setattr(e, "reset_infos", None))[0]}),
    ("seed", {"reset": lambda e, reset, s, o: (e.seed(next(CALLS)), reset())[1]}),
    ("step", {"step": lambda e, result: (*result, {})}),
    ("reward", {"step": changed(1, lambda reward: reward.astype(np.float64))}),
    ("dones", {"step": changed(2, lambda dones: dones.astype(float))}),
    ("infos", {"step": changed(3, lambda infos: {})}),
    ("fresh", {"step": same_buffer}),
    ("terminal", {"step": of_ends(terminal_observation=np.full(20, 9.0))}),
    ("truncated", {"step": of_ends(**{"TimeLimit.truncated": 1})}),
    ("attributes", {"env_is_wrapped": lambda wrapper, indices=None: [False]}),
]


@pytest.mark.quick("rules0-spaces-next_step-spoils0")
@pytest.mark.parametrize(
    ("rules", "rule", "mode", "spoils"),
    [
        *((VECTOR_RULES, rule, MODE_OF.get(rule, "next_step"), spoils) for rule, spoils in VECTOR),
        *((SB3_RULES, rule, "sb3", spoils) for rule, spoils in SB3),
    ],
)
def test_a_broken_environment_is_caught(rules, rule, mode, spoils):
    with pytest.raises(BrokenRule) as error:
        rde.check_vec_env(broken(mode, **spoils))
    assert error.value.rule == rule
    assert rules[rule] in str(error.value)


def test_every_rule_has_a_case():
    assert {rule for rule, _ in VECTOR} == set(VECTOR_RULES)
    assert {rule for rule, _ in SB3} == set(SB3_RULES)


@pytest.mark.quick("disabled-2")
@pytest.mark.parametrize("steps", [1, 2, 3])
@pytest.mark.parametrize("mode", [*MODES, "sb3"])
def test_episodes_of_a_few_steps_pass(mode, steps):
    rde.check_vec_env(made(mode, FOUR_R, max_episode_steps=steps))


@pytest.mark.long
def test_one_environment_that_ends_early_passes():
    ends = {"decide_every": 7, "action": "joint_velocity"}  # with the seed of the checker, the third one
    rde.check_vec_env(made("disabled", "redundant_envs/FourRGoalReachAround-v0", 5, **ends))


def test_something_else_is_refused():
    with pytest.raises(ValueError, match=r"env is .*; give a gymnasium.vector.VectorEnv"):
        rde.check_vec_env(gym.make("CartPole-v1"))
