"""Coordinates at their stops, from accelerations, forces of stops and mobilities: which are struck, which
come to rest, and which are released. Time does not advance."""

import enum
import itertools
import math
from collections.abc import Sequence
from functools import reduce
from operator import mul, sub
from typing import Any, NamedTuple

from redundant_envs.compiler.tracing.ways import branches
from redundant_envs.language.algebra import all_of, any_of, logical_not, maximum, minimum, sqrt, total, where
from redundant_envs.language.limits import ROUNDING
from redundant_envs.simulator.events.boundary import NEGLIGIBLE_SPEED, side_touched
from redundant_envs.simulator.events.complementarity import Matrix, halting, impulses, pressed

MAX_IMPACTS, MAX_WITH_LOW_BOUNCES = 256, 1024
"""Most impacts of an interval, and of one with bounces below 1e-9 m; with more it is given up."""
CHANGES_OF_IMPACT = 2
"""Most contact resolutions of an interval for each of these."""
LOWEST_BOUNCE, LOWEST_SHARE = 1e-9, 0.01
"""m; a coordinate that would bounce less high comes to rest, under a tolerance less than this share of it."""
AWAY = -1e300
"""m/s^2; the outward acceleration of a coordinate that is pressed onto no stop."""


class Happening(enum.IntEnum):
    """What happens to a coordinate where contacts are resolved."""

    NONE = 0
    UPPER_IMPACT = 1  # it strikes its upper stop
    LOWER_IMPACT = 2
    REST = 3  # it comes to rest at its stop
    RELEASE = 4  # it leaves the stop at which it rested


class Contact(NamedTuple):
    """A coordinate with a stop, near it or not."""

    position: Any  # m
    velocity: Any  # m/s
    active_stop: Any  # side of the stop it rests at
    lower: Any  # its stops, m
    upper: Any
    acceleration: Any  # m/s^2
    force: Any  # exerted by its stop along it, N
    released: Any  # whether it leaves its stop and must not come to rest there before it is struck
    restitution: Any = 0.0
    holds: bool = True  # whether its stop can hold it
    owner: str = ""  # of the boundary
    grip: Any = None  # limit of its friction at rest, N; given if friction decides which coordinates rest
    lowest: Any = LOWEST_BOUNCE  # if it would bounce less high it comes to rest, m

    @property
    def friction_with_stop(self) -> bool:
        """Whether friction decides which coordinates stay at rest."""
        return self.grip is not None

    @property
    def free(self) -> Any:
        """Whether it rests at no stop."""
        return self.active_stop == 0.0

    @property
    def resting(self) -> Any:
        """Whether it rests at a stop."""
        return self.active_stop != 0.0

    @property
    def side(self) -> Any:
        """Side of the stop that it touches."""
        return side_touched(self.position, self.velocity, self.active_stop, self.lower, self.upper)

    @property
    def speed(self) -> Any:
        """Its speed into this stop, m/s."""
        return self.side * self.velocity

    @property
    def pulled(self) -> Any:
        """Whether the stop at which it rests would have to pull it."""
        return self.active_stop * self.force > 0.0


class Resolved(NamedTuple):
    """The contacts of a lane, resolved once; lists have an entry for each coordinate."""

    strikes: Any  # whether impulses act
    going_on: Any  # whether the motion continues; otherwise contacts are resolved again
    impulses: list[Any]  # along the coordinates, N s
    velocities: list[Any]  # after it, m/s, as all that follows
    active_stops: list[Any]
    forces: list[Any]  # of the stops, N
    released: list[Any]
    happened: list[Any]  # the :class:`Happening`
    speeds: list[Any]  # into the stop, m/s
    impacts: Any  # their number
    left_out: Any  # time of the bounces that were left out, s
    others: Any  # whether another coordinate may come to its stop, or bounces there, in this time


def lowest_bounce(tolerance: Any) -> Any:
    """Height below which a bounce ends in rest under a tolerance, both m."""
    return minimum(LOWEST_BOUNCE, maximum(LOWEST_SHARE * tolerance, ROUNDING))


def impulses_of_impacts(contacts: Sequence[Contact], w: Matrix) -> tuple[list[Any], Any]:
    """Inward impulses of the stops, N s, once it is known which other coordinates they support; and whether
    coordinates would strike in turn for ever, and therefore stop. One that moves away from its stop, however
    near it is, is not supported: if an impact of another sends it back, it is struck next. One that stays
    there without a force is."""
    sides, speeds = [c.side for c in contacts], [c.speed for c in contacts]
    supported = [
        c.resting | (c.speed > 0.0) | ((c.speed == 0.0) & (c.side * c.acceleration >= 0.0)) for c in contacts
    ]
    supporting = [where(s, side, 0.0) for s, side in zip(supported, sides, strict=True)]
    p = impulses(speeds, supporting, w, [c.restitution for c in contacts])
    if len(contacts) != 2 or contacts[0].owner != contacts[1].owner:
        return p, False  # with more coordinates the limit of impacts applies
    by_turns = all_of((c.side != 0.0) & c.free for c in contacts) & logical_not(supported[0] & supported[1])
    return p, by_turns & collapses(speeds, sides, w, contacts[0].restitution)


