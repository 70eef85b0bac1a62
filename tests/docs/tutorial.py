"""A tutorial page as a reader follows it: its files are written and its blocks run, in order, in one folder.

A block whose first line is a comment with nothing but a file name (``# third_arm.py``) is saved under that
name. Of the others, ``python`` blocks run as scripts, ``console`` blocks as the commands behind ``$ `` (the
other lines show output), and ``shell`` blocks as a whole; ``text`` blocks are only read.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FILE_NAME = re.compile(r"# ([\w./-]+\.\w+)\n")
READ_ONLY = ("", "text")


class Block(NamedTuple):
    """A block of code: the line of its beginning, its language, and its text."""

    line: int
    language: str
    text: str

    @property
    def file(self) -> str | None:
        """Name under which it is saved."""
        named = FILE_NAME.match(self.text)
        return named.group(1) if named else None


def blocks_of(page: Path) -> list[Block]:
    """All blocks of a page, in order."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(text.count("\n", 0, found.start(2)) + 1, found.group(1), found.group(2))
        for found in FENCE.finditer(text)
    ]


def run_tutorial(page: Path, folder: Path, seconds: float = 120.0, without: str | None = None) -> list[str]:
    """Follow a page in an empty folder; return what each block printed, errors included.

    Blocks that say ``without``, such as the command of a training, are not run. A block that ends with a
    status other than 0, or takes longer than ``seconds``, raises an AssertionError with its position, its
    text and its output.
    """
    outputs = []
    for block in blocks_of(page):
        if block.language in READ_ONLY or (without is not None and without in block.text):
            continue
        place = f"{page.name}, line {block.line}"
        if block.file is not None:
            path = folder / block.file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
            continue
        try:
            done = subprocess.run(
                _command(block, place), cwd=folder, env=_environment(), text=True, timeout=seconds,
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired as late:
            raise AssertionError(f"{place}: more than {seconds:g} s\n{block.text}\n{late.output}") from None
        assert done.returncode == 0, f"{place}: status {done.returncode}\n{block.text}\n{done.stdout}"
        outputs.append(done.stdout)
    return outputs


def _command(block: Block, place: str) -> list[str]:
    if block.language == "python":
        return [sys.executable, "-c", block.text]
    if block.language == "console":
        lines = [line[2:] for line in block.text.splitlines() if line.startswith("$ ")]
        assert lines, f"{place}: a console block without a command; begin commands with '$ '"
        return ["bash", "-e", "-o", "pipefail", "-c", "\n".join(lines)]
    if block.language in ("shell", "sh", "bash"):
        return ["bash", "-e", "-o", "pipefail", "-c", block.text]
    raise AssertionError(
        f"{place}: nothing runs a {block.language} block; begin it with a comment that names its file, or "
        "call it text"
    )


def _environment() -> dict[str, str]:
    """As with this package installed: its commands are found, and its modules are those of this checkout."""
    scripts = str(Path(sys.executable).parent)
    return {
        **os.environ,
        "PATH": os.pathsep.join((scripts, os.environ.get("PATH", ""))),
        "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "agents"))),
        "MPLBACKEND": "Agg",
    }
