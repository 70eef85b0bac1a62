"""Where the figures of a training are logged: one function for each place."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from redundant_envs.extras import needs

from ..config import Config

with needs("train"):
    from stable_baselines3.common.logger import CSVOutputFormat, KVWriter, Logger


def tensorboard(folder: Path, config: Config) -> KVWriter:
    """Files for TensorBoard in the run folder."""
    with needs("train"):
        from stable_baselines3.common.logger import TensorBoardOutputFormat

        return TensorBoardOutputFormat(str(folder / "tensorboard"))


def csv(folder: Path, config: Config) -> KVWriter:
    """The table progress.csv in the run folder."""
    return CSVOutputFormat(str(folder / "progress.csv"))


class _Client(KVWriter):
    """Hands figures on to a client's function of (figures, step)."""

    def __init__(self, log: Callable[[dict[str, float], int], Any]) -> None:
        self.log = log

    def write(self, key_values: dict[str, Any], key_excluded: Any, step: int = 0) -> None:
        self.log({k: float(v) for k, v in key_values.items() if isinstance(v, int | float)}, step)

    def close(self) -> None:
        """The client closes itself at the end of the process."""


def wandb(folder: Path, config: Config) -> KVWriter:
    """Weights & Biases; the place is set by its own environment variables."""
    with needs("wandb"):
        import wandb as client
    run = client.init(project="redundant-envs", name=folder.name, dir=str(folder), config=config.to_dict())
    return _Client(lambda figures, step: run.log(figures, step=step))


def mlflow(folder: Path, config: Config) -> KVWriter:
    """MLflow; the place is set by its own environment variables."""
    with needs("mlflow"):
        import mlflow as client
    client.start_run(run_name=folder.name)
    client.log_dict(config.to_dict(), "config.yaml")
    return _Client(lambda figures, step: client.log_metrics(figures, step=step))


PLACES: dict[str, Callable[[Path, Config], KVWriter]] = {
    "tensorboard": tensorboard, "csv": csv, "wandb": wandb, "mlflow": mlflow,
}  # fmt: skip


def logger(folder: Path, config: Config) -> Logger:
    """What stable-baselines3 logs to."""
    return Logger(str(folder), [PLACES[name](folder, config) for name in config.telemetry])
