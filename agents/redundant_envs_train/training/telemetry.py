"""Logs of a training's figures, in the run folder or at a client that has a package of its own."""

import importlib
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from redundant_envs.support.extras import needs

from ..config import CLIENTS, Config

with needs("train"):
    from stable_baselines3.common.logger import CSVOutputFormat, KVWriter, Logger, TensorBoardOutputFormat
    from torch.utils.tensorboard import SummaryWriter


class _Client(KVWriter):
    """Passes figures on to a client's function ``log``; ``end`` ends its run."""

    def __init__(self, log: Callable[..., Any], end: Callable[[], Any]) -> None:
        self.log, self.end = log, end

    def write(self, key_values: dict[str, Any], key_excluded: Any, step: int = 0) -> None:
        self.log({k: float(v) for k, v in key_values.items() if isinstance(v, int | float)}, step=step)

    def close(self) -> None:
        """End the client's run, so that the next training of this process has its own."""
        self.end()


class _TensorBoard(TensorBoardOutputFormat):
    """Points of a resumed training take the places of those that were written after its checkpoint."""

    def __init__(self, folder: Path, steps: int) -> None:
        self.writer = SummaryWriter(str(folder), purge_step=steps + 1 if steps else None)
        self._is_closed = False


def check(config: Config) -> dict[str, Any]:
    """The packages of the clients by name; a missing one is refused before a training begins."""
    modules: dict[str, Any] = {}
    for name in CLIENTS:
        if name in config.telemetry:
            with needs(name):
                modules[name] = importlib.import_module(name)
    return modules


def logger(folder: Path, config: Config, steps: int) -> Logger:
    """The logger of a training that goes on after some steps; variables of a client set where it sends."""
    clients, writers = check(config), list[KVWriter]()
    for name in config.telemetry:
        if name == "tensorboard":
            writers.append(_TensorBoard(folder / "tensorboard", steps))
        elif name == "csv":  # a resumed training begins another table
            parts = (folder / f"progress{f'_{n}' if n > 1 else ''}.csv" for n in itertools.count(1))
            writers.append(CSVOutputFormat(str(next(part for part in parts if not part.exists()))))
        elif name == "wandb":
            about = {"name": folder.name, "dir": str(folder), "config": config.to_dict()}
            run = clients[name].init(project="redundant-envs", **about)
            writers.append(_Client(run.log, run.finish))
        else:
            clients[name].start_run(run_name=folder.name)
            clients[name].log_dict(config.to_dict(), "config.yaml")
            writers.append(_Client(clients[name].log_metrics, clients[name].end_run))
    return Logger(str(folder), writers)
