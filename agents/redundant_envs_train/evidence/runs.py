"""Runs read from their folders, and groups of runs that differ only in their seed."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.registration import SCENES
from redundant_envs.values import shown

from .. import command, train_again
from ..config import WITHOUT_EFFECT, Config
from ..own_scene import read_scene
from ..run_folder import SELECTION, evaluate_anew, flat, read_config, read_evaluation, read_facts, read_table

CIRCUMSTANCES = ("train_seconds", "versions", "machine", "date")
"""Entries in which two trainings of one seed may differ although their results are the same."""


@dataclass(frozen=True, eq=False)
class Run:
    """One evaluated run.

    Attributes
    ----------
    folder : Path
        For a row of a table, that of the table and the name of the run.
    env, algo : str
    learner : str
        Name of the algorithm in tables and figures.
    seed : int
    settings : mapping
        The configuration without its seed.
    scene : mapping
        Plain data of the scene that it was trained in.
    evaluation : mapping
        Content of evaluation.json.
    curve : ndarray (points, len(SELECTION))
        The rows of selection.csv.
    simulator : str or None
        Checksum of the simulator that it was trained with.
    """

    folder: Path
    env: str
    algo: str
    learner: str
    seed: int
    settings: Mapping[str, Any]
    scene: Mapping[str, Any]
    evaluation: Mapping[str, Any]
    curve: NDArray[np.float64]
    simulator: str | None


@dataclass(frozen=True, eq=False)
class Group:
    """Runs of one environment, learner and all settings, in the order of their seeds.

    Attributes
    ----------
    environment : str
        Id without its namespace.
    scene : str
        Name of the scene, or "" for the environment's own.
    learner : str
        "PPO", and the settings that differ where several groups share environment, scene and learner.
    runs : tuple of Run
    """

    environment: str
    scene: str
    learner: str
    runs: tuple[Run, ...]

    @property
    def title(self) -> str:
        """The environment, with its scene where that is another one."""
        return f"{self.environment} ({self.scene})" if self.scene else self.environment

    def numbers(self, name: str) -> list[float]:
        """An entry of the evaluations, from those runs that have it."""
        found = [run.evaluation.get(name) for run in self.runs]
        return [float(value) for value in found if value is not None]


def read_run(folder: str | Path, stopped: bool = False, evaluation: Mapping[str, Any] | None = None) -> Run:
    """Read a run folder; that of a training that was stopped only if ``stopped``.

    ``evaluation`` replaces that of the folder.

    Raises
    ------
    ValueError
        The folder is not that of an evaluated run (the message says what is missing), or a file in it is
        damaged or belongs to another run.
    """
    folder = Path(folder)
    config, scene = read_config(folder), read_scene(folder).to_dict()
    evaluation = read_evaluation(folder) if evaluation is None else evaluation
    facts = read_facts(folder)
    if facts["stopped"] and not stopped:
        raise ValueError(
            f"{folder} is a training that was stopped; leave it out, or go on with it: "
            f"{command('resume', folder)}"
        )
    curve = read_table(folder, "selection.csv", SELECTION)
    return run_of(folder, config, scene, evaluation, curve, facts["simulator"])


def run_of(
    folder: Path, config: Config, scene: Mapping[str, Any], evaluation: Mapping[str, Any],
    curve: NDArray[np.float64], simulator: str | None,
) -> Run:  # fmt: skip
    """A run from its parts; ValueError if they contradict each other."""
    settings = config.to_dict()
    seed = settings.pop("seed")
    for name in WITHOUT_EFFECT:
        del settings[name]
    for name in ("env", "algo", "seed"):
        if evaluation[name] != (value := getattr(config, name)):
            raise ValueError(
                f"{folder}/evaluation.json has {shown(evaluation[name])} as {name!r}, and config.yaml has "
                f"{shown(value)}; make it again: {evaluate_anew(folder)}"
            )
    progress = curve[:, [SELECTION.index("env_steps"), SELECTION.index("seconds")]]
    if not np.isfinite(curve).all() or (np.diff(progress, axis=0) < 0).any():
        raise ValueError(
            f"{folder}/selection.csv is damaged (a number is not finite, or steps or seconds go back); make "
            f"it again: {train_again(folder)}"
        )
    return Run(
        folder, config.env, config.algo, config.label, seed, settings, scene, evaluation, curve, simulator
    )


def group(runs: Iterable[Run]) -> list[Group]:
    """Join runs of the same environment, learner, settings and number of evaluation episodes.

    A seed counts once: the first of several folders of one seed is taken if their results are the same.

    Raises
    ------
    ValueError
        Two folders of one group have the same seed and different results.
    """
    found: dict[str, dict[int, Run]] = {}
    for run in runs:
        key = json.dumps([run.settings, run.scene, run.evaluation["episodes"]], sort_keys=True, default=str)
        first = found.setdefault(key, {}).setdefault(run.seed, run)
        if not _same_results(first, run):
            raise ValueError(
                f"{first.folder} and {run.folder} are runs of seed {run.seed} with the same settings and "
                "different results; give one of them"
            )
    members = [tuple(by_seed[seed] for seed in sorted(by_seed)) for by_seed in found.values()]
    alike: dict[tuple[str, str, str], list[tuple[Run, ...]]] = {}
    for same in members:
        alike.setdefault((_environment(same[0]), _scene(same[0]), same[0].learner), []).append(same)
    return [
        Group(environment, scene, ", ".join([learner, *difference]), same)
        for (environment, scene, learner), rivals in sorted(alike.items())
        for same, difference in zip(rivals, _differences([r[0] for r in rivals]), strict=True)
    ]


def _same_results(a: Run, b: Run) -> bool:
    told = a.evaluation.keys() & b.evaluation.keys() - CIRCUMSTANCES  # folders of older versions have less
    facts = [{name: run.evaluation[name] for name in told} for run in (a, b)]
    kept = [i for i, name in enumerate(SELECTION) if name != "seconds"]
    return facts[0] == facts[1] and np.array_equal(a.curve[:, kept], b.curve[:, kept])


def _environment(run: Run) -> str:
    return run.env.split("/")[-1]


def _scene(run: Run) -> str:
    """Name of a scene that is not the environment's own; a scene without a name gets a checksum."""
    own = next(scene for arm, scene in SCENES.items() if _environment(run).startswith(arm))
    scene = run.settings["env_kwargs"].get("scene", own)
    if isinstance(scene, str):
        return "" if scene == own else scene
    return f"scene {_checksum(scene)}"


def _checksum(scene: Mapping[str, Any]) -> str:
    return f"{zlib.crc32(json.dumps(scene, sort_keys=True, default=str).encode()):08x}"


def _differences(runs: list[Run]) -> list[list[str]]:
    """For each run, the settings in which the runs differ, as "name=value"."""
    settings = [
        flat(run.settings) | {"goals": run.evaluation["episodes"], "scene": _checksum(run.scene)}
        for run in runs
    ]
    names = sorted({name for own in settings for name, value in own.items() if value != {}})
    differing = [n for n in names if any(own.get(n) != settings[0].get(n) for own in settings)]
    return [[f"{n}={shown(own[n]) if n in own else 'unset'}" for n in differing] for own in settings]
