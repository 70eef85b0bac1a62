"""Events of a lane: where a slider meets its stop, or its stop would have to pull it, located in time.

A trial step is made to the end of the planned step. If it has an event, trial steps from the same start
end ever nearer to it: an extension of the method's own order, no interpolation. The last 1e-9 s to a stop
are a Taylor step, exact to rounding: positions here, velocities when the accelerations there are known.
Then contacts are resolved, and the motion goes on. Sides are 1 at the upper stop, -1 at the lower one, 0 at
none.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from typing import Any, NamedTuple

from redundant_envs.algebra import any_of, cases, logical_not, maximum, minimum, sqrt, where
from redundant_envs.integrators.methods import Watched


class Phase(enum.IntEnum):
    """What a lane with steps of its own does next."""

    IDLE = 0
    AT_STOP = 1
    """Its contacts are resolved."""
    RUN = 2
    """A trial step to the end of the planned step."""
    FIND_TURN = 3
    """Trial steps to where a slider turns."""
    RUN_PAST_TURN = 4
    """To the end of the planned step, though a slider turns near its stop."""
    FIND_EVENT = 5
    """Trial steps towards an event."""
    COMPLETE = 6


class Crossing(enum.IntEnum):
    """How a trial step meets a stop; negative at the lower one."""

    NONE = 0
    ENDS_BEYOND = 1
    """It ends beyond it, and passes it once."""
    TURNS_NEAR = 2
    """It turns once, and may be beyond it then."""
    UNCLEAR = 4
    """It may pass it more often than its ends and its turn tell."""


ROUNDING = 8.881784197001252e-16
"""Four units in the last place, relative: nearer than that positions and times are not told apart."""
NO_STOP = 1e300
"""Larger limits are none: infinite ones must not make every position close."""
SMALLEST_SCALE = 1e-280
"""Positions and limits that are all 0 still round at something that is not 0."""
TAYLOR_TIME = 1e-9
"""Seconds to a stop that a Taylor step crosses: its third order is below rounding."""
ARRIVAL_TIME = 1e-14
"""Seconds from a stop at which another slider's event finds a slider there."""
RELEASE_SHARE = 1e-7
"""Of the step, by which a release may be late: what its stop pulls until then is lost in rounding."""
PUSH_ON = 5e-8
"""Of the step, added to a guess of a release, which then lies behind it in most cases."""
MOST_GUESSES = 10
"""Trial steps towards an event before its bracket is halved, so that every search ends."""
MOST_TURN_GUESSES = 60
"""Trial steps towards a turn; by then a bracket is smaller than rounding."""


class Unseen(NamedTuple):
    """What an acceleration may do between the stages of a step and near its ends (Tableau.unseen)."""

    between: float
    at_ends: float


class Slider(NamedTuple):
    """A slider in a trial step.

    Attributes
    ----------
    position, velocity : at the end of the step, m and m/s
    start_position, start_velocity : at its start
    watched : accelerations at the stages, m/s^2; of a slider that rests, how hard its stop has to pull, N
    active_stop : side of the stop it rests at
    lower, upper : its stops, m
    """

    position: Any
    velocity: Any
    start_position: Any
    start_velocity: Any
    watched: Watched
    active_stop: Any
    lower: Any
    upper: Any

    @property
    def free(self) -> Any:
        """Whether it rests at no stop."""
        return self.active_stop == 0.0


def closeness(position: Any, lower: Any, upper: Any) -> Any:
    """Positions nearer than this to a stop are at it: four units in the last place, m, but never 0."""
    low = where(abs(lower) < NO_STOP, abs(lower), 0.0)
    high = where(abs(upper) < NO_STOP, abs(upper), 0.0)
    return ROUNDING * maximum(maximum(low, high), maximum(abs(position), SMALLEST_SCALE))


