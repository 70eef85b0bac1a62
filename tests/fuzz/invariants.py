"""Promises about the batch simulator: one function each, which returns the violations with numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import redundant_envs as rde
from redundant_envs.numerics.tableaus import METHODS
from redundant_envs.tasks.limits import hard_stops

from .cases import Case, with_lanes, without_calls
from .invariants_motion import tolerance_and_energies
from .played import Played, Tally, Violation, same
from .playing import Lanes, Make, Player, play
from .references import astuple, lane_parameters, of_lanes

MOST_TRIALS, MOST_MORE, MOST_ADAPTIVE = 65536, 18, 1_000_002
"""Most steps of an interval, more for each substep, and the most for dop853."""
STRUCTURES = ("save", "copy", "pickle", "npz")
NON_FINITE, GIVEN_UP = int(rde.Numerics.NON_FINITE), int(rde.Numerics.EVENT_BUDGET)


Invariant = Callable[[Played], list[Violation]]


def differing(one: Lanes, other: Lanes) -> list[int]:
    """Lanes that differ in any bit."""
    agree = np.ones(len(one.q), np.bool_)
    for a, b in zip(astuple(one), astuple(other), strict=True):
        agree &= same(a, b).reshape(len(agree), -1).all(axis=1)
    return np.flatnonzero(~agree).tolist()


def only_documented_exceptions(played: Played) -> list[Violation]:
    """A call raises no other exception than a ValueError, and only if its arguments are invalid."""
    name, found = "only_documented_exceptions", []
    for k, step in enumerate(played.steps):
        call, error = step.call, step.error
        if error is not None and not isinstance(error, ValueError):
            found.append(Violation(name, k, -1, f"{call['call']} raised {type(error).__name__}: {error}"))
        elif error is not None and not (call.get("refusable") or call.get("refused")):
            found.append(Violation(name, k, -1, f"{call['call']} was refused: {error}"))
        elif error is None and call.get("refused"):
            found.append(Violation(name, k, -1, f"{call['call']} was not refused"))
    return found


def a_refused_call_changes_nothing(played: Played) -> list[Violation]:
    """A call that raises leaves all lanes unchanged, to the last bit."""
    return [
        Violation("a_refused_call_changes_nothing", k, lane, f"{step.call['call']} changed it, and raised")
        for k, step in enumerate(played.steps)
        if step.error is not None
        for lane in differing(step.before, step.after)[:1]
    ]


def what_is_not_finite_is_flagged(played: Played) -> list[Violation]:
    """``finite`` and the flag NON_FINITE say whether a lane's state is finite in every component."""
    found = []
    for k, step in played.intervals():
        numeric = [np.isfinite(a).all(axis=1) for a in (step.after.q, step.after.qd, step.after.z)]
        finite = np.logical_and.reduce(numeric)
        flagged = (step.status["numerics"] & NON_FINITE) > 0
        for lane in np.flatnonzero(
            (finite != step.status["finite"]) | (flagged & finite) | ~(finite | flagged)
        ):
            told = {name: value[lane].item() for name, value in step.status.items()}
            q, qd = step.after.q[lane].tolist(), step.after.qd[lane].tolist()
            found.append(Violation("what_is_not_finite_is_flagged", k, int(lane), f"q {q}, qd {qd}: {told}"))
    return found


def a_given_up_interval_leaves_its_lane(played: Played) -> list[Violation]:
    """A lane with more events than an interval may have returns to the start of the interval."""
    found = []
    for k, step in played.intervals():
        given_up = (step.status["numerics"] & GIVEN_UP) > 0
        moved = ~(same(step.before.q, step.after.q) & same(step.before.qd, step.after.qd)).all(axis=1)
        for lane in np.flatnonzero(given_up & moved):
            apart = np.abs(step.after.q[lane] - step.before.q[lane]).max()
            found.append(Violation("a_given_up_interval_leaves_its_lane", k, int(lane), f"it moved {apart}"))
    return found


def the_work_of_an_interval_is_bounded(played: Played) -> list[Violation]:
    """No interval takes more evaluations than the documented budgets allow, for any input."""
    scene, found = played.scene, []
    stages = METHODS[scene.integrator].stages
    most = stages * (MOST_TRIALS + MOST_MORE * scene.substeps)
    if scene.integrator == "dop853":
        most = stages * (MOST_ADAPTIVE + MOST_TRIALS)
    for k, step in played.intervals():
        for lane in np.flatnonzero(step.status["evaluations"] > most):
            text = f"{step.status['evaluations'][lane]} evaluations, more than {most}"
            found.append(Violation("the_work_of_an_interval_is_bounded", k, int(lane), text))
    return found


