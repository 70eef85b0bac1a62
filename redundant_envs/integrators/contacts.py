"""What becomes of sliders at their stops when nothing else moves: struck, let go, at rest.

With accelerations, holding forces and mobilities at hand. What holds is 1.0, what does not 0.0;
sliders are a and b, sides 1 at the upper stop, -1 at the lower one, 0 at none; phases as in stops.py.
"""

from __future__ import annotations

from redundant_envs.algebra import maximum, minimum, physics, sqrt, where
from redundant_envs.integrators.stops import at_stop, either, equal, no, positive


@physics
def impulses(ua, ub, sa, sb, waa, wab, wbb, e):
    """Impulses at the stops: u+ = -e u where it moved out, u+ <= 0 else, and no stop pulls.

    u are outward speeds, s the sides of the stops that the sliders touch. The 2 x 2 problem has
    one answer, since the mobility w is positive definite: of the sets of struck stops the one that
    fits.
    """
    det = waa * wbb - wab * wab
    wab = sa * sb * wab
    at_a = abs(sa)
    at_b = abs(sb)
    da = ua + e * maximum(ua, 0.0)
    db = ub + e * maximum(ub, 0.0)
    only_a = da * (1.0 / waa)
    only_b = db * (1.0 / wbb)
    fits_a = at_a * where(only_a >= 0.0, 1.0, 0.0) * where(at_b * (db - wab * only_a) <= 0.0, 1.0, 0.0)
    fits_b = at_b * where(only_b >= 0.0, 1.0, 0.0) * where(at_a * (da - wab * only_b) <= 0.0, 1.0, 0.0)
    pa = where(fits_a > 0.0, only_a, where(fits_b > 0.0, 0.0, (wbb * da - wab * db) * (1.0 / det)))
    pb = where(fits_a > 0.0, 0.0, where(fits_b > 0.0, only_b, (waa * db - wab * da) * (1.0 / det)))
    return pa, pb


@physics
def collapses(ua, ub, sa, sb, waa, wab, wbb, e):
    """Whether two sliders at their stops, of which one moves out, strike by turns for ever, and so stop.

    Each impact sends the other slider back to its stop, in no time. In units of sqrt(mobility) two
    impacts take the outward speeds (x, y) to ((k^2 - e) x + k y, -e k x - e y), where k = p / sqrt(waa wbb)
    is 1 + e times what one is pushed by the other. They end by themselves if that map has no real
    eigenvalues, or if y is below the eigenvector of the greater one.
    """
    p = -(1.0 + e) * sa * sb * wab
    square = p * p - 4.0 * e * waa * wbb
    slope = p + sqrt(maximum(square, 0.0))
    lasting = where(ua > 0.0, 2.0 * waa * ub + slope * ua, 2.0 * wbb * ua + slope * ub)
    return where(minimum(minimum(p, square), lasting) >= 0.0, where(p > 0.0, 1.0, 0.0), 0.0)


@physics
def negligible(u):
    return where(u > 0.0, where(u <= 1e-13, 1.0, 0.0), 0.0)


@physics
def halting(va, vb, still_a, still_b, waa, wab, wbb):
    """Impulses that stop slider a, b or both; 0 for one that need not stand still."""
    det = waa * wbb - wab * wab
    both = still_a * still_b
    ja = where(both > 0.0, (wab * vb - wbb * va) * (1.0 / det), where(still_a > 0.0, -va * (1.0 / waa), 0.0))
    jb = where(both > 0.0, (wab * va - waa * vb) * (1.0 / det), where(still_b > 0.0, -vb * (1.0 / wbb), 0.0))
    return ja, jb


@physics
def pressed(fa, fb, waa, wab, wbb):
    """Which of two sliders at rest at their stops are pressed onto them, given the outward
    accelerations that they would have free: the one set in which no stop pulls and none is entered."""
    pa = wbb * fa - wab * fb
    pb = waa * fb - wab * fa
    both = where(pa >= 0.0, where(pb >= 0.0, 1.0, 0.0), 0.0)
    one_a = where(fa > 0.0, where(pb <= 0.0, 1.0, 0.0), 0.0)
    one_b = where(fb > 0.0, where(pa <= 0.0, 1.0, 0.0), 0.0)
    some = positive(maximum(fa, fb))
    return some * either(both, one_a), some * either(both, no(one_a) * one_b)


