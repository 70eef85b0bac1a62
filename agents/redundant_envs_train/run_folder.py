"""Run folders: their files, their scenes, and checks before one is written. Nothing large is imported."""

import contextlib
import itertools
import json
import shlex
import shutil
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.registration import check_arm, check_motors, ids
from redundant_envs.scenes.files import exists
from redundant_envs.scenes.scene import Scene, load_scene, scene_at, scene_path
from redundant_envs.support.bounded import read_json, read_lines
from redundant_envs.support.disk import check_folder, check_plain, write_text
from redundant_envs.support.extras import needs
from redundant_envs.support.figures import check_clip
from redundant_envs.support.values import say, shown

from . import COMMAND, command, train_again
from .config import ALGORITHMS, MAX_EPISODES, MAX_SEEDS, WITHOUT_EFFECT, Config, check_telemetry, load

SELECTION = ("env_steps", "seconds", "hold_success", "touch_success", "return")  # columns of selection.csv
EPISODES = ("seed", "hold", "touch", "distance", "return", "expert_hold", "expert_distance")
"""Columns of episodes.csv."""
FACTS = ("env_steps", "train_seconds")
MOST = 1e15  # largest number of a run: of its steps, seconds and metres
NUMBERS = {
    "median_distance": MOST, "expert_median_distance": MOST, "mean_return": MOST, "expert_mean_return": MOST,
    "hold_success": 1, "touch_success": 1, "expert_hold_success": 1,
}  # fmt: skip
"""Largest values of the numbers of an evaluation."""
RETURNS = ("mean_return", "expert_mean_return")  # those that may be negative
UNTOLD = NUMBERS.keys() - {"mean_return"}  # those that are null where the task does not tell them
UNSURE = {
    "env_steps": MOST, "train_seconds": MOST, "time_to_hold": MOST, "effort": MOST, "smoothness": MOST,
    "expert_time_to_hold": MOST, "expert_effort": MOST, "expert_smoothness": MOST, "restless": MOST,
    "expert_touch_success": 1, "passed": MOST, "stopped": MOST, "missed_by_both": MOST,
}  # fmt: skip
"""The same of numbers that may be unknown, as in folders of older versions."""
UNKNOWN: dict[str, Any] = {**dict.fromkeys(UNSURE), "faults": {}}
"""What an evaluation of an older version lacks."""
LONGEST_ROW = 128  # bytes of a row of selection.csv or episodes.csv: fewer than 80 are written
MAX_CHARACTERS = 200  # most characters of the name of a machine
CHECKPOINT, OLD_CHECKPOINT = "checkpoint", "checkpoint.old"
"""Checkpoint folders inside that of a run; after a kill between two renamings only the old name exists."""
STATE = "state.pt"  # file that exists only in a complete checkpoint
EVALUATED = ("evaluation.json", "episodes.csv")
RESULTS = (*EVALUATED, "report.md")  # files of a run that is evaluated and reported
REPORTED = ("report.md", "plots", "clip.gif", "clip.mp4")
JUDGED = (*EVALUATED, *REPORTED)
TRAINED = ("policy.zip", "selection.csv", "monitor.csv", "progress*.csv", "tensorboard", "training.json")
"""What a training writes beside its configuration, its scene and its checkpoint."""
SCENE = "scene.yaml"
MAX_SHOWN = 3  # most differences in a message


def read_config(folder: Path, overrides: Sequence[str] = ()) -> Config:
    """The configuration of a run folder, which holds no links, with overrides of the command."""
    path = folder / "config.yaml"
    if not path.is_file():
        there = "is a file" if folder.is_file() else "is there" if folder.is_dir() else "does not exist"
        raise ValueError(
            f"{path} is missing ({folder} {there}); give a run folder, as '{COMMAND} train' writes it"
        )
    check_plain(folder)
    return load(path, overrides)


def config_to_resume(folder: Path, overrides: Sequence[str] = ()) -> Config:
    """The configuration with which a run goes on; ValueError for overrides that would change its results."""
    for override in overrides:
        if override.partition("=")[0] not in WITHOUT_EFFECT:
            raise ValueError(
                f"override is {shown(override)}; a run goes on as it began, and only "
                f"{' and '.join(WITHOUT_EFFECT)} may be set"
            )
    config = read_config(folder, overrides)
    check_telemetry(config, overrides)
    return config


