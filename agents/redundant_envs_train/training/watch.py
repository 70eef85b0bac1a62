"""Monitoring of a training: progress, learning curve, checkpoints, and its end."""

import math
import time
from collections.abc import Callable
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from redundant_envs.support.disk import write_text
from redundant_envs.support.extras import needs

from ..config import Config
from ..policies import save_policy
from ..rollout import SELECTION_SEED, policy_act, run_episodes
from ..run_folder import SELECTION, read_curve
from . import checkpoint
from .curriculum import Course

with needs("train"):
    from rich.progress import Progress
    from stable_baselines3.common.callbacks import BaseCallback

PARTS = ("environment", "policy", "gradient")
"""Parts of a training's time: steps of the environments, choices of actions, updates of the networks."""
CURVE = SELECTION[-3:]  # numbers of a point of the curve: hold success, touch success, mean return
BETTER = "hold_success", "return"
"""What a better point of the curve has more of; the second counts where the first is equal."""
SHOW_EVERY = 0.5  # s, between two looks of the user at the progress
LOGGED = {"touch_success": "touch_success", "hold_success": "is_success", "distance_m": "distance"}
"""Names in the log -> those in ``info``; a task may lack some."""
RETURN = "return_"  # prefix of the terms of an episode's return in ``info``
OnPoint = Callable[[int, float, float], None]
"""Receives environment steps, hold success (0 to 1; NaN if the task does not tell it), and mean return."""


