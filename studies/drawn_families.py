"""Families of control intervals drawn by seed: every effect that changes a motion, alone and beside another.
The references are the same scene at smaller tolerances, and, for some lanes and all that are off,
:mod:`studies.another_account`, where it knows the scene."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.effects import Effect, Gravity
from redundant_envs.model import parameters
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.robots.arm import Arm
from redundant_envs.scenes.scene import Scene
from redundant_envs.verify.accuracy import agree
from studies import another_account, drawing
from studies.interval_families import LaneSamples, chosen, decades

Array = NDArray[np.float64]
KINDS = "plain", "plain", "fast", "folded", "at rest", "at stop", "near stop"
EFFORTS = "plain", "plain", "bang-bang", "none", "too large"
EFFORT = 0.01, 4.0
"""Of motors, in units of those that hold the stretched arm: these whirl light links around."""
GENERALIZED = 1.0 / 3.0
"""Share of families whose efforts act on the coordinates: what holds the whole arm acts on single links."""
FINER = 0.01, 0.001
"""Tolerances of references, in units of the scene's."""
VARIANTS = 16
"""Scenes of one structure with other numbers in a family: compiling takes longer than their intervals."""
SENSORS = "DroppedSamples", "Quantisation", "SensorBias", "SensorDelay", "SensorNoise"
"""Effects that change no motion."""
SUCCESSIVE = 8
"""Intervals in succession from one drawn state."""
MAX_GRAVITY = 30.0  # m/s^2
MAX_EVALUATIONS = 100_000
"""Of an interval: few take more."""
ENOUGH = 3e6
"""Evaluations of the intervals of a draw: where they take many it has fewer of them, and is the last one if
it has less than half of those asked for."""
AT_ONCE = 32
"""States drawn at once."""
MIN_SIZE, LARGEST_SIZE = 0.1, 10.0  # m


