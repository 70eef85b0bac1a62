"""The programs of an environment: step, reset and observe all lanes, and the reward of goals."""

import enum
import math
from collections.abc import Mapping
from typing import Any

from redundant_envs.compiler.tracing.flow import LANES, Kernel, LaneFunction, Output, Scalar
from redundant_envs.compiler.tracing.graph import Graph
from redundant_envs.compiler.tracing.number import Number, value_of
from redundant_envs.language.draws import KEY_WORDS, WORDS, uniform
from redundant_envs.language.philox import philox
from redundant_envs.language.quantities import Quantities
from redundant_envs.simulator.batch.blocks import MEMORY, Block, Blocks, Ends, limited
from redundant_envs.simulator.batch.slots import advance
from redundant_envs.simulator.lane.dynamics import DRAW_KEY
from redundant_envs.simulator.lane.episode import ENDS, GOAL, TABLES, TIP, Episode
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.tasks.base import Task


class KernelCall(enum.IntEnum):
    """What a call of the kernel does."""

    STEP = 0
    RESET = 1
    OBSERVE = 2
    CHECKED_STEP = 3  # if an action is not finite it changes nothing and returns NaN as the first reward
    BEGIN_STATES = 4  # of effects, after a reset whose options have set positions or rates


class Autoreset(enum.IntEnum):
    """Time at which lanes whose episodes have ended start a new one."""

    DISABLED = 0
    NEXT_STEP = 1
    SAME_STEP = 2


EPISODE_KEY = KEY_WORDS + 1
"""Words of an episode key: four of the key of a lane's next episode, and whether it is to begin or has
begun."""
DUE, BEGUN = 1, 2
ARGUMENTS = {
    "actions": "f32",
    "obs": "f32",
    **TABLES,
    "stride": "int",
    "last_obs": "f32",
    **{f"last_{table}": element for table, element in TABLES.items()},
    "episode_keys": "u32",
    **dict.fromkeys(("operation", "autoreset", "any_due"), "int"),
}
"""Arguments of the kernel beside memories. The stride is that of the rows of tables."""


DECISION = "decide_every"
"""Argument of kernels with decisions: the control steps that each lasts."""


