"""Contact resolution: resolves the contacts of coordinates at their stops, at one instant.

Sides are 1 at the upper stop, -1 at the lower one, 0 at none.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from typing import Any, NamedTuple

from redundant_envs.algebra import any_of, logical_not, maximum, where
from redundant_envs.events.boundary import NEGLIGIBLE_SPEED
from redundant_envs.events.complementarity import Matrix, halting
from redundant_envs.events.contacts import (
    Approach,
    Contact,
    Impact,
    Support,
    approach_of,
    impact_of,
    support_of,
    unheld_accelerations,
)
from redundant_envs.tracing.ways import branches

MOST_IMPACTS = 256
"""Most impacts of an interval; with more it is given up."""
MOST_CHANGES = 512
"""Most contact resolutions of an interval; with more it is given up."""


class Happening(enum.IntEnum):
    """What happens to a coordinate where contacts are resolved."""

    NONE = 0
    """Nothing."""
    UPPER_IMPACT = 1
    """It strikes its upper stop."""
    LOWER_IMPACT = 2
    """It strikes its lower stop."""
    REST = 3
    """It comes to rest at its stop."""
    RELEASE = 4
    """It leaves the stop at which it rested."""


class Halt(NamedTuple):
    """Coordinates that have to stop, and the impulses along them that stop them, N s."""

    still: list[Any]
    impulses: list[Any]


class Resolved(NamedTuple):
    """The contacts of a lane, resolved once.

    Attributes
    ----------
    strikes : impulses act
    going_on : the motion continues; otherwise contacts are resolved again
    impulses : along the coordinates, N s
    velocities, active_stops, forces, released : of the coordinates, after it
    happened, speeds : the :class:`Happening` of each coordinate, and its speed into the stop, m/s
    impacts : number of impacts
    """

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


def halt_of(
    contacts: Sequence[Contact], approach: Approach, impact: Impact, support: Support, w: Matrix
) -> Halt:
    """Which coordinates have to stop: one that comes to rest must not set off another that rests, too.

    Parameters
    ----------
    contacts, approach : the coordinates, and their motion at their stops
    impact, support : their impacts, and changes of their support
    w : mobilities of the coordinates, 1/kg
    """
    someone = any_of(support.rests)
    still = [
        impact.stops_all | rests | (someone & c.resting & logical_not(released))
        for c, rests, released in zip(contacts, *support, strict=True)
    ]
    return Halt(still, halting(approach.velocities, still, w))


def looks_again(contacts: Sequence[Contact], approach: Approach, support: Support, halt: Halt) -> Any:
    """Whether contacts are resolved once more before the motion continues.

    They are if a coordinate at its stop strikes next, or has lost or gained the support of another, or if
    removing a bounce has changed the motion of the arm.
    """
    waits = any_of(
        (side != 0.0) & c.free & logical_not(rests) & logical_not(c.released)
        for side, c, rests in zip(approach.sides, contacts, support.rests, strict=True)
    )
    moved = any_of(abs(j) > 0.0 for j in halt.impulses)
    return support.changes & (approach.strikes | moved | waits)


def impulses_of(approach: Approach, impact: Impact, halt: Halt) -> list[Any]:
    """Impulses along the coordinates, N s: those of impacts, otherwise those that stop coordinates."""
    bounces = impact.strikes & logical_not(impact.stops_all)
    return [
        where(bounces, -side * p, h)
        for side, p, h in zip(approach.sides, impact.impulses, halt.impulses, strict=True)
    ]


def velocities_after(
    contacts: Sequence[Contact], pushes: Sequence[Any], approach: Approach, impact: Impact, halt: Halt,
    w: Matrix,
) -> list[Any]:  # fmt: skip
    """Velocities of the coordinates after impulses, m/s.

    The velocity of a coordinate that stops or bounces is exact, without the rounding of the impulses.

    Parameters
    ----------
    contacts, pushes : the coordinates, and impulses along them, N s
    approach, impact, halt : their motion at their stops, their impacts, and which of them stop
    w : mobilities of the coordinates, 1/kg
    """
    velocities = []
    for i, c in enumerate(contacts):
        side, velocity, speed = approach.sides[i], approach.velocities[i], approach.speeds[i]
        for push, mobility in zip(pushes, w[i], strict=True):
            velocity = velocity + push * mobility
        bounced = -side * c.restitution * maximum(speed, 0.0)
        velocities.append(velocity_after(halt.still[i], impact.pushed[i], bounced, velocity))
    return velocities


@branches
def velocity_after(still: Any, pushed: Any, bounced: Any, velocity: Any) -> Any:
    """Velocity of a coordinate that stops, that its stop has pushed, or that others have pushed, m/s."""
    if still:
        return 0.0
    return bounced if pushed else velocity


@branches
def stop_after(c: Contact, strikes: Any, rests: Any, released: Any, velocity: Any) -> Any:
    """Side of the stop at which a coordinate rests from now on.

    Parameters
    ----------
    c : the coordinate
    strikes : whether a coordinate moves into its stop
    rests, released : whether this one comes to rest, or is released
    velocity : its present velocity, m/s
    """
    if rests:
        return c.side
    if released or (strikes and -c.side * velocity > 0.0):
        return 0.0
    return c.active_stop


def released_after(c: Contact, strikes: Any, hit: Any, released: Any, velocity: Any) -> Any:
    """Whether a coordinate is leaving its stop, and must not come to rest there before it is struck.

    One that stays at rest while another one strikes has not left: it may be pressed onto its stop now.

    Parameters
    ----------
    c : the coordinate
    strikes, hit : whether a coordinate moves into its stop, and whether this one does
    released : whether it is released
    velocity : its present velocity, m/s
    """
    stands = strikes & (maximum(abs(c.velocity), abs(velocity)) <= NEGLIGIBLE_SPEED)
    return (released | c.released) & logical_not(hit | stands)


@branches
def happened_to(c: Contact, strikes: Any, hit: Any, rests: Any, released: Any, active: Any) -> Any:
    """The :class:`Happening` of a coordinate.

    Parameters
    ----------
    c : the coordinate
    strikes, hit : whether a coordinate moves into its stop, and whether this one does
    rests, released : whether it comes to rest, or is released
    active : side of the stop at which it rests from now on
    """
    if hit:
        return Happening.UPPER_IMPACT if c.side > 0.0 else Happening.LOWER_IMPACT
    if rests:
        return Happening.REST
    thrown = strikes & c.resting & (active == 0.0)
    return Happening.RELEASE if released or thrown else Happening.NONE


def resolve_contacts(impacts: Any, contacts: Sequence[Contact], w: Matrix) -> Resolved:
    """Strike, release, rest, or continue.

    Parameters
    ----------
    impacts : number of impacts of the interval
    contacts : the coordinates
    w : their mobilities, 1/kg
    """
    approach = approach_of(contacts)
    unheld = unheld_accelerations(contacts, approach.sides, w)
    support = support_of(contacts, approach, unheld, w)
    impact = impact_of(contacts, approach, support, w)
    halt = halt_of(contacts, approach, impact, support, w)
    pushes = impulses_of(approach, impact, halt)
    velocities = velocities_after(contacts, pushes, approach, impact, halt, w)
    changes = list(zip(contacts, impact.hits, *support, velocities, strict=True))
    active = [stop_after(c, impact.strikes, rests, off, v) for c, _, rests, off, v in changes]
    # The solution for speeds also serves accelerations: the holding forces from now on.
    accelerations = [side * a for side, a in zip(approach.sides, unheld, strict=True)]
    for hit in impact.hits:
        impacts = impacts + where(hit, 1.0, 0.0)
    return Resolved(
        strikes=impact.strikes | any_of(support.rests) | any_of(approach.negligible),
        going_on=logical_not(impact.strikes) & logical_not(looks_again(contacts, approach, support, halt)),
        impulses=pushes,
        velocities=velocities,
        active_stops=active,
        forces=halting(accelerations, [a != 0.0 for a in active], w),
        released=[released_after(c, impact.strikes, hit, off, v) for c, hit, _, off, v in changes],
        happened=[
            happened_to(c, impact.strikes, hit, rests, off, a)
            for (c, hit, rests, off, _), a in zip(changes, active, strict=True)
        ],
        speeds=[where(hit, u, 0.0) for hit, u in zip(impact.hits, approach.speeds, strict=True)],
        impacts=impacts,
    )
