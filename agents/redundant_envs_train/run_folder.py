"""Run folders: their files, their scenes, and checks before one is written. Nothing large is imported."""

import contextlib
import functools
import hashlib
import itertools
import json
import shlex
import shutil
import sys
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.arguments import with_mode
from redundant_envs.envs.registration import check_arm, check_motors, ids, listed
from redundant_envs.scenes.files import exists
from redundant_envs.scenes.scene import Scene, load_scene, scene_at, scene_path
from redundant_envs.support.bounded import MAX_PACKED, opened, read_json, read_lines
from redundant_envs.support.disk import check_folder, check_plain, write_text
from redundant_envs.support.extras import needs
from redundant_envs.support.values import say, shown

from . import COMMAND, command, train_again
from .config import MAX_EPISODES, MAX_SEEDS, WITHOUT_EFFECT, Config, Model, check_telemetry, checked, load
from .config.fields import Real, Text, Whole
from .config.run import Algorithm

with needs("train"):
    from pydantic import AfterValidator, ConfigDict, Field, model_validator

SELECTION = ("env_steps", "seconds", "hold_success", "touch_success", "return")  # columns of selection.csv
EPISODES = ("seed", "hold", "touch", "distance", "return", "expert_hold", "expert_distance")
"""Columns of episodes.csv."""
MOST = 1e15  # largest number of a run: of its steps, seconds and metres
MAX_CHARACTERS = 200  # most characters of the name of a machine
LONGEST_ROW = 128  # bytes of a row of selection.csv or episodes.csv: fewer than 80 are written
CHECKPOINT, OLD_CHECKPOINT = "checkpoint", "checkpoint.old"
"""Checkpoint folders inside that of a run; after a kill between two renamings only the old name exists."""
STATE = "state.pt"  # file that exists only in a complete checkpoint
EVALUATED = ("evaluation.json", "episodes.csv")
RESULTS = (*EVALUATED, "report.md")  # files of a run that is evaluated and reported
REPORTED = ("report.md", "plots", "clip.gif")
JUDGED = (*EVALUATED, *REPORTED)
TRAINED = ("policy.zip", "selection.csv", "monitor.csv", "progress*.csv", "tensorboard", "training.json")
"""What a training writes beside its configuration, its scene and its checkpoint."""
SCENE = "scene.yaml"


def read_config(folder: Path, overrides: Sequence[str] = ()) -> Config:
    """The configuration of a run folder, which holds no links, with overrides of the command."""
    path = folder / "config.yaml"
    if not path.is_file():
        there = "is a file" if folder.is_file() else "is there" if folder.is_dir() else "does not exist"
        fix = f"give a run folder, as '{COMMAND} train' writes it"
        raise ValueError(f"{path} is missing ({folder} {there}); {fix}")
    check_plain(folder)
    return load(path, overrides)


def config_to_resume(folder: Path, overrides: Sequence[str] = ()) -> Config:
    """The configuration with which a run goes on; ValueError for overrides that would change its results."""
    for override in overrides:
        if override.partition("=")[0] not in WITHOUT_EFFECT:
            free = f"only {' and '.join(WITHOUT_EFFECT)} may be set"
            raise ValueError(f"override is {shown(override)}; a run goes on as it began, and {free}")
    config = read_config(folder, overrides)
    check_telemetry(config, overrides)
    return config


def is_exported(folder: Path) -> bool:
    """Whether a folder is that of an exported policy, which has no evaluation and no learning curve."""
    return (folder / "policy.npz").is_file() and not (folder / "evaluation.json").is_file()


def evaluate_anew(folder: Path) -> str:
    return command("evaluate", folder, "--force")


def _line(text: str) -> str:
    if not text.isprintable() or len(text) > MAX_CHARACTERS:
        raise ValueError(f"give a line of at most {MAX_CHARACTERS} characters")
    return text


Line = Annotated[Text, AfterValidator(_line)]
Share = Annotated[Real, Field(ge=0, le=1)]
Amount = Annotated[Real, Field(ge=0, le=MOST)]
Count = Annotated[Whole, Field(ge=0, le=MOST)]
Number = Annotated[Real, Field(ge=-MOST, le=MOST)]


