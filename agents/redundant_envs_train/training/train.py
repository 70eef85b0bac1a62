"""One training run from a configuration to a run folder; it can be stopped and resumed."""

import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack, nullcontext, suppress
from pathlib import Path
from typing import Any

import yaml

from redundant_envs.envs.core import Core
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.support.disk import DiskFull, alone, disk_errors, write_text
from redundant_envs.support.extras import needs
from redundant_envs.support.progress import progress_bars
from redundant_envs.support.values import say

from .. import command, run_folder
from ..config import WITHOUT_EFFECT, Config, PlainPPOSettings
from ..config.run import first_environment_seed
from ..learners.build import make_model
from ..policies import save_policy, start_from
from ..rollout import info_names
from . import checkpoint, demonstrations
from .curriculum import Course
from .pool import Stopped, stop_request
from .telemetry import check, logger
from .watch import OnPoint, Watch

with needs("train"):
    import torch
    from rich.progress import Progress
    from stable_baselines3.common.monitor import ResultsWriter
    from stable_baselines3.common.vec_env import VecMonitor

LOG_EPISODES = 4  # episodes of every environment between two lines of SAC's log
LOG_ROLLOUTS = 10  # rollouts between two lines of PPO's log


def train(
    config: Config, folder: Path, progress: Progress | None = None, on_point: OnPoint | None = None
) -> dict[str, Any]:
    """Train, and keep the averaged policy in ``folder``, new or empty; returns steps and seconds. What
    ``on_point`` raises is raised here. Stopped if the user asked for it: the folder then has a checkpoint."""
    run_folder.check_new(folder)
    config, new = run_folder.with_start(config), not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with alone(folder, "trains"):
            return _run(config, folder, progress, new=True, on_point=on_point)
    finally:
        if new:
            with suppress(OSError):  # of a folder that is not empty
                folder.rmdir()


def resume(
    folder: Path, progress: Progress | None = None, overrides: Sequence[str] = (), again: bool = False
) -> dict[str, Any]:
    """Continue from the last checkpoint of a run folder, to the same bits as without a break; a run that was
    stopped before its first one, or without any if ``again``, begins again, and what it had is set aside."""
    config = run_folder.config_to_resume(folder, overrides)
    with alone(folder, "trains"):
        resumed = not again and run_folder.check_resumable(folder) is not None
        if not resumed:
            before = run_folder.set_aside(folder, (*run_folder.TRAINED, *run_folder.JUDGED))
            where = f"; what it had is in {before}" if before else ""
            say(f"note: {folder} was stopped without a checkpoint, and begins again{where}", file=sys.stderr)
        return _run(config, folder, progress, new=False, resumed=resumed)


