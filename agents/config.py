"""Training configurations: typed, from YAML, with dotted overrides; unknown keys are errors."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from redundant_envs.envs.registration import ids
from redundant_envs.files import exists, explained, read_yaml, text_value
from redundant_envs.scene import scene_folder
from redundant_envs.values import shown

ALGORITHMS = ("ppo", "sac")
LARGEST_WHOLE = 2**53
"""Largest whole number in a configuration: every float up to it is exact."""
SEEDS_PER_RUN = 10_000
"""Environment seeds of a run: seed * 10 000 and up, one per environment."""


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


@dataclass(frozen=True)
class Config:
    """One training run.

    Attributes
    ----------
    env : registered id; ``env_kwargs`` are those of ``redundant_envs.make_sb3``
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
        if not 0 <= self.seed < 100:
            raise ValueError(
                f"seed is {self.seed}; choose 0..99: higher ones would meet the evaluation goals"
            )
        for name in ("num_envs", "total_steps", "torch_threads", "selection_every",
                     "selection_episodes", "evaluation_episodes"):  # fmt: skip
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; it must be at least 1")
        if not self.max_seconds > 0.0:
            raise ValueError(f"max_seconds is {self.max_seconds}; it must be positive")
        for name, most in (
            ("num_envs", SEEDS_PER_RUN),
            ("evaluation_episodes", 1_000_000),
            ("selection_episodes", 1_000_000),
        ):
            if getattr(self, name) > most:
                raise ValueError(
                    f"{name} is {getattr(self, name)}; at most {most}, or goals of training, "
                    "selection and evaluation would meet"
                )
        for name in ("n_steps", "batch_size", "n_epochs", "learning_rate"):
            if getattr(self.ppo, name) <= 0:
                raise ValueError(f"ppo.{name} is {getattr(self.ppo, name)}; it must be positive")
        for name in ("buffer_size", "batch_size", "learning_rate", "train_freq"):
            if getattr(self.sac, name) <= 0:
                raise ValueError(f"sac.{name} is {getattr(self.sac, name)}; it must be positive")
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
