"""Checks for a report, before anything long begins and anything large is imported."""

from __future__ import annotations

from pathlib import Path

from redundant_envs.envs.clips import check_clip
from redundant_envs.extras import needs

from .new_folder import check_unwritten
from .run_folder import is_exported

EVALUATED = ("evaluation.json", "episodes.csv")
REPORTED = ("report.md", "plots", "clip.gif", "clip.mp4")


def check_drawing() -> None:
    """Raise an error if the packages that draw a report are missing."""
    with needs("plot"):
        import matplotlib  # noqa: F401
        import PIL  # noqa: F401
    check_clip(Path("clip.gif"))


def check_target(folder: Path, out: Path | None, overwrite: bool) -> None:
    """Refuse to replace files by a report, or to write into an exported policy, without ``overwrite``."""
    if out is not None:
        check_unwritten(out, (*REPORTED, *EVALUATED), overwrite)
        return
    if overwrite:
        return
    reason = ""
    if is_exported(folder):
        reason = "is an exported policy"
    elif (folder / "report.md").exists():
        reason = "has a report"
    if reason:
        raise ValueError(f"{folder} {reason}; give --out FOLDER, or --overwrite to write into it")
