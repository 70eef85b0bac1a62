"""A case of a vector of environments is played, and judged by promises, one function each.

The name of the function is the name of the promise.
"""

import copy
import pickle
import re
from dataclasses import dataclass, field

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded

from .cases import Violation, lanes_of, taken, with_lanes


@dataclass
class Step:
    """A call that was played."""

    call: dict  # with arrays for its lanes in place of "rows"
    must_refuse: str | None  # a pattern of the message; None: it need not be refused
    before: dict  # arrays with all that determines the continuation
    after: dict = field(default_factory=dict)
    told: dict = field(default_factory=dict)  # results: arrays with a row for each lane
    error: Exception | None = None


class Player:
    """A vector of a case; its methods are the calls."""

    def __init__(self, case):
        self.case, self.ended = case, np.zeros(case["num_envs"], np.bool_)
        self.env, self.other = self.made(), self.made()

    def made(self):
        given = "num_envs", "threads", "autoreset_mode", "scene", "on_bad_action", "max_episode_steps", "task"
        env_id = f"redundant_envs/{self.case['scene']['robot']['type']}{'Goal' * self.case['goal']}Reach-v0"
        return gym.make_vec(env_id, **{name: self.case[name] for name in given}).unwrapped

    def replace(self, k):
        """A copy, an unpickled one, or one that was left earlier and is set to its state takes the place of
        the vector."""
        old = self.env
        if k % 3 == 2:
            self.env = self.other
            self.env.set_state(old.get_state())
        else:
            self.env = pickle.loads(pickle.dumps(old)) if k % 3 else copy.deepcopy(old)
        self.other = old

    def play(self, call):
        """Make a call; any exception is kept."""
        call = {**call, **arrays(taken(call.get("rows", {}), lanes_of(self.case, call)))}
        step = Step(call, self.refusal(call), self.now())
        try:
            step.told = getattr(self, call["call"])(call)
        except Exception as raised:  # judged by the promises
            step.error = raised
        step.after = self.now()
        return step

    def now(self):
        state = self.env.get_state()
        words = [str(one and one.bit_generator.state) for one in state["generators"]]
        tables = {name: table for name, table in state.items() if isinstance(table, np.ndarray)}
        return tables | {"generators": np.array(words), "q": np.array(self.env.q)}

    def refusal(self, call):
        """The pattern of the message if a call must be refused; of several reasons any is told."""
        found = [call["refused"]] if "refused" in call else []
        if call["call"] == "step":
            if self.case["autoreset_mode"] == "disabled" and self.ended.any():
                found.append("have ended")
            begins = self.ended & (self.case["autoreset_mode"] == "next_step")  # and ignores its action
            if self.case["on_bad_action"] == "raise" and not np.isfinite(call["actions"][~begins]).all():
                found.append("non-finite")
        return None if not found else found[0] if len(found) == 1 else ""

    def step(self, call):
        actions = call["actions"] if call.get("float64") else call["actions"].astype(np.float32)
        obs, reward, terminated, truncated, infos = self.env.step(actions)
        self.ended = terminated | truncated
        told = {"reward": np.array(reward), "terminated": terminated, "truncated": truncated}
        last = {name: np.array(table) for name, table in named(obs).items()}
        for lane in np.flatnonzero(infos.get("_final_obs", ())):  # its next episode has begun
            for name, row in named(infos["final_obs"][lane]).items():
                last[name][lane] = row
        return told | observed(obs) | {f"last {name}": table for name, table in last.items()}

    def reset(self, call):
        count, lanes, options = self.case["num_envs"], lanes_of(self.case, call), call.get("options", {})
        seeds = dict(zip(lanes, call["seed"].tolist(), strict=True)) if "seed" in call else None
        if len(lanes) < count:
            options = {**options, "reset_mask": np.isin(np.arange(count), lanes)}
        obs, _ = self.env.reset(seed=seeds and [seeds.get(k) for k in range(count)], options=options)
        self.ended[lanes] = False
        return observed(obs)


def named(obs):
    return obs if isinstance(obs, dict) else {"": obs}


def observed(obs):
    return {f"now {name}": np.array(table) for name, table in named(obs).items()}


def arrays(rows):
    return {name: arrays(x) if isinstance(x, dict) else np.array(x) for name, x in rows.items()}


