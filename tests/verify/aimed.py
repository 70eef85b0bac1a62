"""All motions of which every bit is recorded: those of the package, and those aimed at rare cases.

The aimed ones meet every way in which a lane crosses a control interval: sliders at rest at their stops, or
nearer to them than rounding, at speeds from 1e-16 m/s on; several sliders at once; links too fast for any
number of steps. Each has many lanes and few intervals.

``python -m tests.verify.aimed`` writes new records; a commit that changes them says why.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects.hooks import Actuation, Effect, Force, Link, State, at_each_joint, effort_unit
from redundant_envs.language.algebra import clamp, maximum, physics, where
from redundant_envs.scenes.files import read_yaml
from redundant_envs.support.values import typed
from redundant_envs.verify import recorded_bits
from redundant_envs.verify.recorded_bits import digest, events, outcome

approach = physics(lambda command, effort, time_constant: (command - effort) / time_constant)
effort_of = physics(lambda effort: effort)
fastest_change = physics(lambda time_constant: 1.0 / time_constant)
wind_up = physics(lambda rate, position, turn: 0.5 * turn + 0.1 * rate + 0.01 * position)
dry = physics(lambda rate, level: where(rate > 0.0, -level, level))


@dataclass(frozen=True)
class Lag(Effect):
    """The effort of each motor approaches its command: a state of each is integrated beside the arm's."""

    time_constant: float

    @at_each_joint
    def hooks(self, k, arm):
        own = {"effort": f".effort[{k}]", "time_constant": ".time_constant"}
        bind, unit = {"command": f"command{k + 1}", **own}, effort_unit(arm, k)
        state = State(f"effort[{k}]", unit, derivative=approach, bind=bind, rate=fastest_change)
        return Actuation(k, effort_of, own, Link.LAG, states=(state,))


@physics
def backlash(rate, position, turn, play, drag):
    beyond = maximum(abs(position - turn) - play, 0.0)
    return -drag * beyond * clamp(10.0 * rate, -1.0, 1.0)


@dataclass(frozen=True)
class Play(Effect):
    """A force on the last joint with two kinks, and a state that changes after each interval only."""

    play: float
    drag: float

    def hooks(self, arm):
        k = len(arm.coordinates)
        here = {"rate": f"phid{k}", "position": f"phi{k}", "turn": ".turn"}
        state = State("turn", "rad", update=wind_up, bind=here)
        return (Force(k - 1, backlash, {**here, "play": ".play", "drag": ".drag"}, states=(state,)),)


@dataclass(frozen=True)
class DryFriction(Effect):
    """A force on the last joint that jumps where its rate changes its sign: pulls of stops jump with it."""

    level: float

    def hooks(self, arm):
        k = len(arm.coordinates)
        return (Force(k - 1, dry, {"rate": f"phid{k}", "level": ".level"}),)


RECORD = Path(__file__).with_name("aimed_bits.json")
ENTRIES = read_yaml(Path(__file__).with_name("aimed_motions.yaml"), "record")
OWN = {"Lag": Lag, "Play": Play, "DryFriction": DryFriction}
ARMS, EFFECTS = dict(recorded_bits.ARMS), dict(recorded_bits.EFFECTS)
ARMS |= {name: typed(name, entry, rde.robots.REGISTRY) for name, entry in ENTRIES["arms"].items()}
EFFECTS |= {name: typed(name, entry, {**e.REGISTRY, **OWN}) for name, entry in ENTRIES["effects"].items()}
FALL = 5.886  # acceleration of a free slider along +x under the gravity of "gravity", m/s^2


def effect_of(words, arm):
    """The effect that some words name; "stops" are farther out for each slider than for the one before."""
    name, _, joint = words.rpartition(" ")
    if name in ENTRIES["springs"]:
        return e.LimitSpring(joint, **ENTRIES["springs"][name])
    if words != "stops":
        return EFFECTS[words]
    sliders = range(len(arm.sliders()))
    lower, upper = (-0.2 * (1.0 + 0.3 * k) for k in sliders), (0.2 + 0.1 * k for k in sliders)
    return e.PrismaticStop(tuple(lower), tuple(upper), 0.5)


AT = ("at rest", "slow, at stops")
NEAR = ("slow, near stops", "near stops", "still", "spun")
KINDS = ("anywhere", *AT, *NEAR[:3], "fast", "together", "one strikes", "broken")
"""Of starts: sliders at stops, or up to 0.1 m away, all striking at once; numbers that are not finite."""


