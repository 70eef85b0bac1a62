"""Pictures of an environment: the arm with what its scene has around it, and the window."""

import itertools
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np
from gymnasium.error import DependencyNotInstalled, Error
from numpy.typing import NDArray

from redundant_envs.effects import CentringSpring, Effect, PointMass, shapes
from redundant_envs.effects.hooks import Sensing
from redundant_envs.envs.arguments import reach_of
from redundant_envs.envs.canvas import MARGIN, SIZE, SMALL_LETTERS, Canvas, Pair, Points
from redundant_envs.envs.core import Core
from redundant_envs.model import parameters
from redundant_envs.model.energy import scene_quantities
from redundant_envs.robots.arm import Arm
from redundant_envs.scenes.scene import Scene
from redundant_envs.simulator.lane.sensing import measured
from redundant_envs.support import palette
from redundant_envs.support.extras import INSTALL
from redundant_envs.tasks.base import Task, hard_stops

HOLDING = {"hold", "is_success"}
"""Memory of a task that counts the steps in which the goal is held: the picture shows the time, green from
success on."""
TRAIL_LENGTH = 100
BORDER = 1.12  # half of a picture's width, in units of the distance from the base that it shows
GROUND = 0.25  # from one dot on the ground to the next, in units of the reach
HEAD = 9.0  # px: of an arrow
ARC, TICK = 24.0, 6.0  # px: radius of the travel of a joint that turns, and half the length of its ends
NO_DISPLAY = (
    "render_mode='human' needs a display, and there is none here; make the environment with "
    "render_mode='rgb_array', or write a clip: redundant-envs-train play ... --clip file.gif"
)
CHOICES = ("SDL_VIDEODRIVER", "SDL_VIDEO_DRIVER")
"""Variables with which a user chooses a driver, such as "dummy", that may have no display."""
FACTORS = dict.fromkeys(("up", "+", "=", "[+]"), 2.0) | dict.fromkeys(("down", "-", "[-]"), 0.5)
"""Of the speed of the window, by the names that pygame gives keys; those of the number pad have brackets."""
FASTEST = 8.0  # speed of the window; its inverse is the slowest


def draw_links(canvas: Canvas, pose: shapes.Pose, travel: Mapping[int, Pair]) -> None:
    """The links of an arm between its point masses; rails and arcs are the ``travel`` of its joints, in m and
    rad. Without a mass behind each joint they are a line through the masses."""
    arm, q, ends = pose.arm, pose.q, np.array(pose.ends)
    if not pose.shows_joints:
        for k, (a, b) in enumerate(itertools.pairwise(ends)):
            canvas.capsule(a, b, max(17.0 - 3.0 * k, 7.0), palette.LINKS[k % len(palette.LINKS)])
        return
    for k, stops in travel.items():
        if not arm.prismatic[k]:
            _arc(canvas, pose, k, stops)
    along = {k: (arm.points(q + np.eye(len(q))[k]) - ends[1:])[k] for k in arm.sliders()}
    link = -1
    for k, slides in enumerate(arm.prismatic):
        link += not slides
        color = palette.LINKS[k % len(palette.LINKS)]
        for j in (1, 0) if k == 0 else (k + 1,):  # behind this link, that of the next slider
            if j in along and j in travel:
                _rail(canvas, ends[j + 1] - q[j] * along[j], along[j], travel[j])
        width = 17.0 - 5.0 * link if any(arm.prismatic) else 17.0 - 3.0 * k + (k > 2)
        width = max(8.0 - 2.0 * link, 4.0) if slides else max(width, 7.0)
        canvas.capsule(ends[k], ends[k + 1], width, color)
        if slides:
            across = 7.0 / canvas.scale * along[k]
            sides, carriage = (ends[k + 1] - across, ends[k + 1] + across), max(13.0 - 2.0 * link, 7.0)
            canvas.capsule(*sides, carriage, palette.LINKS[max(k - 1, 0) % len(palette.LINKS)])
    for k, slides in enumerate(arm.prismatic):
        if not slides:
            canvas.disc(ends[k], 4.5, palette.JOINT)


