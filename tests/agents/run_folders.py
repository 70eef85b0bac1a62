"""Small runs and made-up run folders for tests, and their comparison."""

from __future__ import annotations

import contextlib
import csv
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml

from redundant_envs.scene import load_scene, scene_at
from redundant_envs_train.config import Config, checked
from redundant_envs_train.policies import read_weights
from redundant_envs_train.run_folder import SELECTION, named_scene, read_config
from redundant_envs_train.training import checkpoint
from redundant_envs_train.training.watch import Watch

ROOT = Path(__file__).resolve().parents[2]
POLICIES = ROOT / "policies"
REFUSALS = yaml.safe_load((Path(__file__).parent / "refusals.yaml").read_text(encoding="utf-8"))
"""What is refused, and the words of the message."""
RPRP, FOUR_R = "redundant_envs/RPRPReach-v0", "redundant_envs/FourRReach-v0"
CURVE = [(1000, 1.0, 0.2, 0.4, 10.0), (2000, 2.0, 0.9, 0.95, 60.0), (3000, 3.5, 0.98, 1.0, 70.0)]
TINY = [
    "num_envs=32", "ppo.n_steps=16", "ppo.batch_size=256", "total_steps=1024", "curve_every=512",
    "curve_episodes=5", "evaluation_episodes=5", "telemetry=[]",
]  # fmt: skip
"""Settings of a training of PPO that takes less than a second."""
SMALL = [*TINY, "env_kwargs.max_episode_steps=20"]
REPLAY = {"learning_starts": 400, "buffer_size": 1200, "gradient_steps": 1, "batch_size": 32}
"""A replay buffer that is smaller than a run, so that its oldest rows are overwritten."""
CASES: dict[str, dict[str, Any]] = {
    "ppo": {"total_steps": 2048, "ppo": {"n_steps": 16, "batch_size": 256}},
    "plain_ppo": {"plain_ppo": {"n_steps": 16, "batch_size": 64}},
    "auto": {"algo": "sac", "sac": {**REPLAY, "ent_coef": "auto", "schedule": "linear"}},
    "her": {
        "env": "redundant_envs/RPRPGoalReach-v0", "total_steps": 4800,
        "her": {**REPLAY, "learning_starts": 1600, "buffer_size": 3200},
    },
    **{algo: {algo: REPLAY} for algo in ("sac", "plain_sac", "td3", "tqc", "crossq")},
}  # fmt: skip
"""Settings of short trainings, by algorithm or by what is special."""


def small_config(case: str, **more: Any) -> Config:
    """The configuration of a short training."""
    return checked(Config, {
        "config_version": 2, "env": RPRP, "algo": case, "seed": 4, "num_envs": 16, "total_steps": 2400,
        "curve_every": 1000, "curve_episodes": 5, "evaluation_episodes": 5, "telemetry": [],
        "checkpoint_seconds": 0, "env_kwargs": {"max_episode_steps": 40}, **CASES[case], **more,
    })  # fmt: skip


@contextlib.contextmanager
def says(*words: str) -> Iterator[None]:
    """What raises a ValueError with these words in its short message."""
    with pytest.raises(ValueError, match=r".") as error:
        yield
    for word in words:
        assert word in str(error.value)
    assert len(str(error.value)) < 1000


def kill_at(steps: int, monkeypatch: Any) -> None:
    """Let trainings end without a trace at so many steps: a kill, a few checkpoints after the first."""
    plain, save = Watch._on_step, checkpoint.save

    def on_step(self: Any) -> bool:
        if self.num_timesteps >= steps:
            raise SystemExit
        return plain(self)

    def save_late(folder: Path, model: Any, *more: Any) -> None:
        if model.num_timesteps > 0.9 * steps - 200:
            save(folder, model, *more)

    monkeypatch.setattr(Watch, "_on_step", on_step)
    monkeypatch.setattr(checkpoint, "save", save_late)


def write_scene_file(folder: Path, friction: float) -> None:
    """mine.yaml: the reach scene with another viscous friction."""
    data = load_scene("rprp_reach").to_dict()
    (effect,) = (e for e in data["effects"] if e["type"] == "ViscousFriction")
    effect["coefficients"] = [friction] * 4
    (folder / "mine.yaml").write_text(yaml.safe_dump(data))


def change(path: Path, **entries: Any) -> Path:
    """Change entries of a JSON or YAML file; returns its folder."""
    read, write = (json.loads, json.dumps) if path.suffix == ".json" else (yaml.safe_load, yaml.safe_dump)
    path.write_text(write(read(path.read_text()) | entries))
    return path.parent


def members(path: Path) -> dict[str, bytes]:
    """Contents of a zip file."""
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def write_members(path: Any, contents: dict[str, bytes | None], kind: int = zipfile.ZIP_DEFLATED) -> None:
    """Write a zip file; contents that are None are left out."""
    with zipfile.ZipFile(path, "w", kind) as archive:
        for name, data in contents.items():
            if data is not None:
                archive.writestr(name, data)


class Evil:
    """Makes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return Path.touch, (self.path,)


def csv_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file, without its comments."""
    with path.open(newline="") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def write_run(
    folder: Path, seed: int = 0, env: str = RPRP, algo: str = "ppo", curve: Any = CURVE,
    settings: dict[str, Any] | None = None, without: tuple[str, ...] = (), **facts: Any,
) -> Path:  # fmt: skip
    """A run folder with entries of its evaluation changed by ``facts``, or left out."""
    folder.mkdir(parents=True)
    config = Config(**{"config_version": 2, "env": env, "algo": algo, "seed": seed, **(settings or {})})
    (folder / "config.yaml").write_text(yaml.safe_dump(config.to_dict()))
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


def kept(folder: Path) -> dict[Path, tuple[bytes, int]]:
    """Contents and times of all files in a folder, and the folder's own time."""
    return {
        path: (path.read_bytes() if path.is_file() else b"", path.stat().st_mtime_ns)
        for path in sorted((folder, *folder.rglob("*")))
    }


def assert_same_policy(one: Path, other: Path) -> None:
    """The policies of two run folders are equal to the bit."""
    expected, found = (read_weights(folder / "policy.zip", "silu")[0] for folder in (one, other))
    assert expected.keys() == found.keys()
    for name, tensor in expected.items():
        assert torch.equal(tensor, found[name]), name
