"""A vector environment whose actions, observations and rewards are torch tensors, on a CPU or a GPU."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv

from redundant_envs.envs.keys import LARGEST_SEED
from redundant_envs.envs.options import checked_options
from redundant_envs.envs.outputs import DRAWN
from redundant_envs.envs.registration import full_id
from redundant_envs.envs.torch_lanes import DeviceLanes, Tables, check_gpu
from redundant_envs.envs.vector_env import ArmVectorEnv, autoreset, lane_seeds
from redundant_envs.simulator.batch.environment import DUE
from redundant_envs.simulator.lane.episode import TIP
from redundant_envs.simulator.lane.fields import STATE
from redundant_envs.support.extras import needs
from redundant_envs.support.values import shown, truth, whole_number

with needs("train"):
    import torch


def make_torch(
    id: str, num_envs: int = 1, device: str | torch.device = "cuda", copy: bool = False, **kwargs: Any
) -> ArmTorchVectorEnv:
    """Environments in one compiled call, from tensors to tensors. **Not yet run on a GPU**: its programs were
    checked as code of a CPU, where they give the bits of ``gymnasium.make_vec``.

    Parameters
    ----------
    id : str
        Of an environment, such as "redundant_envs/FourRReach-v0".
    num_envs : int
        Their number; on a GPU the numbers of each take some 1000 bytes of its memory.
    device : str or torch.device
        "cuda", or "cpu" for the programs of ``gymnasium.make_vec``; both give the same bits.
    copy : bool
        Whether tensors stay as they are. Otherwise a step on a GPU overwrites those of the step before the
        last one.
    **kwargs
        Arguments of ``gymnasium.make_vec``. On a GPU nothing may wait for it: no ``render_mode``, no
        ``autoreset_mode="disabled"``, no ``on_bad_action="raise"``; and there are no ``threads``.

    Raises
    ------
    ValueError
        If the device is none, has too little memory, or an argument does not fit it.

    Examples
    --------
    >>> import redundant_envs as rde, torch
    >>> env = rde.make_torch("redundant_envs/FourRReach-v0", num_envs=4, device="cpu")
    >>> observation, info = env.reset(seed=7)
    >>> observation, reward, terminated, truncated, info = env.step(torch.zeros(4, 4))
    >>> reward.shape, reward.dtype
    (torch.Size([4]), torch.float64)
    """
    return ArmTorchVectorEnv(id, num_envs, device, copy, kwargs)


class ArmTorchVectorEnv(VectorEnv[Any, Any, Any]):
    """Made by :func:`make_torch`. Steps of a GPU are launched on torch's current stream; none waits for the
    device or reads from it, so that a CUDA graph can capture them."""

    def __init__(
        self, id: str, num_envs: int, device: str | torch.device, copy: bool, kwargs: Mapping[str, Any]
    ) -> None:
        self._id, self._kwargs, self._copy = full_id(id), dict(kwargs), truth("copy", copy)
        self.num_envs = whole_number("num_envs", num_envs)
        try:
            self.device = torch.device(device)
        except (RuntimeError, TypeError):
            raise ValueError(f"device is {shown(device)}; give 'cpu' or 'cuda'") from None
        on_cpu = self._runs_on_cpu()
        if not on_cpu:
            self._check_gpu()
        self._env = self._made(self.num_envs if on_cpu else 1)
        """All environments, or on a GPU one that tells what they are."""
        self._lanes = None if on_cpu else self._placed()
        if self._lanes:
            self.device = self._lanes.state.device
        self.autoreset_mode, self.metadata = self._env.autoreset_mode, self._env.metadata
        self.spec = self._env.spec
        self.single_observation_space = self._env.single_observation_space
        self.single_action_space = self._env.single_action_space
        self.observation_space = gym.vector.utils.batch_space(self.single_observation_space, self.num_envs)
        self.action_space = gym.vector.utils.batch_space(self.single_action_space, self.num_envs)
        self._all = torch.ones(self.num_envs, dtype=torch.bool, device=self.device)

    def _runs_on_cpu(self) -> bool:
        return self.device.type == "cpu"

    def _placed(self) -> DeviceLanes:
        return DeviceLanes(self._env.core, self.num_envs, self.device)

    def _made(self, num_envs: int) -> ArmVectorEnv:
        made: Any = gym.make_vec(self._id, num_envs=num_envs, **self._kwargs)
        return made.unwrapped  # type: ignore[no-any-return]

    def _check_gpu(self) -> None:
        """Refuse a device that is none, and arguments that would make every step wait for it."""
        check_gpu(self.device)
        mode = autoreset(self._kwargs.get("autoreset_mode", AutoresetMode.NEXT_STEP))
        refused = {
            "render_mode": self._kwargs.get("render_mode") is not None,
            "autoreset_mode": mode is AutoresetMode.DISABLED,
            "on_bad_action": self._kwargs.get("on_bad_action") == "raise",
            "threads": self._kwargs.get("threads", 1) != 1,
        }
        for key in (key for key, bad in refused.items() if bad):
            raise ValueError(
                f"{key} is {shown(self._kwargs[key])}: on a GPU nobody draws single environments or looks at "
                "them, because every step would wait for it; leave it out, or give device='cpu'"
            )

    # ---- Gymnasium ---------------------------------------------------------------------------------------

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """As that of ``gymnasium.make_vec``; masks and numbers of ``options`` are arrays. On a GPU, options
        other than "reset_mask" take the way of the CPU: each call copies all environments there and back."""
        lanes, options = self._lanes, checked_options(options)
        if lanes is None:
            observation, infos = self._env.reset(seed=seed, options=options)
            return self._given((_tensors(observation), _tensors(infos)))
        mask = np.asarray(options.get("reset_mask", np.ones(self.num_envs, np.bool_)))
        seeds = lane_seeds(seed, self.num_envs)
        if self._is_plain(options, mask, seeds):
            lanes.seed([s if chosen else None for s, chosen in zip(seeds, mask, strict=True)])
            tables = lanes.reset(mask)
        else:  # which also says what is wrong with a mask
            env = self._on_cpu()
            env.reset(seed=seed, options=options)
            lanes.take(env.core)
            tables = lanes.reset(np.zeros(self.num_envs, np.bool_))
        begun = torch.as_tensor(mask, device=self.device)
        return self._given((self._observation(tables), self._infos(tables, begun)))

    def _is_plain(self, options: Mapping[str, Any], mask: Any, seeds: Sequence[int | None]) -> bool:
        """Whether a reset has nothing that only the programs of a CPU do."""
        if not {*options} <= {"reset_mask"} or (mask.dtype, mask.shape) != (np.bool_, (self.num_envs,)):
            return False
        enough = mask.any() if self._lanes and self._lanes.begun else mask.all()
        return bool(enough) and max((s for s in seeds if s is not None), default=0) <= LARGEST_SEED

    def step(self, actions: Any) -> tuple[Any, torch.Tensor, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """One decision of all environments; actions are (num_envs, actions) float32 in [-1, 1] on the device.
        With ``autoreset_mode="same_step"``, ``info["final_obs"]`` has a row for each environment, of which
        those in ``info["_final_obs"]`` tell something."""
        actions = self._checked(actions)
        results = self._step_on_gpu(self._lanes, actions) if self._lanes else self._step_on_cpu(actions)
        return self._given(results)  # type: ignore[no-any-return]

    def _step_on_cpu(self, actions: torch.Tensor) -> tuple[Any, ...]:
        observation, reward, terminated, truncated, infos = self._env.step(actions.numpy())
        if "final_obs" in infos:
            infos["final_obs"] = _together(infos["final_obs"], observation)
        return tuple(map(_tensors, (observation, reward, terminated, truncated, infos)))

    def _step_on_gpu(self, lanes: DeviceLanes, actions: torch.Tensor) -> tuple[Any, ...]:
        if not lanes.begun:
            raise ResetNeeded("step was called before reset; call reset() first")
        begins = lanes.due == DUE if self._env.goal_conditioned else None
        now, last = lanes.step(actions)
        observation, infos = self._observation(now), self._infos(now, self._all)
        terminated, truncated = (self._of(now, name) for name in ("terminated", "truncated"))
        reward, ended, before = self._of(now, "reward"), terminated | truncated, observation
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            before = self._observation(last)
            infos |= {"final_obs": before, "_final_obs": ended}
            infos |= {"final_info": self._infos(last, ended), "_final_info": ended}
        if begins is not None:  # the reward of an end belongs to the observation before it
            places = ("achieved_goal", "desired_goal")
            pair = (torch.where(ended[:, None], before[name], observation[name]) for name in places)
            reward = torch.where(begins, 0.0, lanes.goal_reward(*pair))
        return observation, reward, terminated, truncated, infos

    def _checked(self, actions: Any) -> torch.Tensor:
        """Actions, or a ValueError about their kind."""
        shape = self.action_space.shape
        if not isinstance(actions, torch.Tensor):
            raise ValueError(f"actions is of {type(actions).__name__}; give a torch tensor on {self.device}")
        if actions.dtype != torch.float32:
            raise ValueError(
                f"actions has dtype {actions.dtype}; give torch.float32, as actions.float() has it"
            )
        if actions.shape != shape:
            raise ValueError(f"actions has shape {tuple(actions.shape)}; give {shape}")
        if actions.device != self.device:
            raise ValueError(
                f"actions is on {actions.device}; give a tensor on {self.device}: actions.to(device)"
            )
        if not actions.is_contiguous():
            raise ValueError("actions is not contiguous, row after row; give actions.contiguous()")
        return actions.detach()

    def _of(self, tables: Tables, name: str) -> torch.Tensor:
        out: Any = tables[1:]
        return self._env.core.columns.of(out, name)  # type: ignore[no-any-return]

    def _observation(self, tables: Tables) -> Any:
        if not self._env.goal_conditioned:
            return tables[0]
        tip, goal = (
            torch.stack([self._of(tables, name) for name in names], dim=1)
            for names in (TIP, self._env.core.columns.goal)
        )
        return {"observation": tables[0], "achieved_goal": tip, "desired_goal": goal}

    def _infos(self, tables: Tables, mask: torch.Tensor) -> dict[str, Any]:
        columns = self._env.core.columns
        infos: dict[str, Any] = {}
        for name, field in columns.shown.items():
            infos |= {name: self._of(tables, field), f"_{name}": mask}
        if columns.shows_drawn:
            drawn = columns.drawn_of([self._of(tables, field) for field in columns.drawn_fields])
            drawn = {name: torch.stack(x, dim=1) if isinstance(x, list) else x for name, x in drawn.items()}
            infos |= {DRAWN: {**drawn, **{f"_{name}": mask for name in drawn}}, f"_{DRAWN}": mask}
        return infos

    def _given(self, results: Any) -> Any:
        return _cloned(results) if self._copy else results

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any = None) -> torch.Tensor:
        """Goal environments only: the reward of (n, 2) pairs of goals, tensors on the device."""
        if self._lanes is None or not self._env.goal_conditioned:
            return _tensors(self._env.compute_reward(achieved_goal, desired_goal, info))  # type: ignore[no-any-return]
        return self._lanes.goal_reward(achieved_goal, desired_goal)

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generator of each environment, from which the keys of its episodes are drawn; of a GPU
        copies."""
        return self._on_cpu().np_random

    @property
    def state(self) -> dict[str, torch.Tensor]:
        """Copies of what lanes remember from step to step by name, (num_envs,) float64: coordinates, rates,
        states of effects, memory of the task."""
        names = [*self._env.core.memory.layout.rows[STATE]]
        if self._lanes is None:
            rows = torch.from_numpy(self._env.core.memory.read(names).T.copy())
        else:
            rows = self._lanes.state[[self._lanes.layout.rows[STATE][name] for name in names]]
        return dict(zip(names, rows, strict=True))

    # ---- from one device to another ------------------------------------------------------------------------

    def _on_cpu(self) -> ArmVectorEnv:
        """The same environments on a CPU, where these are."""
        if self._lanes is None:
            return self._env
        env = self._made(self.num_envs)
        if self._lanes.begun:
            self._lanes.give(env.core)
            env._ready = True
        return env

    def get_state(self) -> dict[str, Any]:
        """Snapshot of all environments, generators included, as that of ``gymnasium.make_vec``: each takes
        those of the other, on every device, and goes on with the same bits."""
        return self._on_cpu().get_state()

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot; the continuation is the same to the last bit."""
        env = self._env if self._lanes is None else self._made(self.num_envs)
        env.set_state(state)
        if self._lanes is not None:
            self._lanes.take(env.core)

    def __reduce__(self) -> tuple[Any, ...]:
        begun = self._env.core.begun_all if self._lanes is None else self._lanes.begun
        state = self.get_state() if begun else None
        given = self._id, self.num_envs, str(self.device), self._copy, self._kwargs
        return _made_again, (type(self), given, state)


def _made_again(kind: Any, given: Any, state: Any) -> ArmTorchVectorEnv:
    env = kind(*given)
    if state is not None:
        env.set_state(state)
    return env  # type: ignore[no-any-return]


def _tensors(results: Any) -> Any:
    """Arrays as tensors of the same memory."""
    if isinstance(results, dict):
        return {name: _tensors(value) for name, value in results.items()}
    return torch.from_numpy(results) if isinstance(results, np.ndarray) else results


def _cloned(results: Any) -> Any:
    if isinstance(results, dict):
        return {name: _cloned(value) for name, value in results.items()}
    if isinstance(results, tuple):
        return tuple(map(_cloned, results))
    return results.clone() if isinstance(results, torch.Tensor) else results


def _together(rows: Any, like: Any) -> Any:
    """Observations of some environments, None for the others, as arrays with a row for each."""
    if isinstance(like, dict):
        return {name: _together([row and row[name] for row in rows], part) for name, part in like.items()}
    table = np.zeros_like(like)
    for row, values in zip(table, rows, strict=True):
        if values is not None:
            row[:] = values
    return table
