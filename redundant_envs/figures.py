"""One style of figures: an empty figure, axes without a frame, files that are the same in every run."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from redundant_envs.extras import needs


def new_figure(width: float, height: float, dpi: int = 100) -> Any:
    """An empty figure of a size in inches, drawn without any window system."""
    with needs("plot"):
        from matplotlib.figure import Figure
    return Figure(figsize=(width, height), dpi=dpi, layout="constrained")


def bare(panel: Any) -> None:
    """Axes with a grid behind the curves, and lines below and on the left only."""
    panel.grid(color="0.9", linewidth=0.7)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)


def save_figure(figure: Any, path: Path, **options: Any) -> Path:
    """Write a figure as PNG or SVG, by the ending of its name, with options of ``Figure.savefig``; the same
    figure gives the same bytes."""
    if path.suffix not in (".svg", ".png"):
        raise ValueError(f"path is {path}; give a file that ends in .svg or .png")
    with needs("plot"):
        import matplotlib
        from PIL import Image
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".svg":
        # Text becomes outlines, so that the picture is the same everywhere.
        with matplotlib.rc_context({"svg.hashsalt": "redundant-envs", "svg.fonttype": "path"}):
            figure.savefig(path, metadata={"Date": None, "Creator": None}, **options)
        return path
    memory = io.BytesIO()
    figure.savefig(memory, format="png", **options)
    # A palette makes the file a third as large; line drawings have few colours.
    Image.open(memory).convert("RGB").quantize(128).save(path, optimize=True)
    return path