class Evaluation(Model):
    """The entries of evaluation.json, in SI units; None for what is unknown, or the task does not tell.
    Older versions have written less, and entries of other versions are kept."""

    model_config = ConfigDict(extra="allow")

    env: Line
    algo: Algorithm
    seed: Annotated[Whole, Field(ge=0, le=MAX_SEEDS)]
    episodes: Annotated[Whole, Field(ge=1, le=MAX_EPISODES)]
    interval: tuple[Share, Share] | None  # of hold_success, 95 %
    hold_success: Share | None
    touch_success: Share | None
    median_distance: Amount | None
    time_to_hold: Amount | None = None
    effort: Amount | None = None
    smoothness: Amount | None = None
    mean_return: Number
    expert_hold_success: Share | None
    expert_touch_success: Share | None = None
    expert_median_distance: Amount | None
    expert_time_to_hold: Amount | None = None
    expert_effort: Amount | None = None
    expert_smoothness: Amount | None = None
    expert_mean_return: Number | None
    expert_refusal: Line | None = None  # why it does not act in the scene
    restless: Count | None = None  # goals that were missed, by what happened: the tip moved there
    passed: Count | None = None  # the tip was there and left
    missed_by_both: Count | None = None
    stopped: Count | None = None  # a fault ended the episode
    failures: dict[Line, Count] = {}  # what the task tells of others that were missed
    faults: dict[Line, Count] = {}
    better: dict[Line, bool | None] = {}
    metrics: dict[Line, Number] = {}
    env_steps: Count | None = None
    train_seconds: Amount | None = None
    date: Line
    machine: Line
    versions: dict[Line, Line]

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.env not in ids():
            raise ValueError(f"env is {shown(self.env)}; choose {listed()}")
        if (self.interval is None) != (self.hold_success is None):
            raise ValueError(f"interval is {self.interval}, and hold_success is {self.hold_success}")
        if self.interval is not None and self.interval[0] > self.interval[1]:
            raise ValueError(f"interval is {self.interval}; give the lower end first")
        return self


class ShownFacts(Model):
    """What training.json tells of demonstrations."""

    model_config = ConfigDict(extra="ignore")

    episodes: Count
    held: Count | None  # None where the task tells no success
    sha256: Line  # of the transitions
    seconds: Amount


class Facts(Model):
    """The entries of training.json; None for what is unknown."""

    model_config = ConfigDict(extra="ignore")

    env_steps: Count | None = None
    train_seconds: Amount | None = None
    simulator: Line | None = None
    split: dict[Line, Number] = {}
    demonstrations: ShownFacts | None = None
    stopped: bool = False


def read_evaluation(folder: Path) -> dict[str, Any]:
    """The checked content of evaluation.json, which may be printed and compared."""
    path = folder / "evaluation.json"
    if is_exported(folder):
        raise ValueError(f"{folder} is an exported policy; give the folder of its run")
    if not path.is_file():
        raise ValueError(f"run folder {folder} has no evaluation.json; make it: {evaluate_anew(folder)}")
    return _read_json(path, Evaluation, evaluate_anew(folder))


def read_facts(folder: Path) -> dict[str, Any]:
    """Steps, seconds and simulator of the training, None if unknown; whether it was stopped."""
    path = folder / "training.json"
    return _read_json(path, Facts, train_again(folder)) if path.is_file() else Facts().model_dump()


def read_curve(folder: Path) -> NDArray[np.float64]:
    """selection.csv, (points, len(SELECTION)); there may be no point yet."""
    return _read_table(folder / "selection.csv", SELECTION, train_again(folder))


def read_episodes(folder: Path) -> NDArray[np.float64]:
    """episodes.csv, (episodes, len(EPISODES)); NaN for what the task does not tell."""
    return _read_table(folder / "episodes.csv", EPISODES, evaluate_anew(folder))


def _read_table(path: Path, columns: Sequence[str], remedy: str) -> NDArray[np.float64]:
    """The rows of a table of numbers with these columns; ValueError if there is no such table."""
    if not path.is_file():
        raise ValueError(f"run folder {path.parent} has no {path.name}; make it: {remedy}")
    try:
        lines = read_lines(path, "table", MAX_EPISODES * LONGEST_ROW)
        head = next(lines, "")
        if head != ",".join(columns):
            raise ValueError(f"its columns are {shown(head)} instead of {','.join(columns)}")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a table without rows
            rows = np.loadtxt(itertools.islice(lines, MAX_EPISODES + 1), delimiter=",", ndmin=2)
        if len(rows) > MAX_EPISODES or (rows.size and rows.shape[1] != len(columns)):
            raise ValueError(f"it has {rows.shape} numbers; give {len(columns)} columns")
    except ValueError as error:
        raise ValueError(f"{path} is damaged ({error}); make it again: {remedy}") from error
    return rows.reshape(-1, len(columns))


def write_json(path: Path, data: dict[str, Any]) -> None:
    """Write plain data; the file is complete or unchanged."""
    write_text(path, json.dumps(data, indent=2) + "\n")


def flat(data: Mapping[str, Any], where: str = "") -> dict[str, Any]:
    """Data by dotted names; a mapping that is empty, or whose keys have dots, stays one."""
    entries: dict[str, Any] = {}
    for name, value in data.items():
        inner = isinstance(value, Mapping) and value and not any("." in key for key in value)
        entries |= flat(value, f"{where}{name}.") if inner else {f"{where}{name}": value}
    return entries


def first_difference(one: Mapping[str, Any], other: Mapping[str, Any]) -> tuple[str, str, str] | None:
    """The first entry, by its dotted name, in which nested data differ, and both values in words."""
    entries, others = flat(one), flat(other)
    name = next((k for k in entries | others if entries.get(k) != others.get(k)), None)
    return None if name is None else (name, shown(entries.get(name)), shown(others.get(name)))