def is_exported(folder: Path) -> bool:
    """Whether a folder is that of an exported policy, which has no evaluation and no learning curve."""
    return (folder / "policy.npz").is_file() and not (folder / "evaluation.json").is_file()


def evaluate_anew(folder: Path) -> str:
    """The command that writes the evaluation of a run."""
    return command("evaluate", folder, "--force")


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
    checks = {
        name: _is_number(data.get(name), most, -most if name in RETURNS else 0)
        or (name in UNTOLD and data.get(name, "") is None)
        for name, most in NUMBERS.items()
    }
    checks |= {n: data.get(n) is None or _is_number(data[n], most) for n, most in UNSURE.items()}
    for name, low, high in (("seed", 0, MAX_SEEDS), ("episodes", 1, MAX_EPISODES)):
        checks[name] = isinstance(data.get(name), int) and _is_number(data[name], high) and data[name] >= low
    checks["env"], checks["algo"] = data.get("env") in ids(), data.get("algo") in ALGORITHMS
    ends: Any = data.get("interval")
    pair = isinstance(ends, list) and [_is_number(rate, 1) for rate in ends] == [True, True]
    checks["interval"] = ends is None if data.get("hold_success") is None else pair and ends[0] <= ends[1]
    versions = data.get("versions")
    checks["versions"] = isinstance(versions, dict) and all(map(_is_line, (*versions, *versions.values())))
    checks |= {name: _is_line(data.get(name)) for name in ("machine", "date")}
    checks_of_entries: dict[str, Callable[[Any], bool]] = {
        "faults": _is_number, "better": lambda value: value in (True, False, None),
        "metrics": lambda value: _is_number(value, MOST, -MOST),
    }  # fmt: skip
    for name, fits in checks_of_entries.items():
        entries = data.get(name, {})
        checks[name] = isinstance(entries, dict) and all(_is_line(k) and fits(entries[k]) for k in entries)
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
    facts = {name: data.get(name) for name in (*FACTS, "simulator")}
    for name, value in facts.items():
        fits = _is_number(value) if name in FACTS else value is None or _is_line(value)
        if not fits:
            raise ValueError(f"{path} has {shown(value)} as {name!r}; delete it to go on without")
    return {**facts, "stopped": data.get("stopped") is True}


def read_table(folder: Path, name: str, columns: tuple[str, ...]) -> NDArray[np.float64]:
    """selection.csv or episodes.csv, (rows, columns); there may be no rows yet."""
    path = folder / name
    remedy = train_again(folder) if columns is SELECTION else evaluate_anew(folder)
    if not path.is_file():
        raise ValueError(f"run folder {folder} has no {name}; make it: {remedy}")
    try:
        lines = read_lines(path, "table", MAX_EPISODES * LONGEST_ROW)
        head = next(lines, "")
        if head != ",".join(columns):
            raise ValueError(f"its columns are {shown(head)} instead of {','.join(columns)}")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a table without rows
            rows = np.loadtxt(_of_width(lines, len(columns)), delimiter=",", ndmin=2)
    except ValueError as error:
        raise ValueError(f"{path} is damaged ({error}); make it again: {remedy}") from error
    return rows.reshape(-1, len(columns))


def _of_width(lines: Iterator[str], width: int) -> Iterator[str]:
    """The lines of a table with so many columns, of which a run has at most ``MAX_EPISODES``."""
    for number, line in enumerate(lines):
        if number >= MAX_EPISODES:
            raise ValueError(f"more than {MAX_EPISODES} rows")
        if line and (found := line.count(",") + 1) != width:
            raise ValueError(f"{found} columns instead of {width}")
        yield line


def write_json(path: Path, data: dict[str, Any]) -> None:
    """Write plain data; the file is complete or unchanged."""
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
        data = read_json(path, path.name)
        if not isinstance(data, dict):
            raise ValueError(f"it holds a {type(data).__name__}, not an object")
    except ValueError as error:
        raise ValueError(f"{path} is damaged ({error}); make it again: {remedy}") from error
    return data


def _is_number(value: Any, most: float = MOST, least: float = 0) -> bool:
    """Whether a value is a number from ``least`` to ``most``; only returns and metrics are negative."""
    return isinstance(value, int | float) and not isinstance(value, bool) and least <= value <= most


def _is_line(value: Any) -> bool:
    """Whether a value is a text that fits into a line of a table."""
    return isinstance(value, str) and value.isprintable() and len(value) <= MAX_CHARACTERS


# ---- the scene of a run: its own scene.yaml, even if the file that its configuration names has changed


