"""rl_zoo3 with the averaged learners and the native vector environment: docs/examples/rl_zoo.py takes the
arguments of rl_zoo3.train, and after the word "enjoy" those of its enjoy (docs/other_libraries.md).

With the settings and the seed of a preset it takes the preset's steps, to the same bits.
"""

import sys
from pathlib import Path

import rl_zoo3.enjoy
import rl_zoo3.train
from rl_zoo3.exp_manager import ExperimentManager
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import CallbackList
from stable_baselines3.common.vec_env import VecMonitor

from redundant_envs import make_sb3
from redundant_envs_train.config.run import first_environment_seed
from redundant_envs_train.learners.networks import Averaging
from redundant_envs_train.learners.ppo import AveragedPPO
from redundant_envs_train.learners.sac import AveragedSAC
from redundant_envs_train.policies import save_policy
from redundant_envs_train.rollout import SELECTION_SEED


class WithAverage(CallbackList):
    """Callbacks, such as evaluations, during which the model holds the averaged policy."""

    def _on_step(self):
        with self.model.averaged():
            return super()._on_step()


class Experiment(ExperimentManager):
    """An experiment on the native vector environment, with the seeds of ``agents train``."""

    def create_envs(self, n_envs, eval_env=False, no_log=False):
        averaged = issubclass(rl_zoo3.ALGOS[self.algo], Averaging)
        if self.env_wrapper or (averaged and (self.continue_training or self.optimize_hyperparameters)):
            sys.exit("env_wrapper, and for averaged learners --trained-agent and --optimize, do not go here")
        given = self.eval_env_kwargs if eval_env else self.env_kwargs
        base = make_sb3(self.env_name.gym_id, n_envs, monitor=False, **given)
        base.seed(SELECTION_SEED if eval_env else first_environment_seed(self.seed))
        log = None if eval_env or no_log else str(Path(self.save_path) / "0.monitor.csv")
        env = VecMonitor(base, log, **self.monitor_kwargs)
        return self._maybe_normalize(self.vec_env_wrapper(env) if self.vec_env_wrapper else env, eval_env)

    def create_callbacks(self):
        super().create_callbacks()
        if issubclass(rl_zoo3.ALGOS[self.algo], Averaging) and self.callbacks:
            self.callbacks = [WithAverage(self.callbacks)]

    def setup_experiment(self):
        self.device = "cpu"  # the averaged learners keep their vectors there
        if found := super().setup_experiment():
            found[0].get_env().seed(first_environment_seed(self.seed))  # after the learner, which has its own
            schedule = found[0].lr_schedule  # the last rollout ends after the last step
            found[0].lr_schedule = lambda remaining: schedule(max(0.0, remaining))
        return found

    def save_trained_model(self, model):
        super().save_trained_model(model)
        if isinstance(model, Averaging):  # so that stable-baselines3 alone loads it
            save_policy(model, Path(self.save_path) / f"{self.env_name}.zip")


if __name__ == "__main__":
    watch = sys.argv[1:2] == ["enjoy"]
    del sys.argv[1 : 1 + watch]
    own = (PPO, SAC) if watch else (AveragedPPO, AveragedSAC)
    rl_zoo3.ALGOS.update(zip(("averaged_ppo", "averaged_sac"), own, strict=True))
    rl_zoo3.train.ExperimentManager = Experiment
    rl_zoo3.enjoy.enjoy() if watch else rl_zoo3.train.train()
