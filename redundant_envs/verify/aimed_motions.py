"""Motions of scenes that are aimed at the ways of crossing an interval: their starts, efforts and results."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.verify.aimed_scenes import AIMED, AT, FALL, NEAR, PLAY, Aimed

Array = NDArray[Any]
LOG2_OF_10 = 3.3219280948873626
BROKEN = np.nan, np.inf, 1e200, 1e60, 1e20
"""Rates of the first joint that are no numbers, or with which a motion soon is none."""


def powers(rng: np.random.Generator, low: float, high: float, shape: Any) -> Array:
    """Numbers from about 10^low to 10^high of either sign, the same on every machine."""
    exponents = np.floor(LOG2_OF_10 * (low + (high - low) * rng.random(shape))).astype(np.int64)
    return np.where(rng.random(shape) < 0.5, -1.0, 1.0) * np.ldexp(1.0 + rng.random(shape), exponents)


def starts(aimed: Aimed, rng: np.random.Generator) -> tuple[Array, Array]:
    """States of lanes: of each kind in turn."""
    arm, n = aimed.scene.robot, aimed.lanes
    shape = n, len(arm.coordinates)
    kinds = np.array(aimed.kinds)[np.arange(n) % len(aimed.kinds)]
    q = 3.0 * rng.random(shape) - 1.5
    qd = 6.0 * rng.random(shape) - 3.0
    for kind, speeds in (
        ("at rest", 0.0 * qd), ("still", 0.0 * qd), ("slow, at stops", powers(rng, -16.0, 0.0, shape)),
        ("slow, near stops", powers(rng, -14.0, 0.5, shape)), ("near stops", 0.3 * qd),
        ("fast", powers(rng, 0.0, aimed.speeds, shape)),
    ):  # fmt: skip
        qd[kinds == kind] = speeds[kinds == kind]
    speed = np.abs(powers(rng, -8.0, 0.5, n))
    soon = np.abs(powers(rng, -4.0, -2.0, n))
    stops = [x for x in aimed.scene.effects if isinstance(x, e.PrismaticStop)]
    for i, k in enumerate(arm.sliders()):
        q[:, k] *= 0.1
        for effect in stops:
            ends = effect.lower[i], effect.upper[i]
            low, high = (far if end is None else end for far, end in zip((-1.0, 1.0), ends, strict=True))
            up = rng.random(n) < 0.5
            stop, inward = np.where(up, high, low), np.where(up, -1.0, 1.0)
            away = np.abs(powers(rng, -18.0, -1.0, n)) * np.isin(kinds, NEAR)
            placed = (rng.random(n) < 0.8) & np.isin(kinds, (*AT, *NEAR))
            placed |= np.isin(kinds, ("together", "one strikes"))
            q[:, k] = np.clip(np.where(placed, stop + inward * away, q[:, k]), low, high)
            qd[:, k] = np.where(kinds == "together", -inward * speed, qd[:, k])
            way = np.abs(qd[:, k]) * soon * (1.0 + powers(rng, -14.0, -6.0, n))
            nearly = kinds == "nearly together"
            q[:, k] = np.where(nearly, stop + inward * way, q[:, k])
            qd[:, k] = np.where(nearly, -inward * np.abs(qd[:, k]), qd[:, k])
    for k, slides in enumerate(arm.prismatic):
        if not slides:
            qd[kinds == "nearly together", k] = 0.0
            qd[:, k] = np.where(kinds == "spun", powers(rng, 1.0, 2.3, n), qd[:, k])
    alone = kinds == "one strikes"
    striking = rng.integers(0, len(arm.sliders()) or 1, n)
    for i, k in enumerate(arm.sliders()):
        qd[:, k] = np.where(alone, np.where(striking == i, np.sign(q[:, k]) * speed, 0.0), qd[:, k])
    qd[alone] *= arm.prismatic
    turns = ~np.array(arm.prismatic)
    for kind, sides, speeds in (
        ("folded", powers(rng, -7.0, -3.0, shape), powers(rng, -1.0, 1.0, shape)),
        ("in step", 0.01 * rng.random((n, 1)), powers(rng, 0.0, 1.0, (n, 1))),
    ):
        q[kinds == kind] = np.where(turns & (kind == "in step"), 0.0, sides + 0.0 * q)[kinds == kind]
        qd[kinds == kind] = np.where(turns, 0.0, speeds + 0.0 * qd)[kinds == kind]
    q[kinds == "at a kink"] = 0.0
    q[kinds == "at a kink", -1] = PLAY.play
    qd[kinds == "round", 0] = np.ldexp(1.0, rng.integers(4, 9, n))[kinds == "round"]
    qd[kinds == "round", 1:] *= 0.1
    _send_past(aimed, rng, kinds, q, qd)
    broken = np.flatnonzero(kinds == "broken")[: len(BROKEN) + 1]
    qd[broken, 0] = (aimed.fastest, *BROKEN)[: len(broken)]
    return q, qd


def _send_past(aimed: Aimed, rng: np.random.Generator, kinds: Array, q: Array, qd: Array) -> None:
    """Lanes of an arm that begins with a slider: thrown against gravity, it turns very near its lower stop
    within an interval; or it creeps there from within rounding."""
    if not np.isin(kinds, ("thrown", "creeping")).any():
        return
    (stop,) = (float(x.lower[0] or 0.0) for x in aimed.scene.effects if isinstance(x, e.PrismaticStop))
    n, h = aimed.lanes, aimed.scene.control_dt
    turn, miss = h * rng.random(n), powers(rng, -17.0, -1.0, n)
    turn[::2] = 0.5 * h * (1.0 + miss[::2])
    height = np.maximum(0.5 * FALL * turn * turn * (1.0 + miss[::-1]), 0.0)
    creeping = np.abs(stop) * np.ldexp(np.floor(8.0 * rng.random(n)), -53)
    for kind, way, speed in (
        ("thrown", height, FALL * turn), ("creeping", creeping, creeping / (h * (0.2 + rng.random(n)))),
    ):  # fmt: skip
        hanging = [0.0 if slides else -0.5 * np.pi for slides in aimed.scene.robot.prismatic]
        q[kinds == kind], qd[kinds == kind] = hanging, 0.0
        q[:, 0] = np.where(kinds == kind, stop + way, q[:, 0])
        qd[:, 0] = np.where(kinds == kind, -speed, qd[:, 0])


def parameters(aimed: Aimed, rng: np.random.Generator) -> dict[str, Array]:
    """Masses of each lane, light ones between heavy ones among them, and its restitution."""
    n, arm = aimed.lanes, aimed.scene.robot
    values = {"masses": np.abs(powers(rng, -1.5, 1.0, (n, len(arm.coordinates))))}
    if any(isinstance(effect, e.PrismaticStop) for effect in aimed.scene.effects):
        values["prismatic_stop.restitution"] = rng.choice((0.0, 0.5, 1.0, 0.1, 0.95), n)
    return values


def aimed_motion(name: str) -> Iterator[Array]:
    """Tables of numbers, interval by interval."""
    aimed = AIMED[name]
    rng = np.random.default_rng(len(name))
    q, qd = starts(aimed, rng)
    batch = rde.BatchSimulator(aimed.scene, aimed.lanes, track_work=aimed.work)
    batch.set_state(q, qd)
    if aimed.varied:
        batch.set_parameters(parameters(aimed, rng))
    if aimed.numbers:
        batch.set_parameters(aimed.numbers)
    shape = (aimed.lanes, len(aimed.scene.robot.coordinates))
    steady = powers(rng, aimed.efforts - 4.5, aimed.efforts, shape)
    for _ in range(aimed.intervals):
        changing = rng.random(shape) < 0.5
        steady = np.where(changing, powers(rng, aimed.efforts - 4.5, aimed.efforts, shape), steady)
        steady[::4] = 0.0
        status = batch.advance(steady)
        yield from (batch.q, batch.qd, batch.z)
        yield from (np.asarray(column, np.float64) for column in status)
        if aimed.work:
            yield batch.work
            happened = events(batch)
            yield np.array([(x.lane, x.time, x.speed) for x in happened])
            yield np.array([f"{x.kind} {x.joint}" for x in happened])


def events(batch: rde.BatchSimulator) -> list[Any]:
    """The events of an interval; none if a lane had more than are kept."""
    try:
        return batch.events()
    except ValueError:
        return []
