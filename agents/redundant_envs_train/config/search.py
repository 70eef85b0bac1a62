"""The space of a search of a learner's settings, as plain data."""

from collections.abc import Sequence
from typing import Any

from redundant_envs.scenes.files import text_value
from redundant_envs.support.values import shown

from .fields import checked
from .files import written
from .run import Config

PPO = {
    "learning_rate": "5e-4..2e-2", "gamma": "0.9..0.99", "gae_lambda": "0.8..0.98", "n_epochs": "1..4",
    "batch_size": "512|1024|2048|4096", "ent_coef": "1e-3..3e-2", "clip_range": "0.1..0.4",
    "average": "0.8|0.9|0.95", "smoothness": "3e-2..1",
}  # fmt: skip
OFF_POLICY = {
    "learning_rate": "1e-3..2e-2", "gamma": "0.8..0.98", "batch_size": "128|256|512",
    "gradient_steps": "4..24", "tau": "1e-2..1e-1", "ent_coef": "1e-4..1e-2", "policy_delay": "1..4",
    "average": "0.998|0.9995|0.9998", "smoothness": "1e-2..1", "smoothness_at_goal": "0.1..3",
    "n_sampled_goal": "2..8", "action_noise": "0.03..0.3",
}  # fmt: skip
"""Default searches, of those settings that a learner has, with the presets' values inside."""
Space = dict[str, dict[str, Any]]
"""By key, low, high and log of a range, whose ends are whole if its numbers are; or choices, as texts."""


def space_of(config: Config, searches: Sequence[str] = (), overrides: Sequence[str] = ()) -> Space:
    """The space of ``searches``, ``key=low..high`` or ``key=a|b|c``; by default that of the learner, without
    the settings that ``overrides`` name."""
    keys = [f"{config.algo}.{name}" for name in type(config.settings).model_fields]
    fixed, space = {override.partition("=")[0].strip() for override in overrides}, Space()
    defaults = {f"{config.algo}.{k}": v for k, v in (PPO if "ppo" in config.algo else OFF_POLICY).items()}
    for text in searches or [f"{k}={v}" for k, v in defaults.items() if k in keys and k not in fixed]:
        key, _, what = (part.strip() for part in text.partition("="))
        if key not in keys:
            raise ValueError(f"search key {shown(key)} is unknown; valid: {', '.join(keys)}")
        if key in space or key in fixed:
            raise ValueError(f"{key} has a value or another search; leave one out")
        is_range = ".." in what
        values = [_setting(config, key, part) for part in what.split(".." if is_range else "|")]
        numbers = all(isinstance(value, int | float) for value in values)
        if len(values) < 2 or (is_range and not (numbers and len(values) == 2 and values[0] < values[1])):
            raise ValueError(f"search of {key} is {shown(what)}; write low..high, the lower first, or a|b|c")
        if is_range:
            low, high = values
            space[key] = {"low": low, "high": high, "log": 0.0 < 10.0 * low <= high}
        else:
            space[key] = {"choices": [*map(written, values)]}
    if not space:
        raise ValueError("every setting of the default search has a value; give --search key=low..high")
    return space


def _setting(config: Config, key: str, raw: Any) -> Any:
    """A number, or a text of a value, as the setting of the learner; ValueError if it is not allowed."""
    value = text_value(raw, f"the value {shown(raw)}") if isinstance(raw, str) else raw
    name = key.partition(".")[2]
    return getattr(checked(type(config.settings), {name: value}, f"{config.algo}."), name)


def with_values(config: Config, parameters: dict[str, Any]) -> Config:
    """A configuration with the parameters of a trial; ValueError if they do not go together."""
    data = config.to_dict()
    data[config.algo] |= {key.partition(".")[2]: _setting(config, key, v) for key, v in parameters.items()}
    return checked(Config, data)


def own_values(config: Config, space: Space) -> dict[str, Any]:
    """The parameters for the settings of a configuration, as far as the space contains them."""
    parameters: dict[str, Any] = {}
    for key, within in space.items():
        value = getattr(config.settings, key.partition(".")[2])
        if "choices" in within:
            if (value := written(value)) in within["choices"]:
                parameters[key] = value
        elif value != "auto" and within["low"] <= value <= within["high"]:
            parameters[key] = value
    return parameters
