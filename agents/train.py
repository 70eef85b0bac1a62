"""One training run from a configuration to a finished run folder."""

from __future__ import annotations

import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecMonitor

from agents.config import SEEDS_PER_RUN, Config
from agents.rollout import SELECTION_SEED, policy_act, run_episodes
from redundant_envs.envs.sb3 import make_sb3


def make_model(config: Config, env: Any) -> Any:
    """The learner of a configuration."""
    policy = "MultiInputPolicy" if "Goal" in config.env else "MlpPolicy"
    if config.algo == "ppo":
        p = config.ppo
        return PPO(
            policy, env, n_steps=p.n_steps, batch_size=p.batch_size, n_epochs=p.n_epochs,
            learning_rate=lambda remaining: p.learning_rate * remaining, gamma=p.gamma,
            gae_lambda=p.gae_lambda, clip_range=p.clip_range, ent_coef=p.ent_coef,
            seed=config.seed, device="cpu",
            policy_kwargs={
                "net_arch": {"pi": list(p.net_arch), "vf": list(p.net_arch)},
                "log_std_init": p.log_std_init,
                "activation_fn": torch.nn.Tanh,
            },
        )  # fmt: skip
    s = config.sac
    return SAC(
        policy, env, buffer_size=s.buffer_size, learning_starts=s.learning_starts,
        batch_size=s.batch_size, learning_rate=lambda remaining: s.learning_rate * remaining,
        gamma=s.gamma, tau=s.tau, train_freq=s.train_freq, gradient_steps=s.gradient_steps,
        ent_coef=s.ent_coef,
        seed=config.seed, device="cpu",
        policy_kwargs={
            "net_arch": list(s.net_arch),
            "activation_fn": torch.nn.Tanh,  # a critic with kinks makes the arm chatter at the goal
            "optimizer_kwargs": {"fused": True},  # saves a third of the time of a gradient step
        },
    )  # fmt: skip


class Watch(BaseCallback):
    """Its line of the progress bars, time limit, and choice of the best policy on goals of their own."""

    def __init__(self, config: Config, folder: Path, progress: Progress) -> None:
        super().__init__()
        self.config = config
        self.folder = folder
        self.progress = progress
        name = f"{config.algo.upper()} {config.env.split('/')[-1]}"
        self.task = progress.add_task(name, total=config.total_steps, note="")
        self.recent = "-"
        self.best = (-1.0, -np.inf)
        self.curve: list[tuple[int, float, float, float]] = []
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
        self.curve.append((self.num_timesteps, self.seconds(), *score))
        self.logger.record("selection/hold_success", score[0])
        self.logger.record("selection/return", score[1])
        if score > self.best:
            self.best = score
            self.model.save(self.folder / "policy.zip")
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
    """Train, keep the best policy in ``folder``; returns steps and seconds.

    ``progress`` are the bars of a caller, which get a line while the training runs.
    """
    if folder.exists() and any(folder.iterdir()):
        raise ValueError(f"run folder {folder} is not empty; choose another --out or delete it")
    torch.set_num_threads(config.torch_threads)
    base = make_sb3(config.env, config.num_envs, **config.env_kwargs)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "config.yaml").write_text(yaml.safe_dump(config.to_dict(), sort_keys=False))
    (folder / "scene.py").write_text(base.core.assembly.text)
    base.seed(config.seed * SEEDS_PER_RUN)
    env = VecMonitor(base, filename=str(folder / "monitor.csv"), info_keywords=("is_success",))
    model = make_model(config, env)
    outputs = ["tensorboard"] if _has_tensorboard() else ["csv"]
    model.set_logger(configure(str(folder / "tensorboard"), outputs))
    with progress_bars() if progress is None else nullcontext(progress) as bars:
        watch = Watch(config, folder, bars)
        model.learn(config.total_steps, callback=watch, log_interval=20)
        watch.select()
        if progress is not None:
            bars.remove_task(watch.task)
    seconds = watch.seconds()
    env.close()
    np.savetxt(
        folder / "selection.csv", np.array(watch.curve), delimiter=",", comments="",
        header="env_steps,seconds,hold_success,return", fmt=["%d", "%.2f", "%.4f", "%.4f"],
    )  # fmt: skip
    return {"env_steps": int(model.num_timesteps), "train_seconds": round(seconds, 1)}


def _has_tensorboard() -> bool:
    try:
        import tensorboard  # noqa: F401  (only whether it is installed)
    except ImportError:
        return False
    return True


def load_policy(folder: Path, algo: str) -> Any:
    """The policy of a run folder."""
    kind: Any = {"ppo": PPO, "sac": SAC}[algo]
    return kind.load(folder / "policy.zip", device="cpu")
