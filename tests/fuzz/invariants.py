"""What is promised of the batch simulator: one function each, which gives the violations with numbers."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import redundant_envs as rde
from redundant_envs.integrators.tableaus import METHODS
from redundant_envs.scene import Scene
from redundant_envs.tasks.limits import hard_stops

from .cases import Array, Case, numbers, with_lanes, without_calls
from .playing import Lanes, Make, Player, Step, play
from .references import (
    AGREEMENT,
    astuple,
    energies,
    fine_interval,
    judged,
    lane_parameters,
    of_lanes,
    tips,
    tolerance_of,
)

LIMIT = 2.0
"""Errors of the tip below this are kept tolerances, in units of the tolerance."""
ENERGY = 1e-5
"""An energy book that is off by less closes, in units of the energies that were exchanged: impacts cost equal
steps a few 1e-8."""
KINKED_ENERGY = 1e-3
"""The same with limit springs: equal steps across the jump of a stiffness are of second order."""
COARSE_ENERGY = 1e-3
"""The same of a scene at its own tolerance, if that is :data:`SMALL` arm lengths or less."""
SMALL = 1e-6
ROUNDING = 1e-8
"""Differences of energies are known to this share of what they are differences of, times :data:`ENERGY`."""
CONVERGING = 0.5
"""A book that is still off, but by less than this share of what the coarser reference is, only converges."""
MOST_TRIALS, MOST_MORE, MOST_ADAPTIVE = 65536, 18, 1_000_002
"""Steps of an interval, more of each substep, and the most of dop853 beside them."""
MANY_STEPS, MOST_STEPS = 40_000, 400_000
"""Of a control interval, where references may be wrong or a book is not closed yet."""
STRUCTURES = ("save", "copy", "pickle", "npz")
NON_FINITE, GIVEN_UP = int(rde.Numerics.NON_FINITE), int(rde.Numerics.EVENT_BUDGET)


@dataclass(frozen=True)
class Violation:
    """A promise that was not kept: in which call, in which lane (-1: in none), and by how much."""

    invariant: str
    call: int
    lane: int
    found: str


@dataclass
class Tally:
    """Counts of a run."""

    scenes: int = 0
    intervals: int = 0
    events: int = 0
    flagged: int = 0
    judged: int = 0
    """Unflagged intervals with a tolerance where the references agree."""
    books: int = 0
    """Intervals whose energies were compared."""
    refused: int = 0
    episodes: int = 0
    early_ends: int = 0
    failures: dict[str, int] = field(default_factory=dict)

    def add(self, other: Tally) -> None:
        for name, value in vars(other).items():
            if name == "failures":
                for invariant, count in value.items():
                    self.failures[invariant] = self.failures.get(invariant, 0) + count
            else:
                setattr(self, name, getattr(self, name) + value)


@dataclass
class Played:
    """A case, what it gave, and how its simulators are made (tests tamper with them)."""

    case: Case
    steps: list[Step]
    make: Make
    tally: Tally

    @property
    def scene(self) -> Scene:
        return Scene.from_dict(self.case["scene"])

    def intervals(self) -> Iterator[tuple[int, Step]]:
        return ((k, s) for k, s in enumerate(self.steps) if s.status)


Invariant = Callable[[Played], list[Violation]]


def same(one: Array, other: Array) -> Any:
    """Where two arrays have the same bits; a NaN is as good as another."""
    if one.dtype.kind != "f":
        return one == other
    whole = {8: np.int64, 4: np.int32}[one.dtype.itemsize]
    bits = np.ascontiguousarray(one).view(whole) == np.ascontiguousarray(other).view(whole)
    return bits | (np.isnan(one) & np.isnan(other))


def differing(one: Lanes, other: Lanes) -> list[int]:
    """Lanes that differ in any bit."""
    agree = np.ones(len(one.q), np.bool_)
    for a, b in zip(astuple(one), astuple(other), strict=True):
        agree &= same(a, b).reshape(len(agree), -1).all(axis=1)
    return np.flatnonzero(~agree).tolist()


def only_documented_exceptions(played: Played) -> list[Violation]:
    """A call raises nothing but a ValueError, and only if it asks for what cannot be."""
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
    """A call that raises leaves all lanes as they are, to the last bit."""
    return [
        Violation("a_refused_call_changes_nothing", k, lane, f"{step.call['call']} changed it, and raised")
        for k, step in enumerate(played.steps)
        if step.error is not None
        for lane in differing(step.before, step.after)[:1]
    ]


def what_is_not_finite_is_flagged(played: Played) -> list[Violation]:
    """``finite`` and the flag NON_FINITE say whether a lane's state is a number in every component."""
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
    """A lane with more events than an interval may have is back where the interval began."""
    found = []
    for k, step in played.intervals():
        given_up = (step.status["numerics"] & GIVEN_UP) > 0
        moved = ~(same(step.before.q, step.after.q) & same(step.before.qd, step.after.qd)).all(axis=1)
        for lane in np.flatnonzero(given_up & moved):
            apart = np.abs(step.after.q[lane] - step.before.q[lane]).max()
            found.append(Violation("a_given_up_interval_leaves_its_lane", k, int(lane), f"it moved {apart}"))
    return found


