"""A checker of vector environments, for Gymnasium's VectorEnv and stable-baselines3's VecEnv: each rule has a
name and one sentence, and a violation raises :class:`BrokenRule` with both."""

import copy
import functools
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from redundant_envs.envs.face import observation_of

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
MAX_STEPS = 1000
same = functools.partial(data_equivalence, exact=True)


class BrokenRule(AssertionError):
    """A rule that an environment breaks; ``rule`` is its name."""

    def __init__(self, rule: str, sentence: str, actual: str) -> None:
        self.rule = rule
        super().__init__(f"{rule}: {sentence}; found: {actual}")


def check_vec_env(env: Any, seed: int = 123) -> None:
    """Check a vector environment against the contract of its library; BrokenRule names the first rule that
    does not hold.

    Parameters
    ----------
    env : gymnasium.vector.VectorEnv or stable_baselines3 VecEnv
        It is reset and stepped until an episode ends (at most 1000 steps).
    seed : int
    """
    if isinstance(env, VectorEnv):
        _VectorCheck(env, VECTOR_RULES, seed).run()
    elif hasattr(env, "step_async") and hasattr(env, "env_method"):
        _SB3Check(env, SB3_RULES, seed).run()
    else:
        raise ValueError(
            f"env is {type(env).__name__}; give a gymnasium.vector.VectorEnv or a stable_baselines3 VecEnv"
        )


class _Check:
    """One environment, its rules, and observations that it returned."""

    def __init__(self, env: Any, rules: dict[str, str], seed: int) -> None:
        self.env, self.rules, self.seed, self.n = env, rules, seed, env.num_envs
        self.returned: list[tuple[Any, Any]] = []  # with copies

    def need(self, rule: str, holds: Any, actual: Any) -> None:
        if not holds:
            raise BrokenRule(rule, self.rules[rule], _described(actual))

    def array(self, rule: str, value: Any, kinds: str) -> None:
        """Need a finite array (num_envs,) of a kind of dtype."""
        good = isinstance(value, np.ndarray) and value.shape == (self.n,) and value.dtype.char in kinds
        self.need(rule, good and np.isfinite(value).all(), value)

    def keep(self, obs: Any) -> None:
        self.need("fresh", all(obs is not k for k, _ in self.returned), "the same object again")
        self.returned.append((obs, copy.deepcopy(obs)))

    def check_kept(self) -> None:
        self.need("fresh", all(same(a, b) for a, b in self.returned), "an array that changed later")


