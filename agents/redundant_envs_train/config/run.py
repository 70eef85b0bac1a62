"""The configuration of a training run."""

from collections.abc import Mapping
from typing import Any, Literal, Self, get_args

from redundant_envs.envs.registration import ARGUMENTS, IDS, TASKS, full_id, ids, listed
from redundant_envs.support.extras import needs
from redundant_envs.support.values import shown

from . import learners
from .fields import Flag, Model, Real, Text, Whole, number, value

with needs("train"):
    from pydantic import model_validator

Algorithm = Literal["ppo", "sac", "her", "plain_ppo", "plain_sac", "td3", "tqc", "crossq"]
ALGORITHMS: tuple[str, ...] = get_args(Algorithm)
LABELS = {algo: algo.upper() for algo in ALGORITHMS}  # names in tables and figures
LABELS |= {"plain_ppo": "stock PPO", "plain_sac": "stock SAC", "crossq": "CrossQ"}
DEMONSTRATED = ("sac", "her")  # learners whose samples may have a share of demonstrations
SEEDS_PER_RUN = 10_000  # environment seeds of a run, one each, from first_environment_seed on
MAX_SEEDS = 9999  # largest seed of a run
KEPT_FOR_GOALS = (1_000_000, 10_000_000)
"""Environment seeds, from one to below the other, that serve evaluation only, never training."""
MAX_EPISODES = 1_000_000  # with more, seeds would overlap with those of the evaluation or of the curve
WITHOUT_EFFECT = ("checkpoint_seconds", "telemetry")  # settings that change no result
CLIENTS = ("wandb", "mlflow")
"""Kinds of logs that leave the run folder; each one's package is in the extra of its name."""
ENV_KWARGS = tuple(name for name in ARGUMENTS if name != "info_keys")  # evaluations read all that info has
MAX_SAMPLES = 10**8  # most samples between two updates of PPO, which a rollout holds in memory
MAX_DRAWN = 10**7  # most samples that are drawn at once
VERSION = 2


def first_environment_seed(seed: int) -> int:
    """Environment seed of the first environment of a run; no two runs share one."""
    first, (low, high) = seed * SEEDS_PER_RUN, KEPT_FOR_GOALS
    return first if first < low else first + high - low


