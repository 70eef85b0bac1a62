"""Training configurations: pydantic models with ranges, units and help; unknown keys are errors."""

from .fields import Model, Real, Text, Whole, checked, number, value
from .files import check_telemetry, config_of, load, load_model
from .learners import HERSettings, OffPolicySettings, PlainPPOSettings, TD3Settings, TQCSettings
from .run import ALGORITHMS, CLIENTS, MAX_EPISODES, MAX_SEEDS, WITHOUT_EFFECT, Config

__all__ = [
    "ALGORITHMS", "CLIENTS", "MAX_EPISODES", "MAX_SEEDS", "WITHOUT_EFFECT", "Config", "HERSettings",
    "Model", "OffPolicySettings", "PlainPPOSettings", "Real", "TD3Settings", "TQCSettings", "Text", "Whole",
    "check_telemetry", "checked", "config_of", "load", "load_model", "number", "value",
]  # fmt: skip
