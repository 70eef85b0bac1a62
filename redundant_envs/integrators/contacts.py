"""Contact resolution: impact, release and sticking of sliders at their stops, when nothing else moves.

Accelerations, forces of stops and mobilities are at hand. Sides are 1 at the upper stop, -1 at the lower
one, 0 at none. One slider or two are resolved by formulas; of more, the set of stops that act is looked for.
"""

from __future__ import annotations

import enum
import itertools
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from redundant_envs.algebra import all_of, any_of, cases, logical_not, maximum, minimum, sqrt, where
from redundant_envs.integrators.events import ROUNDING, Phase, side_touched

Matrix = Sequence[Sequence[Any]]

MOST_IMPACTS = 256
"""Of an interval; with more it is given up."""
MOST_CHANGES = 512
"""Times that contacts are resolved in an interval; with more it is given up."""
NEGLIGIBLE_SPEED = 1e-13
"""m/s into a stop that are rounding: taken away, not struck back and forth."""
LOWEST_BOUNCE = 1e-9
"""m; a slider that would bounce less comes to rest."""


class Event(enum.IntEnum):
    """What happened to a slider at a stop."""

    NONE = 0
    UPPER_IMPACT = 1
    LOWER_IMPACT = 2
    REST = 3
    RELEASE = 4


class Contact(NamedTuple):
    """A slider, near a stop or not.

    Attributes
    ----------
    position, velocity : m, m/s
    active_stop : side of the stop it rests at
    lower, upper : its stops, m
    acceleration : m/s^2
    force : that its stop exerts along it, N
    released : whether it has just left its stop and is not to rest again before it moves
    """

    position: Any
    velocity: Any
    active_stop: Any
    lower: Any
    upper: Any
    acceleration: Any
    force: Any
    released: Any

    @property
    def free(self) -> Any:
        return self.active_stop == 0.0

    @property
    def resting(self) -> Any:
        return self.active_stop != 0.0

    @property
    def side(self) -> Any:
        """Side of the stop that it touches."""
        return side_touched(self.position, self.active_stop, self.lower, self.upper)


class Resolved(NamedTuple):
    """What becomes of the contacts of a lane.

    Attributes
    ----------
    given_up : more impacts or changes than an interval may have
    strikes : impulses act
    going_on : the motion goes on
    impulses : along the sliders, N s
    velocities, active_stops, forces, released : of the sliders, after it
    happened, speeds : the :class:`Event` of each slider, and its speed into the stop, m/s
    impacts : their number
    """

    given_up: Any
    strikes: Any
    going_on: Any
    impulses: list[Any]
    velocities: list[Any]
    active_stops: list[Any]
    forces: list[Any]
    released: list[Any]
    happened: list[Any]
    speeds: list[Any]
    impacts: Any


def _solved(w: Matrix, b: Sequence[Any], unsigned: Matrix | None = None) -> list[Any]:
    """x of w x = b, w symmetric and positive definite: by elimination without pivoting.

    ``unsigned`` is the same but for the signs of two rows and columns, and has the same determinant.
    """
    if len(b) == 1:
        return [b[0] * (1.0 / w[0][0])]
    if len(b) == 2:
        m = w if unsigned is None else unsigned
        per_det = 1.0 / (m[0][0] * m[1][1] - m[0][1] * m[0][1])
        first = (w[1][1] * b[0] - w[0][1] * b[1]) * per_det
        return [first, (w[0][0] * b[1] - w[0][1] * b[0]) * per_det]
    share = [row[0] * (1.0 / w[0][0]) for row in w]
    rest = [[w[i][j] - share[i] * w[0][j] for j in range(1, len(b))] for i in range(1, len(b))]
    x = _solved(rest, [b[i] - share[i] * b[0] for i in range(1, len(b))])
    return [(b[0] - _dot(w[0][1:], x)) * (1.0 / w[0][0]), *x]


def _dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    terms = [x * y for x, y in zip(a, b, strict=True)]
    return sum(terms[1:], terms[0])


def _sets(count: int) -> Iterator[tuple[int, ...]]:
    """Sets of sliders that are not all of them, the smaller ones first."""
    for size in range(1, count):
        yield from itertools.combinations(range(count), size)


def _part(w: Matrix, chosen: Sequence[int]) -> list[list[Any]]:
    return [[w[i][j] for j in chosen] for i in chosen]


