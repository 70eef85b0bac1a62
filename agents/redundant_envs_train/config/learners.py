"""Settings of the learners: one model for each algorithm."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from redundant_envs.support.extras import needs

from .fields import Model, Real, Text, Whole, number, value

with needs("train"):
    from pydantic import Field, PlainValidator, model_validator
    from pydantic_core import PydanticCustomError

Width = Annotated[Whole, Field(ge=1, le=2048)]
Net = Annotated[tuple[Width, ...], Field(min_length=1, max_length=8)]
Activation = Literal["silu", "tanh", "relu"]
Schedule = Literal["constant", "linear"]


def _entropy_weight(weight: Any) -> float | str:
    number = isinstance(weight, int | float) and not isinstance(weight, bool)
    if weight == "auto":
        return "auto"
    if not number or not 0.0 <= weight <= 100.0:
        raise PydanticCustomError("kind", "give a number from 0 to 100, or auto")
    return float(weight)


EntropyWeight = Annotated[
    float | str, PlainValidator(_entropy_weight, json_schema_input_type=float | Literal["auto"])
]

RATE = (1e-12, 1.0)
SMOOTHNESS = (
    0, 1000,
    "weight in the actor's loss of |a(s) - a(s')|^2, for a state s and the next, s'; 0: no such term",
)  # fmt: skip
AT_GOAL = (
    "smoothness for steps with a reward above the mean, which are those at the goal; if only smoothness is "
    "given, its value is used here, too"
)
NET = "widths of the hidden layers"
ACTIVATION = "activation function between layers"
ADAM = "Adam's learning rate of actor and critics, at the beginning"
CRITIC_STEPS = "gradient steps of the critics after every train_freq control steps"


class PlainPPOSettings(Model):
    """PPO as in stable-baselines3."""

    n_steps: Whole = number(32, 1, 1e6, "control steps of every environment between two updates")
    batch_size: Whole = number(1024, 2, 1e8, "samples of a minibatch, a divisor of num_envs * n_steps")
    n_epochs: Whole = number(2, 1, 1000, "passes over the samples of an update")
    learning_rate: Real = number(2e-3, *RATE, "Adam's learning rate, at the beginning")
    schedule: Schedule = value("linear", "learning rate: constant, or linear to 0 at total_steps")
    gamma: Real = number(0.95, 0, 1, "discount per control step")
    gae_lambda: Real = number(0.9, 0, 1, "weight of longer returns in the advantages")
    clip_range: Real = number(0.2, 1e-6, 10, "largest change of a probability ratio that is rewarded")
    ent_coef: Real = number(0.01, 0, 100, "weight of the entropy in the loss, at the beginning")
    vf_coef: Real = number(0.5, 0, 100, "weight of the value loss")
    max_grad_norm: Real = number(0.5, 1e-9, 1e9, "largest norm of a gradient; longer ones are shortened")
    log_std_init: Real = number(-0.5, -20, 5, "logarithm of the first standard deviation of the actions")
    net_arch: Net = value((64, 64), NET)
    activation: Activation = value("silu", ACTIVATION)


class PPOSettings(PlainPPOSettings):
    """PPO with averaged weights, and smooth actions: exploration noise hides in training that a policy
    trembles."""

    schedule: Schedule = value(
        "linear", "learning rate and ent_coef: constant, or linear to 0 at total_steps"
    )
    n_epochs: Whole = number(1, 1, 1000, "passes over the samples of an update")
    learning_rate: Real = number(8e-3, *RATE, "Adam's learning rate, at the beginning")
    gamma: Real = number(0.97, 0, 1, "discount per control step")
    gae_lambda: Real = number(0.95, 0, 1, "weight of longer returns in the advantages")
    average: Real = number(
        0.9, 0, 1 - 1e-9, "share of the old average of the weights that an epoch keeps; 0: no average"
    )
    smoothness: Real = number(0.3, *SMOOTHNESS)


class OffPolicySettings(Model):
    """Settings of all learners with a replay buffer."""

    buffer_size: Whole = number(500_000, 1, 1e8, "transitions kept")
    learning_starts: Whole = number(20_000, 0, 1e9, "environment steps with random actions before learning")
    batch_size: Whole = number(256, 1, 1e6, "samples of a gradient step")
    learning_rate: Real = number(1e-3, *RATE, ADAM)
    schedule: Schedule = value("constant", "learning rate: constant, or linear to 0 at total_steps")
    gamma: Real = number(0.9, 0, 1, "discount per control step")
    train_freq: Whole = number(1, 1, 1e6, "control steps of every environment between gradient steps")
    gradient_steps: Whole = number(8, 1, 10_000, CRITIC_STEPS)
    net_arch: Net = value((64, 64), NET)
    activation: Activation = value("silu", ACTIVATION)


TAU = (1e-9, 1, "share of their distance to the critics that the target critics move at a gradient step")
KEPT = "share of the old average of the weights that an actor step keeps; 0: no average"
DELAY = (1, 1000, "gradient steps of the critics for each gradient step of the actor")
ENTROPY = "weight of the entropy, from 0 to 100, or auto"


class PlainSACSettings(OffPolicySettings):
    """SAC as in stable-baselines3; its ent_coef is small, as holding still needs a nearly deterministic
    policy."""

    tau: Real = number(0.04, *TAU)
    ent_coef: EntropyWeight = value(0.001, ENTROPY)


class SACSettings(PlainSACSettings):
    """SAC with an averaged, smoothed, delayed actor."""

    learning_rate: Real = number(6e-3, *RATE, ADAM)
    policy_delay: Whole = number(2, *DELAY)
    rewards_ahead: Whole = number(
        1, 1, 100, "rewards that are summed before the value of the state after them (n-step return)"
    )
    smoothness: Real = number(0.1, *SMOOTHNESS)
    average: Real = number(0.9995, 0, 1 - 1e-9, KEPT)


class HERSettings(SACSettings):
    """SAC with hindsight goals (stable-baselines3's HerReplayBuffer), for the goal environments: actions have
    to be smooth at the goal, of which the reward says nothing; elsewhere a large weight slows learning."""

    buffer_size: Whole = number(500_000, 1, 1e7, "transitions kept")
    gamma: Real = number(0.95, 0, 1, "discount per control step")
    learning_rate: Real = number(4e-3, *RATE, ADAM)
    learning_starts: Whole = number(102_400, 0, 1e9, "environment steps with random actions before learning")
    smoothness: Real = number(0.05, *SMOOTHNESS)
    smoothness_at_goal: Real = number(0.6, 0, 1000, AT_GOAL)
    gradient_steps: Whole = number(16, 1, 10_000, CRITIC_STEPS)

    n_sampled_goal: Whole = number(4, 1, 100, "hindsight goals for every original goal")
    goal_selection_strategy: Literal["future", "final", "episode"] = value(
        "future", "which tip position of the same episode becomes the goal"
    )
    error_scale: Real = number(0.05, 1e-6, 1e6, "distance from the goal that networks see as 1", "reach")

    @model_validator(mode="before")
    @classmethod
    def _alike(cls, values: Any) -> Any:
        """One weight counts everywhere, as in configurations of before there were two."""
        if isinstance(values, Mapping) and "smoothness" in values:
            return {"smoothness_at_goal": values["smoothness"], **values}
        return values


EXPERT = "expert"  # the source of demonstrations that is no dataset


class Demonstrations(Model):
    """Episodes that hold their goal, of which each sample of a learner has a share."""

    source: Text = value(EXPERT, "expert, which is that of the task; or the folder or id of a Minari dataset")
    episodes: Whole = number(
        1000, 1, 10_000, "episodes played or read; only those that hold their goal are used"
    )
    share: Real = number(0.5, 0.01, 0.99, "share of demonstrations in each sample of the learner")


class Curriculum(Model):
    """Numbers of the environments that begin with other values, such as stronger motors, and move in a
    straight line to those of the environments."""

    parameters: Annotated[dict[Any, Any], Field(min_length=1)] = value(
        ..., "values of the numbers at the beginning, by their names in env.parameters"
    )
    until: Real = number(0.5, 0.01, 1, "share of total_steps after which the numbers have the values of env")


class TD3Settings(OffPolicySettings):
    """TD3 of stable-baselines3."""

    tau: Real = number(0.04, *TAU)
    policy_delay: Whole = number(2, *DELAY)
    action_noise: Real = number(0.1, 0, 10, "standard deviation of the noise on actions, while exploring")
    target_policy_noise: Real = number(0.2, 0, 10, "standard deviation of the noise on target actions")
    target_noise_clip: Real = number(0.5, 0, 10, "largest noise on target actions")


class TQCSettings(PlainSACSettings):
    """TQC of sb3-contrib."""

    n_quantiles: Whole = number(25, 1, 1000, "quantiles of the return that each of two critics estimates")
    top_quantiles_to_drop_per_net: Whole = number(
        2, 0, 999, "largest quantiles of each critic that are left out; less than n_quantiles"
    )


class CrossQSettings(OffPolicySettings):
    """CrossQ of sb3-contrib: batch renormalisation instead of target networks."""

    batch_size: Whole = number(
        256, 2, 1e6, "samples of a gradient step; at least 2, because one has no variance"
    )
    ent_coef: EntropyWeight = value(0.001, ENTROPY)
    policy_delay: Whole = number(3, *DELAY)