@dataclass(frozen=True)
class DrawnFamily:
    """Scenes of one structure by a seed and a number; each effect comes alone once in as many numbers."""

    seed: int
    number: int
    tolerance: float = 0.0  # m; by default one is drawn

    def __post_init__(self) -> None:
        if self.tolerance == 0.0:
            object.__setattr__(self, "tolerance", float(10.0 ** -self._rng(1).integers(3, 10)))

    def _rng(self, *more: int) -> np.random.Generator:
        return np.random.default_rng((self.seed, self.number, *more))

    @cached_property
    def variants(self) -> list[Scene]:
        """Scenes that differ in numbers alone."""
        rng, kinds = self._rng(), moving_effects()
        name = [*kinds][self.number % len(kinds)]
        control_dt = float(np.round(decades(rng, 0.005, 0.2), 4))
        actuation = "generalized" if self._rng(2).random() < GENERALIZED else "joint"
        scene = None
        while scene is None:
            arm: Arm = drawing.drawn_chain(rng) if rng.random() < 0.5 else drawing.drawn_arm(rng, calm=True)
            names = [name]
            if self.number // len(kinds) % 2:
                names.append(str(rng.choice([k for k in kinds if k not in (name, "Gravity")])))
            scene = made_scene(rng, arm, [kinds[n] for n in names], control_dt, actuation)
            if not MIN_SIZE <= drawing.size_of(arm) <= LARGEST_SIZE:
                scene = None
        others = (changed(rng, scene) for _ in range(20 * VARIANTS))
        return [scene, *itertools.islice((s for s in others if s is not None), VARIANTS - 1)]

    @property
    def name(self) -> str:
        scene = self.variants[0]
        arm: Any = scene.robot
        effects = " + ".join(type(e).__name__ for e in scene.effects)
        kind = arm.joint_types if arm.kind == "Chain" else arm.kind
        return f"{self.number}: {kind}, {effects}, {1e3 * scene.control_dt:g} ms, {scene.actuation}"

    @property
    def robot(self) -> Any:
        return self.variants[0].robot

    def scene(self, **how: Any) -> Scene:
        """The scene; ``how`` sets its stepping, by default its tolerance."""
        return dataclasses.replace(self.variants[0], **(how or {"tolerance": self.tolerance}))

    def references(self) -> list[Scene]:
        """Scenes whose tips are right where they agree, the most accurate one first."""
        return [self.scene(tolerance=max(f * self.tolerance, 1e-13)) for f in reversed(FINER)]

    def draw(self, count: int, rng: np.random.Generator) -> LaneSamples:
        """Random data of at most ``count`` lanes: starts of intervals in succession from random states."""
        states, drawn, spent = -(-count // SUCCESSIVE), list[LaneSamples](), 0.0
        for start in range(0, states, AT_ONCE):
            some, evaluations = self._drawn_from(min(AT_ONCE, states - start), rng)
            drawn.append(some)
            spent += evaluations
            if spent > ENOUGH:
                break
        samples = joined(drawn)
        return chosen(samples, np.arange(min(count, len(samples.joints))))

    def _drawn_from(self, few: int, rng: np.random.Generator) -> tuple[LaneSamples, float]:
        """Intervals in succession from ``few`` random states, and their evaluations in all."""
        scenes = self.variants
        which = np.sort(rng.integers(len(scenes), size=few))
        tables = [s.parameters() for s in scenes]
        numbers = {name: np.array([table[name] for table in tables])[which] for name in tables[0]}
        shares = [(s, int((which == k).sum())) for k, s in enumerate(scenes) if (which == k).any()]
        starts = [drawing.drawn_states(s, rng.choice(KINDS, n), rng) for s, n in shares]
        q, qd = (np.concatenate(parts) for parts in zip(*starts, strict=True))
        batch, fine, drawn, spent = begun(self.scene(), numbers, q, qd), np.arange(few), [], 0.0
        for _ in range(SUCCESSIVE):
            pushes = [drawing.drawn_efforts(s, rng.choice(EFFORTS, n), rng) for s, n in shares]
            efforts = np.concatenate(pushes)
            efforts *= decades(rng, *EFFORT, (few, 1))
            begin = batch.q, batch.qd, efforts, batch.z
            status = batch.advance(efforts)
            fine = fine[status.evaluations[fine] <= MAX_EVALUATIONS]
            drawn.append((*begin, fine))
            spent += float(status.evaluations.sum())
            fine = fine[status.numerics[fine] == 0]
        lanes = np.concatenate([one[-1] for one in drawn])
        q, qd, efforts, z = (np.concatenate([one[k][one[-1]] for one in drawn]) for k in range(4))
        B = self.robot.motor_map
        samples = LaneSamples(
            q @ B, qd @ B, efforts, {name: values[lanes] for name, values in numbers.items()},
            dict(zip(scenes[0].states(), z.T, strict=True)),
        )  # fmt: skip
        return samples, spent

    def tips_after(self, scene: Scene, drawn: LaneSamples) -> tuple[Array, Any]:
        """Tips after a control interval, (count, 2), m, and its status."""
        inverse = np.linalg.inv(self.robot.motor_map)
        batch = begun(scene, drawn.parameters, drawn.joints @ inverse, drawn.rates @ inverse)
        fields = tuple(batch.simulator.dynamics.effect_states)
        if fields:
            batch._memory.write(fields, np.stack([drawn.states[name] for name in fields], axis=1))
        status = batch.advance(drawn.efforts)
        values = drawn.parameters | dict(zip(self.robot.coordinates, batch.q.T, strict=True))
        values = {name: x for name, x in values.items() if "." not in name}
        tips = np.broadcast_arrays(*self.robot.evaluate(["tip_x", "tip_y"], values))
        return np.stack(tips, axis=-1), status

    def account_tips(self, drawn: LaneSamples, others: Array) -> Array:
        """Tips by another account, (count, 2), m; NaN where it does not know them. Where it does not confirm
        ``others``, it has to give the same with smaller steps."""
        scene, inverse = self.scene(), np.linalg.inv(self.robot.motor_map)
        if not another_account.tells(scene):
            return np.full((len(drawn.joints), 2), np.nan)

        def crossed(lanes: LaneSamples, error: float) -> Array:
            rows = [np.empty((0, 2))]
            for k in range(len(lanes.joints)):
                d = chosen(lanes, np.array([k]))
                account = another_account.Account(scene, d.parameters, d.efforts)
                tip = account.after(d.joints @ inverse, d.rates @ inverse, d.states, max(error, 1e-13))
                rows.append(tip)
            return np.concatenate(rows)

        tips = crossed(drawn, 1e-4 * self.tolerance)
        (apart,) = np.nonzero(np.isfinite(tips[:, 0]) & ~agree([tips, others], self.tolerance))
        again = crossed(chosen(drawn, apart), 1e-5 * self.tolerance)
        tips[apart] = np.where(agree([again, tips[apart]], self.tolerance)[:, None], again, np.nan)
        return tips


def moving_effects() -> dict[str, type[Effect]]:
    """Effects that change a motion, by name."""
    return {n: kind for n, kind in drawing.own_effects().items() if n not in SENSORS}


def made_scene(
    rng: np.random.Generator, arm: Arm, kinds: list[type[Effect]], control_dt: float, actuation: str = "joint"
) -> Scene | None:
    """A scene of some effects, with gravity in two of three; None if it cannot be."""
    if Gravity not in kinds and rng.random() < 0.67:
        kinds = [*kinds, Gravity]
    for _ in range(drawing.TRIES):
        try:
            effects = tuple(drawn_calmly(rng, kind, arm) for kind in kinds)
            return Scene(arm, effects, control_dt=control_dt, actuation=actuation)
        except ValueError:
            continue
    return None


def drawn_calmly(rng: np.random.Generator, kind: type[Effect], arm: Arm) -> Effect:
    """An effect with numbers of its own; ValueError if an arm under it only whirls."""
    effect = drawing.drawn_effect(rng, kind, arm)
    if isinstance(effect, Gravity) and effect.g > MAX_GRAVITY:
        raise ValueError(f"g is {effect.g} m/s^2")
    return effect


def changed(rng: np.random.Generator, scene: Scene) -> Scene | None:
    """The scene with other numbers; None if they do not fit."""
    arm: Any = scene.robot
    try:
        masses, lengths = drawing.drawn_numbers(rng, arm.num_masses, arm.num_lengths, calm=True)
        other = dataclasses.replace(arm, masses=masses, lengths=lengths)
        if not MIN_SIZE <= drawing.size_of(other) <= LARGEST_SIZE:
            return None
        effects = [
            dataclasses.replace(drawn_calmly(rng, type(e), other), **{n: getattr(e, n) for n in e.static})
            for e in scene.effects
        ]
        variant = dataclasses.replace(scene, robot=other, effects=tuple(effects))
    except (TypeError, ValueError):  # delays have their numbers of intervals from the scene, and keep theirs
        return None
    return variant if variant.parameters().keys() == scene.parameters().keys() else None


def joined(draws: Sequence[LaneSamples]) -> LaneSamples:
    """The lanes of several draws of a family."""
    parts = [[getattr(d, name) for d in draws] for name in ("joints", "rates", "efforts")]
    tables = [[d.parameters for d in draws], [d.states for d in draws]]
    merged = [{name: np.concatenate([t[name] for t in some]) for name in some[0]} for some in tables]
    joints, rates, efforts = map(np.concatenate, parts)
    return LaneSamples(joints, rates, efforts, *merged)


def begun(scene: Scene, numbers: dict[str, Array], q: Array, qd: Array) -> BatchSimulator:
    """A simulator whose lanes have numbers of their own, at the start of a motion."""
    batch = BatchSimulator(scene, len(q))
    parameters.write(scene, batch._memory, np.arange(len(q)), numbers)
    batch.set_state(q, qd)
    return batch
