"""Promises: the checks of ``verify`` at the states of a case, and one function each for what it does not
judge: calls in any order, and environments of any scene.

The name of the function or check is the name of the promise.
"""

import dataclasses
import re
from collections import Counter
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from gymnasium.error import ResetNeeded

import redundant_envs as rde
from redundant_envs.effects.hooks import Actuation, Sensing
from redundant_envs.scenes.tableaus import METHODS
from redundant_envs.tasks.base import hard_stops
from redundant_envs.verify import Mode, Subject, Verdict, accuracy, bits, conservation, evaluators, impacts
from redundant_envs.verify.checks import Sample, check, checks_of, enough, ratio
from redundant_envs.verify.promises import NotApplicable, at_most

from .cases import lanes_of, with_lanes, without_calls
from .playing import EnvironmentPlayer, differing, play, same

MAX_TRIALS, MAX_MORE, MAX_ADAPTIVE = 65536, 18, 1_000_002
"""Most steps of an interval, more for each substep, and the most for dop853."""
REPLACING = ("copy", "pickle", "anew")
"""Calls after which another simulator or environment goes on."""
NON_FINITE, GIVEN_UP = int(rde.Numerics.NON_FINITE), int(rde.Numerics.EVENT_BUDGET)
ROUNDING = 1e-9
"""Of a sum of a hundred rewards of at most 1."""


class Violation(NamedTuple):
    invariant: str
    call: int  # -1: none in particular, as the lane
    lane: int
    found: str


@dataclass
class Played:
    """A case, and what its calls gave."""

    case: dict
    steps: list
    tally: Counter  # counts of a run

    def __post_init__(self):
        self.scene = rde.Scene.from_dict(self.case["scene"])

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


# ---- what verify judges -----------------------------------------------------------------------------------

MOST = 96
"""States of a case that are judged."""
STEPS, NUDGE, STEADY = 96, 1e-13, 1e-11
"""Equal steps of the motions of two orders of effects. Lanes are compared whose ends change by less than the
third number if their rates change by the second at the start: others magnify rounding."""


def reordered(scene, rng):
    """The scene with its effects in a random order, in which those that do not commute keep theirs: links of
    one chain of motors or sensors."""

    def places(effect):
        hooks = effect.hooks(scene.robot)
        links = {(h.link, h.joint) for h in hooks if isinstance(h, Actuation)}
        return links | {(h.reading, h.joint) for h in hooks if isinstance(h, Sensing)}

    left, chosen = [(e, places(e)) for e in scene.effects], []
    while left:
        free = [k for k, (_, own) in enumerate(left) if not any(own & before for _, before in left[:k])]
        chosen.append(left.pop(rng.choice(free))[0])
    return dataclasses.replace(scene, effects=tuple(chosen))


@check("effects commute", at_most(1e-9))
def effects_commute(trial):
    """Effects in another order give the same motion to rounding, in equal steps."""
    scene, (q, qd, efforts) = trial.scene, trial.states
    if len(scene.effects) < 2:
        raise NotApplicable("there is one order")
    equal = dataclasses.replace(scene, integrator="rk8", tolerance=None, substeps=STEPS)
    other = reordered(equal, np.random.default_rng(len(scene.effects)))
    motions = (equal, qd), (equal, qd * (1.0 + NUDGE)), (other, qd)
    ends = [conservation.moved(motion, q, rates, efforts) for motion, rates in motions]
    own, nudged, found = (np.stack([end.q, end.qd], axis=1) for end in ends)
    size = np.abs(own).max(axis=2, keepdims=True)
    steady = ends[0].good & (ratio(nudged - own, size) < STEADY).all(axis=(1, 2))
    enough(steady, "every interval magnifies rounding", 1e-9)
    gaps = np.where(steady[:, None, None], ratio(found - own, size), 0.0)
    order = ", ".join(e.key for e in other.effects)
    return trial.finding(gaps.max(axis=1), f"another motion, by {{:.1e}}, in the order {order}")


OF_VERIFY = {
    re.sub(r"\W+", "_", one.name): one
    for one in (
        accuracy.tolerance_kept, conservation.energy_book, impacts.inside, *checks_of(bits), effects_commute,
        evaluators.arrays, evaluators.singles,
    )
    if one is not bits.record
}  # fmt: skip
"""Checks whose promise holds for every scene and state that can be drawn, by the names of their promises."""


def states_of(played):
    """The start and the efforts of unflagged intervals between the scene's own stops."""
    scene, values = played.scene, played.scene.parameters()
    told = [(s.before["q"], s.before["qd"], s.call["efforts"], s.told["numerics"]) for _, s in played.intervals()]
    *states, numerics = (np.concatenate(tables) for tables in zip(*told, strict=True))
    good = (numerics == 0) & np.isfinite(np.hstack(states)).all(axis=1)
    for joint, low, high in hard_stops(scene):
        places = states[0] @ scene.robot.motor_map[:, joint]
        good &= (places >= values[low]) & (places <= values[high])
    return tuple(x[good][:MOST] for x in states)


def missed_by_verify(played, only):
    """Violations of the promises of ``verify`` by the scene at the states of a case."""
    states = states_of(played)
    if not len(states[0]):
        return
    trial = Sample(Subject("drawn", played.scene), len(states[0]), Mode.STANDARD, given=states)
    for name, one in OF_VERIFY.items():
        if only and name not in only:
            continue
        outcome = one.run(trial)
        played.tally[f"{name} {outcome.verdict.value}"] += 1
        # The energy book is infinite where too few motions are simulated well enough to be judged.
        if outcome.verdict is Verdict.MISSED and not np.isinf(outcome.finding.found):
            yield Violation(name, -1, -1, f"{outcome.finding.words} ({outcome.finding.where})")