def _rail(canvas: Canvas, start: Any, along: Any, travel: Pair) -> None:
    stops = [start + limit * along for limit in travel if np.isfinite(limit)]
    canvas.capsule(stops[0], stops[-1], 7.0, palette.RAIL)
    across = 9.0 / canvas.scale * np.array([-along[1], along[0]])
    for stop in stops:
        canvas.capsule(stop - across, stop + across, 3.0, palette.RAIL)


def _arc(canvas: Canvas, pose: shapes.Pose, joint: int, travel: Pair) -> None:
    """Directions that the link behind a revolute joint can have, around the joint."""
    stops = [float(end) for end in travel if np.isfinite(end)]
    if (len(stops) == 2 and stops[1] - stops[0] >= 2.0 * np.pi) or not np.isfinite(pose.q).all():
        return  # a whole turn, or a fault
    ends = pose.moved(joint, np.linspace(stops[0], stops[-1], 33))
    way = ends[:, joint + 1] - ends[:, joint]
    length = np.hypot(*way.T)
    if not length.all():
        return
    way /= length[:, None]
    at, px = ends[0, joint], 1.0 / canvas.scale
    if len(stops) == 2:
        canvas.trail(at + ARC * px * way, 4.0, palette.RAIL, faint=1.0, strong=1.0)
    for direction in way[:: len(way) - 1][: len(stops)]:
        inner, outer = (at + radius * px * direction for radius in (ARC - TICK, ARC + TICK))
        canvas.capsule(inner, outer, 3.0, palette.RAIL)


def _arrow(canvas: Canvas, points: Points) -> None:
    """A line with a head, which is left out where the line is too short to have one."""
    canvas.trail(points, 3.0, palette.FORCE, faint=1.0, strong=1.0)
    way = points[-1] - points[-2]
    length = float(np.hypot(*way))
    if canvas.scale * float(np.hypot(*np.diff(points, axis=0).T).sum()) < HEAD or not length:
        return
    for turn in (2.6, -2.6):
        c, s = np.cos(turn), np.sin(turn)
        side = HEAD / canvas.scale * np.array([c * way[0] - s * way[1], s * way[0] + c * way[1]]) / length
        canvas.capsule(points[-1], points[-1] + side, 3.0, palette.FORCE)


def stated_limits(scene: Scene, known: Mapping[str, float] | None = None) -> dict[int, Pair]:
    """Travel of the joints that have any, from the numbers of the scene, or of one environment: joint ->
    (lower, upper), m or rad; an end without a stop is infinite. The report's centring spring names limits
    too, although it does not enforce them."""
    values = scene.parameters() if known is None else known
    names = {joint: (low, high) for joint, low, high in hard_stops(scene)} | scene.travel()
    for effect in scene.effects:
        if isinstance(effect, CentringSpring):
            for i, joint in enumerate(scene.robot.sliders()):
                names[joint] = f"{effect.key}.lower[{i}]", f"{effect.key}.upper[{i}]"
    return {joint: (float(values[low]), float(values[high])) for joint, (low, high) in names.items()}


