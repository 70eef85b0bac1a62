"""What all kinds of environments share: values that users may read, numbers with units, pictures."""

from __future__ import annotations

import copy
import dataclasses
import functools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, Self

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from redundant_envs.envs.arguments import check_action, refuse_bad_action
from redundant_envs.envs.core import Core
from redundant_envs.envs.options import checked_options
from redundant_envs.envs.outputs import Outputs
from redundant_envs.envs.registration import ARGUMENTS, OF_PICTURES
from redundant_envs.model.memory import alone, first
from redundant_envs.model.parameters import lanes_of
from redundant_envs.scenes.numbers import names_of
from redundant_envs.scenes.scene import Scene
from redundant_envs.simulator.batch.environment import Autoreset
from redundant_envs.simulator.lane.episode import TIP
from redundant_envs.support.tables import table
from redundant_envs.support.values import plain_data, shown, whole_number
from redundant_envs.tasks.base import is_confined

LANE_VALUES = ("q", "qd", "tip", "goal", "parameters")  # properties that lanes have each for itself
MOVING = ("core", "_memory", "_np_random", "_actions")  # attributes that steps change
MADE_ANEW = ("_renderer", "_lane")  # attributes that copies make when they need them
SHARED = ("on_bad_action", "render_mode", "metadata")  # attributes of all together that set_attr sets
AT_MAKE = {*ARGUMENTS, *OF_PICTURES, "autoreset_mode", "threads"} - {*SHARED}
"""Arguments of environments that later changes do not reach."""
PICTURE_SIZE, MIN_SIZE, MAX_SIZE = 480, 32, 4096
"""Sizes of pictures, px: by default, and the least and the largest that one may ask for."""
OF_ARM = {"m": "masses", "l": "lengths"}
"""First letters of the numbers of an arm, and the names that users give to all of them."""
COPIES = (
    "numbers of an environment are copies, which change nothing; set them by reset(options=...) or "
    "set_options(...), with 'q', 'qd', 'goal' or 'parameters': {name: numbers}"
)


class Copy(np.ndarray[Any, np.dtype[np.float64]]):
    """Numbers that refuse to be written to, because that would change nothing."""

    def __setitem__(self, place: Any, value: Any) -> None:
        if not self.flags.writeable:  # a copy of it, or a result, may be written to
            raise ValueError(COPIES)
        super().__setitem__(place, value)

    def __repr__(self) -> str:
        return repr(np.asarray(self))


def read_only(numbers: NDArray[np.float64]) -> Copy:
    """New numbers, from now on without a way to write to them."""
    numbers.flags.writeable = False
    return numbers.view(Copy)


@dataclasses.dataclass(frozen=True, eq=False)
class Parameter:
    """A number of an environment, or several with one name: ``value`` and ``unit``. In a vector the value is
    (num_envs,), or (num_envs, entries) of several; a single environment's has no first axis. There is one
    unit, or one for each entry where they differ; "" if none is declared."""

    value: Any
    unit: str | tuple[str, ...]


class Parameters(Mapping[str, Parameter]):
    """Copies of numbers by name, in the order of arm, effects and task; ``print`` shows a table."""

    def __init__(self, by_name: Mapping[str, Parameter]) -> None:
        self._found = dict(by_name)

    def __getitem__(self, name: str) -> Parameter:
        return self._found[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)

    def __setitem__(self, name: str, value: Any) -> None:
        raise ValueError(COPIES)

    def of_lane(self, lane: int) -> Parameters:
        """Those of one environment of a vector."""
        return Parameters({name: Parameter(p.value[lane], p.unit) for name, p in self.items()})

    def __repr__(self) -> str:
        vector = all(np.ndim(p.value) for p in self.values())  # a single one has numbers without an axis
        rows = []
        for name, p in self.items():
            entries = np.atleast_2d(p.value.T if vector else np.atleast_1d(p.value)[:, None])
            ends = [(f"{e.min():.5g}", f"{e.max():.5g}") for e in entries]  # where environments differ
            value = ", ".join(low if low == high else f"{low} to {high}" for low, high in ends)
            rows.append((name, value, p.unit if isinstance(p.unit, str) else ", ".join(p.unit)))
        return table(("name", "value in each environment" if vector else "value", "unit"), rows, "<")


