"""Where an event, or a turn, lies between trial steps: the bracket of its time becomes ever smaller.

What a step towards an event and what one towards a turn would show is computed for every lane. Sides are 1 at
the upper stop, -1 at the lower one, 0 at none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from redundant_envs.algebra import logical_not, maximum, where
from redundant_envs.integrators.event_times import TAYLOR_SHARE, Candidate
from redundant_envs.integrators.sliders import ROUNDING, Slider, pick
from redundant_envs.integrators.trial_steps import Bracket, Search, Trial

RELEASE_SHARE = 1e-7
"""Of the step, by which a release may be late: what its stop pulls until then is lost in rounding."""
PUSH_ON = 5e-8
"""Of the step, added to a guess of a release, which then lies behind it in most cases."""
MOST_GUESSES = 10
"""Trial steps towards an event before its bracket is halved, so that every search ends."""
MOST_TURN_GUESSES = 60
"""Trial steps towards a turn; by then a bracket is smaller than rounding."""


class Sought(NamedTuple):
    """The slider whose event is looked for, at the end of the trial step.

    Attributes
    ----------
    chosen : of each slider, whether it is this one
    free : whether it rests at no stop
    closeness : positions nearer than this to the stop are at it, m
    stop : its position, m
    gap : how far the slider is beyond it, m; of a slider that rests, how hard it would have to pull, N
    speed, acceleration : outward, m/s and m/s^2
    time : of the first event that it has in the step, s
    passes : whether it passes its limit, where a force on it changes its law
    """

    chosen: list[Any]
    free: Any
    closeness: Any
    stop: Any
    gap: Any
    speed: Any
    acceleration: Any
    time: Any
    passes: Any

    @property
    def over(self) -> Any:
        """Whether the step ends after the event."""
        return self.gap > 0.0


class TaylorStep(NamedTuple):
    """The rest of the way to a stop.

    Attributes
    ----------
    possible : whether it takes no time to speak of
    time : that it takes, s; less if another slider comes to its stop before
    arrives : of each slider, whether it is the one that comes to its stop
    """

    possible: Any
    time: Any
    arrives: list[Any]


class Guess(NamedTuple):
    """What a trial step has shown of an event, or of a turn.

    Attributes
    ----------
    bracket : that is left
    reached : whether the step ends there
    h : where the next trial step ends, s
    """

    bracket: Bracket
    reached: Any
    h: Any


class Guesses(NamedTuple):
    """What a trial step has shown of an event, and what of a turn: one of them is looked for."""

    event: Guess
    turn: Guess


def sought_slider(search: Search, candidates: Sequence[Candidate]) -> Sought:
    """The slider whose event is looked for, at the end of the trial step."""
    sliders = [c.slider for c in candidates]
    chosen = [search.target == c.number for c in candidates]
    free = pick(chosen, [s.active_stop for s in sliders]) == 0.0
    upper, lower = pick(chosen, [s.upper for s in sliders]), pick(chosen, [s.lower for s in sliders])
    stop = where(search.side > 0.0, upper, lower)
    beyond = search.side * (pick(chosen, [s.position for s in sliders]) - stop)
    return Sought(
        chosen=chosen, free=free, closeness=pick(chosen, [s.closeness for s in sliders]), stop=stop,
        gap=where(free, beyond, pick(chosen, [c.pull for c in candidates])),
        speed=search.side * pick(chosen, [s.velocity for s in sliders]),
        acceleration=search.side * pick(chosen, [s.watched.last for s in sliders]),
        time=pick(chosen, [c.event.time for c in candidates]),
        passes=any(s.passes for s in sliders) and pick(chosen, [float(s.passes) for s in sliders]) > 0.0,
    )  # fmt: skip


def bracket_of_event(trial: Trial, search: Search, sought: Sought) -> Bracket:
    """What a trial step towards an event leaves of the bracket.

    An end that stays for the second time counts less (Anderson and Bjorck 1973).
    """
    over, last_over = sought.over, search.side > 0.0
    weight = 1.0 - sought.gap / where(over, search.gap_high, search.gap_low)
    weight = where(weight > 0.0, weight, 0.5)
    return Bracket(
        low=where(over, search.low, trial.h),
        high=where(over, trial.h, search.high),
        gap_low=where(over, where(last_over, weight * search.gap_low, search.gap_low), sought.gap),
        gap_high=where(over, sought.gap, where(last_over, search.gap_high, weight * search.gap_high)),
    )


def bracket_of_turn(trial: Trial, search: Search, sought: Sought) -> Bracket:
    """What a trial step towards a turn leaves of the bracket; the gaps are speeds."""
    outward = sought.speed > 0.0
    return Bracket(
        low=where(outward, trial.h, search.low),
        high=where(outward, search.high, trial.h),
        gap_low=where(outward, sought.speed, search.gap_low),
        gap_high=where(outward, search.gap_high, -sought.speed),
    )


def correction_of(trial: Trial, sought: Sought, event: Bracket, turn: Bracket) -> Any:
    """How the next guess follows from what is known: one division for three formulas.

    Towards a turn a chord of speeds, of a resting slider a chord of holding forces, both as a share of the
    bracket; towards an impact Halley's step, s.
    """
    gap, speed = sought.gap, sought.speed
    curved = 2.0 * speed * speed - gap * sought.acceleration
    curved = where(curved > speed * speed, curved, 2.0 * speed * speed)
    forces = event.gap_low - event.gap_high
    share = where(trial.seeks_turn, turn.gap_low, where(sought.free, -2.0 * gap * speed, event.gap_low))
    return share / where(trial.seeks_turn, turn.gap_low + turn.gap_high, where(sought.free, curved, forces))


def next_towards_event(
    trial: Trial, search: Search, sought: Sought, bracket: Bracket, correction: Any
) -> Any:
    """Where the next trial step towards an event ends, s; after many of them, in the middle of the bracket.

    Parameters
    ----------
    trial, search, sought : the step, the search that it belongs to, and its slider
    bracket : that the step has left
    correction : of :func:`correction_of`
    """
    low, high = bracket.low, bracket.high
    middle = 0.5 * (low + high)
    impact = where(sought.speed > 0.0, trial.h + correction, middle)
    release = low + (high - low) * correction + PUSH_ON * trial.left
    guess = where(sought.free, impact, release)
    guess = where(search.tries < MOST_GUESSES, guess, middle)
    guess = where(guess > low, where(guess < high, guess, middle), middle)
    return where(logical_not(sought.free) & bracket.is_narrow(trial.left), high, guess)


def next_towards_turn(bracket: Bracket, correction: Any) -> Any:
    """Where the next trial step towards a turn ends, s."""
    low, high = bracket.low, bracket.high
    guess = low + (high - low) * correction
    return where(guess > low, where(guess < high, guess, low), 0.5 * (low + high))


def taylor_step(trial: Trial, sought: Sought, sliders: Sequence[Slider]) -> TaylorStep:
    """The rest of the way of a sought slider to its stop, or of another one that is at its own before."""
    time = where(sought.speed > 0.0, -sought.gap / sought.speed, 1.0)
    near = (abs(time) <= TAYLOR_SHARE * trial.left) & (time <= trial.left - trial.h)
    possible = near & logical_not(sought.passes)
    arrives = list(sought.chosen)
    for k, s in enumerate(sliders):
        if s.passes:
            continue
        speed, way = abs(s.velocity), where(s.velocity > 0.0, s.upper - s.position, s.position - s.lower)
        own = maximum(way, 0.0) / speed
        sooner = possible & s.free & (speed > 0.0) & (own < time)
        time = where(sooner, own, time)
        arrives = [x | sooner if j == k else x & logical_not(sooner) for j, x in enumerate(arrives)]
    return TaylorStep(possible, time, arrives)


def ends_at_event(
    trial: Trial, search: Search, sought: Sought, bracket: Bracket, rest_of_way: TaylorStep
) -> Any:
    """Whether a trial step ends at the event: at the stop, or where that would pull, not just before.

    Parameters
    ----------
    trial, search, sought : the step, the search that it belongs to, and its slider
    bracket : that the step has left
    rest_of_way : to the stop
    """
    gap, narrow = sought.gap, bracket.is_narrow(trial.left)
    late = gap * (trial.h - search.low) <= RELEASE_SHARE * trial.left * (gap - search.gap_low)
    # A slider that is distinguishable from its stop at the end of the bracket has not arrived.
    rounding = sought.closeness + 4.0 * ROUNDING * trial.left * abs(sought.speed)
    at_stop = (abs(gap) <= sought.closeness) | rest_of_way.possible | (narrow & (gap >= -rounding))
    return where(sought.free, at_stop, (narrow | late) & sought.over)


def guesses_after(trial: Trial, search: Search, sought: Sought, rest_of_way: TaylorStep) -> Guesses:
    """What a trial step has shown of an event, and what of a turn."""
    event, turn = bracket_of_event(trial, search, sought), bracket_of_turn(trial, search, sought)
    step = correction_of(trial, sought, event, turn)
    h_event = next_towards_event(trial, search, sought, event, step)
    h_turn = next_towards_turn(turn, step)
    at_event = ends_at_event(trial, search, sought, event, rest_of_way)
    at_turn = abs(sought.speed * (h_turn - trial.h)) <= sought.closeness
    at_turn = at_turn | (search.tries >= MOST_TURN_GUESSES)
    return Guesses(Guess(event, at_event, h_event), Guess(turn, at_turn, h_turn))