def side_beyond(position: Any, active_stop: Any, lower: Any, upper: Any) -> Any:
    """Side of the stop that a free slider is beyond."""
    return where(active_stop == 0.0, where(position > upper, 1.0, where(position < lower, -1.0, 0.0)), 0.0)


def side_touched(position: Any, active_stop: Any, lower: Any, upper: Any) -> Any:
    """Side of the stop that a slider touches."""
    at = where(position >= upper, 1.0, where(position <= lower, -1.0, 0.0))
    return where(active_stop == 0.0, at, active_stop)


def starts_at_stop(position: Any, velocity: Any, active_stop: Any, lower: Any, upper: Any) -> Any:
    """Whether a free slider starts at a stop and does not move away from it."""
    up, down = (position >= upper) & (velocity >= 0.0), (position <= lower) & (velocity <= 0.0)
    return (active_stop == 0.0) & (up | down)


def leaves_stop(position: Any, velocity: Any, active_stop: Any, lower: Any, upper: Any) -> Any:
    """Whether a free slider starts at a stop and moves away from it: it does not come to rest there, however
    slow it is."""
    up, down = (position >= upper) & (velocity < 0.0), (position <= lower) & (velocity > 0.0)
    return (active_stop == 0.0) & (up | down)


# ---- does a trial step meet a stop? -----------------------------------------------------------------


def may_meet(s: Slider, h: Any, unseen: Unseen) -> Any:
    """Whether a free slider may meet a stop in a step. A cheap bound of :func:`excursions`: if q'' >= -A, q
    exceeds its ends by at most A h^2 / 8."""
    more = unseen.between * (s.watched.most - s.watched.least)
    eighth = 0.125 * h * h
    top = maximum(s.start_position, s.position) + eighth * maximum(more - s.watched.least, 0.0)
    bottom = minimum(s.start_position, s.position) - eighth * maximum(s.watched.most + more, 0.0)
    return s.free & logical_not((top < s.upper) & (bottom > s.lower))


def most_pull(s: Slider, unseen: Unseen) -> Any:
    """How hard the stop of a resting slider may have to pull it at any time of a step; 0 if not at all."""
    w = s.watched
    share = where(w.most > maximum(w.first, w.last), unseen.between, unseen.at_ends)
    return where(s.free, 0.0, maximum(w.most + share * (w.most - w.least), 0.0))


def acceleration_bounds(s: Slider, unseen: Unseen) -> tuple[Any, Any]:
    """Bounds of an acceleration in a step, from its least and greatest value at the stages.

    What a parabola may add between the stages is added; but a slider that starts at its stop was struck or
    released there, so its first stage is an end of the range: nothing is added towards that stop.
    """
    w = s.watched
    down = where(w.least < minimum(w.first, w.last), unseen.between, unseen.at_ends) * (w.most - w.least)
    up = where(w.most > maximum(w.first, w.last), unseen.between, unseen.at_ends) * (w.most - w.least)
    return (
        where(s.start_position > s.lower, w.least - down, w.least),
        where(s.start_position < s.upper, w.most + up, w.most),
    )


def excursions(s: Slider, h: Any, lo: Any, hi: Any) -> tuple[Any, Any]:
    """Whether a slider whose acceleration stays in lo..hi may turn beyond its upper and lower stop
    between the ends of a step: it cannot if these are 0 or less.

    With q'' >= -A and A h^2 = p, q exceeds its ends by at most (p/2 - |q1 - q0|)^2 / (2 p), and not at
    all if p/2 < |q1 - q0|; with q'' <= B it stays below q0 + v0 h + B h^2 / 2, and if B < 0 it is at
    most v^2 / (2 |B|) above each end.
    """
    q0, v0, q1, v1 = s.start_position, s.start_velocity, s.position, s.velocity
    close = closeness(q0, s.lower, s.upper)
    top = s.upper + close
    bottom = s.lower - close
    up0 = top - q0
    up1 = top - q1
    down0 = q0 - bottom
    down1 = q1 - bottom
    sinks = h * h * maximum(-lo, 0.0)
    lifts = h * h * maximum(hi, 0.0)
    way = abs(q1 - q0)
    rest = maximum(0.5 * sinks - way, 0.0)
    above = rest * rest - 2.0 * sinks * minimum(up0, up1)
    above = minimum(above, h * maximum(v0, 0.0) + 0.5 * lifts - up0)
    above = minimum(above, minimum(v0 * v0 + 2.0 * hi * up0, v1 * v1 + 2.0 * hi * up1))
    rest = maximum(0.5 * lifts - way, 0.0)
    below = rest * rest - 2.0 * lifts * minimum(down0, down1)
    below = minimum(below, 0.5 * sinks - h * minimum(v0, 0.0) - down0)
    below = minimum(below, minimum(v0 * v0 - 2.0 * lo * down0, v1 * v1 - 2.0 * lo * down1))
    return above, below