@physics(gives="leaves_a leaves_b")
def leaving(mode_a, mode_b, hold_a, hold_b, at_a, at_b, waa, wab, wbb):
    """Sliders at rest that their stops would have to pull, if the other one rests too or is at no stop."""
    pulled_a = positive(mode_a * hold_a)
    pulled_b = positive(mode_b * hold_b)
    fa = -mode_a * (waa * hold_a + wab * hold_b)
    fb = -mode_b * (wab * hold_a + wbb * hold_b)
    stays_a, stays_b = pressed(fa, fb, waa, mode_a * mode_b * wab, wbb)
    two = abs(mode_a) * abs(mode_b) * either(pulled_a, pulled_b)
    leaves_a = where(two > 0.0, no(stays_a), pulled_a * equal(at_b, 0.0))
    leaves_b = where(two > 0.0, no(stays_b), pulled_b * equal(at_a, 0.0))
    return leaves_a, leaves_b


@physics
def would_rest(side, u, press, mode, let_go, e, limit):
    """Whether a slider at a stop, pressed onto it, bounces less than 1e-9 m; an elastic one rests
    only if its bounce is lost in rounding."""
    height = where(e < 1.0, 1e-9, 8.881784197001252e-16 * maximum(abs(limit), 1.0))
    low = where(u * u <= 2.0 * press * height, 1.0, 0.0)
    new = equal(mode, 0.0) * no(equal(side, 0.0)) * no(let_go)
    return positive(press) * low * where(u <= 0.0, 1.0, 0.0) * new


