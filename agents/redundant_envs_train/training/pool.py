"""Requests to end a training in order, and several runs at a time: their seeds, places and progress."""

import contextlib
import os
import re
import signal
import stat
import sys
import threading
from collections.abc import Callable, Iterator, Sequence

from redundant_envs.support.progress import progress_bars
from redundant_envs.support.values import say

from ..config import MAX_SEEDS

POLL = 0.2  # s; longest time without a look whether the user asked to stop
MAX_PROCESSES = 1024
STOPPING = (
    "stopping: each run saves a checkpoint and ends. A second Ctrl-C ends at once, and what they learned "
    "since their last checkpoints is lost"
)
News = tuple[str, float, str, bool]  # name of a run, share done (1.0: it ended), note, whether it failed
_requests: list[threading.Event] = []  # of the trainings here that can still be asked to stop


class Stopped(KeyboardInterrupt):
    """A run was stopped by its user; the message says what was kept and how to continue."""


@contextlib.contextmanager
def stop_request() -> Iterator[threading.Event]:
    """Within this context the first SIGINT, SIGTERM or SIGHUP is kept as a request; a second interrupts at
    once. In other threads than the main one, which get no signals, :func:`ask_to_stop` alone makes it."""
    request = threading.Event()

    def note(number: int, frame: object) -> None:
        if number == getattr(signal, "SIGHUP", None):
            _leave_terminal()
        elif request.is_set():
            raise KeyboardInterrupt
        request.set()

    is_main = threading.current_thread() is threading.main_thread()
    known = [getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGHUP") if is_main and hasattr(signal, n)]
    _requests.append(request)
    # a signal that is ignored, as by nohup or in a worker, stays ignored
    before = {n: signal.signal(n, note) for n in known if signal.getsignal(n) is not signal.SIG_IGN}
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)
        _requests.remove(request)


def ask_to_stop() -> None:
    """Make the request of :func:`stop_request` without a signal: those may be ignored, as in job scripts, and
    on Windows they end a process at once."""
    for request in _requests:
        request.set()


def _leave_terminal() -> None:
    """Write no more to a terminal that is closed: an error there would end a training before it is saved."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):  # a stream without a descriptor
            if stat.S_ISCHR(os.fstat(stream.fileno()).st_mode) and not stream.isatty():
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, stream.fileno())
                os.close(nowhere)


def follow(names: Sequence[str], pool: Callable[[threading.Event], Iterator[News]]) -> None:
    """Show the reports of ``pool`` until all runs have ended; Stopped, or ValueError if one failed."""
    failures, announced = [], False
    with progress_bars() as bars, stop_request() as stop:
        lines = {name: bars.add_task(name, total=1.0, note="waits", start=False) for name in names}
        for name, share, note, failed in pool(stop):
            if stop.is_set() and not announced:
                announced = True
                say(STOPPING, file=sys.stderr)
            if failed:
                failures.append(f"{name}: {note}")
            bars.start_task(lines[name])
            bars.update(lines[name], completed=share, note=f"failed: {note}" if failed else note)
    if stop.is_set():
        raise Stopped("stopped; the same command with the same --out goes on")
    if failures:
        count = f"{len(failures)} of {len(names)} runs failed"
        raise ValueError(f"{count}; the same command goes on: {'; '.join(failures)}")


def seeds_of(text: str) -> list[int]:
    """Seeds as a user writes them: ``0..9``, or ``1,4,7``, or both."""
    seeds: list[int] = []
    prefix = f"seeds is {text[:80]!r}"
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,4})(?:\.\.(\d{1,4}))?\s*", part)
        if not match:
            raise ValueError(f"{prefix}; write such as 0..9 or 1,4,7, with seeds from 0 to {MAX_SEEDS}")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise ValueError(f"{prefix}; write the lower one first, {last}..{first}")
        seeds += range(first, last + 1)
    if not seeds or len(set(seeds)) < len(seeds):
        raise ValueError(f"{prefix}; give different seeds from 0 to {MAX_SEEDS}")
    return seeds


def cores() -> list[int]:
    """Cores that this process may use; empty if the system does not report them."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []


def count_of(processes: int | None) -> int:
    """Runs at a time on this machine: ``processes``, or one for each core."""
    count = (len(cores()) or os.cpu_count() or 1) if processes is None else processes
    if not 1 <= count <= MAX_PROCESSES:
        raise ValueError(f"processes is {count}; give a whole number from 1 to {MAX_PROCESSES}")
    return count
