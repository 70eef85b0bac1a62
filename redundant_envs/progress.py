"""Progress of a command on standard error."""

from __future__ import annotations

import contextlib
import importlib.util
import itertools
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from redundant_envs.extras import needs

if TYPE_CHECKING:
    from rich.progress import Progress


def progress_bars() -> Progress:
    """Lines of progress on a terminal or in a notebook; every task has a ``note``."""
    with needs("train"):
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:3.0f} %"),
        TextColumn("{task.fields[note]}"), TimeElapsedColumn(), TimeRemainingColumn(),
        console=console, redirect_stdout=sys.stdout.isatty(),
        disable=not (console.is_terminal or console.is_jupyter),
    )  # fmt: skip


@contextlib.contextmanager
def counted(name: str, total: int, each: int = 1) -> Iterator[Callable[[str], None]]:
    """A function that counts one more finished part of ``total`` and takes its description: it moves a bar on
    a terminal, if rich is installed, or writes a line every ``each`` counts."""
    if sys.stderr.isatty() and importlib.util.find_spec("rich"):
        with progress_bars() as bars:
            task = bars.add_task(name, total=total, note="")
            yield lambda what: bars.update(task, advance=1, note=what)
        return
    counts = itertools.count(1)

    def line(what: str) -> None:
        count = next(counts)
        if count % each == 0:
            print(f"{name} {count // each}/{total // each}: {what}", file=sys.stderr, flush=True)

    yield line
