"""Are impacts at hard stops those of rigid bodies? Each is compared with an impulse from the mass matrix."""

import numpy as np

from redundant_envs.effects.hooks import Impact, Impulse
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.verify.checks import LEAST_SHARE, Sample, check, ratio
from redundant_envs.verify.promises import EQUAL_BITS, Finding, NotApplicable, at_most

SHORT = 1e-10  # s after an impact, for an arm of a metre: forces change velocities by 1e-7, to be subtracted
SMALL = 0.01  # below this restitution a slider may come to rest at its stop instead of an invisible bounce
AGREE = at_most(1e-8)
"""Largest relative error of velocities and energies: the impulse follows from an elimination that loses
digits by the condition of M, at most 1e6 for reasonable arms; the time after it matters below 1e-10."""


def stops(trial: Sample) -> list[tuple[int, float, float, float]]:
    """For every joint with stops: joint, lower and upper end, restitution."""
    rows = [
        (a.hook.joint, *map(a.number, (a.hook.lower, a.hook.upper, a.hook.restitution)))
        for a in trial.scene.attached.of(Impact)
    ]
    if not rows:
        raise NotApplicable("the scene has no hard stops")
    if not any(np.isfinite(x[1:3]).any() for x in rows):
        raise NotApplicable("no stop has an end")
    if trial.scene.attached.of(Impulse):
        raise NotApplicable("impulses of effects change the velocities as well")
    return rows  # type: ignore[return-value]


@check("impacts: velocities", AGREE)
def velocities(trial: Sample) -> Finding:
    """A joint that strikes a stop returns with ``restitution`` times its speed, and the arm moves as an
    impulse along that joint requires, with the energy and the momenta that follow. In each state one joint is
    at a stop of its travel and moves outwards; the others are between stops."""
    ends, b = stops(trial), trial.arm.motor_map
    inverse = np.linalg.inv(b)
    q, qd, _ = trial.states
    q, qd = q @ b, qd @ b  # positions and rates of joints, for now
    rng = np.random.default_rng(trial.seed + 3)
    for joint, low, high, _ in ends:
        if np.isinf(low):  # half a metre if an end is missing
            low = 0.0 if np.isinf(high) else high - 0.5
        high = low + 0.5 if np.isinf(high) else high
        q[:, joint] = rng.uniform(low + 0.1 * (high - low), high - 0.1 * (high - low), len(q))
    sides = [(j, end, way) for j, low, high, _ in ends for end, way in ((low, -1.0), (high, 1.0))]
    joints, positions, ways = np.array([x for x in sides if np.isfinite(x[1])]).T
    chosen = rng.integers(len(joints), size=len(q))
    rows, struck_joint = np.arange(len(q)), joints.astype(int)[chosen]
    q[rows, struck_joint] = positions[chosen]
    qd[rows, struck_joint] = ways[chosen] * rng.uniform(0.5, 1.5, len(q))
    restitution, rate = {j: e for j, *_, e in ends}, qd[rows, struck_joint]
    q, qd = q @ inverse, qd @ inverse
    e, after_times = np.array([restitution[j] for j in struck_joint.tolist()]), []
    good = np.ones(len(q), bool)
    short = SHORT * min(1.0, np.linalg.norm(trial.arm.points(q), axis=2).max())
    for seconds in (short, 2.0 * short):
        batch = BatchSimulator(trial.scene, len(q), track_work=True)
        batch.set_state(q, qd)
        status = batch.advance_partly(None, seconds)
        good &= (status.events > 0) & (status.numerics == 0)
        after_times.append(batch.qd)
    M = trial.arm.mass_matrix(q)
    push = np.linalg.solve(M, b.T[struck_joint][..., None])[..., 0]
    after = 2.0 * after_times[0] - after_times[1]
    back = np.abs((after @ b)[rows, struck_joint]) <= 0.5 * e * np.abs(rate)
    impulse = -(1.0 + np.where(back & (e < SMALL), 0.0, e)) * rate / (push @ b)[rows, struck_joint]
    if np.mean(good) < LEAST_SHARE:
        raise ValueError(f"a joint that strikes its stop has an event in {np.mean(good):.0%} of the states")
    expected, scale = qd + push * impulse[:, None], np.sqrt(np.einsum("nii->ni", M))
    size = (scale * np.abs(qd)).max(axis=1, keepdims=True)
    gaps = np.where(good[:, None], ratio((after - expected) * scale, size), 0.0)
    return trial.finding(gaps, "velocities after an impact are off by {:.1e}: impulse or restitution")


INTERVALS = 20


@check("impacts: no joint beyond its stop", EQUAL_BITS)
def inside(trial: Sample) -> Finding:
    """After intervals sliders are within their stops to the bit, and angles to 4 ulp of coordinates."""
    ends, b = stops(trial), trial.arm.motor_map
    q, qd, efforts = trial.states
    batch = BatchSimulator(trial.scene, len(q), track_work=True)
    batch.set_state(q, qd)
    beyond = np.zeros(q.shape)
    for _ in range(INTERVALS):
        batch.advance(efforts)
        for joint, low, high, _ in ends:
            now = batch.q @ b[:, joint]
            out = np.maximum(low - now, now - high)
            if not trial.arm.prismatic[joint]:
                largest = [np.abs(batch.q * b[:, joint]).max(axis=1)]
                largest += [np.full(len(q), abs(end)) for end in (low, high) if np.isfinite(end)]
                out = np.where(out <= 4.0 * np.spacing(np.max(largest, axis=0)), 0.0, out)
            beyond[:, joint] = np.maximum(beyond[:, joint], np.where(np.isnan(out), 0.0, out))
    most, where, _ = trial.worst(beyond)
    lanes = int((beyond > 0.0).any(axis=1).sum())
    return Finding(lanes, where if lanes else "", f"a joint is up to {most:.1e} m or rad beyond its stop")
