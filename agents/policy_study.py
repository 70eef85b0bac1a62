"""What the physics costs a policy: the same episodes under each, and training under the cheapest."""

from __future__ import annotations

import re
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import numpy as np
import yaml
from numpy.typing import NDArray

from redundant_envs.envs.core import Core
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.extras import needs
from redundant_envs.files import explained, text_value
from redundant_envs.integrators.tableaus import METHODS
from redundant_envs.model.batch import Numerics
from redundant_envs.scene import ACCURACIES, Scene, scene_data
from redundant_envs.studies.throughput import versions
from redundant_envs.values import shown

from .config import Config, Real, Text, Whole, checked, load, read
from .config.fields import fields_of
from .policies import load_policy
from .rollout import STUDY_SEED, Act, Outcome, policy_act, run_episodes
from .run_folder import SELECTION, read_config, read_facts, read_table
from .statistics import bootstrap_means, middle_95, permutation_test, sign_test, wilson
from .training.train import simulator_hash, train
from .training.watch import progress_bars

with needs("train"):
    import torch
    from pydantic import ConfigDict, PlainValidator
    from pydantic.dataclasses import dataclass as checked_dataclass

Array = NDArray[np.float64]
Row = dict[str, Any]

TIMING_REPEATS = 5
BOOTSTRAP_SEED = 0
FEW = 10
"""Of fewer seeds, or so few episodes, a bootstrap interval alone is not to be relied on."""
NO_AUTORESET = 0
EVALUATION_STEPS = 200_000
"""Training steps that take about as long as an evaluation; for the progress bar alone."""
STEPPING = ("integrator", "substeps", "tolerance")
"""What a scene says about its physics being stepped."""


def _accuracy(value: Any) -> str | float | None:
    if isinstance(value, str):
        value = text_value(value, f"accuracy {shown(value)}")
    if isinstance(value, bool) or not isinstance(value, str | int | float | None):
        raise ValueError(f"accuracy is {shown(value)}; choose {', '.join(ACCURACIES)} or metres")
    return value


Accuracy = Annotated[str | float | None, PlainValidator(_accuracy)]
model = checked_dataclass(frozen=True, config=ConfigDict(extra="forbid"))


@model
class Physics:
    """How a scene is stepped: an integrator with equal substeps, or an accuracy."""

    integrator: Text = ""
    substeps: Whole = 1
    accuracy: Accuracy = None

    def __post_init__(self) -> None:
        if bool(self.integrator) == (self.accuracy is not None):
            raise ValueError(
                f"integrator is {self.integrator!r} and accuracy is {self.accuracy!r}; give exactly one: "
                "an integrator (with substeps), or an accuracy"
            )
        if self.integrator and self.integrator not in METHODS:
            raise ValueError(f"integrator is {self.integrator!r}; choose {', '.join(METHODS)}")
        if self.substeps < 1 or (self.accuracy is not None and self.substeps != 1):
            raise ValueError(
                f"substeps is {self.substeps}; give at least 1, and none beside an accuracy, which "
                "chooses the steps itself"
            )
        if isinstance(self.accuracy, str) and self.accuracy not in ACCURACIES:
            raise ValueError(
                f"accuracy is {self.accuracy!r}; choose {', '.join(ACCURACIES)} or a tip error in metres"
            )

    def to_dict(self) -> dict[str, Any]:
        """Plain data that makes an equal one."""
        if self.accuracy is not None:
            return {"accuracy": self.accuracy}
        return {"integrator": self.integrator, "substeps": self.substeps}

    def env_kwargs(self, config: Config) -> dict[str, Any]:
        """A configuration's arguments of the environment, with this physics and all else equal."""
        kwargs = {k: v for k, v in config.env_kwargs.items() if k not in ("scene", "accuracy")}
        scene = config.env_kwargs.get("scene", gym.spec(config.env).kwargs["scene"])
        data = dict(scene if isinstance(scene, Mapping) else scene_data(scene))
        data = {k: v for k, v in data.items() if k not in STEPPING}
        if self.accuracy is not None:
            return {**kwargs, "scene": data, "accuracy": self.accuracy}
        return {**kwargs, "scene": {**data, **self.to_dict()}}


