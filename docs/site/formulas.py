"""Formulas as outlines, drawn while the site is built: a page needs no script and no font for them."""

from __future__ import annotations

from functools import cache
from html import escape
from typing import Any

from matplotlib.path import Path
from matplotlib.textpath import TextPath

SIZE = 10.0  # of the letters, in units of the outlines
LETTERS = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C"}


@cache
def outline(formula: str) -> str:
    """TeX as SVG in the colour of the text around it; ValueError for what matplotlib does not know."""
    path, data = TextPath((0.0, 0.0), f"${formula.strip()}$", size=SIZE), []
    for points, code in path.iter_segments():
        data.append("Z")
        if code != Path.CLOSEPOLY:
            data[-1] = LETTERS[code] + " ".join(f"{x:.2f} {-y:.2f}" for x, y in points.reshape(-1, 2))
    box = path.get_extents()
    width, height, down = (f"{x / SIZE:.3f}em" for x in (box.width, box.height, box.y0))
    return (
        f'<svg role="img" aria-label="{escape(formula)}" viewBox="{box.x0:.2f} {-box.y1:.2f} {box.width:.2f} '
        f'{box.height:.2f}" style="width:{width};height:{height};vertical-align:{down}" fill="currentColor">'
        f'<path d="{"".join(data)}"/></svg>'
    )


def setup(app: Any) -> None:
    """Let Sphinx write formulas in this way."""
    from docutils import nodes

    def inline(writer: Any, node: Any) -> None:
        writer.body.append(outline(node.astext()))
        raise nodes.SkipNode

    def block(writer: Any, node: Any) -> None:
        writer.body.append(f'<p class="formula">{outline(node.astext())}</p>')
        raise nodes.SkipNode

    app.add_html_math_renderer("outlines", (inline, None), (block, None))
