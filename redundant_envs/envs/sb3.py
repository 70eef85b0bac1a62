"""A stable-baselines3 VecEnv over the same core: no nested wrappers, no subprocesses."""

import importlib
import time
from collections.abc import Sequence
from threading import get_ident
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.error import NoAsyncCallError
from numpy.typing import NDArray

from redundant_envs.envs.arguments import checked_seed
from redundant_envs.envs.core import Core
from redundant_envs.envs.face import PICTURE_SIZE, VectorEnvBase, observation_of
from redundant_envs.envs.outputs import ALL
from redundant_envs.envs.registration import ARGUMENTS, IDS, OF_PICTURES, full_id, ids, listed
from redundant_envs.model.memory import first
from redundant_envs.simulator.batch.environment import Autoreset
from redundant_envs.support.extras import needs
from redundant_envs.support.values import shown, truth, whole_number
from redundant_envs.tasks import make_task

with needs("train"):
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices


class SB3VecEnv(VectorEnvBase, VecEnv):
    """Lanes of a core as a VecEnv; use :func:`make_sb3`. A done environment begins its next episode in the
    same step; the last observation is in ``infos[i]["terminal_observation"]``, and with ``monitor`` the
    return, the control steps and the time of its episode, s since the environments were made, in
    ``infos[i]["episode"]``."""

    def __init__(
        self, core: Core, on_bad_action: str = "terminate", render_mode: str | None = None,
        monitor: bool = True, render_width: int = PICTURE_SIZE, render_height: int = PICTURE_SIZE,
    ) -> None:  # fmt: skip
        self._check_choices(on_bad_action, render_mode, render_width, render_height)
        self.monitor = truth("monitor", monitor)
        self._made = time.time()
        self._actions: dict[int, NDArray[np.float32]] = {}  # those that wait for a step, by thread
        super().__init__(core.num_envs, *self._take(core))
        # The base class has put what it knows of pictures in place of the rate of frames.
        self.metadata = {**self.metadata, "render_fps": core.frames_per_second}

    @first
    def reset(self) -> Any:
        """Begin new episodes everywhere; seeds and options set before are used up."""
        self._actions.clear()
        observation, out = self._begun(np.ones(self.num_envs, dtype=np.bool_), self._seeds, {})
        self._reset_seeds()
        self.reset_infos = self.core.columns.all_info(out)
        return observation

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seeds of the next reset: ``seed + i`` for environment i, or random ones with None."""
        return super().seed(checked_seed("seed", seed))

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions for the next :meth:`step_wait` of this thread."""
        self._actions[get_ident()] = self._checked_actions(actions)

    @first
    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """One control step of all environments, with the actions that this thread gave, or else another."""
        if not self._actions:
            raise NoAsyncCallError("step_wait was called before step_async; call step_async first", "step")
        core, columns, thread = self.core, self.core.columns, get_ident()
        actions = self._actions.pop(thread if thread in self._actions else next(iter(self._actions)))
        observation, reward, dones, out, last, last_out = self._stepped(actions)
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": False} for _ in range(self.num_envs)]
        if "is_success" in columns.names:
            held = columns.of(out, "is_success").tolist()
            infos = [{"TimeLimit.truncated": False, "is_success": success} for success in held]
        if "numerics" in columns.names:
            faults = columns.of(out, "numerics")
            for n in np.flatnonzero(faults).tolist():
                infos[n]["numerics"] = int(faults[n])
        if dones.any():
            returns = sum(columns.of(last_out, name) for name in core.episode.returns)
            steps = columns.of(last_out, "steps")
            cut = columns.of(last_out, "truncated") & ~columns.of(last_out, "terminated")
            for n in np.flatnonzero(dones).tolist():
                infos[n] = columns.info(last_out, n)
                if self.monitor:
                    took = round(time.time() - self._made, 6)
                    infos[n]["episode"] = {"r": round(float(returns[n]), 6), "l": int(steps[n]), "t": took}
                infos[n]["terminal_observation"] = observation_of(last, n)
                infos[n]["TimeLimit.truncated"] = bool(cut[n])
                self.reset_infos[n] = columns.info(out, n)
        return observation, reward.astype(np.float32), dones, infos

    def close(self) -> None:
        """Nothing to release."""

    @first
    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """One picture per environment."""
        return [None] * self.num_envs if self.render_mode is None else self._drawn()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute for each environment: q, qd, tip, goal, and numbers by name are its own."""
        each = self._each(attr_name)
        return [each[lane] for lane in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Let a number have a value, or several a row for each environment, from its next episode on, as
        :meth:`set_options` does; or set an attribute that all share."""
        self._set_for(attr_name, value, np.array([*self._get_indices(indices)], dtype=np.int64))

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of this object; the result is repeated per requested environment. ``set_options`` and
        ``set_state`` are for those alone."""
        if method_name in ("set_options", "set_state") and indices is not None:
            method_kwargs["index"] = [*self._get_indices(indices)]
        result = getattr(self, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: VecEnvIndices = None) -> list[bool]:
        """Whether infos are those of a wrapper: of ``Monitor`` with ``monitor``; of others they are not."""
        return [self.monitor and wrapper_class is Monitor for _ in self._get_indices(indices)]


def make_sb3(env_id: str, num_envs: int = 256, monitor: bool = True, **kwargs: Any) -> SB3VecEnv:
    """A native stable-baselines3 VecEnv of a registered id.

    Parameters
    ----------
    env_id : str
        A registered id, with or without the namespace; "module:id" imports the module that registers it.
    num_envs : int
    monitor : bool
        Give return, length and time of an episode at its end, ``info["episode"]``, as stable-baselines3's
        Monitor does. Without it, wrap the result in a VecMonitor to have them.
    **kwargs
        Those of ``gymnasium.make``: scene, accuracy, task, terminate_on_touch, on_bad_action, render_mode
        and sizes, max_episode_steps, randomize, observe_parameters, action, decide_every, info_keys (all by
        default, because they are read at the ends of episodes); and threads, over blocks of 8 environments.
    """
    num_envs = whole_number("num_envs", num_envs)
    if not isinstance(env_id, str):
        raise ValueError(
            f"env_id is {shown(env_id)}; give an id (for functions that make environments, "
            "stable-baselines3 has DummyVecEnv and SubprocVecEnv)"
        )
    module, _, name = env_id.rpartition(":")
    if module:
        importlib.import_module(module)
    full, valid = full_id(name), (*ARGUMENTS, *OF_PICTURES, "threads")
    if full not in ids():
        raise ValueError(f"env_id is {shown(env_id)}; valid: {listed()}")
    for key in kwargs:
        if key not in valid:
            raise ValueError(f"make_sb3 has no argument {key!r}; valid: {', '.join(valid)}")
    spec = gym.spec(full)
    arguments = {"max_episode_steps": spec.max_episode_steps, **spec.kwargs, **kwargs}
    options = {name: arguments.pop(name) for name in ("on_bad_action", *OF_PICTURES) if name in arguments}
    ends = arguments.pop("terminate_on_touch", None)
    task = make_task(arguments.pop("task", None), IDS[full].task, ends)
    arguments["info_keys"] = ALL if arguments.get("info_keys") is None else arguments["info_keys"]
    core = Core(**arguments, num_envs=num_envs, task=task, env_id=full, autoreset=Autoreset.SAME_STEP)
    return SB3VecEnv(core, **options, monitor=monitor)
