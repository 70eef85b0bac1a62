"""Training configurations: typed, from YAML, with dotted overrides; unknown keys are errors."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from redundant_envs.envs.registration import ARGUMENTS, ids
from redundant_envs.files import exists, explained, read_yaml, text_value
from redundant_envs.scene import scene_folder
from redundant_envs.values import shown

ALGORITHMS = ("ppo", "sac")
LARGEST_WHOLE = 2**53
"""Largest whole number in a configuration: every float up to it is exact."""
SEEDS_PER_RUN = 10_000
"""Environment seeds of a run: seed * 10 000 and up, one per environment."""

Range = tuple[float, float]
RANGES: dict[str, dict[str, Range]] = {
    "": {
        "seed": (0, 99),  # higher ones would meet the evaluation goals
        "num_envs": (1, SEEDS_PER_RUN),  # more would meet the environments of the next seed
        "total_steps": (1, 1e12),
        "max_seconds": (1e-6, float("inf")),
        "torch_threads": (1, 1024),
        "selection_every": (1, 1e12),
        "selection_episodes": (1, 1e6),  # more would meet the goals of the evaluation, and so below
        "evaluation_episodes": (1, 1e6),
    },
    "env_kwargs.": {
        "max_episode_steps": (1, 1e6),  # without an end no evaluation would end
    },
    "ppo.": {
        "n_steps": (1, 1e6),
        "batch_size": (2, 1e8),  # advantages are normalized in a batch
        "n_epochs": (1, 1000),
        "learning_rate": (1e-12, 1),
        "gamma": (0, 1),
        "gae_lambda": (0, 1),
        "clip_range": (1e-6, 10),
        "ent_coef": (0, 100),
        "log_std_init": (-20, 5),
    },
    "sac.": {
        "buffer_size": (1, 1e8),
        "learning_starts": (0, 1e9),
        "batch_size": (1, 1e6),
        "learning_rate": (1e-12, 1),
        "gamma": (0, 1),
        "tau": (1e-9, 1),
        "train_freq": (1, 1e6),
        "gradient_steps": (1, 10_000),
        "ent_coef": (0, 100),
    },
}
"""Least and largest value of each number, both allowed."""
WIDTHS: Range = (1, 2048)
"""Of a layer of a net."""
MOST_LAYERS = 8
MOST_SAMPLES = 10**8
"""Between two updates of PPO: what a rollout holds in memory."""


def check_range(name: str, value: Any, allowed: Range, whole: bool) -> None:
    """ValueError if a number is of another kind, or outside its range."""
    if isinstance(value, bool) or not isinstance(value, int if whole else int | float):
        raise ValueError(f"{name} is {shown(value)}; give a {'whole ' if whole else ''}number")
    low, high = allowed
    if not low <= value <= high:
        bounds = f"from {low:g} to {high:g}" if high < float("inf") else f"of at least {low:g}"
        raise ValueError(f"{name} is {shown(value)}; give a {'whole ' if whole else ''}number {bounds}")


def check_numbers(where: str, settings: Any) -> None:
    """ValueError if a number of settings is outside its range of ``RANGES``."""
    whole = {f.name: f.type == "int" for f in dataclasses.fields(settings)}
    for name, allowed in RANGES[where].items():
        check_range(f"{where}{name}", getattr(settings, name), allowed, whole[name])


def check_net(name: str, widths: Sequence[int]) -> None:
    """ValueError if a net has too many layers, or one of a width that is out of range."""
    if len(widths) > MOST_LAYERS:
        raise ValueError(f"{name} has {len(widths)} layers; give at most {MOST_LAYERS}")
    for i, width in enumerate(widths):
        check_range(f"{name}[{i}]", width, WIDTHS, whole=True)


@dataclass(frozen=True)
class PPOSettings:
    """Settings of PPO; learning rate falls linearly to 0."""

    n_steps: int = 32
    batch_size: int = 4096
    n_epochs: int = 4
    learning_rate: float = 2e-3
    gamma: float = 0.97
    gae_lambda: float = 0.9
    clip_range: float = 0.2
    ent_coef: float = 0.0
    log_std_init: float = -0.5
    net_arch: tuple[int, ...] = (64, 64)

    def __post_init__(self) -> None:
        check_numbers("ppo.", self)
        check_net("ppo.net_arch", self.net_arch)


@dataclass(frozen=True)
class SACSettings:
    """Settings of SAC; learning rate falls linearly to 0.

    A small fixed ent_coef, because holding still needs a policy that is nearly sure; few, large
    minibatches, because a gradient step costs about the same for 256 samples as for 1024.
    """

    buffer_size: int = 1_000_000
    learning_starts: int = 10_000
    batch_size: int = 1024
    learning_rate: float = 6e-3
    gamma: float = 0.9
    tau: float = 0.04
    train_freq: int = 1
    gradient_steps: int = 8
    ent_coef: float = 0.001
    net_arch: tuple[int, ...] = (64, 64)

    def __post_init__(self) -> None:
        check_numbers("sac.", self)
        check_net("sac.net_arch", self.net_arch)


@dataclass(frozen=True)
class Config:
    """One training run.

    Attributes
    ----------
    env : registered id; ``env_kwargs`` are those of ``redundant_envs.make_sb3``, without the number of
        environments and what draws them
    algo : "ppo" or "sac"
    seed : of the learner and, times 10 000, of the environments (below 100)
    num_envs, total_steps : environments in parallel; environment steps in all
    max_seconds : stop earlier after so much training time
    torch_threads : threads of PyTorch
    selection_every, selection_episodes : the policy kept is the best on goals of their own
    evaluation_episodes : on frozen goals that are used for nothing else
    """

    env: str
    algo: str = "ppo"
    seed: int = 0
    num_envs: int = 512
    total_steps: int = 8_000_000
    max_seconds: float = 600.0
    torch_threads: int = 1
    selection_every: int = 400_000
    selection_episodes: int = 500
    evaluation_episodes: int = 1000
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    ppo: PPOSettings = field(default_factory=PPOSettings)
    sac: SACSettings = field(default_factory=SACSettings)

    def __post_init__(self) -> None:
        if self.algo not in ALGORITHMS:
            raise ValueError(f"algo is {shown(self.algo)}; choose {', '.join(ALGORITHMS)}")
        if self.env not in ids():
            raise ValueError(f"env is {shown(self.env)}; choose {', '.join(ids())}")
        check_numbers("", self)
        for name in self.env_kwargs:
            if name not in ARGUMENTS:
                raise ValueError(
                    f"env_kwargs has the unknown key {shown(name)}; valid: {', '.join(ARGUMENTS)}"
                )
        for name, allowed in RANGES["env_kwargs."].items():
            if name in self.env_kwargs:
                check_range(f"env_kwargs.{name}", self.env_kwargs[name], allowed, whole=True)
        if self.algo == "ppo" and self.num_envs * self.ppo.n_steps > MOST_SAMPLES:
            raise ValueError(
                f"ppo.n_steps is {self.ppo.n_steps}; with {self.num_envs} environments give at most "
                f"{MOST_SAMPLES // self.num_envs}"
            )
        if self.algo == "ppo" and (self.num_envs * self.ppo.n_steps) % self.ppo.batch_size:
            total = self.num_envs * self.ppo.n_steps
            raise ValueError(
                f"ppo.batch_size is {self.ppo.batch_size}; it must divide num_envs * ppo.n_steps "
                f"= {total}, such as {total // max(1, round(total / self.ppo.batch_size))}"
            )

    def to_dict(self) -> dict[str, Any]:
        """Plain data, with the settings of the chosen algorithm only."""
        data = dataclasses.asdict(self)
        for name in ALGORITHMS:
            if name != self.algo:
                del data[name]
            else:
                data[name]["net_arch"] = list(data[name]["net_arch"])
        data["env_kwargs"] = dict(self.env_kwargs)
        return data


def build(kind: type[Any], data: Mapping[str, Any], where: str) -> Any:
    """A dataclass from plain data; unknown keys and wrong types are errors that name the field."""
    if not isinstance(data, Mapping):
        raise ValueError(f"{where.rstrip('.')} is {shown(data)}; give a mapping")
    fields = {f.name: f for f in dataclasses.fields(kind)}
    values: dict[str, Any] = {}
    for key, value in data.items():
        if key not in fields:
            raise ValueError(
                f"{where}{str(key)[:80]} is unknown; valid: {', '.join(where + f for f in fields)}"
            )
        values[key] = convert(fields[key].type, value, f"{where}{key}")
    missing = [
        name for name, f in fields.items()
        if name not in values
        and f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
    ]  # fmt: skip
    if missing:
        raise ValueError(f"{where}{missing[0]} is missing")
    return kind(**values)


def convert(annotation: Any, value: Any, name: str) -> Any:
    """A value as its field's type."""
    text = str(annotation)
    if text == "PPOSettings":
        return build(PPOSettings, value, f"{name}.")
    if text == "SACSettings":
        return build(SACSettings, value, f"{name}.")
    if text == "int":
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not abs(value) <= LARGEST_WHOLE
            or value != int(value)
        ):
            raise ValueError(f"{name} is {shown(value)}; give a whole number")
        return int(value)
    if text == "float":
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{name} is {shown(value)}; give a number")
        return float(value)
    if text == "str":
        if not isinstance(value, str):
            raise ValueError(f"{name} is {shown(value)}; give a text")
        return value
    if text == "str | float | None":
        if isinstance(value, str):
            value = number_or_text(value)
        return value if value is None or isinstance(value, str) else convert("float", value, name)
    if text.startswith("tuple"):
        kind, noun = ("str", "texts") if "str" in text else ("int", "whole numbers")
        if not isinstance(value, list | tuple):
            raise ValueError(f"{name} is {shown(value)}; give a list of {noun}")
        return tuple(convert(kind, v, f"{name}[{i}]") for i, v in enumerate(value))
    if not isinstance(value, Mapping):
        raise ValueError(f"{name} is {shown(value)}; give a mapping")
    return dict(value)


