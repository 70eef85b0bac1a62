"""Training configurations: pydantic models with ranges, units and help; unknown keys are errors."""

from .fields import Model, Real, Text, Whole, checked, number, value
from .files import config_of, load, read
from .learners import (
    HERSettings,
    OffPolicySettings,
    PlainPPOSettings,
    PPOSettings,
    SACSettings,
    TD3Settings,
    TQCSettings,
)
from .run import (
    ALGORITHMS,
    MOST_EPISODES,
    MOST_SEEDS,
    SEEDS_PER_RUN,
    WITHOUT_EFFECT,
    Config,
    first_environment_seed,
    label,
)

__all__ = [
    "ALGORITHMS", "MOST_EPISODES", "MOST_SEEDS", "SEEDS_PER_RUN", "WITHOUT_EFFECT", "Config", "HERSettings",
    "Model", "OffPolicySettings", "PPOSettings", "PlainPPOSettings", "Real", "SACSettings", "TD3Settings",
    "TQCSettings", "Text", "Whole", "checked", "config_of", "first_environment_seed", "label", "load",
    "number", "read", "value",
]  # fmt: skip