def no_slider_is_beyond_its_stop(played: Played) -> list[Violation]:
    """After every call the sliders of finite lanes are between their stops, to the last bit."""
    scene, found = played.scene, []
    for k, step in enumerate(played.steps):
        values = lane_parameters(scene, step.after)
        for joint, low, high in hard_stops(scene):
            x = step.after.q[:, joint]
            beyond = np.maximum(values[low] - x, x - values[high])
            numeric = np.isfinite(step.after.q).all(axis=1)
            for lane in np.flatnonzero(numeric & (beyond > 0.0)):
                text = f"{scene.robot.joints[joint]} is {beyond[lane]:.3g} m beyond its stop"
                found.append(Violation("no_slider_is_beyond_its_stop", k, int(lane), text))
    return found


def no_lane_depends_on_others(played: Played) -> list[Violation]:
    """Lanes in another order, with other threads, and alone have the same bits.

    Of a lane that is not finite any more this is counted for itself.
    """
    count = played.case["num_envs"]
    refused = [k for k, step in enumerate(played.steps) if step.error is not None]
    kept = without_calls(played.case, refused)
    steps = [step for step in played.steps if step.error is None]
    rng = np.random.default_rng(count)
    orders = [rng.permutation(count).tolist()]
    orders += [[int(lane)] for lane in rng.choice(count, min(count, 2), replace=False)]
    found: list[Violation] = []
    for order in orders if count > 1 else []:
        other = {**with_lanes(kept, order), "threads": 3 - played.case["threads"]}
        # Calls for none of the lanes are not in the other case.
        own = [
            k for k, c in enumerate(kept["calls"]) if c.get("lanes") is None or set(c["lanes"]) & set(order)
        ]
        for k, again in zip(own, play(other, played.make), strict=True):
            present = of_lanes(steps[k].after, np.array(order))
            apart = differing(present, again.after)
            apart += [
                lane
                for name, value in steps[k].status.items()
                for lane in np.flatnonzero(~same(value[order], again.status[name])).tolist()
            ]
            if apart:
                place = f"index {apart[0]} of {len(order)}, {other['threads']} threads"
                text = f"after call {steps[k].call['call']} its bits differ at {place}"
                found.append(Violation("no_lane_depends_on_others", k, order[apart[0]], text))
                break
    return found


def what_is_saved_continues(played: Played) -> list[Violation]:
    """A simulator restored from a snapshot, a copy and an unpickled one continue to the same bits."""
    calls = played.case["calls"]
    found: list[Violation] = []
    for k in [k for k, c in enumerate(calls) if c["call"] in STRUCTURES][:2]:
        first = Player(played.case, played.make)
        for call in calls[: k + 1]:
            first.play(call)
        second, third = Player(played.case, played.make), Player(played.case, played.make)
        try:
            second.batch.restore(first.batch.save())
        except ValueError as error:
            text = f"the snapshot taken after call {k} is refused: {error}"
            return [Violation("what_is_saved_continues", k, -1, text)]
        second.saved = third.saved = first.saved
        third.batch = first.batch
        third._make({"call": "pickle"})
        for n, call in enumerate(calls[k + 1 :], start=k + 1):
            ends = [player.play(call) for player in (first, second, third)]
            apart = [differing(ends[0].after, end.after) for end in ends[1:]]
            wrong = next((w for w, lanes in zip(("snapshot", "pickle"), apart, strict=True) if lanes), None)
            if wrong:
                lane = (apart[0] or apart[1])[0]
                text = f"the {wrong} taken after call {k} goes on differently"
                found.append(Violation("what_is_saved_continues", n, lane, text))
                break
    return found


INVARIANTS: tuple[Invariant, ...] = (
    only_documented_exceptions, a_refused_call_changes_nothing, what_is_not_finite_is_flagged,
    a_given_up_interval_leaves_its_lane, the_work_of_an_interval_is_bounded,
    no_slider_is_beyond_its_stop, tolerance_and_energies, no_lane_depends_on_others, what_is_saved_continues,
)  # fmt: skip


def violations(
    case: Case, make: Make = rde.BatchSimulator, tally: Tally | None = None, chosen: Any = INVARIANTS
) -> list[Violation]:
    """All violations of a case of the batch simulator."""
    tally = Tally() if tally is None else tally
    played = Played(case, play(case, make), make, tally)
    tally.scenes += 1
    tally.refused += sum(step.error is not None for step in played.steps)
    for _, step in played.intervals():
        tally.intervals += case["num_envs"]
        tally.events += int(step.status["events"].sum())
        tally.flagged += int((step.status["numerics"] != 0).sum())
    return [violation for invariant in chosen for violation in invariant(played)]