class Drawing:
    """An arm with all that its scene has around it, in pictures of a size."""

    def __init__(self, scene: Scene, width: int = SIZE, height: int = SIZE) -> None:
        self.scene = scene
        self._empty = np.full((height, width, 3), palette.BACKGROUND, dtype=np.uint8)
        every = [*scene.parameters(), *scene.states()]
        self._shown = [
            (e, {n.removeprefix(f"{e.key}."): n for n in every if n.startswith(f"{e.key}.")})
            for e in scene.effects
            if type(e).shapes is not Effect.shapes
        ]
        self._masses = [(a.hook.point.number, a.parameter(a.hook.mass)) for a in scene.attached.of(PointMass)]
        self._background: tuple[Any, Any] = (None, None)

    def surroundings(self, arm: Arm, q: Points, known: Mapping[str, float]) -> list[shapes.Shape]:
        """What effects show, from all numbers and states of the scene by name."""
        scenery = shapes.shapes_of(self._shown, arm, q, known)
        if self._masses:
            points = shapes.Pose(arm, q, {}).points
            scenery += [shapes.Load(points[n], known[name]) for n, name in self._masses if known[name] > 0.0]
        return scenery

    def begun(
        self, scenery: Sequence[shapes.Shape], reach: float, border: float = BORDER, least: float = 0.0
    ) -> Canvas:
        """A canvas for an arm of a reach, with ground, obstacles and the reach; it shows ``least`` [m] around
        the base at least."""
        half_width = border * (max(shapes.seen_with(scenery, reach), least) or 1.0)
        behind = tuple(x for x in scenery if isinstance(x, shapes.Circle | shapes.HalfSpace))
        made_for = (half_width, reach, behind)
        if self._background[0] != made_for:
            canvas = Canvas(half_width, self._empty.copy())
            for plane in (x for x in behind if isinstance(x, shapes.HalfSpace)):
                canvas.half_plane(plane.point, plane.normal, palette.OBSTACLE, palette.EDGE)
            canvas.disc((0.0, 0.0), canvas.scale * reach, palette.REACH, ring=2.0)
            for circle in (x for x in behind if isinstance(x, shapes.Circle)):
                radius = max(canvas.scale * circle.radius, 4.0)
                canvas.disc(circle.centre, radius, palette.OBSTACLE if radius > 4.0 else palette.EDGE)
                canvas.disc(circle.centre, radius, palette.EDGE, ring=2.4)
            self._background = made_for, canvas.pixels
        canvas = Canvas(half_width, self._background[1].copy())
        if moved := [x.displacement for x in scenery if isinstance(x, shapes.Ground)]:
            canvas.grid(-np.sum(moved, axis=0), GROUND * reach, 4.0, palette.GRID)
        return canvas

    def arm(
        self, canvas: Canvas, arm: Arm, q: Points, known: Mapping[str, float], scenery: Sequence[shapes.Shape]
    ) -> None:
        """The arm with its travel, springs, cables, loads, forces on it, and the pose that sensors read."""
        draw_links(canvas, shapes.Pose(arm, q, {}), stated_limits(self.scene, known))
        for line in (x for x in scenery if isinstance(x, shapes.Line)):
            for a, b in itertools.pairwise(line.points):
                canvas.capsule(a, b, 3.0, palette.CABLE if line.taut else palette.SLACK)
        for spring in (x for x in scenery if isinstance(x, shapes.Spring)):
            canvas.trail(np.array(spring.points), 1.8, palette.CABLE, faint=1.0, strong=1.0)
        held: dict[Pair, float] = {}
        for load in (x for x in scenery if isinstance(x, shapes.Load)):
            total = held.get(load.place, 0.0) + load.mass
            if load.held:
                held[load.place] = total
            else:
                canvas.disc(load.place, _radius(total, arm) + 2.0, palette.WAITING, ring=2.5)
        for place, mass in held.items():
            canvas.disc(place, _radius(mass, arm), palette.LOAD)
        for arrow in (x for x in scenery if isinstance(x, shapes.Arrow)):
            _arrow(canvas, np.array(arrow.points))
        if self.scene.attached.of(Sensing) and np.isfinite(q).all():
            read = measured(self.scene.attached, arm, scene_quantities(self.scene, q, parameters=known))
            points = shapes.Pose(arm, np.array([float(read[name]) for name in arm.coordinates]), {}).ends
            canvas.trail(np.array(points), 2.0, palette.READING, faint=1.0, strong=1.0)
            canvas.disc(points[-1], 11.0, palette.READING, ring=2.0)


def points_of(task: Task, known: Mapping[str, float]) -> Points:
    """The points of a task's path, (n, 2); ValueError unless it gives points."""
    path = np.asarray(task.path(known), dtype=np.float64)
    if path.size and (path.ndim != 2 or path.shape[1] != 2):
        raise ValueError(f"{type(task).__name__}.path gives {task.path(known)!r}; give points, [(x, y), ...]")
    return path.reshape(-1, 2)


def _radius(mass: float, arm: Arm) -> float:
    """Radius of a load, px: its square beyond the tip's dot shows the mass, up to 4 of the arm's heaviest."""
    return 8.5 + 6.0 * float(np.sqrt(min(mass / max(arm.masses), 4.0)))


