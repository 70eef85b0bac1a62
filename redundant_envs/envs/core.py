"""The one implementation behind all environments: a batch of lanes and its compiled task."""

import copy
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.compiler.tracing.flow import LANES
from redundant_envs.envs import arguments, options
from redundant_envs.envs.keys import EpisodeKeys
from redundant_envs.envs.outputs import Columns, Outputs
from redundant_envs.envs.registration import check_arm, check_motors
from redundant_envs.language.quantities import Quantities
from redundant_envs.model import parameters
from redundant_envs.model.memory import IN_USE, KEPT, NOBODY, Memory, aligned, alone
from redundant_envs.model.programs import Call, Copied, Simulator, Team, address, environment_simulator
from redundant_envs.scenes.scene import Scene, scene_at
from redundant_envs.simulator.batch.environment import (
    BEGUN,
    DECISION,
    DUE,
    EPISODE_KEY,
    Autoreset,
    KernelCall,
)  # fmt: skip
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.episode import ENDS, TIP, Episode
from redundant_envs.simulator.lane.fields import Layout
from redundant_envs.support.values import shown, whole_number
from redundant_envs.tasks.base import Task, range_of_starts
from redundant_envs.tasks.checks import check_task

OF_LANES = ("keys", "mask", "waiting", "ended")
STATE_KEYS = ("states", "parameters", *OF_LANES, "generators", "simulator")
Tables = tuple[NDArray[np.float32], Outputs, NDArray[np.float32], Outputs]
"""Observations, with a row for each lane, and outputs, with a column; those before an autoreset."""


def start_ranges(scene: Scene, task: Task) -> list[tuple[float, float]]:
    """Range of the starts of each joint in a scene, inside its limits."""
    values = {**scene.parameters(), **task.parameters()}
    return [range_of_starts(task, scene, k, values.__getitem__) for k in range(len(scene.robot.joints))]


def first_memory(episode: Episode, layout: Layout, count: int, max_episode_steps: Any) -> Memory:
    """The memory of lanes before their first episode: every joint is in the middle of its starts."""
    numbers = {**episode.task.parameters(), "limit": arguments.episode_limit(max_episode_steps)}
    numbers |= episode.randomized.numbers()
    memory = Memory(episode.dynamics, layout, count, numbers, bool(episode.randomized.entries))
    ranges = enumerate(start_ranges(episode.dynamics.scene, episode.task), 1)
    named = {f"phi{k}": 0.5 * (low + high) for k, (low, high) in ranges}
    at_rest = Quantities(named, (episode.arm.coordinates_of_joints,), {})
    for name in episode.arm.coordinates:
        memory.column(name)[:] = at_rest[name]
    return memory


