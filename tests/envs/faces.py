"""Every kind of environment by one name, and what tests do with all of them: begin, step, compare."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from catalogue import IDS

import redundant_envs as rde
from redundant_envs.envs.registration import IDS as registered

ID, FOUR_R = "redundant_envs/RPRPReach-v0", "redundant_envs/FourRReach-v0"
PLAIN_IDS, GOAL_IDS = ([i for i in IDS if registered[i].task == task] for task in ("Reach", "GoalReach"))
"""Of the reach task, with all arms."""
MODES = ("next_step", "same_step", "disabled")
STEPS = 6
"""Control steps of a short episode."""
RANGES = {
    "masses": {"scale": {"log_uniform": [0.8, 1.25]}, "shared": True},
    "lengths": {"scale": {"uniform": [0.9, 1.1]}},
    "gravity.g": {"normal": [9.81, 0.3], "within": [9.0, 10.0]},
    "viscous_friction.coefficients": {"choice": [0.05, 0.1, 0.3]},
    "goal_tolerance": {"uniform": [0.01, 0.03]},
    "hold_steps": {"choice": [3, 5, 8]},
}
"""Of every form, for numbers with entries and without."""


def with_effects(env_id, *effects):
    """The data of the scene of an id with some effects more."""
    scene = gym.make(f"redundant_envs/{env_id}").unwrapped.scene
    return dataclasses.replace(scene, effects=(*scene.effects, *effects)).to_dict()


def drawing(randomize=RANGES, name="four_r_reach"):
    """The data of a scene whose episodes draw numbers."""
    return {**rde.load_scene(name).to_dict(), "randomize": randomize}


def made(kind, env_id=ID, count=3, **kwargs):
    """An environment of a kind: "single", "sb3", or a vector with one of the autoreset modes.

    A single one keeps its wrapper, which ends episodes, if it is given their length.
    """
    if kind == "single":
        env = gym.make(env_id, disable_env_checker=True, **kwargs)
        return env if "max_episode_steps" in kwargs else env.unwrapped
    if kind == "sb3":
        return rde.make_sb3(env_id, count, **kwargs)
    return gym.make_vec(env_id, num_envs=count, autoreset_mode=kind, **kwargs)


KINDS = ("single", *MODES, "sb3")
FACES = ("single", "next_step", "sb3")


def begin(env, options=None, seed=None):
    """Reset any kind; the observations."""
    if isinstance(env, gym.Env | gym.vector.VectorEnv):
        return env.reset(seed=seed, options=options)[0]
    if seed is not None:
        env.seed(seed)
    env.set_options(options)
    return env.reset()


def actions(env, steps=2 * STEPS + 3, seed=2):
    """Random actions of some steps, some of them beyond their bounds."""
    lanes = () if isinstance(env, gym.Env) else (env.num_envs,)
    shape = (*lanes, env.action_space.shape[-1])
    return np.random.default_rng(seed).uniform(-1.2, 1.2, (steps, *shape)).astype(np.float32)


def running(kind, *args, seed=3, **kwargs):
    """An environment in the middle of an episode."""
    env = made(kind, *args, **kwargs)
    begin(env, seed=seed)
    env.step(actions(env, 1)[0])
    return env


def flat(value):
    """All numbers in the outputs of an environment, in a fixed order, but for times on a clock."""
    if isinstance(value, dict):
        return [x for k in sorted(value) if k != "t" for x in flat(value[k])]
    if isinstance(value, list | tuple) or getattr(value, "dtype", None) == np.object_:
        return [x for v in value for x in flat(v)]
    return [] if value is None else np.asarray(value, float).ravel().tolist()


def motion(env, table=None):
    """All that some steps and the resets between them give."""
    rows = []
    for action in actions(env) if table is None else table:
        ended = np.zeros(1, bool) if isinstance(env, gym.Env) else env.core.ended
        if ended.any():  # of a vector that begins nothing itself
            rows.append(flat(env.reset(options={"reset_mask": ended.copy()})))
        result = env.step(action)
        rows.append(flat(result))
        if isinstance(env, gym.Env) and (result[2] or result[3]):
            rows.append(flat(env.reset()))
    return [*rows, flat(env.reset())]


def plain(value):
    """The whole content of a state, in a comparable form."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, list):
        return [plain(v) for v in value]
    if isinstance(value, np.random.Generator):
        return plain(value.bit_generator.state)
    return value.tolist() if isinstance(value, np.ndarray) else value


def parts(env):
    """The state that a refused call must not change."""
    state = plain(env.get_state())
    if isinstance(env, gym.Env):
        assert env.core.generators[0] is env.np_random
        state |= {"np_random": plain(env.np_random), "np_random_seed": env.np_random_seed}
    return state


def refused(env, call, words=""):
    """A call raises a short ValueError with these words, and changes nothing; its message."""
    before = parts(env)
    with pytest.raises(ValueError, match=words) as error:
        call(env)
    assert len(str(error.value)) < 500
    assert parts(env) == before
    return str(error.value)
