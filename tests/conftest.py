"""Kernels compiled by the tests live in a folder of their own, kept between runs."""

import os
import tempfile
from pathlib import Path

FOLDER = Path(tempfile.gettempdir()) / f"redundant-envs-tests-{os.getuid() if hasattr(os, 'getuid') else 0}"
os.environ.setdefault("REDUNDANT_ENVS_CACHE", str(FOLDER))
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
