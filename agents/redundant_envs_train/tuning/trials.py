"""Trials of a study: how they are judged, and best.yaml, trials.csv and tune.md of all.

A trial has a position in the order of the study. Its settings, and whether it is pruned, follow from the
trials before it except the last few, ``ahead`` of them. So those few may still run, and the study is the
same however many run at a time and whichever ends first.
"""

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from redundant_envs.disk import write_text
from redundant_envs.extras import needs
from redundant_envs.tables import markdown, write_rows

from .. import command, pages
from ..config import Config
from .search import Space, own_parameters, with_parameters, words

with needs("tune"):
    import optuna
    from optuna.trial import FrozenTrial, Trial, TrialState, create_trial

MESSAGE, STEPS, POINTS, ORDER = "message", "env_steps", "points", "order"
"""Attributes of a trial: why it failed, the environment steps of its last point, all points of its curve
(steps, hold success, mean return), and its position in the study."""
STATES = ("complete", "pruned", "refused", "stopped", "running")
COLUMNS = ("trial", "state", "hold_success", "return", "env_steps", "seconds")
"""Columns of trials.csv, before a column for each key of the search space and the message."""
SHOWN = 10  # number of trials in the table of the page
LEAST_TRIALS = 10  # number of complete trials from which on importance is estimated
LARGEST = math.log1p(sys.float_info.max)  # of the logarithm of a return
STARTUP_TRIALS = 5  # least number of complete trials before a trial is pruned: a median of fewer means little
WARMUP = 0.2  # least share of a training before it may be pruned: at first no policy holds any goal


def state_of(trial: FrozenTrial) -> str:
    """How a trial ended, one of ``STATES``; those of other machines may still run."""
    if trial.state is TrialState.RUNNING:
        return "running"
    if trial.state is TrialState.COMPLETE:
        return "complete"
    if trial.state is TrialState.PRUNED:
        return "refused" if MESSAGE in trial.user_attrs else "pruned"
    return "stopped"


def ended(study: optuna.Study) -> list[FrozenTrial]:
    """Trials that were not stopped or killed."""
    return study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.PRUNED))


def order_of(trial: FrozenTrial) -> int:
    """Position of a trial in the study; one that is repeated after a break has that of the first."""
    return int(trial.user_attrs[ORDER])


def known(hold: float | None) -> float:
    """A hold success for the sampler: 0 where the task does not tell it, so that the return alone ranks."""
    return 0.0 if hold is None or math.isnan(hold) else hold


def held(trial: FrozenTrial) -> float | None:
    """Hold success of the last point of a trial; None if it has none, or the task does not tell it."""
    points = trial.user_attrs.get(POINTS)
    return points[-1][1] if points else trial.value


def score(hold: float | None, returned: float | None, episodes: int) -> float:
    """Hold success, 0 if the task does not tell it, and a share of the return that is less than half of one
    goal of ``episodes``."""
    hold = known(hold)
    if returned is None or math.isnan(returned):
        return hold - 0.5 / episodes
    share = math.copysign(min(math.log1p(abs(returned)) / LARGEST, 1.0), returned)
    return hold + 0.5 * share / episodes


def return_of(trial: FrozenTrial) -> float:
    """Mean return of the last point of a trial; the lowest possible number if it has none."""
    points = trial.user_attrs.get(POINTS) or [(0, 0.0, None)]
    last = points[-1][2]
    return -math.inf if last is None else float(last)


def complete(study: optuna.Study) -> list[FrozenTrial]:
    """Complete trials, the best first: by hold success, if the task tells it, then by return, of equal ones
    the earlier."""
    trials = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    return sorted(trials, key=lambda trial: (-(trial.value or 0.0), -return_of(trial), order_of(trial)))


def write(study: optuna.Study, config: Config, space: Space, folder: Path) -> Path:
    """Write best.yaml, trials.csv and tune.md, which is returned; without a complete one only trials.csv."""
    trials = study.get_trials(deepcopy=False)
    rows = [_row(trial) for trial in trials if trial.state is not TrialState.WAITING]
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
    hold = trial.value if state in ("complete", "pruned") and held(trial) is not None else ""
    hold = "" if hold is None else hold
    returned = return_of(trial) if trial.user_attrs.get(POINTS) else ""
    return {
        "trial": trial.number, "state": state, "hold_success": hold, "return": returned,
        "env_steps": trial.user_attrs.get(STEPS, 0), "seconds": seconds, **trial.params,
        MESSAGE: trial.user_attrs.get(MESSAGE, ""),
    }  # fmt: skip


