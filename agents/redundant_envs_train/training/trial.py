"""A training as a trial of Optuna's: its settings, its score, and its end where others are better."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from redundant_envs.support.extras import needs

from ..config import Config
from ..config.search import Space, with_values
from ..run_folder import check_new
from . import checkpoint, train

with needs("tune"):
    import optuna

POINT = ("hold_success", "return", "env_steps")  # last point of the curve; None: it is not told


def score(trial: Any, config: Config, space: Space, folder: Path, seed: int, bars: Any) -> float:
    """Train ``folder``/trial<k>; a training that is refused or not finite counts as pruned."""
    value, place = -1.0, folder / f"trial{trial.number}"
    sampler_seed = np.random.SeedSequence((seed, trial.number)).generate_state(1)  # no two trials draw alike
    trial.study.sampler = optuna.samplers.TPESampler(seed=int(sampler_seed[0]), constant_liar=True)
    for key, within in space.items():
        is_whole = isinstance(within.get("low"), int)
        kind = "categorical" if "choices" in within else "int" if is_whole else "float"
        getattr(trial, f"suggest_{kind}")(key, **within)

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
        check_new(place)
        try:
            train.train(with_values(config, trial.params), place, bars, on_point)
        finally:
            checkpoint.remove(place)
    except (ValueError, ArithmeticError, RuntimeError) as error:
        trial.set_user_attr("message", " ".join(str(error).split()))
        raise optuna.TrialPruned from error
    return value