def display() -> Any:
    """pygame with its display begun; an error names the extra to install. NoDisplay where there is none: SDL
    would draw into nothing."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pygame imports modules that Python has deprecated
            import pygame
    except ImportError as error:
        raise DependencyNotInstalled(
            f"render_mode='human' needs pygame, which is not installed; {INSTALL.format('human')}"
        ) from error
    try:
        pygame.display.init()
    except pygame.error as error:
        raise NoDisplay(NO_DISPLAY) from error
    if pygame.display.get_driver() == "offscreen" and not any(map(os.environ.get, CHOICES)):
        pygame.display.quit()
        raise NoDisplay(NO_DISPLAY)
    return pygame


class NoDisplay(Error, OSError):
    """There is no display to open a window on."""


@dataclass
class Pace:
    """What the keys of the window have set: its speed, 1 in real time, and whether it is paused."""

    speed: float = 1.0
    paused: bool = False
    steps: int = 0  # that were asked for and are not yet made

    def goes_on(self, pygame: Any) -> bool:
        """Whether the next picture may come, after the keys that were pressed; a window that was asked to
        close does not pause. Other keys, and that request, stay in the queue for programs that read them."""
        for event in pygame.event.get(pygame.KEYDOWN):
            key = pygame.key.name(event.key)
            if key == "space":
                self.paused = not self.paused
            elif key == "right":
                self.steps += 1
            elif key in FACTORS:
                self.speed = min(max(self.speed * FACTORS[key], 1.0 / FASTEST), FASTEST)
            else:
                pygame.event.post(event)
        if pygame.event.peek(pygame.QUIT):
            self.paused = False
        if self.steps:
            self.steps -= 1
            return True
        return not self.paused

    def written(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The picture with pause and speed in its lower right corner; itself in real time."""
        words = ["paused"] * self.paused + [f"speed {Fraction(self.speed)}"] * (self.speed != 1.0)
        if not words:
            return picture
        canvas = Canvas(1.0, picture.copy())
        line = " - ".join(words)
        canvas.text(line, MARGIN, -MARGIN - SMALL_LETTERS, palette.INK, SMALL_LETTERS, from_right=True)
        return canvas.pixels