def _read_json(path: Path, kind: type[Model], remedy: str) -> dict[str, Any]:
    """The data of a model; ValueError if the file is no JSON, or of another kind."""
    try:
        return checked(kind, read_json(path, path.name)).model_dump()
    except ValueError as error:
        raise ValueError(f"{path} is damaged ({error}); make it again: {remedy}") from error


# ---- the policy with which a training begins


def policy_file(start: str) -> Path:
    """The file that ``start_from`` names: a policy.zip, or that of a run or an exported policy."""
    path = Path(start)
    file = path / "policy.zip" if path.is_dir() else path
    if not file.is_file():
        fix = "give a run folder, the folder of an exported policy, or a policy.zip"
        raise ValueError(f"start_from is {shown(start)}; there is no {file}: {fix}")
    return file


def with_start(config: Config) -> Config:
    """A configuration with the hash of the policy that it starts from; ValueError for another hash."""
    if config.start_from is None:
        return config
    with opened(policy_file(config.start_from), "start_from", MAX_PACKED) as data:
        digest = hashlib.file_digest(data, "sha256").hexdigest()
    if config.start_from_sha256 not in (None, digest):
        problem = f"start_from is {shown(config.start_from)}, whose policy.zip has the SHA-256 {digest}"
        asked = f"start_from_sha256 is {config.start_from_sha256}; give that file, or leave the hash out"
        raise ValueError(f"{problem}, and {asked}")
    return config.model_copy(update={"start_from_sha256": digest})


# ---- the scene of a run: its own scene.yaml, even if the file that its configuration names has changed


def read_scene(folder: Path) -> Scene:
    path = folder / SCENE
    if not path.is_file():
        fix = f"put it back, or make a new run: {train_again(folder)}"
        raise ValueError(f"{folder} has no {SCENE}, which says what its policy was trained in; {fix}")
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
    """That a run's scene differs from the one that its configuration names, in a sentence; nothing if it does
    not, or the file of that one cannot be found."""
    config = read_config(folder)
    named = named_scene(config)
    if isinstance(named, str | Path) and not exists(scene_path(named)):
        return ""
    what = f"the scene {shown(named)} that config.yaml names" if isinstance(named, str) else "config.yaml"
    try:
        named_today = scene_at(named, config.env_kwargs.get("accuracy"))
        today = with_mode(named_today, config.env_kwargs.get("action"))
    except ValueError as error:
        return f"{what} cannot be read any more: {error}"
    return f"{folder / SCENE} differs from {what}" if read_scene(folder).to_dict() != today.to_dict() else ""


def tell_differences(folders: Sequence[Path]) -> None:
    """A line on stderr for each run folder of another scene than its configuration names today."""
    for folder in folders:
        if folder.is_dir() and (text := difference(folder)):
            say(f"note: {text}; the run's own is used", file=sys.stderr)


# ---- checks of folders for results, before anything long begins

check_out = functools.partial(check_folder, "out", fix="choose another --out")


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
    """Refuse a folder for a study with links, or with files but none of the patterns of an earlier call's."""
    check_out(folder)
    check_plain(folder)
    if folder.is_dir() and any(folder.iterdir()) and not any(any(folder.glob(m)) for m in marks):
        raise ValueError(f"out is {folder}, which holds other files and no study; choose another --out")


def begin_study(path: Path, asked: dict[str, Any], storage: str) -> str:
    """Write what the study of a folder is of, or refuse a folder whose study is of something else; returns a
    name of such a study in any storage."""
    # a digest, since the URL of a storage may have a password
    now = {**asked, "storage": hashlib.sha256(storage.encode()).hexdigest()}
    if not path.exists():
        write_json(path, now)
    try:
        differing = first_difference(read_json(path, "study"), now)
    except (ValueError, AttributeError):
        raise ValueError(f"{path} is damaged, or no study's; choose another --out") from None
    if differing:
        other = "{}: {}, and this one has {}".format(*differing)
        raise ValueError(f"{path.parent} holds a study with {other}; choose another --out")
    return hashlib.sha256(json.dumps(asked).encode()).hexdigest()


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
    go_on = f"{train_again(folder)} {shlex.quote(f'start_from={folder}')}"
    if is_exported(folder):
        reason = "is an exported policy and"
    elif not (folder / "training.json").is_file():
        reason, go_on = "was killed, or lacks its training.json, and", train_again(folder)
    elif read_facts(folder)["stopped"]:
        reason = "was stopped and"
    else:
        reason = "is finished and"
    raise ValueError(f"run folder {folder} {reason} has no checkpoint; train on with: {go_on}")


def check_unwritten(folder: Path, files: Sequence[str], force: bool) -> None:
    """Refuse a folder for results that holds files of their names, unless they may be overwritten."""
    check_out(folder)
    check_plain(folder)
    there = ", ".join(name for name in files if (folder / name).exists())
    content = "an exported policy" if is_exported(folder) else f"which has {there}" if there else ""
    if content and not force:
        raise ValueError(f"out is {folder}, {content}; choose another --out, or add --force")


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
