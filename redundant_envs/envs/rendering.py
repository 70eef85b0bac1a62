"""Pictures of an environment in plain NumPy: anti-aliased shapes and letters by their signed distances."""

import itertools
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium.error import DependencyNotInstalled, Error
from numpy.typing import NDArray

from redundant_envs.effects import CentringSpring, Effect, PointMass, shapes
from redundant_envs.envs.arguments import reach_of
from redundant_envs.envs.core import Core
from redundant_envs.model import parameters
from redundant_envs.robots.arm import Arm
from redundant_envs.scenes.files import read_yaml
from redundant_envs.scenes.scene import Scene
from redundant_envs.support import palette
from redundant_envs.support.extras import INSTALL
from redundant_envs.support.palette import Color
from redundant_envs.tasks.base import hard_stops

Points = NDArray[np.float64]
Pair = tuple[float, float]

SIZE = 480  # of a picture, px; sizes of letters and lines are for this one, and others have all in proportion
MARGIN = 16  # distance of texts from the border of the picture, px
LETTERS, SMALL_LETTERS = 13.0, 9.0  # heights of digits, px
BAR_WIDTH, BAR_HEIGHT, BAR_GAP = 96, 9, 6
BARS = "effort / limit"  # heading of the bars: each motor's effort as a fraction of its limit, from -1 to 1
HOLDING = {"hold", "is_success"}
"""Memory of a task that counts the steps in which the goal is held: the picture shows the time, green from
success on."""
TRAIL_LENGTH = 100
BORDER = 1.12  # half of a picture's width, in units of the distance from the base that it shows
GROUND = 0.25  # from one dot on the ground to the next, in units of the reach
FARTHEST = 1e4  # px: what ends farther away is not drawn, so that numbers may be of any size
MIN_LETTERS = 5.0  # px: lower ones cannot be read, and are left out
ARC, TICK = 24.0, 6.0  # px: radius of the travel of a joint that turns, and half the length of its ends
CAPITAL = 6.0  # height of a digit on the grid; the base line is at y = 6, and y points down
GAP = 1.5  # between two letters, in units of the grid
STROKE = 0.85  # width of a stroke, in units of the grid
GLYPHS: dict[str, tuple[float, str]] = read_yaml(Path(__file__).with_name("lettering.yaml"), "glyphs")
"""Character -> its width, and its strokes: points x,y joined by lines, strokes parted by semicolons."""
NO_DISPLAY = (
    "render_mode='human' needs a display, and there is none here; make the environment with "
    "render_mode='rgb_array', or write a clip: redundant-envs-train play ... --clip file.gif"
)
CHOICES = ("SDL_VIDEODRIVER", "SDL_VIDEO_DRIVER")
"""Variables with which a user chooses a driver, such as "dummy", that may have no display."""