@dataclass(frozen=True)
class Aimed:
    """A motion of a scene."""

    scene: rde.Scene
    work: bool  # whether it is tracked and events are logged
    varied: bool = True  # whether each lane has masses and a restitution of its own
    speeds: float = 1.0  # the greatest of links and sliders at the start is 10 to this power, rad/s and m/s
    fastest: float = 1e5  # speed of the first joint in one lane, rad/s or m/s
    lanes: int = 512
    intervals: int = 16
    kinds: Sequence[str] = KINDS  # of starts, one after the other
    efforts: float = 1.5  # the greatest is 10 to this power, N m or N
    numbers: Mapping[str, float] = field(default_factory=dict)  # instead of the scene's: for shared code


def aimed(name):
    """The motion of an entry of the file, from which the fields of its scene are taken."""
    entry, method = dict(ENTRIES["aimed"][name]), name.partition(",")[0]
    of_scene = {"tolerance": float(method)} if method[0] == "1" else {"integrator": method}
    of_scene |= {n: entry.pop(n) for n in ("control_dt", "substeps", "actuation") if n in entry}
    arm = ARMS[entry.pop("arm")]
    effects = tuple(effect_of(words, arm) for words in entry.pop("effects"))
    return Aimed(rde.Scene(arm, effects, **of_scene), name.endswith("log"), **entry)


LOG2_OF_10 = 3.3219280948873626
BROKEN = np.nan, np.inf, 1e200, 1e60, 1e20  # rates that are no numbers, or soon lead to one that is none


def powers(rng, low, high, shape):
    """Numbers from about 10^low to 10^high of either sign, the same on every machine."""
    exponents = np.floor(LOG2_OF_10 * (low + (high - low) * rng.random(shape))).astype(np.int64)
    return np.where(rng.random(shape) < 0.5, -1.0, 1.0) * np.ldexp(1.0 + rng.random(shape), exponents)


def starts(aimed, rng):
    """States of lanes: of each kind in turn."""
    arm, n = aimed.scene.robot, aimed.lanes
    shape = n, len(arm.coordinates)
    kinds = np.array(aimed.kinds)[np.arange(n) % len(aimed.kinds)]
    q = 3.0 * rng.random(shape) - 1.5
    qd = 6.0 * rng.random(shape) - 3.0
    for kind, speeds in (
        ("at rest", 0.0 * qd), ("still", 0.0 * qd), ("slow, at stops", powers(rng, -16.0, 0.0, shape)),
        ("slow, near stops", powers(rng, -14.0, 0.5, shape)), ("near stops", 0.3 * qd),
        ("fast", powers(rng, 0.0, aimed.speeds, shape)),
    ):  # fmt: skip
        qd[kinds == kind] = speeds[kinds == kind]
    speed = np.abs(powers(rng, -8.0, 0.5, n))
    soon = np.abs(powers(rng, -4.0, -2.0, n))
    stops = [x for x in aimed.scene.effects if isinstance(x, e.PrismaticStop)]
    for i, k in enumerate(arm.sliders()):
        q[:, k] *= 0.1
        for effect in stops:
            ends = effect.lower[i], effect.upper[i]
            low, high = (far if end is None else end for far, end in zip((-1.0, 1.0), ends, strict=True))
            up = rng.random(n) < 0.5
            stop, inward = np.where(up, high, low), np.where(up, -1.0, 1.0)
            away = np.abs(powers(rng, -18.0, -1.0, n)) * np.isin(kinds, NEAR)
            placed = (rng.random(n) < 0.8) & np.isin(kinds, (*AT, *NEAR))
            placed |= np.isin(kinds, ("together", "one strikes"))
            q[:, k] = np.clip(np.where(placed, stop + inward * away, q[:, k]), low, high)
            qd[:, k] = np.where(kinds == "together", -inward * speed, qd[:, k])
            way = np.abs(qd[:, k]) * soon * (1.0 + powers(rng, -14.0, -6.0, n))
            nearly = kinds == "nearly together"
            q[:, k] = np.where(nearly, stop + inward * way, q[:, k])
            qd[:, k] = np.where(nearly, -inward * np.abs(qd[:, k]), qd[:, k])
    turns = ~np.array(arm.prismatic)
    for k in np.flatnonzero(turns).tolist():
        qd[kinds == "nearly together", k] = 0.0
        qd[:, k] = np.where(kinds == "spun", powers(rng, 1.0, 2.3, n), qd[:, k])
    alone = kinds == "one strikes"
    striking = rng.integers(0, len(arm.sliders()) or 1, n)
    for i, k in enumerate(arm.sliders()):
        qd[:, k] = np.where(alone, np.where(striking == i, np.sign(q[:, k]) * speed, 0.0), qd[:, k])
    qd[alone] *= arm.prismatic
    for kind, sides, speeds in (
        ("folded", powers(rng, -7.0, -3.0, shape), powers(rng, -1.0, 1.0, shape)),
        ("in step", 0.01 * rng.random((n, 1)), powers(rng, 0.0, 1.0, (n, 1))),
    ):
        q[kinds == kind] = np.where(turns & (kind == "in step"), 0.0, sides + 0.0 * q)[kinds == kind]
        qd[kinds == kind] = np.where(turns, 0.0, speeds + 0.0 * qd)[kinds == kind]
    q[kinds == "at a kink"] = 0.0
    q[kinds == "at a kink", -1] = 0.02  # the play of "play"
    qd[kinds == "round", 0] = np.ldexp(1.0, rng.integers(4, 9, n))[kinds == "round"]
    qd[kinds == "round", 1:] *= 0.1
    _send_past(aimed, rng, kinds, q, qd)
    broken = np.flatnonzero(kinds == "broken")[: len(BROKEN) + 1]
    qd[broken, 0] = (aimed.fastest, *BROKEN)[: len(broken)]
    return q, qd