def the_work_of_an_interval_is_bounded(played: Played) -> list[Violation]:
    """No interval takes more evaluations than the documented budgets allow, whatever is asked."""
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
    """After every call the sliders of finite lanes stand between their stops, to the last bit."""
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


def can_be_judged(scene: Scene, step: Step) -> Any:
    """Lanes whose interval can be computed again: all numbers finite, and sliders between their stops."""
    efforts = numbers(step.call["efforts"])
    arrays = (step.before.q, step.before.qd, step.before.z, step.before.work[:, None], efforts)
    possible = np.logical_and.reduce([np.isfinite(a).all(axis=1) for a in arrays])
    values = lane_parameters(scene, step.before)
    for joint, low, high in hard_stops(scene):
        x = step.before.q[:, joint]
        possible &= (x >= values[low]) & (x <= values[high])
    return possible


def tolerance_and_energies(played: Played) -> list[Violation]:
    """An interval keeps its tolerance, or is flagged; kinetic + potential - work stays.

    Both are judged where two references agree: the tip is off by less than twice the tolerance (with dop853
    by less than 1e-9 arm lengths); the energy book closes in the scene itself or in a reference, and in the
    scene itself to a thousandth if its tolerance is small.
    """
    scene, found = played.scene, []
    robot: Any = scene.robot
    promised = scene.tolerance is not None or scene.integrator == "dop853"
    tolerance = tolerance_of(scene)
    for k, step in played.intervals():
        lanes = np.flatnonzero(can_be_judged(scene, step) & (step.status["numerics"] == 0))
        if not len(lanes):
            continue
        judgement = judged(scene, step, lanes)
        before, after = of_lanes(step.before, lanes), of_lanes(step.after, lanes)
        error = np.linalg.norm(tips(scene, after) - tips(scene, judgement.finer), axis=1)
        own, fine, coarse = (
            drifts(scene, before, ends) for ends in (after, judgement.finer, judgement.coarser)
        )
        agreed = judgement.agreed
        played.tally.judged += int(agreed.sum()) if promised else 0
        played.tally.books += int(agreed.sum())
        if promised:
            for lane in np.flatnonzero(agreed & ~(error <= LIMIT * tolerance)):
                # An impact within the first step of both references leaves them the same piece before it.
                finest, _ = fine_interval(scene, step, lanes[[lane]], MANY_STEPS)
                apart = tips(scene, finest)[0] - tips(scene, of_lanes(judgement.finer, np.array([lane])))[0]
                if not np.linalg.norm(apart) <= AGREEMENT * tolerance:
                    continue
                text = f"the tip is off by {error[lane]:.3g} m, the tolerance is {tolerance:.3g} m"
                found.append(Violation("tolerance_is_kept_or_flagged", k, int(lanes[lane]), text))
        # Rounding grows with the number of steps: a wrong book is wrong in all three.
        least = np.minimum(np.minimum(own, fine), coarse)
        kinked = any(type(effect).__name__ == "LimitSpring" for effect in scene.effects)
        open_books = agreed & (least > (KINKED_ENERGY if kinked else ENERGY)) & (fine > CONVERGING * coarse)
        if promised and tolerance <= SMALL * sum(robot.lengths):
            open_books |= agreed & (own > COARSE_ENERGY)
        for lane in np.flatnonzero(open_books):
            # What fast friction takes may want far more steps than where the tip comes to rest.
            here = of_lanes(before, np.array([lane]))
            finest = (fine_interval(scene, step, lanes[[lane]], n)[0] for n in (MANY_STEPS, MOST_STEPS))
            if any(drifts(scene, here, end)[0] <= CONVERGING * fine[lane] for end in finest):
                continue
            text = (
                f"kinetic + potential - work drifts by {own[lane]:.3g} of the energies exchanged, in the "
                f"references by {coarse[lane]:.3g} and {fine[lane]:.3g}"
            )
            found.append(Violation("the_energy_book_closes", k, int(lanes[lane]), text))
    return found


def drifts(scene: Scene, before: Lanes, after: Lanes) -> Array:
    """How far kinetic + potential - work has drifted, in units of the energies that were exchanged."""
    (kinetic, potential), (kinetic_after, potential_after) = (energies(scene, x) for x in (before, after))
    with np.errstate(all="ignore"):
        work, gained = after.work - before.work, potential_after - potential
        rounding = ROUNDING * (np.abs(potential) + np.abs(after.work)) + rounding_of_places(scene, before)
        scale = np.maximum(kinetic, kinetic_after) + np.abs(gained) + np.abs(work) + rounding
        drift = np.abs(kinetic_after - kinetic + gained - work)
        return np.where(drift == 0.0, 0.0, drift / scale)


def rounding_of_places(scene: Scene, lanes: Lanes) -> Array:
    """How much the potential energy changes if each coordinate is off by :data:`ROUNDING` of itself, J."""
    _, potential = energies(scene, lanes)
    total = np.zeros(len(potential))
    for k in range(lanes.q.shape[1]):
        q = lanes.q.copy()
        q[:, k] *= 1.0 + ROUNDING
        total += np.abs(energies(scene, dataclasses.replace(lanes, q=q))[1] - potential)
    return total


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
                place = f"place {apart[0]} of {len(order)}, {other['threads']} threads"
                text = f"after call {steps[k].call['call']} it is another one at {place}"
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
