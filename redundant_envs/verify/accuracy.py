"""Is a scene's step fine enough, is its tolerance kept, and does its method have the declared order?"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.effects import Gravity
from redundant_envs.model.batch import BatchSimulator, Numerics
from redundant_envs.scenes.scene import Scene
from redundant_envs.scenes.tableaus import METHODS
from redundant_envs.verify.checks import Array, Sample, check, enough
from redundant_envs.verify.conservation import crossed, exact_in_parts, own_interval
from redundant_envs.verify.promises import Finding, Mode, NotApplicable, Promise, at_most, nothing

ENOUGH = 1e-3  # tip error of a control interval [m] that is good enough for the 99th percentile
MISSED = 1e-3  # share of the states that may miss the tolerance without a flag; our scenes miss none of 1e6

CONFIRMED = 0.1  # references agree if their tips differ by less than this, in units of the tolerance
LIMIT = 2.0  # an error beyond this is a miss, in units of the tolerance: an estimate is no bound


class Judgement(NamedTuple):
    """Of the lanes of an interval."""

    judged: NDArray[np.bool_]  # lanes whose references agree
    missed: NDArray[np.bool_]  # of these, the lanes whose tips are off
    error: Array  # distance from the first reference, in units of the tolerance


def agree(references: Sequence[Array], tolerance: float) -> NDArray[np.bool_]:
    """Lanes of which all references, tips (n, 2) in m, confirm the first one."""
    best, *others = references
    with np.errstate(all="ignore"):
        apart = [np.zeros(len(best)), *(np.linalg.norm(other - best, axis=1) for other in others)]
        return np.max(apart, axis=0) <= CONFIRMED * tolerance


def judge(tips: Array, references: Sequence[Array], tolerance: float, known: Any = True) -> Judgement:
    """Compare the tips of an interval, (n, 2), m, with those of references, the most accurate one first.

    The tolerance is the scene's, m; in lanes that are ``known``, nothing has a flag.
    """
    with np.errstate(all="ignore"):
        error = np.linalg.norm(tips - references[0], axis=1) / tolerance
    judged = agree(references, tolerance) & known
    return Judgement(judged, judged & ~(error <= LIMIT), error)


def tips(trial: Sample) -> tuple[Array, list[Array], NDArray[np.bool_]]:
    """Tips at the scene's own step, those of the two references, m, and whether these are valid."""
    ends = trial.shared(own_interval), crossed(trial.scene, *trial.states), exact_in_parts(trial)
    scene_tips, first, second = (trial.arm.forward_kinematics(end.q) for end in ends)
    return scene_tips, [second, first], ends[1].good & ends[2].good & np.isfinite(first - second).all(axis=1)


@check("tip error of the own step", nothing("m, 99 % of the states"))
def own_step(trial: Sample) -> Finding:
    """The tip error of a control interval at the scene's own step, against dop853 in parts."""
    scene_tips, (best, other), sure = trial.shared(tips)
    if not sure.any():
        raise NotApplicable("dop853 crosses no interval of this scene without trouble")
    off, apart = (np.linalg.norm(x - best, axis=1) for x in (scene_tips, other))
    off = np.where(np.isnan(off), np.inf, off)[sure]
    median, high, most = np.median(off), np.quantile(off, 0.99), off.max()
    where = f"median {median:.1e}, max {most:.1e}; references agree to {apart[sure].max():.0e}"
    words = "the tip is off by more than 1 mm at the 99th percentile: take more substeps, or a tolerance"
    return Finding(float(high), where, "" if high < ENOUGH else words)


@check("intervals without a flag", at_most(0.05, "of the states"))
def flagged(trial: Sample) -> Finding:
    """The share of the states whose control interval ends with a flag at the scene's own step."""
    numerics = trial.shared(own_interval).numerics
    names = ", ".join(str(f.name) for f in Numerics(int(np.bitwise_or.reduce(numerics))))
    share = float(np.mean(numerics != 0))
    words = f"{100 * share:.2g} % of the intervals end with a flag ({names}); see docs/trouble.md"
    return Finding(share, names, words)