def _send_past(aimed, rng, kinds, q, qd):
    """Lanes of an arm that begins with a slider: thrown against gravity, it turns very near its lower stop
    within an interval; or it creeps there from within rounding."""
    if not np.isin(kinds, ("thrown", "creeping")).any():
        return
    (stop,) = (float(x.lower[0] or 0.0) for x in aimed.scene.effects if isinstance(x, e.PrismaticStop))
    n, h = aimed.lanes, aimed.scene.control_dt
    turn, miss = h * rng.random(n), powers(rng, -17.0, -1.0, n)
    turn[::2] = 0.5 * h * (1.0 + miss[::2])
    height = np.maximum(0.5 * FALL * turn * turn * (1.0 + miss[::-1]), 0.0)
    creeping = np.abs(stop) * np.ldexp(np.floor(8.0 * rng.random(n)), -53)
    for kind, way, speed in (
        ("thrown", height, FALL * turn), ("creeping", creeping, creeping / (h * (0.2 + rng.random(n)))),
    ):  # fmt: skip
        hanging = [0.0 if slides else -0.5 * np.pi for slides in aimed.scene.robot.prismatic]
        q[kinds == kind], qd[kinds == kind] = hanging, 0.0
        q[:, 0] = np.where(kinds == kind, stop + way, q[:, 0])
        qd[:, 0] = np.where(kinds == kind, -speed, qd[:, 0])


def motion(name):
    """Tables of numbers, interval by interval."""
    aimed_one, rng = aimed(name), np.random.default_rng(len(f"events: {name}"))
    q, qd = starts(aimed_one, rng)
    batch = rde.BatchSimulator(aimed_one.scene, aimed_one.lanes, track_work=aimed_one.work)
    batch.set_state(q, qd)
    if aimed_one.varied:  # light masses between heavy ones among them
        values = {"masses": np.abs(powers(rng, -1.5, 1.0, q.shape))}
        if any(isinstance(effect, e.PrismaticStop) for effect in aimed_one.scene.effects):
            values["prismatic_stop.restitution"] = rng.choice((0.0, 0.5, 1.0, 0.1, 0.95), aimed_one.lanes)
        batch.set_parameters(values)
    batch.set_parameters(aimed_one.numbers)
    range_of_efforts = aimed_one.efforts - 4.5, aimed_one.efforts
    steady = powers(rng, *range_of_efforts, q.shape)
    for _ in range(aimed_one.intervals):
        changing = rng.random(q.shape) < 0.5
        steady = np.where(changing, powers(rng, *range_of_efforts, q.shape), steady)
        steady[::4] = 0.0
        yield from outcome(batch, steady)
        if aimed_one.work:
            yield np.array([f"{x.kind} {x.joint}" for x in events(batch)])


AIMED = {f"events: {name}": partial(motion, name) for name in ENTRIES["aimed"]}
RECORDED = {**recorded_bits.RECORDED, **AIMED}
"""Everything that is recorded, by name."""


def found(name):
    """The digest of a motion on this machine."""
    return digest(RECORDED[name]())


def recorded():
    """The recorded digests by name."""
    return {n: d for file in (recorded_bits.RECORD, RECORD) for n, d in json.loads(file.read_text()).items()}


if __name__ == "__main__":
    for file, motions in ((recorded_bits.RECORD, recorded_bits.RECORDED), (RECORD, AIMED)):
        digests = {}
        for name in motions:
            digests[name] = found(name)
            print(f"{digests[name]}  {name}", flush=True)
        file.write_text(json.dumps(digests, indent=1) + "\n", encoding="utf-8")
