"""Progress of a command on standard error."""

import contextlib
import itertools
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from redundant_envs.support.extras import needs
from redundant_envs.support.values import printable, say

if TYPE_CHECKING:
    from rich.progress import Progress

EVERY = 10.0  # s; time between two lines of progress where there is no terminal


def progress_bars() -> "Progress":
    """Progress whose tasks have a ``note``: bars on a terminal or in a notebook, else a line every 10 s."""
    with needs("train"):
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
        from rich.text import Text

    class Plain(TextColumn):  # names of files are no markup
        def render(self, task: Any) -> Text:
            return Text(printable(self.text_format.format(task=task)))

    class Lines(Progress):  # all tasks that are under way in each
        last = time.monotonic()

        def update(self, task_id: Any, **changes: Any) -> None:
            super().update(task_id, **changes)
            under_way = [task for task in self.tasks if task.started and not task.finished]
            if time.monotonic() - self.last >= EVERY:
                self.last = time.monotonic()
                if under_way:
                    say("; ".join(map(_line, under_way)), file=sys.stderr, flush=True)

    console = Console(stderr=True)
    if not (console.is_terminal or console.is_jupyter):
        return Lines(disable=True)
    return Progress(
        Plain("{task.description}"), BarColumn(), Plain("{task.percentage:3.0f} %"),
        Plain("{task.fields[note]}"), TimeElapsedColumn(), TimeRemainingColumn(),
        console=console, redirect_stdout=bool(sys.stdout and sys.stdout.isatty()),
    )  # fmt: skip


def _line(task: Any) -> str:
    """A task in words: its share, note, time so far and time left."""
    left = "" if task.time_remaining is None else f", {task.time_remaining:.0f} s left"
    note = f", {task.fields['note']}" if task.fields["note"] else ""
    return f"{task.description}: {task.percentage:.0f} %{note}, {task.elapsed or 0.0:.0f} s{left}"


@contextlib.contextmanager
def counted(name: str, total: int, each: int = 1) -> Iterator[Callable[[str], None]]:
    """A function that counts one more finished part of ``total`` and takes its description; it writes a line
    every ``each`` counts."""
    counts = itertools.count(1)

    def line(what: str) -> None:
        count = next(counts)
        if count % each == 0:
            say(f"{name} {count // each}/{total // each}: {what}", file=sys.stderr, flush=True)

    yield line
