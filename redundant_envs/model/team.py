"""Threads that share the blocks of a memory; they change no bit."""

from __future__ import annotations

import itertools
import os
import threading
import weakref
from collections.abc import Callable
from queue import SimpleQueue

import numpy as np

from redundant_envs.model.memory import Memory
from redundant_envs.model.programs import Part, Simulator


class Worker:
    """A thread that runs the calls it is given, one after another, and ends with this object.

    A call begins after 15 us, with an executor of the standard library after 21 (Zen 5, 2026-11-23); a
    step of 4096 lanes takes 200 to 1000 us.
    """

    def __init__(self) -> None:
        self._asked: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._done: SimpleQueue[BaseException | None] = SimpleQueue()
        threading.Thread(
            target=_serve, args=(self._asked, self._done), name="redundant-envs worker", daemon=True
        ).start()
        weakref.finalize(self, self._asked.put, None)

    def begin(self, call: Callable[[], None]) -> None:
        self._asked.put(call)

    def finish(self) -> None:
        """Wait until the call is done, and only then raise an interrupt: until then it writes to memory."""
        interrupt = None
        while True:
            try:
                error = self._done.get()
                break
            except KeyboardInterrupt as again:
                interrupt = again
        if interrupt or error:
            raise interrupt or error  # type: ignore[misc]


def _serve(asked: SimpleQueue[Callable[[], None] | None], done: SimpleQueue[BaseException | None]) -> None:
    while (call := asked.get()) is not None:
        try:
            call()
        except BaseException as error:
            done.put(error)
        else:
            done.put(None)


class Team:
    """A kernel on all blocks of a memory, with the given number of threads."""

    def __init__(self, simulator: Simulator, name: str, memory: Memory, threads: int) -> None:
        cuts = np.linspace(0, memory.blocks, min(threads, memory.blocks) + 1).astype(int).tolist()
        self.parts = [Part(simulator, name, memory, a, b) for a, b in itertools.pairwise(cuts)]
        self._start()

    def _start(self) -> None:
        """Threads belong to a process: a forked process starts its own."""
        self._workers = [Worker() for _ in self.parts[1:]]
        self._process = os.getpid()

    def __call__(self) -> None:
        for part in self.parts:
            part.set_pointers()
        if len(self.parts) > 1 and self._process != os.getpid():
            self._start()
        for worker, part in zip(self._workers, self.parts[1:], strict=True):
            worker.begin(part)
        try:
            self.parts[0]()  # the calling thread works, too
        finally:
            for worker in self._workers:
                worker.finish()