class _VectorCheck(_Check):
    def run(self) -> None:
        env, n, seed = self.env, self.n, self.seed
        spaces = env.observation_space, env.action_space
        expected = [batch_space(one, n) for one in (env.single_observation_space, env.single_action_space)]
        self.need("spaces", [*spaces] == expected, f"{spaces[0]}, {spaces[1]}")
        mode = env.metadata.get("autoreset_mode")
        self.need("autoreset_mode", isinstance(mode, AutoresetMode), repr(mode))
        result = env.reset(seed=seed)
        pair = isinstance(result, tuple) and len(result) == 2 and isinstance(result[1], dict)
        self.need("reset", pair, type(result).__name__)
        self.need("reset", env.observation_space.contains(result[0]), result[0])
        self.check_infos(result[1])
        first = copy.deepcopy(result[0])
        for rule, seeds in (("seed", seed), ("seed_list", [seed + i for i in range(n)])):
            self.need(rule, same(first, env.reset(seed=seeds)[0]), "different observations")
        env.action_space.seed(seed)
        actions = [env.action_space.sample() for _ in range(5)]
        one, two = self.rollout(actions), self.rollout(actions)
        self.need("determinism", same(one, two), "different observations or rewards")
        self.check_ends(mode)

    def rollout(self, actions: list[Any]) -> list[Any]:
        """Observations and rewards of some steps."""
        self.returned = []
        self.keep(self.env.reset(seed=self.seed)[0])
        rewards = []
        for action in actions:
            obs, reward, terminated, truncated, _ = self.step(action)
            self.keep(obs)
            rewards.append(np.array(reward))
            self.begin_anew(terminated | truncated)
        self.check_kept()
        return [copied for _, copied in self.returned] + rewards

    def begin_anew(self, ended: np.ndarray[Any, np.dtype[np.bool_]]) -> None:
        """Reset ended environments where nobody else does: without that none may be stepped."""
        if self.env.metadata["autoreset_mode"] is AutoresetMode.DISABLED and ended.any():
            self.env.reset(options={"reset_mask": ended})

    def step(self, action: Any) -> tuple[Any, ...]:
        """A step whose results were checked."""
        result = self.env.step(action)
        self.need("step", isinstance(result, tuple) and len(result) == 5, "another shape")
        obs, reward, terminated, truncated, infos = result
        self.need("step", self.env.observation_space.contains(obs), obs)
        self.array("reward", reward, "efd")
        self.array("flags", terminated, "?")
        self.array("flags", truncated, "?")
        self.check_infos(infos)
        return result

    def check_infos(self, infos: Any) -> None:
        self.need("infos", isinstance(infos, dict), type(infos).__name__)
        for key in (k for k in infos if not k.startswith("_")):
            mask = infos.get(f"_{key}")
            good = isinstance(mask, np.ndarray) and mask.shape == (self.n,) and mask.dtype == np.bool_
            self.need("infos", good, f"no mask for {key!r}")

    def check_ends(self, mode: AutoresetMode) -> None:
        env = self.env
        env.reset(seed=self.seed)
        for _ in range(MAX_STEPS):
            obs, _, terminated, truncated, infos = self.step(env.action_space.sample())
            ended = terminated | truncated
            if ended.any():
                break
        else:
            return
        lane = int(np.flatnonzero(ended)[0])
        if mode is AutoresetMode.NEXT_STEP:
            _, reward, terminated, truncated, _ = env.step(env.action_space.sample())
            quiet = reward[lane] == 0.0 and not terminated[lane] and not truncated[lane]
            self.need("next_step", quiet, f"reward {reward[lane]} in environment {lane}")
        elif mode is AutoresetMode.SAME_STEP:
            final = infos.get("final_obs")
            good = final is not None and "final_info" in infos and "_final_obs" in infos
            self.need("same_step", good, f"infos with {sorted(infos)}")
            self.need("same_step", env.single_observation_space.contains(final[lane]), final[lane])
        else:
            mask = np.arange(self.n) == lane
            before = copy.deepcopy(obs)
            after, _ = env.reset(seed=self.seed + 1, options={"reset_mask": mask})
            equal = [same(observation_of(before, i), observation_of(after, i)) for i in range(self.n)]
            self.need("reset_mask", equal == (~mask).tolist(), f"unchanged: {equal}, mask: {mask.tolist()}")


class _SB3Check(_Check):
    def run(self) -> None:
        env, n = self.env, self.n
        counts = len(env.get_attr("render_mode")), len(env.env_is_wrapped(object))
        self.need("attributes", counts == (n, n), f"{counts} entries")
        space: spaces.Space[Any] = batch_space(env.observation_space, n)
        self.keep(self.begin(space))
        self.need("seed", same(self.returned[0][1], self.begin(space)), "different observations")
        env.action_space.seed(self.seed)
        for step in range(MAX_STEPS):
            result = env.step(np.stack([env.action_space.sample() for _ in range(n)]))
            self.need("step", isinstance(result, tuple) and len(result) == 4, type(result).__name__)
            obs, rewards, dones, infos = result
            self.need("step", space.contains(obs), obs)
            self.array("reward", rewards, "f")
            self.array("dones", dones, "?")
            self.check_list("infos", infos)
            if step < 5:
                self.keep(obs)
            for lane in np.flatnonzero(dones):
                last, flag = (infos[lane].get(k) for k in ("terminal_observation", "TimeLimit.truncated"))
                self.need("terminal", last is not None and env.observation_space.contains(last), last)
                self.need("truncated", isinstance(flag, bool), repr(flag))
            if dones.any():
                break
        self.check_kept()

    def begin(self, space: spaces.Space[Any]) -> Any:
        """Observations of a reset with the seed."""
        self.env.seed(self.seed)
        obs = self.env.reset()
        self.need("reset", isinstance(obs, np.ndarray | dict) and space.contains(obs), obs)
        self.check_list("reset_infos", self.env.reset_infos)
        return obs

    def check_list(self, rule: str, infos: Any) -> None:
        good = isinstance(infos, list) and len(infos) == self.n and all(isinstance(i, dict) for i in infos)
        self.need(rule, good, type(infos).__name__)


def _described(value: Any) -> str:
    if isinstance(value, np.ndarray):
        extent = f" in [{value.min()}, {value.max()}]" if value.size and value.dtype.kind in "fiu" else ""
        return f"array of shape {value.shape}, dtype {value.dtype}{extent}"
    return value if isinstance(value, str) else f"{type(value).__name__} {value!r}"
