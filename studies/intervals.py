"""Is the tolerance kept? Control intervals of many families of scenes, each judged by two references.

The reference of the named families is dop853, which chooses its steps for errors near rounding; it counts if
much finer equal steps of rk8 confirm it to a tenth of the tolerance. That of families drawn by the seed is
the same scene at smaller tolerances; for some lanes, and those that are off, it is another account, where
that knows the scene. An interval is missed if the tip is off by more than twice the tolerance without a flag.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import multiprocessing
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.model.batch import BatchSimulator, Numerics
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.progress import counted
from redundant_envs.verify.accuracy import judge
from studies.drawn_families import DrawnFamily
from studies.interval_families import FAMILIES, Family, LaneSamples, chosen
from studies.stop_families import NAMED, StopFamily, drawn_families

COLUMNS = (
    "family", "tolerance", "intervals", "judged", "told", "beyond", "missed", "flagged", "spent",
    "largest_error", "events", "evaluations",
)  # fmt: skip
BATCH = 4096
DRAWN = {"impacts": 12, "intervals": 60}
"""Families drawn by the seed beside the named ones: every effect alone, then each beside another."""
TOLD, MAX_TOLD = 2, 48
"""Lanes of a batch that another account crosses, and the most of those that are off."""

Array = NDArray[np.float64]
AnyFamily = Family | StopFamily | DrawnFamily


@dataclass
class Tally:
    """Counts over the intervals of a family."""

    intervals: int = 0
    judged: int = 0  # with a confirmed reference
    told: int = 0  # crossed by another account, which then judges them
    beyond: int = 0  # of those judged, off by more than one tolerance without a flag
    missed: int = 0  # off by more than two
    flagged: int = 0  # with a flag of any kind and less than 256 impacts
    spent: int = 0  # with more impacts than an interval may have
    largest_error: float = 0.0  # of those judged, in units of the tolerance
    events: int = 0  # impacts
    evaluations: int = 0  # of the right-hand side, in all


def families(study: str, seed: int) -> Sequence[AnyFamily]:
    """The families of ``study intervals`` or ``study impacts``."""
    if study == "impacts":
        return [*NAMED, *drawn_families(DRAWN[study], seed)]
    return [*FAMILIES, *(DrawnFamily(seed, number) for number in range(DRAWN[study]))]


def tips_after(family: AnyFamily, scene: Scene, drawn: LaneSamples) -> tuple[Array, Any]:
    """Tips after a control interval, (count, 2), m, and its status."""
    if isinstance(family, DrawnFamily):
        return family.tips_after(scene, drawn)
    arm: Any = family.robot
    inverse = np.linalg.inv(arm.motor_map)
    batch = BatchSimulator(scene, len(drawn.joints))
    batch.set_parameters(drawn.parameters)
    batch.set_state(drawn.joints @ inverse, drawn.rates @ inverse)
    efforts = drawn.efforts if family.actuation == "joint" else drawn.efforts @ np.asarray(arm.motor_map).T
    status = batch.advance(efforts)
    values = dict(zip(arm.coordinates, batch.q.T, strict=True))
    if "lengths" in drawn.parameters:
        values |= {f"l{k + 1}": length for k, length in enumerate(drawn.parameters["lengths"].T)}
    return np.stack(arm.evaluate(["tip_x", "tip_y"], {**arm.parameter_values(), **values}), axis=-1), status


def judge_family(family: AnyFamily, count: int, seed: Any, misses: list[LaneSamples] | None = None) -> Tally:
    """Judge intervals of a family; ``misses`` collects the random data of missed ones."""
    (tally,) = judge_tolerances([family], count, seed, misses)
    return tally


def judge_tolerances(
    asked: Sequence[AnyFamily], count: int, seed: Any, misses: list[LaneSamples] | None = None
) -> list[Tally]:
    """Judge the same intervals of a family at several tolerances: one family for each."""
    rng, tallies, family = np.random.default_rng(seed), [Tally() for _ in asked], asked[0]
    references = references_of(min(asked, key=lambda one: one.tolerance))
    for start in range(0, count, BATCH):
        few = min(BATCH, count - start)
        drawn = family.draw(few, rng)
        if not len(drawn.joints):  # all would take too long
            break
        (best, how), (other, also) = (tips_after(family, scene, drawn) for scene in references)
        for one, tally in zip(asked, tallies, strict=True):
            tip, status = tips_after(one, one.scene(), drawn)
            flags = status.numerics | how.numerics | also.numerics
            spent = (flags & Numerics.EVENT_BUDGET) > 0
            right, confirming = best, other
            if isinstance(one, DrawnFamily):
                off = judge(tip, [best], one.tolerance, status.numerics == 0).missed
                account = told_of(one, drawn, best, off)
                known = np.isfinite(account[:, 0])
                right, confirming = (np.where(known[:, None], account, x) for x in (best, other))
                flags = np.where(known, status.numerics, flags)
                tally.told += int(known.sum())
            judged, missed, error = judge(tip, [right, confirming], one.tolerance, flags == 0)
            tally.intervals += len(tip)
            tally.judged += int(judged.sum())
            tally.beyond += int((judged & ~(error <= 1.0)).sum())
            tally.missed += int(missed.sum())
            tally.flagged += int(((status.numerics != 0) & ~spent).sum())
            tally.spent += int(spent.sum())
            tally.events += int(status.events.sum())
            tally.evaluations += int(status.evaluations.sum())
            tally.largest_error = max(tally.largest_error, float(error[judged].max(initial=0.0)))
            if misses is not None and missed.any():
                misses.append(chosen(drawn, missed))
        if 2 * len(drawn.joints) < few:  # they take long
            break
    return tallies


def told_of(family: DrawnFamily, drawn: LaneSamples, best: Array, doubtful: NDArray[np.bool_]) -> Array:
    """Tips by another account, (count, 2), m, of some lanes and of doubtful ones; NaN of the others."""
    some = np.arange(len(doubtful)) % (len(doubtful) // TOLD + 1) == 0
    tips = np.full((len(doubtful), 2), np.nan)
    (lanes,) = np.nonzero(some | (doubtful & (doubtful.cumsum() <= MAX_TOLD)))
    tips[lanes] = family.account_tips(chosen(drawn, lanes), best[lanes])
    return tips


def references_of(family: AnyFamily) -> Sequence[Scene]:
    """Scenes whose tips are right where they agree, the most accurate one first."""
    if isinstance(family, DrawnFamily):
        return family.references()
    return [family.scene(integrator="dop853"), family.scene(integrator="rk8", substeps=family.steps)]


def rows_of(
    study: str, number: int, intervals: int, seed: int, tolerances: Sequence[float]
) -> list[dict[str, Any]]:
    """Rows of ``COLUMNS``, for the number of a family: its functions could not be sent to a process."""
    family = families(study, seed)[number]
    asked = [dataclasses.replace(family, tolerance=t) for t in tolerances or (family.tolerance,)]
    rows = []
    for one, tally in zip(asked, judge_tolerances(asked, intervals, (seed, number)), strict=True):
        mean = round(tally.evaluations / max(tally.intervals, 1), 1)
        rounded = {"largest_error": f"{tally.largest_error:.2g}", "evaluations": mean}
        rows.append({"family": one.name, "tolerance": one.tolerance, **dataclasses.asdict(tally), **rounded})
    return rows


def run(
    study: str, intervals: int, seed: int = 0, processes: int = 1, tolerances: Sequence[float] = ()
) -> list[dict[str, Any]]:
    """Rows of ``COLUMNS``: ``intervals`` in all, as many of each family, at its own tolerance or each of
    ``tolerances``, m."""
    count = len(families(study, seed))
    tasks = [(study, number, -(-intervals // count), seed, tuple(tolerances)) for number in range(count)]
    rows = []
    with contextlib.ExitStack() as stack:
        done = stack.enter_context(counted(study, count))
        results: Iterable[list[dict[str, Any]]] = itertools.starmap(rows_of, tasks)
        if processes > 1:
            context = multiprocessing.get_context("spawn")
            pool = stack.enter_context(ProcessPoolExecutor(processes, context))
            results = pool.map(rows_of, *zip(*tasks, strict=True))
        for some in results:
            rows += some
            missed = sum(one["missed"] for one in some)
            done(f"{some[0]['family']}: {missed} missed of {sum(one['judged'] for one in some)} judged")
    return rows
