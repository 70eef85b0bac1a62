"""What becomes of a lane that meets a stop: one decision after every piece of its motion.

A piece is tried to the end of the planned step. If it meets a stop, pieces from the same start end
ever nearer to the event: an extension of the method's own order, no interpolation. The last 1e-9 s
to a stop are a Taylor step, exact to rounding: positions here, velocities when the accelerations
there are known. Then the arm is struck or held, and the motion goes on. All of it is arithmetic
without branches, for eight lanes at once; what holds is 1.0, what does not 0.0.

``phase`` of a lane: 0 none, 1 its contacts come next, 2 a piece to the end of the step, 3 to where
a slider turns, 4 to the end of the step though one turns near a stop, 5 towards an event, 6 complete.
Sliders are a and b; sides are 1 at the upper stop, -1 at the lower one, 0 at none.
"""

from __future__ import annotations

from redundant_envs.algebra import maximum, minimum, physics, sqrt, where


@physics
def equal(x, value):
    return where(x == value, 1.0, 0.0)


@physics
def positive(x):
    return where(x > 0.0, 1.0, 0.0)


@physics
def either(x, y):
    return maximum(x, y)


@physics
def no(x):
    return 1.0 - x


@physics
def pick(chosen, a, b):
    return where(chosen > 0.0, b, a)


@physics
def closeness(q, lower, upper):
    """Positions nearer than this to a stop are at it: four units in the last place, m, but never 0."""
    low = where(abs(lower) < 1e300, abs(lower), 0.0)
    high = where(abs(upper) < 1e300, abs(upper), 0.0)
    return 8.881784197001252e-16 * maximum(maximum(low, high), maximum(abs(q), 1e-280))


@physics
def beyond(q, mode, lower, upper):
    """Side of the stop that a slider is beyond."""
    return where(mode == 0.0, where(q > upper, 1.0, where(q < lower, -1.0, 0.0)), 0.0)


@physics
def at_stop(q, mode, lower, upper):
    """Side of the stop that a slider touches."""
    return where(mode == 0.0, where(q >= upper, 1.0, where(q <= lower, -1.0, 0.0)), mode)


@physics
def bounds(q0, least, most, first, last, unseen, unseen_end, lower, upper):
    """Bounds of an acceleration in a step, from its least and greatest value at the stages.

    ``unseen`` is what a parabola may add between the stages, in units of that range, and ``unseen_end``
    if its first or last value is the greatest. A slider that starts at its stop was struck or released
    there, so its first stage is an end of the range: nothing is added towards that stop.
    """
    down = where(least < minimum(first, last), unseen, unseen_end) * (most - least)
    up = where(most > maximum(first, last), unseen, unseen_end) * (most - least)
    return where(q0 > lower, least - down, least), where(q0 < upper, most + up, most)


@physics
def excursions(q0, v0, q1, v1, h, lo, hi, lower, upper):
    """Whether a slider whose acceleration stays in lo..hi may turn beyond its upper and lower stop
    between the ends of a step: it cannot if these are 0 or less.

    With q'' >= -A and A h^2 = p, q exceeds its ends by at most (p/2 - |q1 - q0|)^2 / (2 p), and not at
    all if p/2 < |q1 - q0|; with q'' <= B it stays below q0 + v0 h + B h^2 / 2, and if B < 0 it is at
    most v^2 / (2 |B|) above each end.
    """
    close = closeness(q0, lower, upper)
    top = upper + close
    bottom = lower - close
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


@physics
def starts_at_stop(q0, v0, mode, lower, upper):
    """Whether a free slider starts at a stop and does not move away from it."""
    up = where(q0 >= upper, where(v0 >= 0.0, 1.0, 0.0), 0.0)
    down = where(q0 <= lower, where(v0 <= 0.0, 1.0, 0.0), 0.0)
    return where(mode == 0.0, either(up, down), 0.0)


@physics
def leaves_stop(q0, v0, mode, lower, upper):
    """Whether a free slider starts at a stop and moves away from it: it does not come to rest there, however
    slow it is."""
    up = where(q0 >= upper, where(v0 < 0.0, 1.0, 0.0), 0.0)
    down = where(q0 <= lower, where(v0 > 0.0, 1.0, 0.0), 0.0)
    return where(mode == 0.0, either(up, down), 0.0)


