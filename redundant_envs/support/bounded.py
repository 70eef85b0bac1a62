"""Files that somebody else may have written: read within bounds of memory, and never from a pipe or a device.

Every refusal is a ValueError that names the file, what it holds or claims, and the bound.
"""

import contextlib
import io
import math
import os
import stat
import struct
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
MAX_MEMBERS = 1000  # of a zip file: torch has two for each tensor of a policy
END, LOCATOR, END_64 = "<4s4H2LH", "<4sLQL", "<4sQ2H2L4Q"
"""Records at the end of a zip file, with length and place of its directory, the latter two for 64 bits."""
ENTRY = b"PK\x01\x02"  # the beginning of a member's entry in the directory of a zip file


@contextlib.contextmanager
def opened(path: Path, what: str, most: int) -> Iterator[BufferedReader]:
    """A file, open for reading; ``what`` names it in messages. ValueError if it cannot be read, is a folder,
    a pipe or a device, or has more than ``most`` bytes."""
    try:
        if path.is_dir():
            raise ValueError(f"{what} is {shown(str(path))}, a folder; give a file in it")
        at_once = getattr(os, "O_NONBLOCK", 0)  # a pipe without a writer does not wait for one
        with open(path, "rb", opener=lambda name, flags: os.open(name, flags | at_once)) as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise ValueError(f"{what} is {shown(str(path))}, a device or a pipe; give a file")
            _check_size(path, status.st_size, most)
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
        for number, raw in enumerate(iter(lambda: file.readline(LONGEST_LINE + 1), b""), 1):
            if len(raw) > LONGEST_LINE:
                raise ValueError(
                    f"{path}, line {number} has more than the {LONGEST_LINE} bytes that are read; give "
                    "shorter lines"
                )
            yield _decoded(raw, path, number).rstrip("\r\n")


def read_rows(path: Path, what: str) -> Iterator[dict[str, str]]:
    """The rows of a CSV file, one line each, by the columns of its first line; empty lines are left out."""
    import csv

    head: list[str] | None = None
    for number, line in enumerate(read_lines(path, what, MAX_TABLE), 1):
        if not line:
            continue
        try:
            cells = next(csv.reader([line], strict=True))
        except csv.Error as error:
            raise ValueError(f"{path}, line {number}: {error}") from None
        if head is None:
            head = cells
        elif len(cells) != len(head):
            raise ValueError(f"{path}, line {number} has {len(cells)} cells instead of {len(head)}")
        else:
            yield dict(zip(head, cells, strict=True))


def read_members(file: BinaryIO, where: str, names: Sequence[str] | None = None) -> dict[str, bytes]:
    """The members of a zip file by name, all or those with these names, of at most 64 MiB in all.

    ValueError if it is damaged, lacks one of the names, has one twice, has more than ``MAX_MEMBERS``, or one
    is neither stored nor deflated: other methods may need gigabytes for a member of any size.
    """
    import zipfile

    with _archive(file, where) as archive:
        there = {entry.filename: entry for entry in archive.infolist()}
        for name in names or ():
            if name not in there:
                raise ValueError(f"{where} has no {name!r}")
        wanted = {name: there[name] for name in names or there}
        for name, entry in wanted.items():
            if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise ValueError(f"{where} has a {shown(name)} that is neither stored nor deflated")
        _check_unpacked(wanted.values(), where, MAX_UNPACKED)
        # By their sizes: without one a member is unpacked whole, with what it has beyond its size.
        return {name: archive.open(entry).read(entry.file_size) for name, entry in wanted.items()}


def stored_members(file: BinaryIO, where: str, most: int) -> list[str]:
    """The names of the members of a zip file for another reader; ValueError as for :func:`read_members`, or
    if one is compressed, or if another reader may find another directory in it."""
    with _archive(file, where) as archive:
        if any(entry.compress_type for entry in archive.infolist()):
            raise ValueError(f"{where} is compressed")
        if archive.start_dir != _start_of_directory(file):
            raise ValueError(f"{where} has something between its members and their directory")
        _check_unpacked(archive.infolist(), where, most)
        return archive.namelist()