def collapses(speeds: Sequence[Any], sides: Sequence[Any], w: Matrix, restitution: Any) -> Any:
    """Whether two coordinates at their stops, of which one moves out, strike in turn for ever, and therefore
    stop.

    Each impact sends the other coordinate back to its stop, in no time. In units of sqrt(mobility) two
    impacts take the outward speeds (x, y) to ((k^2 - e) x + k y, -e k x - e y), where k = p / sqrt(waa wbb)
    is 1 + e times the push of one by the other. The impacts end by themselves if that map has no real
    eigenvalues, or if y is below the eigenvector of the greater one.
    """
    (ua, ub), (sa, sb) = speeds, sides
    p = -(1.0 + restitution) * sa * sb * w[0][1]
    square = p * p - 4.0 * restitution * w[0][0] * w[1][1]
    slope = p + sqrt(maximum(square, 0.0))
    lasting = where(ua > 0.0, 2.0 * w[0][0] * ub + slope * ua, 2.0 * w[1][1] * ua + slope * ub)
    return (minimum(minimum(p, square), lasting) >= 0.0) & (p > 0.0)


def leaving(contacts: Sequence[Contact], w: Matrix) -> list[Any]:
    """Coordinates at rest whose stops would have to pull, if every other one rests, too, or is at no stop."""
    modes, forces = [c.active_stop for c in contacts], [c.force for c in contacts]
    free = [-mode * total(map(mul, row, forces)) for mode, row in zip(modes, w, strict=True)]
    all_rest = all_of(c.resting for c in contacts) & any_of(c.pulled for c in contacts)
    result = []
    for c, stay in zip(contacts, pressed(free, modes, w), strict=True):
        alone = c.pulled & all_of(other.side == 0.0 for other in contacts if other is not c)
        result.append((all_rest & logical_not(stay)) | (logical_not(all_rest) & alone))
    return result


def would_rest(c: Contact, press: Any) -> Any:
    """Whether a coordinate at a stop, pressed onto it with an acceleration, bounces less than its lowest; if
    the stop is elastic and has no friction, whether its bounce is lost in rounding."""
    if not c.holds:
        return False
    fades = c.restitution < 1.0
    if c.friction_with_stop:
        fades = fades | (c.grip > 0.0)
    height = where(fades, c.lowest, ROUNDING * maximum(abs(where(c.side > 0.0, c.upper, c.lower)), 1.0))
    low = (c.speed * c.speed <= 2.0 * press * height) & (c.speed <= 0.0)
    if c.friction_with_stop:  # then there is a bounce to remove: without a speed friction decides
        low = low & (c.speed < 0.0)
    return (press > 0.0) & low & c.free & (c.side != 0.0) & logical_not(c.released)


@branches
def time_of_bounces(c: Contact, unheld: Any) -> Any:
    """Time of all further bounces of a coordinate that is pressed onto its stop, s; without the support of
    others it is pressed with ``unheld``."""
    press = maximum(unheld, c.side * c.acceleration) * (1.0 - c.restitution)
    if c.speed >= 0.0:
        return 0.0
    return -2.0 * c.speed / press if press > 0.0 else math.inf


def support_of(contacts: Sequence[Contact], unheld: Sequence[Any], w: Matrix) -> list[list[Any]]:
    """Which coordinates come to rest, and which are released, since their stops would have to pull them.

    If one strikes its stop, only those without velocity come to rest, and they do so before it strikes:
    whether a stop supports a coordinate follows from the motion alone, not from its earlier state. The
    bounces of others, however low, are not over yet. If several may rest, each decision changes the force on
    the others, so all are decided together. ``unheld`` are outward accelerations without any stop.
    """
    pressing = [c.side * c.acceleration for c in contacts]
    released = [c.pulled for c in contacts]
    calm = logical_not(any_of(released))
    strikes = any_of(c.speed > 0.0 for c in contacts)
    now = [logical_not(strikes) | (c.speed >= -NEGLIGIBLE_SPEED) for c in contacts]
    rests = [calm & s & would_rest(c, a) for c, a, s in zip(contacts, pressing, now, strict=True)]
    if len(contacts) == 1 or contacts[0].friction_with_stop:
        return [rests, released]
    each = list(enumerate(contacts))
    may_rest = [c.resting | (now[k] & would_rest(c, maximum(unheld[k], pressing[k]))) for k, c in each]
    if len(contacts) > 2:
        unheld = [where(may, a, AWAY) for may, a in zip(may_rest, unheld, strict=True)]
    stay = pressed(unheld, [c.side for c in contacts], w)
    changes = any_of(released) | any_of(rests)
    several = any_of(a & b for a, b in itertools.combinations(may_rest, 2)) & changes
    new_rests = [c.free & stay[k] for k, c in each]
    new_released = [logical_not(c.free | stay[k]) for k, c in each]
    return [
        [where(several & may, a, b) for may, a, b in zip(may_rest, new, alone, strict=True)]
        for new, alone in ((new_rests, rests), (new_released, released))
    ]


