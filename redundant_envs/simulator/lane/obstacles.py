"""How near the links of an arm come to the obstacles of a scene: now, and within a control interval."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import reduce
from typing import Any

from redundant_envs.effects.bound_hooks import Attached, Attachments
from redundant_envs.effects.hooks import ENDS_OF_LINK, Obstacle
from redundant_envs.language.algebra import cases, clamp, minimum, numbered, physics, where
from redundant_envs.robots.arm import Arm
from redundant_envs.simulator.lane.fields import Variable, copies, variables
from redundant_envs.simulator.lane.memory import Lane

CLOSEST, NEAR = "closest{}", "near{}"
FARTHEST = 1e300
"""m: a distance before anything was measured; unlike infinity it is no NaN after a product with 0."""


def ends_of_link(link: int) -> tuple[tuple[str, str], ...]:
    """Names of x and y of both ends of a link, counted from 0, the first of which begins at the base."""
    return tuple((f"x{n}", f"y{n}") for n in (link, link + 1))


def clearance_functions(attached: Attachments, arm: Arm) -> tuple[Callable[..., Any], ...]:
    """They give ``clearance<k>_<j>`` [m] of obstacle k and link j, and ``clearance<k>`` of the nearest."""
    functions = []
    for k, obstacle in enumerate(attached.of(Obstacle), start=1):
        names = [f"clearance{k}_{j + 1}" for j in range(arm.num_masses)]
        functions += [_of_link(obstacle, name, j) for j, name in enumerate(names)]
        functions.append(_least(f"clearance{k}", names))
    return tuple(functions)


def _of_link(obstacle: Attached[Obstacle], name: str, link: int) -> Callable[..., Any]:
    near, far = ends_of_link(link)
    ends = (*(near if link else ()), *far)
    gap = obstacle.functions["gap"]
    numbers = [n for n in gap.names if n not in ENDS_OF_LINK]

    @physics(gives=name, takes=(*ends, *numbers))
    def clearance(*values: Any) -> Any:
        places = values[: len(ends)] if link else (0.0, 0.0, *values[: len(ends)])
        return _gap(obstacle, places, dict(zip(numbers, values[len(ends) :], strict=True)))

    return clearance


def _least(name: str, of: Sequence[str]) -> Callable[..., Any]:
    @physics(gives=name, takes=of)
    def least(*values: Any) -> Any:
        return reduce(minimum, values)

    return least


def _gap(obstacle: Attached[Obstacle], places: Sequence[Any], numbers: Any) -> Any:
    """The gap of a link whose ends are at these places (xa, ya, xb, yb)."""
    gap, known = obstacle.functions["gap"], dict(zip(ENDS_OF_LINK, places, strict=True))
    return gap.on(known[n] if n in known else numbers[n] for n in gap.names)


def closest_fields(attached: Attachments) -> tuple[str, ...]:
    """Names of the least clearances from the obstacles within an interval."""
    return tuple(numbered(CLOSEST, len(attached.of(Obstacle))))


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
    the step (Hermite). The gaps of each link at the start, in the middle and at the end of the step tell when
    the gap of which link is least, and it is computed there, too. Under error control no link turns by more
    than half a radian in a step: a place is off by at most 0.5^4 / 384, or 1.6e-4, of its distance from the
    base. Deep in a disc, where links pass its centre, the least gap is less exact than at its edge.
    """

    def __init__(self, dynamics: Any) -> None:
        self.dynamics, self.obstacles = dynamics, dynamics.scene.attached.of(Obstacle)
        self.closest = closest_fields(dynamics.scene.attached)
        self.near = tuple(numbered(NEAR, len(self.obstacles)))

    def fields(self, saved: bool) -> Iterator[Variable]:
        yield from variables(self.closest, "least clearance of the links in the interval", unit="m")
        yield from variables(self.near, "the same in the last step", unit="m")
        if saved:
            yield from copies(self.closest, "{}_start", "before the common step")

    def clear(self, lane: Lane) -> None:
        lane.set(self.closest, [FARTHEST] * len(self.closest))

    def note_step(self, lane: Lane, before: Iterable[Any], now: Iterable[Any], h: Any) -> None:
        motions = [self._motion(lane, states) for states in (before, now)]
        numbers = {n: lane[n] for o in self.obstacles for n in o.functions["gap"].names if n in lane}

        pairs = [*zip(*motions, strict=True)]

        def links_at(share: Any) -> list[Ends]:
            return links_of([hermite(share, a, h * va, b, h * vb) for (a, va), (b, vb) in pairs])

        first, last = (links_of([place for place, _ in motion]) for motion in motions)
        middle = links_at(0.5)
        for name, obstacle in zip(self.near, self.obstacles, strict=True):
            sampled, shares, lowest = [], [], []
            for link in zip(first, middle, last, strict=True):
                sampled += (gaps := [_gap(obstacle, places, numbers) for places in link])
                share, value = lowest_between(*gaps)
                shares.append(share)
                lowest.append(value)
            least = reduce(minimum, lowest)
            chosen = [(value == least, number) for number, value in enumerate(lowest)]
            share = cases(*zip((c for c, _ in chosen), shares, strict=True), default=0.5)
            ends = links_at(share)
            place = [cases(*((c, ends[n][k]) for c, n in chosen), default=ends[-1][k]) for k in range(4)]
            lane[name] = reduce(minimum, [*sampled, _gap(obstacle, place, numbers)])

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
