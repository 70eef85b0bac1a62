"""The card of a policy: its task, training, results and limits, and how to load it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from redundant_envs.envs.core import Core
from redundant_envs.envs.registration import MAX_EPISODE_STEPS
from redundant_envs.tables import markdown

from ..config import Config, OffPolicySettings
from ..evaluate import PACKAGES
from ..learners.build import ALGORITHM_CLASSES
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
    learner = ALGORITHM_CLASSES[config.algo].__name__
    made = ", ".join([f'"{config.env}"', *([f'scene="{scene}"'] if scene else [])])
    parts = [f"`{name}` ({width} numbers)" for name, width in layers.inputs.items()]
    count = sum(w.size + b.size for w, b in zip(layers.weights, layers.biases, strict=True))
    lines = [
        f"# {config.label} for {config.env}{f', scene {scene}' if scene else ''}", "",
        "## Task", "", _task(config, core, parts), "",
        "## How it was trained", "", _training(config, evaluation), "",
        "## Results", "", *_results(evaluation), "",
        "The interval is of the goals. Other seeds of the training give other policies; `docs/learners.md` "
        "and `docs/strength.md` have all of them.", "",
        "## Limits", "",
        "It was trained for one arm, one scene, one control interval and goals that are drawn once per "
        "episode; with other masses, motors, friction or observations it may fail without a warning. It "
        "cannot avoid obstacles or follow moving goals. It acts deterministically.", "",
        "## Load it", "", "In this folder, with stable-baselines3, which unpickles what the file holds:", "",
        "```python", "import gymnasium as gym", "import redundant_envs  # registers the ids",
        f"from {MODULES.get(learner, 'stable_baselines3')} import {learner}", "",
        f"env = gym.make({made})",
        f'model = {learner}.load("policy.zip", device="cpu")',
        "observation, info = env.reset()",
        "action, _ = model.predict(observation, deterministic=True)", "```", "",
        f"`policy.onnx` takes {' and '.join(parts)}, batch first, in single precision, and gives `actions`; "
        "`policy.npz` has the same layers as arrays, with which `docs/examples/play_with_numpy.py` acts. It "
        f"has {len(layers.biases)} layers of {', '.join(str(len(b)) for b in layers.biases)} units, "
        f"{count} numbers, {layers.activation} between them and {layers.output} at the end.", "",
        f"Both compute in double precision. Over {checked} observations their actions differ from those of "
        f"the weights in double precision by at most {worst['policy.onnx']:.1g} (ONNX) and "
        f"{worst['policy.npz']:.1g} (NumPy), those of stable-baselines3, which computes in single precision, "
        f"by {worst['policy.zip']:.1g}.", "",
    ]  # fmt: skip
    return "\n".join(lines)


def _task(config: Config, core: Core, parts: list[str]) -> str:
    task = core.task
    seen = f"dictionaries of {', '.join(parts)}" if len(parts) > 1 else f"arrays, {parts[0]}"
    return (
        "The tip of a planar arm goes from a random pose to a random goal and holds it, by the efforts of "
        f"four motors, every {1000.0 * core.scene.control_dt:g} ms. Hold success: within "
        f"{100 * task.goal_tolerance:g} % of the reach and slower than {task.hold_speed:g} reach/s for the "
        f"last {task.hold_steps} of {MAX_EPISODE_STEPS} control steps. Observations are {seen}, actions four "
        f"normalized efforts from -1 to 1; `help(gymnasium.make({config.env!r}).unwrapped)` has the tables."
    )


def _training(config: Config, evaluation: Mapping[str, Any]) -> str:
    steps, settings = evaluation["env_steps"], config.settings
    updates = ""
    if isinstance(settings, OffPolicySettings):
        learned = max(steps - settings.learning_starts, 0) / config.num_envs
        count = learned * settings.gradient_steps / settings.train_freq
        updates = f", about {count:,.0f} gradient steps"
    again = "trains it again" if config.max_seconds is None else "trains another one for as many seconds"
    # An old run may name a package that the present code does not use.
    found = evaluation["versions"].items()
    versions = [f"{name} {_plain(version)}" for name, version in found if name in ("python", *PACKAGES)]
    return (
        f"{ORIGIN[config.algo]}; {steps / 1e6:.2f} million environment steps in {config.num_envs} "
        f"environments{updates}, {evaluation['train_seconds']:.0f} s with PyTorch threads: "
        f"{config.torch_threads}, on {_plain(evaluation['machine'])}; seed {config.seed}. The policy is the "
        f"last one of the training. `python -m agents train config.yaml` {again}. {', '.join(versions)}."
    )


def _results(evaluation: Mapping[str, Any]) -> list[str]:
    low, high = evaluation["interval"]
    rows = [
        ("hold success", "hold_success", 100.0, 1, " %"), ("touch success", "touch_success", 100.0, 1, " %"),
        ("median final distance", "median_distance", 1000.0, 2, " mm"),
        ("median time to hold", "time_to_hold", 1.0, 2, " s"),
    ]  # fmt: skip
    lines = [
        f"On {evaluation['episodes']} frozen goals that training never saw ({_plain(evaluation['date'])}); "
        f"the 95 % interval of hold success is {100 * low:.1f} to {100 * high:.1f} %:", "",
    ]  # fmt: skip
    cells = []
    for label, key, scale, digits, unit in rows:
        found = [evaluation.get(f"{who}{key}") for who in ("", "expert_")]
        cells.append((label, *("-" if v is None else f"{scale * v:.{digits}f}{unit}" for v in found)))
    return [*lines, markdown(("", "this policy", "computed torque"), cells)]


def _plain(text: str) -> str:
    """A text of a run folder without characters that have a meaning in Markdown or HTML."""
    return re.sub(r"[^\w .,;:()@+/-]", "?", text)[:200]
