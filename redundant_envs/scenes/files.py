"""Files of users: YAML that is read as plain data, within bounds, with one clear message on a mistake."""

import contextlib
import hashlib
import sys
from collections.abc import Iterator
from os.path import exists as exists  # False for a text that cannot be a path
from pathlib import Path
from typing import Any

from redundant_envs.compiler.backends import cache
from redundant_envs.support import bounded

LARGEST_FILE = 1 << 15
"""Bytes: eight times the longest existing description; the reader takes a fifth of a second for it."""


def read_yaml(path: Path, what: str) -> Any:
    """The content of a YAML file, such as a "scene", as plain data; a ValueError with file and line if it is
    unreadable, longer than 32 KiB, not UTF-8 or not plain data."""
    return parse_yaml(read_text(path, what), str(path))


def read_text(path: Path, what: str) -> str:
    """The text of a file, within bounds; see :func:`read_yaml`."""
    return bounded.read_text(path, what, LARGEST_FILE)


def parse_yaml(text: str, where: str) -> Any:
    """The content of YAML text, as plain data; ``where`` names it in messages."""
    from redundant_envs.support.yaml_reader import parsed  # takes a tenth of the time to a first step

    return parsed(text, where)


def shipped_data(path: Path, what: str) -> Any:
    """The content of a file of the package. The folder of the user keeps it under what it follows from: the
    text of the file, and that of a reader that nobody has imported before, and so has not replaced."""
    text = read_text(path, what)
    if "yaml" in sys.modules:
        return parse_yaml(text, str(path))
    reader = (Path(__file__).parents[1] / "support" / "yaml_reader.py").read_text(encoding="utf-8")
    name = hashlib.sha256(f"{text}\0{reader}".encode()).hexdigest()[:40]
    return cache.facts(name, lambda: {"data": parse_yaml(text, str(path))})["data"]


def text_value(text: str, where: str) -> Any:
    """The value of a text such as the right-hand side of ``key=value``."""
    if len(text) > LARGEST_FILE:
        raise ValueError(f"{where} has more than {LARGEST_FILE} characters; give fewer")
    return parse_yaml(text, where)


@contextlib.contextmanager
def explained(path: str | Path) -> Iterator[None]:
    """Put the file before the message of a ValueError about its data, and the line if it is known."""
    try:
        yield
    except ValueError as error:
        from redundant_envs.support.yaml_reader import line_of

        line = line_of(str(error), read_text(Path(path), "file"))
        raise ValueError(f"{path}{f', line {line}' if line else ''}: {error}") from None
