"""Follow a point that moves along a curve with the tip, among obstacles that no link may touch."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from redundant_envs.language.algebra import clamp, physics, sqrt, where
from redundant_envs.scenes.scene import Scene
from redundant_envs.tasks.parts.curve import TURN, point_at, sizes
from redundant_envs.tasks.parts.draws import first_that_fits
from redundant_envs.tasks.parts.obstacles import AmongObstacles, clearance_of_points
from redundant_envs.tasks.reach import terms_of_distance
from redundant_envs.tasks.track import TrackTask

CANDIDATES = 6
"""Centres of curves that are drawn. If none has room for the whole curve, the last one is taken, with a
smaller curve; if that has no room at all, the first one that has some."""
SMALLEST_FIT = 0.1
"""Least share of its size to which a curve shrinks where there is no room for it."""


def candidate(k: int) -> tuple[Callable[..., Any], ...]:
    """Candidate k of a centre, uniform over the area of an annulus."""

    @physics(gives=f"radius{k} angle{k}", takes=f"draw{2 * k + 7} draw{2 * k + 8} reach near far")
    def polar(first: Any, second: Any, reach: Any, near: Any, far: Any) -> Any:
        return reach * sqrt(near * near + first * (far * far - near * near)), TURN * second

    @physics(gives=f"x{k}_drawn y{k}_drawn", takes=f"radius{k} angle{k}_s angle{k}_c")
    def place(radius: Any, s: Any, c: Any) -> Any:
        return radius * c, radius * s

    @physics(gives=f"room{k} fits{k} some{k}", takes=f"free{k} goal_margin reach drawn_along slenderness")
    def room(free: Any, margin: Any, reach: Any, along: Any, slenderness: Any) -> Any:
        left = free - margin * reach
        size = along * sqrt(1.0 + slenderness * slenderness)
        return left, left - size, left - SMALLEST_FIT * size

    return polar, place, room


@physics(gives="tilt_s tilt_c along across")
def fitted(room, drawn_along, slenderness, tilt_sine, tilt_cosine):
    """The curve, smaller where the circle around it has no room."""
    share = clamp(room / (drawn_along * sqrt(1.0 + slenderness * slenderness)), SMALLEST_FIT, 1.0)
    return tilt_sine, tilt_cosine, share * drawn_along, share * drawn_along * slenderness


@physics(gives="is_success lost")
def success(tracked, begun, struck_new, ended):
    """Whether the tip has been on the target all the time without a touch, and no fault cuts that short;
    whether it has lost the target."""
    return where(struck_new + ended > 0.0, 0.0, tracked), begun - tracked


@dataclass(frozen=True)
class TrackAroundTask(AmongObstacles, TrackTask):
    """Follow a point along an ellipse or a figure eight with the tip; no link may touch an obstacle.

    Parameters
    ----------
    near, far : float
        Radii of the annulus in which centres of curves are drawn.
    goal_margin : float
        Least distance of a curve from the obstacles.
    """

    near: float = 0.25
    far: float = 0.65
    goal_margin: float = 0.03
    smallest: float = 0.1
    largest: float = 0.22
    wait: float = 1.5
    settle: float = 1.7

    name = "TrackAround"
    summary = "follows a point along a drawn curve with its tip among obstacles without touching them"
    expert = "redundant_envs.control.experts.track_around:TrackAround"
    steps = 240
    draws = 6 + 2 * CANDIDATES
    memory = (*TrackTask.memory, "struck")
    updates = {**TrackTask.updates, **AmongObstacles.updates}
    metrics = (*AmongObstacles.metrics, *(m for m in TrackTask.metrics if m not in AmongObstacles.metrics))
    angles = {
        **{name: pair for name, pair in TrackTask.angles.items() if name != "centre_a"},
        **{f"angle{k}": (f"angle{k}_s", f"angle{k}_c") for k in range(CANDIDATES)},
    }
    flags = (*AmongObstacles.flags, "lost")
    held_outputs = (*AmongObstacles.held_outputs, "lost")
    failures = {**AmongObstacles.failures, **TrackTask.failures}
    weights = (0.18, 0.22, 0.36)
    unused = (*TrackTask.unused, *AmongObstacles.unused, "spread")
    units = {
        **TrackTask.units, **AmongObstacles.units,
        **dict.fromkeys(("near", "far", "goal_margin"), "reaches"),
    }  # fmt: skip

    ranges = {
        **TrackTask.ranges, **AmongObstacles.ranges, "goal_margin": (0.0, 2.0),
        **dict.fromkeys(("near", "far"), (0.0, 1.0)),
    }  # fmt: skip
    ordered = (*TrackTask.ordered, *AmongObstacles.ordered, ("near", "far"))

    @property
    def farthest(self) -> float:
        return self.far

    def begin_functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        numbers = range(CANDIDATES)
        points = [(f"x{k}_drawn", f"y{k}_drawn") for k in numbers]
        centres = [(*point, f"room{k}") for k, point in enumerate(points)]
        some = [f"some{k}" for k in numbers]
        fits = [*(f"fits{k}" for k in numbers[:-1]), some[-1], *some[:-1]]
        return (
            sizes([f"draw{k}" for k in range(1, 7)]), *(f for k in numbers for f in candidate(k)),
            *clearance_of_points(scene, points, [f"free{k}" for k in numbers]),
            first_that_fits(("centre_x", "centre_y", "room"), (*centres, *centres), fits),
            fitted, point_at("goal", "phase_s", "phase_c"),
        )  # fmt: skip

    def success_functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        return (*super().success_functions(scene)[:-1], success)

    def distance_terms(self) -> tuple[Callable[..., Any], ...]:
        return terms_of_distance(self.weights, "track_tolerance", 2.0, "unharmed")

    def start_note(self) -> str:
        return (
            "The arm hangs. The curve is an ellipse or a figure eight, half of each, with a half length of\n"
            f"{self.smallest:g} to {self.largest:g} of the full reach, shorter where there is no room for "
            f"it, {self.goal_margin:g} of it clear of\nall obstacles. {self.course()}"
        )