def read_scene(folder: Path) -> Scene:
    """The scene that a run was trained in."""
    path = folder / SCENE
    if not path.is_file():
        raise ValueError(
            f"{folder} has no {SCENE}, which says what its policy was trained in; put it back, or make a new "
            f"run: {train_again(folder)}"
        )
    return load_scene(path)


def with_scene(config: Config, scene: Scene) -> Config:
    """A configuration in this scene, with the stepping of the scene."""
    rest = {name: value for name, value in config.env_kwargs.items() if name != "accuracy"}
    return config.model_copy(update={"env_kwargs": {**rest, "scene": scene.to_dict()}})


def own_config(folder: Path) -> Config:
    """The configuration of a run folder, in the scene that it was trained in."""
    config, scene = read_config(folder), read_scene(folder)
    try:
        check_arm(config.env, scene.robot.kind)
        check_motors(scene)
    except ValueError as error:
        raise ValueError(f"{folder / SCENE}: {error}") from None
    return with_scene(config, scene)


def named_scene(config: Config) -> Any:
    """The scene that a configuration names or holds: that of its environment, if it has none."""
    return config.env_kwargs.get("scene", gym.spec(config.env).kwargs["scene"])


def difference(folder: Path) -> str:
    """How a run's scene differs from the one that its configuration names, in a sentence; nothing if it does
    not, or the file of that one cannot be found."""
    config = read_config(folder)
    named = named_scene(config)
    if isinstance(named, str | Path) and not exists(scene_path(named)):
        return ""
    what = f"the scene {shown(named)} that config.yaml names" if isinstance(named, str) else "config.yaml"
    try:
        today = scene_at(named, config.env_kwargs.get("accuracy"))
    except ValueError as error:
        return f"{what} cannot be read any more: {error}"
    own, other = _flat_scene(read_scene(folder).to_dict()), _flat_scene(today.to_dict())
    names = [name for name in {**own, **other} if own.get(name) != other.get(name)]
    if not names:
        return ""
    words = []
    for name in names[:MAX_SHOWN]:
        mine, theirs = ("absent" if (v := d.get(name)) is None else shown(v) for d in (own, other))
        words.append(f"{name} {mine}, not {theirs}")
    more = f" and {len(names) - MAX_SHOWN} more" if len(names) > MAX_SHOWN else ""
    return f"{folder / SCENE} differs from {what} ({'; '.join(words)}{more})"


def tell_differences(folders: Sequence[Path]) -> None:
    """One line on stderr if run folders are of other scenes than their configurations name today."""
    found = [text for folder in folders if folder.is_dir() and (text := difference(folder))]
    more = f" (and so for {len(found) - 1} more of {len(folders)} runs)" if len(found) > 1 else ""
    if found:
        say(f"note: {found[0]}; the run's own is used{more}", file=sys.stderr)


def _flat_scene(data: Mapping[str, Any]) -> dict[str, Any]:
    """A scene's data by dotted names; an effect's numbers by its type."""
    effects = {effect["type"]: effect for effect in data["effects"]}
    return flat({name: value for name, value in data.items() if name != "effects"} | effects)


# ---- checks of folders for results, before anything long begins


def check_out(folder: Path) -> None:
    """Refuse an impossible folder for results; see :func:`check_folder`."""
    check_folder("out", folder, "choose another --out")


