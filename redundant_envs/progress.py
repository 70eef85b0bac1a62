"""A progress bar on standard error, without a package."""

from __future__ import annotations

import sys
import time

WIDTH = 24


class Progress:
    """Counts finished parts and estimates the remaining time.

    On a terminal one line is redrawn; elsewhere each count is a line.

    Parameters
    ----------
    name : str
    total : int
        Counts until the end.
    """

    def __init__(self, name: str, total: int) -> None:
        self.name, self.total, self.done = name, total, 0
        self._start = time.monotonic()

    def step(self, what: str) -> None:
        """Count one more finished part, described by ``what``."""
        self.done += 1
        left = (time.monotonic() - self._start) * (self.total / self.done - 1.0)
        minutes, seconds = divmod(round(left), 60)
        filled = WIDTH * self.done // self.total
        bar = "#" * filled + "." * (WIDTH - filled)
        text = f"{self.name} [{bar}] {self.done}/{self.total}, {minutes}:{seconds:02d} left: {what}"
        terminal = sys.stderr.isatty()
        end = "\n" if not terminal or self.done == self.total else ""
        print(f"\r\x1b[K{text[:110]}" if terminal else text, end=end, file=sys.stderr, flush=True)
