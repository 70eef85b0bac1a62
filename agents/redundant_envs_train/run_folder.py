"""The files of a run folder: for a missing or damaged one the error names the command that writes it."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.registration import ids
from redundant_envs.values import shown

from . import COMMAND, command, train_again
from .config import ALGORITHMS, MOST_EPISODES, MOST_SEEDS, Config, load

SELECTION = ("env_steps", "seconds", "hold_success", "touch_success", "return")
"""Columns of selection.csv."""
EPISODES = ("seed", "hold", "touch", "distance", "return", "expert_hold", "expert_distance")
"""Columns of episodes.csv."""
FACTS = ("env_steps", "train_seconds")
MOST = 1e15
"""Largest number of a run: of its steps, seconds and metres."""
NUMBERS = {
    "median_distance": MOST, "expert_median_distance": MOST, "mean_return": MOST, "expert_mean_return": MOST,
    "hold_success": 1, "touch_success": 1, "expert_hold_success": 1,
}  # fmt: skip
"""Largest values of the numbers of an evaluation."""
UNSURE = {
    "env_steps": MOST, "train_seconds": MOST, "time_to_hold": MOST, "effort": MOST, "smoothness": MOST,
    "expert_time_to_hold": MOST, "expert_effort": MOST, "expert_smoothness": MOST, "restless": MOST,
    "expert_touch_success": 1,
}  # fmt: skip
"""The same of numbers that may be unknown, as in folders of older versions."""
MOST_CHARACTERS = 200
"""Most characters of the name of a machine."""


def read_config(folder: Path) -> Config:
    """The configuration of a run folder."""
    path = folder / "config.yaml"
    if not path.is_file():
        there = "is a file" if folder.is_file() else "is there" if folder.is_dir() else "does not exist"
        raise ValueError(
            f"{path} is missing ({folder} {there}); give a run folder, as '{COMMAND} train' writes it"
        )
    return load(path)


def is_exported(folder: Path) -> bool:
    """Whether a folder is that of an exported policy, which has no evaluation and no learning curve."""
    return (folder / "policy.npz").is_file() and not (folder / "evaluation.json").is_file()


def evaluate_anew(folder: Path) -> str:
    """The command that writes the evaluation of a run."""
    return command("evaluate", folder, "--overwrite")


def read_evaluation(folder: Path) -> dict[str, Any]:
    """The checked content of evaluation.json, which may be printed and compared."""
    path = folder / "evaluation.json"
    if is_exported(folder):
        raise ValueError(
            f"{folder} is an exported policy: it has a card, README.md, and no evaluation.json; give the "
            "folder of its run"
        )
    if not path.is_file():
        raise ValueError(f"run folder {folder} has no evaluation.json; make it: {evaluate_anew(folder)}")
    return checked_evaluation(_read_json(path, evaluate_anew(folder)), folder)


def checked_evaluation(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The evaluation of a run with this folder; ValueError if an entry is missing or impossible."""
    checks = {name: _is_number(data.get(name), most) for name, most in NUMBERS.items()}
    checks |= {n: data.get(n) is None or _is_number(data[n], most) for n, most in UNSURE.items()}
    for name, low, high in (("seed", 0, MOST_SEEDS), ("episodes", 1, MOST_EPISODES)):
        checks[name] = isinstance(data.get(name), int) and _is_number(data[name], high) and data[name] >= low
    checks["env"], checks["algo"] = data.get("env") in ids(), data.get("algo") in ALGORITHMS
    ends: Any = data.get("interval")
    pair = isinstance(ends, list) and [_is_number(rate, 1) for rate in ends] == [True, True]
    checks["interval"] = pair and ends[0] <= ends[1]
    versions = data.get("versions")
    checks["versions"] = isinstance(versions, dict) and all(map(_is_line, (*versions, *versions.values())))
    checks |= {name: _is_line(data.get(name)) for name in ("machine", "date")}
    for name, holds in checks.items():
        if not holds:
            raise ValueError(
                f"{folder}/evaluation.json has {shown(data.get(name))} as {name!r}; make it again: "
                f"{evaluate_anew(folder)}"
            )
    return data


def read_facts(folder: Path) -> dict[str, Any]:
    """Steps, seconds and simulator of the training, None if unknown; whether it was stopped."""
    path = folder / "training.json"
    if not path.is_file():
        return {**dict.fromkeys((*FACTS, "simulator")), "stopped": False}
    data = _read_json(path, train_again(folder))
    for name in FACTS:
        if not _is_number(data.get(name)):
            raise ValueError(f"{path} has {shown(data.get(name))} as {name!r}; delete it to go on without")
    simulator = data.get("simulator")
    if simulator is not None and not _is_line(simulator):
        raise ValueError(f"{path} has {shown(simulator)} as 'simulator'; delete it to go on without")
    facts = {name: data[name] for name in FACTS}
    return {**facts, "simulator": simulator, "stopped": data.get("stopped") is True}


def read_table(folder: Path, name: str, columns: tuple[str, ...]) -> NDArray[np.float64]:
    """selection.csv or episodes.csv, (rows, columns); there may be no rows yet."""
    path = folder / name
    remedy = train_again(folder) if columns is SELECTION else evaluate_anew(folder)
    if not path.is_file():
        raise ValueError(f"run folder {folder} has no {name}; make it: {remedy}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a table without rows
            rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
        with path.open(encoding="utf-8") as file:
            head = file.readline().rstrip("\n")
        if head != ",".join(columns):
            raise ValueError(f"its columns are {shown(head)} instead of {','.join(columns)}")
        if rows.size and rows.shape[1] != len(columns):
            raise ValueError(f"{rows.shape[1]} columns instead of {len(columns)}")
    except ValueError as error:
        raise ValueError(f"{path} is damaged ({error}); make it again: {remedy}") from error
    return rows.reshape(-1, len(columns))


def write_text(path: Path, text: str) -> None:
    """Write a text; the file is complete or unchanged."""
    part = path.with_name(f"{path.name}.part")
    part.write_text(text, encoding="utf-8")
    os.replace(part, path)


def write_json(path: Path, data: dict[str, Any]) -> None:
    """Write plain data, like :func:`write_text`."""
    write_text(path, json.dumps(data, indent=2) + "\n")


def flat(data: Mapping[str, Any], where: str = "") -> dict[str, Any]:
    """Data by dotted names; a mapping that is empty, or whose keys have dots, stays one."""
    found: dict[str, Any] = {}
    for name, value in data.items():
        inner = isinstance(value, Mapping) and value and not any("." in key for key in value)
        found |= flat(value, f"{where}{name}.") if inner else {f"{where}{name}": value}
    return found


def _read_json(path: Path, remedy: str) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(data, dict):
            raise ValueError(f"it holds a {type(data).__name__}, not an object")
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is damaged ({error}); make it again: {remedy}") from error
    return data


def _is_number(value: Any, most: float = MOST) -> bool:
    """Whether a value is a number from 0 to ``most``; a run has no negative numbers."""
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= most


def _is_line(value: Any) -> bool:
    """Whether a value is a text that fits into a line of a table."""
    return isinstance(value, str) and value.isprintable() and len(value) <= MOST_CHARACTERS
