"""Promises: one function each, which yields call, lane (-1: none) and text of each violation.

The name of the function is the name of the promise.
"""

import re
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from gymnasium.error import ResetNeeded

import redundant_envs as rde
from redundant_envs.scenes.tableaus import METHODS

from . import motions
from .cases import lanes_of, with_lanes, without_calls
from .composition import autoresets_begin_the_same_episodes, effects_commute, evaluators_agree
from .motions import stops_of, the_energy_book_closes, tolerance_is_kept_or_flagged, values_of
from .playing import EnvironmentPlayer, differing, play, same

MAX_TRIALS, MAX_MORE, MAX_ADAPTIVE = 65536, 18, 1_000_002
"""Most steps of an interval, more for each substep, and the most for dop853."""
REPLACING = ("copy", "pickle", "anew")
"""Calls after which another simulator or environment goes on."""
MANY = 4096
"""Lanes of a case that has as many as vectors of learners have."""
MAX_EVALUATIONS = 1e7
"""Most evaluations of so many lanes; where all intervals take equally many, none are counted."""
NON_FINITE, GIVEN_UP = int(rde.Numerics.NON_FINITE), int(rde.Numerics.EVENT_BUDGET)
ROUNDING, FLOAT32 = 1e-9, 1e-4
"""Rounding of a sum of a hundred rewards of at most 1; in single precision, as in stable-baselines3."""


class Violation(NamedTuple):
    invariant: str
    call: int
    lane: int
    found: str


@dataclass
class Played:
    """A case, its results, and the class of its simulators (tests tamper with them)."""

    case: dict
    steps: list
    make: type
    tally: Counter  # counts of a run

    def __post_init__(self):
        self.scene = rde.Scene.from_dict(self.case["scene"])

    @cached_property
    def judgements(self):
        return list(motions.judgements(self))

    def intervals(self):
        return ((k, s) for k, s in enumerate(self.steps) if s.told)

    def observations(self):
        """Call, lane, name and row of every observation: those of resets and last ones, too."""
        for k, step in enumerate(self.steps):
            for key, table in step.told.items():
                when, _, name = key.partition(" ")
                if when in ("now", "last"):
                    for lane in np.flatnonzero(step.told["begun"]) if when == "last" else range(len(table)):
                        yield k, lane, name, table[lane]


# ---- simulators and environments ------------------------------------------------------------------------


def only_documented_exceptions(played):
    """A call raises no other exception than a ValueError or ResetNeeded; only if it is invalid, and then
    always."""
    for k, step in enumerate(played.steps):
        what, error, must = step.call["call"], step.error, step.must_refuse
        if error is None and must is not None:
            yield k, -1, f"{what} was not refused"
        elif error is not None and not isinstance(error, ValueError | ResetNeeded):
            yield k, -1, f"{what} raised {type(error).__name__}: {error}"
        elif error is not None and must is None and not step.may_refuse:
            yield k, -1, f"{what} was refused: {error}"
        elif error is not None and not re.search(must or "", str(error)):
            yield k, -1, f"{what} was refused without a word of {must!r}: {error}"


def a_refused_call_changes_nothing(played):
    """A call that raises leaves everything that determines the continuation, to the last bit."""
    for k, step in enumerate(played.steps):
        for name, table in step.before.items() if step.error is not None else ():
            if table.shape != step.after[name].shape or not np.all(same(table, step.after[name])):
                yield k, -1, f"{step.call['call']} changed {name}, and raised"


def no_joint_is_beyond_its_stop(played):
    """After every call sliders are between their stops to the last bit, and angles but for 4 ulp; a lost lane
    has no place."""
    scene, lost = played.scene, np.bool_(played.case["face"] == "simulator")
    for k, step in enumerate(played.steps):
        values = values_of(scene, step.after) if "values" in step.after else scene.parameters()
        for stop in stops_of(scene, step.after["q"], values):
            for lane in np.flatnonzero(stop.beyond | (np.isnan(stop.positions) & ~lost)):
                place = f"{scene.robot.joints[stop.joint]} is at {stop.positions[lane]}"
                yield k, lane, f"{place}, beyond its stop"


def compared(played, steps, other, order):
    """The first of some steps, by their numbers, which has other bits in another case, and its lane in an
    order; the same calls are made there."""
    again = play(other, played.make)
    broken = [step for step in again if step.call["call"] in REPLACING and step.error is not None]
    if broken:
        yield -1, -1, f"{broken[0].call['call']} raised {broken[0].error}"
    twins = [step for step in again if step.call["call"] not in REPLACING]
    for (k, step), twin in zip(steps.items(), twins, strict=True):
        if type(step.error) is not type(twin.error):
            yield k, -1, f"{step.call['call']}: {step.error}; {twin.error}"
            return
        apart = differing(step.rows(), twin.rows(), order)
        if apart:
            yield k, apart[0], f"{step.call['call']} gives other bits"
            return


