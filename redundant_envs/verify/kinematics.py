"""Do the further quantities of an arm follow from its point masses, and from its joints?"""

from typing import Any

import numpy as np

from redundant_envs.effects.hooks import Inertia
from redundant_envs.language.algebra import entries, numbered
from redundant_envs.language.dual import Dual, dual
from redundant_envs.language.quantities import Quantities
from redundant_envs.tasks.base import full_reach
from redundant_envs.verify.checks import Array, Sample, check, ratio
from redundant_envs.verify.equations import AGREE, at_poses, columns, finding, slopes, table, values_of
from redundant_envs.verify.promises import Finding, at_least, at_most


@check("Jacobian", AGREE)
def jacobian(trial: Sample) -> Finding:
    """J is the derivative of the tip, the tip is the last point mass, and its velocity is J qd."""
    arm, (q, qd), e = trial.arm, trial.poses, trial.shared(at_poses)
    J, tip = arm.jacobian(q), e.slopes[:, -1]
    velocity = table(arm, ["tip_vx", "tip_vy"], values_of(arm, q, qd), len(q))
    speed = (np.abs(tip) * np.abs(qd)[:, None, :]).sum(axis=2)
    gaps = [
        np.abs(ratio(J - tip, np.linalg.norm(tip, axis=1).max(axis=0))).max(axis=1),
        ratio(arm.forward_kinematics(q) - e.points[:, -1], np.linalg.norm(e.points, axis=2).max()),
        ratio(velocity - np.einsum("naj,nj->na", tip, qd), speed.max(axis=1, keepdims=True)),
    ]
    names = (*arm.joints, "tip x", "tip y", "velocity x", "velocity y")
    words = "J, tip or its velocity contradicts the points"
    return finding(trial, np.concatenate(gaps, axis=1), words, names)


@check("rate of the Jacobian", AGREE)
def jacobian_rate(trial: Sample) -> Finding:
    """Jdqd is J' qd."""
    arm, (q, qd), joints = trial.arm, trial.poses, len(trial.arm.joints)
    change = slopes(arm, entries("J", 2, joints), q).reshape(len(q), 2, joints, joints)
    size = np.einsum("najk,nj,nk->na", np.abs(change), np.abs(qd), np.abs(qd)).max(axis=1, keepdims=True)
    gaps = ratio(arm.jacobian_dot_qd(q, qd) - np.einsum("najk,nj,nk->na", change, qd, qd), size)
    return finding(trial, gaps, "Jdqd contradicts the derivatives of J", ("x", "y"))


@check("joints", AGREE)
def joints(trial: Sample) -> Finding:
    """Rates of joints are those of their positions, motors act along them, and the inverse map is right."""
    arm, (q, qd), n = trial.arm, trial.poses, len(trial.arm.joints)
    rates = table(arm, numbered("phid{}", n), values_of(arm, q, qd), len(q))
    moved = np.einsum("nij,nj->ni", slopes(arm, numbered("phi{}", n), q), qd)
    back = arm.coordinates_of_joints(*table(arm, numbered("phi{}", n), values_of(arm, q), len(q)).T)
    again = np.stack(back if isinstance(back, tuple) else (back,), axis=-1)
    size, most = np.abs(qd).sum(axis=1, keepdims=True), np.abs(q).sum(axis=1, keepdims=True)
    gaps = [ratio(rates - moved, size), ratio(rates - qd @ arm.motor_map, size), ratio(again - q, most)]
    words = "phi, phid, Q and coordinates_of_joints contradict each other"
    return finding(trial, np.concatenate(gaps, axis=1), words, arm.joints * 3)


@check("motions of points", AGREE)
def motions(trial: Sample) -> Finding:
    """Velocities, Jacobians and accelerations at constant rates of all point masses are derivatives."""
    arm, (q, qd), e = trial.arm, trial.poses, trial.shared(at_poses)
    count, points, joints = len(q), arm.num_masses, len(arm.joints)

    def quantities(form: str, axes: str) -> Array:
        names = [form.format(axis, k + 1) for k in range(points) for axis in axes]
        return table(arm, names, values_of(arm, q, qd), count)

    jacobians = np.stack([quantities(f"{{}}{{}}{j + 1}", "XY") for j in range(joints)], axis=-1)
    slope = e.slopes.reshape(jacobians.shape)
    values = values_of(arm, q)
    values |= {name: Dual(Dual(q[:, k], qd[:, k]), Dual(qd[:, k])) for k, name in enumerate(arm.coordinates)}
    positions = arm.evaluate([f"{axis}{k + 1}" for k in range(points) for axis in "xy"], values)
    change = columns((dual(dual(x).slope).slope for x in positions), count)  # at constant rates
    most = np.einsum("naj,nj->na", np.abs(slope), np.abs(qd)).max(axis=1)
    faster = np.maximum(np.abs(change).max(axis=1), most * np.abs(qd).max(axis=1))
    gaps = [
        ratio(jacobians - slope, np.linalg.norm(e.slopes, axis=2).max(axis=(0, 1))).max(axis=2),
        ratio(quantities("v{}{}", "xy") - np.einsum("naj,nj->na", slope, qd), most[:, None]),
        ratio(quantities("{}dqd{}", "XY") - change, faster[:, None]),
    ]
    names = [f"point {k + 1} {axis}" for k in range(points) for axis in "xy"]
    words = "X, Y, vx, vy, Xdqd or Ydqd of a point mass contradicts its position"
    return finding(trial, np.concatenate(gaps, axis=1), words, names * 3)


