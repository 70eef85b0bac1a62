"""Contact resolution: resolves the contacts of sliders at their stops, at one instant.

Sides are 1 at the upper stop, -1 at the lower one, 0 at none.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from typing import Any, NamedTuple

from redundant_envs.algebra import any_of, cases, logical_not, maximum, where
from redundant_envs.integrators.complementarity import Matrix, halting
from redundant_envs.integrators.contacts import (
    Approach,
    Contact,
    Impact,
    Support,
    approach_of,
    impact_of,
    support_of,
    unheld_accelerations,
)
from redundant_envs.integrators.sliders import NEGLIGIBLE_SPEED

MOST_IMPACTS = 256
"""Most impacts of an interval; with more it is given up."""
MOST_CHANGES = 512
"""Most contact resolutions of an interval; with more it is given up."""


class Event(enum.IntEnum):
    """Event of a slider at a stop."""

    NONE = 0
    UPPER_IMPACT = 1
    LOWER_IMPACT = 2
    REST = 3
    RELEASE = 4


class Halt(NamedTuple):
    """Sliders that have to stop, and the impulses along them that stop them, N s."""

    still: list[Any]
    impulses: list[Any]


class Resolved(NamedTuple):
    """Result of resolving the contacts of a lane.

    Attributes
    ----------
    given_up : there were more impacts or changes than an interval may have
    strikes : impulses act
    going_on : the motion continues
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


def halt_of(
    contacts: Sequence[Contact], approach: Approach, impact: Impact, support: Support, w: Matrix
) -> Halt:
    """Which sliders have to stop: a slider that comes to rest must not set off another that rests, too.

    Parameters
    ----------
    contacts, approach : the sliders, and their motion at their stops
    impact, support : their impacts, and changes of their support
    w : mobilities of the sliders, 1/kg
    """
    someone = any_of(support.rests)
    still = [
        impact.stops_all | rests | (someone & c.resting & logical_not(released))
        for c, rests, released in zip(contacts, *support, strict=True)
    ]
    return Halt(still, halting(approach.velocities, still, w))


def looks_again(contacts: Sequence[Contact], approach: Approach, support: Support, halt: Halt) -> Any:
    """Whether contacts are resolved once more before the motion continues.

    They are if a slider at its stop strikes next, or has lost or gained the support of another, or if
    removing a bounce has changed the motion of the arm.
    """
    waits = any_of(
        (side != 0.0) & c.free & logical_not(rests) & logical_not(c.released)
        for side, c, rests in zip(approach.sides, contacts, support.rests, strict=True)
    )
    moved = any_of(abs(j) > 0.0 for j in halt.impulses)
    return support.changes & (approach.strikes | moved | waits)


def impulses_of(approach: Approach, impact: Impact, halt: Halt) -> list[Any]:
    """Impulses along the sliders, N s: those of impacts, otherwise those that stop sliders."""
    bounces = impact.strikes & logical_not(impact.stops_all)
    return [
        where(bounces, -side * p, h)
        for side, p, h in zip(approach.sides, impact.impulses, halt.impulses, strict=True)
    ]


def velocities_after(
    pushes: Sequence[Any], approach: Approach, impact: Impact, halt: Halt, w: Matrix, restitution: Any
) -> list[Any]:
    """Velocities of the sliders after impulses, m/s.

    The velocity of a slider that stops or bounces is exact, without the rounding of the impulses.

    Parameters
    ----------
    pushes : impulses along the sliders, N s
    approach, impact, halt : their motion at their stops, their impacts, and which of them stop
    w, restitution : mobilities of the sliders, 1/kg, and of the impacts
    """
    velocities = []
    for i, (side, velocity, speed) in enumerate(
        zip(approach.sides, approach.velocities, approach.speeds, strict=True)
    ):
        for push, mobility in zip(pushes, w[i], strict=True):
            velocity = velocity + push * mobility
        bounced = -side * restitution * maximum(speed, 0.0)
        velocities.append(where(halt.still[i], 0.0, where(impact.pushed[i], bounced, velocity)))
    return velocities