def turning_time(s: Slider, h: Any) -> Any:
    """Time at which the cubic through both ends of a step turns; the end if it does not."""
    v0, v1 = s.start_velocity, s.velocity
    s0 = h * v0
    d = s.position - s.start_position
    c2 = 3.0 * d - h * (2.0 * v0 + v1)
    c3 = h * (v0 + v1) - 2.0 * d
    root = sqrt(maximum(c2 * c2 - 3.0 * c3 * s0, 0.0))
    return h * where(v0 * v1 < 0.0, s0 / (where(v0 > 0.0, root, -root) - c2), 1.0)


def crossing_of(s: Slider, h: Any, unseen: Unseen) -> Any:
    """How a step meets a stop, as :class:`Crossing` with the sign of its side.

    A velocity that keeps its sign meets a stop once at most, an acceleration that does turns once.
    """
    w, q1, v0, v1 = s.watched, s.position, s.start_velocity, s.velocity
    lo, hi = acceleration_bounds(s, unseen)
    above, below = excursions(s, h, lo, hi)
    ends = where(q1 > s.upper, 1.0, where(q1 < s.lower, -1.0, 0.0))
    slower = h * maximum(-lo, 0.0)  # by how much a velocity can fall and rise
    faster = h * maximum(hi, 0.0)
    rises = maximum(v0 - slower, v1 - faster)
    falls = maximum(-v0 - faster, -v1 - slower)
    # While an acceleration grows, or falls, its velocity stays below, or above, its ends.
    stays_below = minimum(minimum(w.least - w.first, w.last - w.most), -maximum(v0, v1))
    stays_above = minimum(minimum(w.first - w.most, w.least - w.last), minimum(v0, v1))
    monotonic = maximum(maximum(rises, falls), maximum(stays_below, stays_above))
    turned = where(above > 0.0, where(q1 > s.upper, 1.0, 2.0), ends)
    turned = where(below > 0.0, where(q1 < s.lower, -1.0, -2.0), turned)
    bent_once = maximum(lo, -hi)
    turned = where(bent_once >= 0.0, turned, where(turned == 0.0, 0.0, 4.0))
    return where(monotonic >= 0.0, ends, turned)


# ---- when? ------------------------------------------------------------------------------------------


class Quintic(NamedTuple):
    """side (gap + s0 s + c2 s^2 + ... + c5 s^5): how far a slider is beyond a stop at a share s of a step."""

    side: Any
    gap: Any
    s0: Any
    c2: Any
    c3: Any
    c4: Any
    c5: Any

    def value(self, s: Any) -> Any:
        inner = self.c2 + s * (self.c3 + s * (self.c4 + s * self.c5))
        return self.side * (self.gap + s * (self.s0 + s * inner))

    def slope(self, s: Any) -> Any:
        inner = 3.0 * self.c3 + s * (4.0 * self.c4 + s * (5.0 * self.c5))
        return self.side * (self.s0 + s * (2.0 * self.c2 + s * inner))


