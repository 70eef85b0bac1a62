"""The order of the site: its tables of contents."""

from __future__ import annotations

from pathlib import Path

SECTIONS = {
    "Start": ["Install, and ten lines that run <install>"],
    "Tutorials": [
        "notebooks/equations_to_environment", "notebooks/accuracy_and_chaos", "notebooks/redundancy",
        "notebooks/learn_and_race", "tutorials/third_arm", "tutorials/moving_target", "tutorials/obstacle",
    ],
    "How to": [
        "scenes", "example_scenes", "action_modes", "extending", "other_libraries", "learners", "policies",
        "handed_to_me", "datasets", "gradients", "models", "control", "browser", "other_programs", "trouble",
    ],
    "Reference": [
        "environments/index", "tasks/*", "effects/README", "reference/integrators", "scenes/index",
        "reference/api", "reference/report", "command_line", "configuration", "how_it_works", "design",
        "errata", "changelog", "contributing",
    ],
    "Results": [
        "accuracy", "results/accuracy/accuracy", "speed", "redundancy", "results/tried", "strength",
        "results/README", "results/policy/report", "hard_cases", "energy", "fuzzing", "mutation", "gallery",
    ],
}  # fmt: skip
"""Sections of the site, and their pages in order."""
BELOW = {"environments/index": "environments/*", "effects/README": "effects/*", "scenes/index": "scenes/*"}
"""Pages with further ones below them."""


def written(site: Path) -> None:
    """Add the tables of contents to the first page, and to those with others below them."""
    tables = [_table(_found(site, pages), caption) for caption, pages in SECTIONS.items()]
    index = site / "index.md"
    index.write_text("\n".join([index.read_text(encoding="utf-8"), *tables]), encoding="utf-8")
    for name, pattern in BELOW.items():
        file = site / f"{name}.md"
        own = name.rpartition("/")[2]
        pages = [page.rpartition("/")[2] for page in _found(site, [pattern])]
        table = _table([page for page in pages if page != own])
        file.write_text(f"{file.read_text(encoding='utf-8')}\n{table}", encoding="utf-8")


def _found(site: Path, pages: list[str]) -> list[str]:
    """Names of pages, patterns replaced by the pages that they fit."""
    found = []
    for page in pages:
        if "*" in page:
            found += [p.relative_to(site).with_suffix("").as_posix() for p in sorted(site.glob(f"{page}.md"))]
        else:
            found.append(page)
    return found


def _table(pages: list[str], caption: str = "") -> str:
    about = f":caption: {caption}\n" if caption else ""
    return "\n".join(["```{toctree}", f"{about}:hidden:", "", *pages, "```", ""])