class Renderer:
    """Draws the lanes of a core and keeps the trails of their tips, one point for each control step."""

    _shown: ClassVar[set["Renderer"]] = set()
    """Those that share the one window of a process, which closes with the last of them."""
    _pace: ClassVar[Pace] = Pace()

    def __init__(self, core: Core, width: int = SIZE, height: int = SIZE) -> None:
        self.core = core
        self._drawing = Drawing(core.scene, width, height)
        self._tips = np.zeros((core.num_envs, TRAIL_LENGTH, 2))
        self._count = np.zeros(core.num_envs, dtype=int)
        self._last = np.full(core.num_envs, -1.0)
        self._pygame: Any = None  # once it is shown
        self._unseen = 0  # steps since the last that the window was due to show

    def clear(self) -> None:
        """Forget all trails."""
        self._count[:] = 0
        self._last[:] = -1.0

    def record(self, steps: NDArray[np.float64], tips: NDArray[np.float64]) -> None:
        """Record the positions of all tips, (n, 2), and the steps of their episodes so far, (n,); a trail
        starts again with each episode."""
        stepped = (steps > self._last) & (steps <= self._last + self.core.decide_every) & (steps > 0.0)
        same = (steps == self._last) & (np.abs(self._tips[:, -1] - tips) < 1e-9).all(axis=1)
        self._count[~(stepped | same)] = 0
        self._tips[~same] = np.concatenate([self._tips, tips[:, None]], axis=1)[~same, 1:]
        self._count = np.minimum(self._count + ~same, TRAIL_LENGTH)
        self._last = steps.copy()

    def trail(self, lane: int) -> NDArray[np.float64]:
        """Positions of the tip of a lane at the last steps of its episode, (n, 2), the newest last."""
        return self._tips[lane, TRAIL_LENGTH - self._count[lane] :]

    def draw(self, lane: int, written: bool = True) -> NDArray[np.uint8]:
        """The picture of a lane, (height, width, 3) uint8; if ``written`` with time, efforts and how long the
        goal was held."""
        core, scene, arm = self.core, self.core.scene, self.core.scene.robot
        index = np.array([lane])

        def read(names: Sequence[str]) -> NDArray[np.float64]:
            return core.memory.read(tuple(names), index)[0]

        q, (steps, *efforts) = read(arm.coordinates), read(("steps", *core.episode.efforts))
        present = parameters.present(core.memory, index, scene.parameters())
        states = tuple(core.memory.dynamics.effect_states)
        known = {name: float(x[0]) for name, x in present.items()}
        known |= zip(states, read(states).tolist(), strict=True)
        numbers = [known[name] for name in arm.parameter_values()]
        own_arm: Any = type(arm)(tuple(numbers[: arm.num_masses]), tuple(numbers[arm.num_masses :]))
        reach = float(reach_of(scene, known))
        tip, base = own_arm.forward_kinematics(q), (0.0, 0.0)
        if not np.isfinite(reach):  # of an arm with a slider without an end
            reach = float(np.hypot(*tip))
        scenery = self._drawing.surroundings(own_arm, q, known)
        # Environments with other lengths are drawn to the same scale, unless theirs are larger.
        canvas = self._drawing.begun(scenery, reach, least=core.reach if np.isfinite(core.reach) else 0.0)
        memory = core.task.memory and dict(
            zip(core.task.memory, read(core.task.memory).tolist(), strict=True)
        )
        canvas.trail(points_of(core.task, memory or {}), 2.0, palette.GOAL, faint=0.4, strong=0.4)
        canvas.trail(self.trail(lane), 3.0, palette.TRAIL, faint=0.15, strong=0.9)
        self._drawing.arm(canvas, own_arm, q, known, scenery)
        canvas.disc(base, 9.0, palette.JOINT)
        canvas.disc(base, 4.0, palette.BACKGROUND)
        canvas.disc(tip, 6.5, palette.TRAIL)
        if core.goal_fields:
            goal, name = read(core.goal_fields), "goal_tolerance"
            radius = canvas.scale * reach * (read([name])[0] if name in core.memory else 0.0)
            canvas.disc(goal, max(radius, 3.0), palette.GOAL)
            canvas.disc(goal, radius + 8.0, palette.GOAL, ring=2.5)
        if not written:
            return canvas.pixels
        canvas.bars([effort if steps > 0 else 0.0 for effort in efforts], arm.joints)
        dt = scene.control_dt
        canvas.text(f"time {steps * dt:.2f} s", MARGIN, MARGIN, palette.INK)
        if {*core.task.memory, *core.task.metrics} >= HOLDING:
            hold, success = read(("hold", "is_success"))
            if hold > 0:
                held = f"held {hold * dt:.2f} s"
                canvas.text(held, MARGIN, MARGIN, palette.GOAL if success else palette.FAINT, from_right=True)
        return canvas.pixels

    def is_due(self) -> bool:
        """Whether the window shows a step: each, but one of 2, 4 or 8 at so many times the speed."""
        self._unseen += 1
        if self._unseen < self._pace.speed and not self._pace.paused:
            return False
        self._unseen = 0
        return True

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Show a picture in the window, a control step after the last; during a pause, until a key asks for
        the next."""
        if self._pygame is None:
            self._pygame = display()
            self._clock = self._pygame.time.Clock()
            self._shown.add(self)
        pygame, pace, size = self._pygame, self._pace, (picture.shape[1], picture.shape[0])
        screen = pygame.display.get_surface()
        if screen is None or screen.get_size() != size:  # as after another one has closed it
            display().display.set_caption("redundant-envs")
            screen = pygame.display.set_mode(size)
        goes_on = False
        while not goes_on:
            goes_on = pace.goes_on(pygame)
            pygame.surfarray.blit_array(screen, pace.written(picture).swapaxes(0, 1))
            self._clock.tick(self.core.frames_per_second * min(pace.speed, 1.0))
            pygame.display.flip()

    def close(self) -> None:
        """Close the window if no other environment is shown in it."""
        self._shown.discard(self)
        if self._pygame is not None and not self._shown:
            self._pygame.display.quit()
            Renderer._pace = Pace()
        self._pygame = None
