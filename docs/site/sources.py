"""The pages of docs/ as sources of the site: links to files elsewhere lead to copies of them."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = {
    "docs/site/start.md": "index.md", "README.md": "install.md", "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
}  # fmt: skip
"""Pages that are not at their place in docs/, and where they are in the site."""
TREE = "source"
"""Folder of the site with copies of files of the source tree, which pages link."""
LISTED = 200
"""Most files of a folder that its page lists."""
MARKDOWN_LINK = re.compile(r"(\]\()([^)\s]+)(\))")
HTML_LINK = re.compile(r'((?:src|href)=")([^"]+)(")')
FENCED = re.compile(r"(^```.*?^```$)", re.S | re.M)


def copied(site: Path) -> None:
    """Write all pages, pictures and tables of docs/ to a folder, and the files that the pages link."""
    for path in sorted(DOCS.rglob("*")):
        place = site / path.relative_to(DOCS)
        if path.is_dir() or DOCS / "site" in path.parents:
            continue
        place.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".md":
            place.write_text(_linked(path, place.relative_to(site), site), encoding="utf-8")
        else:
            shutil.copy(path, place)
    for name, place in PAGES.items():
        (site / place).write_text(_linked(ROOT / name, PurePosixPath(place), site), encoding="utf-8")


def _linked(page: Path, place: PurePosixPath | Path, site: Path) -> str:
    """The text of a page whose links are those of the site."""

    def link(found: re.Match[str]) -> str:
        before, target, after = found.groups()
        return f"{before}{_target(page, PurePosixPath(place), target, site)}{after}"

    parts = FENCED.split(page.read_text(encoding="utf-8"))
    for k, part in enumerate(parts):
        if not part.startswith("```"):
            parts[k] = HTML_LINK.sub(link, MARKDOWN_LINK.sub(link, part))
    return "".join(parts)


def _target(page: Path, place: PurePosixPath, target: str, site: Path) -> str:
    """A link of a page as one of the page at its place in the site."""
    path, mark, anchor = target.partition("#")
    if not path or re.match(r"[a-z]+:", path):
        return target
    file = Path(os.path.normpath(page.parent / path))
    if file == DOCS:
        there = PurePosixPath("index.md")
    elif DOCS in file.parents:
        there = PurePosixPath(file.relative_to(DOCS).as_posix())
        if file.is_dir():
            has_page = (file / "README.md").exists()
            there = there / "README.md" if has_page else PurePosixPath(TREE, "docs", there)
    elif file.parent == ROOT and file.name in PAGES:
        there = PurePosixPath(PAGES[file.name])
    else:
        there = PurePosixPath(TREE, file.relative_to(ROOT).as_posix())
    if there.parts[0] == TREE:
        there = _kept(file, there, site)
    return os.path.relpath(there, place.parent).replace(os.sep, "/") + mark + anchor


def _kept(file: Path, place: PurePosixPath, site: Path) -> PurePosixPath:
    """Copy a file of the source tree, or a list of those of a folder; its place."""
    if file.is_dir():
        place = place / "index.md"
        files = [path for path in sorted(file.iterdir()) if path.is_file() and not path.name.startswith(".")]
        lines = [
            f"* [{path.name}]({_kept(path, place.parent / path.name, site).name})" for path in files[:LISTED]
        ]
        text = (
            f"---\norphan: true\n---\n\n# {file.relative_to(ROOT).as_posix()}\n\n" + "\n".join(lines) + "\n"
        )
        (site / place).parent.mkdir(parents=True, exist_ok=True)
        (site / place).write_text(text, encoding="utf-8")
        return place
    if file.suffix == ".md":  # its own links are not those of the site: shown as it stands
        place = place.with_name(f"{place.name}.txt")
    (site / place).parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(file, site / place)
    return place
