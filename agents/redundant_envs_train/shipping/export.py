"""A run folder's policy as files for others: policy.zip, policy.onnx, policy.npz and a card."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.scene import scene_names
from redundant_envs.values import shown

from ..config import Config, PlainPPOSettings
from ..evidence.runs import read_run
from ..learners.build import ALGORITHM_CLASSES, policy_kwargs, policy_name
from ..new_folder import check_out
from ..own_scene import SCENE, difference, own_config
from ..policies import load_policy
from ..run_folder import FACTS, read_config
from . import onnx_file
from .card import card
from .layers import Layers, exact_actions, layers_of, sampled

TOLERANCE = 1e-6
"""Largest difference of an action from that of the policy's own weights, computed in double precision."""
SINGLE = 1e-4
"""The same for policy.zip: some ten times the error of single precision."""
LANES, STEPS = 64, 100
SEED = 4_000_000
"""Episodes of the check; no other part uses these."""


def name_of(config: Config) -> str:
    """Folder of a policy: the id without its namespace, the scene if it is another one, the algorithm.

    Raises
    ------
    ValueError
        The environment has arguments that would have to be published with the policy.
    """
    for key, value in config.env_kwargs.items():
        if key != "scene" or value not in scene_names():
            raise ValueError(
                f"env_kwargs.{key} is {shown(value)}; policies of environments as they are registered, or "
                f"with a scene of the package ({', '.join(scene_names())}), are exported"
            )
    return "-".join([config.env.split("/")[-1], *config.env_kwargs.values(), config.algo])


def export(run: Path, out: Path) -> Path:
    """Write the policy of an evaluated run folder to its own folder inside ``out``.

    No pickled objects of a stranger are copied: policy.zip is written again from checked weights.

    Returns
    -------
    Path
        The folder: ``policy.zip`` for stable-baselines3, ``policy.onnx``, ``policy.npz`` for NumPy,
        ``config.yaml``, ``scene.yaml`` and the card, ``README.md``.

    Raises
    ------
    ValueError
        The run is not finished or not evaluated; its environment has arguments other than a scene of the
        package; the folder exists; or a file acts otherwise than the policy, by more than ``TOLERANCE``
        (policy.zip: ``SINGLE``).
    """
    config, evaluation = read_config(run), read_run(run).evaluation
    for name in FACTS:
        if evaluation.get(name) is None:
            raise ValueError(
                f"{run}/evaluation.json has no {name}; export a run that was trained with this version"
            )
    check_out(out)
    own = own_config(run)
    folder = out / name_of(config)
    if folder.exists():
        raise ValueError(f"{folder} exists; delete it or choose another --out")
    policy = load_policy(run, own)
    env = make_sb3(own.env, LANES, **own.env_kwargs)
    part = out / f".{folder.name}.part"
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    try:
        layers = layers_of(policy, env.observation_space)
        worst = _write(config, evaluation, policy, layers, env, part)
        scene = SCENE if difference(run) else config.env_kwargs.get("scene", "")
        page = card(config, evaluation, layers, worst, LANES * STEPS, env.core, scene)
        (part / "README.md").write_text(page, encoding="utf-8")
        part.rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return folder


def _write(
    config: Config, evaluation: Any, policy: Any, layers: Layers, env: Any, folder: Path
) -> dict[str, float]:
    """Write all but the card; returns the largest difference of each file from the policy, checked."""
    learner = ALGORITHM_CLASSES[config.algo]
    small = {"n_steps": 2, "batch_size": 2} if isinstance(config.settings, PlainPPOSettings) else {}
    model = learner(
        policy_name(config), env, gamma=config.settings.gamma, learning_rate=config.settings.learning_rate,
        policy_kwargs=policy_kwargs(config), device="cpu", **(small or {"buffer_size": LANES}),
    )  # fmt: skip
    model.policy.load_state_dict(policy.state_dict())
    model.save(folder / "policy.zip")
    for name, data in (("config.yaml", config.to_dict()), (SCENE, env.core.scene.to_dict())):
        (folder / name).write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    layers.save(folder / "policy.npz")
    about = {name: str(evaluation[name]) for name in ("env", "algo", "seed", "hold_success", "date")}
    onnx_file.write(policy, layers.inputs, folder / "policy.onnx", about)
    saved = learner.load(folder / "policy.zip", device="cpu")
    acting = {
        "policy.onnx": onnx_file.actions_of(folder / "policy.onnx", layers.inputs),
        "policy.npz": Layers.load(folder / "policy.npz"),
        "policy.zip": lambda observations: saved.predict(observations, deterministic=True)[0],
    }
    worst = dict.fromkeys(acting, 0.0)
    env.seed(SEED)
    for observations in sampled(env, policy, STEPS):
        exact = exact_actions(policy, layers.inputs, observations)
        for name, act in acting.items():
            difference = np.abs(act(observations) - exact).max()
            worst[name] = float(np.maximum(worst[name], difference))  # NaN stays
    for name, difference in worst.items():
        most = SINGLE if name == "policy.zip" else TOLERANCE
        if not difference <= most:
            raise ValueError(
                f"{name} acts otherwise than the policy of the run, by {difference:.3g}; at most {most:g} is "
                "allowed: are its weights finite?"
            )
    return worst


def export_all(runs: Sequence[Path], out: Path) -> list[Path]:
    """Export several runs; ValueError if two of them are policies of one id and algorithm."""
    names: dict[str, Path] = {}
    runs = list({run.resolve(): run for run in runs}.values())  # a folder that is given twice counts once
    for run in runs:
        other = names.setdefault(name_of(read_config(run)), run)
        if other != run:
            raise ValueError(f"{other} and {run} are policies of one id and algorithm; give one of them")
    return [export(run, out) for run in runs]
