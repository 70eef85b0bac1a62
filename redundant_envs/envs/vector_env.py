"""The environment: many lanes in one compiled call, as a Gymnasium VectorEnv."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from redundant_envs.batch.environment import Autoreset
from redundant_envs.envs.arguments import (
    check_action,
    checked_options,
    checked_seed,
    plain_scene,
    refuse_bad_action,
)
from redundant_envs.envs.core import STATE_KEYS, Core
from redundant_envs.envs.lane_values import LaneValues
from redundant_envs.envs.outputs import Columns, Outputs
from redundant_envs.lane.episode import TIP
from redundant_envs.model import snapshot
from redundant_envs.model.programs import environment_simulator
from redundant_envs.plain_data import check_keys
from redundant_envs.scene import Scene
from redundant_envs.tasks import REGISTRY as TASKS
from redundant_envs.tasks import Task
from redundant_envs.tasks.limits import is_confined
from redundant_envs.values import shown, whole_number

KERNEL_MODE = {mode: Autoreset[mode.name] for mode in AutoresetMode}
ON_BAD_ACTION = ("raise", "terminate")


def info_names(scene: Scene, task: Task) -> list[str]:
    """Keys of ``info`` in an environment of a scene, in order."""
    episode = environment_simulator(scene, task).episode
    assert episode is not None
    return Columns(episode).names


def observation_space(core: Core) -> spaces.Space[Any]:
    """Space of one environment's observation."""
    box = spaces.Box(-1.0, 1.0, (core.obs_size,), np.float32)
    if not core.task.goal_conditioned:
        return box
    far = 2.0 * core.reach if is_confined(core.scene) else np.inf
    place = spaces.Box(-far, far, (2,), np.float64)
    return spaces.Dict({"observation": box, "achieved_goal": place, "desired_goal": place})


