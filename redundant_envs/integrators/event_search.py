"""The search for events of a lane: decisions after a trial step.

A trial step goes to the end of the planned step. If it has an event, trial steps from the same start end ever
nearer to it: this keeps the method's own order, and nothing is interpolated. The last 2e-8 of the planned
step to a stop are a Taylor step, exact to rounding: positions here, velocities when the accelerations there
are known. Then contacts are resolved, and the motion continues. Sides are 1 at the upper stop, -1 at the
lower one, 0 at none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from redundant_envs.algebra import any_of, cases, logical_not, maximum, minimum, where
from redundant_envs.integrators.crossings import Crossing, Unseen, most_pull
from redundant_envs.integrators.event_brackets import (
    Guesses,
    Sought,
    TaylorStep,
    guesses_after,
    sought_slider,
    taylor_step,
)
from redundant_envs.integrators.event_times import Candidate, Encounter, first_event
from redundant_envs.integrators.sliders import ROUNDING, Slider, pick
from redundant_envs.integrators.trial_steps import Bracket, Outcome, Phase, Search, Trial

TOGETHER_SHARE = 1e-13
"""Fraction of the control interval: impacts of two sliders that are no farther apart count as one impact of
both. So the result does not depend on the number of steps in an interval."""


class Decision(NamedTuple):
    """Interpretation of a trial step of a lane; at most one of these holds.

    Attributes
    ----------
    accepted : the step has no event
    unclear : it may hide an event: a step of half the length shows more
    event_found : a step to the end of the planned one has an event, which is sought from now on
    other_sooner : another slider has an event before the sought one
    at_event : the step ends at the event
    near_event : it ends only near the event, and the next one will end nearer
    beyond_at_turn : it ends near a turn beyond the stop, so there is an impact before
    past_turn : the slider turns, and stays before its stop
    near_turn : the step ends only near the turn, and the next one will end nearer
    """

    accepted: Any
    unclear: Any
    event_found: Any
    other_sooner: Any
    at_event: Any
    near_event: Any
    beyond_at_turn: Any
    past_turn: Any
    near_turn: Any

    @property
    def begins(self) -> Any:
        """Whether a search begins, with a new bracket."""
        return self.event_found | self.other_sooner | self.beyond_at_turn


class Aim(NamedTuple):
    """An event that may be sought from now on.

    Attributes
    ----------
    exists : whether there is one
    chosen : for each slider, whether the event belongs to it; by default to the first slider
    target, side : number of the slider, and side of the stop
    turns : whether it is a turn
    h : length of the first trial step towards it, s
    """

    exists: Any
    chosen: list[Any]
    target: Any
    side: Any
    turns: Any
    h: Any


class Aims(NamedTuple):
    """The first event of a step without a search, and one before the sought event."""

    first: Aim
    other: Aim


def earliest_event(trial: Trial, candidates: Sequence[Candidate]) -> Aim:
    """The first event of all sliders in a step to the end of the planned one."""
    events = [c.event for c in candidates]
    time, chosen = events[0].time, [True]
    for event in events[1:]:
        sooner = event.time < time
        chosen = [*(other & logical_not(sooner) for other in chosen), sooner]
        time = where(sooner, event.time, time)
    free = pick(chosen, [c.slider.free for c in candidates])
    return Aim(
        exists=time <= trial.h, chosen=chosen,
        target=pick(chosen, [c.number for c in candidates]),
        side=pick(chosen, [event.side for event in events]),
        turns=pick(chosen, [event.turns for event in events]) & free,
        h=minimum(maximum(time, 0.0), trial.h),
    )  # fmt: skip


def came_before(trial: Trial, search: Search, c: Candidate) -> Any:
    """Whether an event of a slider came before the end of a trial step."""
    s, side = c.slider, c.slider.side_beyond
    passed = c.event.turns | ((side != 0.0) & (side * (s.position - s.stop(side)) > s.closeness))
    pulled = (c.pull > 0.0) & (trial.h - search.low > ROUNDING * trial.left)
    return where(s.free, passed, pulled)


def other_event(trial: Trial, search: Search, sought: Sought, candidates: Sequence[Candidate]) -> Aim:
    """An event of another slider than the sought one, before the end of a trial step."""
    late = [
        came_before(trial, search, c) & logical_not(is_sought)
        for c, is_sought in zip(candidates, sought.chosen, strict=True)
    ]
    chosen = [is_late & logical_not(any_of(late[:k])) for k, is_late in enumerate(late)]
    free = pick(chosen, [c.slider.free for c in candidates])
    h = where(free, pick(chosen, [c.event.time for c in candidates]), 0.5 * trial.h)
    sides = [where(c.event.turns, c.event.side, c.slider.side_beyond) for c in candidates]
    return Aim(
        exists=any_of(late), chosen=chosen,
        target=pick(chosen, [c.number for c in candidates]),
        side=pick(chosen, sides), turns=pick(chosen, [c.event.turns for c in candidates]),
        h=where(h < trial.h, h, 0.5 * trial.h),  # never repeat the same step
    )  # fmt: skip


def may_hide_event(h: Any, c: Candidate, unseen: Unseen) -> Any:
    """Whether a step may hide an event of a slider that is larger than rounding.

    A free slider may reach its stop and leave it; the stop of a resting one may have to pull before the end,
    though not at the end. In either case a step of half the length follows.
    """
    s, encounter = c.slider, c.encounter
    moves = most_pull(s, unseen) * encounter.mobility * (h * h)
    pulled = logical_not(c.pull > 0.0) & (moves > s.closeness)
    return where(s.free, encounter.crossing == Crossing.UNCLEAR, pulled)


def decided(trial: Trial, hides: Any, aims: Aims, sought: Sought, guesses: Guesses) -> Decision:
    """Interpret a trial step.

    Parameters
    ----------
    trial, sought : the step, and the slider whose event is sought
    hides : whether the step may hide an event
    aims : events that it may have
    guesses : its results for the sought event, or turn
    """
    tried, seeks_event, seeks_turn = trial.tried, trial.seeks_event, trial.seeks_turn
    at_event, at_turn = guesses.event.reached, guesses.turn.reached
    unclear = tried & hides
    event_found = tried & logical_not(unclear) & aims.first.exists
    sooner = seeks_event & aims.other.exists
    beyond = seeks_turn & (sought.gap > sought.closeness)
    past_turn = seeks_turn & logical_not(beyond) & at_turn
    return Decision(
        accepted=tried & logical_not(event_found) & logical_not(unclear),
        unclear=unclear, event_found=event_found, other_sooner=sooner,
        at_event=seeks_event & logical_not(sooner) & at_event,
        near_event=seeks_event & logical_not(sooner) & logical_not(at_event),
        beyond_at_turn=beyond, past_turn=past_turn,
        near_turn=seeks_turn & logical_not(beyond) & logical_not(past_turn),
    )  # fmt: skip


def next_phase(trial: Trial, decision: Decision, for_turn: Any) -> Any:
    """Kind of the next trial step."""
    return cases(
        (decision.near_turn, Phase.FIND_TURN), (decision.unclear, trial.phase), (for_turn, Phase.FIND_TURN),
        (decision.past_turn, Phase.RUN_PAST_TURN), default=Phase.FIND_EVENT,
    )  # fmt: skip


def next_length(trial: Trial, decision: Decision, sought: Sought, aims: Aims, guesses: Guesses) -> Any:
    """Length of the next trial step, s.

    Parameters
    ----------
    trial, decision : the step before, and its interpretation
    sought : the slider whose event is sought
    aims, guesses : events that may be sought now, and results for the present one
    """
    return cases(
        (decision.near_turn, guesses.turn.h), (decision.unclear, 0.5 * trial.h),
        (decision.beyond_at_turn, sought.time), (decision.past_turn, trial.left),
        (decision.event_found, aims.first.h), (decision.other_sooner, aims.other.h), default=guesses.event.h,
    )  # fmt: skip


def search_continued(
    trial: Trial, search: Search, decision: Decision, sought: Sought, guesses: Guesses
) -> Search:
    """The same search after one more trial step.

    Parameters
    ----------
    trial, decision : the step, and its interpretation
    search, sought : the search before it, and its slider
    guesses : results of the step for the event, or the turn
    """
    brackets = zip(guesses.event.bracket, guesses.turn.bracket, search.bracket, strict=True)
    bracket = Bracket(
        *(
            cases((decision.near_event, event), (decision.near_turn, turn), default=before)
            for event, turn, before in brackets
        )
    )
    side = where(sought.free, search.side, where(sought.over, 1.0, -1.0))
    one = where(trial.seeks_event | trial.seeks_turn, 1.0, 0.0)
    return Search(search.target, side, *bracket, search.tries + one)


def search_begun(
    trial: Trial, search: Search, decision: Decision, for_turn: Any, aims: Aims,
    candidates: Sequence[Candidate],
) -> Search:  # fmt: skip
    """A new search, with the whole step as its bracket, or the present one.

    Parameters
    ----------
    trial, decision : the step, and its interpretation
    search : the present one
    for_turn, aims : whether a turn is sought, and events that may be
    candidates : the sliders
    """
    found, sooner, begins = decision.event_found, decision.other_sooner, decision.begins
    chosen = [where(found, f, o) for f, o in zip(aims.first.chosen, aims.other.chosen, strict=True)]
    start_speed = abs(pick(chosen, [c.slider.start_velocity for c in candidates]))
    speed = abs(pick(chosen, [c.slider.velocity for c in candidates]))
    start_pull = minimum(pick(chosen, [c.start_pull for c in candidates]), 0.0)
    pull = pick(chosen, [c.pull for c in candidates])
    return Search(
        target=cases((found, aims.first.target), (sooner, aims.other.target), default=search.target),
        side=cases((found, aims.first.side), (sooner, aims.other.side), default=search.side),
        low=where(begins, 0.0, search.low),
        high=where(begins, trial.h, search.high),
        gap_low=where(begins, where(for_turn, start_speed, start_pull), search.gap_low),
        gap_high=where(begins, where(for_turn, speed, pull), search.gap_high),
        tries=where(begins, 0.0, search.tries),
    )


def position_at_event(s: Slider, position: Any, arrives: Any, stop: Any, interval: Any) -> Any:
    """Position of a free slider at an event, m: ``position``, or exactly its stop.

    It is at ``stop`` if it ``arrives`` there, and at one of its stops if it would reach it within a
    negligible part of the control ``interval``, or is beyond it.
    """
    near = s.closeness + TOGETHER_SHARE * interval * abs(s.velocity)
    up = (position > s.upper) | ((position >= s.upper - near) & (s.velocity > 0.0))
    down = (position < s.lower) | ((position <= s.lower + near) & (-s.velocity > 0.0))
    return where(arrives, stop, where(up, s.upper, where(down, s.lower, position)))


def positions_after(
    trial: Trial, sliders: Sequence[Slider], sought: Sought, rest_of_way: TaylorStep, at_event: Any,
    slide: Any,
) -> list[Any]:  # fmt: skip
    """Positions of the sliders after a trial step and the Taylor step that follows it."""
    positions = []
    for s, is_sought, arrives in zip(sliders, sought.chosen, rest_of_way.arrives, strict=True):
        moved = s.position + slide * s.velocity
        stop = where(is_sought, sought.stop, s.stop(s.velocity))
        there = moved if s.passes else position_at_event(s, moved, arrives, stop, trial.interval)
        positions.append(where(at_event & s.free, there, moved))
    return positions


def after_trial(
    trial: Trial, search: Search, sliders: Sequence[Slider], encounters: Sequence[Encounter], unseen: Unseen,
    smooth: bool,
) -> Outcome:  # fmt: skip
    """After a trial step: its earliest event, the next step towards the sought one, or its end.

    Parameters
    ----------
    trial, search : the step, and the search that it belongs to
    sliders, encounters : motions of the sliders with stops in the step, and data of their stops
    unseen, smooth : overshoot between the stages of the method, and whether it is not Euler's
    """
    per_h = 1.0 / trial.h
    candidates = [
        Candidate(float(k), s, e, first_event(s, e, trial.h, per_h, smooth))
        for k, (s, e) in enumerate(zip(sliders, encounters, strict=True))
    ]
    sought = sought_slider(search, candidates)
    rest_of_way = taylor_step(trial, sought, sliders)
    guesses = guesses_after(trial, search, sought, rest_of_way)
    aims = Aims(earliest_event(trial, candidates), other_event(trial, search, sought, candidates))
    hides = any_of(may_hide_event(trial.h, c, unseen) for c in candidates)
    decision = decided(trial, hides, aims, sought, guesses)
    for_turn = where(decision.event_found, aims.first.turns, decision.other_sooner & aims.other.turns)
    goes_on = search_continued(trial, search, decision, sought, guesses)
    slide = where(decision.at_event & sought.free & rest_of_way.possible, rest_of_way.time, 0.0)
    return Outcome(
        accepted=decision.accepted, there=decision.at_event,
        again=(
            decision.event_found | decision.near_event | decision.other_sooner | trial.seeks_turn
            | decision.unclear
        ),
        phase=next_phase(trial, decision, for_turn),
        h=next_length(trial, decision, sought, aims, guesses),
        search=search_begun(trial, goes_on, decision, for_turn, aims, candidates),
        positions=positions_after(trial, sliders, sought, rest_of_way, decision.at_event, slide), slide=slide,
        cleared=[
            e.cleared | (decision.past_turn & is_sought)
            for e, is_sought in zip(encounters, sought.chosen, strict=True)
        ],
    )  # fmt: skip
