"""Is energy booked right? Potentials against their forces, and the energy book of a motion."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.algebra import numbered
from redundant_envs.effects.hooks import Effect, Field, Force
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.model.energy import at_joints, hook_value, kinetic_energy, potential_energy
from redundant_envs.scene import Scene

Array = NDArray[np.float64]

STEP = 1e-5
"""Of the differences, rad and m: far below the lengths over which a potential changes its shape (1e-2),
far above what rounding needs (1e-11)."""
AGREEMENT = 1e-5
"""Largest gap between a force and the slope of its potential, in units of the force: a thousand times what
the differences of a smooth potential are off."""
SMOOTH = 1e-6
"""Two differences that agree to this, in units of the force, see a smooth potential: at a kink, such as the
limit of a spring, no difference is a derivative, and the state says nothing."""
ROUNDING = 32 * np.finfo(np.float64).eps
"""Of a potential, in units of itself."""
ENOUGH_SMOOTH = 0.5
"""Share of the states that must be smooth, and of the intervals that must be judged."""
SMALL_FORCE = 1e-6
"""A force below this, in units of the largest of all states, is compared with that."""


@dataclass(frozen=True)
class Potential:
    """How far an effect's forces are from the slope of its potential.

    Attributes
    ----------
    effect : its name in parameters
    joint : the joint where the gap is largest
    force, slope : there: the conservative force, and minus the derivative of the potential, N m or N
    gap : their difference in units of the force
    smooth : share of the states at which the potential can be differentiated
    """

    effect: str
    joint: str
    force: float
    slope: float
    gap: float
    smooth: float

    @property
    def fault(self) -> str:
        """What is wrong, or nothing."""
        if self.smooth < ENOUGH_SMOOTH:
            return (
                f"{self.effect}: the potential can be differentiated at {100 * self.smooth:.0f} % of the "
                "states only; it must change smoothly"
            )
        if self.gap <= AGREEMENT:
            return ""
        return (
            f"{self.effect}: at {self.joint} the conservative force is {self.force:.6g} and minus the "
            f"derivative of the potential {self.slope:.6g}; one is wrong (its sign, a factor, its joint)"
        )


def potentials(scene: Scene, q: Array) -> tuple[Potential, ...]:
    """Compare every effect that has a potential with its conservative force, at coordinates (n, joints)."""

    def has_one(effect: Effect) -> bool:
        hooks = effect.hooks(scene.robot)
        return any(isinstance(h, Field) or (isinstance(h, Force) and h.conservative) for h in hooks)

    return tuple(_potential(scene, effect, q) for effect in scene.effects if has_one(effect))


def _potential(scene: Scene, effect: Effect, q: Array) -> Potential:
    arm: Any = scene.robot
    alone = Scene(arm, (effect,))
    inverse = np.linalg.inv(arm.motor_map)  # from joint positions to coordinates
    here = np.abs(potential_energy(alone, q))
    slope, rough = np.empty_like(q), np.empty_like(q)
    for k in range(len(arm.joints)):

        def difference(steps: int, joint: int = k) -> Array:
            move = steps * STEP * inverse[joint]
            return (potential_energy(alone, q + move) - potential_energy(alone, q - move)) / (
                2 * steps * STEP
            )

        near, far = difference(1), difference(2)
        slope[:, k] = -(4.0 * near - far) / 3.0
        rough[:, k] = np.abs(near - far)
    force = conservative_force(alone, effect, q)
    largest = np.maximum(np.abs(force), np.abs(slope)).max(axis=1)
    scale = np.maximum(largest, SMALL_FORCE * largest.max())[:, None]
    noise = (ROUNDING * here / STEP)[:, None]
    smooth = np.all(rough <= SMOOTH * scale + noise, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        gap = np.where(smooth[:, None], np.maximum(np.abs(force - slope) - noise, 0.0) / scale, 0.0)
    gap = np.where(scale > 0.0, gap, 0.0)
    state, joint = np.unravel_index(int(np.argmax(gap)), gap.shape)
    return Potential(
        effect.key,
        arm.joints[joint],
        float(force[state, joint]),
        float(slope[state, joint]),
        float(gap[state, joint]),
        float(np.mean(smooth)),
    )


def conservative_force(scene: Scene, effect: Effect, q: Array) -> Array:
    """The forces at the joints that an effect books as potential energy, (n, joints), N m or N."""
    arm: Any = scene.robot
    values = {**arm.parameter_values(), "ax": 0.0, "ay": 0.0}
    values |= {name: q[:, k] for k, name in enumerate(arm.coordinates)}
    force = np.zeros_like(q)
    for hook in effect.hooks(arm):
        if isinstance(hook, Force) and hook.conservative is not None:
            force += at_joints(arm, effect, hook, hook.conservative, values)
        elif isinstance(hook, Field):
            ax, ay = hook_value(arm, effect, hook, hook.function, values)
            weight = arm.evaluate(numbered("G{}", len(arm.joints)), {**values, "ax": ax, "ay": ay})
            columns = np.stack([np.broadcast_to(g, len(q)) for g in weight], axis=1)
            force -= columns @ np.linalg.inv(arm.motor_map).T
    return force


# ---- the energy book -----------------------------------------------------------------------------

OPEN = 1e-9
"""Largest gap of the energy book, in units of the energies that change hands: forty times what dop853 leaves
in scenes of all effects (2e-11), and far below what a wrong booking does."""
SAME = 0.1
"""Gaps that differ by no more than this, in units of ``OPEN``, when the interval is simulated whole and in
parts, are of the booking. Steps across a kink, such as that of a stiff spring, leave gaps of their own, and
their states say nothing."""
PARTS = 3


@dataclass(frozen=True)
class Book:
    """Kinetic + potential - work over a control interval, by dop853, whose error is near rounding.

    Attributes
    ----------
    gap : largest change of the sum, in units of kinetic energy, work and change of potential
    joules : the same, J
    judged : share of the states whose interval was simulated without trouble, and exactly enough to judge
    """

    gap: float
    joules: float
    judged: float

    @property
    def fault(self) -> str:
        """What is wrong, or nothing."""
        if self.judged < ENOUGH_SMOOTH:
            return (
                f"energy: {100 * self.judged:.0f} % of the intervals could be simulated without trouble and "
                f"to {OPEN * SAME:.0e} of their energies; that is too few to judge the scene by"
            )
        if self.gap <= OPEN:
            return ""
        return (
            f"energy: kinetic + potential - work changes by up to {self.joules:.3g} J in a control interval, "
            f"{self.gap:.1e} of the energies at hand; a force is booked as what it is not: check potential "
            "and conservative of the effects"
        )


def energy_book(scene: Scene, q: Array, qd: Array, efforts: Array) -> Book:
    """The energy book of a control interval from states and efforts, (n, joints) each."""
    whole, scale, kept, good = _change(scene, q, qd, efforts, 1)
    parts, _, _, also_good = _change(scene, q, qd, efforts, PARTS)
    noise = ROUNDING * kept
    with np.errstate(invalid="ignore", divide="ignore"):
        judged = good & also_good & ~(np.abs(whole - parts) > SAME * OPEN * scale + noise)
        gap = np.maximum(np.abs(whole) - noise, 0.0)
        relative = np.where(gap > 0.0, gap / scale, np.where(np.isnan(gap), np.inf, 0.0))
    relative, gap = relative[judged], gap[judged]
    return Book(float(relative.max(initial=0.0)), float(gap.max(initial=0.0)), float(np.mean(judged)))


def _change(
    scene: Scene, q: Array, qd: Array, efforts: Array, parts: int
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Change of kinetic + potential - work over a control interval by dop853, the energies that change hands,
    those that are stored [J], and whether there was no trouble; (n,) each."""
    exact = dataclasses.replace(
        scene, integrator="dop853", substeps=1, tolerance=None, control_dt=scene.control_dt / parts
    )
    batch = BatchSimulator(exact, len(q), track_work=True)
    batch.set_state(q, qd)
    good = np.ones(len(q), np.bool_)
    for _ in range(parts):
        good &= batch.advance(efforts).numerics == 0
    kinetic = [kinetic_energy(scene, *state) for state in ((q, qd), (batch.q, batch.qd))]
    potential = [potential_energy(scene, x) for x in (q, batch.q)]
    gained, work = potential[1] - potential[0], batch.work
    scale = kinetic[0] + kinetic[1] + np.abs(gained) + np.abs(work)
    return (
        kinetic[1] - kinetic[0] + gained - work,
        scale,
        np.abs(potential[0]) + np.abs(potential[1]),
        good,
    )