def no_lane_depends_on_others(played):
    """Lanes in another order, with other threads, and alone have the same bits."""
    count = played.case["num_envs"]
    rng = np.random.default_rng(count)
    alone = [[k] for k in rng.choice(count, min(count, 2), replace=False).tolist()]
    for order in (rng.permutation(count).tolist(), *alone) if count > 1 else ():
        yield from in_another_order(played, order)


def thousands_have_the_same_bits(played):
    """Each of 4096 lanes has the bits that it has among few, noise included."""
    count = played.case["num_envs"]
    if played.case["face"] == "env" or costs(played) * MANY / count > 1.0:
        return
    played.tally["thousands"] += 1
    yield from in_another_order(played, (list(range(count)) * (MANY // count + 1))[:MANY])


def costs(played):
    """How much the calls of a case cost, in units of what the lanes of a case may cost."""
    if played.case["face"] == "simulator":
        return sum(step.told["evaluations"].sum() for _, step in played.intervals()) / MAX_EVALUATIONS
    pairs = [(s.before.get("evaluations"), s.after.get("evaluations")) for s in played.steps]
    return sum(np.maximum(b - a, 0.0).sum() for a, b in pairs if b is not None) / MAX_EVALUATIONS


def in_another_order(played, order):
    """The first call that has other bits with its lanes in an order, and the lane."""
    case = played.case
    kept = without_calls(case, [k for k, step in enumerate(played.steps) if step.error is not None])
    steps = {k: step for k, step in enumerate(played.steps) if step.error is None}
    own = {
        k: step
        for k, step in steps.items()
        if step.call["call"] not in REPLACING and set(lanes_of(case, step.call)) & set(order)
    }
    other = {**with_lanes(kept, order), "threads": 3 - case["threads"]}
    for k, lane, text in compared(played, own, other, order):
        yield k, lane, f"{text} in another order of {len(order)} with {other['threads']} threads"


def what_is_saved_continues(played):
    """Copies, unpickled ones, and others restored from a snapshot continue to the same bits as what goes on
    itself."""
    case, lanes = played.case, list(range(played.case["num_envs"]))
    steps = {k: step for k, step in enumerate(played.steps) if step.call["call"] not in REPLACING}
    alone = [call for call in case["calls"] if call["call"] not in REPLACING]
    anew = []
    for call in case["calls"]:
        anew += [call] * (call["call"] not in REPLACING)
        anew += [{"call": "anew"}] * (call["call"] in ("save", *REPLACING))
    for what, calls in (("that goes on itself", alone), ("with others in its place", anew)):
        if calls != case["calls"]:
            for k, lane, text in compared(played, steps, {**case, "calls": calls}, lanes):
                yield k, lane, f"{text} in one {what}"


# ---- simulators -----------------------------------------------------------------------------------------


def what_is_not_finite_is_flagged(played):
    """``finite`` and the flag NON_FINITE say whether a lane's state is finite in every component."""
    for k, step in played.intervals():
        finite = np.logical_and.reduce([np.isfinite(step.after[n]).all(axis=1) for n in ("q", "qd", "z")])
        flagged = (step.told["numerics"] & NON_FINITE) > 0
        for lane in np.flatnonzero((finite != step.told["finite"]) | (flagged == finite)):
            told = {name: value[lane].item() for name, value in step.told.items()}
            q, qd = step.after["q"][lane].tolist(), step.after["qd"][lane].tolist()
            yield k, lane, f"q {q}, qd {qd}: {told}"


def a_given_up_interval_leaves_its_lane(played):
    """A lane with more events than an interval may have returns to the start of the interval."""
    for k, step in played.intervals():
        given_up = (step.told["numerics"] & GIVEN_UP) > 0
        kept = [same(step.before[name], step.after[name]).all(axis=1) for name in ("q", "qd")]
        for lane in np.flatnonzero(given_up & ~np.logical_and.reduce(kept)):
            apart = np.abs(step.after["q"][lane] - step.before["q"][lane]).max()
            yield k, lane, f"it moved {apart}"


def the_work_of_an_interval_is_bounded(played):
    """No interval takes more evaluations than the documented budgets of its parts allow, for any input."""
    scene = played.scene
    parts = 1 + len(scene.attached.instants)
    adaptive = MAX_ADAPTIVE if scene.integrator == "dop853" else MAX_MORE * scene.substeps
    most = METHODS[scene.integrator].stages * (MAX_TRIALS + adaptive) * parts
    for k, step in played.intervals():
        for lane in np.flatnonzero(step.told["evaluations"] > most):
            yield k, lane, f"{step.told['evaluations'][lane]} evaluations, more than {most}"


# ---- environments ---------------------------------------------------------------------------------------


def observations_lie_in_their_space(played):
    """Every observation is finite, and lies in its space."""
    env = EnvironmentPlayer(played.case).inner
    space = getattr(env, "single_observation_space", env.observation_space)
    for k, lane, name, row in played.observations():
        if not (np.isfinite(row).all() and (space[name] if name else space).contains(row)):
            yield k, lane, f"{name or 'the observation'} is {row.tolist()}"


def no_early_end_pays(played):
    """Steps pay 0 to 1, goals 0 or 1; a dense episode that a fault ends returns nothing."""
    case, goal = played.case, played.case["goal"]
    mode = {"vector": case["autoreset_mode"], "sb3": "same_step"}.get(case["face"])
    returns, over = np.zeros(case["num_envs"]), np.zeros(case["num_envs"], np.bool_)
    saved = None
    slack = FLOAT32 if case["face"] == "sb3" else ROUNDING
    for k, step in enumerate(played.steps):
        kind = step.call["call"]
        if step.error is not None:
            continue
        if kind == "save":
            saved = returns.copy(), over.copy()
        elif kind == "restore" and saved:
            returns, over = (x.copy() for x in saved)
        elif kind == "reset":
            lanes = lanes_of(case, step.call)
            returns[lanes], over[lanes] = 0.0, False
        if kind != "step":
            continue
        reward, terminated = step.told["reward"], step.told["terminated"]
        going = ~over
        if mode == "next_step":  # this step began the next episode of those
            returns[over], over[:] = 0.0, False
        returns[going] += reward[going]
        ended, early = terminated | step.told["truncated"], terminated & going
        paid = reward if goal else np.where(early & np.isfinite(reward), 0.0, reward)
        right = np.isin(paid, (0.0, 1.0)) if goal else (paid >= 0.0) & (paid <= 1.0 + ROUNDING)
        for lane in np.flatnonzero(going & ~right):
            yield k, lane, f"a step pays {reward[lane]}"
        for lane in np.flatnonzero(early & (np.abs(returns) > slack) & (not goal)):
            yield k, lane, f"an episode that a fault ended returns {returns[lane]}"
        played.tally["episodes"] += int((ended & going).sum())
        played.tally["early_ends"] += int(early.sum())
        over = over | ended
        if mode == "same_step":
            returns[over], over[:] = 0.0, False


COMMON = (only_documented_exceptions, a_refused_call_changes_nothing, no_joint_is_beyond_its_stop)
COSTLY = (no_lane_depends_on_others, thousands_have_the_same_bits, what_is_saved_continues)
OF_SIMULATORS = (
    *COMMON, what_is_not_finite_is_flagged, a_given_up_interval_leaves_its_lane,
    the_work_of_an_interval_is_bounded, tolerance_is_kept_or_flagged, the_energy_book_closes, *COSTLY,
    effects_commute, evaluators_agree,
)  # fmt: skip
OF_ENVIRONMENTS = (
    *COMMON, observations_lie_in_their_space, no_early_end_pays, *COSTLY, autoresets_begin_the_same_episodes,
)  # fmt: skip

NAMES = {one.__name__ for one in (*OF_SIMULATORS, *OF_ENVIRONMENTS)}
OF_ONE_SCENE = {"effects_commute", "evaluators_agree", "thousands_have_the_same_bits"}
SHORT = NAMES - OF_ONE_SCENE
"""Without promises that depend little on the order of calls, for tests that play one scene many times."""


def violations(case, make=rde.BatchSimulator, tally=None, only=()):
    """All violations of a case, or of some promises; ``tally`` counts what was looked at."""
    tally = Counter() if tally is None else tally
    played = Played(case, play(case, make), make, tally)
    tally["scenes"] += 1
    tally["refused"] += sum(step.error is not None for step in played.steps)
    for _, step in played.intervals():
        tally["intervals"] += case["num_envs"] * ("reward" in step.told or "numerics" in step.told)
        tally["events"] += int(np.sum(step.told.get("events", 0)))
        tally["flagged"] += int(np.sum(step.told.get("numerics", 0) != 0))
    chosen = OF_SIMULATORS if case["face"] == "simulator" else OF_ENVIRONMENTS
    with np.errstate(all="ignore"):
        return [
            Violation(one.__name__, *found)
            for one in chosen
            if not only or one.__name__ in only
            for found in one(played)
        ]
