"""Brackets of the time of an event, or of a turn, which trial steps make ever smaller.

The results for a step towards an event and for one towards a turn are both computed for every lane. Sides are
1 at the upper stop, -1 at the lower one, 0 at none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from redundant_envs.algebra import logical_not, maximum, where
from redundant_envs.integrators.event_times import TAYLOR_SHARE, Candidate
from redundant_envs.integrators.sliders import ROUNDING, Slider, pick
from redundant_envs.integrators.trial_steps import Bracket, Search, Trial

RELEASE_SHARE = 1e-7
"""Fraction of the step by which a release may be late: the pull of the stop until then is rounding."""
PUSH_ON = 5e-8
"""Fraction of the step added to a guess of a release, so that it is after the release in most cases."""
MOST_GUESSES = 10
"""Number of trial steps towards an event before its bracket is halved, so that every search ends."""
MOST_TURN_GUESSES = 60
"""Number of trial steps towards a turn; by then its bracket is smaller than rounding."""


class Sought(NamedTuple):
    """The slider whose event is sought, at the end of the trial step.

    Attributes
    ----------
    chosen : for each slider, whether it is this one
    free : whether it rests at no stop
    closeness : positions nearer than this to the stop are at it, m
    stop : its position, m
    gap : distance of the slider beyond it, m; for a resting slider, the force with which it must pull, N
    speed, acceleration : outward, m/s and m/s^2
    time : of the first event that it has in the step, s
    passes : whether it may pass its limit, at which a force on it changes its law
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
    """The remaining distance to a stop, covered by a Taylor step.

    Attributes
    ----------
    possible : whether its time is negligible
    time : its duration, s; shorter if another slider reaches its stop before
    arrives : for each slider, whether it is the one that reaches its stop
    """

    possible: Any
    time: Any
    arrives: list[Any]


class Guess(NamedTuple):
    """Result of a trial step for an event, or for a turn.

    Attributes
    ----------
    bracket : the remaining one
    reached : whether the step ends there
    h : length of the next trial step, s
    """

    bracket: Bracket
    reached: Any
    h: Any


class Guesses(NamedTuple):
    """Results of a trial step for an event and for a turn, of which one is sought."""

    event: Guess
    turn: Guess


def sought_slider(search: Search, candidates: Sequence[Candidate]) -> Sought:
    """The slider whose event is sought, at the end of the trial step."""
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
    """The bracket after a trial step towards an event.

    An end that stays for the second time gets a smaller weight (Anderson and Bjorck 1973).
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
    """The bracket after a trial step towards a turn; the gaps are speeds."""
    outward = sought.speed > 0.0
    return Bracket(
        low=where(outward, trial.h, search.low),
        high=where(outward, search.high, trial.h),
        gap_low=where(outward, sought.speed, search.gap_low),
        gap_high=where(outward, search.gap_high, -sought.speed),
    )


def correction_of(trial: Trial, sought: Sought, event: Bracket, turn: Bracket) -> Any:
    """The correction that leads to the next guess: one division for three formulas.

    Towards a turn it is a chord of speeds, for a resting slider a chord of holding forces, both as a fraction
    of the bracket; towards an impact it is Halley's step, s.
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
    """Length of the next trial step towards an event, s; after many of them, to the middle of the bracket.

    Parameters
    ----------
    trial, search, sought : the step, the search that it belongs to, and its slider
    bracket : the bracket after the step
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
    """Length of the next trial step towards a turn, s."""
    low, high = bracket.low, bracket.high
    guess = low + (high - low) * correction
    return where(guess > low, where(guess < high, guess, low), 0.5 * (low + high))


def taylor_step(trial: Trial, sought: Sought, sliders: Sequence[Slider]) -> TaylorStep:
    """The remaining distance of the sought slider to its stop, or of another one that reaches its own
    before."""
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
    """Whether a trial step ends at the event: at the stop, or just after the stop would begin to pull.

    Parameters
    ----------
    trial, search, sought : the step, the search that it belongs to, and its slider
    bracket : the bracket after the step
    rest_of_way : the remaining distance to the stop
    """
    gap, narrow = sought.gap, bracket.is_narrow(trial.left)
    late = gap * (trial.h - search.low) <= RELEASE_SHARE * trial.left * (gap - search.gap_low)
    # A slider that is distinguishable from its stop at the end of the bracket has not arrived.
    rounding = sought.closeness + 4.0 * ROUNDING * trial.left * abs(sought.speed)
    at_stop = (abs(gap) <= sought.closeness) | rest_of_way.possible | (narrow & (gap >= -rounding))
    return where(sought.free, at_stop, (narrow | late) & sought.over)


def guesses_after(trial: Trial, search: Search, sought: Sought, rest_of_way: TaylorStep) -> Guesses:
    """Results of a trial step for an event and for a turn."""
    event, turn = bracket_of_event(trial, search, sought), bracket_of_turn(trial, search, sought)
    step = correction_of(trial, sought, event, turn)
    h_event = next_towards_event(trial, search, sought, event, step)
    h_turn = next_towards_turn(turn, step)
    at_event = ends_at_event(trial, search, sought, event, rest_of_way)
    at_turn = abs(sought.speed * (h_turn - trial.h)) <= sought.closeness
    at_turn = at_turn | (search.tries >= MOST_TURN_GUESSES)
    return Guesses(Guess(event, at_event, h_event), Guess(turn, at_turn, h_turn))
