"""How near the links of an arm come to the obstacles of a scene within a control interval."""

from collections.abc import Iterable, Iterator, Sequence
from functools import reduce
from typing import Any

from redundant_envs.effects.hooks import Obstacle
from redundant_envs.effects.obstacles import closest_names, gap_at, measure_of_link, near_names, numbers_of
from redundant_envs.language.algebra import cases, clamp, minimum, physics, where
from redundant_envs.simulator.lane.fields import Variable, copies, variables
from redundant_envs.simulator.lane.memory import Lane

FARTHEST = 1e300
"""m: a distance before anything was measured; unlike infinity it is no NaN after a product with 0."""


class NoWatch:
    """Lanes of which nobody asks how near they come to obstacles within an interval."""

    closest: tuple[str, ...] = ()
    """Fields with the least clearance from each obstacle so far in the interval, m."""

    def fields(self, saved: bool) -> Iterator[Variable]:
        return iter(())

    def clear(self, lane: Lane) -> None:
        """Before an interval: nothing is near."""

    def note_step(self, lane: Lane, before: Iterable[Any], now: Iterable[Any], h: Any) -> None:
        """After a step between two motions: the least clearances within it."""

    def take(self, lane: Lane) -> None:
        """The step counts: what it came near to is near."""


Ends = Sequence[Any]
"""Places of both ends of a link: xa, ya, xb, yb."""


class Watch(NoWatch):
    """Least clearances within the steps of an interval.

    In a step the ends of links move along the cubics that have their places and velocities at both ends of
    the step (Hermite). The measures of each link at the start, in the middle and at the end of the step tell
    when that of which link is least, and it is computed there, too. Under error control no link turns by more
    than half a radian in a step: a place is off by 0.5^4 / 384, or 1.6e-4, of its distance from the base
    at most. A disc much smaller than the way of a link in the step may be passed unseen.
    """

    def __init__(self, dynamics: Any) -> None:
        self.dynamics, self.obstacles = dynamics, dynamics.scene.attached.of(Obstacle)
        self.closest = closest_names(dynamics.scene.attached)
        self.near = near_names(dynamics.scene.attached)

    def fields(self, saved: bool) -> Iterator[Variable]:
        yield from variables(self.closest, "least clearance of the links in the interval", unit="m")
        yield from variables(self.near, "the same in the last step", unit="m")
        if saved:
            yield from copies(self.closest, "{}_start", "before the common step")

    def clear(self, lane: Lane) -> None:
        lane.set(self.closest, [FARTHEST] * len(self.closest))

    def note_step(self, lane: Lane, before: Iterable[Any], now: Iterable[Any], h: Any) -> None:
        motions = [self._motion(lane, states) for states in (before, now)]
        numbers = {name: lane[name] for o in self.obstacles for name in numbers_of(o)}
        pairs = [*zip(*motions, strict=True)]

        def links_at(share: Any) -> list[Ends]:
            return links_of([hermite(share, a, h * va, b, h * vb) for (a, va), (b, vb) in pairs])

        first, last = (links_of([place for place, _ in motion]) for motion in motions)
        middle = links_at(0.5)
        for name, obstacle in zip(self.near, self.obstacles, strict=True):
            sampled, shares, lowest = [], [], []
            for link in zip(first, middle, last, strict=True):
                sampled += (three := [measure_of_link(obstacle, places, numbers) for places in link])
                share, value = lowest_between(*three)
                shares.append(share)
                lowest.append(value)
            least = reduce(minimum, lowest)
            chosen = [(value == least, number) for number, value in enumerate(lowest)]
            share = cases(*zip((c for c, _ in chosen), shares, strict=True), default=0.5)
            ends = links_at(share)
            place = [cases(*((c, ends[n][k]) for c, n in chosen), default=ends[-1][k]) for k in range(4)]
            found = [*sampled, measure_of_link(obstacle, place, numbers)]
            lane[name] = gap_at(obstacle, reduce(minimum, found), numbers)

    def _motion(self, lane: Lane, states: Iterable[Any]) -> list[tuple[Any, Any]]:
        """x and y of each point mass with their rates, in the order of links."""
        x = self.dynamics.quantities([*states], {n: lane[n] for n in self.dynamics.parameters.numbers})
        points = range(1, self.dynamics.arm.num_masses + 1)
        return [(x[f"{axis}{n}"], x[f"v{axis}{n}"]) for n in points for axis in "xy"]

    def take(self, lane: Lane) -> None:
        for closest, near in zip(self.closest, self.near, strict=True):
            lane[closest] = minimum(lane[closest], lane[near])


def links_of(places: Sequence[Any]) -> list[Ends]:
    """Both ends of each link, from x and y of each point mass."""
    ends = (0.0, 0.0, *places)
    return [ends[k : k + 4] for k in range(0, len(places), 2)]


@physics
def hermite(s: Any, start: Any, slope: Any, end: Any, slope_of_end: Any) -> Any:
    """The cubic with these values and slopes at 0 and 1."""
    change = end - start
    second, third = 3.0 * change - 2.0 * slope - slope_of_end, slope + slope_of_end - 2.0 * change
    return start + s * (slope + s * (second + s * third))


@physics
def lowest_between(first: Any, middle: Any, last: Any) -> tuple[Any, Any]:
    """Where in 0 to 1 a parabola through three values has its minimum, the middle without one, and that."""
    rise, bend = 0.5 * (last - first), 0.5 * (first + last) - middle
    t = where(bend > 0.0, clamp(-0.5 * rise / bend, -1.0, 1.0), 0.0)
    return 0.5 + 0.5 * t, middle + t * (rise + t * bend)
