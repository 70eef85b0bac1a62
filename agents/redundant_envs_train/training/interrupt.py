"""Ctrl-C and SIGTERM as a request to end a training in order."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from dataclasses import dataclass


class Stopped(KeyboardInterrupt):
    """A run was stopped by its user; the message says what was kept and how to continue."""


@dataclass
class Request:
    """Whether the user asked to stop."""

    made: bool = False


@contextlib.contextmanager
def stop_request() -> Iterator[Request]:
    """Within this context the first SIGINT or SIGTERM is kept as a request; a second one interrupts at once.

    In a thread other than the main one, which receives no signals, the request is never made.
    """
    request = Request()
    if threading.current_thread() is not threading.main_thread():
        yield request
        return

    def note(number: int, frame: object) -> None:
        if request.made:
            raise KeyboardInterrupt
        request.made = True

    # a signal that is ignored, as by nohup or in a worker, stays ignored
    heard = [n for n in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(n) is not signal.SIG_IGN]
    before = {number: signal.signal(number, note) for number in heard}
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)