def page(study: optuna.Study, config: Config, space: Space, folder: Path) -> str:
    """The text of tune.md."""
    best = complete(study)
    states = [state_of(trial) for trial in study.get_trials(deepcopy=False)]
    counts = ", ".join(f"{states.count(state)} {state}" for state in STATES if state in states)
    rows = []
    for trial in best[:SHOWN]:
        numbers = (trial.params[key] for key in space)
        cells = (f"{number:.4g}" if isinstance(number, float) else number for number in numbers)
        hold = "-" if held(trial) is None else f"{100 * (trial.value or 0.0):.1f} %"
        rows.append((trial.number, hold, f"{return_of(trial):.1f}", *cells))
    shares = [(key, f"{100 * share:.0f} %") for key, share in importance(study).items()]
    return pages.page(
        "tune", config=config, counts=counts, complete=len(best),
        untold=all(held(trial) is None for trial in best),
        judge=command("train", folder / "best.yaml", "--seeds", "1..5"),
        best=markdown(("trial", "hold success", "mean return", *space), rows),
        searched=", ".join(f"{key} {words(searched)}" for key, searched in space.items()),
        shares=shares and markdown(("setting", "share"), shares),
    )  # fmt: skip


def importance(study: optuna.Study) -> dict[str, float]:
    """Share of each setting in the differences of hold success; empty where there are too few trials, or
    these do not differ."""
    values = [trial.value for trial in complete(study)]
    if len(values) < LEAST_TRIALS or len(set(values)) == 1:
        return {}
    evaluator = optuna.importance.PedAnovaImportanceEvaluator()
    return dict(optuna.importance.get_param_importances(study, evaluator=evaluator))


class Judge:
    """One trial: its settings, the points of its learning curve, and whether the others were better.

    ``order`` is its position in the study, from 0; it ignores the ``ahead`` trials just before it. ``seed``
    is that of the study's sampler.
    """

    def __init__(
        self, study: optuna.Study, config: Config, space: Space, order: int, ahead: int, seed: int
    ) -> None:
        self.order, self.config = order, config
        before = sorted((t for t in ended(study) if order_of(t) < order - ahead), key=order_of)
        own_seed = int(np.random.SeedSequence((seed, order)).generate_state(1)[0])  # by position alone
        self.history = optuna.create_study(
            direction="maximize", sampler=optuna.samplers.TPESampler(seed=own_seed),
            pruner=optuna.pruners.MedianPruner(STARTUP_TRIALS, int(WARMUP * config.total_steps)),
        )  # fmt: skip
        self.history.add_trials([self._scored(trial) for trial in before])
        if order == 0:
            self.history.enqueue_trial(own_parameters(config, space))
        study.enqueue_trial(self.history.ask(space).params, user_attrs={ORDER: order})
        self.trial: Trial = study.ask(space)
        self.points: list[tuple[int, float, float]] = []

    def add(self, steps: int, hold: float, returned: float) -> bool:
        """Add a point: environment steps, hold success (0 to 1), mean return; True if the trial is to end."""
        again = bool(self.points) and steps == self.points[-1][0]  # the end may coincide with a point
        if not again:
            self.points.append((steps, hold, returned))
        self.trial.set_user_attr(STEPS, steps)
        plain = [[number if math.isfinite(number) else None for number in point] for point in self.points]
        self.trial.set_user_attr(POINTS, plain)  # JSON, in the journal
        if again or steps >= self.config.total_steps:
            return False
        self.trial.report(known(hold), steps)
        return self._prunes()

    def _prunes(self) -> bool:
        """Whether the trials before it were better at its last point."""
        running = create_trial(
            state=TrialState.RUNNING, params=self.trial.params, distributions=self.trial.distributions,
            intermediate_values=self._scores(self.points),
        )  # fmt: skip
        return bool(self.history.pruner.prune(self.history, running))

    @property
    def hold(self) -> float:
        """Hold success of the last point, for the sampler."""
        return known(self.points[-1][1]) if self.points else 0.0

    def _scored(self, trial: FrozenTrial) -> FrozenTrial:
        """A trial judged by its score instead of hold success alone."""
        scores = self._scores(trial.user_attrs.get(POINTS, []))
        complete = trial.state is TrialState.COMPLETE
        return create_trial(
            state=trial.state, params=trial.params, distributions=trial.distributions,
            value=list(scores.values())[-1] if complete else None, intermediate_values=scores,
        )  # fmt: skip

    def _scores(self, points: Any) -> dict[int, float]:
        episodes = self.config.curve_episodes
        return {int(steps): score(hold, returned, episodes) for steps, hold, returned in points}


class OwnFirst(optuna.samplers.TPESampler):
    """Optuna's sampler for machines that share a study, whose first trial has the configuration's own values.

    The storage numbers trials one by one; a queued trial may be taken by two machines at once.
    """

    def __init__(self, config: Config, space: Space) -> None:
        super().__init__(constant_liar=True)
        self._own = own_parameters(config, space)

    def sample_independent(
        self, study: optuna.Study, trial: FrozenTrial, param_name: str, param_distribution: Any
    ) -> Any:
        if trial.number == 0 and param_name in self._own:
            return self._own[param_name]
        return super().sample_independent(study, trial, param_name, param_distribution)


class SharedJudge(Judge):
    """One trial of a study that other machines share: Optuna's own sampler and pruner judge it by all trials
    that have ended by then, so its settings depend on which end first."""

    def __init__(self, study: optuna.Study, config: Config, space: Space) -> None:
        self.config, self.points = config, []
        self.trial = study.ask(space)
        self.order = self.trial.number
        self.trial.set_user_attr(ORDER, self.order)

    def _prunes(self) -> bool:
        return self.trial.should_prune()
