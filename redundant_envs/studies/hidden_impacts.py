"""Does error control find every impact? Random families of scenes with hard stops.

Each family is a scene of the RPRP arm with short or long travel, weak or strong efforts, light or heavy
masses. An interval is judged if two fine references agree; it is missed if the tip is off by more
than twice the tolerance without a flag.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import multiprocessing
import sys
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.effects import Gravity, PrismaticStop, ViscousFriction
from redundant_envs.model.batch import BatchSimulator, Numerics
from redundant_envs.robots import RPRP
from redundant_envs.scene import Scene
from redundant_envs.studies.independent_stops import StoppedArm

COLUMNS = (
    "family", "control_dt", "effort", "travel", "masses", "restitution", "tolerance", "intervals", "judged",
    "missed", "flagged", "spent", "largest_error", "events", "judged_alone", "missed_alone",
)  # fmt: skip
FINE, FINER = 96, 160
"""Steps of the two references per control interval."""
AGREEMENT = 0.1
"""The references agree if their tips differ by less than this, in units of the tolerance."""
LIMIT = 2.0
"""An error beyond this is a miss, in units of the tolerance."""
BATCH = 8192

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Family:
    """Numbers of a scene, and of the states and efforts drawn for it.

    Attributes
    ----------
    control_dt : float
        s.
    effort : float
        Largest motor effort, N m and N.
    travel : float
        Of both sliders, m.
    masses, lengths : kg, m
    restitution, tolerance, g, friction : float
    rate : float
        Scale of joint rates, rad/s; for sliders it is a travel in 60 ms, at most 3 m/s.
    """

    control_dt: float = 0.02
    effort: float = 30.0
    travel: float = 0.25
    masses: tuple[float, ...] = (0.5,) * 4
    lengths: tuple[float, ...] = (0.25, 0.25)
    restitution: float = 0.0
    tolerance: float = 1e-6
    g: float = 9.81
    friction: float = 0.2
    rate: float = 3.0

    def scene(self) -> Scene:
        """The scene, error-controlled."""
        stop = PrismaticStop((0.0, 0.0), (self.travel, self.travel), self.restitution)
        effects = (Gravity(self.g), ViscousFriction((self.friction,) * 4), stop)
        robot = RPRP(self.masses, self.lengths)
        return Scene(robot, effects, control_dt=self.control_dt, tolerance=self.tolerance)


NAMED = (
    Family(),
    Family(control_dt=0.05, effort=100.0, travel=0.1, restitution=0.5),
    Family(travel=0.02, restitution=0.5),
    Family(masses=(0.5, 0.5, 0.5, 0.01)),
    Family(effort=94.0, travel=0.023, masses=(0.3, 0.2, 0.1, 0.15), restitution=0.3, g=0.0, friction=0.0),
    Family(effort=250.0, travel=0.05, masses=(1.0,) * 4, lengths=(0.5, 0.5), restitution=0.5, g=0.0),
    Family(effort=60.0, travel=0.1, restitution=1.0),
    Family(effort=10.0, travel=0.25, rate=8.0),
)
"""Families in which earlier versions missed impacts, and similar ones."""


def drawn_families(count: int, seed: int) -> list[Family]:
    """Families with random numbers: control intervals, efforts, travels and masses vary over decades."""
    rng = np.random.default_rng(seed)
    families = []
    for _ in range(count):

        def decades(low: float, high: float) -> float:
            return float(np.exp(rng.uniform(np.log(low), np.log(high))))

        families.append(
            Family(
                control_dt=float(rng.choice([0.005, 0.01, 0.02, 0.05])),
                effort=decades(3.0, 200.0),
                travel=decades(0.01, 0.3),
                masses=tuple(decades(0.1, 2.0) for _ in range(4)),
                lengths=(decades(0.1, 1.0), decades(0.1, 1.0)),
                restitution=float(rng.choice([0.0, 0.0, 0.3, 0.5, 0.9, 1.0])),
                tolerance=float(rng.choice([1e-5, 1e-6, 1e-6, 1e-7, 1e-8])),
                g=float(rng.choice([0.0, 9.81])),
                friction=float(rng.choice([0.0, 0.2])),
                rate=decades(0.5, 8.0),
            )
        )
    return families


def drawn_states(family: Family, count: int, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Coordinates, velocities and efforts, (count, 4) each.

    A third of the sliders are anywhere in their travel, a third at logarithmic distances from an end, a
    third rest at one. Half of the efforts are uniform, half at their limits.
    """
    q, qd = rng.uniform(-np.pi, np.pi, (count, 4)), rng.normal(0.0, family.rate, (count, 4))
    speed = min(family.travel / 0.06, 3.0)
    for joint in (1, 3):
        qd[:, joint] = rng.normal(0.0, speed, count)
        place = rng.uniform(0.0, family.travel, count)
        kind = rng.integers(0, 3, count)
        gap = 0.5 * family.travel * 10.0 ** rng.uniform(-7.0, 0.0, count)
        gap[kind == 2] = 0.0
        near = np.where(rng.random(count) < 0.5, gap, family.travel - gap)
        q[:, joint] = np.where(kind == 0, place, near)
        qd[kind == 2, joint] = 0.0
    efforts = family.effort * rng.uniform(-1.0, 1.0, (count, 4))
    hard = rng.random(count) < 0.5
    efforts[hard] = family.effort * np.sign(efforts[hard])
    efforts[:, [0, 2]] *= 0.5 * sum(family.lengths)
    return q, qd, efforts


