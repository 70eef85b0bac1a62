"""One training run from a configuration to a run folder; Ctrl-C ends it early and in order."""

from __future__ import annotations

import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.extras import needs

from . import COMMAND
from .config import SEEDS_PER_RUN, Config
from .interrupt import Request, Stopped, stop_request
from .policies import learner, policy_kwargs, policy_name, save_policy
from .rollout import SELECTION_SEED, policy_act, run_episodes
from .run_folder import SELECTION, write_json

with needs("train"):
    import torch
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import configure
    from stable_baselines3.common.vec_env import VecMonitor


def make_model(config: Config, env: Any) -> Any:
    """The learner of a configuration."""
    common = {"seed": config.seed, "device": "cpu", "policy_kwargs": policy_kwargs(config)}
    if config.algo == "ppo":
        p = config.ppo
        return learner(config)(
            policy_name(config), env, n_steps=p.n_steps, batch_size=p.batch_size, n_epochs=p.n_epochs,
            learning_rate=lambda remaining: p.learning_rate * remaining, gamma=p.gamma,
            gae_lambda=p.gae_lambda, clip_range=p.clip_range, ent_coef=p.ent_coef, **common,
        )  # fmt: skip
    s = config.sac
    return learner(config)(
        policy_name(config), env, buffer_size=s.buffer_size, learning_starts=s.learning_starts,
        batch_size=s.batch_size, learning_rate=lambda remaining: s.learning_rate * remaining,
        gamma=s.gamma, tau=s.tau, train_freq=s.train_freq, gradient_steps=s.gradient_steps,
        ent_coef=s.ent_coef, **common,
    )  # fmt: skip


class Watch(BaseCallback):
    """Its line of the progress bars, time limit, and choice of the best policy on goals of their own.

    It ends the training when the user asks to.
    """

    def __init__(self, config: Config, folder: Path, progress: Progress, stop: Request) -> None:
        super().__init__()
        self.stop = stop
        self.config = config
        self.folder = folder
        self.progress = progress
        name = f"{config.algo.upper()} {config.env.split('/')[-1]}"
        self.task = progress.add_task(name, total=config.total_steps, note="")
        self.recent = "-"
        self.best = (-1.0, -np.inf)
        self.table = folder / "selection.csv"
        self.table.write_text(",".join(SELECTION) + "\n", encoding="utf-8")
        self.start = time.perf_counter()
        self._next = config.selection_every
        self._bar = 0

    def seconds(self) -> float:
        """Training time so far."""
        return time.perf_counter() - self.start

    def _on_step(self) -> bool:
        if self.num_timesteps - self._bar >= self.config.total_steps // 400:
            self._bar = self.num_timesteps
            buffer = self.model.ep_success_buffer
            self.recent = f"{100 * np.mean(buffer):.1f} %" if buffer else "-"
            # the run ends with the steps or with the seconds, whichever comes first
            share = max(
                self.num_timesteps / self.config.total_steps, self.seconds() / self.config.max_seconds
            )
            self.progress.update(self.task, completed=share * self.config.total_steps, note=self.note())
        if self.stop.made:
            return False
        if self.num_timesteps >= self._next:
            self._next += self.config.selection_every
            self.select()
        return self.seconds() < self.config.max_seconds

    def select(self) -> None:
        """Evaluate on the selection goals; keep the policy if it is the best so far."""
        config = self.config
        outcome = run_episodes(
            config.env, policy_act(self.model), config.selection_episodes, SELECTION_SEED,
            **config.env_kwargs,
        )  # fmt: skip
        score = (float(outcome.hold.mean()), float(outcome.returns.mean()))
        with self.table.open("a", encoding="utf-8") as file:
            file.write(f"{self.num_timesteps},{self.seconds():.2f},{score[0]:.4f},{score[1]:.4f}\n")
        self.logger.record("selection/hold_success", score[0])
        self.logger.record("selection/return", score[1])
        if score > self.best:
            self.best = score
            save_policy(self.model, self.folder / "policy.zip")
        self.progress.update(self.task, note=self.note())

    def note(self) -> str:
        """Hold success of recent training episodes, and of the best policy so far."""
        best = f"{100 * self.best[0]:.1f} %" if self.best[0] >= 0.0 else "-"
        return f"success {self.recent} best {best}"


def progress_bars() -> Progress:
    """Lines of progress; every task has a ``note``."""
    return Progress(
        TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:3.0f} %"),
        TextColumn("{task.fields[note]}"), TimeElapsedColumn(), TimeRemainingColumn(),
    )  # fmt: skip


def train(config: Config, folder: Path, progress: Progress | None = None) -> dict[str, Any]:
    """Train and keep the best policy in ``folder``; returns steps and seconds.

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
        The user asked to stop, and the folder is as after a shorter training. Without a selection so far
        it holds the present policy.
    """
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"run folder {folder} is a file; choose another --out")
    if folder.exists() and any(folder.iterdir()):
        raise ValueError(f"run folder {folder} is not empty; choose another --out or delete it")
    torch.set_num_threads(config.torch_threads)
    base = make_sb3(config.env, config.num_envs, **config.env_kwargs)
    folder.mkdir(parents=True, exist_ok=True)
    with stop_request() as stop:
        (folder / "config.yaml").write_text(yaml.safe_dump(config.to_dict(), sort_keys=False))
        (folder / "scene.py").write_text(base.core.assembly.text)
        base.seed(config.seed * SEEDS_PER_RUN)
        env = VecMonitor(base, filename=str(folder / "monitor.csv"), info_keywords=("is_success",))
        model = make_model(config, env)
        outputs = ["tensorboard"] if _has_tensorboard() else ["csv"]
        model.set_logger(configure(str(folder / "tensorboard"), outputs))
        with progress_bars() if progress is None else nullcontext(progress) as bars:
            watch = Watch(config, folder, bars, stop)
            try:
                model.learn(config.total_steps, callback=watch, log_interval=20)
                if not stop.made:
                    watch.select()
            except KeyboardInterrupt:
                stop.made = True
            if progress is not None:
                bars.remove_task(watch.task)
        seconds = watch.seconds()
        if not (folder / "policy.zip").is_file():
            save_policy(model, folder / "policy.zip")
        env.close()
        facts = {"env_steps": int(model.num_timesteps), "train_seconds": round(seconds, 1)}
        write_json(folder / "training.json", {**facts, "stopped": stop.made})
    if stop.made:
        raise Stopped(
            f"stopped after {facts['env_steps']} of {config.total_steps} steps; the policy so far is kept. "
            f"Go on with: {COMMAND} report {folder}"
        )
    return facts


def _has_tensorboard() -> bool:
    try:
        import tensorboard  # noqa: F401  (only whether it is installed)
    except ImportError:
        return False
    return True
