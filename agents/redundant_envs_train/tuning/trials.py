"""Trials of a study: the results on which their settings depend, and when they are pruned.

A trial has a position in the order of the study. Its settings, and whether it is pruned, follow from the
trials before it except the last few, ``ahead`` of them. So those few may still run, and the study is the
same however many run at a time and whichever ends first.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from redundant_envs.extras import needs

from ..config import Config
from .results import ORDER, POINTS, STEPS, ended, order_of, score
from .search import Space, own_parameters

with needs("tune"):
    import optuna
    from optuna.trial import FrozenTrial, Trial, TrialState, create_trial

STARTUP_TRIALS = 5
"""Least number of complete trials before a trial is pruned: a median of fewer means little."""
WARMUP = 0.2
"""Least share of a training before it may be pruned: at first no policy holds any goal."""


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
        self.history = optuna.create_study(
            direction="maximize", sampler=optuna.samplers.TPESampler(seed=_sampler_seed(seed, order)),
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
        self.trial.set_user_attr(POINTS, [list(map(_plain, point)) for point in self.points])
        if again or steps >= self.config.total_steps:
            return False
        self.trial.report(hold, steps)
        running = create_trial(
            state=TrialState.RUNNING, params=self.trial.params, distributions=self.trial.distributions,
            intermediate_values=self._scores(self.points),
        )  # fmt: skip
        return bool(self.history.pruner.prune(self.history, running))

    @property
    def hold(self) -> float:
        """Hold success of the last point."""
        return self.points[-1][1] if self.points else 0.0

    def _scored(self, trial: FrozenTrial) -> FrozenTrial:
        """A trial judged by its score instead of hold success alone."""
        points = trial.user_attrs.get(POINTS, [])
        scores = self._scores(points)
        complete = trial.state is TrialState.COMPLETE
        return create_trial(
            state=trial.state, params=trial.params, distributions=trial.distributions,
            value=list(scores.values())[-1] if complete else None, intermediate_values=scores,
        )  # fmt: skip

    def _scores(self, points: Any) -> dict[int, float]:
        episodes = self.config.curve_episodes
        return {int(steps): score(hold, returned, episodes) for steps, hold, returned in points}


def _plain(number: float) -> float | None:
    """A number in the precision of the journal."""
    return number if math.isfinite(number) else None


def _sampler_seed(seed: int, order: int) -> int:
    """The sampler's seed for a trial: it follows from its position, not from breaks between trials."""
    return int(np.random.SeedSequence((seed, order)).generate_state(1)[0])
