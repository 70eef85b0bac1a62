"""A search of a learner's settings with Optuna: each trial is a training, and a journal keeps the study."""

import hashlib
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from redundant_envs.scenes.files import text_value
from redundant_envs.support import bounded
from redundant_envs.support.disk import alone, write_text
from redundant_envs.support.extras import needs
from redundant_envs.support.progress import progress_bars
from redundant_envs.support.tables import markdown
from redundant_envs.support.values import check_between, shown

from . import command, pages, run_folder
from .config import Config, checked
from .config.files import written
from .training.many import in_processes
from .training.pool import Stopped, count_of

with needs("tune"):
    import optuna
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend
    from optuna.trial import TrialState

optuna.logging.set_verbosity(optuna.logging.ERROR)  # trials are told by trials.csv
PPO = {
    "learning_rate": "5e-4..2e-2", "gamma": "0.9..0.99", "gae_lambda": "0.8..0.98", "n_epochs": "1..4",
    "batch_size": "512|1024|2048|4096", "ent_coef": "1e-3..3e-2", "clip_range": "0.1..0.4",
    "average": "0.8|0.9|0.95", "smoothness": "3e-2..1",
}  # fmt: skip
OFF_POLICY = {
    "learning_rate": "1e-3..2e-2", "gamma": "0.8..0.98", "batch_size": "128|256|512",
    "gradient_steps": "4..24", "tau": "1e-2..1e-1", "ent_coef": "1e-4..1e-2", "policy_delay": "1..4",
    "average": "0.998|0.9995|0.9998", "smoothness": "1e-2..1", "smoothness_at_goal": "0.1..3",
    "n_sampled_goal": "2..8", "action_noise": "0.03..0.3",
}  # fmt: skip
"""Default searches, of those settings that a learner has, with the presets' values inside."""
MARK = "study.json"  # what the study of a folder is of
JOURNAL, POINT = "study.journal", ("hold_success", "return", "env_steps")  # last point; None: it is not told
STARTUP, WARMUP = 5, 0.2  # complete trials, and share of a training, before one may be pruned
FEW = 10  # trials in the table of the page
Space = dict[str, Any]  # by key, a distribution of Optuna; choices are texts


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

    searched = {key: distribution._asdict() for key, distribution in space.items()}
    run = identity(config, make_sb3(config.env, 1, **config.env_kwargs).core)
    asked = json.loads(json.dumps({**run, "search": searched, "seed": seed}))
    run_folder.check_study(folder, [MARK])
    folder.mkdir(parents=True, exist_ok=True)
    with alone(folder, "tunes"):
        begin_study(folder / MARK, {**asked, "storage": storage or JOURNAL})
        study = opened(storage or str(folder / JOURNAL), config, asked)
        job = study, config, space, folder, trials, seed
        left = max(0, trials - (begun := ended(study)))
        if not begun:
            study.enqueue_trial(own_values(config, space))
        try:
            if count > 1:
                jobs = {f"process {k + 1}": (range(k, left, count), *job) for k in range(min(count, left))}
                in_processes(_trials, jobs, count, config.torch_threads == 1)
            else:
                with progress_bars() as bars:
                    _trials(range(left), *job, bars)
        except KeyboardInterrupt:
            told = f"stopped after {ended(study)} of {trials} trials; the same command goes on"
            raise Stopped(told) from None
        return write(study, config, space, folder)


def space_of(config: Config, searches: Sequence[str] = (), overrides: Sequence[str] = ()) -> Space:
    """The space of ``searches``, ``key=low..high`` or ``key=a|b|c``; by default that of the learner, without
    the settings that ``overrides`` name."""
    fields = {f"{config.algo}.{name}": field for name, field in type(config.settings).model_fields.items()}
    fixed, space = {override.partition("=")[0].strip() for override in overrides}, Space()
    own = {f"{config.algo}.{k}": v for k, v in (PPO if "ppo" in config.algo else OFF_POLICY).items()}
    for text in searches or [f"{k}={v}" for k, v in own.items() if k in fields.keys() - fixed]:
        key, _, what = (part.strip() for part in text.partition("="))
        if key not in fields:
            raise ValueError(f"search key {shown(key)} is unknown; valid: {', '.join(fields)}")
        if key in space or key in fixed:
            raise ValueError(f"{key} has a value or another search; leave one out")
        is_range = ".." in what
        values: Any = [_setting(config, key, part) for part in what.split(".." if is_range else "|")]
        numbers = all(isinstance(value, int | float) for value in values)
        if len(values) < 2 or (is_range and not (numbers and len(values) == 2 and values[0] < values[1])):
            raise ValueError(f"search of {key} is {shown(what)}; write low..high, the lower first, or a|b|c")
        if is_range:
            (low, high), is_whole = values, fields[key].annotation is int
            space[key] = (IntDistribution if is_whole else FloatDistribution)(
                low, high, 0.0 < 10.0 * low <= high
            )
        else:
            space[key] = CategoricalDistribution([*map(written, values)])
    if not space:
        raise ValueError("every setting of the default search has a value; give --search key=low..high")
    return space


def _setting(config: Config, key: str, given: Any) -> Any:
    """A number, or a text of a value, as the setting of the learner; ValueError if it is not allowed."""
    value = text_value(given, f"the value {shown(given)}") if isinstance(given, str) else given
    name = key.partition(".")[2]
    return getattr(checked(type(config.settings), {name: value}, f"{config.algo}."), name)