class ArmVectorEnv(LaneValues, VectorEnv[Any, Any, Any]):
    """Native vector environment of an arm with a task; made by ``gymnasium.make_vec``.

    Parameters
    ----------
    scene : str or mapping
        Scene by name, path of a YAML file, or plain data.
    num_envs : int
    max_episode_steps : int
        Truncate after so many control steps; -1 never does.
    autoreset_mode : AutoresetMode or str
        "next_step", "same_step" or "disabled".
    on_bad_action : {"terminate", "raise"}
        Effect of a non-finite action on its lane.
    task : mapping
        Numbers of the task other than the defaults.
    render_mode : {None, "rgb_array"}
    accuracy : {"standard", "exact"} or float, optional
        Tip error per control interval [m] of the simulation: 1e-6, 1e-12 or the number given. None
        keeps the scene's own; "standard" if the scene has none.
    threads : int
        Threads over blocks of 8 environments; they change no bit.
    """

    task_name: ClassVar[str] = "Reach"
    env_id: ClassVar[str | None] = None
    """The id that belongs to the class; its scenes have the arm of that id."""

    def __init__(
        self,
        scene: str | Mapping[str, Any],
        num_envs: int = 1,
        max_episode_steps: int | None = 100,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        on_bad_action: str = "terminate",
        task: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
        accuracy: str | float | None = None,
        threads: int = 1,
    ) -> None:
        num_envs = whole_number("num_envs", num_envs)
        self.autoreset_mode = autoreset(autoreset_mode)
        if on_bad_action not in ON_BAD_ACTION:
            raise ValueError(f"on_bad_action is {on_bad_action!r}; choose {', '.join(ON_BAD_ACTION)}")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode is {render_mode!r}; a vector has None or 'rgb_array'")
        self.core = Core(
            plain_scene(scene),
            num_envs,
            make_task(task, self.task_name),
            max_episode_steps,
            accuracy,
            self.env_id,
            threads,
        )
        self.num_envs = num_envs
        self.on_bad_action = on_bad_action
        self.render_mode = render_mode
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": round(1.0 / self.core.scene.control_dt),
            "autoreset_mode": self.autoreset_mode,
        }
        self.goal_conditioned = self.core.task.goal_conditioned
        """Whether observations are goal dictionaries and the reward is that of the goals."""
        self.single_observation_space = observation_space(self.core)
        self.single_action_space = spaces.Box(-1.0, 1.0, (len(self.core.actions),), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._ended = np.zeros(num_envs, dtype=np.bool_)
        self._ready = False
        self._renderer: Any = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_renderer": None}

    def __copy__(self) -> ArmVectorEnv:
        return copy.deepcopy(self)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes.

        Parameters
        ----------
        seed : int, sequence of ints, optional
            Environment i gets ``seed + i``, or its entry of the sequence.
        options : dict, optional
            "reset_mask": (num_envs,) bool, the environments to reset; "q", "qd": (joints,) or (n,
            joints);
            "goal": (2,) or (n, 2) [m]; "parameters": {name: numbers} of the arm, its effects and the
            task, each with a row for each environment or one for all; n counts those reset.
            Parameters are set on top of the environment's own and stay, through autoresets too, until
            a reset of the environment gives "parameters" again ({} returns to the own ones).
        """
        options = checked_options(options)
        mask = options.pop("reset_mask", None)
        if mask is None:
            mask = np.ones(self.num_envs, dtype=np.bool_)
        mask = np.array(mask)
        if mask.dtype != np.bool_ or mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(
                f"options['reset_mask'] has shape {mask.shape} and dtype {mask.dtype}; "
                f"give ({self.num_envs},) bool with at least one True"
            )
        if not self._ready and not mask.all():
            raise ValueError("options['reset_mask'] leaves environments out of the first reset")
        seeds = lane_seeds(seed, self.num_envs)
        checked = self.core.checked(options, np.flatnonzero(mask))
        for lane, value in enumerate(seeds):
            if value is not None and mask[lane]:
                self.core.seed(lane, value)
        self.core.begin(mask, checked)
        obs, out = self.core.observe()
        self._ended[mask] = False
        self._ready = True
        if self.render_mode is not None:
            self._see(out)
        infos = self._infos(out, mask)
        return self.core.observation(obs, out, self.goal_conditioned), infos

    def step(
        self, actions: Any
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """One control step of all environments; actions are (num_envs, joints) in [-1, 1]."""
        if not self._ready:
            raise ResetNeeded("step was called before reset; call reset() first")
        actions = check_action(actions, (self.num_envs, len(self.core.actions)))
        if self.on_bad_action == "raise" and not np.isfinite(actions).all():
            refuse_bad_action(actions[self.core.mask == 0])  # the others are reset and ignore theirs
        core, mode = self.core, self.autoreset_mode
        if mode is AutoresetMode.DISABLED and self._ended.any():
            raise ValueError(
                f"environments {np.flatnonzero(self._ended).tolist()[:8]} have ended; call "
                "reset(options={'reset_mask': mask}) for them first (autoreset_mode is disabled)"
            )
        obs, out, last_obs, last_out = core.step(actions, KERNEL_MODE[mode])
        columns = core.columns
        terminated, truncated = columns.of(out, "terminated"), columns.of(out, "truncated")
        ended = terminated | truncated
        observation = core.observation(obs, out, self.goal_conditioned)
        reward = columns.of(out, "reward")
        if self.goal_conditioned:
            reward = core.goal_reward(observation["achieved_goal"], observation["desired_goal"])
        if self.render_mode is not None:
            self._see(out)
        infos = self._infos(out, None)
        if mode is AutoresetMode.NEXT_STEP and core.begun is not None:
            reward[core.begun] = 0.0
        elif mode is AutoresetMode.SAME_STEP and ended.any():
            lanes = np.flatnonzero(ended)
            last = core.observation(last_obs, last_out, self.goal_conditioned)
            final = np.full(self.num_envs, None, dtype=object)
            for n in lanes.tolist():
                final[n] = {k: v[n] for k, v in last.items()} if self.goal_conditioned else last[n]
            if self.goal_conditioned:
                reward[lanes] = core.goal_reward(last["achieved_goal"][lanes], last["desired_goal"][lanes])
            infos["final_obs"], infos["_final_obs"] = final, ended.copy()
            infos["final_info"] = self._infos(last_out, ended)
            infos["_final_info"] = ended.copy()
        elif mode is AutoresetMode.DISABLED:
            self._ended = ended.copy()
        return observation, reward, terminated, truncated, infos

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """Goal environments only: the compiled reward of (n, 2) pairs of goals."""
        if not self.goal_conditioned:
            raise ValueError("compute_reward belongs to the goal environments (…GoalReach-v0)")
        return self.core.goal_reward(achieved_goal, desired_goal)

    def get_state(self) -> dict[str, Any]:
        """Snapshot of all environments, generators included."""
        own = {"ended": self._ended.copy(), "autoreset_mode": self.autoreset_mode.name.lower()}
        return {**self.core.get_state(), **own}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot; the continuation is the same to the last bit."""
        own = ("ended", "autoreset_mode")
        snapshot.check_keys("state", state, (*own, *STATE_KEYS), "get_state of a vector environment")
        of_core = {key: value for key, value in state.items() if key not in own}
        self.core.check_state(of_core)
        snapshot.check_array("state", "ended", state["ended"], self._ended)
        mode = self.autoreset_mode.name.lower()
        if state["autoreset_mode"] != mode:
            raise ValueError(
                f"state has the autoreset_mode {state['autoreset_mode']!r} and this one {mode!r}; a lane "
                "that waits for its reset in one does not in the other: make the environment with the same"
            )
        self.core.set_state(of_core)
        self._ended = state["ended"].copy()
        self._ready = self.core.begun_all

    def render(self) -> tuple[NDArray[np.uint8], ...]:
        """One picture per environment, (height, width, 3) uint8."""
        if self.render_mode is None:
            raise ValueError("render needs render_mode='rgb_array' at make")
        return tuple(self._made_renderer().draw(lane) for lane in range(self.num_envs))

    def _made_renderer(self) -> Any:
        if self._renderer is None:
            from redundant_envs.envs.rendering import Renderer

            self._renderer = Renderer(self.core)
        return self._renderer

    def _see(self, out: Outputs) -> None:
        """Record the positions of the tips for their trails."""
        columns = self.core.columns
        self._made_renderer().record(columns.of(out, "steps"), columns.points(out, TIP))

    # ---- shapes of returned values ---------------------------------------------------------------

    def _infos(self, out: Outputs, mask: NDArray[np.bool_] | None) -> dict[str, Any]:
        infos: dict[str, Any] = {}
        columns = self.core.columns
        present = np.ones(
            (len(columns.names), self.num_envs), np.bool_
        )  # a line for each: one call, not many
        if mask is not None:
            present &= mask
        for name, (_, table, row), valid in zip(columns.names, columns.places_shown, present, strict=True):
            infos[name] = out[table][row]
            infos[f"_{name}"] = valid
        return infos


def make_task(given: Mapping[str, Any] | None, name: str) -> Task:
    """The task of a name, with the numbers of the keyword argument; a "type" in it must be the same name."""
    kind = TASKS[name]
    if given is None:
        return kind()
    valid = [field.name for field in dataclasses.fields(kind)]
    if not isinstance(given, Mapping):
        raise ValueError(f"task is {shown(given)}; give a mapping of {', '.join(valid)}")
    check_keys("task", given, ["type", *valid])
    if given.get("type", name) != name:
        raise ValueError(
            f"task.type is {shown(given['type'])} and the environment's task is {name}; make the id of that "
            f"task (registered: {', '.join(TASKS)})"
        )
    return kind(**{key: value for key, value in given.items() if key != "type"})


def autoreset(mode: AutoresetMode | str) -> AutoresetMode:
    """An autoreset mode from itself or its name."""
    names = {m.name.lower(): m for m in AutoresetMode}
    if isinstance(mode, AutoresetMode):
        return mode
    key = str(mode).lower().replace("-", "_")
    if key not in names:
        raise ValueError(f"autoreset_mode is {mode!r}; choose {', '.join(names)}")
    return names[key]


def lane_seeds(seed: Any, count: int) -> list[int | None]:
    """One seed per lane from Gymnasium's seed argument."""
    if seed is None:
        return [None] * count
    if isinstance(seed, np.ndarray):
        seed = list(np.atleast_1d(seed))
    if isinstance(seed, Sequence) and not isinstance(seed, str | bytes):
        if len(seed) != count:
            raise ValueError(f"seed has {len(seed)} entries; give one per environment, {count}")
        return [checked_seed(f"seed[{i}]", s) for i, s in enumerate(seed)]
    first = checked_seed("seed", seed)
    assert first is not None
    return [first + i for i in range(count)]