def parameters_of(core: Core) -> Parameters:
    scene, task = core.scene, core.task
    units = {**scene.robot.units, **task.units, **scene.units()}
    named: dict[str, list[str]] = {}
    for name in scene.parameters():
        named.setdefault(name.split("[")[0] if "." in name else OF_ARM[name[0]], []).append(name)
    named.update({name: [name] for name in task.parameters()})
    by_name = {}
    for name, entries in named.items():
        each = tuple(units.get(entry, units.get(name, "")) for entry in entries)
        value = values_of(core, entries, entries == [name])
        by_name[name] = Parameter(value, each if len({*each}) > 1 else each[0])
    return Parameters(by_name)


def numbers_of(core: Core) -> dict[str, NDArray[np.float64]]:
    """What a controller may know of episodes: the numbers in force, the task's memory, and ``limit``, their
    control steps (inf without a limit), and ``decide_every``, by their names; (num_envs,), or (num_envs,
    entries) of several with one name."""
    memory = core.memory.read(core.task.memory).T if core.task.memory else ()
    numbers = {name: np.asarray(p.value) for name, p in parameters_of(core).items()}
    limit = core.memory.read(("limit",))[:, 0]
    every = np.full(core.num_envs, core.decide_every)
    memory_of = dict(zip(core.task.memory, memory, strict=True))
    return {**numbers, **memory_of, "limit": limit, "decide_every": every}


def values_of(core: Core, names: Sequence[str], single: bool) -> NDArray[np.float64]:
    """Scalar parameters of all lanes, (lanes, names), or (lanes,) of a single one."""
    value = core.memory.read([*map(core.memory.dynamics.parameters.field_of, names)])
    return read_only(value[:, 0].copy() if single else value)


