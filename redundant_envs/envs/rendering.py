"""Pictures of an environment in plain NumPy: anti-aliased shapes and letters by their signed distances."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from redundant_envs.envs.core import Core
from redundant_envs.files import read_yaml
from redundant_envs.robots.arm import Arm

Points = NDArray[np.float64]
Pair = tuple[float, float]
Color = tuple[int, int, int]

SIZE = 480
BACKGROUND = (250, 250, 248)
REACH = (228, 231, 236)
GOAL = (46, 160, 103)
TRAIL = (240, 140, 60)
LINKS = ((52, 73, 110), (86, 118, 168), (124, 157, 205), (168, 192, 226))
RAIL = (198, 204, 214)
JOINT = (28, 36, 52)
BAR_TRACK = (226, 229, 234)
BAR_PLUS = (70, 120, 190)
BAR_MINUS = (205, 92, 92)
INK = (74, 84, 104)
SOFT = (160, 166, 178)
MARGIN = 16  # distance of texts from the border of the picture, px
LETTERS, SMALL_LETTERS = 13.0, 9.0  # heights of digits, px
BAR_WIDTH, BAR_HEIGHT, BAR_GAP = 96, 9, 6
BARS = "effort / limit"  # heading of the bars: each motor's effort as a fraction of its limit, from -1 to 1
HOLDING = {"hold", "is_success"}
"""Memory of a task that counts the steps in which the goal is held: the picture shows the time, green from
success on."""
TRAIL_LENGTH = 100
CENTRES = np.arange(SIZE, dtype=np.float32) + np.float32(0.5)  # middles of the pixels of a row or a column
CAPITAL = 6.0  # height of a digit on the grid; the base line is at y = 6, and y points down
GAP = 1.5  # between two letters, in units of the grid
STROKE = 0.85  # width of a stroke, in units of the grid
GLYPHS: dict[str, tuple[float, str]] = read_yaml(Path(__file__).with_name("lettering.yaml"), "glyphs")
"""Character -> its width, and its strokes: points x,y joined by lines, strokes parted by semicolons."""


class Canvas:
    """A square picture with the base of the arm in its middle; (SIZE, SIZE, 3) uint8 in ``pixels``."""

    def __init__(self, half_width: float, background: NDArray[np.uint8] | None = None) -> None:
        if background is None:
            background = np.full((SIZE, SIZE, 3), BACKGROUND, dtype=np.uint8)
        self.pixels = background.copy()
        self.scale = SIZE / (2.0 * half_width)

    def _pixel(self, point: Points) -> Pair:
        return SIZE / 2 + self.scale * float(point[0]), SIZE / 2 - self.scale * float(point[1])

    def _blend(self, low: Pair, high: Pair, color: Color, distance: Callable[[Any, Any], Any]) -> None:
        """Colour the inside of a shape, given by its signed distance [px] at x, y."""
        x0, y0 = (max(0, int(v) - 2) for v in low)
        x1, y1 = (min(SIZE, int(v) + 3) for v in high)
        if x0 >= x1 or y0 >= y1:
            return
        cover = np.float32(0.5) - distance(CENTRES[x0:x1], CENTRES[y0:y1, None])
        np.minimum(cover, 1.0, out=cover)
        np.maximum(cover, 0.0, out=cover)
        mix(self.pixels[y0:y1, x0:x1], cover, color)

    def capsule(self, a: Points, b: Points, width: float, color: Color) -> None:
        """A thick line with round ends; width in pixels."""
        (ax, ay), (bx, by) = self._pixel(a), self._pixel(b)
        r = width / 2
        low, high = (min(ax, bx) - r, min(ay, by) - r), (max(ax, bx) + r, max(ay, by) + r)
        self._blend(low, high, color, lambda x, y: from_segment(x - ax, y - ay, bx - ax, by - ay) - r)

    def disc(self, center: Points, radius: float, color: Color, ring: float = 0.0) -> None:
        """A disc, or a ring of the given width; sizes in pixels."""
        cx, cy = self._pixel(center)

        def distance(x: NDArray[np.float32], y: NDArray[np.float32]) -> Any:
            dx, dy = x - cx, y - cy
            d = np.sqrt(dx * dx + dy * dy) - radius
            return np.abs(d) - ring / 2 if ring else d

        r = radius + ring
        self._blend((cx - r, cy - r), (cx + r, cy + r), color, distance)

    def trail(self, points: Points, width: float, color: Color, faint: float, strong: float) -> None:
        """A line through points (n, 2) that fades towards the first; width in pixels.

        All its segments are drawn at once: along the longer of its two directions a segment has a
        pixel for each column, and across a few rows. Where segments overlap the stronger one shows.
        """
        if len(points) < 2:
            return
        at = (SIZE / 2 + self.scale * points * (1.0, -1.0)).astype(np.float32)
        steep = np.abs(np.diff(at[:, 1])) > np.abs(np.diff(at[:, 0]))
        a, b = at[:-1].copy(), at[1:].copy()
        a[steep], b[steep] = a[steep, ::-1], b[steep, ::-1]
        r = width / 2
        first = np.maximum(np.minimum(a[:, 0], b[:, 0]) - r - 1, 0).astype(int)
        last = np.minimum(np.maximum(a[:, 0], b[:, 0]) + r + 1, SIZE - 1).astype(int)
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
        shown = (cover > 0.0) & (row >= 0) & (row < SIZE)
        turned = steep[segment, None]
        column = np.broadcast_to(column[:, None], row.shape)
        index = np.where(turned, column * SIZE + row, row * SIZE + column)[shown]
        strongest = np.zeros(SIZE * SIZE, np.float32)
        np.maximum.at(strongest, index, cover[shown].astype(np.float32))
        flat = self.pixels.reshape(-1, 3)
        patch = flat[index]
        mix(patch, strongest[index], color)
        flat[index] = patch

    def text(
        self, text: str, x: int, y: int, color: Color, height: float = LETTERS, from_right: bool = False
    ) -> None:
        """A line of text with its upper left corner, or its upper right one, at a pixel (x, y)."""
        weight = cover(text, height)
        rows, columns = weight.shape
        left = x - columns if from_right else x
        mix(self.pixels[y : y + rows, left : left + columns], weight, color)

    def bars(self, values: Sequence[float]) -> None:
        """Values in [-1, 1] as horizontal bars in the lower left corner, numbered from 1, with a heading."""
        pitch = BAR_HEIGHT + BAR_GAP
        top = SIZE - MARGIN - len(values) * pitch
        self.text(BARS, MARGIN - 2, top - 18, INK, SMALL_LETTERS)
        left = MARGIN + (14 if len(values) < 10 else 22)
        middle = left + BAR_WIDTH // 2
        for k, value in enumerate(values):
            row = slice(top + k * pitch, top + k * pitch + BAR_HEIGHT)
            self.text(str(k + 1), MARGIN - 2, row.start - 3, INK, SMALL_LETTERS)
            self.pixels[row, left : left + BAR_WIDTH] = BAR_TRACK
            end = middle + round(float(np.clip(value, -1.0, 1.0)) * BAR_WIDTH / 2)
            self.pixels[row, min(middle, end) : max(middle, end)] = BAR_PLUS if value >= 0 else BAR_MINUS
            self.pixels[row.start - 1 : row.stop + 1, middle] = JOINT


def from_segment(x: Any, y: Any, dx: Any, dy: Any) -> Any:
    """Distance of points from a segment, both relative to its start; (dx, dy) is its end."""
    s = (x * dx + y * dy) / np.maximum(dx * dx + dy * dy, np.float32(1e-9))
    s = np.maximum(np.minimum(s, 1.0), 0.0)
    ex, ey = x - s * dx, y - s * dy
    return np.sqrt(ex * ex + ey * ey)


@lru_cache(maxsize=512)
def cover(text: str, height: float) -> NDArray[np.float32]:
    """How much of each pixel a line of text covers, (rows, columns), 0 to 1; two are free around the text.

    ``height`` is that of a digit, px. ValueError if a character has no glyph.
    """
    lacking = sorted(set(text) - GLYPHS.keys())
    if lacking:
        raise ValueError(f"text is {text!r}; there is no glyph for {''.join(lacking)!r} in GLYPHS")
    unit, left = height / CAPITAL, 2.0
    width = sum(GLYPHS[c][0] + GAP for c in text) - GAP
    rows, columns = int(np.ceil(height + 0.4 * height)) + 4, int(np.ceil(unit * width)) + 5
    x = np.arange(columns, dtype=np.float32) + np.float32(0.5)
    y = (np.arange(rows, dtype=np.float32) + np.float32(0.5))[:, None]
    nearest = np.full((rows, columns), np.inf, np.float32)
    for character in text:
        own, strokes = GLYPHS[character]
        for stroke in filter(None, strokes.split(";")):
            points = [tuple(map(float, pair.split(","))) for pair in stroke.split()]
            for (ax, ay), (bx, by) in itertools.pairwise(points):
                away = from_segment(
                    x - (left + unit * ax), y - (3.0 + unit * ay), unit * (bx - ax), unit * (by - ay)
                )
                np.minimum(nearest, away, out=nearest)
        left += unit * (own + GAP)
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


def draw_links(canvas: Canvas, arm: Arm, q: Points, travel: Mapping[int, Pair]) -> None:
    """The links of an arm between its point masses; a slider's rail spans its ``travel`` [m]."""
    points = arm.points(q)
    ends = [np.zeros(2), *points]
    along = {k: (arm.points(q + np.eye(len(q))[k]) - points)[k] for k in arm.sliders()}
    link = -1
    for k, slides in enumerate(arm.prismatic):
        link += not slides
        color = LINKS[k % len(LINKS)]
        if k + 1 in along and k + 1 in travel:
            _rail(canvas, ends[k + 2] - q[k + 1] * along[k + 1], along[k + 1], travel[k + 1])
        if slides:
            if k == 0 and k in travel:
                _rail(canvas, ends[1] - q[0] * along[0], along[0], travel[0])
            across = 7.0 / canvas.scale * along[k]
            canvas.capsule(ends[k], ends[k + 1], max(8.0 - 2.0 * link, 4.0), color)
            sides, carriage = (ends[k + 1] - across, ends[k + 1] + across), max(13.0 - 2.0 * link, 7.0)
            canvas.capsule(*sides, carriage, LINKS[max(k - 1, 0) % len(LINKS)])
        else:
            width = 17.0 - 5.0 * link if any(arm.prismatic) else 17.0 - 3.0 * k + (k > 2)
            canvas.capsule(ends[k], ends[k + 1], max(width, 7.0), color)
    for k, slides in enumerate(arm.prismatic):
        if not slides:
            canvas.disc(ends[k], 4.5, JOINT)


