"""Importing this module lets cases import helpers of other tests: effects from outside, exact numbers."""

import sys
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
for folder in (TESTS, TESTS / "outside"):
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