class Core(Copied):
    """Lanes of a scene, with a task. Lane i owns ``np_random(seed + i)``; each episode draws one 128-bit key
    from it, and all else of the episode follows from that key inside the compiled code."""

    made_anew = "keys", "mask", "_key_address", "_offsets", "_team", "_goal_rewards", "_facts", "_single"

    def __init__(
        self,
        scene: str | Mapping[str, Any] | Scene,
        num_envs: int,
        task: Task,
        max_episode_steps: int | None = None,
        accuracy: str | float | None = None,
        env_id: str | None = None,
        threads: int = 1,
        randomize: bool = True,
        observe_parameters: Sequence[str] = (),
        info_keys: Any = None,
        autoreset: Autoreset = Autoreset.DISABLED,
        action: str | None = None,
        decide_every: int = 1,
    ) -> None:
        self.decide_every, self.env_id = arguments.decision(decide_every), env_id
        self.autoreset = autoreset
        self.scene = arguments.with_mode(scene_at(scene, accuracy), action)
        self.task: Any = task  # its numbers are its own
        check_motors(self.scene)
        check_arm(env_id, self.scene.robot.kind)
        check_task(task, self.scene)
        self.simulated = arguments.simulated(self.scene, task, randomize)
        self.observed = arguments.observed(self.scene, task, observe_parameters)
        self.bounds = arguments.bounds(self.scene, task, self.observed)  # of numbers that observations show
        self.num_envs = num_envs
        self.threads = whole_number("threads", threads)
        self.simulator = self._found_simulator(vars(self))
        self.max_episode_steps = arguments.episode_limit(max_episode_steps)
        self.memory = first_memory(self.episode, self.simulator.layout, num_envs, max_episode_steps)
        self._memory = self.memory
        self.begun: NDArray[np.bool_] | None = None  # lanes that began an episode in the last step, if any
        self.waiting_options: options.Given = {}  # of episodes that have not begun yet
        self.actions, self.goal_fields = self.episode.actions, self.episode.goal
        self.columns = Columns(self.episode, info_keys)
        self.episode_keys = EpisodeKeys(num_envs)
        self.key_table = np.zeros((num_envs, EPISODE_KEY), dtype=np.uint32)
        self.waiting = np.zeros(num_envs, dtype=np.bool_)  # keys drawn and not yet used
        self.ended = np.zeros(num_envs, dtype=np.bool_)  # episodes after which nobody has begun another
        self.obs_size = len(self.episode.observed)
        self.reach = arguments.reach_of(self.scene, self.scene.parameters())
        self._connect()

    def _connect(self) -> None:
        simulator, memory = self.simulator, self.memory
        self._team = Team(simulator, "environment", memory, self.threads, [self.key_table])
        self._goal_rewards = [self._reward_call()] if self.task.goal_functions else []
        """Calls that nobody makes now: learners ask for rewards of old goals from threads of their own."""
        self.keys, self.mask = self.key_table[:, :-1], self.key_table[:, -1]
        self._key_address = address(self.key_table)
        self.set_decision(self._team)
        seen = [4 * self.obs_size, *(table.itemsize for table in Outputs.allocate(self.columns, 1))]
        bytes_of_lane = [4 * len(self.actions), *seen, 0, *seen, self.key_table.strides[0], 0, 0, 0]
        self._offsets = [[part.first * LANES * size for size in bytes_of_lane] for part in self._team.parts]
        """What the arguments of each part are behind those of the first."""

    @property
    def frames_per_second(self) -> float:
        """Calls of ``step`` in a second of the motion."""
        return 1.0 / (self.scene.control_dt * self.decide_every)

    def limit_decisions(self) -> None:
        """Let episodes of a single environment end after the control steps of its id, if decisions last for
        several: Gymnasium's TimeLimit counts calls of ``step``."""
        if self.decide_every > 1 and self.env_id is not None:
            steps = gym.spec(self.env_id).max_episode_steps
            self.memory.column("limit")[:] = arguments.episode_limit(steps)

    def set_decision(self, team: Team) -> None:
        """Tell the calls of a team how many control steps a decision lasts."""
        for part in team.parts if self.decide_every > 1 else ():
            part.set(**{DECISION: self.decide_every})

    @property
    def episode(self) -> Episode:
        assert self.simulator.episode is not None
        return self.simulator.episode

    @staticmethod
    def _found_simulator(state: Mapping[str, Any]) -> Simulator:
        fields = map(Dynamics(state["simulated"]).parameters.field_of, state["observed"])
        return environment_simulator(
            state["simulated"], state["task"], tuple(fields), state["decide_every"] > 1
        )

    @property
    def generators(self) -> list[np.random.Generator | None]:
        """Generators of the lanes: the next keys are the next words of each."""
        return self.episode_keys.generators

    @property
    def begun_all(self) -> bool:
        """Whether every lane has had a reset, and so a key."""
        return bool(self.keys.any(axis=1).all())

    def provide_keys(self, lanes: NDArray[np.int64]) -> None:
        """Draw the key of the next episode for those of the given lanes that have no unused key."""
        lanes = lanes[~self.waiting[lanes]]
        if len(lanes):
            self.keys[lanes] = self.episode_keys.take(lanes)
            self.waiting[lanes] = True

    def step(self, actions: NDArray[np.float32], autoreset: int) -> Tables:
        """One decision of all lanes, by default one control step; those that NEXT_STEP resets have no reward
        and no flags."""
        if autoreset == Autoreset.SAME_STEP and not self.waiting.all():
            self.provide_keys(np.flatnonzero(~self.waiting))
        tables = self._run(KernelCall.STEP, actions, autoreset)
        self.begun = None
        if autoreset != Autoreset.DISABLED and np.count_nonzero(self.mask):  # quicker than any()
            self.begun = self.mask == (BEGUN if autoreset == Autoreset.NEXT_STEP else DUE)
            self.waiting[self.begun] = False
            self.mask[self.begun] = 0
            self.provide_keys(np.flatnonzero(self.mask))
            if self.waiting_options:
                self._begin_with_options(tables, np.flatnonzero(self.begun))
        return tables

    def _begin_with_options(self, tables: Tables, lanes: NDArray[np.int64]) -> None:
        """Begin episodes that an autoreset has begun anew, with the options that waited for them."""
        parts = options.within(self.waiting_options, lanes)
        if not parts:
            return
        self.waiting_options = options.within(self.waiting_options, lanes, others=True)
        some = np.zeros(self.num_envs, np.bool_)
        some[np.concatenate([part.lanes for part in parts.values()])] = True
        lanes = np.flatnonzero(some)
        parts = options.checked_reset(self.episode, self.memory, {}, lanes, parts)
        self.waiting[lanes] = True  # their keys are those of the last draw
        self.begin(some, parts)
        obs, out = self.observe()
        tables[0][lanes] = obs[lanes]
        for table, fresh, names in zip(tables[1], out, self.columns.tables.values(), strict=True):
            places = np.ix_(np.flatnonzero([name not in ENDS for name in names]), lanes)
            table[places] = fresh[places]

    def _run(
        self, operation: int, actions: NDArray[np.float32] | None = None, autoreset: int = Autoreset.DISABLED
    ) -> Tables:
        if actions is None:
            actions = np.zeros((self.num_envs, len(self.actions)), dtype=np.float32)
        obs, out, places = now = self._tables(np.empty)
        last_obs, last_out, last = self._tables(np.zeros) if autoreset == Autoreset.SAME_STEP else now
        starts = [address(actions), *places, self.memory.blocks * LANES, *last, self._key_address]
        starts += operation, autoreset, int(np.count_nonzero(self.mask))
        memory = self.memory
        before, memory.free, memory.user = (memory.free, memory.user), IN_USE, NOBODY
        try:  # nobody else until the call is over, not even a handler of a signal in this thread
            for part, offsets in zip(self._team.parts, self._offsets, strict=True):
                part.put("actions", [start + offset for start, offset in zip(starts, offsets, strict=True)])
            self._team()
        finally:
            memory.free, memory.user = before
        return obs, out, last_obs, last_out

    def _tables(self, make: Callable[..., Any]) -> tuple[NDArray[np.float32], Outputs, list[int]]:
        """New tables for observations and outputs of all lanes, and the addresses of their whole blocks."""
        n, count = self.num_envs, self.memory.blocks * LANES
        obs, out = make((count, self.obs_size), np.float32), Outputs.allocate(self.columns, count, make)
        places = [address(array) for array in (obs, *out)]
        return (obs, out, places) if count == n else (obs[:n], out.lanes(slice(n)), places)

    def begin(
        self, lanes: NDArray[np.bool_], parts: options.Given, run: Callable[[int], Any] | None = None
    ) -> None:
        """Begin new episodes in the lanes of a mask, with options that :meth:`checked` returned for some of
        them; ``run`` replaces the default way of running the kernel for all lanes. Parameters are set before
        start and goal are drawn: equal seeds and options give equal episodes."""
        run = run or self._run
        index = np.flatnonzero(lanes)
        starts = [part for key, part in parts.items() if key != options.PARAMETERS]
        if options.PARAMETERS in parts:
            names, some, table = parts[options.PARAMETERS]
            parameters.write(self.scene, self.memory, some, dict(zip(names, table.T, strict=True)))
        self.waiting_options = options.within(self.waiting_options, index, others=True)
        self.provide_keys(index)
        due = self.mask.copy()
        self.mask[:] = lanes
        run(KernelCall.RESET)
        for names, some, table in starts:
            self.memory.write(names, table, some)
        if starts and self.simulator.dynamics.effect_states.computed:
            run(KernelCall.BEGIN_STATES)
        self.mask[:] = np.where(lanes, 0, due)
        self.waiting[lanes] = self.ended[lanes] = False

    @alone
    def observe(self) -> tuple[NDArray[np.float32], Outputs]:
        """Observations and outputs of the present states."""
        return self._run(KernelCall.OBSERVE)[:2]

    def checked(self, requested: Mapping[str, Any], lanes: NDArray[np.int64]) -> options.Given:
        """Options of a reset of some lanes, with those that wait for them and are not given again."""
        return options.checked_reset(self.episode, self.memory, requested, lanes, self.waiting_options)

    @alone
    def let_wait(self, requested: Mapping[str, Any], lanes: NDArray[np.int64], keep: bool = False) -> None:
        """Keep options for the next episodes of lanes; without any, forget those that wait."""
        waiting = self.waiting_options
        if requested:
            parts = options.checked_reset(self.episode, self.memory, requested, lanes, waiting, keep)
            self.waiting_options = options.over(waiting, parts)
        else:
            self.waiting_options = options.within(waiting, lanes, others=True)

    def observation(self, obs: NDArray[np.float32], out: Outputs) -> Any:
        """Observations in the form of their space, from the tables of a step."""
        if not self.task.goal_conditioned:
            return obs
        tips, goals = (self.columns.points(out, names) for names in (TIP, self.columns.goal))
        return {"observation": obs, "achieved_goal": tips, "desired_goal": goals}

    def goal_reward(self, achieved: ArrayLike, desired: ArrayLike) -> NDArray[np.float64]:
        """The compiled reward of goal pairs, (n, 2) each."""
        a, d = np.atleast_2d(np.asarray(achieved, float)), np.atleast_2d(np.asarray(desired, float))
        if {a.shape[1:], d.shape[1:]} != {(2,)} or len({len(a), len(d)} - {1}) > 1:
            raise ValueError(
                f"goals have shapes {np.shape(achieved)} and {np.shape(desired)}; give (2,) or (n, 2)"
            )
        a, d = np.broadcast_arrays(a, d)
        blocks = -(-len(a) // LANES)
        pairs, reward = np.zeros((blocks * LANES, 4)), np.empty(blocks * LANES)
        pairs[: len(a), :2], pairs[: len(a), 2:] = a, d
        task = self.task.parameters()
        numbers = aligned(1 + len(task), LANES)
        numbers[:] = np.array([self.reach, *task.values()])[:, None]
        try:
            call = self._goal_rewards.pop()
        except IndexError:
            call = self._reward_call()
        call.set(pairs=pairs, numbers=numbers, reward=reward, blocks=blocks)
        call()
        self._goal_rewards.append(call)
        return reward[: len(a)]

    def _reward_call(self) -> Call:
        entry = self.simulator.kernels(self.memory.count)["goal_reward"]
        return Call(self.simulator.arguments["goal_reward"], entry)

    def goals(self) -> NDArray[np.float64]:
        """Goals, (num_envs, 2), m."""
        if not self.goal_fields:
            raise AttributeError(f"the task {self.task.name} has no goal")
        return self.memory.read(self.goal_fields)

    @alone
    def get_state(self) -> dict[str, Any]:
        """Everything that determines the continuation: numbers, keys and generators."""
        return {
            **self.memory.save(),
            **{name: getattr(self, name).copy() for name in OF_LANES},
            "generators": copy.deepcopy(self.generators),
            "simulator": self._facts,
        }

    @alone
    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a state of :meth:`get_state`; the continuation is the same to the last bit. ValueError if
        it is of another scene, task, episode limit or number of environments."""
        self.check_state(state)
        self.memory.restore(state["states"], state["parameters"])
        for name in OF_LANES:
            getattr(self, name)[:] = state[name]
        self.episode_keys = EpisodeKeys(self.num_envs)
        self.generators[:] = copy.deepcopy(state["generators"])

    @alone
    def take_state(self, state: Mapping[str, Any], lanes: NDArray[np.int64]) -> None:
        """Continue the episode of one environment in some lanes, which keep their generators and limits."""
        single = self._single
        single.set_state(state)
        if single.ended.any():
            raise ValueError("state is of an episode that has ended; take one of an episode that goes on")
        self.provide_keys(lanes[~self.keys[lanes].any(axis=1)])  # to those that have not begun
        for life in KEPT:
            names = [name for name in self.memory.layout.rows[life] if name != "limit"]
            self.memory.write(names, single.memory.read(names), lanes)
        self.mask[lanes] = self.ended[lanes] = 0

    @cached_property
    def _single(self) -> "Core":
        single = Core(
            self.simulated, 1, self.task, env_id=self.env_id, observe_parameters=self.observed,
            decide_every=self.decide_every,
        )  # fmt: skip
        single.limit_decisions()
        return single

    def check_state(self, state: Mapping[str, Any]) -> None:
        """ValueError if :meth:`set_state` cannot take a state."""
        parameters.check_keys("state", state, STATE_KEYS, "get_state")
        parameters.check_facts("state", state["simulator"], self._facts)
        dynamics = self.simulator.dynamics
        motion = (*dynamics.states, *dynamics.effect_states.updated, *dynamics.draw_fields)
        finite = (*motion, *self.task.memory, "steps")
        fixed = (*arguments.numbers_of_reward(self.task), *self.episode.randomized.numbers())
        parameters.check_numbers("state", state, self.memory, fixed, finite, self.task)
        for name in OF_LANES:
            parameters.check_array("state", name, state[name], getattr(self, name))
        generators, kinds = state["generators"], np.random.Generator | None
        listed = isinstance(generators, list) and len(generators) == self.num_envs
        if not listed or not all(isinstance(one, kinds) for one in generators):
            fix = f"give a list of {self.num_envs} NumPy generators or None"
            raise ValueError(f"state['generators'] is {shown(generators)}; {fix}")

    @cached_property
    def _facts(self) -> str:
        """The settings that must be equal in all states of these environments."""
        return parameters.simulator_facts(
            self.simulator, self.num_envs, task=dataclasses.asdict(self.task),
            max_episode_steps=self.max_episode_steps, decide_every=self.decide_every,
            goal_conditioned=self.task.goal_conditioned, autoreset_mode=self.autoreset.name.lower(),
        )  # fmt: skip
