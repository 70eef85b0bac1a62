"""Search spaces: ranges and choices for settings of a learner."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from redundant_envs.extras import needs
from redundant_envs.files import text_value
from redundant_envs.values import shown

from ..config import Config, checked

with needs("tune"):
    from optuna.distributions import (
        BaseDistribution,
        CategoricalDistribution,
        FloatDistribution,
        IntDistribution,
    )

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


@dataclass(frozen=True)
class Range:
    """Numbers from ``low`` to ``high``, both included."""

    low: float
    high: float
    whole: bool

    @property
    def log(self) -> bool:
        """Whether the range is searched on a logarithmic scale."""
        return self.low > 0.0 and self.high / self.low >= LOGARITHMIC

    def distribution(self) -> BaseDistribution:
        """The range as a distribution of Optuna."""
        if self.whole:
            return IntDistribution(int(self.low), int(self.high), log=self.log)
        return FloatDistribution(self.low, self.high, log=self.log)

    def value(self, parameter: Any) -> Any:
        """The setting for a parameter of a trial."""
        return parameter

    def ends(self) -> tuple[Any, ...]:
        """Parameters at both ends."""
        return (int(self.low), int(self.high)) if self.whole else (self.low, self.high)

    def parameter(self, value: Any) -> Any:
        """The parameter of a trial for a setting; None if the range does not contain it."""
        return value if isinstance(value, int | float) and self.low <= value <= self.high else None

    def __str__(self) -> str:
        return f"{self.low!r}..{self.high!r}"


@dataclass(frozen=True)
class Choice:
    """Some values of a setting, by their texts."""

    values: Mapping[str, Any]

    def distribution(self) -> BaseDistribution:
        """The choice as a distribution of Optuna."""
        return CategoricalDistribution(tuple(self.values))

    def value(self, parameter: Any) -> Any:
        """The setting for a parameter of a trial."""
        return self.values[parameter]

    def ends(self) -> tuple[Any, ...]:
        """All parameters."""
        return tuple(self.values)

    def parameter(self, value: Any) -> Any:
        """The parameter of a trial for a setting; None if the choice does not contain it."""
        return next((text for text, own in self.values.items() if own == value), None)

    def __str__(self) -> str:
        return "|".join(self.values)


Space = dict[str, Range | Choice]
"""Range or choice by dotted key, such as ``sac.gamma``."""


def space_of(config: Config, searches: Sequence[str] = (), overrides: Sequence[str] = ()) -> Space:
    """The search space of a study.

    Parameters
    ----------
    config : Config
        Its learner's settings are searched.
    searches : sequence of str
        ``key=low..high`` or ``key=a|b|c``. Without any the learner's default space is used.
    overrides : sequence of str
        ``key=value`` of the user. These settings keep their value.

    Raises
    ------
    ValueError
        A text is no range or choice, its key is no setting of the learner or has a value already, or the
        learner does not allow a value.
    """
    fixed = {override.partition("=")[0].strip() for override in overrides}
    if not searches:
        defaults = DEFAULTS[config.algo]
        searches = [
            f"{config.algo}.{k}={v}" for k, v in defaults.items() if f"{config.algo}.{k}" not in fixed
        ]
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


def _check_some_value(config: Config, key: str, searched: Range | Choice) -> None:
    """ValueError if no value of a key is compatible with the configuration."""
    refused = ""
    for parameter in searched.ends():
        try:
            with_parameters(config, {key: searched}, {key: parameter})
        except ValueError as error:
            refused = str(error)
        else:
            return
    raise ValueError(f"no value of {key} {searched} goes together with the configuration: {refused}")


def _one(config: Config, key: str, text: str) -> Range | Choice:
    """The range or choice that a text describes."""
    kind = type(config.settings)
    valid = {f"{config.algo}.{name}": name for name in kind.model_fields}
    if key not in valid:
        raise ValueError(f"search key {shown(key)} is unknown; valid: {', '.join(valid)}")
    name = valid[key]

    def allowed(value: Any) -> Any:
        return getattr(checked(kind, {name: value}, f"{config.algo}."), name)

    ends = re.fullmatch(rf"({NUMBER})\s*\.\.\s*({NUMBER})", text)
    if ends:
        low, high = (allowed(float(end)) for end in ends.groups())
        if not low < high:
            raise ValueError(f"search of {key} is {shown(text)}; write the lower number first")
        return Range(low, high, whole=kind.model_fields[name].annotation is int)
    texts = [part.strip() for part in text.split("|")]
    if not 2 <= len(texts) <= MOST_CHOICES:
        raise ValueError(
            f"search of {key} is {shown(text)}; write low..high, or 2 to {MOST_CHOICES} values as a|b|c"
        )
    values = [allowed(text_value(part, f"the value {shown(part)}")) for part in texts]
    for k, value in enumerate(values):
        if value in values[:k]:
            raise ValueError(f"search of {key} has {shown(texts[k])} twice; give different values")
    return Choice(dict(zip(texts, values, strict=True)))


def with_parameters(config: Config, space: Space, parameters: Mapping[str, Any]) -> Config:
    """A configuration with the settings for the parameters of a trial.

    Raises
    ------
    ValueError
        The settings do not go together.
    """
    data = config.to_dict()
    for key, parameter in parameters.items():
        data[config.algo][key.partition(".")[2]] = space[key].value(parameter)
    chosen: Config = checked(Config, data)
    return chosen


def own_parameters(config: Config, space: Space) -> dict[str, Any]:
    """The parameters for the settings of a configuration, as far as the space contains them."""
    found = {key: s.parameter(getattr(config.settings, key.partition(".")[2])) for key, s in space.items()}
    return {key: parameter for key, parameter in found.items() if parameter is not None}
