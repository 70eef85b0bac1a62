"""Are impacts at hard stops those of rigid bodies? Each is compared with an impulse from the mass matrix."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from redundant_envs.effects.hooks import Impact
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.verify.checks import (
    ENOUGH_SMOOTH,
    EQUAL_BITS,
    Array,
    Finding,
    NotApplicable,
    Trial,
    at_most,
    check,
    ratio,
)
from redundant_envs.verify.equations import from_points

SHORT = 1e-10
"""Simulated time after an impact, s, for an arm of a metre and more, and shorter for shorter arms: forces
change velocities by 1e-7 in it, which is subtracted."""
SMALL = 0.01
"""Below this restitution a slider may come to rest at its stop instead of an invisible bounce."""
AGREE = at_most(1e-8)
"""Largest relative error of velocities and energies: the impulse follows from an elimination that loses
digits by the condition of M, at most 1e6 for reasonable arms, and the remaining effect of the time after it
is below 1e-10."""


class Struck(NamedTuple):
    """States in which one slider strikes a stop, and the velocities afterwards."""

    rows: Array  # of the states
    joint: Array  # index of the slider
    qd: Array
    after: Array
    expected: Array  # velocities, (n, joints)
    M: Array
    restitution: Array
    good: Array  # whether the impact took place without a fault


def stops(trial: Trial) -> list[tuple[int, float, float, float]]:
    """For every slider with stops: joint, lower and upper end, restitution."""
    found = [
        (a.hook.joint, *map(a.number, (a.hook.lower, a.hook.upper, a.hook.restitution)))
        for a in trial.scene.attached.of(Impact)
    ]
    if not found:
        raise NotApplicable("the scene has no hard stops")
    if not any(np.isfinite(x[1:3]).any() for x in found):
        raise NotApplicable("no stop has an end")
    return found  # type: ignore[return-value]


def struck(trial: Trial) -> Struck:
    """Each state with one slider at a stop of its travel, moving outwards; the others are between their
    stops."""
    ends = stops(trial)
    q, qd, _ = (x.copy() for x in trial.states)
    rng = np.random.default_rng(trial.seed + 3)
    for joint, low, high, _ in ends:
        if not np.isfinite([low, high]).all():  # half a metre instead of a missing end
            low = low if np.isfinite(low) else high - 0.5 if np.isfinite(high) else 0.0
            high = high if np.isfinite(high) else low + 0.5
        q[:, joint] = rng.uniform(low + 0.1 * (high - low), high - 0.1 * (high - low), len(q))
    sides = [(j, end, way) for j, low, high, _ in ends for end, way in ((low, -1.0), (high, 1.0))]
    sides = [x for x in sides if np.isfinite(x[1])]
    chosen = rng.integers(len(sides), size=len(q))
    struck_joint = np.array([x[0] for x in sides])[chosen]
    rows = np.arange(len(q))
    q[rows, struck_joint] = np.array([x[1] for x in sides])[chosen]
    qd[rows, struck_joint] = np.array([x[2] for x in sides])[chosen] * rng.uniform(0.5, 1.5, len(q))
    e, ways = ends[0][3], []
    good = np.ones(len(q), bool)
    short = SHORT * min(1.0, np.linalg.norm(trial.arm.points(q), axis=2).max())
    for seconds in (short, 2.0 * short):
        batch = BatchSimulator(trial.scene, len(q), track_work=True)
        batch.set_state(q, qd)
        status = batch.advance_partly(None, seconds)
        good &= (status.events > 0) & (status.numerics == 0)
        ways.append(batch.qd)
    M = trial.arm.mass_matrix(q)
    push = np.linalg.solve(M, np.eye(q.shape[1])[struck_joint][..., None])[..., 0]
    after = 2.0 * ways[0] - ways[1]
    back = np.abs(after[rows, struck_joint]) <= 0.5 * e * np.abs(qd[rows, struck_joint])
    own = np.where(back & (e < SMALL), 0.0, e)
    impulse = -(1.0 + own) * qd[rows, struck_joint] / push[rows, struck_joint]
    if np.mean(good) < ENOUGH_SMOOTH:
        raise ValueError(f"a slider that strikes its stop has an event in {np.mean(good):.0%} of the states")
    return Struck(rows, struck_joint, qd, after, qd + push * impulse[:, None], M, own, good)


@check("impacts: velocities", AGREE)
def velocities(trial: Trial) -> Finding:
    """The slider returns with ``restitution`` times its speed, and the arm moves as the impulse requires."""
    s, e = trial.shared(struck), trial.shared(from_points)
    size = (e.scale * np.abs(s.qd)).max(axis=1, keepdims=True)
    gaps = np.where(s.good[:, None], ratio((s.after - s.expected) * e.scale, size), 0.0)
    return trial.finding(gaps, "velocities after an impact are off by {:.1e}: impulse or restitution")


@check("impacts: momentum", AGREE)
def momentum(trial: Trial) -> Finding:
    """M dqd has an entry only at the slider: the impulse acts along it."""
    s, e = trial.shared(struck), trial.shared(from_points)
    change = np.einsum("nij,nj->ni", s.M, s.after - s.qd)
    size = (e.scale * np.abs(s.qd)).max(axis=1)
    change[s.rows, s.joint] = 0.0
    gaps = np.where(s.good[:, None], ratio(change / e.scale, size[:, None]), 0.0)
    return trial.finding(gaps, "an impact changes momenta of joints that it does not act on")


@check("impacts: energy", AGREE)
def energy(trial: Trial) -> Finding:
    """An impact takes (1 - restitution^2) v^2 / (2 W_jj), with W the inverse of M."""
    s = trial.shared(struck)
    before, after = (0.5 * np.einsum("ni,nij,nj->n", v, s.M, v) for v in (s.qd, s.after))
    own = np.linalg.inv(s.M)[s.rows, s.joint, s.joint]
    lost = (1.0 - s.restitution**2) * s.qd[s.rows, s.joint] ** 2 / (2.0 * own)
    gaps = np.where(s.good, ratio(after - before + lost, before), 0.0)
    return trial.finding(gaps, "the energy of an impact is off by {:.1e} of the kinetic energy")


INTERVALS = 20


@check("impacts: no slider beyond its stop", EQUAL_BITS)
def inside(trial: Trial) -> Finding:
    """After each of some control intervals every slider is within its stops, to the last bit."""
    ends = stops(trial)
    q, qd, efforts = trial.states
    batch = BatchSimulator(trial.scene, len(q), track_work=True)
    batch.set_state(q, qd)
    beyond = np.zeros(q.shape)
    for _ in range(INTERVALS):
        batch.advance(efforts)
        now = batch.q
        for joint, low, high, _ in ends:
            out = np.maximum(low - now[:, joint], now[:, joint] - high)
            beyond[:, joint] = np.maximum(beyond[:, joint], np.where(np.isnan(out), 0.0, out))
    most, where = trial.worst(beyond)
    lanes = int((beyond > 0.0).any(axis=1).sum())
    return Finding(lanes, where if lanes else "", f"a slider is up to {most:.1e} m beyond its stop")