def velocity_after(c: Contact, pushes: Sequence[Any], row: Sequence[Any], still: Any, pushed: Any) -> Any:
    """Velocity of a coordinate after impulses, m/s, by its mobilities: exact, without the rounding of the
    impulses, if it is ``still`` or ``pushed`` by its stop."""
    bounced = -c.side * c.restitution * maximum(c.speed, 0.0)
    return where(still, 0.0, where(pushed, bounced, total([c.velocity, *map(mul, pushes, row)])))


@branches
def stop_after(c: Contact, strikes: Any, rests: Any, released: Any, velocity: Any) -> Any:
    """Side of the stop at which a coordinate, now with a velocity, rests from now on: some coordinate
    ``strikes``, and this one comes to rest or is released."""
    if rests:
        return c.side
    if released or (strikes and -c.side * velocity > 0.0):
        return 0.0
    return c.active_stop


def released_after(c: Contact, strikes: Any, hit: Any, released: Any, velocity: Any) -> Any:
    """Whether a coordinate is leaving its stop, and must not come to rest there before it is struck. One that
    rests while another strikes has not left: it may be pressed onto its stop now."""
    stands = strikes & (maximum(abs(c.velocity), abs(velocity)) <= NEGLIGIBLE_SPEED)
    return (released | c.released) & logical_not(hit | stands)


@branches
def happened_to(c: Contact, strikes: Any, hit: Any, rests: Any, released: Any, active: Any) -> Any:
    """The :class:`Happening` of a coordinate that rests at the ``active`` stop from now on."""
    if hit:
        return Happening.UPPER_IMPACT if c.side > 0.0 else Happening.LOWER_IMPACT
    if rests:
        return Happening.REST
    thrown = strikes & c.resting & (active == 0.0)
    return Happening.RELEASE if released or thrown else Happening.NONE


def resolve_contacts(impacts: Any, contacts: Sequence[Contact], w: Matrix) -> Resolved:
    """Strike, release, rest, or continue, after a number of impacts; ``w`` are mobilities, 1/kg."""
    rounding = [(c.speed > 0.0) & (c.speed <= NEGLIGIBLE_SPEED) for c in contacts]
    cleaned = [where(r, 0.0, c.velocity) for r, c in zip(rounding, contacts, strict=True)]
    contacts = [c._replace(velocity=v) for c, v in zip(contacts, cleaned, strict=True)]
    each = list(enumerate(contacts))
    held = [where(c.free, 0.0, c.force) if c.holds else 0.0 for c in contacts]
    unheld = [c.side * reduce(sub, map(mul, w[k], held), c.acceleration) for k, c in each]
    rests, released = support_of(contacts, unheld, w)
    settling = any_of(released) | any_of(rests)
    approach = any_of(c.speed > 0.0 for c in contacts)
    strikes = approach & logical_not(settling)
    struck, by_turns = impulses_of_impacts(contacts, w)
    pushed = [strikes & (p > 0.0) for p in struck]
    hits = [pushed[k] & (c.speed > 0.0) for k, c in each]
    # One that comes to rest must not set off another that rests, too.
    still = [
        (strikes & by_turns) | rests[k] | (any_of(rests) & c.resting & logical_not(released[k]))
        for k, c in each
    ]
    halts = halting([c.velocity for c in contacts], still, w)
    bounces = strikes & logical_not(by_turns)
    pushes = [where(bounces, -c.side * struck[k], halts[k]) for k, c in each]
    velocities = [velocity_after(c, pushes, w[k], still[k], pushed[k]) for k, c in each]
    active = [stop_after(c, strikes, rests[k], released[k], velocities[k]) for k, c in each]
    # Contacts are resolved once more if a coordinate at its stop strikes next, or has lost or gained the
    # support of another, or if removing a bounce has changed the motion of the arm.
    moved = any_of(abs(j) > 0.0 for j in halts)
    wait = any_of((c.side != 0.0) & c.free & logical_not(rests[k]) & logical_not(c.released) for k, c in each)
    left_out = reduce(maximum, [where(rests[k], time_of_bounces(c, unheld[k]), 0.0) for k, c in each])
    due = [  # one that stands still at its stop is not
        c.free & (minimum(c.upper - c.position, c.position - c.lower) < abs(c.velocity) * left_out)
        for c in contacts
    ]
    return Resolved(
        strikes=strikes | any_of(rests) | any_of(rounding),
        going_on=logical_not(strikes) & logical_not(settling & (approach | moved | wait)),
        impulses=pushes,
        velocities=velocities,
        active_stops=active,
        # The solution for speeds also serves accelerations: the holding forces from now on.
        forces=halting([c.side * unheld[k] for k, c in each], [a != 0.0 for a in active], w),
        released=[released_after(c, strikes, hits[k], released[k], velocities[k]) for k, c in each],
        happened=[happened_to(c, strikes, hits[k], rests[k], released[k], active[k]) for k, c in each],
        speeds=[where(hits[k], c.speed, 0.0) for k, c in each],
        impacts=sum((where(hit, 1.0, 0.0) for hit in hits), impacts),
        left_out=left_out,
        others=(left_out > 0.0) & any_of(a & b for a, b in itertools.combinations(due, 2)),
    )
