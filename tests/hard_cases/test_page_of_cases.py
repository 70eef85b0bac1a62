"""docs/hard_cases.md has every case, and no other; its figures are those of the day it was written."""

import re
from pathlib import Path

import naive
import page
from hard_case import THEMES, all_cases

DOCS = Path(__file__).parents[2] / "docs"
TEXT = (DOCS / "hard_cases.md").read_text(encoding="utf-8")
CASES = all_cases()


def test_the_page_has_every_case_in_order_and_no_other():
    assert re.findall(r"^### .*$", TEXT, re.M) == [page.heading(case) for case in CASES]
    assert re.findall(r"^## (.*)$", TEXT, re.M) == list(THEMES.values())


def test_what_the_page_says_of_a_case_is_what_the_case_says():
    for case in CASES:
        part = TEXT.split(page.heading(case) + "\n")[1].split("\n### ")[0]
        for said in (case.hard, case.naive, case.mujoco, *(variant.name for variant in case.variants)):
            assert said in part, case.name
        assert ("waits for the effect" in part) == bool(case.waiting_for)
        assert f"`{case.measure.__name__}`" in TEXT


def test_every_picture_is_of_a_case_and_is_there():
    numbers = {case.number for case in CASES}
    for number, (draw, _) in page.PICTURES.items():
        assert number in numbers
        assert f"hard_cases/{draw.__name__}.png" in TEXT
        assert (DOCS / "hard_cases" / f"{draw.__name__}.png").stat().st_size > 1000
    assert len(list((DOCS / "hard_cases").glob("*.png"))) == len(page.PICTURES)


def test_this_package_keeps_every_promise_of_the_page_and_each_variant_misses_one():
    """A bold number of the package would be a broken promise on the published page."""
    names = {variant.name for variant in naive.VARIANTS}
    for part in TEXT.split("\n### ")[1:]:
        rows = [
            [x.strip() for x in line.strip("|").split("|")]
            for line in part.splitlines()
            if line.startswith("|")
        ]
        if not rows:
            continue
        head, _, *body = rows
        assert head[:3] == ["", "promised", "this package"]
        assert not any(row[2].startswith("**") for row in body), part[:40]
        for k, name in enumerate(head):
            assert name not in names or any(row[k].startswith("**") for row in body), (part[:40], name)
