"""Made-up run folders, changes of their files, and their comparison."""

import contextlib
import csv
import importlib.util
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from redundant_envs.scenes.scene import load_scene, scene_at
from redundant_envs_train.__main__ import main as application
from redundant_envs_train.config import Config
from redundant_envs_train.run_folder import SELECTION, named_scene, read_config
from studies.__main__ import main as studies

ROOT = Path(__file__).resolve().parents[2]
TUNES = importlib.util.find_spec("optuna") is not None
"""Whether the extra "tune" is installed, without which its command says so and no more."""
POLICIES = ROOT / "policies"
REFUSALS = yaml.safe_load((Path(__file__).parent / "refusals.yaml").read_text(encoding="utf-8"))
"""What is refused, and the words of the message."""
RPRP, FOUR_R = "redundant_envs/RPRPReach-v0", "redundant_envs/FourRReach-v0"
CURVE = [(1000, 1.0, 0.2, 0.4, 10.0), (2000, 2.0, 0.9, 0.95, 60.0), (3000, 3.5, 0.98, 1.0, 70.0)]


def main(words: list[str]) -> int:
    """Run a command of the application, or one that begins with "study", to its exit status."""
    return studies(words[1:]) if words[0] == "study" else application(words)


@contextlib.contextmanager
def says(*words: str) -> Iterator[None]:
    """What raises a ValueError with these words in its short message."""
    with pytest.raises(ValueError, match=r".") as error:
        yield
    for word in words:
        assert word in str(error.value)
    assert len(str(error.value)) < 1000


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


def csv_rows(path: Path, *without: str) -> list[dict[str, str]]:
    """Rows of a CSV file, without its comments and without some columns."""
    with path.open(newline="") as file:
        rows = [*csv.DictReader(line for line in file if not line.startswith("#"))]
    return [{name: cell for name, cell in row.items() if name not in without} for row in rows]


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
    paths = sorted((folder, *folder.rglob("*")))
    return {p: (p.read_bytes() if p.is_file() else b"", p.stat().st_mtime_ns) for p in paths}


def readers(folder: Path, out: Path) -> dict[str, list[Any]]:
    """Commands that read a run, and write only into ``out``."""
    return {
        "evaluate": ["evaluate", folder], "evaluate out": ["evaluate", folder, "--out", out / "a"],
        "report": ["report", folder, "--out", out / "b"],
        "play": ["play", folder, "--clip", out / "a.gif", "--episodes", 1],
        "export": ["export", folder, "--out", out / "policies"], "table": ["table", folder],
        "table out": ["table", folder, "--out", out / "a.jsonl"],
        "curves": ["curves", folder, "--out", out / "curves.png"],
        "stops": ["study", "stops", folder, "--lanes", 8, "--out", out / "stops.csv"],
    }  # fmt: skip
