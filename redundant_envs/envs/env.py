"""One environment: the view of a core with one lane, and its steps without the loop over blocks."""

import functools
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from redundant_envs.compiler.tracing.flow import LANES
from redundant_envs.envs.arguments import check_action, checked_seed, refuse_bad_action
from redundant_envs.envs.core import Core
from redundant_envs.envs.face import PICTURE_SIZE, EnvBase
from redundant_envs.envs.options import checked_options
from redundant_envs.envs.outputs import DRAWN, Columns, Outputs
from redundant_envs.model.memory import IN_USE, alone, first
from redundant_envs.model.programs import Team
from redundant_envs.simulator.batch.environment import Autoreset, KernelCall
from redundant_envs.simulator.lane.episode import TABLES, TIP
from redundant_envs.tasks import make_task

FORMATS = {"flags": "?", "counts": "q", "values": "d"}
"""Numbers of the tables for :mod:`struct` and NumPy; a row has one for each lane of a block."""


class ArmEnv(EnvBase, gym.Env[Any, Any]):
    """A torque-controlled arm with a task; made by ``gymnasium.make``."""

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 50}
    _lanes = 0

    def __init__(
        self,
        scene: str | Mapping[str, Any],
        accuracy: str | float | None = None,
        render_mode: str | None = None,
        on_bad_action: str = "raise",
        task: Mapping[str, Any] | None = None,
        terminate_on_touch: bool | None = None,
        randomize: bool = True,
        observe_parameters: Sequence[str] = (),
        info_keys: Sequence[str] | str | None = None,
        action: str | None = None,
        decide_every: int = 1,
        render_width: int = PICTURE_SIZE,
        render_height: int = PICTURE_SIZE,
    ) -> None:
        self._check_choices(on_bad_action, render_mode, render_width, render_height)
        if render_mode == "human":
            from redundant_envs.envs.rendering import display

            display()  # a missing package or display is reported at once, not at the first step
        core = Core(
            scene, 1, make_task(task, self.task_name, terminate_on_touch), None, accuracy, self.env_id,
            randomize=randomize, observe_parameters=observe_parameters, info_keys=info_keys, action=action,
            decide_every=decide_every,
        )  # fmt: skip
        core.limit_decisions()
        self.observation_space, self.action_space = self._take(core)
        self._operation: KernelCall | None = None  # kind of step; None if the next call has to be a reset

    @functools.cached_property
    def _lane(self) -> "SingleLane":
        return SingleLane(self.core)

    @first
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin a new episode.

        Parameters
        ----------
        seed : int, optional
        options : dict, optional
            "q", "qd": (joints,); "goal": (2,) [m]; "parameters": {name: numbers} of the arm, its effects
            and the task, set on top of the environment's own and kept until a reset gives "parameters"
            again ({} returns to the own ones).
        """
        options = checked_options(options)
        if "reset_mask" in options:
            raise ValueError("options['reset_mask'] belongs to vector environments")
        lanes = np.ones(1, dtype=np.bool_)
        checked = self.core.checked(options, np.flatnonzero(lanes))
        super().reset(seed=checked_seed("seed", seed))
        if self.core.generators[0] is not self.np_random:
            self.core.generators[0] = self.np_random
            self.core.waiting[0] = False
        self.core.begin(lanes, checked, self._lane.run)
        obs = self._lane.run(KernelCall.OBSERVE)
        self._begin()
        if self.render_mode is not None:
            self._show()
        return obs, self._lane.unpack(self._lane.read())[-1]

    def _begin(self) -> None:
        self._operation = KernelCall.CHECKED_STEP if self.on_bad_action == "raise" else KernelCall.STEP

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One decision, by default one control step; the action is (actions,) in [-1, 1], in units of
        ``scene.action_units()``: by default (joints,) in units of the effort limits."""
        if self._operation is None:
            when = "after the end of the episode" if self.core.begun_all else "before reset"
            raise gym.error.ResetNeeded(f"step was called {when}; call reset() first")
        obs, (terminated, truncated, reward, info) = self._lane.step(action, self._operation)
        if reward != reward and self._operation == KernelCall.CHECKED_STEP:
            refuse_bad_action(np.asarray(action, np.float32))
        if terminated or truncated:
            self._operation = None
            self.core.ended[0] = True
        if self.render_mode is not None:
            self._show()
        return obs, reward, terminated, truncated, info

    @first
    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot; the continuation is the same to the last bit."""
        super().set_state(state)
        self._begin()
        if not self.core.begun_all or self.core.ended.any():
            self._operation = None
        if (generator := self.core.generators[0]) is not None:
            self._np_random = generator

    def get_wrapper_attr(self, name: str) -> Any:
        """An attribute, or a number such as ``goal_tolerance``, as vectors ask for it."""
        return self._attribute(name)

    def has_wrapper_attr(self, name: str) -> bool:
        """Whether there is an attribute or a number of this name."""
        return hasattr(self, name) or self._is_number(name)

    def set_wrapper_attr(self, name: str, value: Any, *, force: bool = True) -> bool:
        """Set an attribute, or a number from the next episode on, without ``force`` only if it is there;
        returns whether it was set. ValueError for an argument, which wrappers would set for themselves."""
        there = force or self.has_wrapper_attr(name) or self._is_of_make(name)
        if there:
            setattr(self, name, value)
        return there

    @alone
    def _show(self) -> None:
        """Record the position of the tip for its trail; in the mode "human", show the picture."""
        self._see(self._lane.outputs.lanes(slice(1)))
        if self.render_mode == "human" and self._renderer.is_due():
            self._renderer.show(self._drawn()[0])

    @first
    def render(self) -> NDArray[np.uint8] | None:
        """A picture, (height, width, 3) uint8; None without a render mode and in the mode "human", which
        shows the picture in a window, that of every step without a call, and waits while it is paused."""
        if self.render_mode is None:
            gym.logger.warn("render was called without a render_mode; make(..., render_mode='rgb_array')")
            return None
        picture = self._drawn()[0]
        return self._renderer.show(picture) if self.render_mode == "human" else picture

    def close(self) -> None:
        """Close the window if there is one."""
        if "_renderer" in self.__dict__:
            self._renderer.close()


class GoalArmEnv(ArmEnv):
    """The goal-conditioned form: Dict observations and a reward of the two goals alone, for HER."""

    task_name = "GoalReach"

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One control step; the reward is 1 at the goal and 0 elsewhere."""
        obs, _, terminated, truncated, info = super().step(action)
        reward = self.compute_reward(obs["achieved_goal"], obs["desired_goal"], info)
        return obs, reward, terminated, truncated, info

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """The compiled reward of one pair (2,) or of many (n, 2) of achieved and desired goals."""
        reward = self.core.goal_reward(achieved_goal, desired_goal)
        return float(reward[0]) if np.ndim(achieved_goal) == 1 else reward


