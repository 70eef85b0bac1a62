"""One style of figures, files that are the same in every run, and clips of frames."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from redundant_envs.support import palette
from redundant_envs.support.disk import replacing, write_bytes
from redundant_envs.support.extras import needs
from redundant_envs.support.values import printable

CLIPS = (".gif", ".mp4")  # endings of clips


def new_figure(width: float, height: float, dpi: int = 100) -> Any:
    """An empty figure of a size in inches, drawn without any window system."""
    with needs("plot"):
        from matplotlib.figure import Figure
    return Figure(figsize=(width, height), dpi=dpi, layout="constrained")


def literal(text: str) -> str:
    """A name of a file or a setting as text of a figure, in which a dollar sign begins no formula."""
    return printable(text).replace("$", r"\$")


def bare(panel: Any) -> None:
    """Axes with a grid behind the curves, and lines below and on the left only."""
    panel.grid(color=palette.css(palette.REACH), linewidth=0.7)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)


def save_figure(figure: Any, path: Path, **options: Any) -> Path:
    """Write a PNG or SVG, with options of ``Figure.savefig``; the same figure gives the same bytes."""
    if path.suffix not in (".svg", ".png"):
        raise ValueError(f"path is {path}; give a file that ends in .svg or .png")
    with needs("plot"):
        import matplotlib
        from PIL import Image
    memory = io.BytesIO()
    if path.suffix == ".svg":
        # Text becomes outlines, so that the picture is the same everywhere.
        with matplotlib.rc_context({"svg.hashsalt": "redundant-envs", "svg.fonttype": "path"}):
            figure.savefig(memory, format="svg", metadata={"Date": None, "Creator": None}, **options)
    else:
        figure.savefig(memory, format="png", **options)
        # A palette makes the file a third as large; line drawings have few colours.
        picture = Image.open(memory).convert("RGB").quantize(128)
        picture.save(memory := io.BytesIO(), format="png", optimize=True)
    write_bytes(path, memory.getvalue())
    return path


def of_lines(svg: str) -> Any:
    """A figure of an SVG of :mod:`redundant_envs.robots.drawn`: paths of straight lines, and texts."""
    root = ElementTree.fromstring(svg)
    width, height = (float(root.get(name, "")) for name in ("width", "height"))
    figure = new_figure(width / 100.0, height / 100.0, dpi=200)
    figure.set_layout_engine("none")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, width), ylim=(height, 0.0))
    axes.axis("off")
    # A line without a length is a dot, which only a marker shows.
    round_ends = {"solid_capstyle": "round", "marker": "o", "markeredgewidth": 0.0}
    for element in root.iter():
        if (data := element.get("d")) is not None:
            color, size = element.get("stroke"), 0.72 * float(element.get("stroke-width", ""))
            for line in data.split("M")[1:]:
                x, y = np.array([point.split() for point in line.split("L")], dtype=float).T
                axes.plot(x, y, color=color, linewidth=size, markersize=size, **round_ends)
        elif element.text:
            at = float(element.get("x", "")), float(element.get("y", ""))
            axes.text(*at, literal(element.text), color=element.get("fill"), size=8.6, ha="center")
    return figure


def check_clip(path: Path) -> None:
    """Refuse, before a simulation, a clip of another ending, or without the packages that it needs."""
    if path.suffix.lower() not in CLIPS:
        raise ValueError(f"clip is {str(path)!r}; end its name in {' or '.join(CLIPS)}")
    with needs("plot"):
        import imageio.v2  # noqa: F401

        if path.suffix.lower() == ".mp4":
            import imageio_ffmpeg  # noqa: F401


def write_clip(path: Path, frames: Sequence[NDArray[np.uint8]], frames_per_second: int) -> None:
    """Write frames, (height, width, 3) each and of even height and width, in real time: GIF or MP4."""
    check_clip(path)
    import imageio.v2 as imageio

    pictures: list[Any] = list(frames)
    if path.suffix.lower() == ".gif":
        # A palette of 64 colours makes the file a third as large; the pictures have few.
        memory, duration = io.BytesIO(), 1000 // frames_per_second
        imageio.mimsave(memory, pictures, format="GIF", duration=duration, loop=0, palettesize=64)
        write_bytes(path, memory.getvalue())
        return
    with replacing(path) as part:
        # H.264 needs even sizes; larger blocks would resize the frames.
        imageio.mimsave(part, pictures, format="FFMPEG", fps=frames_per_second, macro_block_size=2)