class Canvas:
    """A picture with the base of the arm in its middle, drawn on ``pixels``, (height, width, 3) uint8. Its
    shorter side shows 2 ``half_width`` [m]. Sizes in px are for one of 480, where ``scale`` px are 1 m; in a
    picture whose shorter side is another, all are larger or smaller by ``unit``."""

    def __init__(self, half_width: float, pixels: NDArray[np.uint8]) -> None:
        self.pixels = pixels
        self.height, self.width = map(int, pixels.shape[:2])
        self.unit = min(self.width, self.height) / SIZE
        self.scale = SIZE / (2.0 * half_width)
        self._columns, self._rows = (np.arange(0.5, n, dtype=np.float32) for n in (self.width, self.height))

    def _pixel(self, point: Any) -> Pair:
        scale = self.unit * self.scale
        return self.width / 2 + scale * float(point[0]), self.height / 2 - scale * float(point[1])

    def _blend(self, low: Pair, high: Pair, color: Color, distance: Callable[[Any, Any], Any]) -> None:
        """Colour the inside of a shape, given by its signed distance [px] at x, y; nothing is drawn at a
        place without numbers, as after a fault."""
        if not np.isfinite((*low, *high)).all():
            return
        x0, y0 = (max(0, int(v) - 2) for v in low)
        x1, y1 = min(self.width, int(high[0]) + 3), min(self.height, int(high[1]) + 3)
        if x0 >= x1 or y0 >= y1:
            return
        cover = np.float32(0.5) - distance(self._columns[x0:x1], self._rows[y0:y1, None])
        np.clip(cover, 0.0, 1.0, out=cover)
        mix(self.pixels[y0:y1, x0:x1], cover, color)

    def capsule(self, a: Any, b: Any, width: float, color: Color) -> None:
        """A thick line with round ends; width in pixels."""
        (ax, ay), (bx, by) = ends = self._pixel(a), self._pixel(b)
        if not (np.abs(ends) <= FARTHEST).all():
            return
        r = self.unit * width / 2
        low, high = (min(ax, bx) - r, min(ay, by) - r), (max(ax, bx) + r, max(ay, by) + r)
        self._blend(low, high, color, lambda x, y: from_segment(x - ax, y - ay, bx - ax, by - ay) - r)

    def disc(self, center: Any, radius: float, color: Color, ring: float = 0.0) -> None:
        """A disc, or a ring of the given width; sizes in pixels."""
        cx, cy = self._pixel(center)
        radius, ring = self.unit * radius, self.unit * ring

        def distance(x: NDArray[np.float32], y: NDArray[np.float32]) -> Any:
            dx, dy = x - cx, y - cy
            d = np.sqrt(dx * dx + dy * dy) - radius
            return np.abs(d) - ring / 2 if ring else d

        r = radius + ring
        self._blend((cx - r, cy - r), (cx + r, cy + r), color, distance)

    def half_plane(self, point: Pair, normal: Pair, color: Color, edge: Color) -> None:
        """All beyond a straight edge, which has a colour of its own."""
        length = float(np.hypot(*normal)) or 1.0
        nx, ny = normal[0] / length, -normal[1] / length
        px, py = self._pixel(point)
        at = min(max(nx * px + ny * py, -FARTHEST), FARTHEST)  # beyond all corners on either side
        low, high, half = (0.0, 0.0), (self.width, self.height), np.float32(1.2 * self.unit)
        self._blend(low, high, color, lambda x, y: nx * x + ny * y - at)
        self._blend(low, high, edge, lambda x, y: np.abs(nx * x + ny * y - at) - half)

    def grid(self, place: Points, step: float, size: float, color: Color) -> None:
        """Dots at a place and every ``step`` [m] from it in both directions, behind all that has been drawn;
        their size in pixels."""
        pitch, (x, y) = self.unit * self.scale * step, self._pixel(place)
        if not (np.isfinite((x, y)).all() and pitch > 2.0):
            return
        weights = []
        for pixels, at in ((self._rows, y), (self._columns, x)):
            away = np.abs(np.remainder(pixels - at % pitch + 0.5 * pitch, pitch) - 0.5 * pitch)
            weights.append(np.clip(0.5 + 0.5 * self.unit * size - away, 0.0, 1.0))
        index = np.ix_(*(np.flatnonzero(weight) for weight in weights))
        patch = self.pixels[index]
        weight = (weights[0][:, None] * weights[1])[index] * (patch == palette.BACKGROUND).all(axis=2)
        mix(patch, weight.astype(np.float32), color)
        self.pixels[index] = patch

    def trail(self, points: Points, width: float, color: Color, faint: float, strong: float) -> None:
        """A line through points (n, 2) that fades towards the first; width in pixels. All its segments are
        drawn at once: along the longer of its two directions a segment has a pixel for each column, and
        across a few rows. Where segments overlap the stronger one shows."""
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < 2:
            return
        middle = np.array([self.width / 2, self.height / 2])
        at = (middle + (self.unit * self.scale) * points * (1.0, -1.0)).clip(-FARTHEST, FARTHEST)
        at = at.astype(np.float32)
        steep = np.abs(np.diff(at[:, 1])) > np.abs(np.diff(at[:, 0]))
        a, b = at[:-1].copy(), at[1:].copy()
        a[steep], b[steep] = a[steep, ::-1], b[steep, ::-1]
        r = self.unit * width / 2
        ends = np.where(steep, self.height, self.width)  # of its longer direction
        first = np.maximum(np.minimum(a[:, 0], b[:, 0]) - r - 1, 0).astype(int)
        last = np.minimum(np.maximum(a[:, 0], b[:, 0]) + r + 1, ends - 1).astype(int)
        counts = np.maximum(last - first + 1, 0)
        segment = np.repeat(np.arange(len(a)), counts)
        column = np.arange(len(segment)) - (np.cumsum(counts) - counts - first)[segment]
        (ax, ay), (dx, dy) = a[segment].T, (b - a)[segment].T
        x = column + np.float32(0.5) - ax
        along = np.clip(x / np.where(dx == 0.0, np.float32(1.0), dx), 0.0, 1.0)
        reach = int(np.ceil(1.5 * r)) + 1
        row = np.floor(ay + along * dy).astype(int)[:, None] + np.arange(-reach, reach + 1)
        y = row + np.float32(0.5) - ay[:, None]
        cover = 0.5 + r - from_segment(x[:, None], y, dx[:, None], dy[:, None])
        strength = faint + (strong - faint) * np.arange(1, len(a) + 1, dtype=np.float32) / len(a)
        cover = np.clip(cover, 0.0, 1.0) * strength[segment, None]
        turned = steep[segment, None]
        shown = (cover > 0.0) & (row >= 0) & (row < np.where(turned, self.width, self.height))
        column = np.broadcast_to(column[:, None], row.shape)
        index = np.where(turned, column * self.width + row, row * self.width + column)[shown]
        strongest = np.zeros(self.width * self.height, np.float32)
        np.maximum.at(strongest, index, cover[shown].astype(np.float32))
        flat = self.pixels.reshape(-1, 3)
        patch = flat[index]
        mix(patch, strongest[index], color)
        flat[index] = patch

    def text(
        self, text: str, x: float, y: float, color: Color, height: float = LETTERS, from_right: bool = False
    ) -> None:
        """A line of text with its upper left corner at (x, y), or its upper right one x from the right; px
        from the left, and from the top or, where y is negative, from the bottom. Letters of less than
        :data:`MIN_LETTERS` are left out."""
        if self.unit * height < MIN_LETTERS:
            return
        weight = cover(text, self.unit * height)
        rows, columns = weight.shape
        left, top = round(self.unit * x), round(self.unit * y) + (self.height if y < 0 else 0)
        left = self.width - left - columns if from_right else left
        y0, x0 = max(top, 0), max(left, 0)
        patch = self.pixels[y0 : top + rows, x0 : left + columns]
        mix(patch, weight[y0 - top :, x0 - left :][: patch.shape[0], : patch.shape[1]], color)

    def bars(self, values: Sequence[float]) -> None:
        """Values in [-1, 1] as horizontal bars in the lower left corner, numbered from 1, with a heading."""
        pitch, unit = BAR_HEIGHT + BAR_GAP, self.unit
        top = -MARGIN - len(values) * pitch  # from the bottom
        self.text(BARS, MARGIN - 2, top - 18, palette.INK, SMALL_LETTERS)
        left = MARGIN + (14 if len(values) < 10 else 22)
        middle = left + BAR_WIDTH // 2

        def box(low: float, high: float, upper: float, lower: float) -> Any:
            columns = slice(round(unit * low), max(round(unit * high), round(unit * low) + (high > low)))
            return self.pixels[self.height + round(unit * upper) : self.height + round(unit * lower), columns]

        for k, value in enumerate(values):
            upper, lower = top + k * pitch, top + k * pitch + BAR_HEIGHT
            self.text(str(k + 1), MARGIN - 2, upper - 3, palette.INK, SMALL_LETTERS)
            box(left, left + BAR_WIDTH, upper, lower)[...] = palette.BAR_TRACK
            value = value if np.isfinite(value) else 0.0
            end = middle + round(float(np.clip(value, -1.0, 1.0)) * BAR_WIDTH / 2)
            color = palette.BAR_PLUS if value >= 0 else palette.BAR_MINUS
            box(min(middle, end), max(middle, end), upper, lower)[...] = color
            box(middle, middle + 1, upper - 1, lower + 1)[...] = palette.JOINT


