"""Processes that train the trials of a study, each on its own core."""

import contextlib
import multiprocessing
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import connection
from pathlib import Path
from typing import Any

from redundant_envs.extras import needs

from ..config import Config, checked
from ..training.pool import POLL, places, settle, start

with needs("train"):
    from rich.progress import Progress

PATIENCE = 20.0  # s; grace period before a process is killed


class Pruned(Exception):
    """Raised to end the training of a trial, because others were better."""


@dataclass
class Worker:
    """A process, the end of its pipe, and the position of its trial in the study."""

    process: Any
    pipe: Any
    order: int | None = None


@contextlib.contextmanager
def workers(count: int, config: Config) -> Iterator[list[Worker]]:
    """Context with ``count`` processes, which end with it."""
    context = multiprocessing.get_context("spawn")
    made: list[Worker] = []
    try:
        for core in places(count, config.torch_threads == 1):
            ours, theirs = context.Pipe()
            process = start(context, _work, theirs, core)
            theirs.close()
            made.append(Worker(process, ours))
        yield made
    finally:
        for worker in made:
            worker.process.terminate()
        for worker in made:
            worker.process.join(PATIENCE)
            worker.process.kill()  # nothing happens to one that has ended
            worker.process.join()


def news(all_workers: list[Worker]) -> list[tuple[Worker, Any]]:
    """Messages of busy workers; None from a worker whose process ended."""
    by_pipe = {worker.pipe: worker for worker in all_workers if worker.order is not None}
    found = []
    for pipe in connection.wait(list(by_pipe), POLL):
        try:
            found.append((by_pipe[pipe], by_pipe[pipe].pipe.recv()))
        except (EOFError, OSError):
            found.append((by_pipe[pipe], None))
    return found


def _work(pipe: Any, core: int | None, modules: tuple[str, ...]) -> None:
    """Train the jobs from the pipe until None arrives; send each point, and receive whether to continue."""
    settle(core, modules)
    from ..training.train import train

    def point(steps: int, hold: float, returned: float) -> None:
        pipe.send(("point", (steps, hold, returned)))
        if pipe.recv():
            raise Pruned

    with contextlib.suppress(EOFError, BrokenPipeError, KeyboardInterrupt):
        while True:
            data, folder = pipe.recv()
            pipe.send(("end", outcome(checked(Config, data), Path(folder), train, point)))


def outcome(config: Config, folder: Path, train: Any, point: Any, bars: Progress | None = None) -> str | None:
    """Train once: "" after a complete training, None if it was pruned, or the reason of its failure."""
    from ..training import checkpoint

    try:
        train(config, folder, bars or Progress(disable=True), point)
    except Pruned:
        return None
    except (ValueError, ArithmeticError, RuntimeError) as error:  # refused, or its numbers became infinite
        return " ".join(str(error).split())[:300] or type(error).__name__
    finally:
        checkpoint.remove(folder)
    return ""
