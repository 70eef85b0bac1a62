"""Files that are complete or absent, and one clear message if a disk is full."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

FULL = {errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)}  # no space left, or the quota of the user is
LEAST = 1 << 14  # bytes; a disk with less left is full for what a library failed to write


class DiskFull(OSError):
    """A disk is full; the message names the file and the disk."""


def is_full(error: BaseException | None) -> bool:
    """Whether an error, or one that led to it, is that of a full disk."""
    while error is not None:
        if isinstance(error, DiskFull) or (isinstance(error, OSError) and error.errno in FULL):
            return True
        error = error.__cause__ or error.__context__
    return False


def disk_of(path: Path) -> tuple[Path, int]:
    """Where the disk of a path is mounted, and the bytes that are left there."""
    place = path.absolute()
    while not place.exists() or not (os.path.ismount(place) or place == place.parent):
        place = place.parent
    return place, shutil.disk_usage(place).free


@contextlib.contextmanager
def told(path: Path) -> Iterator[None]:
    """What is raised within because a disk is full is a DiskFull that names the file ``path``."""
    try:
        yield
    except DiskFull:
        raise
    except Exception as error:
        mount, free = disk_of(path)
        unsaid = isinstance(error, OSError | RuntimeError) and free < LEAST  # as of torch and ffmpeg
        if not (is_full(error) or unsaid):
            raise
        raise DiskFull(
            f"{path} cannot be written: the disk {mount} is full ({free / 1e6:.1f} MB left); delete "
            "something there, or write to another disk"
        ) from error


def telling(function: Callable[..., Any], path: Path) -> Callable[..., Any]:
    """A function that writes a file, within :func:`told`."""

    def told_of(*given: Any, **more: Any) -> Any:
        with told(path):
            return function(*given, **more)

    return told_of


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """The path of a new file beside ``path``, whose place it takes at the end; the folder is made. If it
    cannot be written, it is deleted, and the file that was there is unchanged. A link keeps its name, and a
    device is written itself."""
    path = path.resolve() if path.is_symlink() else path
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if path.exists() and not path.is_file():
        with told(path):
            yield path
        return
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    with told(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield part
            os.replace(part, path)
        finally:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file, which is complete or unchanged."""
    with replacing(path) as part:
        part.write_bytes(data)


def write_text(path: Path, text: str) -> None:
    """Write a text as UTF-8, like :func:`write_bytes`."""
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8")
