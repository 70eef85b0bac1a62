"""Is energy booked right, and is momentum kept? Potentials against their forces, and books of motions."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.algebra import numbered
from redundant_envs.effects.hooks import Effect, Field, Force, Inertia, PointMass
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.model.energy import at_joints, hook_value, kinetic_energy, potential_energy
from redundant_envs.scene import Scene
from redundant_envs.studies.verify.checks import (
    Array,
    Finding,
    Mode,
    NotApplicable,
    Trial,
    at_most,
    check,
    ratio,
)
from redundant_envs.studies.verify.equations import added_inertia, equations_at, from_points, slopes
from redundant_envs.studies.verify.states import random_states

BEYOND = 0.5
"""How far beyond the travel potentials are looked at, in units of it: springs at its ends act only there."""
STEP = 1e-5
"""Of the differences, rad and m: far below the lengths over which a potential changes its shape (1e-2),
far above what rounding needs (1e-11)."""
SHARE_OF_TRAVEL = 0.01
"""Of the travel of a joint, above which no difference goes: few of them straddle its ends."""
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


@check("potentials against forces", at_most(AGREEMENT), Mode.QUICK)
def potentials(trial: Trial) -> Finding:
    """Every effect's conservative force is minus the slope of its potential, also beyond the travel."""

    def has_one(effect: Effect) -> bool:
        hooks = effect.hooks(trial.scene.robot)
        return any(isinstance(h, Field) or (isinstance(h, Force) and h.conservative) for h in hooks)

    q = random_states(trial.scene, trial.count, trial.seed, BEYOND)[0]
    found = [_potential(trial, effect, q) for effect in trial.scene.effects if has_one(effect)]
    if not found:
        raise NotApplicable("no effect has a potential")
    return max(found, key=lambda f: f.found if f.found == f.found else np.inf)


