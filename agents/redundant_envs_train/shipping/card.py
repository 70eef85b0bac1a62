"""The card of a policy: its task, training, results and limits, and how to load it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from redundant_envs.envs.core import Core
from redundant_envs.envs.registration import MAX_EPISODE_STEPS

from ..config import Config, OffPolicySettings
from ..evaluate import PACKAGES
from ..learners.build import ALGORITHM_CLASSES
from ..pages import measures, page, plain
from .layers import Layers

AVERAGED_SAC = "SAC of stable-baselines3 with an averaged, smoothed, delayed actor (`agents/learners/sac.py`)"
ORIGIN = {
    "ppo": "PPO of stable-baselines3 with averaged weights (`agents/learners/ppo.py`)",
    "sac": AVERAGED_SAC, "her": f"{AVERAGED_SAC} and hindsight goals (`HerReplayBuffer`)",
    "plain_ppo": "PPO of stable-baselines3", "plain_sac": "SAC of stable-baselines3",
    "td3": "TD3 of stable-baselines3", "tqc": "TQC of sb3-contrib", "crossq": "CrossQ of sb3-contrib",
}  # fmt: skip
MODULES = {"TQC": "sb3_contrib", "CrossQ": "sb3_contrib"}
"""Packages of classes that are not stable-baselines3's."""


def card(
    config: Config, evaluation: Mapping[str, Any], layers: Layers, worst: Mapping[str, float], checked: int,
    core: Core, scene: str = "",
) -> str:  # fmt: skip
    """Markdown for the folder of a policy.

    Parameters
    ----------
    config : Config
    evaluation : mapping
        Of the run, checked.
    layers : Layers
    worst : mapping
        Largest difference of each file's actions from those of the weights in double precision.
    checked : int
        Number of observations over which this is the largest difference.
    core : Core
        Of the environment.
    scene : str
        Name of the scene, or its file in the folder of the policy; empty for that of the environment.
    """
    learner, steps, settings = (
        ALGORITHM_CLASSES[config.algo].__name__,
        evaluation["env_steps"],
        config.settings,
    )
    updates = None
    if isinstance(settings, OffPolicySettings):
        learned = max(steps - settings.learning_starts, 0) / config.num_envs
        updates = learned * settings.gradient_steps / settings.train_freq
    # An old run may name a package that the present code does not use.
    found = evaluation["versions"].items()
    return page(
        "card", config=config, evaluation=evaluation, layers=layers, worst=worst, checked=checked, core=core,
        scene=scene, learner=learner, module=MODULES.get(learner, "stable_baselines3"), updates=updates,
        origin=ORIGIN[config.algo], most_steps=MAX_EPISODE_STEPS,
        parts=[f"`{name}` ({width} numbers)" for name, width in layers.inputs.items()],
        count=sum(w.size + b.size for w, b in zip(layers.weights, layers.biases, strict=True)),
        versions=[f"{name} {plain(version)}" for name, version in found if name in ("python", *PACKAGES)],
        results=measures(evaluation, "", "this policy", 4),
    )  # fmt: skip
