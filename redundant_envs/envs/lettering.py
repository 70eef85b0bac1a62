"""Letters for pictures: strokes on a small grid, drawn like all other shapes by their signed distances."""

from __future__ import annotations

import itertools
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.files import read_yaml

CAPITAL = 6.0  # height of a digit on the grid; the base line is at y = 6, and y points down
GAP = 1.5  # between two letters, in units of the grid
STROKE = 0.85  # width of a stroke, in units of the grid
GLYPHS: dict[str, tuple[float, str]] = read_yaml(Path(__file__).with_name("lettering.yaml"), "glyphs")
"""Character -> its width, and its strokes: points x,y joined by lines, strokes parted by semicolons."""


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
