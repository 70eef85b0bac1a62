"""Are the equations of an arm consistent? Each is derived again from the point masses.

The equations are run on numbers with derivatives, so comparisons are exact to rounding. Forces and inertias
are compared in units in which the mass matrix has ones on its diagonal: neither the unit of a joint nor a
light link at the end of a heavy arm hides a mistake. Sums over ten joints lose some 1e-14 in these units.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from redundant_envs.effects.hooks import Inertia
from redundant_envs.language.algebra import entries, numbered
from redundant_envs.language.dual import Dual, dual
from redundant_envs.language.quantities import Quantities
from redundant_envs.robots.arm import Arm
from redundant_envs.simulator.lane.direct import fields_of
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.verify.checks import Array, Sample, check, ratio
from redundant_envs.verify.promises import Finding, Mode, NotApplicable, at_least, at_most

AGREE = at_most(1e-10)  # a thousand times the rounding, a thousandth of the smallest mistake in a formula
LEAST = 1e-4
"""Bias forces are compared with at least this share of the forces that the kinetic energy could cause: a
single link has no bias forces, and sums over its point mass leave rounding."""
TILTED = {"ax": 5.0, "ay": 9.81}  # a field that is not vertical, m/s^2


class Equations(NamedTuple):
    """Quantities that follow from the point masses alone, at the states of a trial."""

    points: Array  # (n, masses, 2)
    slopes: Array  # (n, masses, 2, joints): derivatives of the points by the coordinates
    M: Array  # (n, joints, joints): mass matrix, inertias that effects add included
    scale: Array  # (n, joints): roots of its diagonal
    change: Array  # (n, joints, joints, joints): derivatives of the arm's own M by the coordinates, last axis


def values_of(arm: Arm, q: Array, qd: Array | None = None, along: Array | None = None) -> dict[str, Any]:
    """Known quantities of an arm at some states; with ``along`` the coordinates have these derivatives."""
    values: dict[str, Any] = {**arm.parameter_values(), "ax": 0.0, "ay": 0.0}
    for k, name in enumerate(arm.coordinates):
        values[name] = q[:, k] if along is None else Dual(q[:, k], along[:, k])
    if qd is not None:
        values |= {name: qd[:, k] for k, name in enumerate(arm.rates)}
    return values


def table(arm: Arm, names: Iterable[str], values: dict[str, Any], count: int) -> Array:
    """Quantities, (count, names)."""
    return columns(arm.evaluate(names, values), count)


def columns(values: Iterable[Any], count: int) -> Array:
    """Numbers, or arrays of (count,), side by side: (count, values)."""
    return np.stack([np.broadcast_to(np.asarray(x, float), count) for x in values], axis=-1)


def slopes(arm: Arm, names: Iterable[str], q: Array) -> Array:
    """Derivatives of quantities of the position by each coordinate, (n, names, joints)."""
    wanted, units = list(names), np.eye(q.shape[1])
    values = (arm.evaluate(wanted, values_of(arm, q, along=np.broadcast_to(u, q.shape))) for u in units)
    return np.stack([columns((dual(x).slope for x in each), len(q)) for each in values], axis=-1)


def added_inertia(trial: Sample) -> Array:
    """Inertias that effects add to the mass matrix beside masses, (joints, joints)."""
    total = np.zeros((len(trial.scene.robot.joints),) * 2)
    for a in trial.scene.attached.of(Inertia):
        direction = trial.scene.robot.motor_map[:, list(a.hook.joints)].sum(axis=1)
        total += a.number(a.hook.inertia) * np.outer(direction, direction)
    return total


def from_points(trial: Sample) -> Equations:
    return equations_at(trial, trial.states[0])


def at_poses(trial: Sample) -> Equations:
    return equations_at(trial, trial.poses[0])


def equations_at(trial: Sample, q: Array) -> Equations:
    """Quantities that follow from the point masses, and from the inertias that effects add."""
    arm, n = trial.arm, len(q)
    joints, masses = len(arm.joints), np.array(arm.masses)
    of_points = [f"{axis}{k + 1}" for k in range(arm.num_masses) for axis in "xy"]
    slope = slopes(arm, of_points, q).reshape(n, -1, 2, joints)
    M = np.einsum("p,npai,npaj->nij", masses, slope, slope) + added_inertia(trial)
    change = slopes(arm, entries("M", joints, joints), q).reshape(n, joints, joints, joints)
    return Equations(arm.points(q), slope, M, np.sqrt(np.einsum("nii->ni", M)), change)


def finding(trial: Sample, gaps: Array, what: str, names: Iterable[str] = ()) -> Finding:
    return trial.finding(gaps, f"{trial.arm.kind}: {what} by {{:.1e}} of its size", names)


@check("mass matrix", AGREE)
def mass_matrix(trial: Sample) -> Finding:
    """M is the sum of m_k J_k^T J_k over the point masses."""
    M, e = trial.arm.mass_matrix(trial.poses[0]), trial.shared(at_poses)
    gaps = ratio(M - e.M, e.scale[:, :, None] * e.scale[:, None, :])
    return finding(trial, gaps, "M contradicts the point masses")


@check("mass matrix is positive", at_least(1e-14))
def positive(trial: Sample) -> Finding:
    """The smallest eigenvalue of M, with ones on its diagonal; below 1e-14 rounding may make it negative."""
    M, e = trial.arm.mass_matrix(trial.poses[0]), trial.shared(at_poses)
    scaled = M / (e.scale[:, :, None] * e.scale[:, None, :])
    if not np.isfinite(scaled).all():
        return Finding(np.nan, "", f"{trial.arm.kind}: M is not finite, or a joint moves no mass")
    least = np.linalg.eigvalsh(0.5 * (scaled + np.swapaxes(scaled, 1, 2)))[:, 0]
    state = int(np.argmin(least))
    words = f"{trial.arm.kind}: M is not positive definite: a motion has no, or negative, kinetic energy"
    return Finding(float(least[state]), f"state {state}", words)


@check("bias forces", AGREE)
def bias_forces(trial: Sample) -> Finding:
    """h is the bias force of Lagrange's equations with the arm's own M."""
    (q, qd), e = trial.poses, trial.shared(at_poses)

    def terms(change: Array, rates: Array, sign: float) -> Array:
        moved = np.einsum("nijk,nj,nk->ni", change, rates, rates)
        return moved + sign * 0.5 * np.einsum("njki,nj,nk->ni", change, rates, rates)  # type: ignore[no-any-return]

    expected, sizes = terms(e.change, qd, -1.0), terms(np.abs(e.change), np.abs(qd), 1.0)
    least = LEAST * np.square(e.scale * qd).sum(axis=1) / e.scale.max(axis=1)
    size = np.maximum((sizes / e.scale).max(axis=1), least)[:, None]
    gaps = ratio((trial.arm.bias_forces(q, qd) - expected) / e.scale, size)
    return finding(trial, gaps, "h contradicts the derivatives of M")


@check("Coriolis matrix", AGREE, Mode.STANDARD)
def coriolis(trial: Sample) -> Finding:
    """C follows from Christoffel's symbols of M, so C + C^T = M', and C qd = h."""
    arm, (q, qd), e = trial.arm, trial.poses, trial.shared(at_poses)
    C = arm.coriolis_matrix(q, qd)
    scale = e.scale[:, :, None] * e.scale[:, None, :]
    size = (np.einsum("nijk,nk->nij", np.abs(e.change), np.abs(qd)) / scale).max(axis=(1, 2))
    size = np.maximum(size, LEAST * np.abs(qd).max(axis=1))
    turn = np.einsum("nikj,nk->nij", e.change, qd)
    christoffel = 0.5 * (np.einsum("nijk,nk->nij", e.change, qd) + turn - np.swapaxes(turn, 1, 2))
    gaps = ratio((C - christoffel) / scale, size[:, None, None])
    power = (np.einsum("nij,nj->ni", C, qd) - arm.bias_forces(q, qd)) / e.scale
    moved = size * (e.scale * np.abs(qd)).max(axis=1)
    gaps = np.concatenate([gaps, ratio(power, moved[:, None])[:, :, None]], axis=2)
    return finding(trial, gaps, "C contradicts M or h")


@check("gravity forces", AGREE)
def gravity_forces(trial: Sample) -> Finding:
    """G is the moment of the weights, and the derivative of U, in a field of either direction."""
    arm, (q, _), e = trial.arm, trial.poses, trial.shared(at_poses)
    masses, joints = np.array(arm.masses), len(arm.joints)
    gaps = []
    for axis, field in enumerate(({"ax": 1.0, "ay": 0.0}, {"ax": 0.0, "ay": 1.0})):
        values = table(arm, [*numbered("G{}", joints), "U"], values_of(arm, q) | field, len(q))
        weights, heights = masses @ e.slopes[:, :, axis], masses * e.points[:, :, axis]
        gaps.append(ratio(values[:, :-1] - weights, e.scale * np.sqrt(masses.sum())))
        gaps.append(ratio(values[:, -1] - heights.sum(axis=1), np.abs(heights).sum(axis=1))[:, None])
    names = (*arm.joints, "energy") * 2
    return finding(trial, np.concatenate(gaps, axis=1), "G or U contradicts the point masses", names)


@check("kinetic energy", AGREE)
def kinetic_energy(trial: Sample) -> Finding:
    """T is qd^T M qd / 2 of the point masses."""
    (q, qd), e = trial.poses, trial.shared(at_poses)
    expected = 0.5 * np.einsum("ni,nij,nj->n", qd, e.M, qd)
    size = 0.5 * (e.scale * np.abs(qd)).sum(axis=1) ** 2
    return finding(trial, ratio(trial.arm.kinetic_energy(q, qd) - expected, size), "T contradicts the masses")


@check("forward dynamics", AGREE)
def forward_dynamics(trial: Sample) -> Finding:
    """M qdd + h + G = Q holds for the accelerations under random forces, in a field that is not vertical: a
    stable elimination keeps the residual small, however badly conditioned M is."""
    arm, (q, qd), e = trial.arm, trial.poses, trial.shared(at_poses)
    Q = np.random.default_rng(trial.seed + 1).normal(0.0, 5.0, q.shape) * e.scale
    n = len(arm.joints)
    values = values_of(arm, q, qd) | TILTED | {f"Q{k + 1}": Q[:, k] for k in range(n)}
    qdd, G = (table(arm, numbered(form, n), values, len(q)) for form in ("qdd{}", "G{}"))
    gaps, _ = residual(arm.mass_matrix(q), qdd, (arm.bias_forces(q, qd), G, -Q), e.scale)
    return finding(trial, gaps, "the accelerations contradict M qdd + h + G = Q")


def residual(M: Array, qdd: Array, forces: tuple[Array, ...], scale: Array) -> tuple[Array, Array]:
    """What is left of M qdd and other forces, in units of the sizes of the terms, (n, joints), (n, 1)."""
    terms = np.einsum("nij,nj->ni", np.abs(M), np.abs(qdd)) + sum(map(np.abs, forces))
    size = (terms / scale).max(axis=1, keepdims=True)
    return ratio((np.einsum("nij,nj->ni", M, qdd) + sum(forces)) / scale, size), size


@check("mobility bounds", at_most(1.0 + 1e-9))
def mobility_bounds(trial: Sample) -> Finding:
    """diag(B^T M^-1 B) is nowhere above the bounds from which error control computes how stiff a spring is; a
    straight arm, or one with right angles, may attain one to rounding."""
    arm, (q, _) = trial.scene.robot, trial.poses
    if arm.mobility_bounds is None:
        raise NotApplicable("the arm gives none")
    B, names = arm.motor_map, numbered("W{}", len(arm.joints))
    bounds = np.array(Quantities(arm.parameter_values(), (arm.mobility_bounds,), {}).each(names), float)
    q = np.concatenate([q, trial.square])
    share = np.einsum("ji,njk,ki->ni", B, np.linalg.inv(arm.mass_matrix(q)), B) / bounds
    return trial.finding(share, f"{arm.kind}: the mobility is {{:.3g}} of its bound: error control trusts it")


@check("sliders held and struck", AGREE)
def sliders(trial: Sample) -> Finding:
    """Held dynamics are those of the constrained system; slider mobilities are columns of M^-1."""
    arm, (q, qd), e = trial.arm, trial.poses, trial.shared(at_poses)
    slides = arm.sliders()
    if not slides:
        raise NotApplicable("the arm has no slider")
    n, dynamics, M = len(arm.joints), Dynamics(trial.scene), arm.mass_matrix(q)
    Q = np.random.default_rng(trial.seed + 2).normal(0.0, 5.0, q.shape) * e.scale
    gaps = []
    for held in dict.fromkeys((tuple(slides), *((k,) for k in slides))):
        rates = qd.copy()
        rates[:, held] = 0.0
        values = fields_of(dynamics) | values_of(arm, q, rates) | TILTED
        values |= {f"Q{k + 1}": Q[:, k] for k in range(n)}
        values |= {f"held{k + 1}": np.full(len(q), float(k in held)) for k in range(n)}
        x = Quantities(values, dynamics.functions_held, arm.sincos)
        qdd, hold = columns(x.each(numbered("qdd{}", n)), len(q)), np.zeros_like(q)
        hold[:, held] = columns(x.each(f"hold{k + 1}" for k in held), len(q))
        h, G = arm.bias_forces(q, rates), table(arm, numbered("G{}", n), values_of(arm, q) | TILTED, len(q))
        left, size = residual(M, qdd, (h, G, -Q, -hold), e.scale)
        gaps += [left, ratio(np.where(np.isin(range(n), held), qdd, 0.0) * e.scale, size)]
    for k in slides:
        W = columns(x.each(f"W{i + 1}{k + 1}" for i in range(n)), len(q))
        most = (np.einsum("nij,nj->ni", np.abs(M), np.abs(W)) / e.scale).max(axis=1, keepdims=True)
        gaps.append(ratio((np.einsum("nij,nj->ni", M, W) - np.eye(n)[k]) / e.scale, most))
    words = "held_dynamics or slider_mobility contradicts M"
    return finding(trial, np.concatenate(gaps, axis=1), words, arm.joints * len(gaps))