@contextlib.contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A place to fill, which gets the name of this folder at the end: it is complete or does not exist."""
    there = next(place for place in folder.absolute().parents if place.exists())
    place = Path(tempfile.mkdtemp(prefix=f".{folder.name[:100]}.", dir=there))
    try:
        (part := place / "whole").mkdir()  # not readable by its owner alone, as ``place`` is
        yield part
        folder.parent.mkdir(parents=True, exist_ok=True)
        part.rename(folder)
    finally:
        shutil.rmtree(place, ignore_errors=True)


def replace_folder(new: Path, folder: Path, old: Path) -> None:
    """Rename a folder to one that may exist; after a kill between two renamings that one is ``old``."""
    shutil.rmtree(old, ignore_errors=True)
    if folder.exists():
        folder.replace(old)
    new.replace(folder)
    shutil.rmtree(old, ignore_errors=True)


def check_study(folder: Path, marks: Sequence[str]) -> None:
    """Refuse a folder for a study with links, or with files but none of the patterns that mark an earlier
    call."""
    check_out(folder)
    check_plain(folder)
    if folder.is_dir() and any(folder.iterdir()) and not any(any(folder.glob(m)) for m in marks):
        raise ValueError(f"out is {folder}, which holds other files and no study; choose another --out")


def check_new(folder: Path) -> None:
    """Refuse a file, or a folder that is not empty, as the folder of a new run."""
    check_out(folder)
    if folder.exists() and any(folder.iterdir()):
        hint = f", or go on with: {command('resume', folder)}" if find_checkpoint(folder) else ""
        raise ValueError(f"run folder {folder} is not empty; choose another --out or delete it{hint}")


def find_checkpoint(folder: Path) -> Path | None:
    """The newest complete checkpoint of a run folder, if it has one."""
    return next((p for n in (CHECKPOINT, OLD_CHECKPOINT) if ((p := folder / n) / STATE).is_file()), None)


def was_stopped(folder: Path) -> bool:
    """Whether a training was stopped or killed, and nobody looked at its policy since."""
    if is_exported(folder) or any((folder / name).exists() for name in RESULTS):
        return False
    if (folder / "training.json").exists():
        return bool(read_facts(folder)["stopped"])
    return (folder / "selection.csv").exists() or not (folder / "policy.zip").exists()


def trained(folder: Path) -> Iterator[Path]:
    """The files that a training has written into its folder, which may have others of the user."""
    for name in (*TRAINED, SCENE, "config.yaml"):
        for path in folder.glob(name):
            yield from filter(Path.is_file, (path, *path.rglob("*")))


def set_aside(folder: Path, names: Sequence[str]) -> Path | None:
    """Move what is there of some files of a run into a new folder in the run's; that folder, if any."""
    there = [path for name in names for path in sorted(folder.glob(name))]
    if not there:
        return None
    place = next(p for n in itertools.count(1) if not (p := folder / f"stopped_{n}").exists())
    place.mkdir()
    for path in there:
        path.rename(place / path.name)
    return place


def check_resumable(folder: Path) -> Path | None:
    """The checkpoint of a run folder, None if the run begins again; ValueError if it cannot go on."""
    if (place := find_checkpoint(folder)) is not None:
        return place
    if was_stopped(folder) and read_config(folder).checkpoint_seconds > 0.0:
        return None
    again, go_on = train_again(folder), f"{train_again(folder)} {shlex.quote(f'start_from={folder}')}"
    if is_exported(folder):
        reason, fix = "is an exported policy and", f"go on from it with: {go_on}"
    elif not (folder / "training.json").is_file():
        reason, fix = "was killed, or lacks its training.json, and", f"make a new run: {again}"
    elif read_facts(folder)["stopped"]:
        reason, fix = "was stopped and", f"go on from its policy with: {go_on}"
    elif (folder / "report.md").is_file():
        reason = "is finished and"
        fix = f"watch it with: {command('play', folder)}, or go on from its policy with: {go_on}"
    else:
        reason, fix = "is finished and", f"evaluate and report it with: {command('report', folder)}"
    raise ValueError(f"run folder {folder} {reason} has no checkpoint; {fix}")


def check_unwritten(folder: Path, files: Sequence[str], force: bool) -> None:
    """Refuse a folder for results that holds files of their names, unless they may be overwritten."""
    check_out(folder)
    check_plain(folder)
    if is_exported(folder) and not force:
        raise ValueError(f"out is {folder}, an exported policy; choose another --out, or add --force")
    there = [name for name in files if (folder / name).exists()]
    if there and not force:
        found = ", ".join(there)
        raise ValueError(f"out is {folder}, which has {found}; choose another --out, or add --force")


def check_drawing() -> None:
    """Raise an error if the packages that draw a report are missing."""
    with needs("plot"):
        import matplotlib  # noqa: F401
        import PIL  # noqa: F401
    check_clip(Path("clip.gif"))


def check_target(folder: Path, out: Path | None, force: bool) -> None:
    """Refuse to replace files by a report, or to write into an exported policy, without ``force``."""
    if out is not None:
        check_unwritten(out, JUDGED, force)
        return
    there = [name for name in JUDGED if (folder / name).exists()]
    if set(EVALUATED) <= {*there}:  # they are read
        there = [name for name in there if name in REPORTED]
    if not force and (is_exported(folder) or there):
        reason = "is an exported policy" if is_exported(folder) else f"has {', '.join(there)}"
        raise ValueError(f"{folder} {reason}; give --out FOLDER, or --force to write into it")
