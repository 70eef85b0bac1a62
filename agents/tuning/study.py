"""A study: trials one after another, kept in a file from which the same command goes on."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.extras import needs
from redundant_envs.values import shown

from ..config import WITHOUT_EFFECT, Config
from ..run_folder import check_out
from ..training import checkpoint, telemetry
from ..training.interrupt import Stopped
from ..training.train import simulator_hash, train
from ..training.watch import progress_bars
from .results import MESSAGE, STEPS, complete, ended, write
from .search import Space, own_parameters, space_of, with_parameters

with needs("tune"):
    import optuna
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend
    from optuna.trial import Trial, TrialState

JOURNAL, LOCK = "study.journal", "study.lock"
STUDY = "tune"
"""Name of the study in its file."""
SETTINGS = "settings"
"""Attribute of a study: what it belongs to."""
MOST_TRIALS = 10_000
MOST_SEED = 2**32 - 1
STARTUP_TRIALS = 5
"""Complete trials before one is pruned: a median of fewer says little."""
WARMUP = 0.2
"""Share of a training before it is pruned: at first no policy holds anything."""


def tune(
    config: Config, folder: Path, trials: int, searches: Sequence[str] = (), overrides: Sequence[str] = (),
    seed: int = 0,
) -> Path:  # fmt: skip
    """Search the settings that hold most goals at the end of a training.

    A trial is a training in ``folder``/trial<k>. It is judged by the hold success of the last point of its
    learning curve, on the selection goals; goals of the evaluation are never used. A trial below the median
    of the others at the same point of the curve is pruned.

    Parameters
    ----------
    config : Config
        All but what is searched. The first trial has its own values, where the search space has them.
    folder : Path
        New or empty, or of the same study, which goes on until it has ``trials``.
    trials : int
        In all; those that were stopped or killed are not counted.
    searches, overrides : sequence of str
        As of :func:`~.search.space_of`.
    seed : int
        Of the sampler.

    Returns
    -------
    Path
        The page tune.md; beside it are best.yaml and trials.csv.

    Raises
    ------
    Stopped
        The user asked to stop; the same call goes on.
    ValueError
        An argument is not allowed, ``folder`` is of another study, or no trial was completed.
    """
    if not 1 <= trials <= MOST_TRIALS:
        raise ValueError(f"trials is {trials}; give a whole number from 1 to {MOST_TRIALS}")
    if not 0 <= seed <= MOST_SEED:
        raise ValueError(f"seed is {seed}; give a whole number from 0 to {MOST_SEED}")
    if config.max_seconds is not None:
        raise ValueError(
            f"max_seconds is {config.max_seconds:g}; trials are compared at equal steps: give "
            "max_seconds=null and total_steps"
        )
    telemetry.check(config)
    space = space_of(config, searches, overrides)
    check_out(folder)
    if folder.exists() and any(folder.iterdir()) and not (folder / JOURNAL).is_file():
        raise ValueError(f"out is {folder}, which holds other files and no study; choose another --out")
    folder.mkdir(parents=True, exist_ok=True)
    with _alone(folder):
        study = _open(folder, config, space, seed)
        try:
            _fail_running(study, folder)  # of a process that was killed
            with progress_bars() as bars:
                line = bars.add_task("tune", total=trials, note="")
                while (count := len(ended(study))) < trials:
                    bars.update(line, completed=count, note=_note(study))
                    _run_trial(study, config, space, folder, _sampler_seed(seed, count), bars)
                bars.update(line, completed=trials, note=_note(study))
        except KeyboardInterrupt:
            _fail_running(study, folder)
            count = len(ended(study))
            if complete(study):
                write(study, config, space, folder)
            raise Stopped(f"stopped after {count} of {trials} trials; the same command goes on") from None
        return write(study, config, space, folder)


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Refuse a folder in which another process tunes, where the system has locks of files."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    with (folder / LOCK).open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise ValueError(
                f"out is {folder}, in which another process tunes; wait for its end, or choose another --out"
            ) from None
        yield


def _open(folder: Path, config: Config, space: Space, seed: int) -> optuna.Study:
    """The study of a folder, new or as it was left."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    settings = _settings(config, space, seed)
    pruner = optuna.pruners.MedianPruner(STARTUP_TRIALS, int(WARMUP * config.total_steps))
    path = folder / JOURNAL
    _cut_half_line(path)
    try:
        study = optuna.create_study(
            storage=JournalStorage(JournalFileBackend(str(path))), study_name=STUDY, direction="maximize",
            load_if_exists=True, pruner=pruner,
        )  # fmt: skip
        found = study.user_attrs.get(SETTINGS)
        if found is None:
            study.set_user_attr(SETTINGS, settings)
    except Exception as error:  # a damaged file fails in any way
        reason = " ".join(str(error).split())[:300]
        raise ValueError(f"{path} is damaged ({reason}); choose another --out or delete it") from error
    if any(trial.value is None or not 0.0 <= trial.value <= 1.0 for trial in complete(study)):
        raise ValueError(
            f"{path} is damaged (a trial's hold success is none); choose another --out or delete it"
        )
    found = found or settings
    for name in (*settings, *found):
        if found.get(name) != settings.get(name):
            raise ValueError(
                f"{folder} holds a study with {name}: {shown(found.get(name))}, and this one has "
                f"{shown(settings.get(name))}; choose another --out"
            )
    return study


