"""Hard cases: tests whose promises are numbers, and naive variants that miss them."""

import sys
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
sys.path += [str(TESTS), str(TESTS / "outside")]
"""Cases use exact numbers and effects of other tests."""