@physics(
    gives="touches over_budget strikes going_on impulse_a impulse_b struck_a struck_b mode_a_new mode_b_new "
    "events_new changes_new phase_new holds_a holds_b let_go_a_new let_go_b_new "
    "told_now_a told_now_b told_speed_now_a told_speed_now_b"
)
def touch(
    phase, changes, events, place_a, place_b, rate_a, rate_b, mode_a, mode_b,
    lower_a, lower_b, upper_a, upper_b, restitution, let_go_a, let_go_b,
    accel_a, accel_b, hold_a, hold_b, waa, wab, wbb,
):  # fmt: skip
    """With accelerations, holding forces and mobilities at hand: strike, let go, rest, or go on."""
    on = equal(phase, 1.0)
    sa = at_stop(place_a, mode_a, lower_a, upper_a)
    sb = at_stop(place_b, mode_b, lower_b, upper_b)
    # 1e-13 m/s into a stop is rounding: taken away, not struck back and forth.
    still_a = negligible(sa * rate_a)
    still_b = negligible(sb * rate_b)
    rate_a = where(still_a > 0.0, 0.0, rate_a)
    rate_b = where(still_b > 0.0, 0.0, rate_b)
    ua = sa * rate_a
    ub = sb * rate_b
    spent = either(where(changes >= 512.0, 1.0, 0.0), where(events > 256.0, 1.0, 0.0))
    strikes = either(positive(ua), positive(ub))
    # One that moves away from its stop is no longer supported by it, however near it is: should an impact
    # of the other send it back, it is struck next.
    supported_a = either(abs(mode_a), positive(ua))
    supported_b = either(abs(mode_b), positive(ub))
    pa, pb = impulses(ua, ub, sa * supported_a, sb * supported_b, waa, wab, wbb, restitution)
    by_turns = abs(sa * sb) * equal(mode_a, 0.0) * equal(mode_b, 0.0) * no(supported_a * supported_b)
    stop_both = strikes * by_turns * collapses(ua, ub, sa, sb, waa, wab, wbb, restitution)
    hit_a = strikes * positive(pa)
    hit_b = strikes * positive(pb)
    free_a = no(strikes) * positive(mode_a * hold_a)  # the stop would have to pull
    free_b = no(strikes) * positive(mode_b * hold_b)
    limit_a = where(sa > 0.0, upper_a, lower_a)
    limit_b = where(sb > 0.0, upper_b, lower_b)
    calm = no(strikes) * no(free_a) * no(free_b)
    rest_a = calm * would_rest(sa, ua, sa * accel_a, mode_a, let_go_a, restitution, limit_a)
    rest_b = calm * would_rest(sb, ub, sb * accel_b, mode_b, let_go_b, restitution, limit_b)
    # What one does changes the force on the other, so of two both are decided at once.
    force_a = where(mode_a == 0.0, 0.0, hold_a)
    force_b = where(mode_b == 0.0, 0.0, hold_b)
    fa = sa * (accel_a - waa * force_a - wab * force_b)
    fb = sb * (accel_b - wab * force_a - wbb * force_b)
    may_a = either(
        abs(mode_a), would_rest(sa, ua, maximum(fa, sa * accel_a), mode_a, let_go_a, restitution, limit_a)
    )
    may_b = either(
        abs(mode_b), would_rest(sb, ub, maximum(fb, sb * accel_b), mode_b, let_go_b, restitution, limit_b)
    )
    stays_a, stays_b = pressed(fa, fb, waa, sa * sb * wab, wbb)
    changes_two = may_a * may_b * either(either(free_a, free_b), either(rest_a, rest_b))
    free_a = where(changes_two > 0.0, abs(mode_a) * no(stays_a), free_a)
    free_b = where(changes_two > 0.0, abs(mode_b) * no(stays_b), free_b)
    rest_a = where(changes_two > 0.0, equal(mode_a, 0.0) * stays_a, rest_a)
    rest_b = where(changes_two > 0.0, equal(mode_b, 0.0) * stays_b, rest_b)
    # The impulses along the sliders, and the rates they have then. One that comes to rest must not
    # set off the other, if that rests or comes to rest too.
    rests = either(rest_a, rest_b)
    stop_a = either(stop_both, either(rest_a, rests * abs(mode_a) * no(free_a)))
    stop_b = either(stop_both, either(rest_b, rests * abs(mode_b) * no(free_b)))
    halt_a, halt_b = halting(rate_a, rate_b, stop_a, stop_b, waa, wab, wbb)
    # A second look is for one at its stop that has lost, or gained, the support of the other, and for an
    # arm that was moved when a bounce was taken away.
    changed = either(either(free_a, free_b), either(rest_a, rest_b))
    waits_a = abs(sa) * equal(mode_a, 0.0) * no(rest_a) * no(let_go_a)
    waits_b = abs(sb) * equal(mode_b, 0.0) * no(rest_b) * no(let_go_b)
    moved = either(positive(abs(halt_a)), positive(abs(halt_b)))
    going = no(strikes) * no(changed * either(moved, either(waits_a, waits_b)))
    struck = strikes * no(stop_both)
    ja = where(struck > 0.0, -sa * pa, halt_a)
    jb = where(struck > 0.0, -sb * pb, halt_b)
    va = rate_a + ja * waa + jb * wab
    vb = rate_b + ja * wab + jb * wbb
    va = where(stop_a > 0.0, 0.0, where(hit_a > 0.0, -sa * restitution * maximum(ua, 0.0), va))
    vb = where(stop_b > 0.0, 0.0, where(hit_b > 0.0, -sb * restitution * maximum(ub, 0.0), vb))
    mode_a_new = where(
        rest_a > 0.0, sa, where(either(free_a, strikes * positive(-sa * va)) > 0.0, 0.0, mode_a)
    )
    mode_b_new = where(
        rest_b > 0.0, sb, where(either(free_b, strikes * positive(-sb * vb)) > 0.0, 0.0, mode_b)
    )
    # What stops a speed stops an acceleration: the forces that hold from now on.
    holds_a, holds_b = halting(sa * fa, sb * fb, abs(mode_a_new), abs(mode_b_new), waa, wab, wbb)
    impact_a = hit_a * positive(ua)
    impact_b = hit_b * positive(ub)
    thrown_a = strikes * abs(mode_a) * equal(mode_a_new, 0.0)  # off its stop, by the other's impact
    thrown_b = strikes * abs(mode_b) * equal(mode_b_new, 0.0)
    acts = on * no(spent)
    return (
        on,
        on * spent,
        acts * either(either(strikes, rests), either(still_a, still_b)),
        acts * going,
        ja,
        jb,
        va,
        vb,
        where(acts > 0.0, mode_a_new, mode_a),
        where(acts > 0.0, mode_b_new, mode_b),
        events + acts * (impact_a + impact_b),
        changes + on,
        where(on * spent > 0.0, 6.0, where(acts * going > 0.0, 2.0, phase)),
        holds_a,
        holds_b,
        where(acts > 0.0, either(free_a, let_go_a) * no(going), let_go_a),
        where(acts > 0.0, either(free_b, let_go_b) * no(going), let_go_b),
        # Of the event of each slider: 1 and 2 impacts at the upper and lower stop, 3 rest, 4 let go.
        acts * (impact_a * where(sa > 0.0, 1.0, 2.0) + 3.0 * rest_a + 4.0 * (free_a + thrown_a)),
        acts * (impact_b * where(sb > 0.0, 1.0, 2.0) + 3.0 * rest_b + 4.0 * (free_b + thrown_b)),
        where(acts * impact_a > 0.0, ua, 0.0),
        where(acts * impact_b > 0.0, ub, 0.0),
    )