def _run(
    config: Config, folder: Path, progress: Progress | None, new: bool, resumed: bool = False,
    on_point: OnPoint | None = None,
) -> dict[str, Any]:  # fmt: skip
    check(config)
    torch.set_num_threads(config.torch_threads)
    run_config = config if new else run_folder.own_config(folder)
    base = make_sb3(config.env, config.num_envs, monitor=False, **run_config.env_kwargs)
    simulated = run_folder.with_scene(config, base.core.scene)  # from now on, whatever happens to its file
    keywords = ("is_success",) if "is_success" in info_names(base.core) else ()  # columns of monitor.csv
    monitor = VecMonitor(base, info_keywords=keywords)
    model = make_model(config, monitor)
    if config.start_from is not None and not resumed:
        start_from(model, config, base)
    # after the learner, which sets its own seed in the environments: otherwise seeds would share most goals
    base.seed(first_environment_seed(config.seed))
    run, shown = identity(config, base.core), None
    if config.demonstrations is not None:
        shown = demonstrations.of(config, run_config.env_kwargs, base)
        model.learn_from(shown.transitions, config.demonstrated)
        run["settings"]["demonstrations"]["sha256"] = shown.sha256
    course = Course(config, base)
    begun = checkpoint.restore(folder, model, monitor, run) if resumed else {}
    course.move(model.num_timesteps)
    if shown is not None and not resumed:
        begun = {"seconds": shown.seconds}
    run_folder.set_aside(folder, run_folder.JUDGED)  # they are of the policy at the stop
    if new:
        described = {run_folder.SCENE: base.core.scene.to_dict(), "config.yaml": config.to_dict()}
        for name, data in described.items():
            write_text(folder / name, yaml.safe_dump(data, sort_keys=False))
    header: dict[str, Any] = {"t_start": monitor.t_start, "env_id": config.env}
    full: DiskFull | None = None
    with stop_request() as stop, progress_bars() if progress is None else nullcontext(progress) as bars:
        with disk_errors(folder):
            table = str(folder / "monitor.csv")
            monitor.results_writer = ResultsWriter(table, header, keywords, override_existing=not resumed)
            model.set_logger(logger(folder, config, model.num_timesteps))
            watch = Watch(simulated, folder, monitor, bars, stop, begun, run, course, on_point)
        on_policy = isinstance(config.settings, PlainPPOSettings)
        every = LOG_ROLLOUTS if on_policy else LOG_EPISODES * config.num_envs
        try:
            with disk_errors(folder), ExitStack() as files:
                files.callback(model.logger.close)
                files.callback(monitor.close)
                left = config.total_steps - model.num_timesteps
                model.learn(left, callback=watch, log_interval=every, reset_num_timesteps=not resumed)
                # a request during the last rollout comes too late
                stopped = stop.is_set() and model.num_timesteps < config.total_steps
                if not stopped:
                    watch.point()
        except KeyboardInterrupt:
            stopped = True
        except DiskFull as error:
            full, stopped = error, True
        finally:
            if progress is not None:
                bars.remove_task(watch.task)
        facts = {
            "env_steps": int(model.num_timesteps), "train_seconds": round(watch.seconds(), 2),
            "simulator": run["simulator"],
            **({} if shown is None else {"demonstrations": shown.facts()}),
            "split": {name: round(share, 3) for name, share in watch.split().items()},
        }  # fmt: skip
        best = config.keep == "best" and (folder / "policy.zip").is_file()
        if full is not None:
            message = "the policy of the best point is kept" if best else keep(model, folder)
            with suppress(DiskFull):
                run_folder.write_json(folder / "training.json", {**facts, "stopped": True})
            steps = f"{facts['env_steps']} of {config.total_steps} steps"
            raise DiskFull(f"{full}. After {steps} {message}") from full
        if stopped and not best:
            save_policy(model, folder / "policy.zip")
        run_folder.write_json(folder / "training.json", {**facts, "stopped": stopped})
    if stopped:
        resumable = run_folder.find_checkpoint(folder) is not None
        go_on = f"Go on with: {command('resume', folder)}, or look" if resumable else "Look"
        reached = f"stopped after {facts['env_steps']} of {config.total_steps} steps"
        message = f"the policy so far is kept. {go_on} at it with: {command('report', folder)}"
        raise Stopped(f"{reached}; {message}")
    checkpoint.remove(folder)
    return facts


def keep(model: Any, folder: Path) -> str:
    """Save the policy of a training whose disk is full where there is room, and say where."""
    path = folder / "policy.zip"
    with suppress(OSError):
        save_policy(model, path)
        return f"the policy is kept in {path}"
    with suppress(OSError):
        elsewhere = Path(tempfile.mkdtemp(prefix="redundant-envs-")) / path.name
        try:
            save_policy(model, elsewhere)
        except OSError:
            elsewhere.parent.rmdir()
            raise
        return f"the policy is kept in {elsewhere}"
    return f"{path} is that of the last point of the curve" if path.is_file() else "no policy could be kept"


def identity(config: Config, core: Core) -> dict[str, Any]:
    """Identity of a checkpoint: the settings that change steps, and a hash of the simulator's program."""
    settings = config.to_dict(*WITHOUT_EFFECT, "max_seconds")
    return {"settings": settings, "simulator": core.simulator.key()[:16]}