# ---- calls ------------------------------------------------------------------------------------------------


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


def compared(steps, other, order):
    """The first of some steps, by their numbers, which has other bits in another case, and its lane in an
    order; the same calls are made there."""
    again = play(other)
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
            for k, lane, text in compared(steps, {**case, "calls": calls}, lanes):
                yield k, lane, f"{text} in one {what}"


# ---- simulators -------------------------------------------------------------------------------------------


def what_is_not_finite_is_flagged(played):
    """``finite`` and the flag NON_FINITE say whether a lane's state is finite in every component."""
    for k, step in played.intervals():
        finite = np.logical_and.reduce([np.isfinite(step.after[n]).all(axis=1) for n in ("q", "qd", "z")])
        flagged = (step.told["numerics"] & NON_FINITE) > 0
        for lane in np.flatnonzero((finite != step.told["finite"]) | (flagged == finite)):
            yield k, lane, f"q {step.after['q'][lane]}, qd {step.after['qd'][lane]}, told finite or not wrongly"


def a_given_up_interval_leaves_its_lane(played):
    """A lane with more events than an interval may have returns to the start of the interval."""
    for k, step in played.intervals():
        given_up = (step.told["numerics"] & GIVEN_UP) > 0
        kept = [same(step.before[name], step.after[name]).all(axis=1) for name in ("q", "qd")]
        for lane in np.flatnonzero(given_up & ~np.logical_and.reduce(kept)):
            yield k, lane, f"it moved from {step.before['q'][lane]} to {step.after['q'][lane]}"


def the_work_of_an_interval_is_bounded(played):
    """No interval takes more evaluations than the documented budgets of its parts allow, for any input."""
    scene = played.scene
    adaptive = MAX_ADAPTIVE if scene.integrator == "dop853" else MAX_MORE * scene.substeps
    parts = 1 + len(scene.attached.instants)
    most = METHODS[scene.integrator].stages * (MAX_TRIALS + adaptive) * parts
    for k, step in played.intervals():
        for lane in np.flatnonzero(step.told["evaluations"] > most):
            yield k, lane, f"{step.told['evaluations'][lane]} evaluations, more than {most}"


# ---- environments -----------------------------------------------------------------------------------------


def no_lane_depends_on_others(played):
    """Lanes in reverse order, with other threads, and alone have the same bits."""
    case, count = played.case, played.case["num_envs"]
    for order in ([*range(count)][::-1], [count // 2]) if count > 1 else ():
        # Calls that were refused for some lane are left out: without it they might not be.
        kept = without_calls(case, [k for k, step in enumerate(played.steps) if step.error is not None])
        own = {
            k: step
            for k, step in enumerate(played.steps)
            if step.error is None
            and step.call["call"] not in REPLACING
            and set(lanes_of(case, step.call)) & set(order)
        }
        other = {**with_lanes(kept, order), "threads": 3 - case["threads"]}
        for k, lane, text in compared(own, other, order):
            yield k, lane, f"{text} in another order of {len(order)} with {other['threads']} threads"


def observations_lie_in_their_space(played):
    """Every observation is finite, and lies in its space."""
    space = EnvironmentPlayer(played.case).subject.single_observation_space
    for k, lane, name, row in played.observations():
        if not (np.isfinite(row).all() and (space[name] if name else space).contains(row)):
            yield k, lane, f"{name or 'the observation'} is {row.tolist()}"


def no_early_end_pays(played):
    """Steps pay 0 to 1, goals 0 or 1; a dense episode that a fault ends returns nothing."""
    case, goal = played.case, played.case["goal"]
    mode = case["autoreset_mode"]
    returns, over = np.zeros(case["num_envs"]), np.zeros(case["num_envs"], np.bool_)
    saved = None
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
        for lane in np.flatnonzero(early & (np.abs(returns) > ROUNDING) & (not goal)):
            yield k, lane, f"an episode that a fault ended returns {returns[lane]}"
        played.tally["episodes"] += int((ended & going).sum())
        played.tally["early_ends"] += int(early.sum())
        over = over | ended
        if mode == "same_step":
            returns[over], over[:] = 0.0, False


COMMON = (only_documented_exceptions, a_refused_call_changes_nothing, what_is_saved_continues)
OF_SIMULATORS = (
    *COMMON, what_is_not_finite_is_flagged, a_given_up_interval_leaves_its_lane,
    the_work_of_an_interval_is_bounded,
)  # fmt: skip
OF_ENVIRONMENTS = (
    *COMMON, no_lane_depends_on_others, observations_lie_in_their_space, no_early_end_pays,
)  # fmt: skip
NAMES = {one.__name__ for one in (*OF_SIMULATORS, *OF_ENVIRONMENTS)} | set(OF_VERIFY)


def violations(case, tally=None, only=()):
    """All violations of a case, or of some promises; ``tally`` counts what was looked at."""
    played = Played(case, play(case), Counter() if tally is None else tally)
    simulator = case["face"] == "simulator"
    played.tally["scenes"] += 1
    played.tally["refused"] += sum(step.error is not None for step in played.steps)
    for _, step in played.intervals():
        played.tally["intervals"] += case["num_envs"] * ("reward" in step.told or "numerics" in step.told)
        played.tally["flagged"] += int(np.sum(step.told.get("numerics", 0) != 0))
    with np.errstate(all="ignore"):
        found = [
            Violation(one.__name__, *own)
            for one in (OF_SIMULATORS if simulator else OF_ENVIRONMENTS)
            if not only or one.__name__ in only
            for own in one(played)
        ]
        return found + (list(missed_by_verify(played, only)) if simulator else [])
