"""This package keeps every bound of every hard case, naive variants do not, and a page shows both."""

import re

import pytest

from redundant_envs.support import palette
from redundant_envs.support.figures import new_figure
from redundant_envs.verify.promises import at_most

from . import __main__ as page
from .cases import CASES
from .hard_case import THEMES, Figure, Subject

BY_NUMBER = {case.number: case for case in CASES}
PAIRS = {f"{case.number}-{variant.name}": (case, variant) for case in CASES for variant in case.caught}


@pytest.mark.quick(
    "1", "2", "3", "4", "5", "6", "8", "9", "10", "11", "12", "48", "13", "14", "18", "19", "25", "32",
    "40",
)  # fmt: skip
@pytest.mark.parametrize("number", BY_NUMBER)
def test_a_hard_case_keeps_its_bounds(number):
    assert [str(figure) for figure in BY_NUMBER[number].figures(Subject()) if not figure.kept] == []


@pytest.mark.long
@pytest.mark.parametrize(("case", "variant"), PAIRS.values(), ids=PAIRS)
def test_a_naive_variant_fails_its_case(case, variant):
    passes = all(figure.kept for figure in case.figures(variant()))  # until the first that is missed
    assert not passes, f"{variant.name} passes case {case.number}"


def test_the_page_has_every_case_in_order_and_marks_missed_promises():
    kept, missed = (Figure("an error", found, at_most(2.0, "m")) for found in (1.0, 3.0))
    assert str(missed) == "an error is 3, at most 2 m is promised"
    results = {number: {"this package": [kept], "a variant": [missed]} for number in BY_NUMBER}
    text = page.text(results, "a machine", "a day")
    assert re.findall(r"^### .*$", text, re.M) == [page.heading(case) for case in CASES]
    assert re.findall(r"^## (.*)$", text, re.M) == list(THEMES)
    assert text.count("| an error | at most 2 m | 1 | **3** |") == len(CASES)
    pictures = re.findall(r"\(hard_cases/(\w+)\.png\)", text)
    assert sorted(pictures) == sorted(draw.__name__ for draw, _ in page.PICTURES.values())


@pytest.mark.long
@pytest.mark.parametrize("number", page.PICTURES)
def test_a_picture_of_the_page_is_drawn_again(number):
    pytest.importorskip("matplotlib", reason="pictures need the extra 'plot'")
    draw, _ = page.PICTURES[number]
    axes = new_figure(6.4, 3.6, 120).subplots()
    title = draw(axes, False)
    own = {x.get_color() for x in axes.lines if x.get_label().startswith(Subject.name)}
    assert own == {palette.BLUE}
    assert palette.BLUE not in {
        x.get_color() for x in axes.lines if not x.get_label().startswith(Subject.name)
    }
    assert re.search(r"\d", title)
