"""Scenes: an arm and its effects, their numbers, ranges of these, and files."""

from pathlib import Path


def config_folder(kind: str) -> Path:
    """A folder of configs/, such as that of the named scenes: package data in a wheel."""
    installed = Path(__file__).parents[1] / "configs"
    return (installed if installed.is_dir() else Path(__file__).parents[2] / "configs") / kind
