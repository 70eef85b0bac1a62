"""Several runs at a time: the protocol of a place where they go on, how they are followed, and processes."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence

from redundant_envs.modules import import_named
from redundant_envs.progress import progress_bars

from .amount import cores
from .interrupt import Request, Stopped, stop_request

POLL = 0.2
"""s; longest time without a look whether the user asked to stop."""
News = tuple[str, float, str, bool]
"""Name of a run, share done (1.0: it ended), note, whether it failed."""


Pool = Callable[[Request], Iterator[News]]
"""A place where runs go on: its reports until all have ended. On request each saves a checkpoint and ends."""


def follow(names: Sequence[str], pool: Pool) -> None:
    """Show the progress of runs until they end; Stopped or ValueError if they were stopped or one failed."""
    failures = []
    with progress_bars() as bars, stop_request() as stop:
        lines = {name: bars.add_task(name, total=1.0, note="waits", start=False) for name in names}
        for name, share, note, failed in pool(stop):
            if failed:
                failures.append(f"{name}: {note}")
            bars.start_task(lines[name])
            bars.update(lines[name], completed=share, note=f"failed: {note}" if failed else note)
    if stop.made:
        raise Stopped("stopped; the same command with the same --out goes on")
    if failures:
        raise ValueError(
            f"{len(failures)} of {len(names)} runs failed; the same command goes on: {'; '.join(failures)}"
        )


def places(count: int, alone: bool) -> Sequence[int | None]:
    """A core for each of ``count`` processes, if each needs one ``alone`` and there are enough."""
    own = cores()
    return own[:count] if alone and count <= len(own) else [None] * count


def settle(core: int | None, modules: Iterable[str]) -> None:
    """Prepare a process for trainings: on a core of its own, with the modules of the user."""
    # Ctrl-C of a terminal reaches all processes: only the first one reacts, and sends SIGTERM to the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for module in modules:
        import_named(module)
    if core is not None:
        os.sched_setaffinity(0, {core})
