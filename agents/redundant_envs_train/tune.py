"""A search of a learner's settings with Optuna: each trial is a training, and a journal keeps the study."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from redundant_envs.support import bounded
from redundant_envs.support.disk import alone, write_text
from redundant_envs.support.extras import needs
from redundant_envs.support.progress import progress_bars
from redundant_envs.support.tables import markdown
from redundant_envs.support.values import check_between

from . import command, pages, run_folder
from .config import Config
from .config.search import Space, own_values, space_of, with_values
from .training.many import in_processes
from .training.pool import Stopped, count_of

with needs("tune"):
    import optuna
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend
    from optuna.trial import TrialState

optuna.logging.set_verbosity(optuna.logging.ERROR)  # trials are told by trials.csv
MARK, JOURNAL = "study.json", "study.journal"  # what the study of a folder is of, and its trials
STARTUP, WARMUP = 5, 0.2  # complete trials, and share of a training, before one may be pruned
ENDED = (TrialState.COMPLETE, TrialState.PRUNED)  # trials that count; others were stopped, or still run
FEW = 10  # trials in the table of the page


def tune(
    config: Config, folder: Path, trials: int, searches: Sequence[str] = (), overrides: Sequence[str] = (),
    seed: int = 0, processes: int = 1, storage: str | None = None,
) -> Path:  # fmt: skip
    """Search the settings that hold most goals; returns the page tune.md. A trial is a training in
    ``folder``/trial<k>, judged by the last point of its curve. The same call goes on until the study, in
    ``folder`` or in a ``storage`` that others share, has ``trials``. Stopped if the user asked for it."""
    check_between("trials", trials, 1, 10_000)
    check_between("seed", seed, 0, 2**32 - 1)
    if config.max_seconds is not None:
        raise ValueError(f"max_seconds is {config.max_seconds:g}; trials take equal steps: give null")
    config = run_folder.with_start(config)
    space, count = space_of(config, searches, overrides), count_of(processes)
    from .training.train import identity, make_sb3  # imports torch

    run = identity(config, make_sb3(config.env, 1, **config.env_kwargs).core)
    run_folder.check_study(folder, [MARK])
    folder.mkdir(parents=True, exist_ok=True)
    with alone(folder, "tunes"):
        asked = {**run, "search": space, "seed": seed}
        name = run_folder.begin_study(folder / MARK, asked, storage or JOURNAL)
        study = opened(storage or str(folder / JOURNAL), name, config)
        left = max(0, trials - (begun := ended(study)))
        if not begun:
            study.enqueue_trial(own_values(config, space))
        job = study, config, space, folder, trials, seed
        try:
            if count > 1:
                shares = (len(range(k, left, count)) for k in range(min(count, left)))
                jobs = {f"process {k}": (share, *job) for k, share in enumerate(shares, 1)}
                in_processes(_trials, jobs, count, config.torch_threads == 1)
            else:
                with progress_bars() as bars:
                    _trials(left, *job, bars)
        except KeyboardInterrupt:
            message = f"stopped after {ended(study)} of {trials} trials; the same command goes on"
            raise Stopped(message) from None
        return write(study, config, space, folder)


def ended(study: optuna.Study) -> int:
    return len(study.get_trials(deepcopy=False, states=ENDED))


def opened(storage: str, name: str, config: Config) -> optuna.Study:
    """The study of this name in a journal or a database, which may hold others."""
    try:
        if Path(storage).exists():  # Optuna would append to any file
            with bounded.opened(Path(storage), "journal", bounded.MAX_UNPACKED) as file:
                if (first := file.read(40)) and b'"op_code"' not in first:
                    raise ValueError("it is no journal of Optuna's")
        return optuna.create_study(
            storage=storage if "://" in storage else JournalStorage(JournalFileBackend(storage)),
            study_name=name, load_if_exists=True, direction="maximize",
            pruner=optuna.pruners.MedianPruner(STARTUP, int(WARMUP * config.total_steps)),
        )  # fmt: skip
    except Exception as error:  # a damaged file may raise any error
        reason = " ".join(str(error).split())[:300]
        raise ValueError(f"{storage} cannot be used ({reason}); choose another one") from error


def _trials(
    count: int, study: optuna.Study, config: Config, space: Space, folder: Path, trials: int, seed: int,
    bars: Any,
) -> str:  # fmt: skip
    """Train ``count`` more trials, or fewer if others have them until the study has enough."""
    from .training.trial import score

    enough = optuna.study.MaxTrialsCallback(trials, ENDED)
    study.optimize(lambda trial: score(trial, config, space, folder, seed, bars), count, callbacks=[enough])
    return f"{ended(study)} trials"


def write(study: optuna.Study, config: Config, space: Space, folder: Path) -> Path:
    """Write trials.csv, best.yaml and tune.md, which is returned; ValueError if no trial is complete."""
    from .training.trial import POINT

    frame = study.trials_dataframe(("number", "state", "value", "user_attrs", "params", "duration"))
    frame.columns = [name.removeprefix("user_attrs_").removeprefix("params_") for name in frame.columns]
    frame = frame.rename(columns={"number": "trial"})
    frame = frame.assign(state=frame["state"].str.lower(), seconds=frame["duration"].dt.total_seconds())
    there = [c for c in ("trial", "state", *POINT, "seconds", *space, "message") if c in frame]
    write_text(folder / "trials.csv", frame[there].to_csv(index=False))
    best = frame[frame["state"] == "complete"].sort_values("value", ascending=False)
    if best.empty:
        why = frame.get("message", frame["state"]).dropna()
        raise ValueError(f"no trial of {folder} was completed: {why.iloc[0]}")
    chosen = with_values(config, study.best_params).to_dict()
    write_text(folder / "best.yaml", yaml.safe_dump(chosen, sort_keys=False))
    rows = best[[*(columns := ("trial", *POINT, *space))]].head(FEW).values.tolist()
    cells = [[f"{cell:.4g}" if isinstance(cell, float) else cell for cell in row] for row in rows]
    page = pages.page(
        "tune", config=config, complete=len(best), trials=len(study.trials), searched=", ".join(space),
        untold=best["hold_success"].isna().all(), best=markdown(columns, cells),
        judge=command("train", folder / "best.yaml", "--seeds", "1..5"),
    )  # fmt: skip
    write_text(folder / "tune.md", page)
    return folder / "tune.md"