def _rail(canvas: Canvas, start: Any, along: Any, travel: Pair) -> None:
    stops = [start + limit * along for limit in travel]
    canvas.capsule(stops[0], stops[1], 7.0, RAIL)
    across = 9.0 / canvas.scale * np.array([-along[1], along[0]])
    for stop in stops:
        canvas.capsule(stop - across, stop + across, 3.0, RAIL)


def load_pygame() -> Any:
    """The package pygame, or an error that names the extra to install."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pygame imports modules that Python has deprecated
            import pygame
    except ImportError as error:
        raise DependencyNotInstalled(
            "render_mode='human' needs pygame, which is not installed: pip install redundant-envs[human]"
        ) from error
    return pygame


class Window:
    """A square window for pictures (size, size, 3), at most ``fps`` a second: ``show`` waits for the next."""

    def __init__(self, size: int, fps: int) -> None:
        self._pygame = load_pygame()
        self._pygame.display.init()
        self._pygame.display.set_caption("redundant-envs")
        self._screen = self._pygame.display.set_mode((size, size))
        self._clock = self._pygame.time.Clock()
        self._fps = fps

    def show(self, picture: NDArray[np.uint8]) -> None:
        self._pygame.surfarray.blit_array(self._screen, picture.swapaxes(0, 1))
        self._pygame.event.pump()
        self._clock.tick(self._fps)
        self._pygame.display.flip()

    def close(self) -> None:
        self._pygame.display.quit()


class Renderer:
    """Draws the lanes of a core and keeps the trails of their tips, one point for each control step."""

    def __init__(self, core: Core) -> None:
        self.core = core
        self.half_width = 1.12 * core.reach
        canvas = Canvas(self.half_width)
        canvas.disc(np.zeros(2), canvas.scale * core.reach, REACH, ring=2.0)
        self._background = canvas.pixels
        self._tips = np.zeros((core.num_envs, TRAIL_LENGTH, 2))
        self._count = np.zeros(core.num_envs, dtype=int)
        self._last = np.full(core.num_envs, -1.0)
        self._window: Any = None

    def clear(self) -> None:
        """Forget all trails."""
        self._count[:] = 0
        self._last[:] = -1.0

    def record(self, steps: NDArray[np.float64], tips: NDArray[np.float64]) -> None:
        """Record the positions of all tips, (n, 2), and the steps of their episodes so far, (n,).

        A trail starts again with each episode.
        """
        stepped = (steps == self._last + 1.0) & (steps > 0.0)
        same = (steps == self._last) & (np.abs(self._tips[:, -1] - tips) < 1e-9).all(axis=1)
        self._count[~(stepped | same)] = 0
        self._tips[~same] = np.concatenate([self._tips, tips[:, None]], axis=1)[~same, 1:]
        self._count = np.minimum(self._count + ~same, TRAIL_LENGTH)
        self._last = steps.copy()

    def trail(self, lane: int) -> NDArray[np.float64]:
        """Positions of the tip of a lane at the last steps of its episode, (n, 2), the newest last."""
        return self._tips[lane, TRAIL_LENGTH - self._count[lane] :]

    def draw(self, lane: int, written: bool = True) -> NDArray[np.uint8]:
        """The picture of a lane, (480, 480, 3) uint8, with time, efforts and how long the goal was held.

        ``written=False`` leaves these out.
        """
        core, arm = self.core, self.core.scene.robot
        index = np.array([lane])

        def read(names: Sequence[str]) -> NDArray[np.float64]:
            return core.memory.read(tuple(names), index)[0]

        q, (steps, *efforts) = read(arm.coordinates), read(("steps", *core.actions))
        # The fields are those of the arm alone: what effects add to a mass is another number.
        numbers = read([core.memory.dynamics.field_of(n) for n in arm.parameter_values()]).tolist()
        own_arm: Any = type(arm)(tuple(numbers[: arm.num_masses]), tuple(numbers[arm.num_masses :]))
        ends = {k: names for k, names in core.scene.travel().items() if arm.prismatic[k]}
        travel: Any = {k: tuple(read(names).tolist()) for k, names in ends.items()}
        tip = own_arm.forward_kinematics(q)
        canvas = Canvas(self.half_width, self._background)
        base = np.zeros(2)
        canvas.trail(self.trail(lane), 3.0, TRAIL, faint=0.15, strong=0.9)
        draw_links(canvas, own_arm, q, travel)
        canvas.disc(base, 9.0, JOINT)
        canvas.disc(base, 4.0, BACKGROUND)
        canvas.disc(tip, 6.5, TRAIL)
        if core.goal_fields:
            goal, name = read(core.goal_fields), "goal_tolerance"
            radius = canvas.scale * core.reach * (read([name])[0] if name in core.memory else 0.0)
            canvas.disc(goal, max(radius, 3.0), GOAL)
            canvas.disc(goal, radius + 8.0, GOAL, ring=2.5)
        if not written:
            return canvas.pixels
        canvas.bars([effort if steps > 0 else 0.0 for effort in efforts])
        dt = core.scene.control_dt
        canvas.text(f"time {steps * dt:.2f} s", MARGIN, MARGIN, INK)
        if {*core.task.memory, *core.task.metrics} >= HOLDING:
            hold, success = read(("hold", "is_success"))
            if hold > 0:
                held = f"held {hold * dt:.2f} s"
                canvas.text(held, SIZE - MARGIN, MARGIN, GOAL if success else SOFT, from_right=True)
        return canvas.pixels

    def show(self, lane: int) -> None:
        """Show a lane in a window, in real time: one picture per control step."""
        if self._window is None:
            self._window = Window(SIZE, round(1.0 / self.core.scene.control_dt))
        self._window.show(self.draw(lane))

    def close(self) -> None:
        """Close the window if one is open."""
        if self._window is not None:
            self._window.close()
            self._window = None
