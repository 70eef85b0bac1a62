"""Reach a goal among obstacles that no link may touch."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from redundant_envs.language.algebra import physics
from redundant_envs.scenes.scene import Scene
from redundant_envs.tasks.parts.draws import first_that_fits
from redundant_envs.tasks.parts.obstacles import AmongObstacles, clearance_of_points, untouched_success
from redundant_envs.tasks.reach import goal_polar, hold_counter

CANDIDATES = 4
"""Goals that are drawn: the last one is taken if none fits."""


def candidate(k: int) -> tuple[Callable[..., Any], ...]:
    """Candidate k of a goal, as goals of reaching are drawn."""

    @physics(gives=f"radius{k} angle{k}", takes=f"draw{2 * k + 1} draw{2 * k + 2} reach inner outer")
    def polar(*values: Any) -> Any:
        return goal_polar(*values)

    @physics(gives=f"x{k}_drawn y{k}_drawn", takes=f"radius{k} angle{k}_s angle{k}_c")
    def place(radius: Any, s: Any, c: Any) -> Any:
        return radius * c, radius * s

    return polar, place


@dataclass(frozen=True)
class ReachAroundTask(AmongObstacles):
    """Bring the tip to a goal among obstacles and hold it there; no link may touch one.

    Parameters
    ----------
    goal_margin : float
        Least distance of a goal from an obstacle.
    """

    goal_margin: float = 0.05
    inner: float = 0.3

    name = "ReachAround"
    summary = "brings its tip to a goal among obstacles without touching them and holds it there"
    expert = "redundant_envs.control.experts.reach_around:ReachAround"
    steps = 150
    draws = 2 * CANDIDATES
    angles = {f"angle{k}": (f"angle{k}_s", f"angle{k}_c") for k in range(CANDIDATES)}
    weights = (0.22, 0.22, 0.32)
    units = {**AmongObstacles.units, "goal_margin": "reaches"}
    ranges = {**AmongObstacles.ranges, "goal_margin": (0.0, 2.0)}

    def begin_functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        points = [(f"x{k}_drawn", f"y{k}_drawn") for k in range(CANDIDATES)]
        free, fits = ([f"{what}{k}" for k in range(CANDIDATES - 1)] for what in ("free", "fits"))
        clear = [fits_beyond(name, fit) for name, fit in zip(free, fits, strict=True)]
        return (
            *(f for k in range(CANDIDATES) for f in candidate(k)),
            *clearance_of_points(scene, points[:-1], free), *clear,
            first_that_fits(("goal_x", "goal_y"), points, fits),
        )  # fmt: skip

    def success_functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        return hold_counter, untouched_success

    def start_note(self) -> str:
        return (
            f"The arm hangs. The goal is uniform over the area of the annulus from {self.inner:g} to\n"
            f"{self.outer:g} of the full reach: the first of {CANDIDATES} that is {self.goal_margin:g} "
            "reaches clear of all obstacles, or the last one."
        )


def fits_beyond(distance: str, name: str) -> Callable[..., Any]:
    """Positive where a distance is at least the margin of goals."""

    @physics(gives=name, takes=(distance, "goal_margin", "reach"))
    def fits_beyond(distance: Any, margin: Any, reach: Any) -> Any:
        return distance - margin * reach

    return fits_beyond