def nearer_root(f: Quintic, low: Any, high: Any, s: Any, per_slope: Any) -> tuple[Any, Any, Any, Any]:
    """A bracketed Newton step towards a zero.

    One over the slope is brought up to date by a Newton step of its own, without a division.
    """
    g, slope = f.value(s), f.slope(s)
    per_slope = per_slope * (2.0 - slope * per_slope)
    low = where(g > 0.0, low, s)
    high = where(g > 0.0, s, high)
    new = s - g * per_slope
    middle = 0.5 * (low + high)
    new = where(slope > 0.0, where(new > low, where(new < high, new, middle), middle), middle)
    return low, high, new, per_slope


def crossing_time(s: Slider, h: Any, side: Any, gap: Any, share: Any, turned: Any) -> Any:
    """When the quintic through both ends of a step goes beyond the stop, of which ``share`` is a guess.

    An inward motion has ``turned`` at that part of the step. The acceleration at the end is that of
    the last stage. Three iterations find the zero as well as the quintic knows the event.
    """
    v0, v1 = s.start_velocity, s.velocity
    d = s.position - s.start_position
    s0 = h * v0
    s1 = h * v1
    c2 = 0.5 * h * h * s.watched.first
    e2 = 0.5 * h * h * s.watched.last
    c3 = 10.0 * d - 6.0 * s0 - 4.0 * s1 - 3.0 * c2 + e2
    c4 = 8.0 * s0 + 7.0 * s1 + 3.0 * c2 - 2.0 * e2 - 15.0 * d
    c5 = 6.0 * d - 3.0 * (s0 + s1) - c2 + e2
    f = Quintic(side, gap, s0, c2, c3, c4, c5)
    low = where(side * v0 < 0.0, where(v0 * v1 < 0.0, minimum(turned, 1.0), 0.0), 0.0)
    high: Any = 1.0
    share = maximum(share, low)
    per_slope = 1.0 / f.slope(share)
    for _ in range(3):
        low, high, share, per_slope = nearer_root(f, low, high, share, per_slope)
    return h * share


class Contact(NamedTuple):
    """What is known of a slider and its stops beside its motion.

    Attributes
    ----------
    force, start_force : that its stop exerts along it now and at the start of the trial step, N
    crossing, turning_time : of the trial step
    cleared : whether it is known to turn before its stop
    mobility : of the slider, 1/kg
    """

    force: Any
    start_force: Any
    crossing: Any
    turning_time: Any
    cleared: Any
    mobility: Any


class Found(NamedTuple):
    """The event of a slider after a tried step: h + 1 for never; its side; whether it only turns near."""

    time: Any
    side: Any
    turn: Any


def first_event(s: Slider, c: Contact, h: Any, per_h: Any, smooth: bool) -> Found:
    """After a tried step: when a slider has an event. Where it ends is a parabola of its length unless the
    method is ``smooth``."""
    q0, v0, q1 = s.start_position, s.start_velocity, s.position
    side = side_beyond(q1, s.active_stop, s.lower, s.upper)
    gap = q0 - where(side > 0.0, s.upper, s.lower)
    pull = s.active_stop * c.force
    push = maximum(-s.active_stop * c.start_force, 0.0)
    turn = (abs(c.crossing) == Crossing.TURNS_NEAR) & logical_not(c.cleared) & s.free
    # Where the parabola through both ends meets the stop, or a chord of holding forces changes sign.
    start = side * h * v0
    bend = side * (q1 - q0) - start
    outward = sqrt(maximum(start * start - 4.0 * bend * side * gap, 0.0))
    share = where(start > 0.0, -2.0 * side * gap, outward - start)
    share = where(pull > 0.0, push, share) / where(
        pull > 0.0, push + pull, where(start > 0.0, start + outward, 2.0 * bend)
    )
    # A slider that begins at its stop and comes back has no such place: near the end, if anywhere.
    guess = where(share > 0.0, where(share < 1.0, share, 1.0), 1.0)
    impact = h * guess
    if smooth:
        impact = crossing_time(s, h, side, gap, guess, c.turning_time * per_h)
    # A slider turns before it ends beyond the other stop.
    time = where(side == 0.0, h + 1.0, impact)
    time = where(turn, c.turning_time, time)
    time = where(pull > 0.0, h * share, time)
    side = where(turn, 0.0, side)
    return Found(time, where(side == 0.0, where(c.crossing > 0.0, 1.0, -1.0), side), turn)