@model
class StudyArm:
    """An arm of the study.

    Attributes
    ----------
    preset : training configuration: a file, or a preset's name
    run : finished run folder whose policy is taken; without one the preset is trained first
    cheap : name of the physics that the second part trains under
    """

    preset: Text
    run: Text = ""
    cheap: Text = ""


@model
class Study:
    """What is compared.

    Attributes
    ----------
    physics, arms : by name
    reference : name of the physics that the others are compared with
    episodes, seed : episode i starts from seed + i under every physics; used for nothing else
    train_seeds : policies per training physics in the second part; 0 leaves it out
    train_overrides : of the presets in the second part, such as "total_steps=4000000"
    resamples : of the bootstrap
    narrow_hold, narrow_return : margins, shares of the episodes and of the reference's mean return
    """

    physics: Mapping[str, Physics]
    arms: Mapping[str, StudyArm]
    reference: Text = "exact"
    episodes: Whole = 1000
    seed: Whole = STUDY_SEED
    train_seeds: Whole = 5
    train_overrides: tuple[Text, ...] = ()
    resamples: Whole = 10_000
    narrow_hold: Real = 0.01
    narrow_return: Real = 0.01

    def __post_init__(self) -> None:
        for name in ("physics", "arms"):
            parts = getattr(self, name)
            if not parts or len({slug(part) for part in parts}) < len(parts):
                raise ValueError(f"{name} has the names {list(parts)}; give different letters or numbers")
        if self.reference not in self.physics:
            raise ValueError(f"reference is {self.reference!r}; choose {', '.join(self.physics)}")
        if self.seed < STUDY_SEED:
            raise ValueError(
                f"seed is {self.seed}; choose at least {STUDY_SEED}: lower ones would meet the goals of "
                "training, evaluation and selection"
            )
        for name, least in (("episodes", 2), ("resamples", 100)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} is {getattr(self, name)}; it must be at least {least}")
        if self.train_seeds == 1 or not 0 <= self.train_seeds <= 100:
            raise ValueError(f"train_seeds is {self.train_seeds}; choose 0 (no training) or 2..100")
        for name, arm in self.arms.items():
            if self.train_seeds and arm.cheap not in self.physics:
                raise ValueError(
                    f"arms.{name}.cheap is {arm.cheap!r}; choose {', '.join(self.physics)}, or set "
                    "train_seeds to 0"
                )
        for name in ("narrow_hold", "narrow_return"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise ValueError(f"{name} is {getattr(self, name)}; it must lie between 0 and 1")

    def to_dict(self) -> dict[str, Any]:
        """Plain data that makes an equal study."""
        data = {name: getattr(self, name) for name in fields_of(Study)}
        data["physics"] = {k: p.to_dict() for k, p in self.physics.items()}
        data["arms"] = {
            k: {n: getattr(a, n) for n in fields_of(StudyArm) if getattr(a, n)} for k, a in self.arms.items()
        }
        data["train_overrides"] = list(self.train_overrides)
        return data


def load_study(path: str | Path, overrides: Sequence[str] = ()) -> Study:
    """The study of a YAML file, with overrides such as ``train_seeds=0``."""
    data = read(path, overrides, "configs/studies")
    with explained(path, not overrides):
        study: Study = checked(Study, data)
    return study


def slug(name: str) -> str:
    """A name as a part of a file name."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


# ---- one policy under one physics ----------------------------------------------------------------


@dataclass(frozen=True)
class Evaluation:
    """Episodes of a policy under one physics; arrays have one entry per episode.

    Attributes
    ----------
    scene : what was simulated
    start, goal : coordinates and goal at the start, (n, 4) and (n, 2)
    hold : held at the end of a whole episode
    returns, steps, evaluations : as in Outcome
    ended : whether numerics ended the episode early
    flags : numerics flag -> control steps that carry it
    ns_per_step : of the compiled environment step of one lane, best of some
    """

    scene: Scene
    start: Array
    goal: Array
    hold: NDArray[np.bool_]
    returns: Array
    steps: NDArray[np.int64]
    evaluations: NDArray[np.int64]
    ended: NDArray[np.bool_]
    flags: dict[str, int]
    ns_per_step: float


def evaluate_under(
    env_id: str, act: Act, episodes: int, seed: int, repeats: int = TIMING_REPEATS, **kwargs: Any
) -> Evaluation:
    """Run each episode once, all side by side, and time the compiled step on what they did."""
    actions: list[NDArray[np.float32]] = []
    begun: list[tuple[Array, Array]] = []

    def recorded(obs: Any, core: Core, step: int) -> NDArray[np.float32]:
        if step == 0:
            begun.append((core.memory.read(core.scene.robot.coordinates), core.goals()))
        actions.append(act(obs, core, step))
        return actions[-1]

    outcome = run_episodes(env_id, recorded, episodes, seed, **kwargs)
    core, flags, seconds = _replay(env_id, actions, outcome, seed, repeats, kwargs)
    return Evaluation(
        scene=core.scene, start=begun[0][0], goal=begun[0][1], hold=held(outcome),
        returns=outcome.returns, steps=outcome.steps, evaluations=outcome.evaluations,
        ended=outcome.ended,
        flags=flags, ns_per_step=1e9 * seconds / (len(actions) * episodes),
    )  # fmt: skip


def _replay(
    env_id: str, actions: list[NDArray[np.float32]], outcome: Outcome, seed: int, repeats: int,
    kwargs: Mapping[str, Any],
) -> tuple[Core, dict[str, int], float]:  # fmt: skip
    """The same steps again without policy and autoreset: numerics flags, and seconds.

    The seconds are the sum over the steps of the best of ``repeats`` of each.
    """
    env = make_sb3(env_id, len(outcome.hold), **kwargs)
    core, times = env.core, np.empty((repeats, len(actions)))
    codes = np.zeros((len(actions), len(outcome.hold)), dtype=np.int64)
    column = core.columns["numerics"]
    for i in range(repeats):
        env.seed(seed)
        env.reset()
        for k, action in enumerate(actions):
            start = time.perf_counter()
            out = core.step(action, NO_AUTORESET)[1]
            times[i, k] = time.perf_counter() - start
            codes[k] = out[column]
    codes[np.arange(len(actions))[:, None] >= outcome.steps] = 0  # what came after an episode's end
    counts = {str(flag.name): int(np.count_nonzero(codes & flag)) for flag in Numerics}
    return core, {name: n for name, n in counts.items() if n}, float(times.min(axis=0).sum())


# ---- comparison ----------------------------------------------------------------------------------


def compare(
    here: Evaluation, reference: Evaluation, resamples: int, seed: int = BOOTSTRAP_SEED
) -> dict[str, Any]:
    """Differences from the reference, episode by episode, with 95 % intervals of their means."""
    if not (np.array_equal(here.start, reference.start) and np.array_equal(here.goal, reference.goal)):
        raise ValueError("episodes have other starts or goals than under the reference; they are no pairs")
    pairs = np.column_stack([here.hold.astype(float) - reference.hold, here.returns - reference.returns])
    means = bootstrap_means(pairs, resamples, seed)
    hold, gain = pairs.mean(axis=0).tolist()
    lost, won = (int(np.count_nonzero(pairs[:, 0] == flip)) for flip in (-1.0, 1.0))
    return {
        "hold_difference": hold,
        **_bounds("hold_difference", middle_95(means[:, 0])),
        "lost": lost,
        "won": won,
        "sign_test_p": sign_test(lost, won),
        "return_difference": gain,
        **_bounds("return_difference", middle_95(means[:, 1])),
        "median_abs_return_difference": float(np.median(np.abs(pairs[:, 1]))),
        "half_from": half_from(pairs[:, 1]),
    }


def half_from(differences: Array) -> int:
    """How few of the differences make half of the sum of their sizes; 0 where all are 0."""
    sizes = np.sort(np.abs(differences))[::-1]
    return int(np.searchsorted(np.cumsum(sizes), 0.5 * sizes.sum()) + 1) if sizes[0] else 0


def compare_groups(a: Array, b: Array, resamples: int) -> Row:
    """Difference of the means of two groups, a minus b, with a 95 % bootstrap interval.

    Below ``FEW`` samples in each also the p of an exact permutation test.
    """
    means = bootstrap_means(a, resamples, BOOTSTRAP_SEED) - bootstrap_means(b, resamples, BOOTSTRAP_SEED + 1)
    low, high = middle_95(means)
    p = permutation_test(a, b) if max(len(a), len(b)) < FEW else ""
    return {"difference": float(np.mean(a) - np.mean(b)), "low": low, "high": high, "permutation_p": p}


def _bounds(name: str, interval: tuple[float, float]) -> dict[str, float]:
    return {f"{name}_low": interval[0], f"{name}_high": interval[1]}


def stepping(scene: Scene) -> str:
    """How a scene is stepped, in words."""
    if scene.tolerance is not None:
        return f"{scene.integrator} to {scene.tolerance:g} m"
    if scene.integrator == "dop853":
        return "dop853, steps of its own"
    return f"{scene.integrator} {1000 * scene.control_dt / scene.substeps:g} ms"


def figures(evaluation: Evaluation) -> Row:
    """What an evaluation alone says."""
    scene, n, held = evaluation.scene, len(evaluation.hold), int(evaluation.hold.sum())
    low, high = wilson(held, n)
    return {
        "stepping": stepping(scene),
        "episodes": n,
        "hold_success": held / n,
        "hold_low": low,
        "hold_high": high,
        "mean_return": float(evaluation.returns.mean()),
        "ended": int(evaluation.ended.sum()),
        "control_steps": int(evaluation.steps.sum()),
        "numerics": ", ".join(f"{name} {n}" for name, n in evaluation.flags.items()),
        "evaluations_per_step": float(evaluation.evaluations.sum() / evaluation.steps.sum()),
        "ns_per_step": evaluation.ns_per_step,
    }


# ---- the study -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class ArmResult:
    """Everything found out about one arm.

    Attributes
    ----------
    policy : what the policy of the first part is, in words
    rows : one per physics, with "refused" where the scene cannot be stepped so
    episodes : physics -> its evaluation
    trained : one row per policy of the second part
    training : measure -> difference of cheap and own training
    """

    name: str
    env: str
    policy: str
    rows: list[Row]
    episodes: dict[str, Evaluation]
    trained: list[Row]
    training: dict[str, Row]


@dataclass(frozen=True)
class Plan:
    """What is to be done for one arm, checked.

    Attributes
    ----------
    preset : training configuration
    run : folder of the policy of the first part
    given : whether that folder is there already, and not the study's to make
    kwargs : physics -> arguments of the environment
    refused : physics -> why this arm cannot be stepped so
    trainings : of the second part: name of the physics, configuration, run folder
    """

    name: str
    preset: Config
    run: Path
    given: bool
    kwargs: dict[str, dict[str, Any]]
    refused: dict[str, str]
    trainings: list[tuple[str, Config, Path]]

    def steps(self) -> int:
        """Environment steps of its parts, for the progress bar."""
        first = 0 if self.given else self.preset.total_steps
        evaluations = len(self.kwargs) + 2 * len(self.trainings)
        return first + sum(c.total_steps for _, c, _ in self.trainings) + evaluations * EVALUATION_STEPS


def plan(study: Study, name: str, folder: Path) -> Plan:
    """Read and check all that an arm needs, before anything long is begun."""
    arm, runs = study.arms[name], folder / "runs"
    preset = load(arm.preset)
    run = Path(arm.run) if arm.run else runs / f"{slug(name)}_policy"
    if arm.run:
        taken = read_config(run)
        if not (run / "policy.zip").is_file():
            raise ValueError(
                f"arms.{name}.run is {arm.run!r}, which has no policy.zip: it is no finished run"
            )
        if (taken.env, taken.env_kwargs) != (preset.env, preset.env_kwargs):
            raise ValueError(
                f"arms.{name}.run was trained on {taken.env} with {taken.env_kwargs}, the preset is of "
                f"{preset.env} with {preset.env_kwargs}; give a run of this preset"
            )
    kwargs: dict[str, dict[str, Any]] = {}
    refused: dict[str, str] = {}
    for label, physics in study.physics.items():
        arguments = physics.env_kwargs(preset)
        try:
            make_sb3(preset.env, 1, **arguments)
        except ValueError as error:  # an effect may not know this integrator
            refused[label] = str(error)
        else:
            kwargs[label] = arguments
    needed = [study.reference, *([arm.cheap] if study.train_seeds else [])]
    for label in needed:
        if label in refused:
            raise ValueError(f"{name} cannot be stepped with {label!r}, which it needs: {refused[label]}")
    trainings: list[tuple[str, Config, Path]] = []
    for seed in range(study.train_seeds):
        own = load(arm.preset, [*study.train_overrides, f"seed={seed}"])
        cheap = own.model_copy(update={"env_kwargs": kwargs[arm.cheap]})
        for label, config in ((arm.cheap, cheap), ("preset", own)):
            trainings.append((label, config, runs / f"{slug(name)}_{slug(label)}_seed{seed}"))
    for config, kept in [(preset, run)] * (not arm.run) + [(c, f) for _, c, f in trainings]:
        if kept.exists():
            check_kept(config, kept)
    return Plan(name, preset, run, bool(arm.run), kwargs, refused, trainings)


def run_study(study: Study, folder: Path, trust: bool = False) -> list[ArmResult]:
    """Everything the study asks for; training runs are kept in ``folder``/runs and taken up again.

    ``trust`` is that of :func:`load_policy`.
    """
    plans = [plan(study, name, folder) for name in study.arms]
    results = []
    with progress_bars() as bars:
        line = bars.add_task("policy study", total=sum(p.steps() for p in plans), note="")

        def done(steps: int, note: str) -> None:
            bars.update(line, advance=steps, note=note)

        for p in plans:
            torch.set_num_threads(p.preset.torch_threads)
            if not p.given:
                done(0, f"{p.name}: the policy")
                ensure_trained(p.preset, p.run, bars)
                done(p.preset.total_steps, "")
            rows, episodes = first_part(study, p, done, trust)
            trained = second_part(study, p, done, bars)
            training = {
                measure: difference(study, p, trained, measure)
                for measure in ("hold_success", "mean_return")
                if trained
            }
            results.append(
                ArmResult(p.name, p.preset.env, describe(p.run), rows, episodes, trained, training)
            )
    return results


def first_part(
    study: Study, p: Plan, done: Callable[[int, str], None], trust: bool
) -> tuple[list[Row], dict[str, Evaluation]]:
    """One policy under each physics, compared with the reference."""
    act = policy_act(load_policy(p.run, read_config(p.run), trust))
    episodes = {}
    for label, kwargs in p.kwargs.items():
        done(0, f"{p.name}: {label}")
        episodes[label] = evaluate_under(p.preset.env, act, study.episodes, study.seed, **kwargs)
        done(EVALUATION_STEPS, "")
    rows = []
    for label in study.physics:
        row: Row = {"arm": p.name, "env": p.preset.env, "policy": describe(p.run), "physics": label}
        if label in p.refused:
            row["refused"] = p.refused[label]
        else:
            row |= figures(episodes[label])
            row |= compare(episodes[label], episodes[study.reference], study.resamples)
        rows.append({**row, "reference": study.reference, "seed": study.seed, "resamples": study.resamples})
    return rows, episodes


def second_part(study: Study, p: Plan, done: Callable[[int, str], None], bars: Any) -> list[Row]:
    """Policies trained under the cheap physics and under the preset's own, evaluated under the reference."""
    rows = []
    for i, (label, config, folder) in enumerate(p.trainings):
        done(0, f"{p.name}: training {i + 1}/{len(p.trainings)}, {label}, seed {config.seed}")
        facts = ensure_trained(config, folder, bars)
        done(config.total_steps, "")
        act = policy_act(load_policy(folder, config))
        ends: Row = {}
        for where, kwargs in (("", p.kwargs[study.reference]), ("own_", config.env_kwargs)):
            outcome = run_episodes(config.env, act, study.episodes, study.seed, **kwargs)
            ends[f"{where}hold_success"] = float(held(outcome).mean())
            ends[f"{where}mean_return"] = float(outcome.returns.mean())
            ends[f"{where}ended"] = int(outcome.ended.sum())
            done(EVALUATION_STEPS, "")
        rows.append(
            {
                "arm": p.name, "env": config.env, "trained_under": label,
                "stepping": stepping(make_sb3(config.env, 1, **config.env_kwargs).core.scene),
                "train_seed": config.seed, **facts, "reference": study.reference,
                "episodes": study.episodes, "seed": study.seed, **ends,
            }
        )  # fmt: skip
    return rows


def difference(study: Study, p: Plan, trained: list[Row], measure: str) -> Row:
    """Difference of the mean of a measure between training under cheap and under own physics."""
    cheap = study.arms[p.name].cheap
    a, b = (
        np.array([row[measure] for row in trained if row["trained_under"] == label])
        for label in (cheap, "preset")
    )
    return {
        "arm": p.name, "env": p.preset.env, "measure": measure, "cheap": cheap,
        "policies_each": len(a), "mean_cheap": float(a.mean()), "mean_preset": float(b.mean()),
        **compare_groups(a, b, study.resamples), "reference": study.reference,
        "resamples": study.resamples,
    }  # fmt: skip


def check_kept(config: Config, folder: Path) -> None:
    """Refuse a run that an earlier study left in a folder, unless it is what this one would train."""
    core = make_sb3(config.env, 1, **config.env_kwargs).core
    if read_config(folder).to_dict() != config.to_dict() or is_of_other_simulator(folder, core):
        raise ValueError(
            f"{folder} holds a run of another configuration or simulator; choose another --out or delete it"
        )


def is_of_other_simulator(folder: Path, core: Core) -> bool:
    """Whether a run folder says that it was trained on another simulator than today's."""
    said = read_facts(folder)["simulator"]
    return said is not None and said != simulator_hash(core)


def ensure_trained(config: Config, folder: Path, bars: Any) -> dict[str, Any]:
    """Train into a folder, or take what an earlier call of the same study left there."""
    if not folder.exists():
        unfinished = folder.with_name(f"{folder.name}.unfinished")
        if unfinished.exists():  # of a study that was stopped
            shutil.rmtree(unfinished)
        train(config, unfinished, bars)
        unfinished.rename(folder)
    rows = read_table(folder, "selection.csv", SELECTION)
    if not len(rows):
        raise ValueError(f"{folder}/selection.csv has no rows; delete {folder} to train it again")
    steps, seconds = rows[-1, :2].tolist()
    return {"env_steps": int(steps), "train_seconds": seconds}


def describe(folder: Path) -> str:
    """A run folder's policy in words."""
    config = read_config(folder)
    core = make_sb3(config.env, 1, **config.env_kwargs).core
    words = f"{config.label}, seed {config.seed}"
    if (folder / "selection.csv").is_file():
        rows = read_table(folder, "selection.csv", SELECTION)
        words += f", {rows[-1, 0] / 1e6:.2f} million steps" if len(rows) else ", no point of its curve"
    words += f", trained under {stepping(core.scene)}"
    if is_of_other_simulator(folder, core):
        words += ", by another simulator (training.json has another hash of it)"
    return words


def held(outcome: Outcome) -> NDArray[np.bool_]:
    """Episodes that went on to their end and held the goal there."""
    return outcome.hold & ~outcome.ended


def stamp() -> dict[str, str]:
    """Where, when and with what the study was made."""
    names = ("gymnasium", "stable-baselines3", "torch")
    return {**versions(), **{name.replace("-", "_"): version(name) for name in names}}


def save_scenes(study: Study, results: Sequence[ArmResult], folder: Path) -> None:
    """The configuration and every scene that was simulated, as YAML."""
    folder.mkdir(parents=True, exist_ok=True)
    text = yaml.safe_dump(study.to_dict(), sort_keys=False, default_flow_style=None, width=1000)
    (folder / "study.yaml").write_text(text)
    (folder / "scenes").mkdir(exist_ok=True)
    for result in results:
        for label, evaluation in result.episodes.items():
            data = yaml.safe_dump(
                evaluation.scene.to_dict(), sort_keys=False, default_flow_style=None, width=1000
            )
            (folder / "scenes" / f"{slug(result.name)}_{slug(label)}.yaml").write_text(data)