class EnvBase:
    """A core as users see it: its scene, and read-only copies of coordinates, velocities, tips, goals and
    numbers of its lanes. Options of a reset, or :meth:`set_options`, set them; a number set as an attribute,
    such as ``goal_tolerance``, is that of the next episode."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}
    task_name: ClassVar[str] = "Reach"
    env_id: ClassVar[str | None] = None  # that of the class; its scenes have the arm of that id
    _lanes: ClassVar[Any] = slice(None)  # of a single environment 0: its values have no first axis
    core: Core

    def _check_choices(
        self, on_bad_action: str, render_mode: str | None, render_width: int, render_height: int
    ) -> None:
        """Take arguments, or refuse them before a core is made."""
        self._check_choice("on_bad_action", on_bad_action)
        self._check_choice("render_mode", render_mode)
        for name, size in {"render_width": render_width, "render_height": render_height}.items():
            if not MIN_SIZE <= whole_number(name, size) <= MAX_SIZE:
                raise ValueError(f"{name} is {shown(size)} pixels; give {MIN_SIZE} to {MAX_SIZE}")
        self.on_bad_action, self.render_mode = on_bad_action, render_mode
        self._size = int(render_width), int(render_height)

    def _check_choice(self, name: str, value: Any) -> None:
        """ValueError unless a value is one of those that an attribute can have."""
        modes = (None, *type(self).metadata["render_modes"])
        valid = {"on_bad_action": ("raise", "terminate"), "render_mode": modes}.get(name)
        if valid and value not in valid:
            raise ValueError(f"{name} is {shown(value)}; choose {' or '.join(map(repr, valid))}")

    def _take(self, core: Core) -> tuple[spaces.Space[Any], spaces.Box]:
        """Take the core; gives the spaces of one environment's observation and action."""
        self.core, self._memory = core, core.memory
        self.goal_conditioned = core.task.goal_conditioned  # observations are goal dictionaries
        self.metadata = {**self.metadata, "render_fps": core.frames_per_second}
        # Observed quantities are within -1 to 1, and the numbers after them within their ranges.
        of_task = [(-1.0, 1.0)] * (core.obs_size - len(core.bounds))
        low, high = np.array([*of_task, *core.bounds], dtype=np.float32).T
        seen: spaces.Space[Any] = spaces.Box(low, high, dtype=np.float32)
        if self.goal_conditioned:
            far = 2.0 * core.reach if is_confined(core.scene) else np.inf
            place = spaces.Box(-far, far, (2,), np.float64)
            seen = spaces.Dict({"observation": seen, "achieved_goal": place, "desired_goal": place})
        return seen, spaces.Box(-1.0, 1.0, (len(core.actions),), np.float32)

    @first
    def __getstate__(self) -> dict[str, Any]:
        state = {name: x for name, x in self.__dict__.items() if name not in MADE_ANEW}
        moving = {name: state[name] for name in MOVING if name in state}
        return {**state, **copy.deepcopy(moving)}  # other threads may go on until the state is written

    def __copy__(self) -> Self:
        return copy.deepcopy(self)

    def _attribute(self, name: str) -> Any:
        """An attribute, or a number that is in force by its name. (``__getattr__`` would do this for every
        way to ask, and slow down every attribute.)"""
        if name in LANE_VALUES or hasattr(self, name) or not self._is_number(name):
            return getattr(self, name)
        entries = names_of(self.scene, name, self.core.task.parameters())
        return values_of(self.core, entries, len(entries) == 1)[self._lanes]

    def __setattr__(self, name: str, value: Any) -> None:
        if name in LANE_VALUES:
            raise AttributeError(f"{name} cannot be set: {COPIES}")
        if self._is_of_make(name):
            raise ValueError(self._refusal(name))
        if name in SHARED:
            self._check_choice(name, value)
        if name == "spec" and value is not None:  # as it was given, a file could not hold it
            kwargs = plain_data(value.kwargs)
            steps = kwargs.get("max_episode_steps", plain_data(value.max_episode_steps))  # a vector's own
            steps = None if steps == -1 else steps
            value = dataclasses.replace(value, kwargs=kwargs, max_episode_steps=steps)
        if name in self.__dict__ or hasattr(type(self), name) or not self._is_number(name):
            object.__setattr__(self, name, value)
        else:
            self.core.let_wait({"parameters": {name: value}}, np.arange(self.core.num_envs), keep=True)

    def _is_number(self, name: str) -> bool:
        """Whether a name is that of numbers of the arm, of an effect or of the task."""
        if "core" not in self.__dict__ or name.startswith("_"):
            return False
        try:
            return bool(names_of(self.scene, name, self.core.task.parameters()))
        except ValueError:
            return False

    def _is_of_make(self, name: str) -> bool:
        """Whether a name is that of an argument, or of a field of the task, that no later change reaches."""
        if "core" not in self.__dict__ or name.startswith("_") or self._is_number(name):
            return False
        return name in AT_MAKE or name in {field.name for field in dataclasses.fields(self.core.task)}

    def _refusal(self, name: str) -> str:
        """The message about an attribute that would change nothing."""
        fix = "make another environment with it, " if self._is_of_make(name) else ""
        return (
            f"set_attr({name!r}) would have no effect; {fix}use set_options(...) with 'q', 'qd', 'goal' or "
            f"'parameters', or name one of these: {', '.join(self.parameters)}; or for all environments "
            f"{', '.join(SHARED)}"
        )

    def set_options(self, options: Mapping[str, Any] | None = None) -> None:
        """Options of the next episode, as ``reset`` takes them; without any, forget those that wait. They are
        in force when the next episode begins. Its reset may have options of its own, which replace those of
        the same name. A start or a goal is that of one episode; parameters stay until options give
        "parameters" again. Options that wait are none of :meth:`get_state`. A ValueError says why the next
        episode could not begin with them; nothing changes then."""
        self.core.let_wait(checked_options(options), np.arange(self.core.num_envs))

    @property
    def scene(self) -> Scene:
        """The scene: arm, effects, and how it is simulated."""
        return self.core.scene

    @property
    @first
    def parameters(self) -> Parameters:
        """Names, values and units of all numbers, of arm, effects and task."""
        return parameters_of(self.core).of_lane(self._lanes)

    @property
    def q(self) -> NDArray[np.float64]:
        """Generalized coordinates, (num_envs, joints), or (joints,) of a single environment; rad and m."""
        return read_only(self.core.memory.read(self.core.scene.robot.coordinates))[self._lanes]

    @property
    def qd(self) -> NDArray[np.float64]:
        """Generalized velocities, (num_envs, joints), or (joints,) of a single environment; rad/s and m/s."""
        return read_only(self.core.memory.read(self.core.scene.robot.rates))[self._lanes]

    @property
    def tip(self) -> NDArray[np.float64]:
        """Position of the tip, (num_envs, 2), or (2,) of a single environment; m."""
        _, out = self.core.observe()
        return read_only(self.core.columns.points(out, TIP))[self._lanes]

    @property
    def goal(self) -> NDArray[np.float64]:
        """Position of the goal, (num_envs, 2), or (2,) of a single environment; m."""
        return read_only(self.core.goals())[self._lanes]

    @first
    def get_state(self) -> dict[str, Any]:
        """Snapshot of all environments, generators included; wrappers (TimeLimit) count for themselves."""
        return self.core.get_state()

    @alone
    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot; the continuation is the same to the last bit."""
        self.core.set_state(state)
        self._begin_trails()

    @functools.cached_property
    def _renderer(self) -> Any:
        from redundant_envs.envs.rendering import Renderer

        return Renderer(self.core, *self._size)

    def _see(self, out: Outputs) -> None:
        """Record the positions of the tips for their trails."""
        columns = self.core.columns
        self._renderer.record(columns.of(out, "steps"), columns.points(out, TIP))

    def _drawn(self) -> list[NDArray[np.uint8]]:
        """A picture of each environment; ResetNeeded before their first reset."""
        if not self.core.begun_all:
            raise ResetNeeded("render was called before reset; call reset() first")
        return [self._renderer.draw(lane) for lane in range(self.core.num_envs)]

    def _begin_trails(self) -> None:
        """Let trails begin where the tips are, as after a state was set."""
        if "_renderer" in self.__dict__:
            self._renderer.clear()
            self._see(self.core.observe()[1])


class VectorEnvBase(EnvBase):
    """The same for many lanes."""

    _ready = False

    @first
    def set_options(self, options: Any = None, index: ArrayLike | None = None) -> None:
        """Options of the next episode of each environment, which a reset or an autoreset begins; as those of
        :meth:`EnvBase.set_options`.

        Parameters
        ----------
        options : mapping, list of mappings, or None
            Of all environments that ``index`` names, each array with a row for each of them or one for all;
            or one mapping for each. An empty one, or None, forgets those that wait.
        index : array_like, optional
            Numbers of environments, or a mask (num_envs,); None is all.
        """
        core, lanes = self.core, lanes_of(index, self.core.num_envs)
        if not isinstance(options, list | tuple):
            core.let_wait(checked_options(options), lanes)
            return
        if len(options) != len(lanes):
            raise ValueError(f"options has {len(options)} entries; give one per environment, {len(lanes)}")
        before = core.waiting_options
        try:
            for lane, one in zip(lanes, options, strict=True):
                core.let_wait(checked_options(one), np.array([lane]))
        except ValueError:
            core.waiting_options = before
            raise

    def _each(self, name: str) -> list[Any]:
        """An attribute, once for each environment: coordinates and numbers each of its own."""
        value = self._attribute(name)
        if name == "parameters":
            return [value.of_lane(lane) for lane in range(self.core.num_envs)]
        per_lane = name in LANE_VALUES or (not hasattr(self, name) and self._is_number(name))
        return [*value] if per_lane else [value] * self.core.num_envs

    def _set_for(self, name: str, value: Any, lanes: NDArray[np.int64]) -> None:
        """Set a number of some environments, or an attribute that is there and that all of them share."""
        if self._is_number(name) and name not in self.__dict__:
            self.core.let_wait({"parameters": {name: value}}, lanes, keep=True)
            return
        if name not in SHARED or len(lanes) != self.core.num_envs:
            raise ValueError(self._refusal(name))
        setattr(self, name, value)

    @first
    def set_state(self, state: Mapping[str, Any], index: ArrayLike | None = None) -> None:
        """Return to a snapshot; the continuation is the same to the last bit.

        Parameters
        ----------
        state : mapping
            What :meth:`get_state` returned, here or from a single environment. The episode of a single one
            continues in each environment that ``index`` names; the episodes after it are the vector's own.
        index : array_like, optional
            Numbers of environments, or a mask (num_envs,), for the state of a single one; None is all.
        """
        generators = state.get("generators") if isinstance(state, Mapping) else None
        of_one = isinstance(generators, list) and len(generators) == 1 < self.core.num_envs
        if index is None and not of_one:
            super().set_state(state)
        else:
            self.core.take_state(state, lanes_of(index, self.core.num_envs))
            self._begin_trails()
        self._ready = self.core.begun_all

    def _checked_actions(self, actions: Any) -> NDArray[np.float32]:
        """Actions of a step as float32, or an error that says what to do first or what to give."""
        if not self._ready:
            raise ResetNeeded("step was called before reset; call reset() first")
        actions = check_action(actions, (self.core.num_envs, len(self.core.actions)))
        if self.on_bad_action == "raise" and not np.isfinite(actions).all():
            refuse_bad_action(actions[self.core.mask == 0])  # the others are reset and ignore theirs
        return actions

    def _begun(
        self, mask: NDArray[np.bool_], seeds: Sequence[int | None], options: Mapping[str, Any]
    ) -> tuple[Any, Outputs]:
        """Begin episodes in the environments of a mask; observations and outputs."""
        core = self.core
        checked = core.checked(options, np.flatnonzero(mask))
        seeded = {lane: seed for lane, seed in enumerate(seeds) if seed is not None and mask[lane]}
        core.waiting[[*seeded]] = False  # their next keys are of new generators
        core.episode_keys.seed(np.array([*seeded], dtype=np.int64), [*seeded.values()])
        core.begin(mask, checked)
        obs, out = core.observe()
        self._ready = True
        if self.render_mode is not None:
            self._see(out)
        return core.observation(obs, out), out

    def _stepped(
        self, actions: NDArray[np.float32]
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], Outputs, Any, Outputs]:
        """A control step: observations, rewards, which lanes ended an episode, outputs, and observations and
        outputs before an autoreset. The reward of an end belongs to the observation before it."""
        core, columns = self.core, self.core.columns
        obs, out, last_obs, last_out = core.step(actions, core.autoreset)
        ended = columns.of(out, "terminated") | columns.of(out, "truncated")
        last = observation = core.observation(obs, out)
        if core.autoreset == Autoreset.SAME_STEP and ended.any():
            last = core.observation(last_obs, last_out)
        reward = columns.of(out, "reward")
        if self.goal_conditioned:
            pair = ("achieved_goal", "desired_goal")
            reward = core.goal_reward(*(np.where(ended[:, None], last[g], observation[g]) for g in pair))
        if self.render_mode is not None:
            self._see(out)
        return observation, reward, ended, out, last, last_out

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """Goal environments only: the compiled reward of (n, 2) pairs of goals."""
        if not self.goal_conditioned:
            raise ValueError("compute_reward belongs to the goal environments (…GoalReach-v0)")
        return self.core.goal_reward(achieved_goal, desired_goal)


def observation_of(batch: Any, lane: int) -> Any:
    """One environment's part of a batch of observations, which are an array or a dictionary of arrays."""
    return {k: v[lane] for k, v in batch.items()} if isinstance(batch, dict) else batch[lane]
