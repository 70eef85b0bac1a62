"""Scenes and environments of which every bit is recorded: it must be the same on every machine.

``python -m redundant_envs.verify.recorded_bits`` writes a new record; a commit that
changes the record says why.
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
from redundant_envs.verify.aimed import AIMED, FOUR_R, GRAVITY, RPRP, aimed_motion

RECORD = Path(__file__).with_name("recorded_bits.json")
LANES, INTERVALS = 256, 50
LIMITS = e.EffortLimits((5.0, 4.0, 3.0, 2.0))
FRICTION = e.ViscousFriction((0.1, 0.2, 0.3, 0.05))
CENTRING = e.CentringSpring((80.0, 40.0), (-0.2, -0.1), (0.2, 0.3))


def stop(restitution: float, lower: Any = (-0.2, -0.1), upper: Any = (0.2, 0.15)) -> e.Effect:
    return e.PrismaticStop(lower, upper, restitution)


def spring(joint: str) -> e.Effect:
    return e.LimitSpring(joint, -0.4, 0.4, 800.0, 100.0)


SCENES = {
    "4R free euler": rde.Scene(FOUR_R, (), "euler", 0.01),
    "4R gravity rk4": rde.Scene(FOUR_R, (GRAVITY,), "rk4", 0.02),
    "4R friction rk8": rde.Scene(FOUR_R, (FRICTION,), "rk8", 0.02),
    "4R limits, 3 substeps, rk4": rde.Scene(FOUR_R, (LIMITS,), "rk4", 0.03, 3),
    "4R all rk8": rde.Scene(FOUR_R, (GRAVITY, FRICTION, spring("joint2"), LIMITS), "rk8", 0.01, 2),
    "4R generalized rk4": rde.Scene(FOUR_R, (GRAVITY, FRICTION), "rk4", 0.02, actuation="generalized"),
    "4R all 1e-6": rde.Scene(FOUR_R, (GRAVITY, FRICTION, spring("joint3"), LIMITS), tolerance=1e-6),
    "4R free 1e-12": rde.Scene(FOUR_R, (), control_dt=0.05, tolerance=1e-12),
    "4R gravity dop853": rde.Scene(FOUR_R, (GRAVITY, LIMITS), "dop853"),
    "RPRP free rk4": rde.Scene(RPRP, (), "rk4", 0.01),
    "RPRP gravity euler": rde.Scene(RPRP, (GRAVITY,), "euler", 0.002, 5),
    "RPRP centring spring rk8": rde.Scene(RPRP, (CENTRING, GRAVITY), "rk8"),
    "RPRP generalized rk8": rde.Scene(RPRP, (GRAVITY, FRICTION, LIMITS), "rk8", actuation="generalized"),
    "RPRP limit springs 1e-6": rde.Scene(
        RPRP, (GRAVITY, FRICTION, spring("r1"), spring("r2"), LIMITS), tolerance=1e-6
    ),
    "RPRP gravity dop853": rde.Scene(RPRP, (GRAVITY, spring("r1"), spring("r2")), "dop853"),
    "stops euler": rde.Scene(RPRP, (GRAVITY, stop(0.5)), "euler", 0.005, 2),
    "stops rk4, inelastic": rde.Scene(RPRP, (GRAVITY, FRICTION, stop(0.0), LIMITS), "rk4", 0.02, 2),
    "stops rk8, elastic": rde.Scene(RPRP, (GRAVITY, stop(1.0)), "rk8", 0.02),
    "stops rk8, half elastic": rde.Scene(RPRP, (GRAVITY, FRICTION, stop(0.5), LIMITS), "rk8", 0.02, 2),
    "stops 1e-6, inelastic": rde.Scene(RPRP, (GRAVITY, FRICTION, stop(0.0), LIMITS), tolerance=1e-6),
    "stops 1e-6, elastic": rde.Scene(RPRP, (stop(1.0),), tolerance=1e-6),
    "stops 1e-12, 0.7": rde.Scene(RPRP, (GRAVITY, stop(0.7)), tolerance=1e-12),
    "stops on one side 1e-6": rde.Scene(
        RPRP, (GRAVITY, stop(0.8, (0.0, None), (None, 0.3)), spring("r2"), spring("joint2")), tolerance=1e-6
    ),
    "stops dop853": rde.Scene(RPRP, (GRAVITY, FRICTION, stop(0.5), LIMITS), "dop853"),
}
"""Scenes, named by their special features."""

WORKED = ("4R all rk8", "stops 1e-6, elastic", "RPRP gravity dop853")
"""Scenes that are also recorded with the work and the log of events."""

VARIED = ("4R all 1e-6", "RPRP generalized rk8", "stops 1e-6, inelastic")
"""Scenes that are also recorded with separate masses, lengths and friction for each lane."""

ENVIRONMENTS: dict[str, dict[str, Any]] = {
    "FourRReach-v0": {},
    "RPRPReach-v0": {},
    "FourRGoalReach-v0": {},
    "RPRPGoalReach-v0": {"accuracy": 1e-9},
    "FourRReach-v0 rk4": {"scene": "four_r_weak", "integrator": "rk4"},
    "RPRPReach-v0 limit springs": {"scene": "rprp_limit_springs", "integrator": "rk8"},
}
"""Environments and their arguments beside the ids."""


def starts(scene: rde.Scene) -> tuple[NDArray[Any], NDArray[Any], np.random.Generator]:
    """States and efforts that are the same on every machine."""
    rng = np.random.default_rng(len(scene.effects))
    q = 0.8 * rng.random((LANES, 4)) - 0.4
    for k, prismatic in enumerate(scene.robot.prismatic):
        q[:, k] *= 0.4 if prismatic else 4.0
    for effect in scene.effects:
        if isinstance(effect, e.PrismaticStop):
            for i, k in enumerate(scene.robot.sliders()):
                low, high = effect.lower[i], effect.upper[i]
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
        status = batch.advance(efforts)
        yield batch.q
        yield batch.qd
        yield from (np.asarray(column, np.float64) for column in status)
        if work:
            yield batch.work
            yield np.array([(x.lane, x.time, x.speed) for x in batch.events()])


def episodes(name: str) -> Iterator[NDArray[Any]]:
    """Tables of numbers, step by step, of 256 environments."""
    arguments = ENVIRONMENTS[name]
    if "integrator" in arguments:
        scene = rde.load_scene(arguments["scene"])
        kept = tuple(x for x in scene.effects if not isinstance(x, e.EffortLimits))
        effects = (*kept, e.EffortLimits((20.0, 16.0, 8.0, 4.0)))
        scene = dataclasses.replace(
            scene, integrator=arguments["integrator"], tolerance=None, effects=effects
        )
        arguments = {"scene": scene.to_dict()}
    for mode in ("same_step", "next_step"):
        env = gym.make_vec(
            f"redundant_envs/{name.split()[0]}", num_envs=LANES, max_episode_steps=20,
            autoreset_mode=mode, **arguments,
        )  # fmt: skip
        rng = np.random.default_rng(5)
        observations, infos = env.reset(seed=3)
        yield from tables(observations)
        for _ in range(INTERVALS):
            actions = (2.4 * rng.random((LANES, 4)) - 1.2).astype(np.float32)
            observations, reward, terminated, truncated, infos = env.step(actions)
            yield from tables(observations)
            yield from (reward, terminated, truncated)
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
    **{f"{name}, work": (motion, (SCENES[name], True)) for name in WORKED},
    **{f"{name}, varied": (motion, (SCENES[name], False, True)) for name in VARIED},
    **{name: (episodes, (name,)) for name in ENVIRONMENTS},
    **{name: (aimed_motion, (name,)) for name in AIMED},
}
"""Everything that is recorded: a function, and its arguments."""


SHORT = (
    "4R all rk8", "4R all 1e-6", "RPRP generalized rk8", "stops 1e-6, inelastic", "stops rk4, inelastic",
    "stops dop853", "4R all rk8, work", "FourRReach-v0", "RPRPReach-v0",
)  # fmt: skip
"""A selection of all kinds, for checks in which all of them would take too long."""


def recorded() -> dict[str, str]:
    """Digests by name."""
    return json.loads(RECORD.read_text(encoding="utf-8"))  # type: ignore[no-any-return]


def found(name: str) -> str:
    """The digest of one of :data:`RECORDED` on this machine."""
    function, arguments = RECORDED[name]
    return digest(function(*arguments))


def record() -> None:
    """Write a new record."""
    digests = {}
    for name in RECORDED:
        digests[name] = found(name)
        print(f"{digests[name]}  {name}", flush=True)
    RECORD.write_text(json.dumps(digests, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    record()