def _signed(w: Matrix, sides: Sequence[Any]) -> list[list[Any]]:
    """Mobilities of outward directions."""
    n = range(len(sides))
    return [[w[i][i] if i == j else sides[min(i, j)] * sides[max(i, j)] * w[i][j] for j in n] for i in n]


def impulses(speeds: Sequence[Any], sides: Sequence[Any], w: Matrix, restitution: Any) -> list[Any]:
    """Impulses at the stops: u+ = -e u where it moved out, u+ <= 0 else, and no stop pulls.

    ``speeds`` are outward, ``sides`` of the stops that the sliders touch. The problem has one answer, since
    the mobility w is positive definite: of the sets of struck stops the one that fits.
    """
    count = len(speeds)
    outward = _signed(w, sides)
    at = [s != 0.0 for s in sides]
    d = [u + restitution * maximum(u, 0.0) for u in speeds]
    result = _solved(outward, d, w)
    choices = []
    for chosen in _sets(count):
        p = _solved(_part(outward, chosen), [d[i] for i in chosen])
        good = [at[i] & (p[k] >= 0.0) for k, i in enumerate(chosen)]
        for j in range(count):
            if j not in chosen:
                left = d[j]
                for k, i in enumerate(chosen):
                    left = left - outward[j][i] * p[k]
                good.append(logical_not(at[j]) | (left <= 0.0))
        full = [0.0] * count
        for k, i in enumerate(chosen):
            full[i] = p[k]
        choices.append((all_of(good), full))
    return [cases(*((good, full[i]) for good, full in choices), default=result[i]) for i in range(count)]


def collapses(speeds: Sequence[Any], sides: Sequence[Any], w: Matrix, restitution: Any) -> Any:
    """Whether two sliders at their stops, of which one moves out, strike by turns for ever, and so stop.

    Each impact sends the other slider back to its stop, in no time. In units of sqrt(mobility) two
    impacts take the outward speeds (x, y) to ((k^2 - e) x + k y, -e k x - e y), where k = p / sqrt(waa wbb)
    is 1 + e times what one is pushed by the other. They end by themselves if that map has no real
    eigenvalues, or if y is below the eigenvector of the greater one.
    """
    (ua, ub), (sa, sb) = speeds, sides  # of two sliders; more are left to the limit of impacts
    p = -(1.0 + restitution) * sa * sb * w[0][1]
    square = p * p - 4.0 * restitution * w[0][0] * w[1][1]
    slope = p + sqrt(maximum(square, 0.0))
    lasting = where(ua > 0.0, 2.0 * w[0][0] * ub + slope * ua, 2.0 * w[1][1] * ua + slope * ub)
    return (minimum(minimum(p, square), lasting) >= 0.0) & (p > 0.0)


def halting(velocities: Sequence[Any], still: Sequence[Any], w: Matrix) -> list[Any]:
    """Impulses that stop some sliders; 0 for one that need not stand still."""
    count = len(velocities)
    negative = [-v for v in velocities]
    if count == 2:
        (va, vb), per_det = velocities, 1.0 / (w[0][0] * w[1][1] - w[0][1] * w[0][1])
        both = still[0] & still[1]
        alone = [
            where(s, n * (1.0 / w[k][k]), 0.0) for k, (s, n) in enumerate(zip(still, negative, strict=True))
        ]
        return [
            where(both, (w[0][1] * vb - w[1][1] * va) * per_det, alone[0]),
            where(both, (w[0][1] * va - w[0][0] * vb) * per_det, alone[1]),
        ]
    result: list[Any] = [0.0] * count
    for chosen in (*_sets(count), tuple(range(count))):
        p = _solved(_part(w, chosen), [negative[i] for i in chosen])
        these = all_of(still[i] if i in chosen else logical_not(still[i]) for i in range(count))
        for k, i in enumerate(chosen):
            result[i] = where(these, p[k], result[i])
    return result


