"""Runs from their folders and from tables, a line of JSON for each, and groups that differ in seeds alone."""

import fnmatch
import json
import os
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.registration import IDS, full_id, scene_of
from redundant_envs.scenes.scene import Scene
from redundant_envs.support import bounded
from redundant_envs.support.disk import write_text
from redundant_envs.support.values import shown

from .. import command, run_folder, train_again
from ..config import WITHOUT_EFFECT, Config, checked, config_of

TABLE = ".jsonl"  # ending of a table of runs
SHARES = ("hold_success", "touch_success")  # columns of the curve that are NaN if the task does not tell them
CIRCUMSTANCES = ("train_seconds", "versions", "machine", "date")
"""Entries in which two trainings of one seed may differ although their results are the same."""


@dataclass(frozen=True, eq=False)
class Run:
    """One evaluated run."""

    folder: Path  # for a row of a table, that of the table and the name of the run
    env: str
    learner: str  # name of the algorithm in tables and figures
    seed: int
    settings: Mapping[str, Any]  # the configuration without its seed
    scene: Mapping[str, Any]  # plain data of the scene that it was trained in
    evaluation: Mapping[str, Any]  # content of evaluation.json
    curve: NDArray[np.float64]  # rows of selection.csv, (points, len(run_folder.SELECTION))
    simulator: str | None  # checksum of the simulator that it was trained with


@dataclass(frozen=True, eq=False)
class Group:
    """Runs of one environment, learner and all settings, in the order of their seeds."""

    environment: str  # id without its namespace
    scene: str  # its name, or "" for the environment's own
    learner: str  # "PPO", and the settings that differ between groups of one environment, scene and learner
    runs: tuple[Run, ...]

    @property
    def title(self) -> str:
        """The environment, with its scene where that is another one."""
        return f"{self.environment} ({self.scene})" if self.scene else self.environment

    def numbers(self, name: str) -> list[float]:
        """An entry of the evaluations, from those runs that have it."""
        return [float(values) for run in self.runs if (values := run.evaluation.get(name)) is not None]


def read_run(folder: str | Path, stopped: bool = False, evaluation: Mapping[str, Any] | None = None) -> Run:
    """Read a run folder, that of a stopped training only if ``stopped``; ``evaluation`` replaces its own.
    ValueError if it is not that of an evaluated run, or a file in it is damaged or of another run."""
    folder = Path(folder)
    if folder.is_file():
        raise ValueError(f"{folder} is a file; give a run folder, or a table of runs, which ends in {TABLE}")
    config, scene = run_folder.read_config(folder), run_folder.read_scene(folder).to_dict()
    evaluation = run_folder.read_evaluation(folder) if evaluation is None else evaluation
    facts = run_folder.read_facts(folder)
    if facts["stopped"] and not stopped:
        fix = f"leave it out, or go on with it: {command('resume', folder)}"
        raise ValueError(f"{folder} is a training that was stopped; {fix}")
    return run_of(folder, config, scene, evaluation, run_folder.read_curve(folder), facts["simulator"])


def run_of(
    folder: Path, config: Config, scene: Mapping[str, Any], evaluation: Mapping[str, Any],
    curve: NDArray[np.float64], simulator: str | None,
) -> Run:  # fmt: skip
    """A run from its parts; ValueError if they contradict each other."""
    for name in ("env", "algo", "seed"):
        if evaluation[name] != (value := getattr(config, name)):
            fix = f"{shown(value)}; make it again: {run_folder.evaluate_anew(folder)}"
            problem = f"{folder}/evaluation.json has {shown(evaluation[name])} as {name!r}"
            raise ValueError(f"{problem}, and config.yaml has {fix}")
    column = run_folder.SELECTION.index
    progress = curve[:, [column("env_steps"), column("seconds")]]
    untold = SHARES if evaluation["hold_success"] is None else ()
    needed = np.delete(curve, [column(name) for name in untold], axis=1)
    if not np.isfinite(needed).all() or (np.diff(progress, axis=0) < 0).any():
        reason = "a number is not finite, or steps or seconds go back"
        fix = f"make it again: {train_again(folder)}"
        raise ValueError(f"{folder}/selection.csv is damaged ({reason}); {fix}")
    settings = config.to_dict("seed", *WITHOUT_EFFECT)
    return Run(folder, config.env, config.label, config.seed, settings, scene, evaluation, curve, simulator)


def group(runs: Iterable[Run]) -> list[Group]:
    """Join runs of the same environment, learner, settings and number of evaluation episodes; of several
    folders of a seed the first one is taken, if their results are the same."""
    by_settings: dict[str, dict[int, Run]] = {}
    for run in runs:
        key = json.dumps([run.settings, run.scene, run.evaluation["episodes"]], sort_keys=True, default=str)
        first = by_settings.setdefault(key, {}).setdefault(run.seed, run)
        if not _same_results(first, run):
            reason = f"runs of seed {run.seed} with the same settings and different results"
            raise ValueError(f"{first.folder} and {run.folder} are {reason}; give one of them")
    members = [tuple(by_seed[seed] for seed in sorted(by_seed)) for by_seed in by_settings.values()]
    alike: dict[tuple[str, str, str], list[tuple[Run, ...]]] = {}
    for same in members:
        alike.setdefault((same[0].env.split("/")[-1], _scene(same[0]), same[0].learner), []).append(same)
    return [
        Group(environment, scene, ", ".join([learner, *difference]), same)
        for (environment, scene, learner), rivals in sorted(alike.items())
        for same, difference in zip(rivals, _differences([r[0] for r in rivals]), strict=True)
    ]