def ends(scene: Scene, q: Array, qd: Array, efforts: Array) -> tuple[Array, Any]:
    """Tips after a control interval, (n, 2), and its status."""
    batch = BatchSimulator(scene, len(q))
    batch.set_state(q, qd)
    status = batch.advance(efforts)
    robot: Any = scene.robot
    return robot.forward_kinematics(batch.q), status


@dataclass
class Tally:
    """Counts over the intervals of a family."""

    intervals: int = 0
    judged: int = 0
    missed: int = 0
    flagged: int = 0
    """Flags of any kind in intervals with less than 256 impacts."""
    spent: int = 0
    """Intervals with more impacts than a control interval may have, also in the references."""
    largest_error: float = 0.0
    events: int = 0


def judge(family: Family, count: int, seed: int, misses: list[tuple[Array, ...]] | None = None) -> Tally:
    """Judge intervals of a family; ``misses`` collects (q, qd, efforts) of those that are missed."""
    rng, scene, tally = np.random.default_rng(seed), family.scene(), Tally()
    while tally.intervals < count:
        q, qd, efforts = drawn_states(family, min(BATCH, count - tally.intervals), rng)
        tip, status = ends(scene, q, qd, efforts)
        references = [
            ends(dataclasses.replace(scene, tolerance=None, substeps=n), q, qd, efforts)
            for n in (FINE, FINER)
        ]
        (fine, fine_status), (finer, finer_status) = references
        full = ((fine_status.numerics | finer_status.numerics) & Numerics.EVENT_BUDGET) > 0
        whole = (fine_status.numerics == 0) & (finer_status.numerics == 0)
        agree = whole & (np.linalg.norm(fine - finer, axis=1) <= AGREEMENT * family.tolerance)
        error = np.linalg.norm(tip - finer, axis=1)
        flagged = (status.numerics != 0) & ~full
        judged = agree & (status.numerics == 0)
        missed = judged & ~(error <= LIMIT * family.tolerance)
        tally.intervals += len(q)
        tally.judged += int(judged.sum())
        tally.missed += int(missed.sum())
        tally.flagged += int(flagged.sum())
        tally.spent += int(full.sum())
        tally.events += int(status.events.sum())
        if judged.any():
            tally.largest_error = max(tally.largest_error, float(error[judged].max()))
        if misses is not None:
            misses += [(q[i], qd[i], efforts[i]) for i in np.flatnonzero(missed)]
    return tally


def judge_independently(family: Family, count: int, seed: int) -> tuple[int, int]:
    """Intervals judged by :mod:`independent_stops`, and those that are missed."""
    q, qd, efforts = drawn_states(family, count, np.random.default_rng(seed))
    scene = family.scene()
    tips, status = ends(scene, q, qd, efforts)
    robot: Any = scene.robot
    arm = StoppedArm(
        family.masses, family.lengths, family.g, family.friction, family.travel, family.restitution
    )
    judged = missed = 0
    for i in np.flatnonzero(status.numerics == 0):
        end = arm.after(q[i], qd[i], efforts[i], family.control_dt)
        if end is not None:
            judged += 1
            error = np.linalg.norm(tips[i] - robot.forward_kinematics(end[:4]))
            missed += int(not error <= LIMIT * family.tolerance)
    return judged, missed


def row(number: int, family: Family, intervals: int, independent: int, seed: int) -> dict[str, Any]:
    """A row of ``COLUMNS``."""
    tally = judge(family, intervals, seed)
    judged, missed = judge_independently(family, independent, seed)
    return {
        "family": number,
        "control_dt": family.control_dt,
        "effort": round(family.effort, 1),
        "travel": round(family.travel, 4),
        "masses": " ".join(f"{m:.2g}" for m in family.masses),
        "restitution": family.restitution,
        **dataclasses.asdict(tally),
        "tolerance": family.tolerance,
        "largest_error": f"{tally.largest_error:.1e}",
        "judged_alone": judged,
        "missed_alone": missed,
    }


def run(
    intervals: int, families: int, independent: int, seed: int = 0, processes: int = 1
) -> list[dict[str, Any]]:
    """Rows of ``COLUMNS``: named and random families, ``intervals`` in all, ``independent`` of them also by a
    simulation that shares no code."""
    chosen = [*NAMED, *drawn_families(families, seed)]
    each, alone = -(-intervals // len(chosen)), -(-independent // len(chosen))
    tasks = [(i, family, each, alone, seed + i) for i, family in enumerate(chosen)]
    rows = []
    with contextlib.ExitStack() as stack:
        found: Iterable[dict[str, Any]] = itertools.starmap(row, tasks)
        if processes > 1:
            context = multiprocessing.get_context("spawn")
            pool = stack.enter_context(ProcessPoolExecutor(processes, context))
            found = pool.map(row, *zip(*tasks, strict=True))
        for i, one in enumerate(found):
            rows.append(one)
            print(
                f"impacts: family {i + 1}/{len(chosen)}: {one['missed']} missed of {one['judged']} judged, "
                f"{one['flagged']} flagged, largest error {one['largest_error']} m; by the other account "
                f"{one['missed_alone']} of {one['judged_alone']}",
                file=sys.stderr,
            )
    return rows