def pressed(accelerations: Sequence[Any], w: Matrix) -> list[Any]:
    """Which of the sliders at rest at their stops are pressed onto them, given the outward accelerations that
    they would have free: the one set in which no stop pulls and none is entered."""
    count = len(accelerations)
    if count == 1:
        return [accelerations[0] > 0.0]
    if count == 2:
        fa, fb = accelerations
        pa = w[1][1] * fa - w[0][1] * fb
        pb = w[0][0] * fb - w[0][1] * fa
        both = (pa >= 0.0) & (pb >= 0.0)
        one_a = (fa > 0.0) & (pb <= 0.0)
        one_b = (fb > 0.0) & (pa <= 0.0)
        some = maximum(fa, fb) > 0.0
        return [some & (both | one_a), some & (both | (logical_not(one_a) & one_b))]
    settled: Any = all_of(f <= 0.0 for f in accelerations)
    result: list[Any] = [False] * count
    for chosen in (*_sets(count), tuple(range(count))):
        p = _solved(_part(w, chosen), [accelerations[i] for i in chosen])
        good = [p_k >= 0.0 for p_k in p]
        good += [
            accelerations[j] - _dot([w[j][i] for i in chosen], p) <= 0.0
            for j in range(count)
            if j not in chosen
        ]
        these = logical_not(settled) & all_of(good)
        result = [r | these if i in chosen else r for i, r in enumerate(result)]
        settled = settled | these
    return result


def leaving(contacts: Sequence[Contact], w: Matrix) -> list[Any]:
    """Sliders at rest that their stops would have to pull, if every other one rests too or is at no stop."""
    modes = [c.active_stop for c in contacts]
    pulled = [c.active_stop * c.force > 0.0 for c in contacts]
    free = []
    for i in range(len(contacts)):
        total = w[i][0] * contacts[0].force
        for j in range(1, len(contacts)):
            total = total + w[i][j] * contacts[j].force
        free.append(-modes[i] * total)
    stays = pressed(free, _signed(w, modes))
    all_rest = all_of(c.resting for c in contacts) & any_of(pulled)
    result = []
    for i in range(len(contacts)):
        alone = pulled[i] & all_of(o.side == 0.0 for j, o in enumerate(contacts) if j != i)
        result.append(where(all_rest, logical_not(stays[i]), alone))
    return result


def would_rest(c: Contact, speed: Any, press: Any, restitution: Any) -> Any:
    """Whether a slider at a stop, pressed onto it, bounces less than 1e-9 m; an elastic one rests
    only if its bounce is lost in rounding."""
    limit = where(c.side > 0.0, c.upper, c.lower)
    height = where(restitution < 1.0, LOWEST_BOUNCE, ROUNDING * maximum(abs(limit), 1.0))
    low = (speed * speed <= 2.0 * press * height) & (speed <= 0.0)
    return (press > 0.0) & low & c.free & (c.side != 0.0) & logical_not(c.released)


