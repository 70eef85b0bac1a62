"""The policy study itself: checks, trainings, episodes under each physics, and results."""

import shutil
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.support.disk import write_text
from redundant_envs.support.extras import needs
from redundant_envs.support.machine import versions
from redundant_envs.support.progress import progress_bars
from redundant_envs_train import run_folder
from redundant_envs_train.config import Config, check_telemetry, load
from redundant_envs_train.policies import load_policy
from redundant_envs_train.rollout import policy_act, run_episodes
from redundant_envs_train.training.train import train

from .episodes import Evaluation, compare, compare_groups, evaluate_under, figures, held, stepping
from .settings import Study, load_study, slug

with needs("train"):
    import torch

Row = dict[str, Any]
STYLE: dict[str, Any] = {"sort_keys": False, "default_flow_style": None, "width": 1000}
EVALUATION_STEPS = 200_000
"""Training steps that take about as long as an evaluation; used for the progress bar only."""


class ArmResult(NamedTuple):
    """All results about one arm."""

    name: str
    env: str
    policy: str  # that of the first part, described
    rows: list[Row]  # one per physics
    episodes: dict[str, Evaluation]  # by physics
    trained: list[Row]  # one per policy of the second part
    training: dict[str, Row]  # measure -> difference of cheap and own training


class Plan(NamedTuple):
    """The checked plan for one arm."""

    name: str
    preset: Config
    run: Path  # folder of the policy of the first part
    exists: bool  # whether that folder exists already, and is not made by the study
    kwargs: dict[str, dict[str, Any]]  # physics -> arguments of the environment
    trainings: list[tuple[str, Config, Path]]  # of the second part: physics, configuration, run folder

    def steps(self) -> int:
        """Environment steps of its parts, for the progress bar."""
        first = 0 if self.exists else self.preset.total_steps
        evaluations = len(self.kwargs) + 2 * len(self.trainings)
        return first + sum(c.total_steps for _, c, _ in self.trainings) + evaluations * EVALUATION_STEPS


def plan(study: Study, name: str, folder: Path) -> Plan:
    """Read and check everything that an arm needs, before anything long begins."""
    arm, runs = study.arms[name], folder / "runs"
    preset = load(arm.preset)
    check_telemetry(preset, ())
    run = Path(arm.run) if arm.run else runs / f"{slug(name)}_policy"
    if arm.run:
        taken = run_folder.read_config(run)
        if not (run / "policy.zip").is_file():
            what = f"arms.{name}.run is {arm.run!r}"
            raise ValueError(f"{what}, which has no policy.zip: it is not a finished run")
        if (taken.env, taken.env_kwargs) != (preset.env, preset.env_kwargs):
            raise ValueError(
                f"arms.{name}.run was trained on {taken.env} with {taken.env_kwargs}, the preset is of "
                f"{preset.env} with {preset.env_kwargs}; give a run of this preset"
            )
        if other := run_folder.difference(run):
            what = f"arms.{name}.run was trained in another scene"
            raise ValueError(f"{what}: {other}; give a run of the preset")
    kwargs = {label: physics.env_kwargs(preset) for label, physics in study.physics.items()}
    for label, arguments in kwargs.items():
        try:
            make_sb3(preset.env, 1, **arguments)
        except ValueError as error:  # an effect may not know this integrator
            raise ValueError(f"{name} cannot be stepped with {label!r}: {error}") from None
    trainings: list[tuple[str, Config, Path]] = []
    for seed in range(study.train_seeds):
        base_config = load(arm.preset, [*study.train_overrides, f"seed={seed}"])
        check_telemetry(base_config, ())
        cheap = base_config.model_copy(update={"env_kwargs": kwargs[arm.cheap]})
        for label, config in ((arm.cheap, cheap), ("preset", base_config)):
            trainings.append((label, config, runs / f"{slug(name)}_{slug(label)}_seed{seed}"))
    for config, path in [(preset, run)] * (not arm.run) + [(c, f) for _, c, f in trainings]:
        if path.exists() and run_folder.read_config(path).to_dict() != config.to_dict():
            raise ValueError(
                f"{path} holds a run of another configuration; choose another --out or delete it"
            )
    return Plan(name, preset, run, bool(arm.run), kwargs, trainings)


def run_study(study: Study, folder: Path, trust: bool = False) -> list[ArmResult]:
    """Run the whole study; training runs are kept in ``folder``/runs. ``trust``: see load_policy."""
    path = folder / "study.yaml"  # the folder is of a study
    run_folder.check_study(folder, [path.name])
    if path.exists() and load_study(path) != study:
        raise ValueError(f"out is {folder}, whose {path.name} is of another study; choose another --out")
    plans = [plan(study, name, folder) for name in study.arms]
    if not path.exists():
        write_text(path, yaml.safe_dump(study.to_dict(), **STYLE))
    results = []
    with progress_bars() as bars:
        line = bars.add_task("policy study", total=sum(p.steps() for p in plans), note="")

        def done(steps: int, note: str) -> None:
            bars.update(line, advance=steps, note=note)

        for p in plans:
            torch.set_num_threads(p.preset.torch_threads)
            if not p.exists:
                done(0, f"{p.name}: the policy")
                ensure_trained(p.preset, p.run, bars)
                done(p.preset.total_steps, "")
            rows, episodes = first_part(study, p, done, trust)
            trained = second_part(study, p, done, bars)
            measures = ("hold_success", "mean_return") if trained else ()
            training = {measure: difference(study, p, trained, measure) for measure in measures}
            policy = describe(p.run)
            results.append(ArmResult(p.name, p.preset.env, policy, rows, episodes, trained, training))
    return results


