"""Settings of the learners: one model for each algorithm."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from redundant_envs.extras import needs

from .fields import Model, Real, Whole, number, value

with needs("train"):
    from pydantic import Field, PlainValidator
    from pydantic_core import PydanticCustomError

MOST_LAYERS = 8
Width = Annotated[Whole, Field(ge=1, le=2048)]
Net = Annotated[tuple[Width, ...], Field(min_length=1, max_length=MOST_LAYERS)]
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
NET = "widths of the hidden layers"
ACTIVATION = "between layers"


class PPOSettings(Model):
    """PPO with averaged weights."""

    n_steps: Whole = number(32, 1, 1e6, "control steps of every environment between two updates")
    batch_size: Whole = number(1024, 2, 1e8, "samples of a minibatch; it divides num_envs * n_steps")
    n_epochs: Whole = number(2, 1, 1000, "passes over the samples of an update")
    learning_rate: Real = number(2e-3, *RATE, "Adam's, at the beginning")
    schedule: Schedule = value(
        "linear", "learning rate and ent_coef: constant, or linear to 0 at total_steps"
    )
    gamma: Real = number(0.95, 0, 1, "discount per control step")
    gae_lambda: Real = number(0.9, 0, 1, "weight of longer returns in the advantages")
    clip_range: Real = number(0.2, 1e-6, 10, "largest change of a probability ratio that is rewarded")
    ent_coef: Real = number(0.01, 0, 100, "weight of the entropy in the loss, at the beginning")
    vf_coef: Real = number(0.5, 0, 100, "weight of the value loss")
    max_grad_norm: Real = number(0.5, 1e-9, 1e9, "largest norm of a gradient; longer ones are shortened")
    log_std_init: Real = number(-0.5, -20, 5, "logarithm of the first standard deviation of the actions")
    net_arch: Net = value((64, 64), NET)
    activation: Activation = value("silu", ACTIVATION)
    average: Real = number(0.9, 0, 1 - 1e-9, "share of the average that an epoch keeps; 0: no average")


class SACSettings(Model):
    """SAC with an averaged, smoothed, delayed actor.

    A small fixed ent_coef, because holding still needs a policy that is nearly sure.
    """

    buffer_size: Whole = number(500_000, 1, 1e8, "transitions kept")
    learning_starts: Whole = number(20_000, 0, 1e9, "environment steps with random actions before learning")
    batch_size: Whole = number(256, 1, 1e6, "samples of a gradient step")
    learning_rate: Real = number(6e-3, *RATE, "Adam's, of actor and critics, at the beginning")
    schedule: Schedule = value("constant", "learning rate: constant, or linear to 0 at total_steps")
    gamma: Real = number(0.9, 0, 1, "discount per control step")
    tau: Real = number(0.04, 1e-9, 1, "share of the critics that their targets take at a gradient step")
    train_freq: Whole = number(1, 1, 1e6, "control steps of every environment between gradient steps")
    gradient_steps: Whole = number(8, 1, 10_000, "critic steps after each train_freq")
    ent_coef: EntropyWeight = value(0.001, "weight of the entropy, from 0 to 100, or auto")
    net_arch: Net = value((64, 64), NET)
    activation: Activation = value("silu", ACTIVATION)
    policy_delay: Whole = number(2, 1, 1000, "critic steps from one actor step to the next")
    smoothness: Real = number(0.1, 0, 1000, "weight of |a(s) - a(s')|^2 in the actor's loss; 0: none")
    average: Real = number(
        0.9995, 0, 1 - 1e-9, "share of the average that an actor step keeps; 0: no average"
    )


class HERSettings(SACSettings):
    """SAC with hindsight goals (stable-baselines3's HerReplayBuffer), for the goal environments."""

    buffer_size: Whole = number(500_000, 1, 1e7, "transitions kept")
    gamma: Real = number(0.95, 0, 1, "discount per control step")
    learning_rate: Real = number(4e-3, *RATE, "Adam's, of actor and critics, at the beginning")
    learning_starts: Whole = number(102_400, 0, 1e9, "environment steps with random actions before learning")
    gradient_steps: Whole = number(16, 1, 10_000, "critic steps after each train_freq")
    n_sampled_goal: Whole = number(4, 1, 100, "hindsight goals for every goal that was asked for")
    goal_selection_strategy: Literal["future", "final", "episode"] = value(
        "future", "which place of the same episode becomes the goal"
    )
    error_scale: Real = number(
        0.05, 1e-6, 1e6, "distance from the goal that the networks are given as 1", "reach"
    )