def resolve_contacts(
    phase: Any, changes: Any, impacts: Any, contacts: Sequence[Contact], w: Matrix, restitution: Any
) -> Resolved:
    """Strike, release, rest, or go on."""
    count = range(len(contacts))
    on = phase == Phase.AT_STOP
    sides = [c.side for c in contacts]
    still = []
    for side, c in zip(sides, contacts, strict=True):
        out = side * c.velocity
        still.append((out > 0.0) & (out <= NEGLIGIBLE_SPEED))
    rates = [where(s, 0.0, c.velocity) for s, c in zip(still, contacts, strict=True)]
    speeds = [side * v for side, v in zip(sides, rates, strict=True)]
    spent = (changes >= MOST_CHANGES) | (impacts > MOST_IMPACTS)
    strikes = any_of(u > 0.0 for u in speeds)
    # A slider that moves away from its stop is no longer supported by it, however near it is: should an
    # impact of another send it back, it is struck next.
    supported = [c.resting | (u > 0.0) for c, u in zip(contacts, speeds, strict=True)]
    struck_sides = [where(s, side, 0.0) for s, side in zip(supported, sides, strict=True)]
    p = impulses(speeds, struck_sides, w, restitution)
    stop_all: Any = False
    if len(contacts) == 2:
        touching = [(side != 0.0) & c.free for side, c in zip(sides, contacts, strict=True)]
        by_turns = touching[0] & touching[1] & logical_not(supported[0] & supported[1])
        stop_all = strikes & by_turns & collapses(speeds, sides, w, restitution)
    hit = [strikes & (x > 0.0) for x in p]
    released = [logical_not(strikes) & (c.active_stop * c.force > 0.0) for c in contacts]
    calm = logical_not(strikes) & logical_not(any_of(released))
    rest = [
        calm & would_rest(c, u, side * c.acceleration, restitution)
        for c, u, side in zip(contacts, speeds, sides, strict=True)
    ]
    # What one does changes the force on the others, so those that may rest are decided at once.
    held = [where(c.free, 0.0, c.force) for c in contacts]
    free = []
    for i, c in enumerate(contacts):
        acceleration = c.acceleration
        for j in count:
            acceleration = acceleration - w[i][j] * held[j]
        free.append(sides[i] * acceleration)
    may = [
        c.resting | would_rest(c, u, maximum(f, side * c.acceleration), restitution)
        for c, u, side, f in zip(contacts, speeds, sides, free, strict=True)
    ]
    if len(contacts) > 1:
        if len(contacts) > 2:
            free_of_may = [where(m, f, -1e300) for m, f in zip(may, free, strict=True)]
            several = any_of(may[i] & may[j] for i, j in itertools.combinations(count, 2))
        else:
            free_of_may, several = free, may[0] & may[1]
        stays = pressed(free_of_may, _signed(w, sides))
        decide = several & (any_of(released) | any_of(rest))
        released = [
            where(decide & m, c.resting & logical_not(s), r)
            for m, c, s, r in zip(may, contacts, stays, released, strict=True)
        ]
        rest = [
            where(decide & m, c.free & s, r) for m, c, s, r in zip(may, contacts, stays, rest, strict=True)
        ]
    # The impulses along the sliders, and the rates they have then. One that comes to rest must not
    # set off another that rests or comes to rest too.
    rests = any_of(rest)
    stop = [
        stop_all | r | (rests & c.resting & logical_not(x))
        for r, c, x in zip(rest, contacts, released, strict=True)
    ]
    halts = halting(rates, stop, w)
    # A second look is for a slider at its stop that has lost, or gained, the support of another, and for
    # an arm that was moved when a bounce was taken away.
    changed = any_of(released) | any_of(rest)
    waits = any_of(
        (side != 0.0) & c.free & logical_not(r) & logical_not(c.released)
        for side, c, r in zip(sides, contacts, rest, strict=True)
    )
    moved = any_of(abs(h) > 0.0 for h in halts)
    going = logical_not(strikes) & logical_not(changed & (moved | waits))
    struck = strikes & logical_not(stop_all)
    pushes = [where(struck, -side * x, h) for side, x, h in zip(sides, p, halts, strict=True)]
    velocities, active = [], []
    for i, c in enumerate(contacts):
        v = rates[i]
        for k in count:
            v = v + pushes[k] * w[i][k]
        v = where(stop[i], 0.0, where(hit[i], -sides[i] * restitution * maximum(speeds[i], 0.0), v))
        velocities.append(v)
        off = released[i] | (strikes & (-sides[i] * v > 0.0))
        active.append(where(rest[i], sides[i], where(off, 0.0, c.active_stop)))
    # What stops a speed stops an acceleration: the forces that hold from now on.
    outward = [side * f for side, f in zip(sides, free, strict=True)]
    forces = halting(outward, [a != 0.0 for a in active], w)
    impact = [x & (u > 0.0) for x, u in zip(hit, speeds, strict=True)]
    thrown = [strikes & c.resting & (a == 0.0) for c, a in zip(contacts, active, strict=True)]
    acts = on & logical_not(spent)
    happened = [
        cases(
            (logical_not(acts), Event.NONE),
            (impact[i], where(sides[i] > 0.0, Event.UPPER_IMPACT, Event.LOWER_IMPACT)),
            (rest[i], Event.REST), (released[i] | thrown[i], Event.RELEASE), default=Event.NONE,
        )
        for i in count
    ]  # fmt: skip
    for i in count:
        impacts = impacts + where(acts & impact[i], 1.0, 0.0)
    return Resolved(
        given_up=on & spent,
        strikes=acts & (strikes | rests | any_of(still)),
        going_on=acts & going,
        impulses=pushes,
        velocities=velocities,
        active_stops=[where(acts, a, c.active_stop) for a, c in zip(active, contacts, strict=True)],
        forces=forces,
        released=[
            where(acts, (r | c.released) & logical_not(going), c.released)
            for r, c in zip(released, contacts, strict=True)
        ],
        happened=happened,
        speeds=[where(acts & x, u, 0.0) for x, u in zip(impact, speeds, strict=True)],
        impacts=impacts,
    )