class EpisodeKernel:
    """What kernels of environments have in common: how an episode begins in a block, and where outputs go."""

    def __init__(self, p: Kernel, blocks: Blocks, episode: Episode) -> None:
        self.p, self.blocks, self.episode = p, blocks, episode
        self.observed = blocks.function("observe", episode.observe)
        make, numbers = blocks.function, episode.randomized
        self.resets = [make("reset", episode.reset)]
        if numbers.entries:  # without joined products, to the bits of numbers that are set from outside
            places = [make("place", episode.place)] if episode.placements else []
            draws = [make("draw", numbers.draw), *places] if numbers.drawn else places
            self.resets = [*draws, make("prepare", numbers.prepare, joins=False), *self.resets]

    def end(self, lane: Lane) -> Any:
        self.episode.finish_control_step(lane)
        lane.next_part()
        return self.episode.observe(lane)

    def observe(self, block: Block) -> None:
        """Observations and outputs of the lanes of a block."""
        self.p.call(self.observed, **block.pointers, **self.outputs(block))

    def outputs(self, block: Block) -> dict[str, Any]:
        obs = self.p["obs"] + block.first * len(self.episode.observed)
        tables: dict[str, Any] = {table: self.p[table] + block.first for table in TABLES}
        return {"obs": obs, **tables, **{f"{table}_stride": self.p["stride"] for table in TABLES}}

    def reset(self, block: Block) -> None:
        """Begin an episode in the lanes of a block that are ``resetting``."""
        for function in self.resets:
            self.p.call(function, **block.pointers)

    def draw(self, block: Block, k: Any, key: list[Scalar]) -> None:
        """The draws of a lane's next episode, from its key and nothing else."""
        p = self.p
        for (first, second), draws in [((0, 0), self.episode.draws), *self.episode.randomized.streams()]:
            for group in range(0, len(draws), WORDS):
                words = philox(key[:2], [first + group // WORDS, second, key[2], key[3]])
                for name, word in zip(draws[group : group + WORDS], words, strict=False):
                    self.blocks.store(block.pointers, k, name, uniform(p.number(word)))
        if self.episode.dynamics.draws:
            for name, word in zip(DRAW_KEY, key, strict=True):
                self.blocks.store(block.pointers, k, name, p.number(word))
        self.blocks.store(block.pointers, k, "resetting", 1.0)

    def keep_last(self, lane: Scalar) -> None:
        """Keep outputs of a lane before it starts a new episode."""
        p, width = self.p, len(self.episode.observed)
        with p.each(width) as column:
            p.store(p["last_obs"], lane * width + column, p.load(p["obs"], lane * width + column))
        for table, names in self.episode.tables.items():
            self._copy(f"last_{table}", table, lane, range(len(names)))

    def copy_ends(self, block: Block, k: Any) -> None:
        """Outputs about the end of a step are those of the episode that has ended."""
        for table, names in self.episode.tables.items():
            rows = [row for row, name in enumerate(names) if name in ENDS]
            self._copy(table, f"last_{table}", block.first + k, rows)

    def _copy(self, goal: str, source: str, lane: Scalar, rows: Any) -> None:
        """Rows of a lane from one table to another."""
        p = self.p
        for row in rows:
            at = p["stride"] * row + lane
            p.store(p[goal], at, p.load(p[source], at))


class EnvironmentKernel(EpisodeKernel):
    """Step, reset or observe all environments in one call; ``lanes`` are those of a block. ValueError if the
    scene has too many operations."""

    @limited()
    def __init__(self, episode: Episode, lanes: int = LANES) -> None:
        more = {DECISION: "int"} if episode.decides else {}
        p = Kernel("environment", {**MEMORY, **ARGUMENTS, **more}, lanes)
        super().__init__(p, Blocks(p, episode.interval, episode.layout()), episode)
        self.states_begin = bool(episode.dynamics.effect_states.computed)
        """Whether states of effects have a computed value at the start of an episode."""
        if self.states_begin:
            self.begun = self.blocks.function("begin_states", episode.begin_states)
        operation = p["operation"]
        checked, count = operation == KernelCall.CHECKED_STEP, p["count"] * len(episode.actions)
        with p.when(checked), p.each(count) as k:
            action = p.load(p["actions"], k)
            with p.when((action != action) | (action == math.inf) | (action == -math.inf)):
                p.store(p["values"], 0, math.nan)
                p.leave()
        steps = (operation == KernelCall.STEP) | checked
        inputs = {"actions": ("f32", episode.actions)}
        with p.when(steps):
            if episode.decides:
                self.advance_decision(inputs)
            else:
                advance(self.blocks, Ends(episode.command, inputs, self.end, self.outputs, self.autoreset))
        with p.when(~steps), p.each(self.blocks.count) as number:
            block = self.blocks.block(number, 0)
            with p.when(operation == KernelCall.RESET):
                self.begin_due(block)
            if self.states_begin:
                with p.when(operation == KernelCall.BEGIN_STATES):
                    self.begin_states(block)
            self.observe(block)
        self.blocks.prune()

    def advance_decision(self, inputs: Mapping[str, Any]) -> None:
        """Advance all lanes by the control steps of a decision; observations and new episodes follow it."""
        p, blocks, episode = self.p, self.blocks, self.episode
        decide = blocks.function("decide", episode.decide, inputs=inputs)
        with p.each(blocks.count) as number:
            blocks.call(decide, blocks.block(number, 0))
        with p.each(p[DECISION]):
            begin, finish = episode.begin_step_of_decision, episode.finish_step_of_decision
            advance(blocks, Ends(begin, {}, finish, lambda block: {}))
        with p.each(blocks.count) as number:
            block = blocks.block(number, 0)
            self.observe(block)
            self.autoreset(block)

    def _flag(self, lane: Scalar) -> Scalar:
        return lane * EPISODE_KEY + KEY_WORDS

    def _key(self, block: Block, k: Scalar) -> list[Scalar]:
        p = self.p
        return [p.load(p["episode_keys"], (block.first + k) * EPISODE_KEY + w) for w in range(KEY_WORDS)]

    def begin_due(self, block: Block, then: int = DUE) -> Scalar:
        """Start new episodes in the lanes of a block whose keys request one; returns whether any did."""
        p = self.p
        some = p.variable(0)
        self._clear(block)
        with p.each(block.lanes) as k:
            lane = block.first + k
            with p.when(p.load(p["episode_keys"], self._flag(lane)) != 0):
                self.draw(block, k, self._key(block, k))
                p.store(p["episode_keys"], self._flag(lane), then)
                some.value = 1
        with p.when(some.value != 0):
            self.reset(block)
        return some.value

    def begin_states(self, block: Block) -> None:
        """Compute again what states of effects are at the start, in lanes that begin an episode."""
        p = self.p
        self._clear(block)
        with p.each(block.lanes) as k, p.when(p.load(p["episode_keys"], self._flag(block.first + k)) != 0):
            self.blocks.store(block.pointers, k, "resetting", 1.0)
        p.call(self.begun, **block.pointers)

    def _clear(self, block: Block) -> None:
        with self.p.each(self.blocks.lanes) as k:
            self.blocks.store(block.pointers, k, "resetting", 0.0)

    def autoreset(self, block: Block) -> None:
        """Autoreset of a block after its step."""
        p, blocks, pointers = self.p, self.blocks, block.pointers
        done = blocks.mask(pointers, "terminated") | blocks.mask(pointers, "truncated")
        done = done & blocks.valid(block)
        with p.when(p["autoreset"] == Autoreset.NEXT_STEP):
            begun = p.variable(0)
            with p.when(p["any_due"] != 0):
                with p.each(block.lanes) as k:
                    flag = p.load(p["episode_keys"], self._flag(block.first + k))
                    with p.when(flag == DUE):
                        begun.value = begun.value | p.record("<<", 1, k)
                with p.when(begun.value != 0):
                    self.begin_due(block, BEGUN)
                    self.observe(block)
            with p.each_set(done & ~begun.value) as k:
                p.store(p["episode_keys"], self._flag(block.first + k), DUE)
        with p.when((p["autoreset"] == Autoreset.SAME_STEP) & (done != 0)):
            self._clear(block)
            with p.each_set(done) as k:
                self.keep_last(block.first + k)
                self.draw(block, k, self._key(block, k))
                p.store(p["episode_keys"], self._flag(block.first + k), DUE)
            self.reset(block)
            self.observe(block)
            with p.each_set(done) as k:
                self.copy_ends(block, k)


def goal_reward_function(task: Task) -> LaneFunction:
    """The reward of goal environments, from both goals alone."""
    graph, goals, numbers = Graph(), (*TIP, *GOAL), ("reach", *task.parameters())
    known = {name: Number(graph, graph.load("numbers", k)) for k, name in enumerate(numbers)}
    known |= {name: Number(graph, graph.load("pairs", k)) for k, name in enumerate(goals)}
    reward = Quantities(known, task.goal_functions, {})["goal_reward"]
    output, inputs = Output("reward", "f64", 0, 0, value_of(reward)), {"pairs": ("f64", len(goals))}
    return LaneFunction("goal_reward", ("numbers",), [], [output], inputs, whole_blocks=True)


def goal_reward_kernel(task: Task) -> Kernel:
    """A kernel for the reward of goal environments, in whole blocks."""
    p = Kernel("goal_reward", {"pairs": "f64", "numbers": "f64", "reward": "f64", "blocks": "int"})
    function, columns = goal_reward_function(task), len((*TIP, *GOAL))
    with p.each(p["blocks"]) as block:
        pairs, rewards = p["pairs"] + block * (LANES * columns), p["reward"] + block * LANES
        p.call(function, pairs=pairs, reward=rewards, numbers=p["numbers"])
    return p