def _cut_half_line(path: Path) -> None:
    """Cut off what a kill or a power cut left of a line: Optuna would write the next one behind it."""
    if path.is_file():
        whole = path.read_bytes().rfind(b"\n") + 1
        if whole < path.stat().st_size:
            os.truncate(path, whole)


def _settings(config: Config, space: Space, seed: int) -> dict[str, Any]:
    """What a study belongs to, as flat plain data; another one does not go on with it."""
    data = config.to_dict()
    for name in WITHOUT_EFFECT:
        del data[name]
    own = data.pop(config.algo)
    data |= {f"{config.algo}.{name}": value for name, value in own.items()}
    core = make_sb3(config.env, 1, **config.env_kwargs).core
    data |= {"simulator": simulator_hash(core), "--seed": seed}
    data |= {f"--search {key}": str(searched) for key, searched in space.items()}
    plain: dict[str, Any] = json.loads(json.dumps(data))
    return plain


def _sampler_seed(seed: int, count: int) -> int:
    """The sampler's seed of a trial: it follows from the trials before, and not from breaks between them."""
    return int(np.random.SeedSequence((seed, count)).generate_state(1)[0])


def _fail_running(study: optuna.Study, folder: Path) -> None:
    """Mark trials that somebody stopped or killed as failed; others take their place."""
    for trial in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
        study.tell(trial.number, state=TrialState.FAIL)
        checkpoint.remove(folder / f"trial{trial.number}")


def _note(study: optuna.Study) -> str:
    best = complete(study)
    return f"best holds {100 * (best[0].value or 0.0):.1f} %, trial {best[0].number}" if best else ""


def _run_trial(study: optuna.Study, config: Config, space: Space, folder: Path, seed: int, bars: Any) -> None:
    """Train once, and report the result to the study."""
    study.sampler = optuna.samplers.TPESampler(seed=seed)
    waiting = study.get_trials(deepcopy=False, states=(TrialState.WAITING,))
    if not ended(study) and not waiting:
        study.enqueue_trial(own_parameters(config, space))
    trial = study.ask({key: searched.distribution() for key, searched in space.items()})
    place = folder / f"trial{trial.number}"
    curve = _Curve(trial, config.total_steps)
    try:
        train(with_parameters(config, space, trial.params), place, bars, curve.add)
    except optuna.TrialPruned:
        study.tell(trial, state=TrialState.PRUNED)
    except (ValueError, ArithmeticError, RuntimeError) as error:  # refused, or it learned numbers without end
        trial.set_user_attr(MESSAGE, " ".join(str(error).split())[:300])
        study.tell(trial, state=TrialState.PRUNED)
    else:
        study.tell(trial, curve.hold)
    finally:
        checkpoint.remove(place)


class _Curve:
    """Reports the points of a learning curve to a trial, and ends it where the others were better.

    ``total_steps`` is the training's; the point there ends it anyway.
    """

    def __init__(self, trial: Trial, total_steps: int) -> None:
        self.trial, self.total_steps = trial, total_steps
        self.steps, self.hold = -1, 0.0

    def add(self, steps: int, hold: float) -> None:
        """Take a point: environment steps and hold success, 0 to 1; TrialPruned ends the training."""
        again = steps == self.steps  # the end of a training may meet a point
        self.steps, self.hold = steps, hold
        self.trial.set_user_attr(STEPS, steps)
        if steps < self.total_steps and not again:
            self.trial.report(hold, steps)
            if self.trial.should_prune():
                raise optuna.TrialPruned
