"""A run folder's policy as files for others: policy.zip, policy.onnx, policy.npz and a card."""

import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from redundant_envs.envs.core import Core
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.scenes.scene import scene_names
from redundant_envs.support.disk import disk_errors, write_bytes
from redundant_envs.support.extras import needs
from redundant_envs.support.tables import Markdown, code
from redundant_envs.support.values import shown

from ..config import Config, OffPolicySettings, PlainPPOSettings
from ..evidence.runs import read_run
from ..learners.build import ALGORITHM_CLASSES, policy_kwargs, policy_name
from ..pages import MEASURES, page, results_table
from ..policies import load_policy, saved
from ..report import PACKAGES
from ..run_folder import SCENE, check_out, difference, new_folder, own_config, read_config
from .layers import Exact, Layers, exact_actions, layers_of

with needs("onnx"):
    import onnx
    import onnxruntime
    import torch

HERE = "agents/redundant_envs_train/learners"
AVERAGED_SAC = f"SAC of stable-baselines3 with an averaged, smoothed, delayed actor (`{HERE}/sac.py`)"
ORIGIN = {
    "ppo": f"PPO of stable-baselines3 with averaged weights (`{HERE}/ppo.py`)",
    "sac": AVERAGED_SAC, "her": f"{AVERAGED_SAC} and hindsight goals (`HerReplayBuffer`)",
    "plain_ppo": "PPO of stable-baselines3", "plain_sac": "SAC of stable-baselines3",
    "td3": "TD3 of stable-baselines3", "tqc": "TQC of sb3-contrib", "crossq": "CrossQ of sb3-contrib",
}  # fmt: skip
CARD_RESULTS = 4  # results of a policy in its card; of a task without success all that are known
WORDS = {4: "four"}
MODULES = {"TQC": "sb3_contrib", "CrossQ": "sb3_contrib"}  # packages of classes beside stable-baselines3's
OPSET = 17  # old enough for every runtime since 2022
TOLERANCE = 1e-6
"""Largest difference of an action from that of the policy's own weights, computed in double precision."""
SINGLE = 1e-4  # the same for policy.zip: some ten times the error of single precision
LANES, STEPS = 64, 100
SEED = 4_000_000  # episodes of the check; no other part uses these


def name_of(config: Config) -> str:
    """Folder of a policy: id without namespace, scene if it is another one, algorithm. ValueError if the
    environment has arguments that would have to be published with the policy; ``terminate_on_touch`` is none
    of them, as it changes no success."""
    of_scene = {key: value for key, value in config.env_kwargs.items() if key != "terminate_on_touch"}
    for key, value in of_scene.items():
        if key != "scene" or value not in scene_names():
            names = ", ".join(scene_names())
            fit = f"policies of environments as they are registered, or with a scene of the package ({names})"
            raise ValueError(f"env_kwargs.{key} is {shown(value)}; {fit}, are exported")
    return "-".join([config.env.split("/")[-1], *of_scene.values(), config.algo])


def export(run: Path, out: Path) -> Path:
    """Write the policy of an evaluated run to a folder inside ``out``; ValueError if a file acts otherwise.
    No pickled objects of a stranger are copied: policy.zip is written again from checked weights."""
    config, evaluation = read_config(run), read_run(run).evaluation
    for name in ("env_steps", "train_seconds"):
        if evaluation[name] is None:
            raise ValueError(f"{run}/evaluation.json has no {name}; give a run with its training.json")
    check_out(out)
    run_config = own_config(run)
    folder = out / name_of(config)
    if os.path.lexists(folder):
        raise ValueError(f"{folder} exists; delete it or choose another --out")
    policy = load_policy(run, run_config)
    env = make_sb3(run_config.env, LANES, **run_config.env_kwargs)
    with disk_errors(folder), new_folder(folder) as part:
        layers = layers_of(policy, env.observation_space)
        worst = _write(config, evaluation, policy, layers, env, part)
        scene = SCENE if difference(run) else config.env_kwargs.get("scene", "")
        text = card(config, evaluation, layers, worst, env.core, scene)
        (part / "README.md").write_text(text, encoding="utf-8")
    return folder


def _write(config: Config, result: Any, policy: Any, layers: Layers, env: Any, out: Path) -> dict[str, float]:
    """Write all but the card; returns the largest difference of each file from the policy, checked."""
    learner = ALGORITHM_CLASSES[config.algo]
    small = {"n_steps": 2, "batch_size": 2} if isinstance(config.settings, PlainPPOSettings) else {}
    model = learner(
        policy_name(config), env, gamma=config.settings.gamma, learning_rate=config.settings.learning_rate,
        policy_kwargs=policy_kwargs(config), device="cpu", **(small or {"buffer_size": LANES}),
    )  # fmt: skip
    model.policy.load_state_dict(policy.state_dict())
    write_bytes(out / "policy.zip", saved(model))
    for name, data in (("config.yaml", config.to_dict()), (SCENE, env.core.scene.to_dict())):
        (out / name).write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    layers.save(out / "policy.npz")
    about = {name: str(result[name]) for name in ("env", "algo", "seed", "hold_success", "date")}
    write_onnx(policy, layers.inputs, out / "policy.onnx", about)
    loaded = learner.load(out / "policy.zip", device="cpu")
    acting = {
        "policy.onnx": onnx_actions(out / "policy.onnx", layers.inputs),
        "policy.npz": Layers.load(out / "policy.npz"),
        "policy.zip": lambda observations: loaded.predict(observations, deterministic=True)[0],
    }
    worst = dict.fromkeys(acting, 0.0)
    env.seed(SEED)
    observations = env.reset()
    for _ in range(STEPS):
        exact = exact_actions(policy, layers.inputs, observations)
        for name, act in acting.items():
            difference = np.abs(act(observations) - exact).max()
            worst[name] = float(np.maximum(worst[name], difference))  # NaN stays
        observations = env.step(policy.predict(observations, deterministic=True)[0])[0]
    for name, difference in worst.items():
        most = SINGLE if name == "policy.zip" else TOLERANCE
        if not difference <= most:
            other = f"{name} acts otherwise than the policy of the run, by {difference:.3g}"
            raise ValueError(f"{other}; at most {most:g} is allowed: are its weights finite?")
    return worst