def _potential(trial: Trial, effect: Effect, q: Array) -> Finding:
    arm: Any = trial.scene.robot
    alone = Scene(arm, (effect,))
    inverse = np.linalg.inv(arm.motor_map)  # from joint positions to coordinates
    here = np.abs(potential_energy(alone, q))
    slope, rough = np.empty_like(q), np.empty_like(q)
    step = np.full(len(arm.joints), STEP)
    for k, (lower, upper) in alone.travel().items():
        step[k] = min(STEP, SHARE_OF_TRAVEL * (alone.parameters()[upper] - alone.parameters()[lower]))
    for k in range(len(arm.joints)):

        def difference(steps: int, joint: int = k) -> Array:
            move = steps * step[joint] * inverse[joint]
            above, below = q + move, q - move
            moved = ((above - below) @ arm.motor_map)[:, joint]  # of a large angle not quite what was asked
            return (potential_energy(alone, above) - potential_energy(alone, below)) / moved

        near, far = difference(1), difference(2)
        slope[:, k] = -(4.0 * near - far) / 3.0
        rough[:, k] = np.abs(near - far)
    force = conservative_force(alone, effect, q)
    largest = np.maximum(np.abs(force), np.abs(slope)).max(axis=1)
    scale = np.maximum(largest, SMALL_FORCE * largest.max())[:, None]
    noise = ROUNDING * here[:, None] / step
    smooth = np.all(rough <= SMOOTH * scale + noise, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        gap = np.where(smooth[:, None], np.maximum(np.abs(force - slope) - noise, 0.0) / scale, 0.0)
    gap = np.where(scale > 0.0, gap, 0.0)
    most, where = trial.worst(gap)
    share = float(np.mean(smooth))
    if share < ENOUGH_SMOOTH:
        words = (
            f"{effect.key}: the potential can be differentiated at {100 * share:.0f} % of the states only; "
            "it must change smoothly"
        )
        return Finding(np.inf, effect.key, words)
    state, joint = np.unravel_index(int(np.argmax(gap)), gap.shape)
    words = (
        f"{effect.key}: at {arm.joints[joint]} the conservative force is {force[state, joint]:.6g} and minus "
        f"the derivative of the potential {slope[state, joint]:.6g}; one is wrong (its sign, a factor, its "
        "joint)"
    )
    return Finding(most, f"{where}, {effect.key}", words)


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


# ---- forces that change their law ----------------------------------------------------------------

CONTINUOUS = 1e-9
"""Largest jump of a force where its law changes, in units of the largest force nearby."""


@check("forces at their switches", at_most(CONTINUOUS), Mode.QUICK)
def forces_at_switches(trial: Trial) -> Finding:
    """Both laws of a force with a ``switch`` are equal where they meet, at random rates, its states as they
    are at the start."""
    found = [
        _jump(trial, effect, hook, limit, side)
        for effect in trial.scene.effects
        for hook in effect.hooks(trial.scene.robot)
        if isinstance(hook, Force) and hook.switch is not None
        for limit, side in zip(hook.switch, (-1.0, 1.0), strict=True)
    ]
    if not found:
        raise NotApplicable("no force changes its law at a position")
    return max(found, key=lambda f: f.found if f.found == f.found else np.inf)


def _jump(trial: Trial, effect: Effect, hook: Force, limit: str, side: float) -> Finding:
    arm: Any = trial.scene.robot
    q, qd, _ = trial.states
    own, joints = effect.parameters(), q @ arm.motor_map
    lower, upper = (own[name[1:]] for name in hook.switch or ())
    width = upper - lower if np.isfinite(upper - lower) else 1.0
    if not np.isfinite(own[limit[1:]]):
        return Finding(0.0)

    def force(beyond: Array | float, side: float) -> Array:
        joints[:, hook.joint] = own[limit[1:]] + beyond
        at = joints @ np.linalg.inv(arm.motor_map)
        values = {**arm.parameter_values(), "ax": 0.0, "ay": 0.0}
        for names, numbers in ((arm.coordinates, at), (arm.rates, qd)):
            values |= {name: numbers[:, k] for k, name in enumerate(names)}
        told = hook_value(arm, effect, hook, hook.function, values, side)
        return np.broadcast_to(np.asarray(told, np.float64), len(q))

    inside, outside = force(0.0, 0.0), force(0.0, side)
    share = np.linspace(0.0, BEYOND, len(q))
    nearby = np.maximum(np.abs(force(side * share * width, side)), np.abs(force(-side * share * width, 0.0)))
    # The place itself is rounded, which a stiff force between near limits feels.
    rounding = ROUNDING * (1.0 + np.abs(joints).sum(axis=1)) * nearby.max() / (BEYOND * width)
    most, where = trial.worst(ratio(np.maximum(np.abs(inside - outside) - rounding, 0.0), nearby.max()))
    state = int(np.argmax(np.abs(inside - outside)))
    words = (
        f"{effect.key}: at {hook.switch}, {limit} = {own[limit[1:]]:g} of {arm.joints[hook.joint]}, the "
        f"force is {inside[state]:.6g} by the law between and {outside[state]:.6g} by the law beyond; they "
        "must be equal, since a motion cannot be located where its force jumps to and fro"
    )
    return Finding(most, f"{where}, {effect.key}", words)


# ---- the energy book -----------------------------------------------------------------------------

OPEN = 1e-9
"""Largest gap of the energy book, in units of the energies that change hands: forty times what dop853 leaves
in scenes of all effects (2e-11), and far below what a wrong booking does."""
SAME = 0.1
"""Gaps that differ by no more than this, in units of ``OPEN``, when the interval is simulated whole and in
parts, are of the booking. Steps across a kink, such as that of a stiff spring, leave gaps of their own, and
their states say nothing."""
PARTS, EQUAL_STEPS = 3, 32


class Crossing(NamedTuple):
    """The end of a control interval.

    Attributes
    ----------
    q, qd : (n, joints)
    work : (n,) J
    good : (n,) whether there was no trouble
    """

    q: Array
    qd: Array
    work: Array
    good: NDArray[np.bool_]


def crossed(scene: Scene, q: Array, qd: Array, efforts: Array, parts: int = 1) -> Crossing:
    """A control interval by dop853, whole or in parts."""
    exact = dataclasses.replace(
        scene, integrator="dop853", substeps=1, tolerance=None, control_dt=scene.control_dt / parts
    )
    return moved(exact, q, qd, efforts, parts)


def moved(scene: Scene, q: Array, qd: Array, efforts: Array, intervals: int = 1) -> Crossing:
    """Some control intervals under constant efforts."""
    batch = BatchSimulator(scene, len(q), track_work=True)
    batch.set_state(q, qd)
    good = np.ones(len(q), np.bool_)
    for _ in range(intervals):
        good &= batch.advance(efforts).numerics == 0
    return Crossing(batch.q, batch.qd, batch.work, good)


def exact_whole(trial: Trial) -> Crossing:
    return crossed(trial.scene, *trial.states)


def calm_whole(trial: Trial) -> Crossing:
    if trial.calm_scene == trial.scene:
        return trial.shared(exact_whole)  # type: ignore[no-any-return]
    return crossed(trial.calm_scene, *trial.states)


def calm_in_parts(trial: Trial) -> Crossing:
    return crossed(trial.calm_scene, *trial.states, PARTS)


def exact_in_parts(trial: Trial) -> Crossing:
    """The same interval by other steps, of which the scene's own is none.

    Where effects renew their states at the end of an interval it cannot be parted, and has equal steps.
    """
    if all(state.update is None for state in trial.scene.states().values()):
        return crossed(trial.scene, *trial.states, PARTS)
    substeps = EQUAL_STEPS * trial.scene.substeps
    fine = dataclasses.replace(trial.scene, integrator="rk8", substeps=substeps, tolerance=None)
    return moved(fine, *trial.states)


def energy_changes(
    scene: Scene, q: Array, qd: Array, new_q: Array, new_qd: Array, work: Array
) -> tuple[Array, Array, Array]:
    """Change of kinetic + potential - work, the energies that change hands, those stored; (n,) each, J."""
    kinetic = [kinetic_energy(scene, *state) for state in ((q, qd), (new_q, new_qd))]
    potential = [potential_energy(scene, x) for x in (q, new_q)]
    gained = potential[1] - potential[0]
    scale = kinetic[0] + kinetic[1] + np.abs(gained) + np.abs(work)
    stored = np.abs(potential[0]) + np.abs(potential[1])
    return kinetic[1] - kinetic[0] + gained - work, scale, stored


@check("energy book", at_most(OPEN), Mode.QUICK)
def energy_book(trial: Trial) -> Finding:
    """Kinetic + potential - work is constant over a control interval, in units of the energies at hand.

    Where half of the motions are too wild for an interval, over a shorter one.
    """
    q, qd, _ = trial.states
    whole, parts = trial.shared(calm_whole), trial.shared(calm_in_parts)
    change, scale, stored = energy_changes(trial.scene, q, qd, *whole[:3])
    other = energy_changes(trial.scene, q, qd, *parts[:3])[0]
    noise = ROUNDING * stored
    judged = whole.good & parts.good & ~(np.abs(change - other) > SAME * OPEN * scale + noise)
    if np.mean(judged) < ENOUGH_SMOOTH:
        words = (
            f"energy: {100 * np.mean(judged):.0f} % of the intervals could be simulated without trouble and "
            f"to {OPEN * SAME:.0e} of their energies; that is too few to judge the scene by"
        )
        return Finding(np.inf, f"{np.mean(judged):.0%} of the states judged", words)
    gap = np.maximum(np.abs(change) - noise, 0.0)
    relative = np.where(judged, np.where(gap == 0.0, 0.0, ratio(gap, scale)), 0.0)
    most, where = trial.worst(np.where(np.isnan(relative), np.inf, relative))
    joules = np.abs(change[judged]).max()
    words = (
        f"energy: kinetic + potential - work changes by up to {joules:.3g} J in a control interval, "
        f"{most:.1e} of the energies at hand; a force is booked as what it is not: check potential and "
        "conservative of the effects"
    )
    return Finding(most, where, words)


# ---- momentum ------------------------------------------------------------------------------------

ADRIFT = 1e-9
"""Largest change of a momentum, in units of the parts it is the sum of: forty times what dop853 leaves of a
control interval, as of the energy book."""
MOVE, RIGID = 0.5, 1e-9
"""A joint that moves the whole arm by this, rad or m, changes its inertia by no more than that."""


def at_base(trial: Trial) -> Array:
    """Coordinates per unit of the first joint, (joints,); joints are linear in coordinates."""
    arm = trial.scene.robot
    turned = slopes(arm, numbered("phi{}", len(arm.joints)), trial.states[0][:1])[0]
    return np.asarray(np.linalg.inv(turned)[:, 0])


@check("momentum", at_most(ADRIFT), Mode.QUICK)
def momentum(trial: Trial) -> Finding:
    """Without a field, and with motors at all joints but the first, the momentum along that is kept.

    It turns the whole arm about the base, or slides it: that changes no inertia. The momentum is taken from
    the point masses, with what effects add to them.
    """
    q, qd, efforts = trial.states
    e, base = trial.shared(from_points), at_base(trial)
    added = added_inertia(trial)
    elsewhere = equations_at(trial.arm, added, q + MOVE * base)
    change = ratio(elsewhere.M - e.M, e.scale[:, :, None] * e.scale[:, None, :])
    if not change.max() <= RIGID:
        raise NotApplicable("the first joint moves the masses against each other")
    kept = tuple(
        x for x in trial.scene.effects
        if all(isinstance(h, PointMass | Inertia) for h in x.hooks(trial.scene.robot))
    )  # fmt: skip
    scene = Scene(trial.scene.robot, kept, control_dt=trial.calm_scene.control_dt)
    forces = np.where(np.arange(q.shape[1]) == 0, 0.0, efforts)
    end = crossed(scene, q, qd, forces)
    after = equations_at(trial.arm, added, end.q)
    before, then = (_momentum(at.M, rates, base) for at, rates in ((e, qd), (after, end.qd)))
    good = end.good & np.isfinite(then).all(axis=1)
    if np.mean(good) < ENOUGH_SMOOTH:
        raise NotApplicable("too few motions without a field could be simulated to rounding")
    size = np.maximum(before[:, 1], then[:, 1])
    gaps = np.where(good, ratio(np.where(good, then[:, 0] - before[:, 0], 0.0), size), 0.0)
    most, where = trial.worst(gaps)
    words = (
        f"{trial.arm.kind}: the momentum about the base changes by {most:.1e} of its parts without a moment "
        "there: M, h or Q is wrong"
    )
    return Finding(most, where, words)


def _momentum(M: Array, qd: Array, base: Array) -> Array:
    """The momentum of the first joint, and the sum of its parts without their signs, (n, 2)."""
    total = np.einsum("nij,j,ni->n", M, base, qd)
    size = np.einsum("nij,j,ni->n", np.abs(M), np.abs(base), np.abs(qd))
    return np.stack([total, size], axis=1)