def load(path: str | Path, overrides: Sequence[str] = ()) -> Config:
    """A configuration: a YAML file or a preset's name, and overrides such as ``seed=3 ppo.gamma=0.98``."""
    file = preset_path(path)
    data = read(file, overrides, "configs/training")
    with explained(file, not overrides):
        config: Config = build(Config, data, "")
    return config


def preset_folder() -> Path:
    """The folder of the presets: package data in a wheel, configs/training in a checkout."""
    return scene_folder().parent / "training"


def preset_path(path: str | Path) -> Path:
    """The file of a configuration: the path itself, or a preset's by its name."""
    file, preset = Path(path), preset_folder() / f"{path}.yaml"
    if exists(file):
        return file
    if not exists(preset):
        names = ", ".join(sorted(p.stem for p in preset_folder().glob("*.yaml")))
        raise ValueError(f"config is {shown(str(path))}; there is no such file, and the presets are {names}")
    return preset


def read(path: str | Path, overrides: Sequence[str], folder: str) -> dict[str, Any]:
    """What a YAML file holds, with overrides; where it is missing, the error lists the folder's files."""
    file = Path(path)
    if not exists(file):
        available = sorted(str(p) for p in Path(folder).glob("*.yaml"))
        raise ValueError(
            f"config is {shown(str(path))}; there is no such file. Found: {', '.join(available)}"
        )
    data = read_yaml(file, "config")
    if not isinstance(data, dict):
        raise ValueError(f"{file} holds no mapping; give 'key: value' lines")
    for override in overrides:
        key, separator, text = override.partition("=")
        if not separator:
            raise ValueError(f"override is {shown(override)}; write key=value, such as seed=3")
        place = data
        *parents, last = key.split(".")
        for parent in parents:
            place = place.setdefault(parent, {})
            if not isinstance(place, dict):
                raise ValueError(f"override {shown(key)}: {shown(parent)} has no keys inside")
        place[last] = number_or_text(text)
    return data


def number_or_text(text: str) -> Any:
    """A value as YAML reads it."""
    return text_value(text, f"the value {shown(text)}")