def from_segment(x: Any, y: Any, dx: Any, dy: Any) -> Any:
    """Distance of points from a segment, both relative to its start; (dx, dy) is its end."""
    s = (x * dx + y * dy) / np.maximum(dx * dx + dy * dy, np.float32(1e-9))
    s = np.maximum(np.minimum(s, 1.0), 0.0)
    ex, ey = x - s * dx, y - s * dy
    return np.sqrt(ex * ex + ey * ey)


@lru_cache(maxsize=512)
def cover(text: str, height: float) -> NDArray[np.float32]:
    """How much of each pixel a line of text covers, (rows, columns), 0 to 1; two are free around the text.
    ``height`` is that of a digit, px. ValueError if a character has no glyph."""
    if lacking := sorted(set(text) - GLYPHS.keys()):
        raise ValueError(f"text is {text!r}; there is no glyph for {''.join(lacking)!r} in GLYPHS")
    unit, left = height / CAPITAL, 2.0
    width = sum(GLYPHS[c][0] + GAP for c in text) - GAP
    rows, columns = int(np.ceil(height + 0.4 * height)) + 4, int(np.ceil(unit * width)) + 5
    x = np.arange(columns, dtype=np.float32) + np.float32(0.5)
    y = (np.arange(rows, dtype=np.float32) + np.float32(0.5))[:, None]
    nearest = np.full((rows, columns), np.inf, np.float32)
    for character in text:
        glyph_width, strokes = GLYPHS[character]
        for stroke in filter(None, strokes.split(";")):
            points = [tuple(map(float, pair.split(","))) for pair in stroke.split()]
            for (ax, ay), (bx, by) in itertools.pairwise(points):
                place = x - (left + unit * ax), y - (3.0 + unit * ay)
                away = from_segment(*place, unit * (bx - ax), unit * (by - ay))
                np.minimum(nearest, away, out=nearest)
        left += unit * (glyph_width + GAP)
    result = np.clip(np.float32(0.5 + 0.5 * STROKE * unit) - nearest, 0.0, 1.0)
    result.setflags(write=False)
    return result


