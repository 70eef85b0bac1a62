"""Several runs at a time, in separate processes, each on its own core."""

import multiprocessing
import queue
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from threading import Event
from typing import Any

from redundant_envs.support.disk import alone, check_plain
from redundant_envs.support.extras import needs

from .. import run_folder
from ..config import Config, checked
from ..start import with_start
from .pool import POLL, News, ask_to_stop, count_of, follow, places, settle, start

with needs("train"):
    from rich.progress import Progress


def train_many(configs: Mapping[str, Config], folder: Path, processes: int | None = None) -> None:
    """Train, evaluate and report configurations in folders by their names, some ``processes`` at a time, each
    on its own core while there are enough; finished ones are left alone. Stopped if the user asked for it."""
    run_folder.check_out(folder)
    check_plain(folder)
    count = min(count_of(processes), len(configs))
    configs = {name: with_start(config) for name, config in configs.items()}
    for name, config in configs.items():
        check_same(config, folder / name)
    folder.mkdir(parents=True, exist_ok=True)
    with alone(folder, "trains seeds"):
        context = multiprocessing.get_context("spawn")
        jobs, news, stopping = context.Queue(), context.Queue(), context.Event()
        for name, config in configs.items():
            jobs.put((name, config.to_dict(), str(folder / name)))
        own_core = all(config.torch_threads == 1 for config in configs.values())
        workers = [start(context, _work, jobs, news, stopping, core) for core in places(count, own_core)]
        for _ in workers:
            jobs.put(None)
        names = list(configs)
        follow(names, lambda stop: _reports(names, workers, news, stopping, stop))


def check_same(config: Config, folder: Path) -> None:
    """Refuse a folder that holds a run of another configuration, or in another scene."""
    if not (folder / "config.yaml").is_file():
        return
    if run_folder.read_config(folder).to_dict() != config.to_dict():
        raise ValueError(f"{folder} holds a run of another configuration; choose another --out or delete it")
    if other := run_folder.difference(folder):
        raise ValueError(
            f"{folder} holds a run in another scene ({other}); choose another --out or delete it"
        )


def _reports(
    names: Sequence[str], workers: Sequence[Any], news: Any, stopping: Any, stop: Event
) -> Iterator[News]:
    """Reports of the processes; runs whose processes ended without one have failed."""
    left = list(names)
    while left:
        if stop.is_set():
            stopping.set()
        alive = any(worker.is_alive() for worker in workers)
        try:
            report: News = news.get(timeout=POLL)
        except queue.Empty:
            if alive:
                continue
            codes = ", ".join(str(worker.exitcode) for worker in workers if worker.exitcode)
            yield from ((name, 1.0, f"its process ended ({codes or 'early'})", True) for name in left)
            return
        if report[1] == 1.0:
            left.remove(report[0])
        yield report


class Teller(Progress):
    """Progress that ``tell`` sends to another process; ``stopping`` says whether the user has asked to
    stop."""

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


def _work(jobs: Any, news: Any, stopping: Any, core: int | None, modules: Sequence[str] = ()) -> None:
    """Finish jobs until none is left, or the user has asked to stop."""
    settle(core, modules)
    while (job := jobs.get()) is not None and not stopping.is_set():
        name, data, place = job
        try:
            finish(checked(Config, data), Path(place), Teller(news.put, stopping.is_set, name))
            news.put((name, 1.0, result_of(Path(place)), False))
        except KeyboardInterrupt:
            return
        except Exception as error:
            news.put((name, 1.0, str(error), True))


def result_of(folder: Path) -> str:
    """The hold success of an evaluated run in words; its mean return if the task tells no success."""
    result = run_folder.read_evaluation(folder)
    hold = result["hold_success"]
    return f"mean return {result['mean_return']:.1f}" if hold is None else f"holds {100 * hold:.1f} %"


def is_finished(folder: Path) -> bool:
    """Whether a run is trained to its end, evaluated and reported."""
    trained = (folder / "training.json").is_file() and not run_folder.read_facts(folder)["stopped"]
    evaluated = all((folder / name).is_file() for name in run_folder.RESULTS)
    return trained and evaluated and not run_folder.find_checkpoint(folder)


def finish(config: Config, folder: Path, progress: Progress) -> None:
    """Train, evaluate and report a configuration, as far as this is not done yet."""
    from ..report import report
    from .train import begin_again, resume, train

    if is_finished(folder):
        return
    if not (folder / "config.yaml").is_file():
        train(config, folder, progress)
    elif run_folder.find_checkpoint(folder):
        resume(folder, progress, [f"telemetry=[{','.join(config.telemetry)}]"])
    elif not (folder / "training.json").is_file() or run_folder.read_facts(folder)["stopped"]:
        begin_again(config, folder, progress)
    report(folder)
