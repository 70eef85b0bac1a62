"""Do environments keep the rules of vectors, their ranges, and the bits of single environments?"""

import copy
from collections.abc import Iterator
from itertools import chain, repeat
from typing import Any

import gymnasium as gym
import numpy as np

from redundant_envs.envs.check import BrokenRule, check_vec_env
from redundant_envs.verify.checks import Sample, check
from redundant_envs.verify.promises import EQUAL_BITS, Finding, Mode, NotApplicable, Promise

LANES, STEPS, SHORT_EPISODE = 9, 12, 5
MANY, WHOLE = 64, 200  # number of lanes and steps with extreme actions


def _made(trial: Sample, **arguments: Any) -> Any:
    """The subject as a vector environment if ``num_envs`` is given, or as a single one."""
    if trial.subject.env_id is None:
        raise NotApplicable("this is not an environment")
    make: Any = gym.make_vec if "num_envs" in arguments else gym.make
    if trial.subject.task is not None:
        arguments["task"] = dict(trial.subject.task)
    return make(trial.subject.env_id, **arguments)


def _vector(trial: Sample, lanes: int = LANES, **arguments: Any) -> Any:
    return _made(trial, num_envs=lanes, max_episode_steps=SHORT_EPISODE, **arguments)


@check("environment: rules of vectors", Promise(0.0, "rules broken", "at most"))
def rules(trial: Sample) -> Finding:
    """``rde.check_vec_env`` finds no broken rule, in each autoreset mode."""
    broken = []
    for mode in ("next_step", "same_step", "disabled"):
        try:
            check_vec_env(_vector(trial, 3, autoreset_mode=mode))
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


def _flat(results: Any) -> list[Any]:
    return [np.asarray(v) for x in results for v in (x.values() if isinstance(x, dict) else (x,))]


def _bits(*results: Any) -> list[bytes]:
    """Each lane's bits in observations, rewards and ends of episodes."""
    flat = _flat(results)
    return [b"".join(x[lane].tobytes() for x in flat) for lane in range(len(flat[0]))]


def _actions(trial: Sample, env: Any) -> Any:
    rng = np.random.default_rng(trial.seed)
    return rng.uniform(-1.2, 1.2, (STEPS, LANES, *env.single_action_space.shape)).astype(np.float32)


def _steps(env: Any, actions: Any) -> list[list[bytes]]:
    return [_bits(*env.step(a)[:4]) for a in actions]


def _differing(one: list[list[bytes]], other: list[list[bytes]], what: str) -> Finding:
    lanes = {k for a, b in zip(one, other, strict=True) for k in range(len(a)) if a[k] != b[k]}
    return Finding(len(lanes), f"lane {min(lanes)}" if lanes else "", f"{len(lanes)} lanes differ {what}")


@check("environment: single and vector", EQUAL_BITS)
def single(trial: Sample) -> Finding:
    """Environment i of a vector has the bits of the single environment with seed s + i."""
    many = _vector(trial, 3)
    actions = _actions(trial, many)[:SHORT_EPISODE, :3]
    together = [_bits(many.reset(seed=7)[0]), *_steps(many, actions)]
    alone = [list(step) for step in together]  # after its end a lane is no longer compared
    for i in range(3):
        env = _made(trial, max_episode_steps=SHORT_EPISODE)
        alone[0][i] = b"".join(x.tobytes() for x in _flat(env.reset(seed=7 + i)[:1]))
        for step, action in enumerate(actions):
            result = env.step(action[i])
            alone[step + 1][i] = b"".join(x.tobytes() for x in _flat(result[:4]))
            if result[2] or result[3]:
                break
    return _differing(together, alone, "from single environments with their seeds")


def _begun(trial: Sample, **arguments: Any) -> tuple[Any, Any]:
    """A vector environment after some steps, and the actions of the next ones."""
    env = _vector(trial, **arguments)
    env.reset(seed=3)
    actions = _actions(trial, env)
    _steps(env, actions[:4])
    return env, actions[4:]


@check("environment: states", EQUAL_BITS)
def states(trial: Sample) -> Finding:
    """``get_state`` and ``set_state`` continue to the same bits, across the ends of episodes."""
    env, actions = _begun(trial, autoreset_mode="same_step")
    state = env.get_state()
    first = _steps(env, actions)
    env.set_state(state)
    return _differing(first, _steps(env, actions), "after set_state")


@check("environment: copies", EQUAL_BITS, Mode.STANDARD)
def copies(trial: Sample) -> Finding:
    """A copy continues to the same bits, whatever happens to the original."""
    env, actions = _begun(trial)
    other = copy.deepcopy(env)
    return _differing(_steps(env, actions), _steps(other, actions), "in a copy")


@check("environment: seeds, threads and neighbours", EQUAL_BITS, Mode.STANDARD)
def seeds(trial: Sample) -> Finding:
    """Equal seeds and actions give equal bits, with two threads and in a larger vector, too."""
    tables = []
    for lanes, threads in ((LANES, 1), (LANES, 2), (3 * LANES, 1)):
        env = _vector(trial, lanes, threads=threads)
        actions = np.zeros((STEPS, lanes, *env.single_action_space.shape), np.float32)
        actions[:, :LANES] = _actions(trial, env)
        tables.append([step[:LANES] for step in (_bits(env.reset(seed=5)[0]), *_steps(env, actions))])
    findings = [_differing(tables[0], other, "with threads or more neighbours") for other in tables[1:]]
    return max(findings, key=lambda finding: finding.found)