@check("tolerance kept", at_most(MISSED, "of the states"))
def tolerance_kept(trial: Sample) -> Finding:
    """The share of the states that are off by more than twice the scene's tolerance, and not flagged."""
    tolerance = trial.scene.tolerance
    if tolerance is None:
        raise NotApplicable("the scene has no tolerance")
    scene_tips, references, sure = trial.shared(tips)
    judged, missed, error = judge(scene_tips, references, tolerance, sure)
    enough(judged, f"references agree to a tenth of it at {np.mean(judged):.0%} of the states only")
    missed &= trial.shared(own_interval).numerics == 0
    share = float(missed.sum() / judged.sum())
    most, where, _ = trial.worst(np.where(missed, tolerance * error, 0.0))
    words = (
        f"{100 * share:.2g} % of the intervals are off by more than twice the tolerance, up to {most:.1e} m, "
        "without a flag: say where forces jump by Force(switch=...), or take a shorter control_dt"
    )
    return Finding(share, where if share else "", words)


LANES = 64
FINE, SHARE = 1e-11, 0.75
"""Error of the finer steps at which the order is measured, in radians and reaches: far above rounding, and so
small that the next order of the method adds little; and the quantile of the states. In an arm with very
unequal links some motions change faster than any step that rounding allows, and show a lower order."""
CALM, GROWTH = 3.0, 1.25  # longest step in units of calm times (rounding grows later); ratio of steps
SHORT_OF = 0.3  # tolerated difference from the method's order: at a finite step the next order contributes


@check("order of convergence", Promise(-SHORT_OF, "beyond the declared one", "at least"), Mode.STANDARD)
def order(trial: Sample) -> Finding:
    """Halving the step divides the error by 2^order, on the scene's arm in a vertical plane."""
    name = trial.scene.integrator
    if name == "dop853":
        raise NotApplicable("dop853 chooses its steps itself")
    q, qd, efforts = (x[:LANES] for x in trial.states)
    # With an angle of many turns only rounding would be measured.
    q = np.where(trial.arm.prismatic, q, np.remainder(q, 2.0 * np.pi))
    unit = np.where(trial.arm.prismatic, np.linalg.norm(trial.arm.points(q), axis=2).max(), 1.0)

    # In a vertical plane, without effects whose kinks would hide the order.
    scenes = {m: Scene(trial.scene.robot, (Gravity(),), m, trial.scene.control_dt) for m in ("rk8", name)}
    batches = {method: BatchSimulator(scene, len(q)) for method, scene in scenes.items()}

    def moved(method: str, steps: int, seconds: float) -> Array:
        batch = batches[method]
        batch.set_state(q, qd)
        for _ in range(steps):
            batch.advance_partly(efforts, seconds / steps)
        return batch.q @ trial.scene.robot.motor_map / unit

    # For each state the first step with that error: some are much faster than others.
    orders, seconds, longest = np.full(len(q), np.nan), 1e-7, CALM * trial.calm[: len(q)]
    while seconds < longest.max() and np.isnan(orders).any():
        exact = moved("rk8", 8, seconds)
        coarse, fine = (np.abs(moved(name, n, seconds) - exact).max(axis=1) for n in (1, 2))
        due = np.isnan(orders) & ~(fine < FINE) & (seconds <= longest)
        orders = np.where(due, np.log2(coarse / fine), orders)
        seconds *= GROWTH
    enough(np.isfinite(orders), "the motions of this arm are too simple to show an order above rounding")
    orders = orders[np.isfinite(orders)]
    high = float(np.quantile(orders, SHARE))
    words = f"{name} has the order {high:.2f}, not {METHODS[name].order}: a coefficient is wrong"
    return Finding(high - METHODS[name].order, f"{SHARE:.0%} quantile of {len(orders)} states", words)
