"""Pages of the documentation: their links, blocks of code and commands."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
MANUAL = [README, *sorted((ROOT / "docs").glob("*.md"))]
"""Pages for users: without tutorials, effects and results."""
PAGES = [README, ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES += sorted((ROOT / "policies").glob("*/README.md"))


def text(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def prose(page: Path) -> str:
    """A page without its fenced blocks."""
    return re.sub(r"^```.*?^```", "", text(page), flags=re.S | re.M)


def blocks(page: Path, of: str | None = None) -> list[tuple[int, str, str]]:
    """Fenced blocks, of one language: the line at which each begins, its language ("" for none) and text."""
    whole = text(page)
    found = re.finditer(r"^```(\w*)[^\n]*\n(.*?)^```$", whole, re.S | re.M)
    return [(whole.count("\n", 0, m.start(2)) + 1, m[1], m[2]) for m in found if of in (None, m[1])]


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub makes them."""
    found: set[str] = set()
    for heading in re.findall(r"^#+ +(.*)$", prose(page), re.M):
        plain = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").strip().lower()
        slug = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        names = (slug, *(f"{slug}-{k}" for k in range(1, len(found) + 1)))
        found.add(next(name for name in names if name not in found))
    return found


def commands(page: Path) -> dict[str, bool]:
    """Commands of this project on a page, without their comments, and whether each is in a block."""
    in_blocks = [line for *_, block in blocks(page, "") for line in re.sub(r"\\\n", " ", block).splitlines()]
    found = dict.fromkeys(re.findall(r"`([^`\n]+)`", prose(page)), False)
    found |= {re.sub(r"\s+#.*", "", line).strip(): True for line in in_blocks}
    ours = ("python -m ", "python docs/examples")
    return {line: whole for line, whole in found.items() if line.startswith(ours)}