@physics
def near(q0, q1, h, least, most, unseen, mode, lower, upper):
    """Whether a free slider may meet a stop in a step; 0 is certain. A cheap bound of ``excursions``: if
    q'' >= -A, q exceeds its ends by at most A h^2 / 8."""
    more = unseen * (most - least)
    eighth = 0.125 * h * h
    top = maximum(q0, q1) + eighth * maximum(more - least, 0.0)
    bottom = minimum(q0, q1) - eighth * maximum(most + more, 0.0)
    inside = where(top < upper, where(bottom > lower, 1.0, 0.0), 0.0)
    return where(mode == 0.0, 1.0 - inside, 0.0)


@physics
def pulled(mode, least, most, first, last, unseen, unseen_end):
    """How hard the stop of a resting slider may have to pull it at any time of a step; 0 if not at all."""
    share = where(most > maximum(first, last), unseen, unseen_end)
    return where(mode == 0.0, 0.0, maximum(most + share * (most - least), 0.0))


@physics
def nearer_root(low, high, s, per_slope, side, gap, s0, c2, c3, c4, c5):
    """A bracketed Newton step towards a zero of side (gap + s0 s + c2 s^2 + ... + c5 s^5).

    One over the slope is brought up to date by a Newton step of its own, without a division.
    """
    g = side * (gap + s * (s0 + s * (c2 + s * (c3 + s * (c4 + s * c5)))))
    slope = side * (s0 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * (5.0 * c5)))))
    per_slope = per_slope * (2.0 - slope * per_slope)
    low = where(g > 0.0, low, s)
    high = where(g > 0.0, s, high)
    new = s - g * per_slope
    middle = 0.5 * (low + high)
    new = where(slope > 0.0, where(new > low, where(new < high, new, middle), middle), middle)
    return low, high, new, per_slope


@physics
def crossing(q0, v0, q1, v1, a0, a1, h, side, gap, s, turned):
    """When the quintic through both ends of a piece goes beyond the stop, of which s is a guess.

    An inward motion has ``turned`` at that part of the piece. The acceleration at the end is that of
    the last stage. Three iterations find the zero as well as the quintic knows the event.
    """
    d = q1 - q0
    s0 = h * v0
    s1 = h * v1
    c2 = 0.5 * h * h * a0
    e2 = 0.5 * h * h * a1
    c3 = 10.0 * d - 6.0 * s0 - 4.0 * s1 - 3.0 * c2 + e2
    c4 = 8.0 * s0 + 7.0 * s1 + 3.0 * c2 - 2.0 * e2 - 15.0 * d
    c5 = 6.0 * d - 3.0 * (s0 + s1) - c2 + e2
    low = where(side * v0 < 0.0, where(v0 * v1 < 0.0, minimum(turned, 1.0), 0.0), 0.0)
    high = 1.0
    s = maximum(s, low)
    per_slope = 1.0 / (side * (s0 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * (5.0 * c5))))))
    low, high, s, per_slope = nearer_root(low, high, s, per_slope, side, gap, s0, c2, c3, c4, c5)
    low, high, s, per_slope = nearer_root(low, high, s, per_slope, side, gap, s0, c2, c3, c4, c5)
    low, high, s, per_slope = nearer_root(low, high, s, per_slope, side, gap, s0, c2, c3, c4, c5)
    return h * s