def mix(patch: NDArray[np.uint8], weight: NDArray[np.float32], color: Color) -> None:
    """Blend a colour into an array of pixels (..., 3), each with its own weight."""
    difference = np.array(color, np.float32) - patch
    difference *= weight[..., None]
    difference += patch
    difference += np.float32(0.5)
    patch[...] = difference  # towards zero, so 0.5 more rounds


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
        """The arm with the ends of its travel, and its cables and loads."""
        draw_links(canvas, shapes.Pose(arm, q, {}), stated_limits(self.scene, known))
        for line in (x for x in scenery if isinstance(x, shapes.Line)):
            for a, b in itertools.pairwise(line.points):
                canvas.capsule(a, b, 3.0, palette.CABLE if line.taut else palette.SLACK)
        held: dict[Pair, float] = {}
        for load in (x for x in scenery if isinstance(x, shapes.Load)):
            total = held.get(load.place, 0.0) + load.mass
            if load.held:
                held[load.place] = total
            else:
                canvas.disc(load.place, _radius(total, arm) + 2.0, palette.WAITING, ring=2.5)
        for place, mass in held.items():
            canvas.disc(place, _radius(mass, arm), palette.LOAD)


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


class Renderer:
    """Draws the lanes of a core and keeps the trails of their tips, one point for each control step."""

    _shown: ClassVar[set["Renderer"]] = set()
    """Those that share the one window of a process, which closes with the last of them."""

    def __init__(self, core: Core, width: int = SIZE, height: int = SIZE) -> None:
        self.core = core
        self._drawing = Drawing(core.scene, width, height)
        self._tips = np.zeros((core.num_envs, TRAIL_LENGTH, 2))
        self._count = np.zeros(core.num_envs, dtype=int)
        self._last = np.full(core.num_envs, -1.0)
        self._pygame: Any = None  # once it is shown

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
        path = np.asarray(core.task.path(memory or {}))
        canvas.trail(path.reshape(-1, 2), 2.0, palette.GOAL, faint=0.4, strong=0.4)
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
        canvas.bars([effort if steps > 0 else 0.0 for effort in efforts])
        dt = scene.control_dt
        canvas.text(f"time {steps * dt:.2f} s", MARGIN, MARGIN, palette.INK)
        if {*core.task.memory, *core.task.metrics} >= HOLDING:
            hold, success = read(("hold", "is_success"))
            if hold > 0:
                held = f"held {hold * dt:.2f} s"
                canvas.text(held, MARGIN, MARGIN, palette.GOAL if success else palette.FAINT, from_right=True)
        return canvas.pixels

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Show a picture in the window, a control step after the last."""
        if self._pygame is None:
            self._pygame = display()
            self._clock = self._pygame.time.Clock()
            self._shown.add(self)
        pygame, size = self._pygame, (picture.shape[1], picture.shape[0])
        screen = pygame.display.get_surface()
        if screen is None or screen.get_size() != size:  # as after another one has closed it
            display().display.set_caption("redundant-envs")
            screen = pygame.display.set_mode(size)
        pygame.surfarray.blit_array(screen, picture.swapaxes(0, 1))
        pygame.event.pump()
        self._clock.tick(self.core.frames_per_second)
        pygame.display.flip()

    def close(self) -> None:
        """Close the window if no other environment is shown in it."""
        self._shown.discard(self)
        if self._pygame is not None and not self._shown:
            self._pygame.display.quit()
        self._pygame = None