class Config(Model):
    """One training run."""

    config_version: Literal[2] = value(..., "version of this format")
    env: Text = value(..., "id of the environment, such as RPRPReach-v0, with or without redundant_envs/")
    algo: Algorithm = value("ppo", "learner")
    seed: Whole = number(
        0, 0, MAX_SEEDS, "seed of the learner, and of all random numbers of the environments"
    )
    num_envs: Whole = number(512, 1, SEEDS_PER_RUN, "environments in parallel")
    stagger: Flag = value(
        False, "whether first episodes begin at a random step, so that updates see all parts of episodes"
    )
    total_steps: Whole = number(8_000_000, 1, 1e12, "environment steps in total")
    start_from: Text | None = value(
        None, "policy to begin with: a run folder, an exported policy's folder, or a policy.zip; null: none"
    )
    start_from_sha256: Text | None = value(
        None, "SHA-256 of that policy.zip, written by the training; if it is given, another file is refused"
    )
    max_seconds: Real | None = value(
        None, "most training time, s, after which the run ends early; null: no limit"
    )
    torch_threads: Whole = number(1, 1, 1024, "threads of PyTorch")
    curve_every: Whole = number(
        400_000, 1, 1e12, "environment steps between two points of the learning curve"
    )
    curve_episodes: Whole = number(500, 1, MAX_EPISODES, "episodes for each point of the learning curve")
    keep: Literal["last", "best"] = value(
        "last",
        "policy that is kept in policy.zip: the last one, or that of the best point of the learning curve",
    )
    evaluation_episodes: Whole = number(
        1000, 1, MAX_EPISODES, "episodes of the evaluation, whose goals are always the same"
    )
    checkpoint_seconds: Real = number(30.0, 0.0, 1e9, "training time between checkpoints; 0: none", "s")
    telemetry: tuple[Literal["tensorboard", "csv", "wandb", "mlflow"], ...] = value(
        ("tensorboard",), "where numbers are logged; wandb and mlflow only if they are given in the command"
    )
    env_kwargs: dict[Any, Any] = value({}, f"arguments of the environment: {', '.join(ENV_KWARGS)}")
    demonstrations: learners.Demonstrations | None = value(
        None, "episodes from which sac or her learns besides its own; null: none"
    )
    curriculum: learners.Curriculum | None = value(
        None, "parameters that begin with values other than those of env, such as stronger motors; null: none"
    )
    ppo: learners.PPOSettings | None = value(None, "settings of ppo")
    sac: learners.SACSettings | None = value(None, "settings of sac")
    her: learners.HERSettings | None = value(None, "settings of her")
    plain_ppo: learners.PlainPPOSettings | None = value(None, "settings of plain_ppo")
    plain_sac: learners.PlainSACSettings | None = value(None, "settings of plain_sac")
    td3: learners.TD3Settings | None = value(None, "settings of td3")
    tqc: learners.TQCSettings | None = value(None, "settings of tqc")
    crossq: learners.CrossQSettings | None = value(None, "settings of crossq")

    @model_validator(mode="before")
    @classmethod
    def _with_settings(cls, data: Any) -> Any:
        """Add the namespace of an id, and the default settings of the learner if none are given."""
        if not isinstance(data, Mapping):
            return data
        if isinstance(data.get("env"), str) and (name := full_id(data["env"])) in ids():
            data = {**data, "env": name}
        algo = data.get("algo", "ppo")
        if algo in ALGORITHMS and data.get(algo) is None:
            return {**data, algo: {}}
        return data

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.env not in ids():
            more = "--import MODULE before the command makes those known that a module of yours registers"
            raise ValueError(f"env is {shown(self.env)}; choose {listed()} ({more})")
        for name in ALGORITHMS:
            if name != self.algo and getattr(self, name) is not None:
                fix = f"give settings of one learner only: begin with a preset of {name} or of {self.algo}"
                raise ValueError(f"{name} has settings, and algo is {self.algo}; {fix}")
        if self.demonstrations is not None and self.algo not in DEMONSTRATED:
            fix = f"{' and '.join(DEMONSTRATED)} learn from demonstrations; leave them out, or choose one"
            raise ValueError(f"demonstrations are given, and algo is {self.algo}; {fix}")
        if self.demonstrations is not None and not 0 < self.demonstrated < self.settings.batch_size:
            batch = f"{self.demonstrated} of the {self.settings.batch_size} samples of a gradient step"
            fix = f"give a share, or {self.algo}.batch_size, that leaves some of both"
            raise ValueError(f"demonstrations.share is {self.demonstrations.share:g}: {batch}; {fix}")
        has_goal = "Goal" in self.env
        others = listed(name for name in ids() if ("Goal" in name) != has_goal)
        if self.algo == "her" and not has_goal:
            raise ValueError(f"env is {self.env}; her needs a goal environment: {others}")
        if self.algo == "crossq" and has_goal:
            reason = "crossq of sb3-contrib has no networks for goal environments"
            raise ValueError(f"env is {self.env}; {reason}: choose {others}")
        if self.max_seconds is not None and not self.max_seconds > 0.0:
            raise ValueError(f"max_seconds is {self.max_seconds:g}; give more than 0, or null")
        if self.start_from_sha256 is not None and self.start_from is None:
            problem = f"start_from_sha256 is {shown(self.start_from_sha256)}, and start_from is null"
            raise ValueError(f"{problem}; give both or neither")
        if self.stagger and self.env_kwargs.get("max_episode_steps", 1) is None:
            problem = "stagger is true, and env_kwargs.max_episode_steps is null"
            raise ValueError(f"{problem}; give episodes a limit, or stagger=false")
        if len(set(self.telemetry)) < len(self.telemetry):
            raise ValueError(f"telemetry is {shown(list(self.telemetry))}; name each one once")
        check_env_kwargs(self.env_kwargs)
        settings = self.settings
        if isinstance(settings, learners.PlainPPOSettings):
            samples = self.num_envs * settings.n_steps
            if samples > MAX_SAMPLES:
                most = MAX_SAMPLES // self.num_envs
                raise self._wrong("n_steps", f"with {self.num_envs} environments give at most {most}")
            if samples % settings.batch_size:
                raise self._wrong("batch_size", f"it must divide num_envs * {self.algo}.n_steps = {samples}")
        elif settings.batch_size * settings.gradient_steps > MAX_DRAWN:
            most, together = MAX_DRAWN // settings.gradient_steps, "whose samples are drawn together"
            fix = f"with {settings.gradient_steps} gradient steps, {together}, give at most {most}"
            raise self._wrong("batch_size", fix)
        elif self.total_steps <= settings.learning_starts:
            begins = f"{self.algo} begins to learn after {settings.learning_starts}"
            fix = f"give more, or a lower {self.algo}.learning_starts"
            raise ValueError(f"total_steps is {self.total_steps}; {begins}: {fix}")
        if isinstance(settings, learners.TQCSettings):
            most = settings.n_quantiles - 1
            if settings.top_quantiles_to_drop_per_net > most:
                fix = f"with {settings.n_quantiles} quantiles give at most {most}"
                raise self._wrong("top_quantiles_to_drop_per_net", fix)
        if isinstance(settings, learners.HERSettings):
            if settings.rewards_ahead > 1:
                raise self._wrong("rewards_ahead", "hindsight goals are those of single steps: give 1")
            # hindsight needs whole episodes: the first ones are over before the first gradient step
            least = self.num_envs * self.env_kwargs.get("max_episode_steps", TASKS[IDS[self.env].task])
            for name, smallest in {"learning_starts": least, "buffer_size": 2 * least}.items():
                if getattr(settings, name) < smallest:
                    fix = f"with {self.num_envs} environments give at least {smallest}"
                    raise self._wrong(name, f"{fix}, so that there are whole episodes to learn from")
        return self

    def _wrong(self, name: str, fix: str) -> ValueError:
        return ValueError(f"{self.algo}.{name} is {getattr(self.settings, name)}; {fix}")

    @property
    def settings(self) -> learners.PlainPPOSettings | learners.OffPolicySettings:
        return getattr(self, self.algo)

    @property
    def demonstrated(self) -> int:
        """Samples of a gradient step that come from demonstrations."""
        share = 0.0 if self.demonstrations is None else self.demonstrations.share
        return round(share * self.settings.batch_size)

    @property
    def label(self) -> str:
        """What tables and figures call the learner."""
        return LABELS[self.algo]

    def to_dict(self, *without: str) -> dict[str, Any]:
        """Plain data, with the settings of the chosen algorithm only, and without some entries."""
        return self.model_dump(mode="json", exclude={*ALGORITHMS, *without} - {self.algo})


def check_env_kwargs(env_kwargs: Mapping[str, Any]) -> None:
    """ValueError on arguments that no environment has, or that would never end an evaluation."""
    for name in env_kwargs:
        if name not in ENV_KWARGS:
            raise ValueError(f"env_kwargs has the unknown key {shown(name)}; valid: {', '.join(ENV_KWARGS)}")
    steps = env_kwargs.get("max_episode_steps", 1)
    whole = isinstance(steps, int) and not isinstance(steps, bool)
    if not whole or not 1 <= steps <= MAX_EPISODES:  # without this limit an evaluation would never end
        fix = f"give a whole number from 1 to {MAX_EPISODES}"
        raise ValueError(f"env_kwargs.max_episode_steps is {shown(steps)}; {fix}")
