"""A checker of vector environments, for Gymnasium's VectorEnv and stable-baselines3's VecEnv.

Each rule has a name and one sentence; a violation raises :class:`BrokenRule` with both.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

VECTOR_RULES = {
    "spaces": "observation_space and action_space are batch_space(single space, num_envs)",
    "autoreset_mode": "metadata['autoreset_mode'] is a gymnasium.vector.AutoresetMode",
    "reset": "reset returns (observations, infos), the observations inside observation_space",
    "seed": "equal seeds give equal first observations",
    "seed_list": "an integer seed s equals the list [s, s + 1, ...]",
    "step": "step returns observations inside observation_space and four more values",
    "reward": "rewards are finite floats of shape (num_envs,)",
    "flags": "terminated and truncated are bool arrays of shape (num_envs,)",
    "infos": "infos is a dict whose entries have a bool mask '_<key>' of shape (num_envs,)",
    "fresh": "returned observations are not changed or returned again by later steps",
    "determinism": "equal seeds and actions give equal observations and rewards",
    "next_step": "after an end, NEXT_STEP ignores the action: reward 0, no flags",
    "same_step": "at an end, SAME_STEP gives final_obs inside the single space, and final_info",
    "reset_mask": "reset with options['reset_mask'] changes only the environments of the mask",
}
SB3_RULES = {
    "reset": "reset returns observations alone, inside the batched observation space",
    "reset_infos": "reset_infos is a list of num_envs dicts",
    "seed": "seed(s) before reset gives equal first observations each time",
    "step": "step returns (observations, rewards, dones, infos)",
    "reward": "rewards are finite float32 of shape (num_envs,)",
    "dones": "dones are bool of shape (num_envs,)",
    "infos": "infos is a list of num_envs dicts",
    "fresh": "returned observations are not changed or returned again by later steps",
    "terminal": "an ended environment has terminal_observation inside the observation space",
    "truncated": "an ended environment has a bool TimeLimit.truncated",
    "attributes": "get_attr('render_mode') and env_is_wrapped give num_envs entries",
}
MOST_STEPS = 1000


class BrokenRule(AssertionError):
    """A rule that an environment breaks; ``rule`` is its name."""

    def __init__(self, rule: str, sentence: str, found: str) -> None:
        self.rule = rule
        super().__init__(f"{rule}: {sentence}; found: {found}")


def check_vec_env(env: Any, seed: int = 123) -> None:
    """Check a vector environment against the contract of its library.

    Parameters
    ----------
    env : gymnasium.vector.VectorEnv or stable_baselines3 VecEnv
        It is reset and stepped until an episode ends (at most 1000 steps).
    seed : int

    Raises
    ------
    BrokenRule
        Naming the first rule that does not hold.
    """
    if isinstance(env, VectorEnv):
        _check_vector_env(env, seed)
    elif hasattr(env, "step_async") and hasattr(env, "env_method"):
        _check_sb3(env, seed)
    else:
        raise ValueError(
            f"env is {type(env).__name__}; give a gymnasium.vector.VectorEnv or a stable_baselines3 VecEnv"
        )


def _need(rules: dict[str, str], rule: str, holds: Any, found: Callable[[], str]) -> None:
    if not holds:
        raise BrokenRule(rule, rules[rule], found())


def same(a: Any, b: Any) -> bool:
    """Whether two observations are equal to the last bit."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    return bool(np.array_equal(a, b))


