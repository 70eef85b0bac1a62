"""The learner of a configuration, and the algorithm of stable-baselines3 that loads its policy."""

from __future__ import annotations

from typing import Any

from redundant_envs.extras import needs

from ..config import Config, HERSettings, PlainPPOSettings, TD3Settings, TQCSettings
from .averaging import Averaging
from .networks import ACTIVATIONS
from .plain import NormalNoise, PlainCrossQ, PlainPPO, PlainSAC, PlainTD3, PlainTQC
from .ppo import AveragedPPO
from .sac import AveragedSAC

with needs("train"):
    from sb3_contrib import TQC, CrossQ
    from stable_baselines3 import PPO, SAC, TD3, HerReplayBuffer

ALGORITHM_CLASSES: dict[str, Any] = {
    "ppo": PPO, "sac": SAC, "her": SAC, "plain_ppo": PPO, "plain_sac": SAC, "td3": TD3, "tqc": TQC,
    "crossq": CrossQ,
}  # fmt: skip
"""Class of stable-baselines3 or sb3-contrib by algorithm: it loads policy.zip."""
LEARNERS: dict[str, Any] = {
    "ppo": AveragedPPO, "sac": AveragedSAC, "her": AveragedSAC, "plain_ppo": PlainPPO, "plain_sac": PlainSAC,
    "td3": PlainTD3, "tqc": PlainTQC, "crossq": PlainCrossQ,
}  # fmt: skip
"""Class that trains, by algorithm."""


OF_POLICY = {"net_arch", "schedule", "learning_rate", "log_std_init", "n_quantiles"}
"""Settings that are not passed to the classes under their own names."""


def policy_name(config: Config) -> str:
    """stable-baselines3's name of the policy class for an environment's observations."""
    return "MultiInputPolicy" if "Goal" in config.env else "MlpPolicy"


def policy_kwargs(config: Config) -> dict[str, Any]:
    """Arguments of the policy class: from torch and plain numbers alone, so that they load anywhere."""
    settings = config.settings
    layers = list(settings.net_arch)
    kwargs: dict[str, Any] = {"activation_fn": ACTIVATIONS[settings.activation].module}
    if isinstance(settings, PlainPPOSettings):
        return {
            **kwargs,
            "net_arch": {"pi": layers, "vf": list(layers)},
            "log_std_init": settings.log_std_init,
        }
    if isinstance(settings, TQCSettings):
        kwargs["n_quantiles"] = settings.n_quantiles
    return {**kwargs, "net_arch": layers}


def make_model(config: Config, env: Any) -> Any:
    """The learner of a configuration, on a VecEnv."""
    settings, learner = config.settings, LEARNERS[config.algo]
    given = settings.model_dump(exclude=OF_POLICY)
    if not issubclass(learner, Averaging):  # the others have it in their policy only
        del given["activation"]
    if isinstance(settings, HERSettings):
        goals = {name: given.pop(name) for name in ("n_sampled_goal", "goal_selection_strategy")}
        given |= {"replay_buffer_class": HerReplayBuffer, "replay_buffer_kwargs": goals}
    if isinstance(settings, TD3Settings):
        noise = NormalNoise(config.num_envs, env.action_space.shape[0], settings.action_noise)
        given["action_noise"] = noise
    return learner(
        policy=policy_name(config),
        env=env,
        seed=config.seed,
        device="cpu",
        policy_kwargs=policy_kwargs(config),
        learning_rate=_rate(settings.learning_rate, settings.schedule),
        **given,
    )


def _rate(rate: float, schedule: str) -> Any:
    if schedule == "constant":
        return rate
    return lambda remaining: rate * max(0.0, remaining)  # the last rollout ends after the last step