@physics
def first_event(
    q0, v0, q1, v1, a0, a1, h, per_h, smooth, mode, hold_from, hold, met, turns, lower, upper, cleared
):  # fmt: skip
    """After a tried piece: when a slider has an event, h + 1 for never; its side; whether it only
    turns near the stop. Where a piece ends is a parabola of its length unless that is ``smooth``."""
    side = beyond(q1, mode, lower, upper)
    gap = q0 - where(side > 0.0, upper, lower)
    pull = mode * hold
    push = maximum(-mode * hold_from, 0.0)
    peak = equal(abs(met), 2.0) * equal(cleared, 0.0) * equal(mode, 0.0)
    # Where the parabola through both ends meets the stop, or a chord of holding forces changes sign.
    start = side * h * v0
    bend = side * (q1 - q0) - start
    outward = sqrt(maximum(start * start - 4.0 * bend * side * gap, 0.0))
    share = where(start > 0.0, -2.0 * side * gap, outward - start)
    share = where(pull > 0.0, push, share) / where(
        pull > 0.0, push + pull, where(start > 0.0, start + outward, 2.0 * bend)
    )
    # One that begins at its stop and comes back has no such place: near the end, if anywhere.
    s = where(share > 0.0, where(share < 1.0, share, 1.0), 1.0)
    impact = where(smooth > 0.0, crossing(q0, v0, q1, v1, a0, a1, h, side, gap, s, turns * per_h), h * s)
    # A slider turns before it ends beyond the other stop.
    at = where(side == 0.0, h + 1.0, impact)
    at = where(peak > 0.0, turns, at)
    at = where(pull > 0.0, h * share, at)
    side = where(peak > 0.0, 0.0, side)
    return at, where(side == 0.0, where(met > 0.0, 1.0, -1.0), side), peak


@physics
def arrived(there, sought, limit, place, rate, mode, close, lower, upper):
    """Where a slider is at an event: at its stop exactly, if it comes there within 1e-14 s or is beyond."""
    near = close + 1e-14 * abs(rate)
    up = where(place > upper, 1.0, where(place >= upper - near, positive(rate), 0.0))
    down = where(place < lower, 1.0, where(place <= lower + near, positive(-rate), 0.0))
    at = where(sought > 0.0, limit, where(up > 0.0, upper, where(down > 0.0, lower, place)))
    return where(there * equal(mode, 0.0) > 0.0, at, place)