def first_part(
    study: Study, p: Plan, done: Callable[[int, str], None], trust: bool
) -> tuple[list[Row], dict[str, Evaluation]]:
    """One policy under each physics, compared with the reference."""
    act = policy_act(load_policy(p.run, run_folder.own_config(p.run), trust))
    episodes = {}
    for label, kwargs in p.kwargs.items():
        done(0, f"{p.name}: {label}")
        episodes[label] = evaluate_under(p.preset.env, act, study.episodes, study.seed, **kwargs)
        done(EVALUATION_STEPS, "")
    rows = []
    for label in study.physics:
        row: Row = {
            "arm": p.name, "env": p.preset.env, "policy": describe(p.run), "physics": label,
            "reference": study.reference, "seed": study.seed, "resamples": study.resamples,
        }  # fmt: skip
        row |= figures(episodes[label])
        row |= compare(episodes[label], episodes[study.reference], study.resamples)
        rows.append(row)
    return rows, episodes


def second_part(study: Study, p: Plan, done: Callable[[int, str], None], bars: Any) -> list[Row]:
    """Policies trained under the cheap physics and under the preset's own, evaluated under the reference."""
    rows = []
    for i, (label, config, folder) in enumerate(p.trainings):
        done(0, f"{p.name}: training {i + 1}/{len(p.trainings)}, {label}, seed {config.seed}")
        facts = ensure_trained(config, folder, bars)
        done(config.total_steps, "")
        act = policy_act(load_policy(folder, run_folder.own_config(folder)))
        ends: Row = {}
        for where, kwargs in (("", p.kwargs[study.reference]), ("own_", config.env_kwargs)):
            outcome = run_episodes(config.env, act, study.episodes, study.seed, **kwargs)
            ends[f"{where}hold_success"] = float(held(outcome).mean())
            ends[f"{where}mean_return"] = float(outcome.returns.mean())
            ends[f"{where}ended"] = int(outcome.ended.sum())
            done(EVALUATION_STEPS, "")
        rows.append({
            "arm": p.name, "env": config.env, "trained_under": label,
            "stepping": stepping(make_sb3(config.env, 1, **config.env_kwargs).core.scene),
            "train_seed": config.seed, **facts, "reference": study.reference,
            "episodes": study.episodes, "seed": study.seed, **ends,
        })  # fmt: skip
    return rows


def difference(study: Study, p: Plan, trained: list[Row], measure: str) -> Row:
    """Difference of the mean of a measure between training under cheap and under own physics."""
    cheap, pairs = study.arms[p.name].cheap, [(row["trained_under"], row[measure]) for row in trained]
    a, b = (np.array([value for of, value in pairs if of == label]) for label in (cheap, "preset"))
    return {
        "arm": p.name, "env": p.preset.env, "measure": measure, "cheap": cheap,
        "policies_each": len(a), "mean_cheap": float(a.mean()), "mean_preset": float(b.mean()),
        **compare_groups(a, b, study.resamples), "reference": study.reference,
        "resamples": study.resamples,
    }  # fmt: skip


def ensure_trained(config: Config, folder: Path, bars: Any) -> dict[str, Any]:
    """Train into a folder, or use the run that an earlier call of the same study left there."""
    if not folder.exists():
        unfinished = folder.with_name(f"{folder.name}.unfinished")
        if unfinished.exists():  # left by a study that was stopped
            shutil.rmtree(unfinished)
        train(config, unfinished, bars)
        unfinished.rename(folder)
    rows = run_folder.read_curve(folder)
    if not len(rows):
        raise ValueError(f"{folder}/selection.csv has no rows; delete {folder} to train it again")
    steps, seconds = rows[-1, :2].tolist()
    return {"env_steps": int(steps), "train_seconds": seconds}


def describe(folder: Path) -> str:
    """A run folder's policy in words."""
    config = run_folder.own_config(folder)
    core = make_sb3(config.env, 1, **config.env_kwargs).core
    words = f"{config.label}, seed {config.seed}"
    if (folder / "selection.csv").is_file():
        rows = run_folder.read_curve(folder)
        words += f", {rows[-1, 0] / 1e6:.2f} million steps" if len(rows) else ", no point of its curve"
    return f"{words}, trained under {stepping(core.scene)}"


def stamp() -> dict[str, str]:
    """Machine, date and versions of the study."""
    names = ("gymnasium", "stable-baselines3", "torch")
    return {**versions(), **{name.replace("-", "_"): version(name) for name in names}}
