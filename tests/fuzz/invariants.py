"""Promises of environments in calls of any order, one function each, and the judgement of any case.

The name of the function is the name of the promise; those of simulators are checks of ``verify``.
"""

import re
from collections import Counter

import numpy as np
from gymnasium.error import ResetNeeded

from .cases import Violation, lanes_of, with_lanes, without_calls
from .judging import FLAGS, OF_VERIFY, violations_of
from .playing import Player, differing, play, same

MANY = 1024
"""Lanes of a vector that has as many as those of learners have; simulators are judged with more."""
REPLACING = ("copy", "pickle", "anew")
"""Calls after which another environment goes on."""


def only_documented_exceptions(case, steps):
    """A call raises no other exception than a ValueError or ResetNeeded; only if it is invalid, and then
    always."""
    for k, step in enumerate(steps):
        what, error, must = step.call["call"], step.error, step.must_refuse
        if error is None and must is not None:
            yield k, -1, f"{what} was not refused"
        elif error is not None and not isinstance(error, ValueError | ResetNeeded):
            yield k, -1, f"{what} raised {type(error).__name__}: {error}"
        elif error is not None and must is None and not step.may_refuse:
            yield k, -1, f"{what} was refused: {error}"
        elif error is not None and not re.search(must or "", str(error)):
            yield k, -1, f"{what} was refused without a word of {must!r}: {error}"


def a_refused_call_changes_nothing(case, steps):
    """A call that raises leaves everything that determines the continuation, to the last bit."""
    for k, step in enumerate(steps):
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


def what_is_saved_continues(case, steps):
    """Copies, unpickled ones, and others that are set to a state continue to the same bits as what goes on
    itself."""
    lanes = list(range(case["num_envs"]))
    own = {k: step for k, step in enumerate(steps) if step.call["call"] not in REPLACING}
    alone = [call for call in case["calls"] if call["call"] not in REPLACING]
    anew = []
    for call in case["calls"]:
        anew += [call] * (call["call"] not in REPLACING)
        anew += [{"call": "anew"}] * (call["call"] in ("save", *REPLACING))
    for what, calls in (("that goes on itself", alone), ("with others in its place", anew)):
        if calls != case["calls"]:
            for k, lane, text in compared(own, {**case, "calls": calls}, lanes):
                yield k, lane, f"{text} in one {what}"


def no_lane_depends_on_others(case, steps):
    """Lanes in reverse order, with other threads, and alone have the same bits."""
    count = case["num_envs"]
    for order in ([*range(count)][::-1], [count // 2]) if count > 1 else ():
        yield from in_another_order(case, steps, order)


def thousands_have_the_same_bits(case, steps):
    """Each of a thousand lanes has the bits that it has among few."""
    count = case["num_envs"]
    yield from in_another_order(case, steps, (list(range(count)) * (MANY // count + 1))[:MANY])


def in_another_order(case, steps, order):
    """The first call that has other bits with its lanes in an order, and the lane."""
    # Calls that were refused for some lane are left out: without it they might not be.
    kept = without_calls(case, [k for k, step in enumerate(steps) if step.error is not None])
    own = {
        k: step
        for k, step in enumerate(steps)
        if step.error is None
        and step.call["call"] not in REPLACING
        and set(lanes_of(case, step.call)) & set(order)
    }
    other = {**with_lanes(kept, order), "threads": 3 - case["threads"]}
    for k, lane, text in compared(own, other, order):
        yield k, lane, f"{text} in another order of {len(order)} with {other['threads']} threads"


def observations_lie_in_their_space(case, steps):
    """Every observation is finite, and lies in its space."""
    space = Player(case).env.single_observation_space
    for k, step in enumerate(steps):
        for key, table in step.told.items():
            when, _, name = key.partition(" ")
            for lane, row in enumerate(table) if when in ("now", "last") else ():
                if not (np.isfinite(row).all() and (space[name] if name else space).contains(row)):
                    yield k, lane, f"{name or 'the observation'} is {row.tolist()}"


OF_ENVIRONMENTS = (
    only_documented_exceptions, a_refused_call_changes_nothing, what_is_saved_continues,
    no_lane_depends_on_others, thousands_have_the_same_bits, observations_lie_in_their_space,
)  # fmt: skip
COSTLY = {"thousands_have_the_same_bits"}
"""Promises that depend little on the order of calls."""
NAMES = {FLAGS, *OF_VERIFY, *(one.__name__ for one in OF_ENVIRONMENTS)}


def violations(case, tally=None, only=()):
    """All violations of a case, or of some promises; ``tally`` counts what was looked at."""
    tally = Counter() if tally is None else tally
    tally["scenes"] += 1
    if case["face"] == "simulator":
        return violations_of(case, tally, only)
    steps = play(case)
    tally["refused"] += sum(step.error is not None for step in steps)
    tally["intervals"] += case["num_envs"] * sum("reward" in step.told for step in steps)
    with np.errstate(all="ignore"):
        return [
            Violation(one.__name__, *found)
            for one in OF_ENVIRONMENTS
            if not only or one.__name__ in only
            for found in one(case, steps)
        ]
