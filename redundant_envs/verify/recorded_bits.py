"""Scenes and environments of which every bit is recorded: it must be the same on every machine.

``python -m redundant_envs.verify.recorded_bits`` writes a new record; a commit that changes it says why.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.support.values import say
from redundant_envs.verify.aimed import AIMED, ENTRIES, SCENES, aimed_motion, outcome

RECORD = Path(__file__).with_name("recorded_bits.json")
LANES, INTERVALS = 256, 50

ENVIRONMENTS: dict[str, dict[str, Any]] = ENTRIES["environments"]
SHORT = tuple(ENTRIES["short"])


def starts(scene: rde.Scene) -> tuple[NDArray[Any], NDArray[Any], np.random.Generator]:
    """States and efforts that are the same on every machine."""
    rng = np.random.default_rng(len(scene.effects))
    q = 0.8 * rng.random((LANES, 4)) - 0.4
    for k, prismatic in enumerate(scene.robot.prismatic):
        q[:, k] *= 0.4 if prismatic else 4.0
    for stop in (x for x in scene.effects if isinstance(x, e.PrismaticStop)):
        for k, low, high in zip(scene.robot.sliders(), stop.lower, stop.upper, strict=True):
            q[:, k] = np.clip(q[:, k], low, high)  # some begin at their stops
    return q, 6.0 * rng.random((LANES, 4)) - 3.0, rng


def motion(scene: rde.Scene, work: bool = False, varied: bool = False) -> Iterator[NDArray[Any]]:
    """Tables of numbers, interval by interval, of 256 lanes of a scene."""
    q, qd, rng = starts(scene)
    batch = rde.BatchSimulator(scene, LANES, track_work=work)
    batch.set_state(q, qd)
    if varied:
        lengths = 0.3 + 0.4 * rng.random((LANES, scene.robot.num_lengths))
        own = {"masses": 0.5 + 2.0 * rng.random((LANES, 4)), "lengths": lengths}
        batch.set_parameters({**own, "viscous_friction.coefficients": rng.random((LANES, 4))})
    for _ in range(INTERVALS):
        efforts = 12.0 * rng.random((LANES, 4)) - 6.0
        yield from outcome(batch, batch.advance(efforts), work)


def episodes(name: str) -> Iterator[NDArray[Any]]:
    """Tables of numbers, step by step, of 256 environments."""
    arguments = dict(ENVIRONMENTS[name])
    if method := arguments.pop("integrator", None):
        scene = rde.load_scene(arguments["scene"])
        kept = tuple(x for x in scene.effects if not isinstance(x, e.EffortLimits))
        effects = (*kept, e.EffortLimits((20.0, 16.0, 8.0, 4.0)))
        own = dataclasses.replace(scene, integrator=method, tolerance=None, effects=effects)
        arguments["scene"] = own.to_dict()
    for mode in ("same_step", "next_step"):
        env = gym.make_vec(
            f"redundant_envs/{name.split()[0]}", num_envs=LANES, max_episode_steps=20,
            autoreset_mode=mode, info_keys="all", **arguments,
        )  # fmt: skip
        rng = np.random.default_rng(5)
        observations, infos = env.reset(seed=3)
        yield from tables(observations)
        for _ in range(INTERVALS):
            actions = (2.4 * rng.random((LANES, 4)) - 1.2).astype(np.float32)
            observations, *ends, infos = env.step(actions)
            yield from (*tables(observations), *ends)
            yield from (infos[k] for k in sorted(infos) if "final" not in k and not k.startswith("_"))
            for final in infos.get("final_obs", ()):
                yield from () if final is None else tables(final)


def tables(observations: Any) -> list[NDArray[Any]]:
    """The arrays of observations, with or without goals."""
    return list(observations.values()) if isinstance(observations, dict) else [observations]


def digest(numbers: Iterable[Any]) -> str:
    """A digest of tables of numbers, to the last bit."""
    whole = hashlib.sha256()
    for table in numbers:
        array = np.array(table)
        if array.dtype.kind == "f":
            array[np.isnan(array)] = np.nan  # one of many
        whole.update(array.astype(array.dtype.newbyteorder("<")).tobytes())
    return whole.hexdigest()[:32]


RECORDED: dict[str, tuple[Callable[..., Iterable[Any]], tuple[Any, ...]]] = {
    **{name: (motion, (scene,)) for name, scene in SCENES.items()},
    **{f"{name}, work": (motion, (SCENES[name], True)) for name in ENTRIES["work"]},
    **{f"{name}, varied": (motion, (SCENES[name], False, True)) for name in ENTRIES["varied"]},
    **{name: (episodes, (name,)) for name in ENVIRONMENTS},
    **{name: (aimed_motion, (name,)) for name in AIMED},
}
"""Everything that is recorded: a function, and its arguments."""


def recorded() -> dict[str, str]:
    """Digests by name."""
    return json.loads(RECORD.read_text(encoding="utf-8"))  # type: ignore[no-any-return]


def found(name: str) -> str:
    """The digest of one of :data:`RECORDED` on this machine."""
    function, arguments = RECORDED[name]
    return digest(function(*arguments))


def differing(names: Iterable[str], done: Callable[[str], None] = lambda name: None) -> list[str]:
    """The names of which this machine has other bits; ``done`` receives each name when it is done."""
    expected, other = recorded(), []
    for name in names:
        other += [name] if found(name) != expected[name] else []
        done(name)
    return other


if __name__ == "__main__":
    digests = {}
    for name in RECORDED:
        digests[name] = found(name)
        say(f"{digests[name]}  {name}", flush=True)
    RECORD.write_text(json.dumps(digests, indent=1) + "\n", encoding="utf-8")
