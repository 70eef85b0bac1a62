"""Small made-up run folders for tests, and their comparison."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch
import yaml

from redundant_envs.scene import scene_at
from redundant_envs_train.config import Config
from redundant_envs_train.policies import read_weights
from redundant_envs_train.run_folder import SELECTION, named_scene, read_config

RPRP, FOUR_R = "redundant_envs/RPRPReach-v0", "redundant_envs/FourRReach-v0"
CURVE = [(1000, 1.0, 0.2, 0.4, 10.0), (2000, 2.0, 0.9, 0.95, 60.0), (3000, 3.5, 0.98, 1.0, 70.0)]


def config_text(seed: int, env: str, algo: str, settings: dict[str, Any]) -> str:
    """A configuration in the form of a run folder."""
    data = {"config_version": 2, "env": env, "algo": algo, "seed": seed, **settings}
    return yaml.safe_dump(Config(**data).to_dict())


def write_run(
    folder: Path, seed: int = 0, env: str = RPRP, algo: str = "ppo", curve: Any = CURVE,
    settings: dict[str, Any] | None = None, without: tuple[str, ...] = (), **facts: Any,
) -> Path:  # fmt: skip
    """A run folder with entries of its evaluation changed by ``facts``, or left out."""
    folder.mkdir(parents=True)
    config = config_text(seed, env, algo, settings or {})
    (folder / "config.yaml").write_text(config)
    write_scene(folder)
    evaluation = {
        "env": env, "algo": algo, "seed": seed, "episodes": 1000, "hold_success": 0.99,
        "interval": [0.98, 0.995], "touch_success": 0.999, "expert_hold_success": 1.0,
        "env_steps": 8_000_000, "train_seconds": 100.0, "mean_return": 78.0, "expert_mean_return": 63.0,
        "median_distance": 1e-3, "expert_median_distance": 2e-6, "time_to_hold": 1.5, "effort": 0.2,
        "smoothness": 0.1, "expert_time_to_hold": 1.2, "expert_effort": 0.4, "expert_smoothness": 0.3,
        "versions": {"torch": "2.13.0", "stable-baselines3": "2.9.2", "machine": "Abacus"},
        "machine": "Abacus", "date": "2026-03-04", **facts,
    }  # fmt: skip
    kept = {name: value for name, value in evaluation.items() if name not in without}
    (folder / "evaluation.json").write_text(json.dumps(kept))
    lines = [SELECTION, *curve]
    (folder / "selection.csv").write_text("".join(",".join(map(str, line)) + "\n" for line in lines))
    return folder


def write_scene(folder: Path) -> None:
    """Write the scene that a configuration names today into its folder."""
    config = read_config(folder)
    scene = scene_at(named_scene(config), config.env_kwargs.get("accuracy"))
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene.to_dict(), sort_keys=False))


def assert_same_policy(one: Path, other: Path) -> None:
    """The policies of two run folders are equal to the bit."""
    expected, found = (read_weights(folder / "policy.zip", "silu")[0] for folder in (one, other))
    assert expected.keys() == found.keys()
    for name, tensor in expected.items():
        assert torch.equal(tensor, found[name]), name
