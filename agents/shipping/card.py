"""The card of a policy: what it does, how it was trained, what it reaches, its limits, how to load it."""

from __future__ import annotations

from typing import Any

from ..config import Config, OffPolicySettings
from ..learners.build import ALGORITHM_CLASSES
from .layers import Layers

ORIGIN = {
    "ppo": "PPO of stable-baselines3 with averaged weights (`agents/learners/ppo.py`)",
    "sac": "SAC of stable-baselines3 with an averaged, smoothed, delayed actor (`agents/learners/sac.py`)",
    "her": "SAC of stable-baselines3 with an averaged, smoothed, delayed actor (`agents/learners/sac.py`) "
    "and hindsight goals (`HerReplayBuffer`)",
    "plain_ppo": "PPO of stable-baselines3", "plain_sac": "SAC of stable-baselines3",
    "td3": "TD3 of stable-baselines3", "tqc": "TQC of sb3-contrib", "crossq": "CrossQ of sb3-contrib",
}  # fmt: skip
LOADERS = {"TQC": "sb3_contrib", "CrossQ": "sb3_contrib"}


def card(
    config: Config, evaluation: dict[str, Any], layers: Layers, worst: dict[str, float], name: str
) -> str:
    """Markdown; ``worst`` has the largest differences of the exported files, ``name`` is the folder's."""
    low, high = (100.0 * end for end in evaluation["interval"])
    versions = ", ".join(f"{package} {found}" for package, found in evaluation["versions"].items())
    kwargs = "".join(f", {key}={value!r}" for key, value in config.env_kwargs.items())
    loader = ALGORITHM_CLASSES[config.algo].__name__
    module = LOADERS.get(loader, "stable_baselines3")
    widths = [len(biases) for biases in layers.biases]
    steps, seconds = evaluation["env_steps"], evaluation["train_seconds"]
    count = sum(w.size + b.size for w, b in zip(layers.weights, layers.biases, strict=True))
    scene = config.env_kwargs.get("scene")
    on = f"{config.env}, scene {scene}" if scene else config.env
    observation = (
        "a dictionary of " + ", ".join(f"`{part}` ({size})" for part, size in layers.inputs.items())
        if len(layers.inputs) > 1
        else f"an array of {next(iter(layers.inputs.values()))} numbers"
    )
    time_to_hold = evaluation.get("time_to_hold")
    took = f"{time_to_hold:.2f} s" if time_to_hold is not None else "unknown"
    gradient = ""
    if isinstance(config.settings, OffPolicySettings):
        each = config.settings.gradient_steps / config.settings.train_freq
        updates = (steps - config.settings.learning_starts) / config.num_envs * each
        gradient = f", about {updates:,.0f} gradient steps"
    lines = [
        f"# {config.label} for {on}", "",
        "## Task", "",
        "The tip of a planar arm goes from a random pose to a random goal and holds it, by the efforts of "
        "four motors, every 20 ms. Hold success: within 2 % of the reach and slower than 0.1 reach/s for the "
        f"last 10 of 100 control steps. Observations are {observation}, actions four normalized efforts from "
        f"-1 to 1; `help(gymnasium.make({config.env!r}).unwrapped)` has the tables.", "",
        "## How it was trained", "",
        f"{ORIGIN[config.algo]}; {steps / 1e6:.2f} million environment steps in {config.num_envs} "
        f"environments{gradient}, {seconds:.0f} s on one core of {evaluation['machine']}, seed "
        f"{config.seed}, which was not chosen by its result. The policy is the last one of the training. "
        f"`config.yaml` repeats it: `python -m agents train policies/{name}/config.yaml`. {versions}.", "",
        "## Results", "",
        f"On {evaluation['episodes']} frozen goals that training never saw ({evaluation['date']}):", "",
        "| | this policy | computed torque |", "|---|---|---|",
        f"| hold success | {100 * evaluation['hold_success']:.1f} % (95 % interval {low:.1f} to "
        f"{high:.1f} %) | {100 * evaluation['expert_hold_success']:.1f} % |",
        f"| touch success | {100 * evaluation['touch_success']:.1f} % "
        f"| {100 * evaluation['expert_touch_success']:.1f} % |",
        f"| median final distance | {1000 * evaluation['median_distance']:.2f} mm "
        f"| {1000 * evaluation['expert_median_distance']:.2f} mm |",
        f"| median time to hold | {took} | {_seconds(evaluation.get('expert_time_to_hold'))} |", "",
        "The interval is of the goals; other seeds of the training give other policies, and "
        "`docs/learners.md` has all of them.", "",
        "## Limits", "",
        "It was trained for one arm, one scene, one control interval and goals that are drawn once per "
        "episode; with other masses, motors, friction or observations it may fail, and nothing tells so. It "
        "knows nothing of obstacles or moving goals. It acts deterministically.", "",
        "## Load it", "",
        "```python", f"from {module} import {loader}", "",
        f'model = {loader}.load("policies/{name}/policy.zip", device="cpu")',
        "action, _ = model.predict(observation, deterministic=True)", "```", "",
        f"`policy.onnx` has the {'inputs' if len(layers.inputs) > 1 else 'input'} "
        f"{', '.join(f'`{part}`' for part in layers.inputs)} (batch first, single precision) and the output "
        "`actions`; `policy.npz` has the same layers as arrays, and `python examples/play_with_numpy.py "
        f"policies/{name}` acts with them. {len(widths)} layers of {', '.join(map(str, widths))} units, "
        f"{count} numbers, {layers.activation} between them, {layers.output} at the end.", "",
        f"Both compute in double precision. Over 6400 observations their actions differ from those of the "
        f"weights in double precision by at most {worst['policy.onnx']:.1g} (ONNX) and "
        f"{worst['policy.npz']:.1g} (NumPy); stable-baselines3, which computes in single precision, by "
        f"{worst['stable-baselines3']:.1g}.", "",
        "```python", "import gymnasium as gym", "import redundant_envs", "",
        f"env = gym.make({config.env!r}{kwargs})", "```", "",
    ]  # fmt: skip
    return "\n".join(lines)


def _seconds(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.2f} s"
