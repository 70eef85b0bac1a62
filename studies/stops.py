"""Cost of hard stops: time per control interval with and without them, by share of lanes at them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from redundant_envs.effects import PrismaticStop
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.scenes.scene import Scene, load_scene
from redundant_envs.support.machine import versions
from redundant_envs.support.progress import counted
from redundant_envs.support.timing import by_turns
from studies.speed import one_core, second_call

COLUMNS = (
    "machine", "date", "python", "llvmlite", "numpy", "commit", "states", "lanes", "touched_share",
    "ns_without", "ns_with", "ratio", "evaluations_without", "evaluations_with", "events_per_lane",
)  # fmt: skip
ENVIRONMENT = "redundant_envs/RPRPReach-v0"
SHARES = (0.01, 0.2)
DRAWS = 8
"""Number of draws of lanes for each share: a single draw of one lane in a hundred is not representative."""
STEPS = 50
"""Control steps from the start of an episode to the states that are timed."""

Array = NDArray[np.float64]
Row = dict[str, Any]
Policy = Callable[[NDArray[np.float32]], NDArray[np.float32]]


def random_policy(seed: int) -> Policy:
    """Uniform actions."""
    rng = np.random.default_rng(seed)
    return lambda obs: rng.uniform(-1.0, 1.0, (len(obs), 4)).astype(np.float32)


def policies(options: Any) -> dict[str, Policy]:
    """Random actions, and the policy of the run folder that is given, unpickled only if it is trusted."""
    if (folder := options.run) is None:
        return {"random actions": random_policy(0)}
    from redundant_envs_train import run_folder

    config = run_folder.own_config(folder)
    if config.env != ENVIRONMENT:
        raise ValueError(f"folder is a run of {config.env}; the study is of {ENVIRONMENT}")
    run_folder.tell_differences([folder])
    from redundant_envs_train.policies import load_policy

    model = load_policy(folder, config, options.trust)
    trained = lambda obs: model.predict(obs, deterministic=True)[0]  # noqa: E731
    return {"policy": trained, "random actions": random_policy(0)}


def visited_states(policy: Policy, count: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """States at random times of episodes, q and qd, (count, 4), and the efforts of the two intervals
    that follow, (2, count, 4): after the first, a simulator knows which sliders rest."""
    env: Any = gym.make_vec(ENVIRONMENT, num_envs=count, autoreset_mode="same_step")
    core, arm = env.core, env.core.scene.robot
    limits = np.array([core.scene.parameters()[f"effort_limits.limits[{k}]"] for k in range(4)])
    obs, _ = env.reset(seed=seed)
    at = np.random.default_rng(seed).integers(0, STEPS - 1, count)
    q, qd, efforts = np.empty((count, 4)), np.empty((count, 4)), np.empty((2, count, 4))
    for step in range(STEPS):
        actions = policy(obs)
        now = at == step
        q[now], qd[now] = core.memory.read(arm.coordinates)[now], core.memory.read(arm.rates)[now]
        for k in range(2):
            chosen = at + k == step
            efforts[k, chosen] = np.clip(actions[chosen], -1.0, 1.0) * limits
        obs, *_ = env.step(actions)
    env.close()
    return q, qd, efforts


def touching(scene: Scene, q: Array, qd: Array, efforts: Array) -> NDArray[np.bool_]:
    """Lanes that a stop affects: they meet one, or are at one and stay."""
    batch = BatchSimulator(scene, len(q))
    batch.set_state(q, qd)
    free = BatchSimulator(without_stops(scene), len(q))
    free.set_state(q, qd)
    different = batch.advance(efforts).evaluations != free.advance(efforts).evaluations
    ends = [(scene.parameters()[a], scene.parameters()[b]) for a, b in scene.travel().values()]
    at_end = [np.isin(q[:, k], end) for k, end in zip(scene.travel(), ends, strict=True)]
    return different | np.any(at_end, axis=0)


def without_stops(scene: Scene) -> Scene:
    """The same scene with unlimited travel."""
    effects = tuple(e for e in scene.effects if not isinstance(e, PrismaticStop))
    return dataclasses.replace(scene, effects=effects)


def rows_of(name: str, policy: Policy, lanes: int, repeats: int, done: Callable[[str], None]) -> list[Row]:
    """Rows of ``COLUMNS`` for the states that a policy visits: shares 1 % and 20 %, and its own."""
    scene = load_scene("rprp_reach")
    q, qd, efforts = visited_states(policy, 4 * lanes)
    visitor = BatchSimulator(scene, 4 * lanes)
    visitor.set_state(q, qd)
    visitor.advance(efforts[0])
    touched = touching(scene, visitor.q, visitor.qd, efforts[1])
    rng = np.random.default_rng(0)
    rows = []
    for share in (*SHARES, float(touched.mean())):
        count = min(round(share * lanes), int(touched.sum()))
        drawn = []
        for _ in range(DRAWS):
            indices = rng.choice(np.flatnonzero(touched), count, replace=False)
            others, few = np.flatnonzero(~touched), lanes - count
            chosen = np.concatenate([indices, rng.choice(others, few, replace=few > len(others))])
            rng.shuffle(chosen)
            drawn.append(measured(scene, q[chosen], qd[chosen], efforts[:, chosen], repeats))
        without, with_stops, evaluations, evaluations_with, events = np.mean(drawn, axis=0).tolist()
        rows.append({
            "states": name, "lanes": lanes, "touched_share": round(count / lanes, 4),
            "ns_without": round(1e9 * without / lanes, 1), "ns_with": round(1e9 * with_stops / lanes, 1),
            "ratio": round(with_stops / without, 2), "evaluations_without": round(evaluations, 2),
            "evaluations_with": round(evaluations_with, 2), "events_per_lane": round(events, 4),
        })  # fmt: skip
        done(f"{name}, {100 * count / lanes:.1f} % touched: {rows[-1]['ratio']}")
    return rows


def measured(scene: Scene, q: Array, qd: Array, efforts: Array, repeats: int) -> tuple[float, ...]:
    """For the second interval from some states: s and evaluations, without and with stops, and events, per
    lane."""
    batches = [BatchSimulator(s, len(q)) for s in (without_stops(scene), scene)]
    batches[1].set_state(q, qd)
    batches[1].advance(efforts[0])
    batches[0].set_state(batches[1].q, batches[1].qd)
    samplers = {k: second_call(batch, efforts[1], again=True) for k, batch in enumerate(batches)}
    free, stopped = (batch.advance(efforts[1]) for batch in batches)
    without, with_stops = (float(times.best) for times in by_turns(samplers, repeats).values())
    counts = (free.evaluations, stopped.evaluations, stopped.events)
    return without, with_stops, *(float(n.mean()) for n in counts)


def run(policies: dict[str, Policy], lanes: int = 4096, repeats: int = 30) -> list[Row]:
    """Time the RPRP reach scene on the states of some policies; on one core."""
    about = versions()
    with one_core(), counted("stops", len(policies) * (len(SHARES) + 1)) as done:
        rows = [row for name, p in policies.items() for row in rows_of(name, p, lanes, repeats, done)]
    return [{**about, **row} for row in rows]
