"""A study: trials, kept in a file from which the same command continues."""

import hashlib
import json
import math
import os
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from redundant_envs.bounded import read_bytes, read_text
from redundant_envs.disk import alone, write_bytes, write_text
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.extras import needs
from redundant_envs.progress import progress_bars
from redundant_envs.values import shown

from ..config import WITHOUT_EFFECT, Config
from ..run_folder import check_study
from ..start import with_start
from ..training import checkpoint, telemetry
from ..training.pool import Stopped, stop_request
from ..training.train import simulator_hash, train
from .search import Space, check_arguments, space_of, with_parameters, words
from .trials import (
    MESSAGE,
    STARTUP_TRIALS,
    WARMUP,
    Judge,
    OwnFirst,
    SharedJudge,
    complete,
    ended,
    held,
    order_of,
    return_of,
    write,
)
from .workers import Pruned, news, outcome, workers

with needs("tune"):
    import optuna
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend, JournalFileSymlinkLock
    from optuna.trial import TrialState
    from rich.progress import Progress

JOURNAL = "study.journal"
SHARED = "study.storage"  # a digest of the storage whose trials are in a folder; its URL may have a password
LEAST_JOURNAL = 1 << 23  # bytes that a journal may have, whatever its study: those of some hundred trials
STUDY = "tune"  # name of the study in its file
SETTINGS = "settings"  # attribute of a study: the settings that identify it
ATTEMPTS = 5  # to open a storage, half a second apart
AHEAD = "ahead"
"""Attribute of a study: number of trials just before another one that it ignores, as they may still run."""
BEGINNING = 40  # bytes of a journal that tell one
LEAST_AHEAD = 3  # so four trials at a time give the results of one at a time


def tune(
    config: Config, folder: Path, trials: int, searches: Sequence[str] = (), overrides: Sequence[str] = (),
    seed: int = 0, processes: int = 1, storage: str | None = None,
) -> Path:  # fmt: skip
    """Search the settings that hold most goals at the end of a training.

    A trial is a training in ``folder``/trial<k>. It is ranked by the hold success at the last point of its
    learning curve, on the selection goals, and among equal ones by the mean return; goals of the
    evaluation are never used. A trial below the median of the others at the same point of the curve is
    pruned. The first trial has the settings of ``config``, as far as the search space of ``searches`` and
    ``overrides`` contains them; ``seed`` is the sampler's.

    ``folder`` is new or empty, or of the same study, which continues until it has ``trials``, without those
    that were stopped or killed. ``processes`` are trials at a time; the results are the same for 1 to 4. The
    page tune.md is returned; beside it are best.yaml and trials.csv. Stopped if the user asked for it: the
    same call continues.

    With a ``storage``, a database's URL or the file of a journal, other processes and machines may search the
    same study at the same time, each one trial at a time in a ``folder`` of its own, until there are
    ``trials`` in all; which trial ends first then changes the next ones.
    """
    check_arguments(config, trials, seed, processes)
    if storage is not None and processes != 1:
        raise ValueError(
            f"processes is {processes} beside a storage; give the same command once for each process"
        )
    telemetry.check(config)
    config = with_start(config)
    space = space_of(config, searches, overrides)
    check_study(folder, [JOURNAL if storage is None else SHARED])
    folder.mkdir(parents=True, exist_ok=True)
    with alone(folder, "tunes"):
        if storage is not None:
            if "://" not in storage:
                _check_journal(Path(storage))
            _check_storage(folder / SHARED, storage)
        if storage is None:
            _cut_half_line(folder / JOURNAL, _most_bytes(config, trials))
        study = _open(folder, config, space, seed, processes, storage)
        trying = (_Trying if storage is None else _Sharing)(study, config, space, folder, trials, seed)
        try:
            trying.fail()  # what a process left that was killed
            with progress_bars() as bars:
                if processes == 1:
                    trying.one_by_one(bars)
                else:
                    trying.several(bars, processes)
        except KeyboardInterrupt:
            trying.fail()
            count = len(ended(study))
            if complete(study):
                write(study, config, space, folder)
            raise Stopped(f"stopped after {count} of {trials} trials; the same command goes on") from None
        return write(study, config, space, folder)


