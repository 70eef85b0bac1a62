"""Configuration of the policy study: which physics, which arms, how many episodes and seeds."""

import functools
import re
from collections.abc import Mapping
from typing import Annotated, Any, Self

from redundant_envs.scenes.files import text_value
from redundant_envs.scenes.scene import ACCURACIES, scene_data
from redundant_envs.scenes.tableaus import METHODS
from redundant_envs.support.extras import needs
from redundant_envs.support.values import shown
from redundant_envs_train.config import Config, Model, Real, Text, Whole, load_model, number, value
from redundant_envs_train.config.run import MAX_EPISODES
from redundant_envs_train.rollout import STUDY_SEED
from redundant_envs_train.run_folder import named_scene

with needs("train"):
    from pydantic import PlainValidator, model_validator

STEPPING = ("integrator", "substeps", "tolerance")  # keys of a scene about the stepping of its physics


def _accuracy(value: Any) -> str | float | None:
    if isinstance(value, str):
        value = text_value(value, f"accuracy {shown(value)}")
    if isinstance(value, bool) or not isinstance(value, str | int | float | None):
        raise ValueError(f"accuracy is {shown(value)}; choose {', '.join(ACCURACIES)} or metres")
    return value


Accuracy = Annotated[str | float | None, PlainValidator(_accuracy)]


class Physics(Model):
    """How a scene is stepped: an integrator with equal substeps, or an accuracy."""

    integrator: Text = ""
    substeps: Whole = number(1, 1, 1e6, "of an integrator, in each control interval")
    accuracy: Accuracy = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if bool(self.integrator) == (self.accuracy is not None):
            raise ValueError(
                f"integrator is {self.integrator!r} and accuracy is {self.accuracy!r}; give exactly one: "
                "an integrator (with substeps), or an accuracy"
            )
        if self.integrator and self.integrator not in METHODS:
            raise ValueError(f"integrator is {self.integrator!r}; choose {', '.join(METHODS)}")
        if self.accuracy is not None and self.substeps != 1:
            raise ValueError(
                f"substeps is {self.substeps} beside an accuracy, which chooses the steps itself"
            )
        if isinstance(self.accuracy, str) and self.accuracy not in ACCURACIES:
            valid = f"{', '.join(ACCURACIES)} or a tip error in metres"
            raise ValueError(f"accuracy is {self.accuracy!r}; choose {valid}")
        return self

    def to_dict(self) -> dict[str, Any]:
        """Plain data that makes an equal one."""
        return self.model_dump(include={"integrator", "substeps"} if self.integrator else {"accuracy"})

    def env_kwargs(self, config: Config) -> dict[str, Any]:
        """A configuration's arguments of the environment, with this physics and all else equal."""
        kwargs = {k: v for k, v in config.env_kwargs.items() if k not in ("scene", "accuracy")}
        scene = named_scene(config)
        data = dict(scene if isinstance(scene, Mapping) else scene_data(scene))
        data = {k: v for k, v in data.items() if k not in STEPPING}
        if self.accuracy is not None:
            return {**kwargs, "scene": data, "accuracy": self.accuracy}
        return {**kwargs, "scene": {**data, **self.to_dict()}}


class StudyArm(Model):
    """An arm of the study."""

    preset: Text  # training configuration: a file, or a preset's name
    run: Text = ""  # finished run folder whose policy is taken; without one the preset is trained first
    cheap: Text = ""  # name of the physics that the second part trains under


class Study(Model):
    """The comparison: ``physics`` and ``arms`` by name."""

    physics: Mapping[str, Physics]
    arms: Mapping[str, StudyArm]
    reference: Text = value("exact", "name of the physics that the others are compared with")
    episodes: Whole = number(1000, 2, MAX_EPISODES, "episode i starts from seed + i under every physics")
    seed: Whole = value(STUDY_SEED, "first seed of the episodes, used for nothing else")
    train_seeds: Whole = number(5, 0, 100, "policies per physics in the second part; 0 leaves it out")
    train_overrides: tuple[Text, ...] = value((), "of the presets there, such as total_steps=4000000")
    resamples: Whole = number(10_000, 100, 1e7, "of the bootstrap")
    narrow_hold: Real = number(0.01, 1e-9, 0.999, "margin, a share of the episodes")
    narrow_return: Real = number(0.01, 1e-9, 0.999, "margin, a share of the reference's mean return")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
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
        if self.train_seeds == 1:
            raise ValueError(f"train_seeds is {self.train_seeds}; choose 0 (no training) or 2..100")
        for name, arm in self.arms.items():
            if self.train_seeds and arm.cheap not in self.physics:
                raise ValueError(
                    f"arms.{name}.cheap is {arm.cheap!r}; choose {', '.join(self.physics)}, or set "
                    "train_seeds to 0"
                )
        return self

    def to_dict(self) -> dict[str, Any]:
        """Plain data that makes an equal study."""
        physics = {name: p.to_dict() for name, p in self.physics.items()}
        arms = {name: arm.model_dump(exclude_defaults=True) for name, arm in self.arms.items()}
        return {**self.model_dump(mode="json"), "physics": physics, "arms": arms}


load_study = functools.partial(load_model, Study)


def slug(name: str) -> str:
    """A name as a part of a file name."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
