"""Kernels compiled by the tests live in the checkout's own pytest cache, kept between runs."""

import os
from pathlib import Path

FOLDER = Path(__file__).parents[1] / ".pytest_cache" / "kernels"
os.environ.setdefault("REDUNDANT_ENVS_CACHE", str(FOLDER))
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
