"""What a study found: best.yaml, trials.csv and tune.md."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from redundant_envs.extras import needs
from redundant_envs.studies.common import write_rows

from .. import command
from ..config import Config
from ..run_folder import write_text
from .search import Space, with_parameters

with needs("tune"):
    import optuna
    from optuna.trial import FrozenTrial, TrialState

MESSAGE, STEPS = "message", "env_steps"
"""Attributes of a trial: why it failed, and the environment steps of its last point."""
STATES = ("complete", "pruned", "refused", "stopped")
COLUMNS = ("trial", "state", "hold_success", "env_steps", "seconds")
"""Of trials.csv, before a column for each key of the search space and the message."""
SHOWN = 10
"""Trials in the table of the page."""
LEAST_TRIALS = 10
"""Complete trials from which importance is estimated."""


def state_of(trial: FrozenTrial) -> str:
    """How a trial ended, one of ``STATES``; one that runs counts as stopped."""
    if trial.state is TrialState.COMPLETE:
        return "complete"
    if trial.state is TrialState.PRUNED:
        return "refused" if MESSAGE in trial.user_attrs else "pruned"
    return "stopped"


def ended(study: optuna.Study) -> list[FrozenTrial]:
    """Trials that nobody stopped or killed."""
    return study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.PRUNED))


def complete(study: optuna.Study) -> list[FrozenTrial]:
    """Complete trials, the best first, of equal ones the earlier."""
    trials = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    return sorted(trials, key=lambda trial: (-(trial.value or 0.0), trial.number))


def write(study: optuna.Study, config: Config, space: Space, folder: Path) -> Path:
    """Write best.yaml, trials.csv and tune.md; returns the last.

    Raises
    ------
    ValueError
        No trial was completed; trials.csv is there.
    """
    rows = [
        _row(trial) for trial in study.get_trials(deepcopy=False) if trial.state is not TrialState.WAITING
    ]
    write_rows(rows, (*COLUMNS, *space, MESSAGE), folder / "trials.csv")
    best = complete(study)
    if not best:
        messages = [row[MESSAGE] for row in rows if row[MESSAGE]]
        why = f": {messages[0]}" if messages else ""
        raise ValueError(f"no trial of {folder} was completed{why}")
    chosen = with_parameters(config, space, best[0].params)
    write_text(folder / "best.yaml", yaml.safe_dump(chosen.to_dict(), sort_keys=False))
    target = folder / "tune.md"
    write_text(target, page(study, config, space, folder))
    return target


def _row(trial: FrozenTrial) -> dict[str, Any]:
    state = state_of(trial)
    seconds = f"{trial.duration.total_seconds():.1f}" if trial.duration else ""
    hold = trial.value if state in ("complete", "pruned") and trial.value is not None else ""
    return {
        "trial": trial.number, "state": state, "hold_success": hold,
        "env_steps": trial.user_attrs.get(STEPS, 0), "seconds": seconds, **trial.params,
        MESSAGE: trial.user_attrs.get(MESSAGE, ""),
    }  # fmt: skip


def page(study: optuna.Study, config: Config, space: Space, folder: Path) -> str:
    """The text of tune.md."""
    best = complete(study)
    states = [state_of(trial) for trial in study.get_trials(deepcopy=False)]
    counts = ", ".join(f"{states.count(state)} {state}" for state in STATES if state in states)
    keys = list(space)
    rows = [
        f"| {trial.number} | {100 * (trial.value or 0.0):.1f} % | "
        f"{' | '.join(_number(trial.params[key]) for key in keys)} |"
        for trial in best[:SHOWN]
    ]
    lines = [
        f"# Tuning of {config.label} on {config.env}", "",
        f"Trials: {counts}. Hold success is that of the last point of the learning curve, on "
        f"{config.curve_episodes} selection goals. The search has seen these goals, and the best of many is "
        "lucky too: judge `best.yaml` by other seeds and the goals of the evaluation, with "
        f"`{command('train', folder / 'best.yaml', '--seeds', '1..5')}`.", "",
        f"| trial | hold success | {' | '.join(keys)} |", "|---|---|" + "---|" * len(keys), *rows, "",
        f"Searched: {', '.join(f'{key} {searched}' for key, searched in space.items())}.", "",
    ]  # fmt: skip
    shares = importance(study)
    if shares:
        lines += [
            f"Importance for hold success (PED-ANOVA, {len(best)} complete trials):", "",
            "| setting | share |", "|---|---|",
            *(f"| {key} | {100 * share:.0f} % |" for key, share in shares.items()), "",
        ]  # fmt: skip
    return "\n".join(lines)


def importance(study: optuna.Study) -> dict[str, float]:
    """Share of each setting in the differences of hold success; empty where there are too few trials."""
    values = [trial.value for trial in complete(study)]
    if len(values) < LEAST_TRIALS or len(set(values)) == 1:
        return {}
    evaluator = optuna.importance.PedAnovaImportanceEvaluator()
    return dict(optuna.importance.get_param_importances(study, evaluator=evaluator))


def _number(parameter: Any) -> str:
    return f"{parameter:.4g}" if isinstance(parameter, float) else str(parameter)
