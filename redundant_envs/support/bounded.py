"""Files that somebody else may have written: read within bounds of memory, and never from a pipe or a device.

Every refusal is a ValueError that names the file, what it holds or claims, and the bound.
"""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Iterable, Iterator, Sequence
from io import BufferedReader
from pathlib import Path
from typing import Any, BinaryIO

from redundant_envs.support.values import shown

# Nothing large is imported here: scenes are read by every program.

MAX_UNPACKED = 1 << 26  # bytes of what is read of a policy: 16 million numbers, far more than an arm needs
MAX_PACKED = 1 << 28  # bytes of a policy.zip, in which stable-baselines3 keeps optimisers beside what is read
MAX_JSON = 1 << 20  # bytes of JSON, which becomes twenty times as many in memory; evaluations have 2000
MAX_TABLE = 1 << 24  # bytes of a table of runs: some thousand with their learning curves
LONGEST_LINE = 1 << 20
MAX_DIRECTORY = 1 << 20  # bytes of the directory of a zip file: torch has two members for each tensor


@contextlib.contextmanager
def opened(path: Path, what: str, most: int) -> Iterator[BufferedReader]:
    """A file, open for reading; ``what`` names it in messages. ValueError if it cannot be read, is a folder,
    a pipe or a device, or has more than ``most`` bytes."""
    try:
        if not path.is_file():
            raise ValueError(f"{what} is {shown(str(path))}; give a file, and no folder, pipe or device")
        with path.open("rb") as file:
            _check_size(path, os.fstat(file.fileno()).st_size, most)
            yield file
    except OSError as error:
        reason = error.strerror or str(error) or type(error).__name__
        raise ValueError(f"{what} is {shown(str(path))}, which cannot be read: {reason}") from None


def read_bytes(path: Path, what: str, most: int) -> bytes:
    """The bytes of a file; ValueError as for :func:`opened`."""
    with opened(path, what, most) as file:
        data = file.read(most + 1)  # files of /proc say that they are empty
    _check_size(path, len(data), most)
    return data


def _check_size(path: Path, size: int, most: int) -> None:
    if size > most:
        raise ValueError(f"{path} has {size} bytes, more than the {most} that are read; give a shorter file")


def read_text(path: Path, what: str, most: int) -> str:
    """The text of a file in UTF-8; ValueError as for :func:`opened`, and with the line of other bytes."""
    return _decoded(read_bytes(path, what, most), path)


def _decoded(raw: bytes, path: Path, first: int = 1) -> str:
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + first
        raise ValueError(f"{path}, line {line}: it is not UTF-8 text; save it as UTF-8") from None


def read_json(path: Path, what: str) -> Any:
    """The content of a JSON file; ValueError as for :func:`read_text`, or if it is no JSON."""
    import json

    try:
        return json.loads(read_text(path, what, MAX_JSON))
    except RecursionError:
        raise ValueError(f"{path} is nested too deeply") from None


def read_lines(path: Path, what: str, most: int) -> Iterator[str]:
    """The lines of a text; ValueError as for :func:`read_text`, or beyond ``LONGEST_LINE`` bytes."""
    with opened(path, what, most) as file:
        number = 0
        while raw := file.readline(LONGEST_LINE + 1):
            number += 1
            if len(raw) > LONGEST_LINE:
                raise ValueError(
                    f"{path}, line {number} has more than the {LONGEST_LINE} bytes that are read; give "
                    "shorter lines"
                )
            yield _decoded(raw, path, number).rstrip("\r\n")


def read_rows(path: Path, what: str) -> Iterator[dict[str, str]]:
    """The rows of a CSV file, one line each, by the columns of its first line; empty lines are left out."""
    import csv

    reader = csv.DictReader(read_lines(path, what, MAX_TABLE), strict=True)
    try:
        for row in reader:
            if None in row or None in row.values():
                raise ValueError(f"{path}, line {reader.line_num} has not the cells of the first line")
            yield row
    except csv.Error as error:
        raise ValueError(f"{path}, line {reader.line_num}: {error}") from None


