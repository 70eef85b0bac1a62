"""What tasks share in which no link may touch an obstacle."""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from redundant_envs.effects.hooks import Obstacle
from redundant_envs.effects.obstacles import closest_names, gap_of_link, least_of, numbers_of
from redundant_envs.language.algebra import maximum, minimum, numbered, physics, squash, tolerance, where
from redundant_envs.scenes.scene import Scene
from redundant_envs.tasks.reach import ReachTask, terms_of_distance

Function = Callable[..., Any]


def clearance_of_points(
    scene: Scene, points: Sequence[tuple[str, str]], names: Sequence[str]
) -> list[Function]:
    """Functions that give the least distance of points (x, y) from all obstacles under some names, m."""
    return [_of_point(scene, point, name) for point, name in zip(points, names, strict=True)]


def _of_point(scene: Scene, point: tuple[str, str], name: str) -> Function:
    obstacles = scene.attached.of(Obstacle)
    numbers = tuple(dict.fromkeys(name for o in obstacles for name in numbers_of(o)))

    @physics(gives=name, takes=(*point, *numbers))
    def clearance_of_point(x: Any, y: Any, *values: Any) -> Any:
        known = dict(zip(numbers, values, strict=True))
        return functools.reduce(minimum, [gap_of_link(o, (x, y, x, y), known) for o in obstacles])

    return clearance_of_point


def struck_within(closest: Sequence[str]) -> Function:
    """Whether a link has touched an obstacle in this step, and whether one ever has."""

    @physics(gives="cost struck_new", takes=("struck", *closest))
    def struck_within(struck: Any, *values: Any) -> Any:
        now = where(functools.reduce(minimum, values) < 0.0, 1.0, 0.0)
        return now, where(struck + now > 0.0, 1.0, 0.0)

    return struck_within


@physics(gives="unharmed")
def unharmed(struck_new):
    """Share of the reward that is left after a touch."""
    return 1.0 - 0.5 * struck_new


@physics(gives="clear_term")
def clear_term(clearance, clear_margin, reach):
    """0.1 tolerance(max(clear_margin reach - clearance, 0), clear_margin reach)"""
    return 0.1 * tolerance(maximum(clear_margin * reach - clearance, 0.0), clear_margin * reach)


@physics(gives="struck_obs")
def observed_touch(struck):
    return struck


def observed_distances(obstacle: int, links: int) -> Function:
    names = [f"clearance{obstacle}_{link + 1}" for link in range(links)]

    @physics(gives=[f"{name}_obs" for name in names], takes=(*names, "reach"))
    def observed_distances(*values: Any) -> Any:
        *distances, reach = values
        return tuple(squash(distance, 0.1 * reach) for distance in distances)

    return observed_distances


def observed_disc(obstacle: int, key: str) -> Function:
    @physics(
        gives=[f"disc{obstacle}_{what}_obs" for what in "xyr"],
        takes=(f"{key}.centre[0]", f"{key}.centre[1]", f"{key}.radius", "reach"),
    )
    def observed_disc(x: Any, y: Any, radius: Any, reach: Any) -> Any:
        return squash(x, reach), squash(y, reach), squash(radius, 0.1 * reach)

    return observed_disc


def discs_of(scene: Scene) -> dict[int, str]:
    """Numbers and keys of the obstacles of a scene that are discs."""
    obstacles = enumerate(scene.attached.of(Obstacle), start=1)
    return {k: o.key for k, o in obstacles if {"centre[0]", "radius"} <= o.effect.parameters().keys()}


