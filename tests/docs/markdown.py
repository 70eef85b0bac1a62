"""Pages of the documentation: their links, blocks of code and commands."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
PAGES = [
    README, ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "policies").glob("*/README.md")),
]  # fmt: skip
MANUAL = [README, *sorted((ROOT / "docs").glob("*.md"))]
"""Pages for users: without tutorials, decisions and results."""


def text(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def prose(page: Path) -> str:
    """A page without its fenced blocks."""
    return re.sub(r"^```.*?^```", "", text(page), flags=re.S | re.M)


def blocks(page: Path, language: str) -> list[tuple[int, str]]:
    """Fenced blocks of a language ("" for none): the line at which each begins, and its text."""
    found, whole = [], text(page)
    for match in re.finditer(r"^```(\w*)\n(.*?)^```", whole, re.S | re.M):
        if match[1] == language:
            found.append((whole[: match.start()].count("\n") + 2, match[2]))
    return found


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub makes them."""
    found: set[str] = set()
    for heading in re.findall(r"^#+ +(.*)$", prose(page), re.M):
        plain = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").strip().lower()
        slug = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        name, k = slug, 0
        while name in found:
            k += 1
            name = f"{slug}-{k}"
        found.add(name)
    return found


def commands(page: Path) -> dict[str, bool]:
    """Commands of this project on a page, without their comments, and whether each is in a block."""
    in_blocks = [line for _, block in blocks(page, "") for line in re.sub(r"\\\n", " ", block).splitlines()]
    found = dict.fromkeys(re.findall(r"`([^`\n]+)`", prose(page)), False)
    found |= {re.sub(r"\s+#.*", "", line).strip(): True for line in in_blocks}
    return {
        line: whole
        for line, whole in found.items()
        if line.startswith(("python -m ", "python docs/examples"))
    }
