"""The learner of a configuration, and the algorithm of stable-baselines3 that loads its policy."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.support.extras import needs

from ..config import Config, HERSettings, PlainPPOSettings, TD3Settings, TQCSettings
from .networks import ACTIVATIONS, Averaging
from .ppo import AveragedPPO
from .sac import AveragedSAC

with needs("train"):
    from sb3_contrib import TQC, CrossQ
    from stable_baselines3 import PPO, SAC, TD3, HerReplayBuffer
    from stable_baselines3.common.noise import VectorizedActionNoise


class NormalNoise(VectorizedActionNoise):
    """Normal noise on the actions of all environments, drawn at once: stable-baselines3 draws it one by one,
    which takes longer than stepping them."""

    def __init__(self, shape: tuple[int, int], deviation: float) -> None:
        self.shape, self.deviation = shape, deviation

    def reset(self, indices: Iterable[int] | None = None) -> None:
        """Do nothing: no draw depends on another."""

    def __call__(self) -> NDArray[np.float64]:
        """Noise, (num_envs, num_actions), from NumPy's global generator as in stable-baselines3."""
        return np.random.normal(0.0, self.deviation, self.shape)


ALGORITHM_CLASSES: dict[str, Any] = {
    "ppo": PPO, "sac": SAC, "her": SAC, "plain_ppo": PPO, "plain_sac": SAC, "td3": TD3, "tqc": TQC,
    "crossq": CrossQ,
}  # fmt: skip
"""Class of stable-baselines3 or sb3-contrib by algorithm: it loads policy.zip."""
OWN = {"ppo": AveragedPPO, "sac": AveragedSAC, "her": AveragedSAC}
LEARNERS: dict[str, Any] = OWN | {
    algo: type(f"Plain{kind.__name__}", (Averaging, kind), {"_update_info_buffer": kind._update_info_buffer})
    for algo, kind in ALGORITHM_CLASSES.items()
    if algo not in OWN
}
"""Class that trains, by algorithm; loops, losses and statistics of the plain ones are unchanged."""
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
        arch = {"pi": layers, "vf": list(layers)}
        return {**kwargs, "net_arch": arch, "log_std_init": settings.log_std_init}
    if isinstance(settings, TQCSettings):
        kwargs["n_quantiles"] = settings.n_quantiles
    return {**kwargs, "net_arch": layers}


def make_model(config: Config, env: Any) -> Any:
    """The learner of a configuration, on a VecEnv."""
    settings, learner = config.settings, LEARNERS[config.algo]
    kwargs = settings.model_dump(exclude=OF_POLICY)
    if config.algo not in OWN:  # the others have it in their policy only
        del kwargs["activation"]
    if isinstance(settings, HERSettings):
        goals = {name: kwargs.pop(name) for name in ("n_sampled_goal", "goal_selection_strategy")}
        kwargs |= {"replay_buffer_class": HerReplayBuffer, "replay_buffer_kwargs": goals}
    if isinstance(settings, TD3Settings):
        shape = config.num_envs, *env.action_space.shape
        kwargs["action_noise"] = NormalNoise(shape, settings.action_noise)
    rate: Any = settings.learning_rate
    if settings.schedule == "linear":  # the last rollout ends after the last step
        rate = lambda remaining: settings.learning_rate * max(0.0, remaining)  # noqa: E731
    return learner(
        policy=policy_name(config), env=env, seed=config.seed, device="cpu",
        policy_kwargs=policy_kwargs(config), learning_rate=rate, **kwargs,
    )  # fmt: skip
