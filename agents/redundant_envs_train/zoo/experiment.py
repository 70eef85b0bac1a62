"""Experiments of rl_zoo3 with the averaged learners and the native vector environment.

``python -m redundant_envs_train.zoo --algo averaged_sac --env redundant_envs/RPRPReach-v0 --seed 0
--conf-file configs/zoo/averaged_sac.yml`` takes all arguments of ``rl_zoo3.train``. With the settings and the
seed of a preset it takes the preset's steps, to the same bits.
"""

from pathlib import Path
from typing import Any

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.extras import needs

from .. import COMMAND
from ..config.run import MOST_SEEDS, SEEDS_PER_RUN, first_environment_seed
from ..learners.networks import Averaging
from ..learners.ppo import AveragedPPO
from ..learners.sac import AveragedSAC
from ..policies import save_policy
from ..rollout import SELECTION_SEED

with needs("zoo"):
    import rl_zoo3
    import rl_zoo3.enjoy
    import rl_zoo3.train
    from rl_zoo3.exp_manager import ExperimentManager
    from stable_baselines3 import PPO, SAC
    from stable_baselines3.common.callbacks import CallbackList
    from stable_baselines3.common.vec_env import VecEnv, VecMonitor

ALGORITHMS = {"averaged_ppo": AveragedPPO, "averaged_sac": AveragedSAC}
"""Names of the learners for ``--algo``."""


class WithAverage(CallbackList):
    """Callbacks, evaluations and checkpoints among them, during which the model holds the averaged policy."""

    def _on_step(self) -> bool:
        model: Any = self.model
        with model.averaged():
            return super()._on_step()


class Experiment(ExperimentManager):
    """An experiment of rl_zoo3 on the native vector environment, with the seeds of ``agents train``."""

    callbacks: list[Any]

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        if not 0 <= self.seed <= MOST_SEEDS:
            raise ValueError(f"--seed is {self.seed}; give one from 0 to {MOST_SEEDS}")
        self.averaged = issubclass(rl_zoo3.ALGOS[self.algo], Averaging)
        if self.averaged:
            self.device = "cpu"  # these learners keep their vectors on the CPU, whatever "auto" would choose
        if self.averaged and (self.continue_training or self.optimize_hyperparameters):
            raise ValueError(
                "--trained-agent and --optimize-hyperparameters are for the algorithms of stable-baselines3; "
                f"{self.algo} goes on after a stop in a run of: {COMMAND} train"
            )

    def create_envs(self, n_envs: int, eval_env: bool = False, no_log: bool = False) -> VecEnv:
        """All environments in one native vector."""
        for name in ("env_wrapper", "frame_stack"):
            if getattr(self, name) is not None:
                raise ValueError(
                    f"{name} is given; it wraps single environments, and the native vector has none: use "
                    "vec_env_wrapper, or python -m rl_zoo3.train with an algorithm of stable-baselines3"
                )
        if n_envs > SEEDS_PER_RUN:
            raise ValueError(f"n_envs is {n_envs}; give at most {SEEDS_PER_RUN}: a run has no more seeds")
        given = self.eval_env_kwargs if eval_env else self.env_kwargs
        base = make_sb3(self.env_name.gym_id, n_envs, monitor=False, **given)
        base.seed(SELECTION_SEED if eval_env else first_environment_seed(self.seed))
        log = None if eval_env or no_log else str(Path(self.save_path) / "0.monitor.csv")
        env: VecEnv = VecMonitor(base, log, **self.monitor_kwargs)
        if self.vec_env_wrapper is not None:
            env = self.vec_env_wrapper(env)
        return self._maybe_normalize(env, eval_env)

    def create_callbacks(self) -> None:
        """What is evaluated and saved on the way is the average, as at the end."""
        super().create_callbacks()
        if self.averaged and self.callbacks:
            self.callbacks = [WithAverage(self.callbacks)]

    def setup_experiment(self) -> Any:
        """The model, with the seeds of this run, and a learning rate that ends at 0."""
        found = super().setup_experiment()
        if found is not None:
            model = found[0]
            # after the learner, which sets its own seed in the environments: else runs would share most goals
            model.get_env().seed(first_environment_seed(self.seed))
            # the last rollout ends after the last step, where a linear schedule is below 0
            schedule = model.lr_schedule
            model.lr_schedule = lambda remaining: schedule(max(0.0, remaining))
        return found

    def save_trained_model(self, model: Any) -> None:
        """Save as rl_zoo3 does, with the average as the policy, so that stable-baselines3 alone loads it."""
        super().save_trained_model(model)
        if self.averaged:
            save_policy(model, Path(self.save_path) / f"{self.env_name}.zip")


def enjoy() -> None:
    """Watch as ``rl_zoo3.enjoy`` does; policies of the averaged learners are those of stable-baselines3."""
    rl_zoo3.ALGOS.update(averaged_ppo=PPO, averaged_sac=SAC)
    rl_zoo3.enjoy.enjoy()


def train() -> None:
    """Train as ``rl_zoo3.train`` does, with these algorithms beside its own."""
    rl_zoo3.ALGOS.update(ALGORITHMS)
    rl_zoo3.train.ExperimentManager = Experiment
    rl_zoo3.train.train()