def _check_vector_env(env: Any, seed: int) -> None:
    def need(rule: str, holds: Any, found: Callable[[], str]) -> None:
        _need(VECTOR_RULES, rule, holds, found)

    n = env.num_envs
    need(
        "spaces",
        env.observation_space == batch_space(env.single_observation_space, n)
        and env.action_space == batch_space(env.single_action_space, n),
        lambda: f"{env.observation_space}, {env.action_space}",
    )
    mode = env.metadata.get("autoreset_mode")
    need("autoreset_mode", isinstance(mode, AutoresetMode), lambda: repr(mode))

    result = env.reset(seed=seed)
    pair = isinstance(result, tuple) and len(result) == 2 and isinstance(result[1], dict)
    need("reset", pair, lambda: type(result).__name__)
    first, infos = result
    need("reset", env.observation_space.contains(first), lambda: _describe(first))
    _check_infos(need, infos, n)
    first = copy.deepcopy(first)
    again, _ = env.reset(seed=seed)
    need("seed", same(first, again), lambda: "different observations")
    listed, _ = env.reset(seed=[seed + i for i in range(n)])
    need("seed_list", same(first, listed), lambda: "different observations")

    env.action_space.seed(seed)
    actions = [env.action_space.sample() for _ in range(5)]
    one = _rollout(env, seed, actions, need)
    two = _rollout(env, seed, actions, need)
    equal = all(same(a[0], b[0]) and np.array_equal(a[1], b[1]) for a, b in zip(one, two, strict=True))
    need("determinism", equal, lambda: "different observations or rewards")
    _check_ends(env, mode, seed, need)


def _rollout(env: Any, seed: int, actions: list[Any], need: Callable[..., None]) -> list[Any]:
    obs, _ = env.reset(seed=seed)
    kept, copies, steps = [obs], [copy.deepcopy(obs)], []
    for action in actions:
        result = env.step(action)
        need("step", isinstance(result, tuple) and len(result) == 5, lambda: "another shape")
        obs, reward, terminated, truncated, infos = result
        _check_step(env, obs, reward, terminated, truncated, infos, need)
        need("fresh", all(obs is not k for k in kept), lambda: "the same object again")
        kept.append(obs)
        copies.append(copy.deepcopy(obs))
        steps.append((copies[-1], np.array(reward)))
    unchanged = all(same(a, b) for a, b in zip(kept, copies, strict=True))
    need("fresh", unchanged, lambda: "an array that changed later")
    return steps


def _check_step(
    env: Any, obs: Any, reward: Any, terminated: Any, truncated: Any, infos: Any,
    need: Callable[..., None],
) -> None:  # fmt: skip
    n = env.num_envs
    need("step", env.observation_space.contains(obs), lambda: _describe(obs))
    shaped = isinstance(reward, np.ndarray) and reward.shape == (n,) and reward.dtype.kind == "f"
    need("reward", shaped and np.isfinite(reward).all(), lambda: _describe(reward))
    for flags in (terminated, truncated):
        good = isinstance(flags, np.ndarray) and flags.shape == (n,) and flags.dtype == np.bool_
        need("flags", good, lambda: _describe(flags))  # noqa: B023
    _check_infos(need, infos, n)


def _check_infos(need: Callable[..., None], infos: Any, n: int) -> None:
    need("infos", isinstance(infos, dict), lambda: type(infos).__name__)
    for key in infos:
        if not key.startswith("_"):
            mask = infos.get(f"_{key}")
            good = isinstance(mask, np.ndarray) and mask.shape == (n,) and mask.dtype == np.bool_
            need("infos", good, lambda: f"no mask for {key!r}")  # noqa: B023


def _check_ends(env: Any, mode: Any, seed: int, need: Callable[..., None]) -> None:
    env.reset(seed=seed)
    for _ in range(MOST_STEPS):
        obs, reward, terminated, truncated, infos = env.step(env.action_space.sample())
        _check_step(env, obs, reward, terminated, truncated, infos, need)
        ended = terminated | truncated
        if ended.any():
            break
    else:
        return
    lane = int(np.flatnonzero(ended)[0])
    if mode is AutoresetMode.NEXT_STEP:
        _, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        quiet = reward[lane] == 0.0 and not terminated[lane] and not truncated[lane]
        need("next_step", quiet, lambda: f"reward {reward[lane]} in environment {lane}")
    elif mode is AutoresetMode.SAME_STEP:
        final = infos.get("final_obs")
        good = final is not None and "final_info" in infos and "_final_obs" in infos
        need("same_step", good, lambda: f"infos with {sorted(infos)}")
        inside = env.single_observation_space.contains(final[lane])
        need("same_step", inside, lambda: _describe(final[lane]))
    else:
        mask = np.arange(env.num_envs) == lane
        before = copy.deepcopy(obs)
        after, _ = env.reset(seed=seed + 1, options={"reset_mask": mask})
        kept = [same(_lane(before, i), _lane(after, i)) for i in range(env.num_envs)]
        held = all(k for k, m in zip(kept, mask, strict=True) if not m)
        renewed = not any(k for k, m in zip(kept, mask, strict=True) if m)
        need("reset_mask", held and renewed, lambda: f"unchanged: {kept}, mask: {mask.tolist()}")