class Watch(BaseCallback):
    """Progress, learning curve and checkpoints of a training, and its end if the user asks for it."""

    def __init__(
        self, config: Config, folder: Path, monitor: Any, progress: Progress, stop: Event,
        begun: dict[str, float], run: dict[str, Any], course: Course, on_point: OnPoint | None = None,
    ) -> None:  # fmt: skip
        super().__init__()
        self.model: Any  # an algorithm with an average
        self.config, self.folder, self.monitor, self.progress = config, folder, monitor, progress
        self.stop, self.run, self.course, self.on_point = stop, run, course, on_point
        name = f"{config.label} {config.env.split('/')[-1]} seed {config.seed}"
        self.task = progress.add_task(name, total=config.total_steps, note="")
        self.hold = begun.get("hold", math.nan)
        """Hold success of the last point of the curve; NaN before it, or if the task does not tell it."""
        self.returned = begun.get("return", math.nan)  # mean return of that point
        self.table = folder / "selection.csv"
        if "next" not in begun:
            write_text(self.table, ",".join(SELECTION) + "\n")
        self._next = begun.get("next", config.curve_every)
        self._before = begun.get("seconds", 0.0)
        self._apart = 0.0
        self._start = self._kept = time.perf_counter()
        self._shown = 0.0
        self._ending = False
        self._collected: tuple[float, int] | None = None
        self.spent = dict.fromkeys(PARTS, 0.0)
        """Seconds of this process's training in each of ``PARTS``; the rest is collection and bookkeeping."""
        self._acted = 0.0  # when the policy began to choose the present actions
        step = monitor.step_wait

        def step_wait() -> Any:
            begun = time.perf_counter()
            self.spent["policy"] += begun - self._acted
            stepped = step()
            self.spent["environment"] += time.perf_counter() - begun
            return stepped

        monitor.step_wait = step_wait

    def split(self) -> dict[str, float]:
        """Shares of environment, policy, gradient and rest in the training time of this process, 0 to 1."""
        whole = self.seconds() - self._before
        shares = {name: spent / whole for name, spent in self.spent.items()}
        return {**shares, "rest": 1.0 - sum(shares.values())}

    def seconds(self) -> float:
        """Training time so far, without evaluations, s."""
        return self._before + time.perf_counter() - self._start - self._apart

    def _on_training_start(self) -> None:
        if self.config.stagger and not self.model.num_timesteps:
            core, rng = self.monitor.unwrapped.core, np.random.default_rng(self.config.seed)
            steps = rng.integers(core.max_episode_steps, size=(core.num_envs, 1))
            core.memory.write(["steps"], steps, core.memory.index)

    def _on_rollout_start(self) -> None:
        self._count_update()
        every = self.config.checkpoint_seconds
        due = every > 0.0 and time.perf_counter() - self._kept >= every
        if due or (self.stop.is_set() and not self._ending):
            numbers = self._next, self.seconds(), self.hold, self.returned
            facts = dict(zip(checkpoint.PROGRESS, numbers, strict=True))
            checkpoint.save(self.folder, self.model, self.monitor, facts, self.run)
            self._kept = time.perf_counter()
        self._ending = self.stop.is_set()
        self._acted = time.perf_counter()

    def _on_training_end(self) -> None:
        self._count_update()

    def _count_update(self) -> None:
        """Add the time since the last rollout, which the learner spent on its gradients."""
        if self._collected is None:
            return
        since, updates = self._collected
        spent, steps = time.perf_counter() - since, self.model._n_updates - updates
        self.spent["gradient"] += spent
        self._collected = None
        if steps > 0:
            self.logger.record("time/update_ms", 1000.0 * spent / steps)

    def _on_rollout_end(self) -> None:
        self._collected = (time.perf_counter(), self.model._n_updates)

    def _on_step(self) -> bool:
        if self._ending:
            return False
        self._log_episodes()
        self.course.move(self.num_timesteps)
        if time.perf_counter() - self._shown >= SHOW_EVERY:
            self._show()
        if self.num_timesteps >= self._next:
            self._next += self.config.curve_every
            self.point()
        self._acted = time.perf_counter()
        return self.config.max_seconds is None or self.seconds() < self.config.max_seconds

    def _log_episodes(self) -> None:
        """Means over the episodes that ended: success, distance, terms of the return."""
        for i in np.flatnonzero(self.locals["dones"]):
            info = self.locals["infos"][i]
            for name, key in LOGGED.items():
                if key in info:
                    self.logger.record_mean(f"episode/{name}", float(info[key]))
            for name, term in info.items():
                if name.startswith(RETURN):
                    self.logger.record_mean(f"reward/{name.removeprefix(RETURN)}", term)

    def point(self) -> None:
        """One point of the learning curve: the averaged policy on the selection goals."""
        begun, config = time.perf_counter(), self.config
        seconds = self.seconds()
        with self.model.averaged():
            act, episodes = policy_act(self.model), config.curve_episodes
            outcome = run_episodes(config.env, act, episodes, SELECTION_SEED, **config.env_kwargs)
        shares = [math.nan if ends is None else float(ends.mean()) for ends in (outcome.hold, outcome.touch)]
        self.hold, self.returned = shares[0], float(outcome.returns.mean())
        numbers = dict(zip(CURVE, (*shares, self.returned), strict=True))
        with self.table.open("a", encoding="utf-8") as file:
            row = ",".join(f"{number:.4f}" for number in numbers.values())
            file.write(f"{self.num_timesteps},{seconds:.2f},{row}\n")
        # Written now: the next line of the log is that of later steps, and may never come.
        logged = {f"curve/{name}": number for name, number in numbers.items() if not math.isnan(number)}
        logged["time/total_timesteps"] = self.num_timesteps
        apart = {**dict.fromkeys(logged, ()), "time/total_timesteps": ("tensorboard",)}  # its own axis
        for log in self.logger.output_formats:
            log.write(logged, apart, self.num_timesteps)
        if config.keep == "last" or self._is_best():
            save_policy(self.model, self.folder / "policy.zip")
        self._apart += time.perf_counter() - begun
        self._show()
        if self.on_point is not None:
            self.on_point(self.num_timesteps, self.hold, self.returned)

    def _is_best(self) -> bool:
        """Whether no earlier point of the curve holds more goals, or as many with a higher return."""
        points = np.nan_to_num(read_curve(self.folder))[:, [SELECTION.index(name) for name in BETTER]]
        return bool(max(map(tuple, points)) == tuple(points[-1]))

    def _show(self) -> None:
        config, self._shown = self.config, time.perf_counter()
        # the run ends with the steps or with the seconds, whichever comes first
        share = self.num_timesteps / config.total_steps
        if config.max_seconds is not None:
            share = max(share, self.seconds() / config.max_seconds)
        note = "" if math.isnan(self.returned) else f"mean return {self.returned:.1f}"
        if not math.isnan(self.hold):
            note = f"holds {100 * self.hold:.1f} %"
        self.progress.update(self.task, completed=share * config.total_steps, note=note)