def _same_results(a: Run, b: Run) -> bool:
    """Whether runs agree in all that both tell: folders of older versions have less."""
    names = a.evaluation.keys() & b.evaluation.keys() - CIRCUMSTANCES
    pairs = [(a.evaluation[name], b.evaluation[name]) for name in names]
    agree = all(one == other or None in (one, other) or {} in (one, other) for one, other in pairs)
    columns = [i for i, name in enumerate(run_folder.SELECTION) if name != "seconds"]
    return agree and np.array_equal(a.curve[:, columns], b.curve[:, columns], equal_nan=True)


def _scene(run: Run) -> str:
    """Name of a scene that is not the environment's own; a scene without a name gets a checksum."""
    default = scene_of(*IDS[full_id(run.env)])
    scene = run.settings["env_kwargs"].get("scene", default)
    if isinstance(scene, str):
        return "" if scene == default else scene
    return f"scene {_checksum(scene)}"


def _checksum(scene: Mapping[str, Any]) -> str:
    return f"{zlib.crc32(json.dumps(scene, sort_keys=True, default=str).encode()):08x}"


def _differences(runs: list[Run]) -> list[list[str]]:
    """For each run, the settings in which the runs differ, as "name=value"."""
    beside = [{"goals": r.evaluation["episodes"], "scene": _checksum(r.scene)} for r in runs]
    settings = [run_folder.flat(r.settings) | more for r, more in zip(runs, beside, strict=True)]
    names = sorted({name for values in settings for name, value in values.items() if value != {}})
    differing = [n for n in names if any(values.get(n) != settings[0].get(n) for values in settings)]
    return [[f"{n}={shown(values[n]) if n in values else 'unset'}" for n in differing] for values in settings]


def write_runs(runs: Sequence[Run], path: Path) -> None:
    """Write runs as a table that :func:`read_runs` reads; their names are the ends of their folders."""
    folders = [run.folder.absolute() for run in runs]
    above = os.path.commonpath([folder.parent for folder in folders])
    lines = []
    for run, folder in zip(runs, folders, strict=True):
        data = {
            "run": folder.relative_to(above).as_posix(), "simulator": run.simulator,
            "config": {**run.settings, "seed": run.seed}, "evaluation": run.evaluation, "scene": run.scene,
            "curve": dict(zip(run_folder.SELECTION, run.curve.T.tolist(), strict=True)),
        }  # fmt: skip
        lines.append(json.dumps(data) + "\n")
    write_text(path, "".join(lines))


def read_runs(places: Iterable[str | Path]) -> list[Run]:
    """Runs from run folders, tables of :func:`write_runs`, and runs of a table, ``TABLE.jsonl/NAME``, where
    the name may be a pattern such as ``*_sac/*``."""
    runs: list[Run] = []
    for place in map(Path, places):
        table = _table_of(place)
        if table is None:
            runs.append(read_run(place))
        else:
            runs += _read_table(table, place.relative_to(table).as_posix())
    if not runs:
        raise ValueError("folders is empty; give at least one run folder")
    return runs


def read_places(places: Iterable[str | Path]) -> list[Path]:
    """The run folders, and the tables of runs, that :func:`read_runs` reads."""
    return [_table_of(place) or place for place in map(Path, places)]


def _table_of(place: Path) -> Path | None:
    """The table of runs that a place names, as in runs.jsonl/name."""
    return next((p for p in (place, *place.parents) if p.suffix == TABLE and p.is_file()), None)


def read_groups(places: Iterable[str | Path]) -> list[Group]:
    """The groups of runs; ValueError as in :func:`read_runs` and :func:`group`."""
    return group(read_runs(places))


def _read_table(path: Path, pattern: str) -> list[Run]:
    """The runs of a table whose names have a pattern; "." are all."""
    name, names, runs = "", [], []
    try:
        for line in bounded.read_lines(path, "table of runs", bounded.MAX_TABLE):
            data = json.loads(line)
            names.append(name := data["run"])
            if pattern == "." or fnmatch.fnmatchcase(name, pattern):
                runs.append(_run(path / name, data))
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        reason = str(error).partition(";")[0][:300]
        fix = f"write it again: {command('table', 'RUNS', '--out', path)}"
        damage = f"or its run {shown(name)} is damaged ({reason})"
        raise ValueError(f"{path} is no table of runs, {damage}; {fix}") from error
    if not runs:
        raise ValueError(f"{path} has no run {pattern}; it has {', '.join(names[:3]) or 'none'} ...")
    return runs


def _run(folder: Path, data: Mapping[str, Any]) -> Run:
    curve = np.array([data["curve"][name] for name in run_folder.SELECTION], dtype=np.float64).T
    evaluation = checked(run_folder.Evaluation, data["evaluation"]).model_dump()
    scene = Scene.from_dict(data["scene"]).to_dict()
    return run_of(folder, config_of(data["config"]), scene, evaluation, curve, data["simulator"])
