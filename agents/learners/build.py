"""The learner of a configuration, and the plain algorithm of stable-baselines3 that loads its policy."""

from __future__ import annotations

from typing import Any

from redundant_envs.extras import needs

from ..config import Config, HERSettings, PPOSettings
from .networks import ACTIVATIONS
from .ppo import AveragedPPO
from .sac import AveragedSAC

with needs("train"):
    from stable_baselines3 import PPO, SAC, HerReplayBuffer

ALGORITHM_CLASSES: dict[str, Any] = {"ppo": PPO, "sac": SAC, "her": SAC}
"""Class of stable-baselines3 by algorithm: it loads policy.zip."""


def policy_name(config: Config) -> str:
    """stable-baselines3's name of the policy class for an environment's observations."""
    return "MultiInputPolicy" if "Goal" in config.env else "MlpPolicy"


def policy_kwargs(config: Config) -> dict[str, Any]:
    """Arguments of the policy class: from torch and plain numbers alone, so that they load anywhere."""
    settings = config.settings
    layers = list(settings.net_arch)
    kwargs: dict[str, Any] = {"activation_fn": ACTIVATIONS[settings.activation].module}
    if isinstance(settings, PPOSettings):
        return {
            **kwargs,
            "net_arch": {"pi": layers, "vf": list(layers)},
            "log_std_init": settings.log_std_init,
        }
    return {**kwargs, "net_arch": layers}


def make_model(config: Config, env: Any) -> AveragedPPO | AveragedSAC:
    """The learner of a configuration, on a VecEnv."""
    settings = config.settings
    given = settings.model_dump(exclude={"net_arch", "schedule", "learning_rate", "log_std_init"})
    common = {
        "policy": policy_name(config),
        "env": env,
        "seed": config.seed,
        "device": "cpu",
        "policy_kwargs": policy_kwargs(config),
        "learning_rate": _rate(settings.learning_rate, settings.schedule),
    }
    if isinstance(settings, PPOSettings):
        return AveragedPPO(**common, **given)
    if isinstance(settings, HERSettings):
        goals = {name: given.pop(name) for name in ("n_sampled_goal", "goal_selection_strategy")}
        common |= {"replay_buffer_class": HerReplayBuffer, "replay_buffer_kwargs": goals}
    return AveragedSAC(**common, **given)


def _rate(rate: float, schedule: str) -> Any:
    if schedule == "constant":
        return rate
    return lambda remaining: rate * max(0.0, remaining)  # the last rollout ends after the last step
