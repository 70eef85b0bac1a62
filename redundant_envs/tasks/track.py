"""Follow a point that moves along a curve with the tip."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from redundant_envs.language.algebra import maximum, physics, saturation, sqrt, squash, tolerance, where
from redundant_envs.scenes.scene import Scene
from redundant_envs.tasks.parts.curve import CURVE, SHAPE, TURN, next_phase, point_at, point_of, sizes, slope
from redundant_envs.tasks.reach import ReachTask, goal_error, terms_of_distance

AHEAD = (4, 8)
"""Control steps: where the target would be then at its present pace is observed."""


PATH_POINTS = 96
"""Parts of a curve in a picture."""
LONGEST = 1.25
"""Most half lengths from the centre to a point of a curve: cos^2 x + sin^2 2x is 25/16 at most."""


@physics(gives="centre_r centre_a")
def centre_drawn(draw7, draw8, reach, spread):
    """Uniform over the area of a disc."""
    return reach * spread * sqrt(draw7), TURN * draw8


@physics(gives="centre_x centre_y tilt_s tilt_c along across")
def place(centre_r, centre_s, centre_c, tilt_sine, tilt_cosine, drawn_along, slenderness):
    return (
        centre_r * centre_c, centre_r * centre_s, tilt_sine, tilt_cosine,
        drawn_along, slenderness * drawn_along,
    )  # fmt: skip


@physics(gives=[f"ahead{k + 1}" for k in range(len(AHEAD))])
def phases_ahead(phase, spin, interval, ramp):
    return tuple(phase + steps * spin * interval * ramp for steps in map(float, AHEAD))


@physics(gives="slope_x_obs slope_y_obs")
def observed_slope(slope_x, slope_y, reach):
    return squash(slope_x, 0.5 * reach), squash(slope_y, 0.5 * reach)


def observed_ahead(k: int) -> Callable[..., Any]:
    @physics(gives=f"ahead{k}_x_obs ahead{k}_y_obs", takes=f"ahead{k}_x ahead{k}_y tip_x tip_y reach")
    def observed_ahead(x, y, tip_x, tip_y, reach):
        return squash(x - tip_x, 0.1 * reach), squash(y - tip_y, 0.1 * reach)

    return observed_ahead


@physics(gives="begun")
def begun(steps, interval, settle):
    """1 when errors count."""
    return where((steps + 1.0) * interval > settle, 1.0, 0.0)


@physics(gives="worst_new")
def worst_error(worst, distance, begun):
    """Largest distance from the target since errors count."""
    return where(begun > 0.0, maximum(worst, distance), worst)


@physics(gives="hold_new touched_new")
def track_counter(hold, touched, distance, reach, track_tolerance):
    """Steps in a row on the target; whether it was ever reached."""
    on_target = where(distance <= track_tolerance * reach, 1.0, 0.0)
    return on_target * (hold + 1.0), where(touched + on_target > 0.0, 1.0, 0.0)


@physics(gives="tracked")
def tracked(worst_new, begun, reach, track_tolerance):
    return begun * where(worst_new <= track_tolerance * reach, 1.0, 0.0)


@physics(gives="is_success lost")
def success(tracked, begun, ended):
    """Whether the tip has been on the target all the time, and no fault cuts that short; whether it has lost
    the target."""
    return where(ended > 0.0, 0.0, tracked), begun - tracked


@physics(gives="settle_term")
def settle_term(distance, tip_vx, tip_vy, slope_x, slope_y, reach):
    """0.08 (1 - saturation(|tip velocity - target velocity|, 1.6 reach) tolerance(distance, 0.1 reach))"""
    dx, dy = tip_vx - slope_x, tip_vy - slope_y
    return 0.08 * (1.0 - saturation(sqrt(dx * dx + dy * dy), 1.6 * reach) * tolerance(distance, 0.1 * reach))


@dataclass(frozen=True)
class TrackTask(ReachTask):
    """Follow a point that moves along an ellipse or a figure eight with the tip.

    Parameters
    ----------
    spread : float
        Radius of the disc in which centres of curves are drawn.
    smallest, largest : float
        Half length of the curves; their half width is 0.4 to 1 times that.
    period : float
        Time of a turn.
    wait : float
        Time for which the target stands still at first.
    rise : float
        Time in which it then comes up to speed.
    settle : float
        Time after which errors count.
    track_tolerance : float
        Largest distance from the target that counts as on it.
    """

    spread: float = 0.5
    smallest: float = 0.1
    largest: float = 0.3
    period: float = 3.0
    wait: float = 0.9
    rise: float = 0.4
    settle: float = 1.1
    track_tolerance: float = 0.01

    name = "Track"
    summary = "follows a point along a drawn curve with its tip"
    expert = "redundant_envs.control.experts.track:Track"
    baseline = "redundant_envs.control.experts.track_nearest:NearestPose"
    steps = 200
    draws = 8
    memory: ClassVar[tuple[str, ...]] = (*ReachTask.memory, "worst", *CURVE)
    moves = {"goal_x": "moved_x", "goal_y": "moved_y", "phase": "phase_next"}
    updates = {**ReachTask.updates, "worst": "worst_new"}
    metrics: ClassVar[tuple[str, ...]] = (*ReachTask.metrics, "lost", "worst", *CURVE)
    flags: ClassVar[tuple[str, ...]] = (*ReachTask.flags, "lost")
    held_outputs: ClassVar[tuple[str, ...]] = (*ReachTask.held_outputs, "lost")
    failures: ClassVar[Mapping[str, str]] = {"lost": "the tip lost the target"}
    successes = ("followed", "targets")
    angles = {
        "centre_a": ("centre_s", "centre_c"), "tilt_a": ("tilt_sine", "tilt_cosine"),
        "phase": ("phase_s", "phase_c"), "phase_next": ("next_s", "next_c"),
        **{f"ahead{k}": (f"ahead{k}_s", f"ahead{k}_c") for k in range(1, len(AHEAD) + 1)},
    }  # fmt: skip
    weights = (0.2, 0.26, 0.4)
    goal_functions = ()
    unused: ClassVar[tuple[str, ...]] = ("inner", "outer", "goal_tolerance", "hold_speed", "hold_steps")
    units = {
        **ReachTask.units,
        **dict.fromkeys(("spread", "smallest", "largest", "track_tolerance"), "reaches"),
        **dict.fromkeys(("period", "wait", "rise", "settle"), "s"),
    }

    ranges = {
        **ReachTask.ranges, "track_tolerance": (1e-9, 2.0),
        "period": (1e-3, 1e9),  # angles stay below those whose sines are exact
    }  # fmt: skip
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("smallest", "largest"),)

    def __post_init__(self) -> None:
        super().__post_init__()
        if (farthest := self.farthest + LONGEST * self.largest) > 1.0:
            raise ValueError(
                f"{type(self).__name__} draws targets as far as {farthest:g} reaches; give a smaller "
                "largest, or centres nearer to the base"
            )

    @property
    def farthest(self) -> float:
        """Largest distance of a centre from the base, in reaches."""
        return self.spread

    def begin_functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        of_curve = sizes([f"draw{k}" for k in range(1, 7)])
        return of_curve, centre_drawn, place, point_at("goal", "phase_s", "phase_c")

    def functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        numbers = range(1, len(AHEAD) + 1)
        return (
            *super().functions(scene), goal_error, next_phase, point_at("moved", "next_s", "next_c"), slope,
            observed_slope, phases_ahead, *map(observed_ahead, numbers),
            *(point_at(f"ahead{k}", f"ahead{k}_s", f"ahead{k}_c") for k in numbers),
        )  # fmt: skip

    def success_functions(self, scene: Scene) -> tuple[Callable[..., Any], ...]:
        return track_counter, begun, worst_error, tracked, success

    def distance_terms(self) -> tuple[Callable[..., Any], ...]:
        return terms_of_distance(self.weights, "track_tolerance", 2.0)

    @property
    def settling_term(self) -> Callable[..., Any]:
        return settle_term

    def observation(self, scene: Scene) -> dict[str, str]:
        return {
            **super().observation(scene),
            **{f"slope_{a}_obs": f"squash(target velocity {a} / (0.5 reach per s))" for a in "xy"},
            **{
                f"ahead{k}_{a}_obs": f"squash((target {a} in {steps} steps at this pace - tip) / (0.1 reach))"
                for k, steps in enumerate(AHEAD, start=1)
                for a in "xy"
            },
        }

    def path(self, known: Mapping[str, float]) -> list[tuple[float, float]]:
        """The curve of the target."""
        shape = [known[name] for name in SHAPE]
        angles = (TURN * k / PATH_POINTS for k in range(PATH_POINTS + 1))
        return [point_of(math.sin(a), math.cos(a), *shape) for a in angles]

    def success_note(self) -> str:
        return (
            '`info["is_success"]`, from the first step after the time `settle` on: whether the tip was\n'
            f"within {100 * self.track_tolerance:g} % of the full reach of the target at the end of every "
            'step since then, and no fault ends the episode;\n`info["worst"]` is the largest distance, m.'
        )

    def start_note(self) -> str:
        return (
            "The curve is an ellipse or a figure eight, half of each, with its centre within "
            f"{self.spread:g} of\nthe full reach and a half length of {self.smallest:g} to "
            f"{self.largest:g} of it. {self.course()}"
        )

    def course(self) -> str:
        """Text of a page: how the target moves."""
        return (
            f"The target\nstands still for {self.wait:g} s, comes up to speed within {self.rise:g} s, and "
            f"makes a turn in {self.period:g} s."
        )