class Search(NamedTuple):
    """The search for an event: which slider, on which side, and a bracket of the time.

    ``gap_low`` and ``gap_high`` are what changes its sign there, at both ends: a pull, or speeds of a turn.
    Of a release ``side`` tells on which side the last trial step ended.
    """

    target: Any
    side: Any
    low: Any
    high: Any
    gap_low: Any
    gap_high: Any
    tries: Any


class Trial(NamedTuple):
    """A trial step of a lane that was due: its phase, length, the time left, and whether it is accurate."""

    due: Any
    phase: Any
    h: Any
    left: Any
    good: Any


class Outcome(NamedTuple):
    """What follows from a trial step.

    Attributes
    ----------
    accepted : it has no event
    there : it ends at the event that was looked for
    again : another trial step from the same start, of phase ``phase`` and length ``h``
    search : the search that goes on
    positions : of the sliders, at their stops if they have come there
    slide : the time of a Taylor step to the stop
    cleared : sliders that are known to turn before their stops
    """

    accepted: Any
    there: Any
    again: Any
    phase: Any
    h: Any
    search: Search
    positions: list[Any]
    slide: Any
    cleared: list[Any]


def pick(chosen: Sequence[Any], values: Sequence[Any]) -> Any:
    """The value of the slider that is chosen; the first one's if none of the others is."""
    value = values[0]
    for is_chosen, other in zip(chosen[1:], values[1:], strict=True):
        value = where(is_chosen, other, value)
    return value


def arrived(s: Slider, position: Any, close: Any, sought: Any, limit: Any) -> Any:
    """Where a free slider is at an event: at its stop exactly, if it comes there in no time or is beyond."""
    near = close + ARRIVAL_TIME * abs(s.velocity)
    up = (position > s.upper) | ((position >= s.upper - near) & (s.velocity > 0.0))
    down = (position < s.lower) | ((position <= s.lower + near) & (-s.velocity > 0.0))
    return where(sought, limit, where(up, s.upper, where(down, s.lower, position)))