@physics(
    gives="accepted there again phase_next h_next_piece target_new side_new low_new high_new "
    "gap_low_new gap_high_new tries_new place_a_new place_b_new slide_new "
    "cleared_a_new cleared_b_new"
)
def decide(
    due, phase, h, left, good, smooth, least_a, least_b, most_a, most_b, unseen, unseen_end, waa, wbb,
    target, side, low, high, gap_low, gap_high, tries,
    place_a, place_b, rate_a, rate_b, place_a_from, place_b_from, rate_a_from, rate_b_from,
    accel_a_first, accel_b_first, accel_a_last, accel_b_last,
    mode_a, mode_b, met_a, met_b, turns_a, turns_b, lower_a, lower_b, upper_a, upper_b,
    hold_a, hold_b, hold_a_from, hold_b_from, cleared_a, cleared_b,
):  # fmt: skip
    """After a piece: its earliest event, how to come nearer to the one looked for, or its end."""
    tried = due * good * either(equal(phase, 2.0), equal(phase, 4.0))
    per_h = 1.0 / h
    at_a, side_a, peak_a = first_event(
        place_a_from, rate_a_from, place_a, rate_a, accel_a_first, accel_a_last, h, per_h, smooth,
        mode_a, hold_a_from, hold_a, met_a, turns_a, lower_a, upper_a, cleared_a,
    )  # fmt: skip
    at_b, side_b, peak_b = first_event(
        place_b_from, rate_b_from, place_b, rate_b, accel_b_first, accel_b_last, h, per_h, smooth,
        mode_b, hold_b_from, hold_b, met_b, turns_b, lower_b, upper_b, cleared_b,
    )  # fmt: skip
    close_a = closeness(place_a_from, lower_a, upper_a)
    close_b = closeness(place_b_from, lower_b, upper_b)

    # A slider that may come to its stop and leave it, or be pulled though not at the end, is followed in
    # half the piece, until no such motion is possible or it would be lost in rounding.
    most_pull_a = pulled(mode_a, least_a, most_a, accel_a_first, accel_a_last, unseen, unseen_end)
    most_pull_b = pulled(mode_b, least_b, most_b, accel_b_first, accel_b_last, unseen, unseen_end)
    unclear_a = where(most_pull_a * waa * (h * h) > close_a, 1.0, 0.0)
    unclear_b = where(most_pull_b * wbb * (h * h) > close_b, 1.0, 0.0)
    unclear_a = where(mode_a == 0.0, equal(met_a, 4.0), where(mode_a * hold_a > 0.0, 0.0, unclear_a))
    unclear_b = where(mode_b == 0.0, equal(met_b, 4.0), where(mode_b * hold_b > 0.0, 0.0, unclear_b))
    halve = tried * either(unclear_a, unclear_b)

    # A tried piece: its first event, if it has one.
    first = where(at_b < at_a, 1.0, 0.0)
    at = minimum(at_a, at_b)
    hit = tried * no(halve) * where(at <= h, 1.0, 0.0)
    held = pick(first, mode_a, mode_b)
    pull_from = pick(first, mode_a * hold_a_from, mode_b * hold_b_from)
    pull_there = pick(first, mode_a * hold_a, mode_b * hold_b)
    peak = pick(first, peak_a, peak_b) * equal(held, 0.0)

    # The slider whose event is looked for (b if target is 1), and the other one.
    q = pick(target, place_a, place_b)
    v = pick(target, rate_a, rate_b)
    mode = pick(target, mode_a, mode_b)
    close = pick(target, close_a, close_b)
    limit = where(side > 0.0, pick(target, upper_a, upper_b), pick(target, lower_a, lower_b))
    gap = where(mode == 0.0, side * (q - limit), pick(target, mode_a * hold_a, mode_b * hold_b))
    other = no(target)
    other_mode = pick(other, mode_a, mode_b)
    other_side = pick(
        other, beyond(place_a, mode_a, lower_a, upper_a), beyond(place_b, mode_b, lower_b, upper_b)
    )
    other_limit = where(other_side > 0.0, pick(other, upper_a, upper_b), pick(other, lower_a, lower_b))
    other_gap = where(other_side == 0.0, 0.0, other_side * (pick(other, place_a, place_b) - other_limit))
    other_pull = pick(other, mode_a * hold_a, mode_b * hold_b)
    other_peak = pick(other, peak_a, peak_b)
    other_late = where(
        other_mode == 0.0,
        either(other_peak, where(other_gap > pick(other, close_a, close_b), 1.0, 0.0)),
        positive(other_pull) * where(h - low > 8.881784197001252e-16 * left, 1.0, 0.0),
    )

    # Towards an event: the other slider's, if that came before; else a smaller bracket.
    locating = due * equal(phase, 5.0)
    sooner = locating * other_late
    over = positive(gap)
    high_in = where(over > 0.0, h, high)
    low_in = where(over > 0.0, low, h)
    # Of a release, side tells on which side the last piece ended. An end that stays for the second
    # time counts less (Anderson and Bjorck 1973).
    last_over = positive(side)
    weight = 1.0 - gap / where(over > 0.0, gap_high, gap_low)
    weight = where(weight > 0.0, weight, 0.5)
    pull_high = where(over > 0.0, gap, where(last_over > 0.0, gap_high, weight * gap_high))
    pull_low = where(over > 0.0, where(last_over > 0.0, weight * gap_low, gap_low), gap)
    narrow = where(high_in - low_in <= 8.881784197001252e-16 * left, 1.0, 0.0)
    # The rest of the way to a stop, if it takes no more than 1e-9 s: a Taylor step.
    speed = side * v
    rest_of_way = where(speed > 0.0, -gap / speed, 1.0)
    within = where(abs(rest_of_way) <= 1e-9, where(rest_of_way <= left - h, 1.0, 0.0), 0.0)
    near = where(
        mode == 0.0,
        either(either(where(abs(gap) <= close, 1.0, 0.0), within), narrow),
        # Let go where the stop would pull, not just before, to 1e-7 of the step: what it pulls until
        # then is lost in rounding.
        either(narrow, where(gap * (h - low) <= 1e-7 * left * (gap - gap_low), 1.0, 0.0)) * over,
    )
    # Where a slider turns: the bracket of that.
    probing = due * equal(phase, 3.0)
    outward = positive(speed)
    low_turn = where(outward > 0.0, h, low)
    high_turn = where(outward > 0.0, high, h)
    fast_low = where(outward > 0.0, speed, gap_low)
    fast_high = where(outward > 0.0, gap_high, -speed)
    bend = side * pick(target, accel_a_last, accel_b_last)
    curved = 2.0 * speed * speed - gap * bend
    curved = where(curved > speed * speed, curved, 2.0 * speed * speed)
    # The next place by a chord of speeds, Halley's step, or a chord of holding forces: one division.
    share = where(probing > 0.0, fast_low, where(mode == 0.0, -2.0 * gap * speed, pull_low))
    share = share / where(
        probing > 0.0, fast_low + fast_high, where(mode == 0.0, curved, pull_low - pull_high)
    )
    turn = low_turn + (high_turn - low_turn) * share
    middle = 0.5 * (low_in + high_in)
    towards = where(speed > 0.0, h + share, middle)
    chord = low_in + (high_in - low_in) * share + 5e-8 * left
    nearer = where(mode == 0.0, towards, chord)
    # From the tenth piece on the bracket is halved, so that every search ends.
    nearer = where(tries < 10.0, nearer, middle)
    nearer = where(nearer > low_in, where(nearer < high_in, nearer, middle), middle)
    nearer = where(no(equal(mode, 0.0)) * narrow > 0.0, high_in, nearer)
    there = locating * no(sooner) * near
    slide = there * equal(mode, 0.0) * where(within > 0.0, rest_of_way, 0.0)
    closer = locating * no(sooner) * no(near)

    # Where a slider turns: beyond its stop, or not.
    found = probing * where(gap > close, 1.0, 0.0)
    turn = where(turn > low_turn, where(turn < high_turn, turn, low_turn), 0.5 * (low_turn + high_turn))
    missed = (
        probing
        * no(found)
        * either(where(abs(speed * (turn - h)) <= close, 1.0, 0.0), where(tries >= 60.0, 1.0, 0.0))
    )
    searching = probing * no(found) * no(missed)

    again = hit + closer + sooner + probing + halve
    turning = where(hit > 0.0, peak, sooner * other_peak)
    phase_next = where(turning > 0.0, 3.0, where(missed > 0.0, 4.0, 5.0))
    phase_next = where(searching > 0.0, 3.0, where(halve > 0.0, phase, phase_next))
    guess = where(other_mode == 0.0, pick(other, at_a, at_b), 0.5 * h)
    guess = where(guess < h, guess, 0.5 * h)  # never the same piece again
    h_next = where(hit > 0.0, minimum(maximum(at, 0.0), h), where(sooner > 0.0, guess, nearer))
    h_next = where(found > 0.0, pick(target, at_a, at_b), where(missed > 0.0, left, h_next))
    h_next = where(searching > 0.0, turn, where(halve > 0.0, 0.5 * h, h_next))
    begins = either(hit, either(sooner, found))
    aimed_pull_low = where(hit > 0.0, pull_from, pick(other, mode_a * hold_a_from, mode_b * hold_b_from))
    aim = where(hit > 0.0, first, other)
    low_gap = where(turning > 0.0, abs(pick(aim, rate_a_from, rate_b_from)), minimum(aimed_pull_low, 0.0))
    high_gap = where(turning > 0.0, abs(pick(aim, rate_a, rate_b)), where(hit > 0.0, pull_there, other_pull))
    return (
        tried * no(hit) * no(halve),
        there,
        again,
        phase_next,
        h_next,
        where(hit > 0.0, first, where(sooner > 0.0, other, target)),
        where(
            hit > 0.0,
            pick(first, side_a, side_b),
            where(
                sooner > 0.0,
                where(other_peak > 0.0, pick(other, side_a, side_b), other_side),
                where(mode == 0.0, side, where(over > 0.0, 1.0, -1.0)),
            ),
        ),
        where(begins > 0.0, 0.0, where(closer > 0.0, low_in, where(searching > 0.0, low_turn, low))),
        where(begins > 0.0, h, where(closer > 0.0, high_in, where(searching > 0.0, high_turn, high))),
        where(
            begins > 0.0, low_gap, where(closer > 0.0, pull_low, where(searching > 0.0, fast_low, gap_low))
        ),
        where(
            begins > 0.0,
            high_gap,
            where(closer > 0.0, pull_high, where(searching > 0.0, fast_high, gap_high)),
        ),
        where(begins > 0.0, 0.0, tries + locating + probing),
        arrived(
            there, no(target), limit, place_a + slide * rate_a, rate_a, mode_a, close_a, lower_a, upper_a
        ),
        arrived(there, target, limit, place_b + slide * rate_b, rate_b, mode_b, close_b, lower_b, upper_b),
        slide,
        either(cleared_a, missed * no(target)),  # it turns before its stop in this piece
        either(cleared_b, missed * target),
    )