def _open(
    folder: Path, config: Config, space: Space, seed: int, processes: int, storage: str | None
) -> optuna.Study:
    """The study of a folder or of a storage, new or from an earlier call."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    settings = _settings(config, space, seed)
    path: Any = storage or folder / JOURNAL
    sampler = OwnFirst(config, space) if storage else optuna.samplers.TPESampler(seed=seed)
    pruner = optuna.pruners.MedianPruner(STARTUP_TRIALS, int(WARMUP * config.total_steps))
    try:
        for left in reversed(range(ATTEMPTS if storage else 1)):
            try:
                kept = (
                    storage if storage and "://" in storage else JournalStorage(JournalFileBackend(str(path)))
                )
                study = optuna.create_study(
                    storage=kept, study_name=STUDY, direction="maximize", load_if_exists=True,
                    sampler=sampler, pruner=pruner,
                )  # fmt: skip
                break
            except Exception:  # two processes that make the tables of a new database hinder each other
                if not left:
                    raise
                time.sleep(0.5)
        found = study.user_attrs.get(SETTINGS)
        if found is None:
            study.set_user_attr(AHEAD, max(LEAST_AHEAD, processes - 1))
            study.set_user_attr(SETTINGS, settings)
        ahead = int(study.user_attrs[AHEAD])
    except Exception as error:  # a damaged file may raise any error
        reason = " ".join(str(error).split())[:300]
        advice = "give another one" if storage else "choose another --out or delete it"
        raise ValueError(f"{path} is damaged, or cannot be used ({reason}); {advice}") from error
    if any(trial.value is None or not 0.0 <= trial.value <= 1.0 for trial in complete(study)):
        raise ValueError(
            f"{path} is damaged (the hold success of a trial is invalid); choose another --out or delete it"
        )
    if processes > ahead + 1:
        raise ValueError(
            f"processes is {processes}, and the study in {folder} was begun for at most {ahead + 1} at a "
            "time; give at most so many, or choose another --out"
        )
    found = found or settings
    for name in (*settings, *found):
        if found.get(name) != settings.get(name):
            raise ValueError(
                f"{folder} holds a study with {name}: {shown(found.get(name))}, and this one has "
                f"{shown(settings.get(name))}; choose another --out"
            )
    return study


def _most_bytes(config: Config, trials: int) -> int:
    """Most bytes of the journal of a study, which become up to twenty times as many in memory: with each
    point of a trial it has a line with all points so far, and a trial may have begun again."""
    points = config.total_steps // config.curve_every + 1
    return max(LEAST_JOURNAL, trials * (2**15 + 2**11 * points + 2**7 * points**2))


def _cut_half_line(path: Path, most: int) -> None:
    """Cut off an incomplete last line, left by a kill: Optuna would append the next one to it. The file is
    written anew, since a copy of the folder may share it; ValueError if it has more than ``most`` bytes, or
    is no journal."""
    if path.exists():
        lines = read_bytes(path, "journal", most)
        if not _begins_journal(lines[:BEGINNING]):
            raise ValueError(
                f"out is {path.parent}, whose {path.name} is no journal of Optuna's; choose another --out"
            )
        write_bytes(path, lines[: lines.rfind(b"\n") + 1])


def _begins_journal(first: bytes) -> bool:
    """Whether a journal begins so, which may be empty, or have half a line."""
    return b'"op_code"' in first or b'{"op_code"'.startswith(first)


def _check_storage(note: Path, storage: str) -> None:
    """Note in the folder of a study which storage has its trials; refuse that of another one."""
    digest = hashlib.sha256(storage.encode()).hexdigest()
    if note.exists() and read_text(note, "storage", 1000).strip() != digest:
        raise ValueError(f"out is {note.parent}, which has trials of another storage; choose another --out")
    write_text(note, f"{digest}\n")


def _check_journal(path: Path) -> None:
    """Refuse a storage that is no journal of Optuna's, and cut off an incomplete last line, left by a kill:
    no process could read on from there. Others that append wait for the lock of the journal meanwhile."""
    wrong = f"storage is {path}, which is no journal of Optuna's; give one, a new name, or a database's URL"
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise ValueError(wrong)
    if not path.exists():
        return
    lock = JournalFileSymlinkLock(str(path))
    lock.acquire()
    try:
        with path.open("r+b") as file:
            if not _begins_journal(file.read(BEGINNING)):
                raise ValueError(wrong)
            end = file.seek(0, os.SEEK_END)
            while end > 0:
                start = max(0, end - 2**16)
                file.seek(start)
                if (found := file.read(end - start).rfind(b"\n")) >= 0:
                    start += found + 1
                    break
                end = start
            file.truncate(start if end > 0 else 0)
    finally:
        lock.release()


def _settings(config: Config, space: Space, seed: int) -> dict[str, Any]:
    """The settings that identify a study, as flat plain data; other settings cannot continue it."""
    data = config.to_dict()
    for name in WITHOUT_EFFECT:
        del data[name]
    own = data.pop(config.algo)
    data |= {f"{config.algo}.{name}": value for name, value in own.items()}
    core = make_sb3(config.env, 1, **config.env_kwargs).core
    data |= {"simulator": simulator_hash(core), "--seed": seed}
    data |= {f"--search {key}": words(searched) for key, searched in space.items()}
    plain: dict[str, Any] = json.loads(json.dumps(data))
    return plain


def _fail_running(study: optuna.Study, folder: Path) -> None:
    """Mark trials that were stopped or killed as failed; others replace them."""
    while study.get_trials(deepcopy=False, states=(TrialState.WAITING,)):  # killed before it began
        study.ask()
    for trial in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
        study.tell(trial.number, state=TrialState.FAIL)
        checkpoint.remove(folder / f"trial{trial.number}")


def _words(hold: float | None, returned: float) -> str:
    """A point of a curve in words: its hold success, or the return where the task tells none."""
    if hold is None or math.isnan(hold):
        return f"has a mean return of {returned:.1f}"
    return f"holds {100 * hold:.1f} %"


class _Trying:
    """Run the remaining trials of a study, one after another or several at a time."""

    def __init__(
        self, study: optuna.Study, config: Config, space: Space, folder: Path, trials: int, seed: int
    ) -> None:
        self.study, self.config, self.space, self.folder = study, config, space, folder
        self.trials, self.seed = trials, seed
        self.ahead = int(study.user_attrs[AHEAD])

    def one_by_one(self, bars: Progress) -> None:
        """Train in this process."""
        line = bars.add_task("tune", total=self.trials, note="")
        for order in self._left():
            self._show(bars, line)
            if (job := self._begin(order)) is None:
                continue
            judge, config, place = job

            def point(steps: int, hold: float, returned: float, judge: Judge = judge) -> None:
                if judge.add(steps, hold, returned):
                    raise Pruned

            self._end(judge, outcome(config, place, train, point, bars))
        self._show(bars, line)

    def several(self, bars: Progress, processes: int) -> None:
        """Train in processes; a trial begins when all trials on which it depends are over."""
        line = bars.add_task("tune", total=self.trials, note="")
        left, running = deque(self._left()), dict[int, tuple[Judge, Any]]()
        count = min(processes, len(left))
        with stop_request() as stop, workers(count, self.config) as team:
            while left or running:
                if stop.is_set():
                    raise KeyboardInterrupt
                for worker in team:
                    # all trials on which a trial depends are over
                    while (
                        worker.order is None
                        and left
                        and min(running, default=left[0]) >= left[0] - self.ahead
                    ):
                        order = left.popleft()
                        if (job := self._begin(order)) is None:
                            continue
                        judge, config, place = job
                        name = f"trial {judge.trial.number}"
                        running[order] = judge, bars.add_task(name, total=config.total_steps, note="")
                        worker.order = order
                        worker.pipe.send((config.to_dict(), str(place)))
                self._show(bars, line)
                for worker, message in news(team):
                    assert worker.order is not None
                    judge, bar = running[worker.order]
                    if message is None:
                        raise ValueError(
                            f"the process of trial {judge.trial.number} ended "
                            f"({worker.process.exitcode}); the same command goes on"
                        )
                    kind, content = message
                    if kind == "point":
                        bars.update(bar, completed=content[0], note=_words(content[1], content[2]))
                        worker.pipe.send(judge.add(*content))
                        continue
                    self._end(judge, content)
                    bars.remove_task(bar)
                    del running[worker.order]
                    worker.order = None
        self._show(bars, line)

    def fail(self) -> None:
        """Mark trials that were stopped or killed as failed; others replace them."""
        _fail_running(self.study, self.folder)

    def _left(self) -> Iterable[int]:
        """Positions of the trials that have not ended yet."""
        over = {order_of(trial) for trial in ended(self.study)}
        return [order for order in range(self.trials) if order not in over]

    def _begin(self, order: int) -> tuple[Judge, Config, Path] | None:
        """A trial, its configuration and folder; None if its settings are incompatible."""
        judge = self._judge(order)
        try:
            config = with_parameters(self.config, self.space, judge.trial.params)
        except ValueError as error:
            self._end(judge, " ".join(str(error).split())[:300])
            return None
        return judge, config, self.folder / f"trial{judge.trial.number}"

    def _judge(self, order: int) -> Judge:
        return Judge(self.study, self.config, self.space, order, self.ahead, self.seed)

    def _end(self, judge: Judge, how: str | None) -> None:
        """Report the end of a trial, as returned by :func:`~.workers.outcome`, to the study."""
        if how:
            judge.trial.set_user_attr(MESSAGE, how)
        if how == "":
            self.study.tell(judge.trial, judge.hold)
        else:
            self.study.tell(judge.trial, state=TrialState.PRUNED)

    def _show(self, bars: Progress, line: Any) -> None:
        best = complete(self.study)
        note = ""
        if best:
            note = f"best {_words(held(best[0]), return_of(best[0]))}, trial {best[0].number}"
        bars.update(line, completed=len(ended(self.study)), note=note)


class _Sharing(_Trying):
    """Run trials of a study that other machines share, until it has enough."""

    own: int | None = None
    """Number of the trial of this process."""

    def fail(self) -> None:
        """Mark the own trial, if one runs, as failed; those of others go on."""
        if self.own is not None:
            self.study.tell(self.own, state=TrialState.FAIL, skip_if_finished=True)

    def _left(self) -> Iterator[int]:
        while len(ended(self.study)) < self.trials:
            yield -1  # the study gives it a number

    def _judge(self, order: int) -> Judge:
        judge = SharedJudge(self.study, self.config, self.space)
        self.own = judge.order
        return judge
