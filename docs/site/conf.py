"""Settings of Sphinx; make.py calls it on the sources that it has assembled."""

import re
from pathlib import Path
from typing import Any

import formulas
import ranking

from redundant_envs import __version__

project = "redundant-envs"
release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_design"]
exclude_patterns = ["source/**/*.rst"]
html_theme = "furo"
html_show_copyright = False
html_favicon = "icon.svg"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_search_scorer = str(Path(__file__).with_name("ranking.js"))
html_title = f"redundant-envs {__version__}"
html_copy_source = False
highlight_language = "none"
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 4
html_math_renderer = "outlines"
autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_use_rtype = False

MARKS = re.compile(r"(``.*?``|`[^`]*`)|[|*]")
"""Literals of docstrings, and marks that stand for absolute values and products there."""


def setup(app: Any) -> None:
    formulas.setup(app)
    ranking.setup(app)
    app.connect("autodoc-process-docstring", escape, priority=400)


def escape(app: Any, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Escape marks of docstrings that reStructuredText would take for its own, before napoleon does."""
    lines[:] = [MARKS.sub(lambda mark: mark[1] or f"\\{mark[0]}", line) for line in lines]