def _start_of_directory(file: BinaryIO) -> int | None:
    """Where a zip file says that its directory begins; None unless that ends where the records of the end
    begin, which are whole, without a comment, and at the end."""
    sizes = [struct.calcsize(record) for record in (END_64, LOCATOR, END)]
    before = file.seek(0, os.SEEK_END) - sizes[-1]
    file.seek(max(before - sum(sizes[:-1]), 0))
    end_64, locator, end = map(file.read, sizes)
    if len(end) < sizes[-1] or not end.startswith(b"PK\x05\x06") or end[-2:] != b"\0\0":
        return None
    *_, length, start, _ = struct.unpack(END, end)
    if locator.startswith(b"PK\x06\x07"):
        before -= sum(sizes[:-1])
        if struct.unpack(LOCATOR, locator)[2] != before or not end_64.startswith(b"PK\x06\x06"):
            return None
        *_, length_64, start_64 = struct.unpack(END_64, end_64)
        if (length, start) not in ((length_64, start_64), (2**32 - 1, 2**32 - 1)):
            return None
        length, start = length_64, start_64
    return start if start + length == before else None


@contextlib.contextmanager
def _archive(file: BinaryIO, where: str) -> Iterator[Any]:
    """A zip file with not too many members, each of its own name."""
    import zipfile
    import zlib

    if _count(file, ENTRY) > MAX_MEMBERS:
        raise ValueError(f"{where} has more than the {MAX_MEMBERS} members that are read")
    errors = (zipfile.BadZipFile, zlib.error, struct.error, EOFError, RuntimeError, OSError, OverflowError)
    try:
        archive = zipfile.ZipFile(file)
    except (*errors, ValueError) as error:  # a place beyond any file, or a name that is no text
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
        except errors as error:
            raise _damaged(where, error) from None


def _damaged(where: str, why: object) -> ValueError:
    return ValueError(f"{where} is damaged ({why}); it is not a complete zip file")


def _check_unpacked(entries: Iterable[Any], where: str, most: int) -> None:
    if (size := sum(entry.file_size for entry in entries)) > most:
        raise ValueError(f"{where} unpacks to {size} bytes, more than the {most} that are read")


def _count(file: BinaryIO, mark: bytes) -> int:
    """How often a mark is in a file, in little memory."""
    count, end = 0, b""
    file.seek(0)
    while chunk := file.read(1 << 20):
        count += (end + chunk).count(mark)
        end = chunk[1 - len(mark) :]
    return count


def read_arrays(path: Path, what: str) -> dict[str, Any]:
    """The arrays of numbers and texts of an .npz file; ValueError as for :func:`read_members`, or if one has
    objects or claims another size than it has."""
    with opened(path, what, MAX_UNPACKED) as file:
        members = read_members(file, str(path))
    return {name.removesuffix(".npy"): _array(x, f"{path}: {shown(name)}") for name, x in members.items()}


def _array(data: bytes, where: str) -> Any:
    """An array of the format of NumPy, which would make room for any size that a header claims."""
    import numpy as np
    from numpy.lib import format as npy

    file = io.BytesIO(data)
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    try:
        reader = readers.get(npy.read_magic(file))
        if reader is None:
            raise ValueError("its version is another than 1.0 and 2.0")
        shape, fortran, dtype = reader(file)
        if dtype.kind not in "biufU":
            raise ValueError(f"it holds {shown(dtype)}; numbers and texts are read")
        count, left = math.prod(shape), len(data) - file.tell()
        if count * dtype.itemsize != left:
            raise ValueError(
                f"it claims {shown(count)} values of {dtype.itemsize} bytes, and has {left} bytes"
            )
        return np.frombuffer(data, dtype, offset=file.tell()).reshape(shape, order="F" if fortran else "C")
    except Exception as error:  # a header of a stranger may raise any error
        raise ValueError(f"{where} is damaged: {' '.join(str(error).split())[:200]}") from None
