"""Promises about the environments: one function each, which returns the violations with numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded

from redundant_envs.scene import Scene
from redundant_envs.tasks.limits import hard_stops

from .cases import Array, Case, lanes_of, with_lanes, without_calls
from .played import Tally, Violation, same
from .playing import Make
from .playing_episodes import EpisodePlayer, EpisodeStep, Given, made, play_episodes

ROUNDING = 1e-9
"""Rounding of a sum of a hundred rewards of at most 1."""
FLOAT32 = 1e-4
"""The same for rewards in single precision, as in stable-baselines3."""
SNAPSHOTS = ("save", "copy", "pickle")


@dataclass
class PlayedEpisodes:
    """A case, its results, and the factory of its environments (tests tamper with them)."""

    case: Case
    steps: list[EpisodeStep]
    make: Make
    tally: Tally

    @property
    def scene(self) -> Scene:
        return Scene.from_dict(self.case["scene"])

    def tables(self) -> Iterator[tuple[int, int, str, Array]]:
        """Call, lane, name and row of every observation."""
        for k, step in enumerate(self.steps):
            for name, table in (step.given.obs or {}).items():
                for lane, line in enumerate(table):
                    yield k, lane, name, line
            for lane, last in step.given.last_obs.items():
                for name, table in last.items():
                    yield k, lane, name, table[0]


def only_documented_exceptions(played: PlayedEpisodes) -> list[Violation]:
    """A call raises no other exception than a ValueError or ResetNeeded, and only if it is invalid."""
    name, found, ready = "only_documented_exceptions", [], False
    for k, step in enumerate(played.steps):
        call, error = step.call, step.error
        documented = (ValueError, ResetNeeded)
        if type(error).__name__ == "ResetNeeded" and not ready:
            continue
        ready = ready or (call["call"] == "reset" and error is None)
        if error is not None and not isinstance(error, documented):
            found.append(Violation(name, k, -1, f"{call['call']} raised {type(error).__name__}: {error}"))
        elif error is not None and not (step.may_refuse or call.get("refused")):
            found.append(Violation(name, k, -1, f"{call['call']} was refused: {error}"))
        elif error is None and call.get("refused"):
            found.append(Violation(name, k, -1, f"{call['call']} was not refused"))
    return found


def a_refused_call_changes_nothing(played: PlayedEpisodes) -> list[Violation]:
    """A call that raises leaves everything that determines the continuation unchanged."""
    found = []
    for k, step in enumerate(played.steps):
        if step.error is None:
            continue
        for key in ("states", "parameters", "keys", "mask", "waiting"):
            one, other = step.before[key], step.after[key]
            if one.shape != other.shape or not np.all(same(one, other)):
                text = f"{step.call['call']} changed the {key}, and raised"
                found.append(Violation("a_refused_call_changes_nothing", k, -1, text))
    return found


def observations_are_finite(played: PlayedEpisodes) -> list[Violation]:
    """No observation has a NaN or an infinity: those of resets and last ones, too."""
    return [
        Violation("observations_are_finite", k, lane, f"{name or 'the observation'} is {line.tolist()}")
        for k, lane, name, line in played.tables()
        if not np.isfinite(line).all()
    ]


def observations_lie_in_their_space(played: PlayedEpisodes) -> list[Violation]:
    """Every finite observation lies in its space."""
    env = EpisodePlayer(played.case, played.make).inner
    space = getattr(env, "single_observation_space", env.observation_space)
    return [
        Violation(
            "observations_lie_in_their_space", k, lane, f"{name or 'the observation'} is {line.tolist()}"
        )
        for k, lane, name, line in played.tables()
        if np.isfinite(line).all() and not (space[name] if name else space).contains(line)
    ]


def no_early_end_pays(played: PlayedEpisodes) -> list[Violation]:
    """Steps pay 0 to 1, goals 0 or 1; a dense episode that a fault ends returns nothing."""
    case, found, name = played.case, [], "no_early_end_pays"
    count, next_step = case["num_envs"], case["face"] == "vector" and case["autoreset_mode"] == "next_step"
    same_step = case["face"] == "sb3" or (case["face"] == "vector" and case["autoreset_mode"] == "same_step")
    returns, over = np.zeros(count), np.zeros(count, np.bool_)
    saved = (returns.copy(), over.copy())
    slack = FLOAT32 if case["face"] == "sb3" else ROUNDING
    for k, step in enumerate(played.steps):
        kind, given = step.call["call"], step.given
        if step.error is not None:
            continue
        if kind == "save":
            saved = (returns.copy(), over.copy())
        elif kind == "restore" and any(s.call["call"] == "save" for s in played.steps[:k]):
            returns, over = saved[0].copy(), saved[1].copy()
        elif kind == "reset":
            lanes = lanes_of(case, step.call)
            returns[lanes], over[lanes] = 0.0, False
        if given.reward is None or given.terminated is None or given.truncated is None:
            continue
        going = ~over
        if next_step:  # this step began the next episode of those
            returns[over], over[:] = 0.0, False
        returns[going] += given.reward[going]
        ended = given.terminated | given.truncated
        early = given.terminated & going
        for lane in np.flatnonzero(going & ~np.isfinite(given.reward)):
            found.append(Violation(name, k, int(lane), f"the reward is {given.reward[lane]}"))
        paid = given.reward if case["goal"] else np.where(early, 0.0, given.reward)
        wrong = ~((paid >= 0.0) & (paid <= 1.0 + ROUNDING))
        wrong |= (paid != 0.0) & (paid != 1.0) if case["goal"] else False
        for lane in np.flatnonzero(going & wrong):
            found.append(Violation(name, k, int(lane), f"a step pays {paid[lane]}"))
        gained = early & (np.abs(returns) > slack) & (not case["goal"])
        for lane in np.flatnonzero(gained):
            text = f"an episode that a fault ended returns {returns[lane]}"
            found.append(Violation(name, k, int(lane), text))
        played.tally.episodes += int((ended & going).sum())
        played.tally.early_ends += int(early.sum())
        over = over | ended
        if same_step:
            returns[over], over[:] = 0.0, False
    return found


def no_slider_is_beyond_its_stop(played: PlayedEpisodes) -> list[Violation]:
    """After every call sliders are between their stops, to the last bit."""
    scene, found = played.scene, []
    values = scene.parameters()
    for k, step in enumerate(played.steps):
        for joint, low, high in hard_stops(scene):
            x = step.q[:, joint]
            beyond = np.maximum(values[low] - x, x - values[high])
            for lane in np.flatnonzero(~(beyond <= 0.0)):
                text = f"{scene.robot.joints[joint]} is {beyond[lane]:.3g} m beyond its stop"
                found.append(Violation("no_slider_is_beyond_its_stop", k, int(lane), text))
    return found


def apart(one: Given, other: Given, order: list[int]) -> list[int]:
    """Indices of lanes for which the results of two calls differ."""
    found: set[int] = set()
    rows = [(one.obs or {}).get(name) for name in (other.obs or {})] + [
        one.reward,
        one.terminated,
        one.truncated,
    ]
    others = [*(other.obs or {}).values(), other.reward, other.terminated, other.truncated]
    for a, b in zip(rows, others, strict=True):
        if a is not None and b is not None:
            equal = np.asarray(same(a[order], b)).reshape(len(order), -1).all(axis=1)
            found |= set(np.flatnonzero(~equal).tolist())
    for place, lane in enumerate(order):
        a, b = one.last_obs.get(lane), other.last_obs.get(place)
        if (a is None) != (b is None) or any(not np.all(same(a[n], b[n])) for n in a or ()):  # type: ignore[index]
            found.add(place)
    return sorted(found)


def no_lane_depends_on_others(played: PlayedEpisodes) -> list[Violation]:
    """Lanes in another order, with other threads, and alone have the same bits."""
    case, count, found = played.case, played.case["num_envs"], []
    refused = [k for k, step in enumerate(played.steps) if step.error is not None]
    kept, steps = without_calls(case, refused), [s for s in played.steps if s.error is None]
    rng = np.random.default_rng(count)
    orders = [rng.permutation(count).tolist(), [int(rng.integers(count))]] if count > 1 else []
    for order in orders:
        other = {**of_lanes(kept, order), "threads": 3 - case["threads"]}
        own = [
            k for k, c in enumerate(kept["calls"]) if c.get("lanes") is None or set(c["lanes"]) & set(order)
        ]
        for k, again in zip(own, play_episodes(other, played.make), strict=True):
            # Lanes that are not reset keep a row, which has no meaning, in some libraries' views.
            places = apart(steps[k].given, again.given, order)
            if again.error is not None or places:
                text = f"{steps[k].call['call']} gives something else in another order ({again.error})"
                lane = order[places[0]] if places else -1
                found.append(Violation("no_lane_depends_on_others", k, lane, text))
                break
    return found


def of_lanes(case: Case, order: list[int]) -> Case:
    """The case with some of its lanes, with their rows of the options of resets."""
    options = [call.get("options") for call in case["calls"]]
    made = with_lanes(case, order)
    remaining = [
        k for k, c in enumerate(case["calls"]) if c.get("lanes") is None or set(c["lanes"]) & set(order)
    ]
    for call, k in zip(made["calls"], remaining, strict=True):
        if not options[k] or call.get("of_lanes") is None:
            continue
        own = lanes_of(case, case["calls"][k])
        rows = [own.index(lane) for lane in order if lane in own]
        for name in call["of_lanes"]:
            if name in call["options"]:
                call["options"][name] = [options[k][name][r] for r in rows]
        for name, table in (options[k].get("parameters") or {}).items():
            call["options"]["parameters"][name] = [table[r] for r in rows]
    return made


def what_is_saved_continues(played: PlayedEpisodes) -> list[Violation]:
    """An environment set to a snapshot, a copy and an unpickled one continue to the same bits."""
    case, calls, found = played.case, played.case["calls"], []
    for k in [k for k, c in enumerate(calls) if c["call"] in SNAPSHOTS][:1]:
        first = EpisodePlayer(case, played.make)
        ready = [first.play(call) for call in calls[: k + 1]]
        if not any(s.call["call"] == "reset" and s.error is None for s in ready):
            return []
        second, third = EpisodePlayer(case, played.make), EpisodePlayer(case, played.make)
        second.env.reset()  # wrappers insist on it
        try:
            second.inner.set_state(first.inner.get_state())
        except ValueError as error:
            text = f"the state of call {k} is refused: {error}"
            return [Violation("what_is_saved_continues", k, -1, text)]
        second._limit().update(first._limit())
        third.env = first.env
        third._make({"call": "pickle"})
        for other in (second, third):
            other.saved, other.ended = first.saved, first.ended.copy()
        for n, call in enumerate(calls[k + 1 :], start=k + 1):
            ends = [player.play(call) for player in (first, second, third)]
            for what, end in zip(("set state", "pickle"), ends[1:], strict=True):
                places = apart(ends[0].given, end.given, list(range(case["num_envs"])))
                if places or (ends[0].error is None) != (end.error is None):
                    text = f"the {what} of call {k} goes on differently ({ends[0].error}; {end.error})"
                    found.append(Violation("what_is_saved_continues", n, places[0] if places else -1, text))
                    return found
    return found


EPISODE_INVARIANTS: tuple[Callable[[PlayedEpisodes], list[Violation]], ...] = (
    only_documented_exceptions, a_refused_call_changes_nothing, observations_are_finite,
    observations_lie_in_their_space, no_early_end_pays, no_slider_is_beyond_its_stop,
    no_lane_depends_on_others, what_is_saved_continues,
)  # fmt: skip


def episode_violations(
    case: Case, make: Make = made, tally: Tally | None = None, chosen: Any = EPISODE_INVARIANTS
) -> list[Violation]:
    """All violations of a case of an environment."""
    tally = Tally() if tally is None else tally
    played = PlayedEpisodes(case, play_episodes(case, make), make, tally)
    tally.scenes += 1
    tally.refused += sum(step.error is not None for step in played.steps)
    for step in played.steps:
        if step.given.reward is not None:
            tally.intervals += case["num_envs"]
    return [violation for invariant in chosen for violation in invariant(played)]
