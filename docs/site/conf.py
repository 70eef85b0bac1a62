"""Settings of Sphinx; make.py calls it on the sources that it has assembled."""

from formulas import setup  # noqa: F401 - called by Sphinx

from redundant_envs import __version__

project = "redundant-envs"
release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["source/**/*.rst"]
html_theme = "furo"
html_title = f"redundant-envs {__version__}"
html_copy_source = False
highlight_language = "none"
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
html_math_renderer = "outlines"
autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_use_rtype = False
