"""Checks of folders for results and reports, before anything long begins and anything large is imported."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from redundant_envs.envs.clips import check_clip
from redundant_envs.extras import needs

from . import command
from .run_folder import is_exported

CHECKPOINT, OLD_CHECKPOINT = "checkpoint", "checkpoint.old"
"""Checkpoint folders inside that of a run; after a kill between two renamings only the old name exists."""
STATE = "state.pt"
"""File that exists only in a complete checkpoint."""
EVALUATED = ("evaluation.json", "episodes.csv")
REPORTED = ("report.md", "plots", "clip.gif", "clip.mp4")


def check_out(folder: Path) -> None:
    """Refuse an impossible folder for results: a file, a path below a file, or one that is not writable."""
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not there.is_dir():
        what = "is a file" if there == folder else f"is below the file {there}"
        raise ValueError(f"out is {folder}, which {what}; choose another --out")
    if not os.access(there, os.W_OK | os.X_OK):
        raise ValueError(f"out is {folder}, and {there} is not writable; choose another --out")


def check_new(folder: Path) -> None:
    """Refuse a file, or a folder that is not empty, as the folder of a new run."""
    check_out(folder)
    if folder.exists() and any(folder.iterdir()):
        hint = f"go on with '{command('resume', folder)}', " if find_checkpoint(folder) else ""
        raise ValueError(f"run folder {folder} is not empty; {hint}choose another --out or delete it")


def find_checkpoint(folder: Path) -> Path | None:
    """The newest complete checkpoint of a run folder, if it has one."""
    return next((p for n in (CHECKPOINT, OLD_CHECKPOINT) if ((p := folder / n) / STATE).is_file()), None)


def check_unwritten(folder: Path, files: Sequence[str], overwrite: bool) -> None:
    """Refuse a folder for results that holds files of their names, unless they may be overwritten."""
    check_out(folder)
    there = [name for name in files if (folder / name).exists()]
    if there and not overwrite:
        raise ValueError(
            f"out is {folder}, which has {', '.join(there)}; choose another --out, or add --overwrite"
        )


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
    elif not overwrite and (is_exported(folder) or (folder / "report.md").exists()):
        reason = "is an exported policy" if is_exported(folder) else "has a report"
        raise ValueError(f"{folder} {reason}; give --out FOLDER, or --overwrite to write into it")