def with_values(config: Config, parameters: dict[str, Any]) -> Config:
    """A configuration with the parameters of a trial; ValueError if they do not go together."""
    data = config.to_dict()
    data[config.algo] |= {key.partition(".")[2]: _setting(config, key, v) for key, v in parameters.items()}
    chosen: Config = checked(Config, data)
    return chosen


def own_values(config: Config, space: Space) -> dict[str, Any]:
    """The parameters for the settings of a configuration, as far as the space contains them."""
    found: dict[str, Any] = {}
    for key, within in space.items():
        own = getattr(config.settings, key.partition(".")[2])
        if isinstance(within, CategoricalDistribution):
            if (own := written(own)) in within.choices:
                found[key] = own
        elif own != "auto" and within.low <= own <= within.high:
            found[key] = own
    return found


def ended(study: optuna.Study) -> int:
    """Number of trials that count; others were stopped, or still run."""
    return len(study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.PRUNED)))


def begin_study(path: Path, asked: dict[str, Any]) -> None:
    """Write what the study of a folder is of, or refuse a folder whose study is of something else."""
    digest = hashlib.sha256(asked["storage"].encode()).hexdigest()  # its URL may have a password
    now = {**asked, "storage": digest}
    if not path.exists():
        run_folder.write_json(path, now)
        return
    try:
        differing = run_folder.first_difference(bounded.read_json(path, "study"), now)
    except (ValueError, AttributeError):
        raise ValueError(f"{path} is damaged, or no study's; choose another --out") from None
    if differing:
        name, theirs, own = differing
        raise ValueError(
            f"{path.parent} holds a study with {name}: {theirs}, and this one has {own}; choose another --out"
        )


def opened(kept: str, config: Config, asked: dict[str, Any]) -> optuna.Study:
    """The study of these settings in a journal or a database, which may hold others."""
    name = hashlib.sha256(json.dumps(asked).encode()).hexdigest()
    try:
        if Path(kept).exists():  # Optuna would append to any file
            with bounded.opened(Path(kept), "journal", bounded.MAX_UNPACKED) as file:
                if (first := file.read(40)) and b'"op_code"' not in first:
                    raise ValueError("it is no journal of Optuna's")
        return optuna.create_study(
            storage=kept if "://" in kept else JournalStorage(JournalFileBackend(kept)),
            study_name=name, load_if_exists=True, direction="maximize",
            pruner=optuna.pruners.MedianPruner(STARTUP, int(WARMUP * config.total_steps)),
        )  # fmt: skip
    except Exception as error:  # a damaged file may raise any error
        reason = " ".join(str(error).split())[:300]
        raise ValueError(f"{kept} cannot be used ({reason}); choose another one") from error


def _trials(
    numbers: range, study: optuna.Study, config: Config, space: Space, folder: Path, trials: int, seed: int,
    bars: Any,
) -> str:  # fmt: skip
    """Train more trials, one for each of ``numbers``, until the study has enough."""
    from .training import checkpoint
    from .training.train import train

    def score(trial: optuna.Trial) -> float:
        value, place = -1.0, folder / f"trial{trial.number}"
        run_folder.check_new(place)

        def on_point(steps: int, hold: float, returned: float) -> None:
            nonlocal value
            # of equal hold successes the return decides, with less than half the weight of a goal
            share = 0.5 * returned / (1.0 + abs(returned)) / config.curve_episodes
            value = (0.0 if math.isnan(hold) else hold) + share
            for name, number in zip(POINT, (hold, returned, steps), strict=True):
                trial.set_user_attr(name, None if math.isnan(number) else number)
            if steps < config.total_steps:
                trial.report(value, steps)
                if trial.should_prune():
                    raise optuna.TrialPruned

        try:
            train(with_values(config, trial.params), place, bars, on_point)
        finally:
            checkpoint.remove(place)
        return value

    for k in numbers:
        if ended(study) >= trials:
            break
        own = np.random.SeedSequence((seed, len(study.trials), k)).generate_state(1)  # a study that goes on
        study.sampler = optuna.samplers.TPESampler(seed=int(own[0]), constant_liar=True)  # draws anew
        trial = study.ask(space)
        try:
            study.tell(trial, score(trial))
        except optuna.TrialPruned:
            study.tell(trial, state=TrialState.PRUNED)
        except (ValueError, ArithmeticError, RuntimeError) as error:  # refused, or not finite
            trial.set_user_attr("message", " ".join(str(error).split()))
            study.tell(trial, state=TrialState.PRUNED)
        except KeyboardInterrupt:
            study.tell(trial, state=TrialState.FAIL)
            raise
    return f"{ended(study)} trials"


def write(study: optuna.Study, config: Config, space: Space, folder: Path) -> Path:
    """Write trials.csv, best.yaml and tune.md, which is returned; ValueError if no trial is complete."""
    frame = study.trials_dataframe(("number", "state", "value", "user_attrs", "params", "duration"))
    frame.columns = [name.removeprefix("user_attrs_").removeprefix("params_") for name in frame.columns]
    frame = frame.rename(columns={"number": "trial"}).assign(seconds=frame["duration"].dt.total_seconds())
    written_columns = [c for c in ("trial", "state", *POINT, "seconds", *space, "message") if c in frame]
    told = frame[written_columns].assign(state=frame["state"].str.lower())
    write_text(folder / "trials.csv", told.to_csv(index=False))
    best = frame[frame["state"] == "COMPLETE"].sort_values("value", ascending=False)
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
