"""Clips: frames as an animated GIF or an MP4, by the ending of the file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.extras import needs

ENDINGS = (".gif", ".mp4")


def check_clip(path: Path) -> None:
    """Refuse a clip that cannot be written, before the simulation begins: by its ending, or for lack of
    imageio, or of imageio-ffmpeg for an MP4."""
    if path.suffix.lower() not in ENDINGS:
        raise ValueError(f"clip is {str(path)!r}; end its name in {' or '.join(ENDINGS)}")
    with needs("plot"):
        import imageio.v2  # noqa: F401

        if path.suffix.lower() == ".mp4":
            import imageio_ffmpeg  # noqa: F401


def write_clip(path: Path, frames: Sequence[NDArray[np.uint8]], frames_per_second: int) -> None:
    """Write frames, (height, width, 3) each and of even height and width, in real time."""
    check_clip(path)
    import imageio.v2 as imageio

    pictures: list[Any] = list(frames)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix.lower() == ".gif":
        # A palette of 64 colours makes the file a third as large; the pictures have few.
        duration = 1000 // frames_per_second
        imageio.mimsave(path, pictures, duration=duration, loop=0, palettesize=64)
    else:
        # H.264 needs even sizes; larger blocks would resize the frames.
        imageio.mimsave(path, pictures, format="FFMPEG", fps=frames_per_second, macro_block_size=2)
