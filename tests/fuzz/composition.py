"""Promises about scenes of any effects: neither their order, nor the evaluator, nor the way in which episodes
begin changes a motion."""

import dataclasses

import numpy as np

from redundant_envs.compiler.backends.torch import number
from redundant_envs.effects.hooks import Actuation, Friction, Impact, Sensing
from redundant_envs.model.torch_step import torch_step
from redundant_envs.scenes.numbers import OF_ARM, names_of
from redundant_envs.simulator.lane.direct import cross_interval, fields_of
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.interval import Interval
from redundant_envs.verify.evaluators import MAX_EVALUATIONS

from .drawing_calls import AUTORESETS
from .motions import FINE, advanced, begun, can_be_judged, in_equal_steps, rows, stops_of, values_of
from .playing import EnvironmentPlayer, lanes_now, same

NUDGE, STEADY = 1e-13, 1e-11
"""Relative change of rates and efforts at the start of an interval, and the most by which its end may change
for a lane to be compared: others magnify rounding, as steps too long for a stiff spring do."""
AGREE = 1e-9
"""Largest difference of two motions that differ by rounding, relative to the largest number of a kind."""
OF_TENSORS, LANES = 2, 8
"""Equal steps, and the most lanes, of an interval on tensors, which are slow."""
EPISODE, STEPS = 3, 11
"""Longest episode, and the control steps, of a comparison of environments that begin episodes differently."""


# ---- order of effects -----------------------------------------------------------------------------------


def places(effect, arm):
    """Where an effect acts that others do before or after it: in chains of motors and of sensors."""
    hooks = effect.hooks(arm)
    links = {(h.link, h.joint) for h in hooks if isinstance(h, Actuation)}
    return links | {(h.reading, h.joint) for h in hooks if isinstance(h, Sensing)}


def reordered(scene, rng):
    """The scene with its effects in a random order, in which those that do not commute keep theirs."""
    left, chosen = [(e, places(e, scene.robot)) for e in scene.effects], []
    while left:
        free = [k for k, (_, own) in enumerate(left) if not any(own & before for _, before in left[:k])]
        chosen.append(left.pop(rng.choice(free))[0])
    return dataclasses.replace(scene, effects=tuple(chosen))


def effects_commute(played):
    """Effects in another order give the same motion to rounding, in equal steps."""
    scene = played.scene
    if len(scene.effects) < 2:
        return
    equal = in_equal_steps(scene, FINE[0][0])
    other = reordered(equal, np.random.default_rng(len(scene.effects)))
    for k, step in played.intervals():
        lanes = np.flatnonzero(can_be_judged(scene, step))
        if not len(lanes):
            continue
        end, steady = steady_end(scene, equal, step, lanes)
        found = end_of(scene, other, step, lanes)
        played.tally["commuted"] += int(steady.sum())
        for lane in lanes[steady & (apart(end, found) > AGREE)]:
            order = ", ".join(e.key for e in other.effects)
            yield k, lane, f"another motion in the order {order}"


def end_of(scene, other, step, lanes, nudge=0.0):
    """What some lanes are after an interval of another scene with the same states: names -> columns; NaN
    where the interval was flagged. Positions, rates and efforts are off by a share ``nudge`` of them, or of
    1 rad and 1 rad/s."""
    start, robot, values = rows(step.before, lanes), scene.robot, values_of(scene, rows(step.before, lanes))
    unit = np.where(robot.prismatic, sum(robot.lengths), 1.0)
    start |= {
        name: x + nudge * np.maximum(np.abs(x), unit) for name, x in start.items() if name in ("q", "qd")
    }
    for stop in stops_of(scene, start["q"], values):
        if stop.beyond.any():
            joints = start["q"] @ robot.motor_map
            joints[:, stop.joint] = np.clip(joints[:, stop.joint], stop.lower, stop.upper)
            start["q"] = np.where(stop.beyond[:, None], joints @ np.linalg.inv(robot.motor_map), start["q"])
    batch = begun(scene, other, start)
    status = advanced(batch, step.call, lanes, 1.0 + nudge)
    flagged = status.numerics != 0
    now = lanes_now(batch)
    found = {name: now[name] for name in ("q", "qd", "work")}
    found |= dict(zip(other.states(), now["z"].T, strict=True))
    return {name: table_of(values, flagged) for name, values in found.items()}


