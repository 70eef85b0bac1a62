"""Scenes and environments of which every bit is recorded: it must be the same on every machine."""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.scenes.files import read_yaml
from redundant_envs.support.values import typed

RECORD = Path(__file__).with_name("recorded_bits.json")
ENTRIES = read_yaml(Path(__file__).with_name("recorded_motions.yaml"), "record")
LANES, INTERVALS = 256, 50
Array = NDArray[Any]


def scene_of(arm: str, effects: Iterable[str], **numbers: Any) -> rde.Scene:
    """The scene of an entry of the file."""
    return rde.Scene(ARMS[arm], tuple(EFFECTS[name] for name in effects), **numbers)


ARMS = {name: typed(name, entry, rde.robots.REGISTRY) for name, entry in ENTRIES["arms"].items()}
EFFECTS = {name: typed(name, entry, e.REGISTRY) for name, entry in ENTRIES["effects"].items()}
SCENES = {name: scene_of(**entry) for name, entry in ENTRIES["scenes"].items()}  # by special features


def motion(scene: rde.Scene, work: bool = False, varied: bool = False) -> Iterator[Array]:
    """Tables of numbers, interval by interval, of 256 lanes of a scene."""
    rng = np.random.default_rng(len(scene.effects))
    q = 0.8 * rng.random((LANES, 4)) - 0.4
    for k, prismatic in enumerate(scene.robot.prismatic):
        q[:, k] *= 0.4 if prismatic else 4.0
    for stop in (x for x in scene.effects if isinstance(x, e.PrismaticStop)):
        for k, low, high in zip(scene.robot.sliders(), stop.lower, stop.upper, strict=True):
            q[:, k] = np.clip(q[:, k], low, high)  # some begin at their stops
    batch = rde.BatchSimulator(scene, LANES, track_work=work)
    batch.set_state(q, 6.0 * rng.random((LANES, 4)) - 3.0)
    if varied:
        lengths = 0.3 + 0.4 * rng.random((LANES, scene.robot.num_lengths))
        parameters = {"masses": 0.5 + 2.0 * rng.random((LANES, 4)), "lengths": lengths}
        batch.set_parameters({**parameters, "viscous_friction.coefficients": rng.random((LANES, 4))})
    for _ in range(INTERVALS):
        yield from outcome(batch, 12.0 * rng.random((LANES, 4)) - 6.0)


def outcome(batch: rde.BatchSimulator, efforts: Array) -> Iterator[Array]:
    """Tables of numbers after an interval, with the work and the events if these are kept."""
    status = batch.advance(efforts)
    yield from (batch.q, batch.qd, batch.z)
    yield from (np.asarray(column, np.float64) for column in status)
    if batch.track_work:
        yield batch.work
        yield np.array([(x.lane, x.time, x.speed) for x in events(batch)])


def events(batch: rde.BatchSimulator) -> list[rde.Event]:
    """The events of an interval; none if a lane had more than are kept."""
    try:
        return batch.events()
    except ValueError:
        return []


def episodes(name: str) -> Iterator[Array]:
    """Tables of numbers, step by step, of 256 environments."""
    arguments = dict(ENTRIES["environments"][name])
    if method := arguments.pop("integrator", None):
        scene = rde.load_scene(arguments["scene"])
        others = tuple(x for x in scene.effects if not isinstance(x, e.EffortLimits))
        effects = (*others, e.EffortLimits((20.0, 16.0, 8.0, 4.0)))
        variant = dataclasses.replace(scene, integrator=method, tolerance=None, effects=effects)
        arguments["scene"] = variant.to_dict()
    for mode in ("same_step", "next_step"):
        env = gym.make_vec(
            f"redundant_envs/{name.split()[0]}", num_envs=LANES, max_episode_steps=20,
            autoreset_mode=mode, info_keys="all", **arguments,
        )  # fmt: skip
        rng = np.random.default_rng(5)
        yield from tables(env.reset(seed=3)[0])
        for _ in range(INTERVALS):
            observations, *ends, infos = env.step((2.4 * rng.random((LANES, 4)) - 1.2).astype(np.float32))
            yield from (*tables(observations), *ends)
            yield from (infos[k] for k in sorted(infos) if "final" not in k and not k.startswith("_"))
            for final in infos.get("final_obs", ()):
                yield from () if final is None else tables(final)


def tables(observations: Any) -> list[Array]:
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


RECORDED: dict[str, Callable[[], Iterable[Any]]] = {  # all that is recorded, by name
    **{name: partial(motion, scene) for name, scene in SCENES.items()},
    **{f"{name}, work": partial(motion, SCENES[name], work=True) for name in ENTRIES["work"]},
    **{f"{name}, varied": partial(motion, SCENES[name], varied=True) for name in ENTRIES["varied"]},
    **{name: partial(episodes, name) for name in ENTRIES["environments"]},
}
SHORT = tuple(ENTRIES["short"])


def differing(names: Iterable[str], done: Callable[[str], None] = lambda name: None) -> list[str]:
    """The names of which this machine has other bits; ``done`` receives each name when it is done."""
    expected, other = json.loads(RECORD.read_text(encoding="utf-8")), []
    for name in names:
        other += [name] if digest(RECORDED[name]()) != expected[name] else []
        done(name)
    return other