def read_members(
    file: BinaryIO, where: str, names: Sequence[str] | None = None, most: int = MAX_UNPACKED
) -> dict[str, bytes]:
    """The members of a zip file by name, all or those with these names, of at most ``most`` bytes in all.

    ValueError if it is damaged, lacks one of the names, has one twice, has more than ``MAX_MEMBERS``, or one
    is neither stored nor deflated: other methods may need gigabytes for a member of any size.
    """
    import zipfile

    methods = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
    with _archive(file, where) as archive:
        there = {entry.filename: entry for entry in archive.infolist()}
        for name in names or ():
            if name not in there:
                raise ValueError(f"{where} has no {name!r}")
        wanted = {name: there[name] for name in names or there}
        for name, entry in wanted.items():
            if entry.compress_type not in methods:
                raise ValueError(f"{where} has a {shown(name)} that is neither stored nor deflated")
        _check_unpacked(wanted.values(), where, most)
        # By their sizes: without one a member is unpacked whole, with what it has beyond its size.
        return {name: archive.open(entry).read(entry.file_size) for name, entry in wanted.items()}


def stored_members(file: BinaryIO, where: str, most: int) -> list[str]:
    """The names of the members of a zip file for another reader; ValueError as for :func:`read_members`, or
    if one is compressed, or if another reader may find another directory in it."""
    import zipfile

    with _archive(file, where) as archive:
        if any(entry.compress_type for entry in archive.infolist()):
            raise ValueError(f"{where} is compressed")
        # zipfile corrects the place of the directory, which others take from the record at the end
        stated = zipfile._EndRecData(file)[zipfile._ECD_OFFSET]  # type: ignore[attr-defined]
        if archive.start_dir != stated:
            raise ValueError(f"{where} has something between its members and their directory")
        _check_unpacked(archive.infolist(), where, most)
        return archive.namelist()


@contextlib.contextmanager
def _archive(file: BinaryIO, where: str) -> Iterator[Any]:
    """A zip file with a directory that is not too long, whose members have different names."""
    import zipfile

    try:
        end = zipfile._EndRecData(file)  # type: ignore[attr-defined]
        if end and end[zipfile._ECD_SIZE] > MAX_DIRECTORY:  # type: ignore[attr-defined]
            raise ValueError(f"its directory has more than the {MAX_DIRECTORY} bytes that are read")
        archive = zipfile.ZipFile(file)
    except Exception as error:  # a place beyond any file, or a name that is no text
        raise _damaged(where, error) from None
    size = file.seek(0, os.SEEK_END)
    with archive:
        names = [name.lower() for name in archive.namelist()]  # which some readers take for equal
        if len(set(names)) < len(names):
            raise ValueError(f"{where} has two members of one name")
        if not all(0 <= entry.header_offset < size for entry in archive.infolist()):
            raise _damaged(where, "a member begins elsewhere")
        try:
            yield archive
        except (ValueError, MemoryError):
            raise
        except Exception as error:
            raise _damaged(where, error) from None


def _damaged(where: str, why: object) -> ValueError:
    return ValueError(f"{where} is damaged ({why}); it is not a complete zip file")


def _check_unpacked(entries: Iterable[Any], where: str, most: int) -> None:
    size = sum(entry.file_size for entry in entries)
    if size > most:
        raise ValueError(f"{where} unpacks to {size} bytes, more than the {most} that are read")


def read_arrays(path: Path, what: str) -> dict[str, Any]:
    """The arrays of numbers and texts of an .npz file; ValueError as for :func:`read_members`, or if one has
    objects or fewer numbers than it claims."""
    from numpy.lib import format as npy

    with opened(path, what, MAX_UNPACKED) as file:
        members = read_members(file, str(path))
    arrays = {}
    for name, data in members.items():
        try:
            arrays[name.removesuffix(".npy")] = npy.read_array(io.BytesIO(data), allow_pickle=False)
        except Exception as error:  # a header of a stranger may raise any error
            words = " ".join(str(error).split())[:200]
            raise ValueError(f"{path}: {shown(name)} is damaged ({words})") from None
    return arrays
