"""Training configurations: pydantic models with ranges, units and help; unknown keys are errors."""

from .fields import Model, Real, Text, Whole, checked, number, value
from .files import load, preset_folder, preset_path, presets, read
from .learners import HERSettings, PPOSettings, SACSettings
from .run import ALGORITHMS, MOST_EPISODES, MOST_SEEDS, SEEDS_PER_RUN, WITHOUT_EFFECT, Config

__all__ = [
    "ALGORITHMS", "MOST_EPISODES", "MOST_SEEDS", "SEEDS_PER_RUN", "WITHOUT_EFFECT", "Config", "HERSettings",
    "Model", "PPOSettings", "Real", "SACSettings", "Text", "Whole", "checked", "load", "number",
    "preset_folder", "preset_path", "presets", "read", "value",
]  # fmt: skip
