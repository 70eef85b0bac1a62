"""Files that are complete or absent and replace nothing unasked, folders without links, and one clear message
if a disk is full."""

import contextlib
import errno
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

FULL = {errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)}  # no space left, or the quota of the user is
LEAST = 1 << 14  # bytes; a disk with less left is full for what a library failed to write
MAX_SHOWN = 5  # most names in a message


class DiskFull(OSError):
    """A disk is full; the message names the file."""


@contextlib.contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Errors within since a disk is full become a DiskFull for ``path``, also those of libraries, as of torch
    and ffmpeg, that say something else."""
    try:
        yield
    except DiskFull:
        raise
    except (OSError, RuntimeError) as error:
        if not (_is_full(error) or free_bytes(path) < LEAST):
            raise
        fix = "delete something there, or write to another one"
        raise DiskFull(f"{path} cannot be written: the disk is full; {fix}") from error


def _is_full(error: BaseException | None) -> bool:
    """Whether an error, or one that led to it, is that of a full disk."""
    return error is not None and (
        (isinstance(error, OSError) and error.errno in FULL) or _is_full(error.__cause__ or error.__context__)
    )


def free_bytes(path: Path) -> int:
    """Bytes that are left on the disk of a path."""
    whole = path.absolute()
    return shutil.disk_usage(next(place for place in (whole, *whole.parents) if place.exists())).free


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """The path of a new file beside ``path``, whose place it takes at the end; the folder is made. If it
    cannot be written, it is deleted, and the file that was there is unchanged.

    Its name cannot be guessed, so no link waits there. A device is written itself; any other link at ``path``
    is refused: what it names may be anything.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        with disk_errors(path):
            yield path
        return
    if path.is_symlink():
        raise FileExistsError(
            f"{path} is a link to {path.readlink()}; delete the link, or give the file itself"
        )
    part = path.with_name(f".{path.stem}.{secrets.token_hex(8)}{path.suffix}")
    with disk_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        # O_EXCL follows no link, and fails where anything has this name
        os.close(os.open(part, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
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


def check_kept(written: Iterable[Path], force: bool, read: Iterable[Path] = ()) -> None:
    """Refuse to write a file twice, files that a command has ``read``, or that are in a folder of these,
    folders, and files that exist, unless ``force`` replaces these; a device may be written."""
    written = [*written]
    for path in written:
        if sum(path.resolve() == other.resolve() for other in written) > 1:
            raise ValueError(f"{path} would be written twice; give different places")
        if path.is_dir():
            raise ValueError(f"{path} is a folder; give a file to be written")
        if path.exists() and any(path.resolve().is_relative_to(other.resolve()) for other in read):
            raise ValueError(f"{path} would be replaced, and is what the command reads; choose another place")
        if path.is_file() or not path.exists():  # a device is written itself
            check_folder(f"the folder of {path.name}", path.parent, "choose another place")
    there = [str(p) for p in written if p.is_file() or (p.is_symlink() and not p.exists())]
    if there and not force:
        names = ", ".join(there[:MAX_SHOWN])
        raise ValueError(f"{names} would be replaced; choose another place, or add --force")


def check_folder(what: str, folder: Path, fix: str) -> None:
    """Refuse a folder in which no file can be made: a file, a link to nothing, what is below one of these, or
    a folder that is not writable; ``what`` names it, and ``fix`` says what to do."""
    there = next(place for place in (folder, *folder.absolute().parents) if os.path.lexists(place))
    kind = "the file" if there.exists() else "the broken link"
    if not there.is_dir():
        problem = f"is {kind.replace('the', 'a')}" if there == folder else f"is below {kind} {there}"
        raise ValueError(f"{what} is {folder}, which {problem}; {fix}")
    if not os.access(there, os.W_OK | os.X_OK):
        raise ValueError(f"{what} is {folder}, and {there} is not writable; {fix}")


def add_force(parser: Any) -> None:
    """Give a command of argparse the option that :func:`check_kept` names."""
    parser.add_argument("--force", action="store_true", help="replace files that exist")


def check_plain(folder: Path) -> None:
    """Refuse a folder that holds links, pipes or devices, at any depth: a file of such a name is written, or
    read, elsewhere or without end. The folder itself may be a link of the user."""
    bad_entries = []
    for place, folders, files in os.walk(folder):
        for path in sorted(Path(place, name) for name in (*folders, *files)):
            if path.is_symlink():
                bad_entries.append(f"{path.relative_to(folder)} (a link)")
            elif not (path.is_dir() or path.is_file()):
                bad_entries.append(f"{path.relative_to(folder)} (a pipe or device)")
    if bad_entries:
        shown = ", ".join(bad_entries[:MAX_SHOWN])
        more = f" and {len(bad_entries) - MAX_SHOWN} more" if len(bad_entries) > MAX_SHOWN else ""
        raise ValueError(
            f"{folder} holds {shown}{more}; files of these names would be read or written elsewhere: delete "
            "them, or put copies in their place"
        )


@contextlib.contextmanager
def alone(folder: Path, what: str) -> Iterator[None]:
    """Refuse a folder in which another process does the same, such as "trains", if the system has such locks.

    The folder itself is locked, so nothing is left in it.
    """
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # some network file systems lock no folders
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise ValueError(
                    f"another process {what} in {folder}; wait for its end, or choose another folder"
                ) from None
        yield
    finally:
        os.close(handle)
