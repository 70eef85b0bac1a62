"""Arguments of a study, and search spaces: ranges and choices for settings of a learner."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from redundant_envs.extras import needs
from redundant_envs.files import text_value
from redundant_envs.values import shown

from ..config import Config, checked
from ..training.pool import count_of

with needs("tune"):
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

PPO = {
    "learning_rate": "5e-4..2e-2", "gamma": "0.9..0.99", "gae_lambda": "0.8..0.98", "n_epochs": "1..4",
    "batch_size": "512|1024|2048|4096", "ent_coef": "1e-3..3e-2", "clip_range": "0.1..0.4",
}  # fmt: skip
OFF_POLICY = {
    "learning_rate": "1e-3..2e-2", "gamma": "0.8..0.97", "batch_size": "128|256|512",
    "gradient_steps": "4..16",
}  # fmt: skip
SAC = {**OFF_POLICY, "tau": "1e-2..1e-1", "ent_coef": "1e-4..1e-2"}
AVERAGED = {"smoothness": "1e-2..1", "average": "0.998|0.9995|0.9998"}
DEFAULTS: dict[str, dict[str, str]] = {
    "ppo": {**PPO, "average": "0.8|0.9|0.95", "smoothness": "3e-2..1"},
    "sac": {**SAC, **AVERAGED},
    "her": {
        **SAC, **AVERAGED, "learning_rate": "1e-3..1e-2", "gamma": "0.9..0.98", "gradient_steps": "8..24",
        "n_sampled_goal": "2..8", "smoothness": "1e-2..0.3", "smoothness_at_goal": "0.1..3",
    },
    "plain_ppo": PPO,
    "plain_sac": SAC,
    "td3": {**OFF_POLICY, "tau": "1e-2..1e-1", "action_noise": "0.03..0.3", "policy_delay": "1..4"},
    "tqc": SAC,
    "crossq": {**OFF_POLICY, "ent_coef": "1e-4..1e-2", "policy_delay": "1..4"},
}  # fmt: skip
"""Default search spaces, with the preset's value near the middle."""
LOGARITHMIC = 10.0
"""A range of positive numbers whose ends have at least this ratio is searched on a logarithmic scale."""
NUMBER = r"[-+]?(?:\d+(?:\.\d+)?|\.\d+)(?:[eE][-+]?\d+)?"
MOST_CHOICES = 100
MOST_TRIALS = 10_000
MOST_SEED = 2**32 - 1
Space = dict[str, Any]
"""By dotted key, such as ``sac.gamma``, Optuna's distribution: a range, or a choice of texts of values."""


def check_arguments(config: Config, trials: int, seed: int, processes: int) -> None:
    """ValueError for impossible arguments of a study."""
    if not 1 <= trials <= MOST_TRIALS:
        raise ValueError(f"trials is {trials}; give a whole number from 1 to {MOST_TRIALS}")
    if not 0 <= seed <= MOST_SEED:
        raise ValueError(f"seed is {seed}; give a whole number from 0 to {MOST_SEED}")
    count_of(processes)
    if config.max_seconds is not None:
        raise ValueError(
            f"max_seconds is {config.max_seconds:g}; trials are compared at equal steps: give "
            "max_seconds=null and total_steps"
        )


def words(searched: Any) -> str:
    """A range or choice as a user writes it."""
    if isinstance(searched, CategoricalDistribution):
        return "|".join(map(str, searched.choices))
    return f"{searched.low!r}..{searched.high!r}"


