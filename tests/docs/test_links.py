"""Links of all pages lead to files and headings that exist."""

import re

import pytest
from markdown import PAGES, README, ROOT, anchors, prose, text

IDS = [str(page.relative_to(ROOT)) for page in PAGES]


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_links_lead_to_files_and_headings(page):
    found = re.findall(r"\]\(([^)\s]+)\)", prose(page)) + re.findall(r'src="([^"]+)"', prose(page))
    for link in found:
        if link.startswith(("http:", "https:", "mailto:")):
            continue
        target, _, anchor = link.partition("#")
        file = page.parent / target if target else page
        assert file.exists(), link
        if anchor:
            assert file.suffix == ".md", link
            assert anchor in anchors(file), f"{link}: {sorted(anchors(file))}"


def test_anchors_are_those_of_github(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "# A `b`, c?\n\n```\n# no heading\n```\n## rl_zoo3\n## I want to ...\n## A b c\n", "utf-8"
    )
    assert anchors(page) == {"a-b-c", "rl_zoo3", "i-want-to-", "a-b-c-1"}


def test_every_page_of_the_manual_can_be_reached_from_the_readme():
    seen, new = set(), {README}
    while new:
        page = new.pop()
        seen.add(page)
        links = re.findall(r"\]\(([^)#\s]+\.md)", prose(page))
        new |= {(page.parent / link).resolve() for link in links if "://" not in link} - seen
    missed = set((ROOT / "docs").glob("*.md")) - seen
    assert not missed


def test_the_readme_is_short_and_its_pages_are_not_long():
    assert len(text(README).split()) <= 1100
    for name in ("models", "scenes", "accuracy", "speed", "gradients", "command_line"):
        assert text(ROOT / "docs" / f"{name}.md").count("\n") < 250, name