class SingleLane:
    """The one lane of a core: calls of the same kernel, with buffers that are reused from step to step."""

    def __init__(self, core: Core) -> None:
        columns = core.columns
        self._team = Team(core.simulator, "environment", core.memory, 1, [core.key_table])
        (part,) = self._team.parts
        self.action = np.zeros(len(core.actions), dtype=np.float32)
        self._action: Any = self.action.data  # faster to write than the array itself
        obs = np.zeros((LANES, core.obs_size), dtype=np.float32)
        self._copied_obs = obs[0].copy
        self._seen: Callable[[], Any] = self._goals_seen if core.task.goal_conditioned else self._copied_obs
        # Tables for the lanes of a block side by side in memory, so that one call reads all of them.
        kinds = [(table, FORMATS[table], (len(names), LANES)) for table, names in columns.tables.items()]
        rows: Any = np.zeros(1, kinds)
        self._buffer = memoryview(rows.view(np.uint8))
        self.outputs = Outputs(*(rows[table][0] for table in columns.tables))
        self.read, self.unpack = self._telling(columns)
        """Numbers of the last step; from these how the episode ended, reward, and ``info``."""
        self._points: Callable[[], tuple[float, ...]] = self._reading(columns, (*TIP, *columns.goal))
        self._memory = core.memory
        self._operation, self._version = -1, -1  # those of the last call
        self._call = self._team if self._team.is_long else functools.partial(part.entry, part.address)
        tables = dict(zip(TABLES, self.outputs, strict=True))
        core.set_decision(self._team)
        part.set(
            actions=self.action, obs=obs, stride=LANES, last_obs=obs, episode_keys=core.key_table, any_due=0,
            autoreset=Autoreset.DISABLED, **tables, **{f"last_{name}": t for name, t in tables.items()},
        )  # fmt: skip

    def _reading(self, columns: Columns, names: Any) -> Any:
        """A function that reads some quantities of the last step; they must be in the order of the tables."""
        form = ["="]
        for table, present in columns.tables.items():
            letter = FORMATS[table]
            size = struct.calcsize(letter)
            form += [f"{letter}{(LANES - 1) * size}x" if n in names else f"{LANES * size}x" for n in present]
        return functools.partial(struct.Struct("".join(form)).unpack_from, self._buffer)

    def _telling(self, columns: Columns) -> tuple[Callable[[], Any], Callable[[Any], Any]]:
        drawn = columns.drawn_fields if columns.shows_drawn else ()
        names = {column: name for name, column in columns.shown.items()}
        wanted = {"terminated", "truncated", "reward", *names, *drawn}
        read = [column for table in columns.tables.values() for column in table if column in wanted]
        entries = [f"{names[column]!r}: x[{k}]" for k, column in enumerate(read) if column in names]
        if drawn:  # they are the last
            entries.append(f"{DRAWN!r}: drawn_of(x[-{len(drawn)}:])")
        # A dict that is written out takes half the time of dict(zip(...)).
        ends = ", ".join(f"x[{read.index(name)}]" for name in ("terminated", "truncated", "reward"))
        unpack = eval(f"lambda x: ({ends}, {{{', '.join(entries)}}})", {"drawn_of": columns.drawn_of})
        return self._reading(columns, read), unpack

    def _goals_seen(self) -> dict[str, NDArray[Any]]:
        places = np.array(self._points())
        return {"observation": self._copied_obs(), "achieved_goal": places[:2], "desired_goal": places[2:]}

    def run(self, operation: int) -> Any:
        """Run an operation of the kernel; returns the observation."""
        (part,) = self._team.parts
        part.set(operation=operation)
        part.set_pointers()
        self._operation, self._version = operation, part.version
        self._team()
        return self._seen()

    def step(self, action: Any, operation: int) -> tuple[Any, Any]:
        """One control step, by STEP or CHECKED_STEP; gives the observation, and what ``unpack`` returns."""
        memory = self._memory
        if self._version != memory.free or operation != self._operation:
            return self._step_otherwise(action, operation)
        memory.free = IN_USE  # as alone does, in a fifth of its time
        try:
            try:
                self._action[:] = action  # takes only float32 of this shape
            except (TypeError, ValueError, BufferError):
                self._action[:] = check_action(action, self.action.shape)
            self._call()
            return self._seen(), self.unpack(self.read())
        finally:
            memory.free = self._version

    @first
    def _step_otherwise(self, action: Any, operation: int) -> tuple[Any, Any]:
        """The same after another operation, or with other arrays than before."""
        self._action[:] = check_action(action, self.action.shape)
        return self.run(operation), self.unpack(self.read())
