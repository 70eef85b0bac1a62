"""This package keeps every bound of every hard case, and a page shows them."""

import re

import pytest

from redundant_envs.verify.promises import at_most

from . import __main__ as page
from .cases import CASES
from .hard_case import THEMES, Figure

BY_NUMBER = {case.number: case for case in CASES}


@pytest.mark.quick(
    "1", "2", "3", "4", "5", "6", "8", "9", "10", "11", "12", "48", "13", "14", "18", "19", "25", "32",
    "40",
)  # fmt: skip
@pytest.mark.parametrize("number", BY_NUMBER)
def test_a_hard_case_keeps_its_bounds(number):
    assert [f"{figure}" for figure in BY_NUMBER[number].figures() if not figure.kept] == []


def test_the_page_has_every_case_in_order_and_marks_missed_promises():
    missed = Figure("an error", 3.0, at_most(2.0, "m"))
    assert str(missed) == "an error is 3, at most 2 m is promised"
    text = page.text({key: [missed] for key in BY_NUMBER}, "a machine", "a day")
    assert re.findall(r"^### .*$", text, re.M) == [page.heading(case) for case in CASES]
    assert re.findall(r"^## (.*)$", text, re.M) == list(THEMES)
    assert text.count("| an error | at most 2 m | **3** |") == len(CASES)