@check("angular momentum", AGREE)
def angular_momentum(trial: Sample) -> Finding:
    """Lz is that of the point masses, and of inertias that turn with the first revolute joint."""
    arm, (q, qd), e = trial.arm, trial.poses, trial.shared(at_poses)
    velocity = np.einsum("npaj,nj->npa", e.slopes, qd)
    parts = np.array(arm.masses)[:, None] * e.points * velocity[..., ::-1] * (1.0, -1.0)
    expected, size = parts.sum(axis=(1, 2)), np.abs(parts).sum(axis=(1, 2))
    rates, first = qd @ arm.motor_map, next((k for k, s in enumerate(arm.prismatic) if not s), None)
    for a in trial.scene.attached.of(Inertia):
        if first in a.hook.joints:
            share = a.number(a.hook.inertia) * rates[:, list(a.hook.joints)].sum(axis=1)
            expected, size = expected + share, size + np.abs(share)
    gaps = ratio(arm.angular_momentum(q, qd) - expected, size)
    return finding(trial, gaps, "Lz contradicts the point masses")


@check("manipulability", AGREE)
def manipulability(trial: Sample) -> Finding:
    """Its square is det J J^T, and not negative: near a singular pose a root has only half the digits."""
    arm, (q, _), e = trial.arm, trial.poses, trial.shared(at_poses)
    values, tip = arm.manipulability(q), e.slopes[:, -1]
    x, y = (np.square(tip[:, axis]).sum(axis=1) for axis in range(2))
    gaps = ratio(
        np.copysign(np.square(values), values) - np.linalg.det(np.einsum("naj,nbj->nab", tip, tip)), x * y
    )
    return finding(trial, gaps, "manipulability contradicts the derivatives of the tip")


@check("column norms", AGREE)
def column_norms(trial: Sample) -> Finding:
    """They are the metres at the tip per unit of each coordinate, with which error control weights errors."""
    arm, (q, _), e = trial.arm, trial.poses, trial.shared(at_poses)
    x = Quantities(values_of(arm, q), (*arm.functions, arm.column_norms), arm.sincos)
    expected = np.linalg.norm(e.slopes[:, -1], axis=1)
    norms = columns(x.each(numbered("n{}", len(arm.joints))), len(q))
    return finding(trial, ratio(norms - expected, expected.max(axis=0)), "column_norms contradicts the tip")


@check("reach", at_most(1.0 + 1e-9))
def reach(trial: Sample) -> Finding:
    """The tip is never farther from the base than the full reach, by which tasks scale their distances:
    neither in random poses nor in stretched and folded ones, with sliders between 0 and an upper end."""
    arm = trial.arm
    joints = np.concatenate([trial.square, trial.poses[0]]) @ arm.motor_map
    known, share = dict(arm.parameter_values()), np.random.default_rng(trial.seed + 5).random(len(joints))
    share[0], high = 1.0, sum(arm.lengths) or 1.0
    for k in arm.sliders():
        joints[:, k], known[f"high{k + 1}"] = high * share, high
    tip = np.linalg.norm(arm.forward_kinematics(joints @ np.linalg.inv(arm.motor_map)), axis=1)
    far = float(np.nanmax(tip) / Quantities(known, (full_reach(arm),), {})["reach"])
    words = f"{arm.kind}: the tip comes {far:.4g} times as far as the sum of extent, {', '.join(arm.extent)}"
    return Finding(far, "", words)


@check("posture", at_least(0.01))
def posture(trial: Sample) -> Finding:
    """The observed posture lies in -1 to 1 and changes with every revolute joint, also where a sine or a
    cosine alone does not: the smallest singular value of its derivatives, and those of the sliders."""
    arm: Any = trial.scene.robot
    names, slides, (q, _) = [*arm.posture], arm.sliders(), trial.poses
    wanted = [*names, *(f"phi{k + 1}" for k in slides)]
    values = table(arm, names, values_of(arm, q), len(q)) if names else np.zeros((len(q), 1))
    if not np.abs(values).max() <= 1.0 + 1e-9:
        gap, where, _ = trial.worst(np.abs(values), names)
        return Finding(np.nan, where, f"{arm.kind}.posture has {gap:.3g}; its quantities must lie in -1 to 1")
    least = np.linalg.svd(slopes(arm, wanted, trial.square), compute_uv=False)
    least = least[:, -1] if least.shape[1] == len(arm.joints) else np.zeros(len(q))
    state = int(np.argmin(least))
    words = f"{arm.kind}.posture, {', '.join(names)}, lacks the sine or the cosine of an angle"
    return Finding(float(least[state]), f"state {state}", words)


@check("kinds of joints", at_least(1e-6))
def kinds(trial: Sample) -> Finding:
    """A slider does not return the point masses after 2 pi of its coordinate, and a revolute joint does not
    move them along straight lines: the distance from that, in units of their distances or derivatives."""
    arm, (q, _), e = trial.arm, trial.poses, trial.shared(at_poses)
    size, back = np.abs(e.points).max(), np.linalg.inv(arm.motor_map)
    of_points = [f"{axis}{k + 1}" for k in range(arm.num_masses) for axis in "xy"]
    moved = []
    for k, slides in enumerate(arm.prismatic):
        if slides:
            gap = np.abs(arm.points(q + 2.0 * np.pi * back[k]) - e.points).max(axis=(1, 2)) / size
        else:
            there, here = (slopes(arm, of_points, at) @ back[k] for at in (q + back[k], q))
            gap = ratio(np.abs(there - here).max(axis=1), np.abs(here).max())
        moved.append(np.where(np.isfinite(gap), gap, np.inf).max())
    k = int(np.argmin(moved))
    motions = "turns, and moves along straight lines", "slides, and moves as if it turned"
    words = f"{arm.kind}.prismatic says that {arm.joints[k]} {motions[arm.prismatic[k]]}"
    return Finding(float(moved[k]), arm.joints[k], words)
