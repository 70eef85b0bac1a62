"""Numbers of the manual that somebody measured are claims, which make claims measures again."""

import re
import runpy

import pytest
from markdown import ROOT

docs = runpy.run_path(str(ROOT / "docs" / "claims.py"))
CLAIMS = [(group, claim) for group, found in docs["claims"]().items() for claim in found]
PAGES = ("README.md", *sorted(p.relative_to(ROOT / "docs").as_posix() for p in (ROOT / "docs").glob("*.md")))
EFFECTS = sorted(f"effects/{path.name}" for path in (ROOT / "docs" / "effects").glob("*.md"))
NOT_CLAIMED = {"design.md", "mutation.md"}
"""Figures of attempts that nobody repeats, and of a study. Those of docs/accuracy.md: test_numbers.py."""
MEASURED = re.compile(r"[\d.]+ (?:ns|us|evaluations|kB|MB|GB|million steps/s|GFLOP/s)\b")


@pytest.mark.parametrize(("group", "claim"), CLAIMS, ids=[f"{g} {c['is']}" for g, c in CLAIMS])
def test_a_claim_is_a_sentence_of_its_page_and_has_a_number_for_each_measurement(group, claim):
    assert group in docs["GROUPS"]
    names = [claim["is"]] if isinstance(claim["is"], str) else claim["is"]
    found = docs["stated"](claim)
    assert len(found) == len(names)
    assert ("within" in claim) != ("plus" in claim)


@pytest.mark.parametrize("page", [p for p in (*PAGES, *EFFECTS) if p not in NOT_CLAIMED])
def test_a_number_that_was_measured_is_claimed(page):
    text = docs["page_of"](page, tables=page != "accuracy.md")
    for _, claim in CLAIMS:
        if claim["page"] == page:
            text = re.sub(re.escape(claim["says"]).replace(r"\{\}", docs["NUMBER"]), "", text)
    assert MEASURED.findall(text) == []
