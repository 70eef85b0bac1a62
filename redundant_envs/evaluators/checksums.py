"""Checksums of a compiled module: a folder that is damaged or was left unfinished is found by them."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from pathlib import Path

FILE = "checksums.json"
"""Written last: a folder without it was left unfinished."""
LARGEST = 1_000_000
"""Bytes that the file of checksums has at most; it has some hundreds for each file of a module."""


def write_whole(path: Path, text: str) -> None:
    """Let a file appear whole, or not at all."""
    handle, name = tempfile.mkstemp(dir=path.parent)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(text)
    os.replace(name, path)


def checksum(path: Path) -> str:
    """SHA-256 of a file; OSError if it is none, such as a pipe, which would be read without end."""
    return hashlib.sha256(_regular(path).read_bytes()).hexdigest()


def _regular(path: Path) -> Path:
    """A path that is a file, or OSError."""
    if not path.is_file():
        raise OSError(f"{path} is no file")
    return path


def write_checksums(folder: Path) -> None:
    """Declare a folder complete as it is now."""
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    sums = {p.relative_to(folder).as_posix(): checksum(p) for p in files}
    write_whole(folder / FILE, json.dumps(sums, indent=1))


def is_whole(folder: Path, needed: tuple[str, ...], text: str) -> bool:
    """Whether a folder has the files needed, the first of them with this text, and none has changed.

    This finds accidents. It cannot protect from one who may write to the folder.
    """
    try:
        if _regular(folder / FILE).stat().st_size > LARGEST:
            return False
        sums = json.loads((folder / FILE).read_text(encoding="utf-8"))
        if not isinstance(sums, dict) or _regular(folder / needed[0]).read_text(encoding="utf-8") != text:
            return False
        return sums.keys() >= set(needed) and all(
            checksum(folder / name) == value for name, value in sums.items()
        )
    except (OSError, ValueError, RecursionError):  # the last is of brackets in brackets
        return False