def play(case, replaced=False):
    """All calls of a case; ``replaced``: of another vector each."""
    player, steps = Player(case), []
    for k, call in enumerate(case["calls"]):
        if replaced and k:
            player.replace(k)
        steps.append(player.play(call))
    return steps


# ---- promises ----------------------------------------------------------------------------------------


def only_documented_exceptions(case, steps):
    """A call raises no other exception than a ValueError or ResetNeeded; only if it is invalid, and then
    always."""
    for k, step in enumerate(steps):
        what, error, must = step.call["call"], step.error, step.must_refuse
        if error is None and must is not None:
            yield k, -1, f"{what} was not refused"
        elif error is not None and not isinstance(error, ValueError | ResetNeeded):
            yield k, -1, f"{what} raised {type(error).__name__}: {error}"
        elif error is not None and must is None and not step.call.get("refusable"):
            yield k, -1, f"{what} was refused: {error}"
        elif error is not None and not re.search(must or "", str(error)):
            yield k, -1, f"{what} was refused without a word of {must!r}: {error}"


def a_refused_call_changes_nothing(case, steps):
    """A call that raises leaves everything that determines the continuation, to the last bit."""
    for k, step in enumerate(steps):
        for name, table in step.before.items() if step.error is not None else ():
            if table.shape != step.after[name].shape or not np.all(same(table, step.after[name])):
                yield k, -1, f"{step.call['call']} changed {name}, and raised"


def what_is_saved_continues(case, steps):
    """Copies, unpickled ones, and others that are set to a state continue to the same bits as what goes on
    itself."""
    every = list(range(case["num_envs"]))
    yield from compared(list(enumerate(steps)), play(case, replaced=True), every, "one that was replaced")


def no_lane_depends_on_others(case, steps):
    """Lanes in reverse order, with other threads, and alone have the same bits."""
    count = case["num_envs"]
    for order in ([*range(count)][::-1], [count // 2]) if count > 1 else ():
        # Calls that were refused for some lane are left out: without it they might not be.
        good = [k for k, x in enumerate(steps) if x.error is None and {*lanes_of(case, x.call)} & {*order}]
        kept = with_lanes({**case, "calls": [case["calls"][k] for k in good]}, order)
        twins = play({**kept, "threads": 3 - case["threads"]})
        yield from compared([(k, steps[k]) for k in good], twins, order, f"another order of {len(order)}")


def compared(steps, twins, order, what):
    """The first of some numbered steps that has other bits in others, and its lane in an order."""
    for (k, step), twin in zip(steps, twins, strict=True):
        if type(step.error) is not type(twin.error):
            yield k, -1, f"{step.call['call']}: {step.error}; in {what}: {twin.error}"
            return
        own, other = (x.told | {"q": x.after["q"]} for x in (step, twin))
        for name, table in own.items():
            apart = ~same(table[order], other[name]).reshape(len(order), -1).all(axis=1)
            if apart.any():
                yield k, order[np.argmax(apart)], f"{step.call['call']} gives another {name} in {what}"
                return


def same(one, other):
    """Entries in which two arrays have the same bits; all NaN count as equal."""
    if one.dtype.kind != "f":
        return one == other
    whole = {8: np.int64, 4: np.int32}[one.dtype.itemsize]
    bits = np.ascontiguousarray(one).view(whole) == np.ascontiguousarray(other).view(whole)
    return bits | (np.isnan(one) & np.isnan(other))


def observations_lie_in_their_space(case, steps):
    """Every observation is finite, and lies in its space."""
    space = Player(case).env.single_observation_space
    for k, step in enumerate(steps):
        for key, table in step.told.items():
            when, _, name = key.partition(" ")
            for lane, row in enumerate(table) if when in ("now", "last") else ():
                if not (np.isfinite(row).all() and (space[name] if name else space).contains(row)):
                    yield k, lane, f"{name or 'the observation'} is {row.tolist()}"


PROMISES = (
    only_documented_exceptions, a_refused_call_changes_nothing, what_is_saved_continues,
    no_lane_depends_on_others, observations_lie_in_their_space,
)  # fmt: skip


def violations_of(case, tally, names):
    """Play a case of a vector, and judge it by some promises."""
    steps = play(case)
    tally["refused"] += sum(step.error is not None for step in steps)
    tally["intervals"] += case["num_envs"] * sum("reward" in step.told for step in steps)
    chosen = [one for one in PROMISES if one.__name__ in names]
    return [Violation(one.__name__, *found) for one in chosen for found in one(case, steps)]
