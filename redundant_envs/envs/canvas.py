"""A picture of anti-aliased shapes and letters, by their signed distances, in plain NumPy."""

import itertools
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.scenes.files import read_yaml
from redundant_envs.support import palette
from redundant_envs.support.palette import Color

Points = NDArray[np.float64]
Pair = tuple[float, float]


SIZE = 480  # of a picture, px; sizes of letters and lines are for this one, and others have all in proportion
MARGIN = 16  # distance of texts from the border of the picture, px
LETTERS, SMALL_LETTERS = 13.0, 9.0  # heights of digits, px
BAR_WIDTH, BAR_HEIGHT, BAR_GAP = 96, 9, 6
LONGEST_NAME = 12  # letters of a bar's name
BARS = "effort / limit"  # heading of the bars: each motor's effort as a fraction of its limit, from -1 to 1
FARTHEST = 1e4  # px: what ends farther away is not drawn, so that numbers may be of any size
MIN_LETTERS = 5.0  # px: lower ones cannot be read, and are left out
CAPITAL = 6.0  # height of a digit on the grid; the base line is at y = 6, and y points down
GAP = 1.5  # between two letters, in units of the grid
STROKE = 0.85  # width of a stroke, in units of the grid
GLYPHS: dict[str, tuple[float, str]] = read_yaml(Path(__file__).with_name("lettering.yaml"), "glyphs")
"""Character -> its width, and its strokes: points x,y joined by lines, strokes parted by semicolons."""


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

    def bars(self, values: Sequence[float], names: Sequence[str]) -> None:
        """Values in [-1, 1] as horizontal bars in the lower left corner, with names and a heading; in
        small letters, or as numbers from 1 if one is long, or has a letter without a glyph."""
        names = [name.lower() for name in names]
        if any(len(name) > LONGEST_NAME or set(name) - GLYPHS.keys() for name in names):
            names = [str(k + 1) for k in range(len(names))]
        pitch, unit = BAR_HEIGHT + BAR_GAP, self.unit
        top = -MARGIN - len(values) * pitch  # from the bottom
        self.text(BARS, MARGIN - 2, top - 18, palette.INK, SMALL_LETTERS)
        widest = max((cover(name, self.unit * SMALL_LETTERS).shape[1] for name in names), default=0)
        left = MARGIN + round(widest / self.unit) + 6
        middle = left + BAR_WIDTH // 2

        def box(low: float, high: float, upper: float, lower: float) -> Any:
            columns = slice(round(unit * low), max(round(unit * high), round(unit * low) + (high > low)))
            return self.pixels[self.height + round(unit * upper) : self.height + round(unit * lower), columns]

        for k, value in enumerate(values):
            upper, lower = top + k * pitch, top + k * pitch + BAR_HEIGHT
            self.text(names[k], MARGIN - 2, upper - 3, palette.INK, SMALL_LETTERS)
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