def stops_after(
    contacts: Sequence[Contact], sides: Sequence[Any], strikes: Any, support: Support,
    velocities: Sequence[Any],
) -> list[Any]:  # fmt: skip
    """Sides of the stops at which the sliders rest from now on.

    Parameters
    ----------
    contacts, sides : the sliders, and the sides of the stops that they touch
    strikes : whether one of them moves into its stop
    support : which come to rest and which are released
    velocities : their present velocities, m/s
    """
    active = []
    for c, side, v, rests, released in zip(contacts, sides, velocities, *support, strict=True):
        off = released | (strikes & (-side * v > 0.0))
        active.append(where(rests, side, where(off, 0.0, c.active_stop)))
    return active


def released_after(
    contacts: Sequence[Contact], impact: Impact, support: Support, velocities: Sequence[Any]
) -> list[Any]:
    """Whether sliders are leaving their stops, and must not come to rest there before they are struck.

    A slider that stays at rest while another one strikes has not left: it may be pressed onto its stop now.

    Parameters
    ----------
    contacts : the sliders
    impact, support : their impacts, and changes of their support
    velocities : their present velocities, m/s
    """
    leaving = []
    for c, hit, released, v in zip(contacts, impact.hits, support.released, velocities, strict=True):
        stands = impact.strikes & (maximum(abs(c.velocity), abs(v)) <= NEGLIGIBLE_SPEED)
        leaving.append((released | c.released) & logical_not(hit | stands))
    return leaving


def happened_to(
    contacts: Sequence[Contact], sides: Sequence[Any], impact: Impact, support: Support, active: Sequence[Any]
) -> list[Any]:
    """The :class:`Event` of each slider.

    Parameters
    ----------
    contacts, sides : the sliders, and the sides of the stops that they touch
    impact, support : their impacts, and changes of their support
    active : sides of the stops at which they rest from now on
    """
    happened = []
    for k, c in enumerate(contacts):
        hit = where(sides[k] > 0.0, Event.UPPER_IMPACT, Event.LOWER_IMPACT)
        thrown = impact.strikes & c.resting & (active[k] == 0.0)
        leaves = support.released[k] | thrown
        happened.append(
            cases(
                (impact.hits[k], hit), (support.rests[k], Event.REST), (leaves, Event.RELEASE),
                default=Event.NONE,
            )
        )  # fmt: skip
    return happened


def resolve_contacts(
    at_stop: Any, changes: Any, impacts: Any, contacts: Sequence[Contact], w: Matrix, restitution: Any
) -> Resolved:
    """Strike, release, rest, or continue.

    Parameters
    ----------
    at_stop : whether the lane is at a stop, and its contacts are to be resolved
    changes, impacts : number of contact resolutions in the interval, and of its impacts
    contacts : the sliders
    w : their mobilities, 1/kg
    restitution : of the impacts
    """
    approach = approach_of(contacts)
    sides = approach.sides
    unheld = unheld_accelerations(contacts, sides, w)
    support = support_of(contacts, approach, unheld, w, restitution)
    impact = impact_of(contacts, approach, support, w, restitution)
    halt = halt_of(contacts, approach, impact, support, w)
    pushes = impulses_of(approach, impact, halt)
    velocities = velocities_after(pushes, approach, impact, halt, w, restitution)
    active = stops_after(contacts, sides, impact.strikes, support, velocities)
    happened = happened_to(contacts, sides, impact, support, active)
    # The solution for speeds also serves accelerations: the holding forces from now on.
    accelerations = [side * a for side, a in zip(sides, unheld, strict=True)]
    forces = halting(accelerations, [a != 0.0 for a in active], w)
    going = logical_not(impact.strikes) & logical_not(looks_again(contacts, approach, support, halt))
    spent = (changes >= MOST_CHANGES) | (impacts > MOST_IMPACTS)
    acts = at_stop & logical_not(spent)
    for hit in impact.hits:
        impacts = impacts + where(acts & hit, 1.0, 0.0)
    return Resolved(
        given_up=at_stop & spent,
        strikes=acts & (impact.strikes | any_of(support.rests) | any_of(approach.negligible)),
        going_on=acts & going,
        impulses=pushes,
        velocities=velocities,
        active_stops=[where(acts, a, c.active_stop) for a, c in zip(active, contacts, strict=True)],
        forces=forces,
        released=[
            where(acts, released, c.released)
            for c, released in zip(
                contacts, released_after(contacts, impact, support, velocities), strict=True
            )
        ],
        happened=[where(logical_not(acts), Event.NONE, event) for event in happened],
        speeds=[where(acts & hit, u, 0.0) for hit, u in zip(impact.hits, approach.speeds, strict=True)],
        impacts=impacts,
    )
