"""One training run from a configuration to a run folder; it can be stopped, and go on."""

from __future__ import annotations

import hashlib
from contextlib import closing, nullcontext
from pathlib import Path
from typing import Any

import yaml

from redundant_envs.envs.core import Core
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.extras import needs

from .. import COMMAND
from ..config import SEEDS_PER_RUN, Config
from ..learners.build import make_model
from ..policies import save_policy
from ..run_folder import read_config, write_json
from . import checkpoint
from .interrupt import Stopped, stop_request
from .telemetry import logger
from .watch import Watch, progress_bars

with needs("train"):
    import torch
    from rich.progress import Progress
    from stable_baselines3.common.monitor import ResultsWriter
    from stable_baselines3.common.vec_env import VecMonitor

LOG_EPISODES = 4
"""Episodes of every environment between two lines of SAC's log."""
LOG_ROLLOUTS = 10
"""Rollouts between two lines of PPO's log."""
KEYWORDS = ("is_success",)


def train(config: Config, folder: Path, progress: Progress | None = None) -> dict[str, Any]:
    """Train, and keep the averaged policy in ``folder``; returns steps and seconds.

    Parameters
    ----------
    config : Config
    folder : Path
        It is made, or is empty.
    progress : Progress, optional
        Bars of a caller, which get a line while the training runs.

    Raises
    ------
    Stopped
        The user asked to stop; the folder has the policy so far, and a checkpoint.
    """
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"run folder {folder} is a file; choose another --out")
    if folder.exists() and any(folder.iterdir()):
        hint = f"go on with '{COMMAND} resume {folder}', " if checkpoint.exists(folder) else ""
        raise ValueError(f"run folder {folder} is not empty; {hint}choose another --out or delete it")
    return _run(config, folder, progress, resumed=False)


def resume(folder: Path, progress: Progress | None = None) -> dict[str, Any]:
    """Go on from the last checkpoint of a run folder, to the same bits as without a break."""
    return _run(read_config(folder), folder, progress, resumed=True)


def _run(config: Config, folder: Path, progress: Progress | None, resumed: bool) -> dict[str, Any]:
    torch.set_num_threads(config.torch_threads)
    base = make_sb3(config.env, config.num_envs, **config.env_kwargs)
    base.seed(config.seed * SEEDS_PER_RUN)
    folder.mkdir(parents=True, exist_ok=True)
    monitor = VecMonitor(base, info_keywords=KEYWORDS)
    model = make_model(config, monitor)
    begun = checkpoint.restore(folder, model, monitor) if resumed else {}
    if not resumed:
        (folder / "config.yaml").write_text(yaml.safe_dump(config.to_dict(), sort_keys=False))
        (folder / "scene.yaml").write_text(yaml.safe_dump(base.core.scene.to_dict(), sort_keys=False))
    header: dict[str, Any] = {"t_start": monitor.t_start, "env_id": config.env}
    monitor.results_writer = ResultsWriter(
        str(folder / "monitor.csv"), header=header, extra_keys=KEYWORDS, override_existing=not resumed
    )
    with stop_request() as stop, closing(monitor):
        model.set_logger(logger(folder, config))
        with progress_bars() if progress is None else nullcontext(progress) as bars:
            watch = Watch(config, folder, monitor, bars, stop, begun)
            every = LOG_ROLLOUTS if config.algo == "ppo" else LOG_EPISODES * config.num_envs
            try:
                left = config.total_steps - model.num_timesteps
                model.learn(left, callback=watch, log_interval=every, reset_num_timesteps=not resumed)
                if not stop.made:
                    watch.point()
            except KeyboardInterrupt:
                stop.made = True
            if progress is not None:
                bars.remove_task(watch.task)
        seconds = watch.seconds()
        if stop.made:
            save_policy(model, folder / "policy.zip")
        facts = {
            "env_steps": int(model.num_timesteps),
            "train_seconds": round(seconds, 2),
            "simulator": simulator_hash(base.core),
        }
        write_json(folder / "training.json", {**facts, "stopped": stop.made})
    if stop.made:
        raise Stopped(
            f"stopped after {facts['env_steps']} of {config.total_steps} steps; the policy so far is kept. "
            f"Go on with: {COMMAND} resume {folder}, or look at it with: {COMMAND} report {folder}"
        )
    checkpoint.remove(folder)
    return facts


def simulator_hash(core: Core) -> str:
    """What tells one simulator of a scene from another: a hash of its program."""
    return hashlib.sha256(core.assembly.text.encode()).hexdigest()[:16]