@dataclass(frozen=True)
class AmongObstacles(ReachTask):
    """A task in which no link may touch an obstacle: the arm starts hanging, and a touch halves the reward.

    Parameters
    ----------
    clear_margin : float
        Distance of the links from the obstacles below which the reward falls.
    hang_low, hang_high : float
        Range of the first joint at the start: the arm hangs.
    bend : float
        Half width of the start angles of the other revolute joints.
    terminate_on_touch : bool
        Whether a touch ends the episode.
    """

    clear_margin: float = 0.04
    hang_low: float = -1.72
    hang_high: float = -1.42
    bend: float = 0.15
    terminate_on_touch: bool = False

    static = ("terminate_on_touch",)
    unused: ClassVar[tuple[str, ...]] = ("start_angle",)
    memory: ClassVar[tuple[str, ...]] = (*ReachTask.memory, "struck")
    updates = {**ReachTask.updates, "struck": "struck_new"}
    metrics: ClassVar[tuple[str, ...]] = (*ReachTask.metrics, "struck_new", "cost", "clearance")
    flags: ClassVar[tuple[str, ...]] = (*ReachTask.flags, "struck_new")
    labels = {**ReachTask.labels, "struck_new": "struck"}
    summed: ClassVar[tuple[str, ...]] = ("cost",)
    failures: ClassVar[Mapping[str, str]] = {"struck": "a link touched an obstacle"}
    held_outputs: ClassVar[tuple[str, ...]] = (*ReachTask.held_outputs, "struck_new", "cost")
    units = {
        **ReachTask.units, "clear_margin": "reaches",
        **dict.fromkeys(("hang_low", "hang_high", "bend"), "rad"),
    }  # fmt: skip
    ranges = {
        **ReachTask.ranges, **dict.fromkeys(("hang_low", "hang_high"), (-1e6, 1e6)),
        "bend": (0.0, 1e6), "clear_margin": (1e-9, 2.0),
    }  # fmt: skip
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("hang_low", "hang_high"),)

    @property
    def ends(self) -> tuple[str, ...]:  # type: ignore[override]
        return ("struck_new",) if self.terminate_on_touch else ()

    def start_range(self, scene: Scene, joint: int) -> tuple[str, str]:
        if scene.robot.prismatic[joint]:
            return super().start_range(scene, joint)
        return ("hang_low", "hang_high") if joint == 0 else ("-bend", "bend")

    def functions(self, scene: Scene) -> tuple[Function, ...]:
        count, links = len(scene.attached.of(Obstacle)), scene.robot.num_masses
        if not count:
            raise ValueError(
                f"the task {self.name} needs obstacles; add KeepOut(centre, radius), Disc or HalfPlane to "
                "the scene's effects"
            )
        return (
            *super().functions(scene), least_of(numbered("clearance{}", count), "clearance"),
            struck_within(closest_names(scene.attached)), unharmed, observed_touch,
            *(observed_distances(k, links) for k in range(1, count + 1)),
            *(observed_disc(k, key) for k, key in discs_of(scene).items()),
        )  # fmt: skip

    def reward_functions(self, scene: Scene) -> tuple[Function, ...]:
        others = super().reward_functions(scene)[len(self.weights) :]
        return (*self.distance_terms(), clear_term, *others)

    def distance_terms(self) -> tuple[Function, ...]:
        return terms_of_distance(self.weights, factor="unharmed")

    def observation(self, scene: Scene) -> dict[str, str]:
        links = scene.robot.num_masses
        of_discs = {
            f"disc{k}_{what}_obs": f"squash({meaning} of disc {k} / {scale})"
            for k in discs_of(scene)
            for what, meaning, scale in (
                ("x", "centre x", "reach"), ("y", "centre y", "reach"), ("r", "radius", "(0.1 reach)"),
            )
        }  # fmt: skip
        distances = {
            f"clearance{k}_{j}_obs": f"squash(distance of link {j} from obstacle {k} / (0.1 reach))"
            for k in range(1, len(scene.attached.of(Obstacle)) + 1)
            for j in range(1, links + 1)
        }
        touch = {"struck_obs": "1 once a link has touched an obstacle, else 0"}
        return {**super().observation(scene), **of_discs, **distances, **touch}

    def pose_note(self) -> str:
        first = f"{self.hang_low:g} to {self.hang_high:g} rad"
        return f"the first joint in {first}, other joint angles uniform in +-{self.bend:g} rad"

    def end_note(self) -> str:
        return f"a touch{'' if self.terminate_on_touch else ', with `terminate_on_touch`'}, or"

    def success_note(self) -> str:
        return (
            f"{super().success_note()}\nAn episode in which a link touches an obstacle is no success: "
            '`info["struck"]`, and `info["cost"]` is 1 in each step with a touch, between its ends, too.'
        )


@physics(gives="is_success")
def untouched_success(hold_new, hold_steps, struck_new, ended):
    return where(struck_new + ended > 0.0, 0.0, where(hold_new >= hold_steps, 1.0, 0.0))
