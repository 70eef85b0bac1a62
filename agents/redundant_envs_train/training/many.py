"""Several runs at a time, in separate processes, each on its own core."""

import contextlib
import multiprocessing
import os
import queue
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from threading import Event
from typing import Any

from redundant_envs.support.disk import alone, check_plain
from redundant_envs.support.extras import needs
from redundant_envs.support.modules import IMPORTED, import_named

from .. import run_folder
from ..config import Config, checked
from .pool import POLL, News, ask_to_stop, cores, count_of, follow

with needs("train"):
    from rich.progress import Progress


def train_many(configs: Mapping[str, Config], folder: Path, processes: int | None = None) -> None:
    """Train, evaluate and report configurations in folders by their names, some ``processes`` at a time, each
    on its own core while there are enough; finished ones are left alone. Stopped if the user asked for it."""
    count = count_of(processes)
    configs = {name: run_folder.with_start(config) for name, config in configs.items()}
    jobs = {name: (config.to_dict(), str(folder / name)) for name, config in configs.items()}
    with prepared(configs, folder):
        in_processes(_train_one, jobs, count, all(config.torch_threads == 1 for config in configs.values()))


def _train_one(data: dict[str, Any], place: str, progress: Progress) -> str:
    finish(checked(Config, data), Path(place), progress)
    return result_of(Path(place))


def in_processes(work: Callable[..., str], jobs: Mapping[str, Any], count: int, own_cores: bool) -> None:
    """Do ``work(*job, progress)`` for each job in ``count`` processes, each on a core of its own if they need
    one and there are enough, and show progress. Stopped or ValueError as in :func:`follow`."""
    context = multiprocessing.get_context("spawn")
    waiting, news, stopping = context.Queue(), context.Queue(), context.Event()
    for job in jobs.items():
        waiting.put(job)
    core_ids, team = cores(), []
    for k in range(count := min(count, len(jobs))):
        waiting.put(None)
        core = core_ids[k] if own_cores and count <= len(core_ids) else None
        args = work, waiting, news, stopping, core, tuple(IMPORTED)
        team.append(context.Process(target=_work, args=args, daemon=True))
        team[-1].start()
    follow([*jobs], lambda stop: _reports([*jobs], team, news, stopping, stop))


@contextlib.contextmanager
def prepared(configs: Mapping[str, Config], folder: Path) -> Iterator[None]:
    """Within this context the folder of runs is this process's own; ValueError if one of them is of another
    configuration, or in another scene."""
    run_folder.check_out(folder)
    check_plain(folder)
    for place, config in ((folder / name, config) for name, config in configs.items()):
        if (place / "config.yaml").is_file():
            other = run_folder.difference(place)
            if run_folder.read_config(place).to_dict() != config.to_dict():
                other = "of another configuration"
            if other:
                raise ValueError(f"{place} holds another run ({other}); choose another --out or delete it")
    folder.mkdir(parents=True, exist_ok=True)
    with alone(folder, "trains seeds"):
        yield


def _reports(names: list[str], team: Sequence[Any], news: Any, stopping: Any, stop: Event) -> Iterator[News]:
    """Reports of the processes; runs whose processes ended without one have failed."""
    left = list(names)
    while left:
        if stop.is_set():
            stopping.set()
        alive = any(worker.is_alive() for worker in team)
        try:
            report: News = news.get(timeout=POLL)
        except queue.Empty:
            if alive:
                continue
            codes = ", ".join(str(worker.exitcode) for worker in team if worker.exitcode)
            yield from ((name, 1.0, f"its process ended ({codes or 'early'})", True) for name in left)
            return
        if report[1] == 1.0:
            left.remove(report[0])
        yield report


class Teller(Progress):
    """Progress that ``tell`` sends to another process; ``stopping``: whether the user has asked to stop."""

    def __init__(self, tell: Callable[[News], Any], stopping: Callable[[], bool], name: str) -> None:
        super().__init__(disable=True)
        self.tell, self.stopping, self.name = tell, stopping, name

    def update(self, task_id: Any, **changes: Any) -> None:
        """Send the share done and the note; without a reader the training ends."""
        if self.stopping():
            ask_to_stop()
        parent = multiprocessing.parent_process()
        if parent is not None and not parent.is_alive():
            raise KeyboardInterrupt
        total = self._tasks[task_id].total or 1.0
        if "completed" in changes:
            self.tell((self.name, 0.99 * changes["completed"] / total, changes.get("note", ""), False))


def _work(
    work: Callable[..., str], jobs: Any, news: Any, stopping: Any, core: int | None, modules: Sequence[str]
) -> None:
    """Do jobs until none is left, or the user has asked to stop."""
    # Ctrl-C of a terminal reaches all processes: only the first one reacts, and asks the others to stop.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for module in modules:
        import_named(module)
    if core is not None:
        os.sched_setaffinity(0, {core})
    while (named := jobs.get()) is not None and not stopping.is_set():
        name, job = named
        try:
            news.put((name, 1.0, work(*job, Teller(news.put, stopping.is_set, name)), False))
        except KeyboardInterrupt:
            return
        except Exception as error:
            news.put((name, 1.0, str(error), True))


def result_of(folder: Path) -> str:
    """The hold success of an evaluated run in words; its mean return if the task tells no success."""
    result = run_folder.read_evaluation(folder)
    hold = result["hold_success"]
    return f"mean return {result['mean_return']:.1f}" if hold is None else f"holds {100 * hold:.1f} %"


def is_trained(folder: Path) -> bool:
    return (folder / "training.json").is_file() and not run_folder.read_facts(folder)["stopped"]


def is_finished(folder: Path) -> bool:
    """Whether a run is trained to its end, evaluated and reported."""
    evaluated = all((folder / name).is_file() for name in run_folder.RESULTS)
    return is_trained(folder) and evaluated and not run_folder.find_checkpoint(folder)


def finish(config: Config, folder: Path, progress: Progress) -> None:
    """Train, evaluate and report a configuration, as far as this is not done yet."""
    from ..report import report
    from .train import resume, train

    if is_finished(folder):
        return
    if not (folder / "config.yaml").is_file():
        train(config, folder, progress)
    elif (there := run_folder.find_checkpoint(folder)) or not is_trained(folder):
        resume(folder, progress, [f"telemetry=[{','.join(config.telemetry)}]"], again=not there)
    report(folder)