def card(
    config: Config, evaluation: Mapping[str, Any], layers: Layers, worst: Mapping[str, float], core: Core,
    scene: str,
) -> str:  # fmt: skip
    """The card of a policy, Markdown with the front matter of models on Hugging Face. ``worst`` is the
    largest difference of each file's actions from those of the weights in double precision; ``scene`` is the
    name of the scene, or its file in the folder of the policy, empty for that of the environment."""
    parts = [f"{code(name)} ({width} numbers)" for name, width in layers.inputs.items()]
    learner, settings, updates = ALGORITHM_CLASSES[config.algo].__name__, config.settings, None
    if isinstance(settings, OffPolicySettings):
        learned = max(evaluation["env_steps"] - settings.learning_starts, 0) / config.num_envs
        updates = learned * settings.gradient_steps / settings.train_freq
    # An old run may name a package that the present code does not use.
    entries = evaluation["versions"].items()
    count = len(MEASURES) if evaluation["hold_success"] is None else CARD_RESULTS
    return front_matter(config, evaluation, scene, MODULES.get(learner, "stable-baselines3"), count) + page(
        "card", config=config, evaluation=evaluation, layers=layers, worst=worst, checked=LANES * STEPS,
        core=core, scene=scene, learner=learner, module=MODULES.get(learner, "stable_baselines3"),
        reaches=core.task.name in ("Reach", "GoalReach"),
        motors=WORDS.get(len(core.actions), len(core.actions)),
        updates=updates, origin=Markdown(ORIGIN[config.algo]), most_steps=core.task.steps,
        several=len(layers.inputs) > 1,
        parts=Markdown(", ".join(parts)), inputs=Markdown(" and ".join(parts)),
        count=sum(w.size + b.size for w, b in zip(layers.weights, layers.biases, strict=True)),
        versions=", ".join(f"{name} {version}" for name, version in entries if name in ("python", *PACKAGES)),
        results=results_table(evaluation, "", "this policy", count),
    )  # fmt: skip


def front_matter(config: Config, evaluation: Mapping[str, Any], scene: str, library: str, count: int) -> str:
    """Front matter of a card (https://huggingface.co/docs/hub/model-cards), with ``count`` results."""
    metrics = []
    for label, key, scale, digits, unit in MEASURES[:count]:
        if evaluation.get(key) is not None:
            name = f"{label} [{unit.strip()}]" if unit else label
            value = round(scale * float(evaluation[key]), digits)
            metrics.append({"type": label.replace(" ", "_"), "name": name, "value": value})
    kind = "reinforcement-learning"
    dataset = {"name": f"{config.env}, scene {scene}" if scene else config.env, "type": config.env}
    results = [{"task": {"type": kind, "name": kind}, "dataset": dataset, "metrics": metrics}]
    data = {
        "library_name": library.replace("_", "-"), "license": "mit", "pipeline_tag": kind,
        "tags": ["deep-reinforcement-learning", kind, library.replace("_", "-"), config.env],
        "model-index": [{"name": config.label, "results": results}],
    }  # fmt: skip
    return f"---\n{yaml.safe_dump(data, sort_keys=False)}---\n\n"


def write_onnx(policy: Any, inputs: dict[str, int], path: Path, about: dict[str, str]) -> None:
    """Write a checked ONNX model with an input for each part of an observation, ``actions`` and metadata."""
    with warnings.catch_warnings():
        # torch prefers its other exporter, which needs onnxscript and writes newer files
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            Exact(policy, torch.float32), tuple(torch.zeros(1, width) for width in inputs.values()),
            str(path), input_names=list(inputs), output_names=["actions"], opset_version=OPSET,
            dynamic_axes={name: {0: "batch"} for name in (*inputs, "actions")}, dynamo=False,
        )  # fmt: skip
    model = onnx.load(path)
    onnx.helper.set_model_props(model, about)
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, path)


def onnx_actions(path: Path, inputs: dict[str, int]) -> Any:
    """A function from observations (n, ...) to the actions (n, actions) that ONNX Runtime computes."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])

    def act(observations: Any) -> NDArray[np.float32]:
        parts = observations if isinstance(observations, dict) else {next(iter(inputs)): observations}
        return session.run(["actions"], {name: np.asarray(parts[name], np.float32) for name in inputs})[0]

    return act