def table_of(values, flagged):
    values = values.reshape(len(flagged), -1)
    return np.where(flagged[:, None], np.nan, values)


def apart(some, others):
    """The largest difference of each lane, of each name relative to the lane's largest number of it, or to
    a thousandth of that of all lanes."""
    gaps = []
    for name, table in some.items():
        size = np.abs(table).max(axis=1)
        size = np.maximum(size, 1e-3 * np.nanmedian(size) if np.isfinite(size).any() else 0.0)
        gap = np.abs(table - others[name]).max(axis=1)
        gaps.append(np.where(gap == 0.0, 0.0, gap / size))
    return np.where(np.isnan(gaps).any(axis=0), np.inf, np.max(gaps, axis=0))


def steady_end(scene, other, step, lanes):
    """What some lanes are after an interval, and which of them hardly change with its start."""
    end = end_of(scene, other, step, lanes)
    nudged = [apart(end, end_of(scene, other, step, lanes, s * NUDGE)) for s in (-1.0, 1.0)]
    return end, np.max(nudged, axis=0) < STEADY


# ---- evaluators -----------------------------------------------------------------------------------------


def evaluators_agree(played):
    """Arrays, single numbers and tensors give the motion of compiled code, and so does ``torch_step`` where
    it takes a scene."""
    scene, known = played.scene, played.tally["single_numbers"]
    for k, step in played.intervals():
        lanes = np.flatnonzero(can_be_judged(scene, step) & (step.told["evaluations"] <= MAX_EVALUATIONS))
        if step.call["call"] != "advance" or not len(lanes):
            continue
        yield from differences(played, scene, k, lanes[:LANES], (arrays, single_numbers, tensors))
        if not scene.attached.of(Impact, Friction):  # these have no derivative
            equal = in_equal_steps(scene, OF_TENSORS)
            yield from differences(played, equal, k, lanes[:LANES], (by_torch_step,))
        if played.tally["single_numbers"] > known:  # without a compiler an interval takes a second
            return


def differences(played, scene, k, lanes, evaluators):
    """Lanes that a scene of the same effects moves otherwise by one of some evaluators than compiled code."""
    step = played.steps[k]
    end, steady = steady_end(played.scene, scene, step, lanes)
    for evaluator in evaluators if steady.any() else ():
        name = evaluator.__name__
        found = evaluator(scene, rows(step.before, lanes), step.call["efforts"][lanes])
        gaps = apart({n: end[n] for n in found}, {n: x.reshape(len(lanes), -1) for n, x in found.items()})
        played.tally[name] += int(steady.sum())
        for lane in lanes[steady & (gaps > AGREE)]:
            yield k, lane, f"another motion by {name}"


def arrays(scene, start, efforts, convert=np.ascontiguousarray):
    """Lanes after an interval without a compiler, by the procedures on numbers of another kind."""
    dynamics = Dynamics(scene)
    own = {dynamics.parameters.field_of(n): x for n, x in values_of(scene, start).items()}
    fields = fields_of(dynamics, own) | dict(zip(dynamics.effect_states, start["z"].T, strict=True))
    for names, table in (
        (dynamics.states, np.concatenate([start["q"], start["qd"]], axis=1)),
        (dynamics.commands, efforts), (dynamics.draw_fields, start["draws"]),
    ):  # fmt: skip
        fields |= dict(zip(names, table.T, strict=False))
    lane = cross_interval(Interval(dynamics), {n: convert(x) for n, x in fields.items()})
    count = len(start["q"])
    joints = dynamics.count
    names = (*dynamics.states[: 2 * joints], *dynamics.effect_states)
    table = np.stack([np.broadcast_to(np.asarray(lane[n]), count) for n in names], axis=1)
    found = {"q": table[:, :joints], "qd": table[:, joints : 2 * joints]}
    return found | dict(zip(scene.states(), table[:, 2 * joints :].T, strict=True))


def single_numbers(scene, start, efforts):
    """The first lane on single numbers, and others as they are by arrays."""
    found = arrays(scene, start, efforts)
    first = arrays(scene, rows(start, [0]), efforts[:1], lambda x: np.float64(np.ravel(x)[0]))
    return {name: np.concatenate([first[name], x[1:]]) for name, x in found.items()}


