"""Names and files of the presets. It imports nothing large: a wrong name is refused at once."""

from pathlib import Path

from redundant_envs.scenes.files import config_folder, exists
from redundant_envs.support.values import shown


def presets() -> list[str]:
    """Names of all presets; baselines are named with their folder."""
    folder = config_folder("training")  # package data in a wheel, configs/training in a checkout
    return sorted(p.relative_to(folder).with_suffix("").as_posix() for p in folder.rglob("*.yaml"))


def preset_path(path: str | Path) -> Path:
    """The file of a configuration: the path itself, or a preset's by its name."""
    file, preset = Path(path), config_folder("training") / f"{path}.yaml"
    if exists(file) and not (file.is_dir() and exists(preset)):
        return file
    if not exists(preset):
        raise ValueError(
            f"config is {shown(str(path))}; there is no such file, and the presets are "
            f"{', '.join(presets())}; or give env=ID, such as env=RPRPReach-v0"
        )
    return preset


def is_override(word: str) -> bool:
    """Whether a word of a command is ``key=value`` where a configuration may stand."""
    return "=" in word and not exists(Path(word))
