"""The environment: many lanes in one compiled call, as a Gymnasium VectorEnv."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from redundant_envs.envs.arguments import checked_seed
from redundant_envs.envs.core import Core
from redundant_envs.envs.face import PICTURE_SIZE, VectorEnvBase, observation_of
from redundant_envs.envs.options import checked_options
from redundant_envs.model.memory import first
from redundant_envs.model.parameters import table
from redundant_envs.scenes.numbers import names_of
from redundant_envs.simulator.batch.environment import Autoreset
from redundant_envs.support.values import shown, whole_number
from redundant_envs.tasks import make_task


class ArmVectorEnv(VectorEnvBase, VectorEnv[Any, Any, Any]):
    """Native vector environment of an arm with a task; made by ``gymnasium.make_vec``. Arguments are those of
    a single environment, on the page of its id, and: ``max_episode_steps``, None or -1 for no limit;
    ``autoreset_mode``, "next_step", "same_step" or "disabled"; ``threads`` over blocks of 8 environments,
    which change no bit."""

    def __init__(
        self,
        scene: str | Mapping[str, Any],
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        on_bad_action: str = "terminate",
        task: Mapping[str, Any] | None = None,
        terminate_on_touch: bool | None = None,
        render_mode: str | None = None,
        accuracy: str | float | None = None,
        threads: int = 1,
        randomize: bool = True,
        observe_parameters: Sequence[str] = (),
        info_keys: Sequence[str] | str | None = None,
        action: str | None = None,
        decide_every: int = 1,
        render_width: int = PICTURE_SIZE,
        render_height: int = PICTURE_SIZE,
    ) -> None:
        self.num_envs = num_envs = whole_number("num_envs", num_envs)
        self.autoreset_mode = autoreset(autoreset_mode)
        self._check_choices(on_bad_action, render_mode, render_width, render_height)
        named = make_task(task, self.task_name, terminate_on_touch)
        core = Core(
            scene, num_envs, named, max_episode_steps, accuracy, self.env_id, threads, randomize,
            observe_parameters, info_keys, Autoreset[self.autoreset_mode.name],
            action, decide_every,
        )  # fmt: skip
        self.single_observation_space, self.single_action_space = self._take(core)
        self.metadata["autoreset_mode"] = self.autoreset_mode
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._all = np.ones(num_envs, dtype=np.bool_)

    @first
    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes.

        Parameters
        ----------
        seed : int, sequence of ints, optional
            Environment i gets ``seed + i``, or its entry of the sequence.
        options : dict, optional
            "reset_mask": (num_envs,) bool, the environments to reset; "q", "qd": (joints,) or (n, joints);
            "goal": (2,) or (n, 2) [m]; "parameters": {name: numbers} of the arm, its effects and the task,
            each with a row for each environment or one for all; n counts those reset. Parameters are set on
            top of the environment's own and stay, through autoresets too, until a reset of the environment
            gives "parameters" again ({} returns to the own ones).
        """
        options = checked_options(options)
        reset_mask = options.pop("reset_mask", None)
        mask = np.ones(self.num_envs, dtype=np.bool_) if reset_mask is None else np.array(reset_mask)
        if mask.dtype != np.bool_ or mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(
                f"options['reset_mask'] has shape {mask.shape} and dtype {mask.dtype}; "
                f"give ({self.num_envs},) bool with at least one True"
            )
        if not self._ready and not mask.all():
            raise ValueError("options['reset_mask'] leaves environments out of the first reset")
        observation, out = self._begun(mask, lane_seeds(seed, self.num_envs), options)
        return observation, self.core.columns.infos(out, mask)

    @first
    def step(
        self, actions: Any
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """One control step of all environments; actions are (num_envs, actions) in [-1, 1], by
        default one for each joint."""
        core, mode = self.core, self.autoreset_mode
        if mode is AutoresetMode.DISABLED and core.ended.any():
            raise ValueError(
                f"environments {np.flatnonzero(core.ended).tolist()[:8]} have ended; call "
                "reset(options={'reset_mask': mask}) for them first (autoreset_mode is disabled)"
            )
        actions = self._checked_actions(actions)
        observation, reward, ended, out, last, last_out = self._stepped(actions)
        infos = core.columns.infos(out, self._all)
        if mode is AutoresetMode.NEXT_STEP and core.begun is not None:
            reward[core.begun] = 0.0
        elif mode is AutoresetMode.SAME_STEP and ended.any():
            final = np.full(self.num_envs, None, dtype=object)
            for n in np.flatnonzero(ended).tolist():
                final[n] = observation_of(last, n)
            infos["final_obs"], infos["_final_obs"] = final, ended.copy()
            infos["final_info"], infos["_final_info"] = core.columns.infos(last_out, ended), ended.copy()
        elif mode is AutoresetMode.DISABLED:
            core.ended[:] = ended
        terminated, truncated = (core.columns.of(out, name) for name in ("terminated", "truncated"))
        return observation, reward, terminated, truncated, infos

    @property  # type: ignore[misc]  # as SyncVectorEnv's
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generator of each environment, from which the keys of its episodes are drawn."""
        self.core.episode_keys.seed_new(range(self.num_envs))
        return tuple(filter(None, self.core.generators))

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each environment's generator."""
        self.core.episode_keys.seed_new(range(self.num_envs))
        return tuple(self.core.episode_keys.seeds)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """An attribute for each environment: q, qd, tip, goal, and numbers by name are its own."""
        return tuple(self._each(name))

    def set_attr(self, name: str, values: Any) -> None:
        """Let a number have a value from the next episode of each environment on, as :meth:`set_options`
        does; or set an attribute that all share. A list or a tuple has one entry for each environment."""
        if isinstance(values, list | tuple) and self._is_number(name):
            if len(values) != self.num_envs:
                raise ValueError(f"values has {len(values)} entries; give {self.num_envs}, one for each")
            width = len(names_of(self.core.scene, name, self.core.task.parameters()))
            values = np.concatenate([table(name, value, 1, width) for value in values])
        self._set_for(name, values, np.arange(self.num_envs))

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method of this object once, or get an attribute, with a result for each environment."""
        value = self._attribute(name)
        return (value(*args, **kwargs),) * self.num_envs if callable(value) else self.get_attr(name)

    @first
    def render(self) -> tuple[NDArray[np.uint8], ...]:
        """One picture per environment, (height, width, 3) uint8."""
        if self.render_mode is None:
            raise ValueError("render needs render_mode='rgb_array' at make")
        return tuple(self._drawn())


def autoreset(mode: AutoresetMode | str) -> AutoresetMode:
    """An autoreset mode from itself or its name."""
    names = {m.name.lower(): m for m in AutoresetMode}
    key = (mode.name if isinstance(mode, AutoresetMode) else str(mode)).lower().replace("-", "_")
    if key not in names:
        raise ValueError(f"autoreset_mode is {shown(mode)}; choose {', '.join(names)}")
    return names[key]


def lane_seeds(seed: Any, count: int) -> list[int | None]:
    """One seed per lane from Gymnasium's seed argument."""
    if isinstance(seed, np.ndarray):
        seed = list(np.atleast_1d(seed))
    if isinstance(seed, Sequence) and not isinstance(seed, str | bytes):
        if len(seed) != count:
            raise ValueError(f"seed has {len(seed)} entries; give one per environment, {count}")
        return [checked_seed(f"seed[{i}]", s) for i, s in enumerate(seed)]
    first = checked_seed("seed", seed)
    return [None] * count if first is None else [*range(first, first + count)]