def tensors(scene, start, efforts):
    return arrays(scene, start, efforts, number)


def by_torch_step(scene, start, efforts):
    found = dict(zip(("q", "qd", "z"), torch_step(scene)(*arguments_of(scene, start, efforts)), strict=False))
    found = {name: x.numpy() for name, x in found.items()}
    z = found.pop("z") if scene.states() else np.zeros((len(efforts), 0))
    return found | dict(zip(scene.states(), z.T, strict=True))


def arguments_of(scene, start, efforts):
    """Arguments of ``torch_step``."""
    values = values_of(scene, start)
    given = {name: value for name, value in values.items() if "." in name}
    given |= {name: np.stack([values[n] for n in names_of(scene, name)], -1) for name in OF_ARM}
    z, draws = (start[name] if start[name].size else None for name in ("z", "draws"))
    return start["q"], start["qd"], efforts, given, z, draws


# ---- episodes ------------------------------------------------------------------------------------------


def autoresets_begin_the_same_episodes(played):
    """Episodes are the same to the last bit in every autoreset mode."""
    case = played.case
    seeds = np.random.default_rng(case["num_envs"]).integers(2**31, size=case["num_envs"])
    told = [list(episodes(case, mode, seeds.tolist())) for mode in AUTORESETS]
    for mode, other in zip(AUTORESETS[1:], told[1:], strict=True):
        for lane, (some, others) in enumerate(zip(told[0], other, strict=True)):
            played.tally["episodes"] += 1
            for one, twin in zip(some, others, strict=False):
                if not np.all(same(one, twin)):
                    yield -1, lane, f"an episode with {mode} has other bits than one with {AUTORESETS[0]}"
                    break


def episodes(case, mode, seeds):
    """What the lanes of a vector are told in some episodes, in the order of each lane; actions follow from
    the lane, the number of the episode, and the step in it."""
    player = EnvironmentPlayer(
        {**case, "face": "vector", "autoreset_mode": mode, "max_episode_steps": EPISODE, "threads": 1}
        | {"on_bad_action": "terminate"}
    )
    env, count = player.subject, case["num_envs"]
    joints = len(player.scene.robot.joints)
    shape = (count, STEPS + 1, EPISODE, joints)
    actions = np.random.default_rng(1).uniform(-1.0, 1.0, shape).astype(np.float32)
    number, at, lanes = np.zeros(count, int), np.zeros(count, int), np.arange(count)
    told = [[] for _ in lanes]

    def tell(lane, observation, *more):
        told[lane].append(np.concatenate([*observation, *more], dtype=np.float64))

    obs, _ = env.reset(seed=seeds)
    for lane in lanes:
        tell(lane, parts_of(player, obs, lane))
    begins = np.zeros(count, np.bool_)
    for _ in range(STEPS):
        if mode == "disabled" and begins.any():
            obs, _ = env.reset(options={"reset_mask": begins.copy()})
            for lane in np.flatnonzero(begins):
                tell(lane, parts_of(player, obs, lane))
            begins[:] = False
        obs, reward, terminated, truncated, infos = env.step(actions[lanes, number, at])
        ended = terminated | truncated
        for lane in lanes:
            if mode == "next_step" and begins[lane]:
                tell(lane, parts_of(player, obs, lane))
                continue
            last = infos["final_obs"][lane] if mode == "same_step" and ended[lane] else None
            of_step = parts_of(player, obs, lane) if last is None else parts_of_one(last)
            tell(lane, of_step, [reward[lane], terminated[lane], truncated[lane]])
            if last is not None:
                tell(lane, parts_of(player, obs, lane))
        running = ~begins if mode == "next_step" else np.ones(count, np.bool_)
        at[running] += 1
        number[ended], at[ended] = number[ended] + 1, 0
        begins = ended.copy()
    return told


def parts_of(player, observation, lane):
    tables = player.tables(observation)
    return [tables[name][lane] for name in sorted(tables)]


def parts_of_one(observation):
    named = observation if isinstance(observation, dict) else {"": observation}
    return [np.ravel(named[name]) for name in sorted(named)]
