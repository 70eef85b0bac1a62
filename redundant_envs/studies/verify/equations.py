"""Do the equations of an arm belong together? Each is found again from the point masses.

The equations are run on numbers with derivatives, so what is compared is exact to rounding. Forces and
inertias are compared in units in which the mass matrix has ones on its diagonal: neither the unit of a joint
nor a light link at the end of a heavy arm hides a mistake. Sums of at most ten joints in float64, whose terms
may cancel, lose some 1e-14 in these units; sines of joint angles that a user's equations add up lose as much.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from redundant_envs.algebra import numbered
from redundant_envs.dual import Dual, dual
from redundant_envs.effects.hooks import Inertia
from redundant_envs.quantities import Quantities
from redundant_envs.robots.arm import Arm
from redundant_envs.simulator.direct import fields_of
from redundant_envs.simulator.dynamics import Dynamics
from redundant_envs.studies.verify.checks import (
    Array,
    Finding,
    Mode,
    NotApplicable,
    Trial,
    at_least,
    at_most,
    check,
    ratio,
)

AGREE = at_most(1e-10)
"""A thousand times and more what rounding leaves, and a thousandth of what the smallest mistake in a formula
makes: a factor, a sign, an index."""
LEAST = 1e-4
"""Forces of the motion itself are compared with at least this share of what its energy could make: a single
link has none of them, and sums over its point mass leave rounding."""


class Equations(NamedTuple):
    """What follows from the point masses alone, at the states of a trial.

    Attributes
    ----------
    points : (n, masses, 2)
    slopes : (n, masses, 2, joints)
        Derivatives of the points by the coordinates.
    M : (n, joints, joints)
        Mass matrix, inertias that effects add included.
    scale : (n, joints)
        Roots of its diagonal.
    change : (n, joints, joints, joints)
        Derivatives of the arm's own mass matrix by the coordinates, the last axis.
    """

    points: Array
    slopes: Array
    M: Array
    scale: Array
    change: Array


def values_of(arm: Arm, q: Array, qd: Array | None = None, along: Array | None = None) -> dict[str, Any]:
    """Known quantities of an arm at some states; with ``along`` the coordinates have these derivatives."""
    values: dict[str, Any] = {**arm.parameter_values(), "ax": 0.0, "ay": 0.0}
    for k, name in enumerate(arm.coordinates):
        values[name] = q[:, k] if along is None else Dual(q[:, k], along[:, k])
    if qd is not None:
        values |= {name: qd[:, k] for k, name in enumerate(arm.rates)}
    return values


def table(arm: Arm, names: Iterable[str], values: dict[str, Any], count: int, slope: bool = False) -> Array:
    """Quantities, or their derivatives, (count, names)."""
    found = arm.evaluate(names, values)
    parts = [dual(x).slope if slope else x for x in found]
    return np.stack([np.broadcast_to(np.asarray(x, float), count) for x in parts], axis=-1)


def slopes(arm: Arm, names: Iterable[str], q: Array) -> Array:
    """Derivatives of quantities of the position by each coordinate, (n, names, joints)."""
    wanted, columns = list(names), []
    for k in range(q.shape[1]):
        along = np.zeros_like(q)
        along[:, k] = 1.0
        columns.append(table(arm, wanted, values_of(arm, q, along=along), len(q), slope=True))
    return np.stack(columns, axis=-1)


def entries(letter: str, rows: int, columns: int) -> list[str]:
    return [f"{letter}{i + 1}{j + 1}" for i in range(rows) for j in range(columns)]


def added_inertia(trial: Trial) -> Array:
    """What effects add to the mass matrix beside masses, (joints, joints)."""
    arm = trial.scene.robot
    total = np.zeros((len(arm.joints),) * 2)
    for effect in trial.scene.effects:
        for hook in effect.hooks(arm):
            if isinstance(hook, Inertia):
                direction = arm.motor_map[:, list(hook.joints)].sum(axis=1)
                total += effect.parameters()[hook.inertia[1:]] * np.outer(direction, direction)
    return total


def from_points(trial: Trial) -> Equations:
    return equations_at(trial.arm, added_inertia(trial), trial.states[0])


def equations_at(arm: Arm, added: Array, q: Array) -> Equations:
    """What follows from the point masses, and from what effects add to the mass matrix."""
    n, joints, masses = len(q), len(arm.joints), np.array(arm.masses)
    of_points = [f"{axis}{k + 1}" for k in range(arm.num_masses) for axis in "xy"]
    slope = slopes(arm, of_points, q).reshape(n, -1, 2, joints)
    M = np.einsum("p,npai,npaj->nij", masses, slope, slope) + added
    change = slopes(arm, entries("M", joints, joints), q).reshape(n, joints, joints, joints)
    return Equations(arm.points(q), slope, M, np.sqrt(np.einsum("nii->ni", M)), change)


def _found(trial: Trial, gaps: Array, what: str, names: Iterable[str] = ()) -> Finding:
    gap, where = trial.worst(gaps, names)
    return Finding(gap, where, f"{trial.arm.kind}: {what} by {gap:.1e} of its size")


@check("mass matrix", AGREE, Mode.QUICK)
def mass_matrix(trial: Trial) -> Finding:
    """M is the sum of m_k J_k^T J_k over the point masses."""
    own, e = trial.arm.mass_matrix(trial.states[0]), trial.shared(from_points)
    gaps = ratio(own - e.M, e.scale[:, :, None] * e.scale[:, None, :])
    return _found(trial, gaps, "M contradicts the point masses")


@check("mass matrix is positive", at_least(1e-14), Mode.QUICK)
def positive(trial: Trial) -> Finding:
    """The smallest eigenvalue of M, its diagonal scaled to ones.

    Positive masses and lengths make it positive in every pose; below 1e-14 rounding may make it negative.
    """
    own, e = trial.arm.mass_matrix(trial.states[0]), trial.shared(from_points)
    scaled = own / (e.scale[:, :, None] * e.scale[:, None, :])
    if not np.isfinite(scaled).all():
        return Finding(np.nan, "", f"{trial.arm.kind}: M is not finite, or a joint moves no mass")
    least = np.linalg.eigvalsh(0.5 * (scaled + np.swapaxes(scaled, 1, 2)))[:, 0]
    state = int(np.argmin(least))
    words = f"{trial.arm.kind}: M is not positive definite: a motion has no, or negative, kinetic energy"
    return Finding(float(least[state]), f"state {state}", words)


@check("bias forces", AGREE, Mode.QUICK)
def bias_forces(trial: Trial) -> Finding:
    """h is that of Lagrange's equations with the arm's own M."""
    (q, qd, _), e = trial.states, trial.shared(from_points)
    expected = np.einsum("nijk,nj,nk->ni", e.change, qd, qd)
    expected -= 0.5 * np.einsum("njki,nj,nk->ni", e.change, qd, qd)
    terms = np.einsum("nijk,nj,nk->ni", np.abs(e.change), np.abs(qd), np.abs(qd))
    terms += 0.5 * np.einsum("njki,nj,nk->ni", np.abs(e.change), np.abs(qd), np.abs(qd))
    size = (terms / e.scale).max(axis=1, keepdims=True)
    size = np.maximum(
        size, LEAST * np.square(e.scale * qd).sum(axis=1, keepdims=True) / e.scale.max(axis=1)[:, None]
    )
    gaps = ratio((trial.arm.bias_forces(q, qd) - expected) / e.scale, size)
    return _found(trial, gaps, "h contradicts the derivatives of M")


@check("passivity", AGREE, Mode.QUICK)
def passivity(trial: Trial) -> Finding:
    """qd^T (M' qd - 2 h) = 0: forces of the motion itself do no work."""
    (q, qd, _), e = trial.states, trial.shared(from_points)
    rate = np.einsum("nijk,nk->nij", e.change, qd)
    power = np.einsum("ni,nij,nj->n", qd, rate, qd) - 2.0 * np.einsum(
        "ni,ni->n", qd, trial.arm.bias_forces(q, qd)
    )
    size = np.einsum("ni,nijk,nj,nk->n", np.abs(qd), np.abs(e.change), np.abs(qd), np.abs(qd))
    size = np.maximum(size, LEAST * np.square(e.scale * qd).sum(axis=1) * np.abs(qd).max(axis=1))
    return _found(trial, ratio(power, size), "h does work: qd^T (M' - 2 C) qd is not 0 but off")


@check("Coriolis matrix", AGREE)
def coriolis(trial: Trial) -> Finding:
    """C qd = h and C + C^T = M', where the arm gives C."""
    arm, (q, qd, _), e = trial.arm, trial.states, trial.shared(from_points)
    if not any("C11" in getattr(f, "physics_gives", ()) for f in arm.functions):
        raise NotApplicable("the arm gives no C")
    C = arm.coriolis_matrix(q, qd)
    scale = e.scale[:, :, None] * e.scale[:, None, :]
    size = (np.einsum("nijk,nk->nij", np.abs(e.change), np.abs(qd)) / scale).max(axis=(1, 2))
    size = np.maximum(size, LEAST * np.abs(qd).max(axis=1))
    rate = np.einsum("nijk,nk->nij", e.change, qd)
    gaps = ratio((C + np.swapaxes(C, 1, 2) - rate) / scale, size[:, None, None])
    power = (np.einsum("nij,nj->ni", C, qd) - arm.bias_forces(q, qd)) / e.scale
    moved = size * (e.scale * np.abs(qd)).max(axis=1)
    gaps = np.concatenate([gaps, ratio(power, moved[:, None])[:, :, None]], axis=2)
    return _found(trial, gaps, "C contradicts M or h")


@check("gravity forces", AGREE, Mode.QUICK)
def gravity_forces(trial: Trial) -> Finding:
    """G is the moment of the weights, and the derivative of U, in a field of either direction."""
    arm, (q, _, _), e = trial.arm, trial.states, trial.shared(from_points)
    masses, joints = np.array(arm.masses), len(arm.joints)
    gaps = []
    for axis, field in enumerate(({"ax": 1.0, "ay": 0.0}, {"ax": 0.0, "ay": 1.0})):
        expected = np.einsum("p,npj->nj", masses, e.slopes[:, :, axis])
        own = table(arm, numbered("G{}", joints), values_of(arm, q) | field, len(q))
        gaps.append(ratio(own - expected, e.scale * np.sqrt(masses.sum())))
        energy = table(arm, ["U"], values_of(arm, q) | field, len(q))
        height = np.einsum("p,np->n", masses, e.points[:, :, axis])[:, None]
        gaps.append(ratio(energy - height, np.abs(masses * e.points[:, :, axis]).sum(1)[:, None]))
    return _found(trial, np.concatenate(gaps, axis=1), "G or U contradicts the point masses", arm.joints * 4)


@check("kinetic energy", AGREE, Mode.QUICK)
def kinetic_energy(trial: Trial) -> Finding:
    """T is qd^T M qd / 2 of the point masses."""
    (q, qd, _), e = trial.states, trial.shared(from_points)
    expected = 0.5 * np.einsum("ni,nij,nj->n", qd, e.M, qd)
    size = 0.5 * (e.scale * np.abs(qd)).sum(axis=1) ** 2
    return _found(trial, ratio(trial.arm.kinetic_energy(q, qd) - expected, size), "T contradicts the masses")


@check("Jacobian", AGREE, Mode.QUICK)
def jacobian(trial: Trial) -> Finding:
    """J is the derivative of the tip, the tip is the last point mass, and its velocity is J qd."""
    arm, (q, qd, _), e = trial.arm, trial.states, trial.shared(from_points)
    J, tip = arm.jacobian(q), e.slopes[:, -1]
    largest = np.linalg.norm(tip, axis=1).max(axis=0)
    reach = np.linalg.norm(e.points, axis=2).max()
    velocity = table(arm, ["tip_vx", "tip_vy"], values_of(arm, q, qd), len(q))
    speed = (np.abs(tip) * np.abs(qd)[:, None, :]).sum(axis=2)
    gaps = [
        np.abs(ratio(J - tip, largest)).max(axis=1),
        ratio(arm.forward_kinematics(q) - e.points[:, -1], reach),
        ratio(velocity - np.einsum("naj,nj->na", tip, qd), speed.max(axis=1, keepdims=True)),
    ]
    names = (*arm.joints, *("tip x", "tip y", "velocity x", "velocity y"))
    return _found(trial, np.concatenate(gaps, axis=1), "J, tip or its velocity contradicts the points", names)


@check("rate of the Jacobian", AGREE, Mode.QUICK)
def jacobian_rate(trial: Trial) -> Finding:
    """Jdqd is J' qd."""
    arm, (q, qd, _) = trial.arm, trial.states
    joints = len(arm.joints)
    change = slopes(arm, entries("J", 2, joints), q).reshape(len(q), 2, joints, joints)
    expected = np.einsum("najk,nj,nk->na", change, qd, qd)
    size = np.einsum("najk,nj,nk->na", np.abs(change), np.abs(qd), np.abs(qd)).max(axis=1, keepdims=True)
    gaps = ratio(arm.jacobian_dot_qd(q, qd) - expected, size)
    return _found(trial, gaps, "Jdqd contradicts the derivatives of J", ("x", "y"))


@check("joints", AGREE, Mode.QUICK)
def joints(trial: Trial) -> Finding:
    """Rates of the joints are those of their positions, motors work along them, and the way back is right."""
    arm, (q, qd, _) = trial.arm, trial.states
    n = len(arm.joints)
    phi = table(arm, numbered("phi{}", n), values_of(arm, q), len(q))
    rates = table(arm, numbered("phid{}", n), values_of(arm, q, qd), len(q))
    moved = np.einsum("nij,nj->ni", slopes(arm, numbered("phi{}", n), q), qd)
    back = arm.coordinates_of_joints(*phi.T)
    again = np.stack(back if isinstance(back, tuple) else (back,), axis=-1)
    size, most = np.abs(qd).sum(axis=1, keepdims=True), np.abs(q).sum(axis=1, keepdims=True)
    gaps = [ratio(rates - moved, size), ratio(rates - qd @ arm.motor_map, size), ratio(again - q, most)]
    words = "phi, phid, Q and coordinates_of_joints contradict each other"
    return _found(trial, np.concatenate(gaps, axis=1), words, arm.joints * 3)


@check("forward dynamics", AGREE, Mode.QUICK)
def forward_dynamics(trial: Trial) -> Finding:
    """M qdd + h + G = Q holds of the accelerations of random forces.

    The residual is what a stable elimination keeps small, however badly conditioned M is.
    """
    arm, (q, qd, _), e = trial.arm, trial.states, trial.shared(from_points)
    Q = np.random.default_rng(trial.seed + 1).normal(0.0, 5.0, q.shape) * e.scale
    qdd = arm.forward_dynamics(q, qd, Q)
    h, G = arm.bias_forces(q, qd), arm.gravity_forces(q)
    own = arm.mass_matrix(q)
    terms = np.einsum("nij,nj->ni", np.abs(own), np.abs(qdd)) + np.abs(h) + np.abs(G) + np.abs(Q)
    left = (np.einsum("nij,nj->ni", own, qdd) + h + G - Q) / e.scale
    gaps = ratio(left, (terms / e.scale).max(axis=1, keepdims=True))
    return _found(trial, gaps, "the accelerations contradict M qdd + h + G = Q")


@check("mobility bounds", at_most(1.0 + 1e-9), Mode.QUICK)
def mobility_bounds(trial: Trial) -> Finding:
    """diag(B^T M^-1 B) is nowhere above the bounds from which error control knows how stiff a spring is.

    A bound may be attained, in a straight arm, to rounding.
    """
    arm, (q, _, _) = trial.scene.robot, trial.states
    if arm.mobility_bounds is None:
        raise NotApplicable("the arm gives none")
    B, names = arm.motor_map, numbered("W{}", len(arm.joints))
    bounds = Quantities(arm.parameter_values(), (arm.mobility_bounds,), {}).each(names)
    own = np.einsum("ji,njk,ki->ni", B, np.linalg.inv(arm.mass_matrix(q)), B)
    most, where = trial.worst(own / np.array(bounds, float))
    return Finding(
        most, where, f"{arm.kind}: the mobility is {most:.3g} of its bound: error control trusts it"
    )


@check("sliders held and struck", AGREE, Mode.QUICK)
def sliders(trial: Trial) -> Finding:
    """Held dynamics are those of the constrained system, and slider mobilities columns of M^-1."""
    arm, (q, qd, _), e = trial.arm, trial.states, trial.shared(from_points)
    held = arm.sliders()
    if not held:
        raise NotApplicable("the arm has no slider")
    n, dynamics = len(arm.joints), Dynamics(trial.scene)
    Q = np.random.default_rng(trial.seed + 2).normal(0.0, 5.0, q.shape) * e.scale
    rates = qd.copy()
    rates[:, held] = 0.0
    values = fields_of(dynamics) | values_of(arm, q, rates) | {"ay": 9.81}
    values |= {f"Q{k + 1}": Q[:, k] for k in range(n)} | {f"held{k + 1}": np.ones(len(q)) for k in held}
    x = Quantities(values, dynamics.functions_held, arm.sincos)
    qdd = np.stack([np.broadcast_to(a, len(q)) for a in x.each(numbered("qdd{}", n))], axis=1)
    hold = np.zeros_like(q)
    hold[:, held] = np.stack([np.broadcast_to(x[f"hold{k + 1}"], len(q)) for k in held], axis=1)
    own, h, G = arm.mass_matrix(q), arm.bias_forces(q, rates), arm.gravity_forces(q)
    terms = np.einsum("nij,nj->ni", np.abs(own), np.abs(qdd)) + np.abs(h) + np.abs(G) + np.abs(Q)
    size = (terms / e.scale).max(axis=1, keepdims=True)
    left = (np.einsum("nij,nj->ni", own, qdd) + h + G - Q - hold) / e.scale
    gaps = [ratio(left, size), ratio(np.where(np.isin(range(n), held), qdd, 0.0) * e.scale, size)]
    for k in held:
        W = np.stack([np.broadcast_to(x[f"W{i + 1}{k + 1}"], len(q)) for i in range(n)], axis=1)
        product = np.einsum("nij,nj->ni", own, W) - np.eye(n)[k]
        most = (np.einsum("nij,nj->ni", np.abs(own), np.abs(W)) / e.scale).max(axis=1, keepdims=True)
        gaps.append(ratio(product / e.scale, most))
    words = "held_dynamics or slider_mobility contradicts M"
    return _found(trial, np.concatenate(gaps, axis=1), words, arm.joints * len(gaps))
