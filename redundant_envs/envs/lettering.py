"""Letters for pictures: strokes on a small grid, drawn like all other shapes by their signed distances."""

from __future__ import annotations

import itertools
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

CAPITAL = 6.0  # height of a digit on the grid; the base line is at y = 6, and y points down
GAP = 1.5  # between two letters, in units of the grid
STROKE = 0.85  # width of a stroke, in units of the grid
GLYPHS = {
    " ": (1.4, ""),
    ".": (0.2, "0,5.8 0,6"),
    "/": (2.0, "0,6.8 2,-.6"),
    "0": (3.2, "1,0 2.2,0 3.2,1 3.2,5 2.2,6 1,6 0,5 0,1 1,0"),
    "1": (3.2, ".6,1.2 1.9,0 1.9,6"),
    "2": (3.2, "0,1.2 1,0 2.2,0 3.2,1 3.2,2.2 0,6 3.2,6"),
    "3": (3.2, "0,.8 1,0 2.2,0 3.1,.9 3.1,2 2.2,2.8 1.2,2.8; 2.2,2.8 3.2,3.7 3.2,5 2.2,6 1,6 0,5.2"),
    "4": (3.2, "2.4,6 2.4,0 0,4.3 3.2,4.3"),
    "5": (3.2, "3,0 .4,0 .2,2.6 1,2.2 2.2,2.2 3.2,3.2 3.2,5 2.2,6 1,6 0,5.3"),
    "6": (3.2, "2.9,.5 2.2,0 1.2,0 0,1.6 0,5 1,6 2.2,6 3.2,5 3.2,3.6 2.2,2.6 1,2.6 0,3.6"),
    "7": (3.2, "0,0 3.2,0 1.2,6"),
    "8": (
        3.2,
        "1,2.8 .1,1.9 .1,.9 1,0 2.2,0 3.1,.9 3.1,1.9 2.2,2.8 1,2.8 0,3.8 0,5 1,6 2.2,6 3.2,5 3.2,3.8 2.2,2.8",
    ),
    "9": (3.2, ".3,5.5 1,6 2,6 3.2,4.4 3.2,1 2.2,0 1,0 0,1 0,2.4 1,3.4 2.2,3.4 3.2,2.4"),
    "d": (3.0, "3,3 2,2 1,2 0,3 0,5 1,6 2,6 3,5; 3,0 3,6"),
    "e": (3.0, "0,4 3,4 3,3 2,2 1,2 0,3 0,5 1,6 2.7,6"),
    "f": (1.8, ".7,6 .7,1 1.4,.2 2,.2; 0,2.2 1.8,2.2"),
    "h": (3.0, "0,0 0,6; 0,3 1,2 2,2 3,3 3,6"),
    "i": (0.2, "0,2.2 0,6; 0,.3 0,.5"),
    "l": (0.6, "0,0 0,5.4 .6,6"),
    "m": (4.4, "0,2 0,6; 0,3 .8,2 1.5,2 2.2,2.8 2.2,6; 2.2,2.8 3,2 3.7,2 4.4,3 4.4,6"),
    "o": (3.0, "1,2 2,2 3,3 3,5 2,6 1,6 0,5 0,3 1,2"),
    "r": (1.9, "0,2 0,6; 0,3.3 1,2.1 1.9,2.1"),
    "s": (2.8, "2.6,2.3 2,2 .9,2 .2,2.6 .2,3.2 .9,3.9 2,4.1 2.7,4.7 2.7,5.4 2,6 .9,6 .1,5.6"),
    "t": (1.9, ".7,.6 .7,5.2 1.4,6 1.9,6; 0,2.2 1.8,2.2"),
}
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
