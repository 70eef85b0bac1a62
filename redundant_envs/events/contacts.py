"""Coordinates at their stops: which are struck, which come to rest, and which are released.

Accelerations, forces of stops and mobilities are given; time does not advance. Sides are 1 at the upper stop,
-1 at the lower one, 0 at none.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

from redundant_envs.algebra import all_of, any_of, logical_not, maximum, minimum, sqrt, where
from redundant_envs.events.boundary import NEGLIGIBLE_SPEED, ROUNDING, side_touched
from redundant_envs.events.complementarity import Matrix, impulses, outward_mobilities, pressed
from redundant_envs.tracing.ways import branches

LOWEST_BOUNCE = 1e-9
"""m; a coordinate that would bounce less high comes to rest."""
AWAY = -1e300
"""m/s^2; the outward acceleration of a coordinate that is pressed onto no stop."""


class Contact(NamedTuple):
    """A coordinate with a stop, near it or not.

    Attributes
    ----------
    position, velocity : m, m/s
    active_stop : side of the stop it rests at
    lower, upper : its stops, m
    acceleration : m/s^2
    force : exerted by its stop along it, N
    released : whether it leaves its stop and must not come to rest there before it is struck
    restitution : of its impacts
    holds : whether its stop can hold it
    owner : of the boundary
    """

    position: Any
    velocity: Any
    active_stop: Any
    lower: Any
    upper: Any
    acceleration: Any
    force: Any
    released: Any
    restitution: Any = 0.0
    holds: bool = True
    owner: str = ""

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
    def limit(self) -> Any:
        """The stop that it touches; without one, the lower."""
        return where(self.side > 0.0, self.upper, self.lower)

    @property
    def holding_force(self) -> Any:
        """Force with which a stop holds it, N."""
        return where(self.free, 0.0, self.force) if self.holds else 0.0


class Approach(NamedTuple):
    """Motion of coordinates at the stops that they touch.

    Attributes
    ----------
    sides : of these stops
    negligible : whether a coordinate moves into its stop by no more than rounding
    velocities : with negligible ones set to 0, m/s
    speeds : the same, outward
    strikes : whether a coordinate moves into its stop
    """

    sides: list[Any]
    negligible: list[Any]
    velocities: list[Any]
    speeds: list[Any]
    strikes: Any


class Impact(NamedTuple):
    """Impacts of coordinates that move into their stops.

    Attributes
    ----------
    strikes : whether a coordinate strikes, and no support changes before
    impulses : of the stops, inward, N s
    pushed : whether a coordinate is pushed by its stop
    hits : whether a coordinate is pushed and has moved into its stop
    stops_all : whether coordinates would strike in turn for ever, and therefore stop
    """

    strikes: Any
    impulses: list[Any]
    pushed: list[Any]
    hits: list[Any]
    stops_all: Any


class Support(NamedTuple):
    """Which coordinates their stops begin or cease to support.

    Attributes
    ----------
    rests : whether a coordinate comes to rest
    released : whether a coordinate is released, since its stop would have to pull it
    """

    rests: list[Any]
    released: list[Any]

    @property
    def changes(self) -> Any:
        """Whether a coordinate comes to rest or is released."""
        return any_of(self.released) | any_of(self.rests)


def approach_of(contacts: Sequence[Contact]) -> Approach:
    """Motion of coordinates at the stops that they touch; speeds that are only rounding are set to 0."""
    sides = [c.side for c in contacts]
    negligible = []
    for side, c in zip(sides, contacts, strict=True):
        out = side * c.velocity
        negligible.append((out > 0.0) & (out <= NEGLIGIBLE_SPEED))
    velocities = [where(n, 0.0, c.velocity) for n, c in zip(negligible, contacts, strict=True)]
    speeds = [side * v for side, v in zip(sides, velocities, strict=True)]
    return Approach(sides, negligible, velocities, speeds, any_of(u > 0.0 for u in speeds))


def impact_of(contacts: Sequence[Contact], approach: Approach, support: Support, w: Matrix) -> Impact:
    """Impacts of coordinates that move into their stops, once it is known which others their stops support.

    A coordinate that moves away from its stop is no longer supported by it, however near it is: if an
    impact of another sends it back, it is struck next. A coordinate that stays there without a force is
    supported.
    """
    sides, speeds = approach.sides, approach.speeds
    strikes = approach.strikes & logical_not(support.changes)
    supported = [
        c.resting | (u > 0.0) | ((u == 0.0) & (side * c.acceleration >= 0.0))
        for c, side, u in zip(contacts, sides, speeds, strict=True)
    ]
    supporting = [where(s, side, 0.0) for s, side in zip(supported, sides, strict=True)]
    p = impulses(speeds, supporting, w, [c.restitution for c in contacts])
    pushed = [strikes & (x > 0.0) for x in p]
    hits = [x & (u > 0.0) for x, u in zip(pushed, speeds, strict=True)]
    stops_all: Any = False
    if len(contacts) == 2 and contacts[0].owner == contacts[1].owner:
        touching = [(side != 0.0) & c.free for side, c in zip(sides, contacts, strict=True)]
        by_turns = touching[0] & touching[1] & logical_not(supported[0] & supported[1])
        stops_all = strikes & by_turns & collapses(speeds, sides, w, contacts[0].restitution)
    return Impact(strikes, p, pushed, hits, stops_all)


def collapses(speeds: Sequence[Any], sides: Sequence[Any], w: Matrix, restitution: Any) -> Any:
    """Whether two coordinates at their stops, of which one moves out, strike in turn for ever, and therefore
    stop.

    Each impact sends the other coordinate back to its stop, in no time. In units of sqrt(mobility) two
    impacts take the outward speeds (x, y) to ((k^2 - e) x + k y, -e k x - e y), where k = p / sqrt(waa wbb)
    is 1 + e times the push of one by the other. The impacts end by themselves if that map has no real
    eigenvalues, or if y is below the eigenvector of the greater one.
    """
    (ua, ub), (sa, sb) = speeds, sides  # for two coordinates; with more, the limit of impacts applies
    p = -(1.0 + restitution) * sa * sb * w[0][1]
    square = p * p - 4.0 * restitution * w[0][0] * w[1][1]
    slope = p + sqrt(maximum(square, 0.0))
    lasting = where(ua > 0.0, 2.0 * w[0][0] * ub + slope * ua, 2.0 * w[1][1] * ua + slope * ub)
    return (minimum(minimum(p, square), lasting) >= 0.0) & (p > 0.0)


def leaving(contacts: Sequence[Contact], w: Matrix) -> list[Any]:
    """Coordinates at rest whose stops would have to pull, if every other one rests, too, or is at no stop."""
    modes = [c.active_stop for c in contacts]
    pulled = [c.active_stop * c.force > 0.0 for c in contacts]
    free = []
    for i in range(len(contacts)):
        total = w[i][0] * contacts[0].force
        for j in range(1, len(contacts)):
            total = total + w[i][j] * contacts[j].force
        free.append(-modes[i] * total)
    stays = pressed(free, outward_mobilities(w, modes))
    all_rest = all_of(c.resting for c in contacts) & any_of(pulled)
    result = []
    for i in range(len(contacts)):
        alone = pulled[i] & all_of(o.side == 0.0 for j, o in enumerate(contacts) if j != i)
        result.append((all_rest & logical_not(stays[i])) | (logical_not(all_rest) & alone))
    return result


def would_rest(c: Contact, speed: Any, press: Any) -> Any:
    """Whether a coordinate at a stop, pressed onto it, bounces less than 1e-9 m.

    With an elastic stop it rests only if its bounce is lost in rounding.
    """
    if not c.holds:
        return False
    low = (speed * speed <= 2.0 * press * height_of_rest(c)) & (speed <= 0.0)
    return (press > 0.0) & low & c.free & (c.side != 0.0) & logical_not(c.released)


@branches
def height_of_rest(c: Contact) -> Any:
    """Height of the bounces, m, below which a coordinate comes to rest."""
    return LOWEST_BOUNCE if c.restitution < 1.0 else ROUNDING * maximum(abs(c.limit), 1.0)


def unheld_accelerations(contacts: Sequence[Contact], sides: Sequence[Any], w: Matrix) -> list[Any]:
    """Outward accelerations that the coordinates would have if no stop held any of them, m/s^2."""
    unheld = []
    for side, row, c in zip(sides, w, contacts, strict=True):
        acceleration = c.acceleration
        for mobility, other in zip(row, contacts, strict=True):
            acceleration = acceleration - mobility * other.holding_force
        unheld.append(side * acceleration)
    return unheld


def support_of(contacts: Sequence[Contact], approach: Approach, unheld: Sequence[Any], w: Matrix) -> Support:
    """Which coordinates come to rest and which are released.

    If one strikes its stop, only those without velocity come to rest, and they do so before it strikes:
    whether a stop supports a coordinate follows from the motion alone, not from its earlier state. The
    bounces of others, however low, are not over yet.

    Parameters
    ----------
    contacts, approach : the coordinates, and their motion at their stops
    unheld : outward accelerations without any stop, m/s^2
    w : mobilities of the coordinates, 1/kg
    """
    pressing = [side * c.acceleration for side, c in zip(approach.sides, contacts, strict=True)]
    released = [c.active_stop * c.force > 0.0 for c in contacts]
    calm = logical_not(any_of(released))
    now = [logical_not(approach.strikes) | (u >= -NEGLIGIBLE_SPEED) for u in approach.speeds]
    rests = [
        calm & settled & would_rest(c, u, a)
        for c, u, a, settled in zip(contacts, approach.speeds, pressing, now, strict=True)
    ]
    support = Support(rests, released)
    if len(contacts) == 1:
        return support
    may_rest = [
        c.resting | (settled & would_rest(c, u, maximum(free, a)))
        for c, u, free, a, settled in zip(contacts, approach.speeds, unheld, pressing, now, strict=True)
    ]
    if len(contacts) > 2:
        unheld = [where(may, a, AWAY) for may, a in zip(may_rest, unheld, strict=True)]
    stay = pressed(unheld, outward_mobilities(w, approach.sides))
    return support_together(contacts, support, may_rest, stay)


def support_together(
    contacts: Sequence[Contact], support: Support, may_rest: Sequence[Any], stay: Sequence[Any]
) -> Support:
    """Which coordinates come to rest and which are released, if several may rest.

    Each decision changes the force on the others, so all are decided together: those that ``stay`` rest.
    """
    several = any_of(a & b for a, b in itertools.combinations(may_rest, 2))
    decide = several & support.changes
    together = [
        changed_together(decide & may, c.free, stays, rest, release)
        for c, may, stays, rest, release in zip(contacts, may_rest, stay, *support, strict=True)
    ]
    return Support([rest for rest, _ in together], [release for _, release in together])


@branches
def changed_together(decided: Any, free: Any, stays: Any, rest: Any, release: Any) -> tuple[Any, Any]:
    """Whether a coordinate comes to rest, and whether it is released.

    Parameters
    ----------
    decided : whether all are decided together
    free, stays : whether the coordinate rests at no stop, and whether it rests from now on
    rest, release : the same if it is decided alone
    """
    if decided:
        return free & stays, logical_not(free | stays)
    return rest, release