def _lane(obs: Any, lane: int) -> Any:
    return {k: v[lane] for k, v in obs.items()} if isinstance(obs, dict) else obs[lane]


def _describe(value: Any) -> str:
    if isinstance(value, dict):
        return str({k: _describe(v) for k, v in value.items()})
    if isinstance(value, np.ndarray):
        extent = f" in [{value.min()}, {value.max()}]" if value.size and value.dtype.kind in "fiu" else ""
        return f"array of shape {value.shape}, dtype {value.dtype}{extent}"
    return f"{type(value).__name__} {value!r}"


def _check_sb3(env: Any, seed: int) -> None:
    def need(rule: str, holds: Any, found: Callable[[], str]) -> None:
        _need(SB3_RULES, rule, holds, found)

    n = env.num_envs
    batched: spaces.Space[Any] = batch_space(env.observation_space, n)
    counts = len(env.get_attr("render_mode")), len(env.env_is_wrapped(object))
    need("attributes", counts == (n, n), lambda: f"{counts} entries")

    def begin() -> Any:
        env.seed(seed)
        obs = env.reset()
        alone = isinstance(obs, np.ndarray | dict)
        need("reset", alone and batched.contains(obs), lambda: _describe(obs))
        infos = env.reset_infos
        good = isinstance(infos, list) and len(infos) == n and all(isinstance(i, dict) for i in infos)
        need("reset_infos", good, lambda: type(infos).__name__)
        return obs

    first = begin()
    kept, copies = [first], [copy.deepcopy(first)]
    need("seed", same(copies[0], begin()), lambda: "different observations")
    env.action_space.seed(seed)
    for step in range(MOST_STEPS):
        actions = np.stack([env.action_space.sample() for _ in range(n)])
        result = env.step(actions)
        need("step", isinstance(result, tuple) and len(result) == 4, lambda: type(result).__name__)  # noqa: B023
        obs, rewards, dones, infos = result
        need("step", batched.contains(obs), lambda: _describe(obs))  # noqa: B023
        shaped = isinstance(rewards, np.ndarray) and rewards.shape == (n,)
        good = shaped and rewards.dtype == np.float32 and np.isfinite(rewards).all()
        need("reward", good, lambda: _describe(rewards))  # noqa: B023
        good = isinstance(dones, np.ndarray) and dones.shape == (n,) and dones.dtype == np.bool_
        need("dones", good, lambda: _describe(dones))  # noqa: B023
        good = isinstance(infos, list) and len(infos) == n and all(isinstance(i, dict) for i in infos)
        need("infos", good, lambda: type(infos).__name__)  # noqa: B023
        if step < 5:
            need("fresh", all(obs is not k for k in kept), lambda: "the same object again")
            kept.append(obs)
            copies.append(copy.deepcopy(obs))
        if dones.any():
            for lane in np.flatnonzero(dones):
                last = infos[lane].get("terminal_observation")
                inside = last is not None and env.observation_space.contains(last)
                need("terminal", inside, lambda: _describe(last))  # noqa: B023
                flag = infos[lane].get("TimeLimit.truncated")
                need("truncated", isinstance(flag, bool), lambda: repr(flag))  # noqa: B023
            break
    unchanged = all(same(a, b) for a, b in zip(kept, copies, strict=True))
    need("fresh", unchanged, lambda: "an array that changed later")
