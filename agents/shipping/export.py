"""A run folder's policy as files for others: policy.zip, policy.onnx, policy.npz and a card."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import yaml

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.values import shown

from ..config import Config
from ..policies import load_policy
from ..run_folder import read_config, read_evaluation, read_facts
from .card import card
from .layers import exact_actions, layers_of, sampled

TOLERANCE = 1e-6
"""Largest difference of an action from that of the policy's own weights, computed in double precision."""
LANES = 64
SEED = 4_000_000
"""Episodes of the check; no other part uses these."""


def name_of(config: Config) -> str:
    """Folder of a policy: the id without its namespace, the scene if it is another one, the algorithm."""
    scene = config.env_kwargs.get("scene")
    if scene is not None and not isinstance(scene, str):
        raise ValueError("env_kwargs.scene is a mapping; only policies of scenes with a name are exported")
    parts = [config.env.split("/")[-1], Path(scene).stem if scene else "", config.algo]
    return "-".join(part for part in parts if part)


def export(run: Path, out: Path) -> Path:
    """Write the policy of an evaluated run folder to a folder of its own inside ``out``.

    Returns
    -------
    Path
        The folder: ``policy.zip`` for stable-baselines3, ``policy.onnx``, ``policy.npz`` for NumPy,
        ``config.yaml`` and the card, ``README.md``.

    Raises
    ------
    ValueError
        The run is not finished or not evaluated; its scene has no name; or an exported file acts otherwise
        than the policy, by more than ``TOLERANCE``.
    """
    from . import onnx_file

    config = read_config(run)
    evaluation = read_evaluation(run)
    if read_facts(run)["stopped"]:
        raise ValueError(f"{run} is a training that was stopped; give a finished one")
    policy = load_policy(run, config)
    env = make_sb3(config.env, LANES, **config.env_kwargs)
    layers = layers_of(policy, env.observation_space)
    folder = out / name_of(config)
    folder.mkdir(parents=True, exist_ok=True)
    layers.save(folder / "policy.npz")
    about = {name: str(evaluation[name]) for name in ("env", "algo", "seed", "hold_success", "date")}
    onnx_file.write(layers, folder / "policy.onnx", about)
    by_onnx = onnx_file.actions_of(folder / "policy.onnx", layers.inputs)
    env.seed(SEED)
    worst = {"policy.onnx": 0.0, "policy.npz": 0.0, "stable-baselines3": 0.0}
    for observations, acted in sampled(env, lambda o: policy.predict(o, deterministic=True)[0]):
        exact = exact_actions(policy, layers.inputs, observations)
        found = {
            "policy.onnx": by_onnx(observations), "policy.npz": layers(observations),
            "stable-baselines3": acted,
        }  # fmt: skip
        for name, actions in found.items():
            worst[name] = max(worst[name], float(np.abs(actions - exact).max()))
    for name in ("policy.onnx", "policy.npz"):
        if not worst[name] <= TOLERANCE:
            raise ValueError(
                f"{folder / name} acts otherwise than {run}/policy.zip, by {shown(worst[name])}; at most "
                f"{TOLERANCE:g} is allowed"
            )
    shutil.copyfile(run / "policy.zip", folder / "policy.zip")
    (folder / "config.yaml").write_text(yaml.safe_dump(config.to_dict(), sort_keys=False), encoding="utf-8")
    page = card(config, evaluation, layers, worst, folder.name)
    (folder / "README.md").write_text(page, encoding="utf-8")
    return folder


def export_all(runs: list[Path], out: Path) -> list[Path]:
    """Export several runs; ValueError if two of them are policies of one id and algorithm."""
    names: dict[str, Path] = {}
    for run in runs:
        other = names.setdefault(name_of(read_config(run)), run)
        if other != run:
            raise ValueError(f"{other} and {run} are policies of one id and algorithm; give one of them")
    return [export(run, out) for run in runs]