def space_of(config: Config, searches: Sequence[str] = (), overrides: Sequence[str] = ()) -> Space:
    """The search space of a study over the settings of a configuration's learner.

    ``searches`` are ``key=low..high`` or ``key=a|b|c``; without any the learner's default space is used.
    Settings that the user's ``overrides``, ``key=value``, name keep their value.
    """
    fixed = {override.partition("=")[0].strip() for override in overrides}
    if not searches:
        defaults = {f"{config.algo}.{name}": what for name, what in DEFAULTS[config.algo].items()}
        searches = [f"{key}={what}" for key, what in defaults.items() if key not in fixed]
        if not searches:
            raise ValueError("every setting of the default search has a value; give --search key=low..high")
    space: Space = {}
    for text in searches:
        key, equals, what = (part.strip() for part in text.partition("="))
        if not equals:
            raise ValueError(f"search is {shown(text)}; write key=low..high or key=a|b|c")
        if key in space:
            raise ValueError(f"search has {shown(key)} twice; leave one out")
        if key in fixed:
            raise ValueError(f"{key} has a value and is searched; leave one out")
        space[key] = _one(config, key, what)
    for key, searched in space.items():
        _check_some_value(config, key, searched)
    return space


def _check_some_value(config: Config, key: str, searched: Any) -> None:
    """ValueError if no choice, or no end of a range, is compatible with the configuration."""
    refused = ""
    choices = getattr(searched, "choices", None)
    for parameter in choices or (searched.low, searched.high):
        try:
            with_parameters(config, {key: searched}, {key: parameter})
        except ValueError as error:
            refused = str(error)
        else:
            return
    raise ValueError(f"no value of {key} {words(searched)} goes together with the configuration: {refused}")


def _allowed(config: Config, key: str, value: Any) -> Any:
    """A value, or a text of one, as the setting of the learner; ValueError if it is not allowed."""
    if isinstance(value, str):
        value = text_value(value, f"the value {shown(value)}")
    name = key.partition(".")[2]
    return getattr(checked(type(config.settings), {name: value}, f"{config.algo}."), name)


def _one(config: Config, key: str, text: str) -> Any:
    """The range or choice that a text describes."""
    fields = {f"{config.algo}.{name}": field for name, field in type(config.settings).model_fields.items()}
    if key not in fields:
        raise ValueError(f"search key {shown(key)} is unknown; valid: {', '.join(fields)}")
    ends = re.fullmatch(rf"({NUMBER})\s*\.\.\s*({NUMBER})", text)
    if ends:
        low, high = (_allowed(config, key, float(end)) for end in ends.groups())
        if not low < high:
            raise ValueError(f"search of {key} is {shown(text)}; write the lower number first")
        kind = IntDistribution if fields[key].annotation is int else FloatDistribution
        return kind(low, high, log=low > 0.0 and high / low >= LOGARITHMIC)
    texts = [part.strip() for part in text.split("|")]
    if not 2 <= len(texts) <= MOST_CHOICES:
        raise ValueError(
            f"search of {key} is {shown(text)}; write low..high, or 2 to {MOST_CHOICES} values as a|b|c"
        )
    values = [_allowed(config, key, part) for part in texts]
    for k, value in enumerate(values):
        if value in values[:k]:
            raise ValueError(f"search of {key} has {shown(texts[k])} twice; give different values")
    return CategoricalDistribution(texts)


def with_parameters(config: Config, space: Space, parameters: Mapping[str, Any]) -> Config:
    """A configuration with the settings for the parameters of a trial; ValueError if they do not fit."""
    data = config.to_dict()
    for key, parameter in parameters.items():
        choice = isinstance(space[key], CategoricalDistribution)
        data[config.algo][key.partition(".")[2]] = _allowed(config, key, parameter) if choice else parameter
    chosen: Config = checked(Config, data)
    return chosen


def own_parameters(config: Config, space: Space) -> dict[str, Any]:
    """The parameters for the settings of a configuration, as far as the space contains them."""
    found: dict[str, Any] = {}
    for key, searched in space.items():
        own = getattr(config.settings, key.partition(".")[2])
        if isinstance(searched, CategoricalDistribution):
            own = next((text for text in searched.choices if _allowed(config, key, text) == own), None)
            found |= {} if own is None else {key: own}
        elif isinstance(own, int | float) and searched.low <= own <= searched.high:
            found[key] = own
    return found
