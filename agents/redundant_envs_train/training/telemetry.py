"""Logs of a training's figures: one function for each kind of log."""

from __future__ import annotations

import importlib
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from redundant_envs.extras import needs

from ..config import Config

with needs("train"):
    from stable_baselines3.common.logger import CSVOutputFormat, KVWriter, Logger, TensorBoardOutputFormat


def tensorboard(folder: Path, config: Config) -> KVWriter:
    """Files for TensorBoard in the run folder."""
    return TensorBoardOutputFormat(str(folder / "tensorboard"))


def csv(folder: Path, config: Config) -> KVWriter:
    """The table progress.csv in the run folder; a resumed training begins another one."""
    parts = (f"progress{f'_{n}' if n > 1 else ''}.csv" for n in itertools.count(1))
    return CSVOutputFormat(str(next(folder / name for name in parts if not (folder / name).exists())))


class _Client(KVWriter):
    """Passes figures on to a client's function of (figures, step); ``end`` ends its run."""

    def __init__(self, log: Callable[[dict[str, float], int], Any], end: Callable[[], Any]) -> None:
        self.log, self.end = log, end

    def write(self, key_values: dict[str, Any], key_excluded: Any, step: int = 0) -> None:
        self.log({k: float(v) for k, v in key_values.items() if isinstance(v, int | float)}, step)

    def close(self) -> None:
        """End the client's run, so that the next training of this process has its own."""
        self.end()


def wandb(folder: Path, config: Config) -> KVWriter:
    """Weights & Biases; its own environment variables set the destination."""
    client = _client("wandb")
    run = client.init(project="redundant-envs", name=folder.name, dir=str(folder), config=config.to_dict())
    return _Client(lambda figures, step: run.log(figures, step=step), run.finish)


def mlflow(folder: Path, config: Config) -> KVWriter:
    """MLflow; its own environment variables set the destination."""
    client = _client("mlflow")
    client.start_run(run_name=folder.name)
    client.log_dict(config.to_dict(), "config.yaml")
    return _Client(lambda figures, step: client.log_metrics(figures, step=step), client.end_run)


def _client(name: str) -> Any:
    """A client's package, which the extra of its name installs."""
    with needs(name):
        return importlib.import_module(name)


PLACES: dict[str, Callable[[Path, Config], KVWriter]] = {
    "tensorboard": tensorboard, "csv": csv, "wandb": wandb, "mlflow": mlflow,
}  # fmt: skip


CLIENTS = ("wandb", "mlflow")
"""Kinds of logs whose packages the extra "train" does not include."""


def check(config: Config) -> None:
    """Refuse, before a training begins, a kind of log whose package is missing."""
    for name in config.telemetry:
        if name in CLIENTS:
            _client(name)


def logger(folder: Path, config: Config) -> Logger:
    """The logger for stable-baselines3."""
    return Logger(str(folder), [PLACES[name](folder, config) for name in config.telemetry])
