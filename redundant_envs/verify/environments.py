"""Do environments keep the rules of vectors, and their observations, rewards and metrics their ranges?"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, repeat
from typing import Any

import gymnasium as gym
import numpy as np

from redundant_envs.envs.check import BrokenRule, check_vec_env
from redundant_envs.verify.checks import Sample, check
from redundant_envs.verify.promises import Finding, NotApplicable, Promise

LANES, SHORT_EPISODE = 3, 5  # of environments whose rules are checked
MANY, WHOLE = 64, 200  # number of lanes and steps with extreme actions


def _made(trial: Sample, **arguments: Any) -> Any:
    """The subject as a vector environment."""
    if trial.subject.env_id is None:
        raise NotApplicable("this is not an environment")
    if trial.subject.task is not None:
        arguments["task"] = dict(trial.subject.task)
    return gym.make_vec(trial.subject.env_id, **arguments)


@check("environment: rules of vectors", Promise(0.0, "rules broken", "at most"))
def rules(trial: Sample) -> Finding:
    """``rde.check_vec_env`` finds no broken rule, in each autoreset mode."""
    broken = []
    for mode in ("next_step", "same_step", "disabled"):
        try:
            check_vec_env(_made(trial, num_envs=LANES, max_episode_steps=SHORT_EPISODE, autoreset_mode=mode))
        except BrokenRule as error:
            broken.append(f"{mode}: {error}")
    return Finding(len(broken), "", "; ".join(broken))


@check("environment: ranges", Promise(0.0, "steps", "at most"))
def ranges(trial: Sample) -> Finding:
    """Observations stay in their space, rewards and metrics finite, under the largest actions and none."""
    outside = without = 0
    named: set[str] = set()
    for largest in (1.0, 0.0):
        env = _made(trial, num_envs=MANY)
        shape = (MANY, *env.single_action_space.shape)
        actions = np.random.default_rng(trial.seed).choice([-largest, largest], shape).astype(np.float32)
        observation, infos = env.reset(seed=trial.seed)
        results = [(observation, np.zeros(MANY), None, None, infos)]
        for observation, reward, _, _, infos in chain(results, map(env.step, repeat(actions, WHOLE))):
            unknown = [*_without_number(infos)]
            named.update(unknown)
            outside += not env.observation_space.contains(observation)
            without += bool(unknown) or not np.isfinite(reward).all()
    what = ", ".join(sorted(named)) or "rewards"
    words = (
        f"{outside} resets and steps have observations outside their space, and in {without} rewards or "
        f"metrics ({what}) are not finite"
    )
    return Finding(outside + without, "", words)


def _without_number(infos: Any) -> Iterator[str]:
    """Names of the entries of infos that are not finite in a lane that has them, according to the masks."""
    for name, value in infos.items():
        if isinstance(value, dict):
            yield from _without_number(value)
        elif isinstance(value, np.ndarray) and value.dtype.kind == "f":
            there = infos.get(f"_{name}", np.ones(len(value), np.bool_))
            if not np.isfinite(value[there]).all():
                yield name