def after_trial(
    trial: Trial, search: Search, sliders: Sequence[Slider], contacts: Sequence[Contact], unseen: Unseen,
    smooth: bool,
) -> Outcome:  # fmt: skip
    """After a trial step: its earliest event, how to come nearer to the one looked for, or its end."""
    due, phase, h, left, good = trial
    target, side, low, high, gap_low, gap_high, tries = search
    tried = due & good & ((phase == Phase.RUN) | (phase == Phase.RUN_PAST_TURN))
    per_h = 1.0 / h
    found = [first_event(s, c, h, per_h, smooth) for s, c in zip(sliders, contacts, strict=True)]
    close = [closeness(s.start_position, s.lower, s.upper) for s in sliders]
    pulls = [s.active_stop * c.force for s, c in zip(sliders, contacts, strict=True)]
    pulls_from = [s.active_stop * c.start_force for s, c in zip(sliders, contacts, strict=True)]
    free = [s.free for s in sliders]

    # A slider that may come to its stop and leave it, or be pulled though not at the end, is followed in
    # half the step, until no such motion is possible or it would be lost in rounding.
    unclear = [
        where(
            s.free,
            c.crossing == Crossing.UNCLEAR,
            logical_not(pull > 0.0) & (most_pull(s, unseen) * c.mobility * (h * h) > near),
        )
        for s, c, pull, near in zip(sliders, contacts, pulls, close, strict=True)
    ]
    halve = tried & any_of(unclear)

    # A tried step: its first event, if it has one.
    at, first = found[0].time, [None]
    for k in range(1, len(found)):
        sooner_yet = found[k].time < at
        first = [None, *(f & logical_not(sooner_yet) for f in first[1:]), sooner_yet]
        at = where(sooner_yet, found[k].time, at)
    hit = tried & logical_not(halve) & (at <= h)
    first_turns = pick(first, [f.turn for f in found]) & pick(first, free)

    # The slider whose event is looked for, and the other ones.
    is_target = [target == k for k in range(len(sliders))]
    q = pick(is_target, [s.position for s in sliders])
    v = pick(is_target, [s.velocity for s in sliders])
    is_free = pick(is_target, [s.active_stop for s in sliders]) == 0.0
    near_stop = pick(is_target, close)
    limit = where(
        side > 0.0, pick(is_target, [s.upper for s in sliders]), pick(is_target, [s.lower for s in sliders])
    )
    gap = where(is_free, side * (q - limit), pick(is_target, pulls))
    sides = [side_beyond(s.position, s.active_stop, s.lower, s.upper) for s in sliders]
    late = []
    for k, s in enumerate(sliders):
        beyond = sides[k] * (s.position - where(sides[k] > 0.0, s.upper, s.lower))
        passed = found[k].turn | ((sides[k] != 0.0) & (beyond > close[k]))
        pulled = (pulls[k] > 0.0) & (h - low > ROUNDING * left)
        late.append(where(s.free, passed, pulled) & logical_not(is_target[k]))
    other: list[Any] = []
    for k in range(len(sliders)):
        other.append(late[k] & logical_not(any_of(late[:k])))
    other_turns = pick(other, [f.turn for f in found])

    # Towards an event: the other slider's, if that came before; else a smaller bracket.
    locating = due & (phase == Phase.FIND_EVENT)
    sooner = locating & any_of(late)
    over = gap > 0.0
    high_in = where(over, h, high)
    low_in = where(over, low, h)
    # An end that stays for the second time counts less (Anderson and Bjorck 1973).
    last_over = side > 0.0
    weight = 1.0 - gap / where(over, gap_high, gap_low)
    weight = where(weight > 0.0, weight, 0.5)
    pull_high = where(over, gap, where(last_over, gap_high, weight * gap_high))
    pull_low = where(over, where(last_over, weight * gap_low, gap_low), gap)
    narrow = high_in - low_in <= ROUNDING * left
    # The rest of the way to a stop, if it takes no time: a Taylor step.
    speed = side * v
    rest_of_way = where(speed > 0.0, -gap / speed, 1.0)
    within = (abs(rest_of_way) <= TAYLOR_TIME) & (rest_of_way <= left - h)
    # Released where the stop would pull, not just before.
    released = narrow | (gap * (h - low) <= RELEASE_SHARE * left * (gap - gap_low))
    near = where(is_free, (abs(gap) <= near_stop) | within | narrow, released & over)
    # Where a slider turns: the bracket of that.
    probing = due & (phase == Phase.FIND_TURN)
    outward = speed > 0.0
    low_turn = where(outward, h, low)
    high_turn = where(outward, high, h)
    fast_low = where(outward, speed, gap_low)
    fast_high = where(outward, gap_high, -speed)
    bend = side * pick(is_target, [s.watched.last for s in sliders])
    curved = 2.0 * speed * speed - gap * bend
    curved = where(curved > speed * speed, curved, 2.0 * speed * speed)
    # The next place by a chord of speeds, Halley's step, or a chord of holding forces: one division.
    share = where(probing, fast_low, where(is_free, -2.0 * gap * speed, pull_low))
    share = share / where(probing, fast_low + fast_high, where(is_free, curved, pull_low - pull_high))
    turn = low_turn + (high_turn - low_turn) * share
    middle = 0.5 * (low_in + high_in)
    towards = where(speed > 0.0, h + share, middle)
    chord = low_in + (high_in - low_in) * share + PUSH_ON * left
    nearer = where(is_free, towards, chord)
    nearer = where(tries < MOST_GUESSES, nearer, middle)
    nearer = where(nearer > low_in, where(nearer < high_in, nearer, middle), middle)
    nearer = where(logical_not(is_free) & narrow, high_in, nearer)
    there = locating & logical_not(sooner) & near
    slide = where(there & is_free & within, rest_of_way, 0.0)
    closer = locating & logical_not(sooner) & logical_not(near)

    # Where a slider turns: beyond its stop, or not.
    turns_beyond = probing & (gap > near_stop)
    turn = where(turn > low_turn, where(turn < high_turn, turn, low_turn), 0.5 * (low_turn + high_turn))
    at_turn = (abs(speed * (turn - h)) <= near_stop) | (tries >= MOST_TURN_GUESSES)
    missed = probing & logical_not(turns_beyond) & at_turn
    searching = probing & logical_not(turns_beyond) & logical_not(missed)

    again = hit | closer | sooner | probing | halve
    turning = where(hit, first_turns, sooner & other_turns)
    phase_next = cases(
        (searching, Phase.FIND_TURN), (halve, phase), (turning, Phase.FIND_TURN),
        (missed, Phase.RUN_PAST_TURN), default=Phase.FIND_EVENT,
    )  # fmt: skip
    times = [f.time for f in found]
    guess = where(pick(other, free), pick(other, times), 0.5 * h)
    guess = where(guess < h, guess, 0.5 * h)  # never the same step again
    h_next = cases(
        (searching, turn), (halve, 0.5 * h), (turns_beyond, pick(is_target, times)), (missed, left),
        (hit, minimum(maximum(at, 0.0), h)), (sooner, guess), default=nearer,
    )  # fmt: skip
    begins = hit | sooner | turns_beyond
    aim = [None, *(where(hit, f, o) for f, o in zip(first[1:], other[1:], strict=True))]
    start_speed = abs(pick(aim, [s.start_velocity for s in sliders]))
    low_gap = where(turning, start_speed, minimum(pick(aim, pulls_from), 0.0))
    high_gap = where(turning, abs(pick(aim, [s.velocity for s in sliders])), pick(aim, pulls))
    index = [float(k) for k in range(len(sliders))]
    sides_next = [where(f.turn, f.side, sides[k]) for k, f in enumerate(found)]
    goes_on = Search(
        target=cases((hit, pick(first, index)), (sooner, pick(other, index)), default=target),
        side=cases(
            (hit, pick(first, [f.side for f in found])), (sooner, pick(other, sides_next)), (is_free, side),
            default=where(over, 1.0, -1.0),
        ),
        low=cases((begins, 0.0), (closer, low_in), (searching, low_turn), default=low),
        high=cases((begins, h), (closer, high_in), (searching, high_turn), default=high),
        gap_low=cases((begins, low_gap), (closer, pull_low), (searching, fast_low), default=gap_low),
        gap_high=cases((begins, high_gap), (closer, pull_high), (searching, fast_high), default=gap_high),
        tries=where(begins, 0.0, tries + where(locating | probing, 1.0, 0.0)),
    )  # fmt: skip
    positions = []
    for k, s in enumerate(sliders):
        moved = s.position + slide * s.velocity
        at_event = arrived(s, moved, close[k], is_target[k], limit)
        positions.append(where(there & s.free, at_event, moved))
    return Outcome(
        accepted=tried & logical_not(hit) & logical_not(halve),
        there=there, again=again, phase=phase_next, h=h_next, search=goes_on, positions=positions,
        slide=slide,
        cleared=[c.cleared | (missed & t) for c, t in zip(contacts, is_target, strict=True)],
    )  # fmt: skip
