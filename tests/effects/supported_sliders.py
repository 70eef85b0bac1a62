"""Random starts at stops, and their resolution: a computation in NumPy that shares no code with contacts.

Forces and impulses of stops are projections: each is raised or lowered by turns until no stop pulls and no
slider enters. The motion that follows is integrated with the sliders held that their stops press.
"""

import numpy as np

import redundant_envs as rde

LOWER, UPPER, SPAN = 0.0, 0.3, 1e-3
"""Stops, m, and a control interval, s."""
ARMS = {
    "RPRP": rde.RPRP((1.2, 0.8, 1.0, 0.6), (0.5, 0.4)),
    "RRP": rde.Chain("RRP", (1.2, 0.8, 1.0), (0.5, 0.4)),
    "PRPRP": rde.Chain("PRPRP", (1.2, 0.8, 1.0, 0.6, 0.7), (0.5, 0.4)),
}
STANDS, ENTERS, LEAVES, AWAY = range(4)


def scene(arm, restitution, **kwargs):
    count = len(arm.sliders())
    stop = rde.effects.PrismaticStop((LOWER,) * count, (UPPER,) * count, restitution)
    return rde.Scene(arm, (rde.effects.Gravity(), stop), **{"control_dt": SPAN, "tolerance": 1e-9, **kwargs})


def starts(arm, lanes, rng):
    """q, qd, efforts (lanes, joints), sides of the stops of the sliders, and how these move there."""
    n, sliders = len(arm.joints), arm.sliders()
    q, qd = rng.uniform(-3.0, 3.0, (lanes, n)), rng.normal(0.0, 1.0, (lanes, n))
    kinds = rng.choice(4, (lanes, len(sliders)), p=(0.45, 0.35, 0.1, 0.1))
    if len(sliders) > 1:
        kinds[:, 0] = np.where((kinds == STANDS).any(axis=1), kinds[:, 0], STANDS)
    sides = np.where(kinds == AWAY, 0.0, rng.choice([-1.0, 1.0], kinds.shape))
    speed = rng.uniform(0.2, 2.0, kinds.shape) * np.where(kinds == ENTERS, sides, -sides)
    q[:, sliders] = np.where(sides > 0.0, UPPER, np.where(sides < 0.0, LOWER, 0.5 * UPPER))
    qd[:, sliders] = np.where(kinds == STANDS, rng.choice([0.0, 0.0, 1e-14, -1e-14], kinds.shape), speed)
    return q, qd, rng.uniform(-10.0, 10.0, (lanes, n)), sides, kinds


def projected(w, d, acting):
    """x >= 0 with w x - d >= 0 and x (w x - d) = 0, for the acting ones; the others are 0."""
    x = np.zeros_like(d)
    for _ in range(5000):
        before = x.copy()
        for i in range(d.shape[1]):
            pull = d[:, i] - np.einsum("lj,lj->l", w[:, i], x)
            x[:, i] = np.where(acting[:, i], np.maximum(x[:, i] + pull / w[:, i, i], 0.0), 0.0)
        if np.abs(x - before).max() <= 1e-15 * np.abs(x).max():
            break
    return x


def forces(arm, q, qd, efforts):
    return efforts @ arm.motor_map.T - arm.bias_forces(q, qd) - arm.gravity_forces(q)


def at_once(arm, q, qd, efforts, sides, restitution):
    """Velocities after all impacts, which sliders are held then, and which lanes have come to an end."""
    sliders, qd = arm.sliders(), qd.copy()
    inverse = np.linalg.inv(arm.mass_matrix(q))
    along = inverse[:, :, sliders] * sides[:, None, :]
    w = inverse[:, sliders][:, :, sliders] * sides[:, :, None] * sides[:, None, :]
    w += np.eye(len(sliders)) * (sides == 0.0)[:, None, :]
    for _ in range(100):
        u = sides * qd[:, sliders]
        standing, enters = (sides != 0.0) & (np.abs(u) <= 1e-13), u > 1e-13
        free = np.einsum("lij,lj->li", inverse, forces(arm, q, qd, efforts))
        held = projected(w, sides * free[:, sliders], standing) > 0.0
        if not enters.any():
            break
        acting = (held | enters) & enters.any(axis=1)[:, None]
        p = projected(w, u + restitution * np.maximum(u, 0.0), acting)
        qd -= np.einsum("lij,lj->li", along, p)
        after = -sides * restitution * np.maximum(u, 0.0)
        qd[:, sliders] = np.where(p > 0.0, after, qd[:, sliders])
    slow = (u < -1e-13) & (u > -0.05)  # their bounces may end within the interval
    return qd, held, ~(enters | slow).any(axis=1)


def moved(arm, q, qd, efforts, held, steps=4):
    """q and qd after the interval with some sliders held, and the least force inward of their stops, N."""
    still = np.zeros(q.shape, dtype=bool)
    still[:, arm.sliders()] = held
    both, push = still[:, :, None] | still[:, None, :], np.full(len(q), np.inf)

    def slope(q, qd):
        nonlocal push
        mass, force = arm.mass_matrix(q), forces(arm, q, qd, efforts)
        qdd = np.linalg.solve(
            np.where(both, np.eye(q.shape[1]), mass), np.where(still, 0.0, force)[..., None]
        )[..., 0]
        hold = np.where(still, np.einsum("lij,lj->li", mass, qdd) - force, np.inf)
        inward = np.where(q <= 0.5 * UPPER, 1.0, -1.0)
        push = np.minimum(push, np.where(still, inward * hold, np.inf).min(axis=1))
        return qd, qdd

    h = SPAN / steps
    for _ in range(steps):
        slopes = [slope(q, qd)]
        for part in (0.5, 0.5, 1.0):
            slopes.append(slope(q + part * h * slopes[-1][0], qd + part * h * slopes[-1][1]))
        q, qd = (
            x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
            for x, (a, b, c, d) in zip((q, qd), zip(*slopes, strict=True), strict=True)
        )
    return q, qd, push


def expected(arm, q, qd, efforts, sides, restitution):
    """q, qd (lanes, 2, joints) after an interval, and the lanes in which nothing else happens in it."""
    struck, held, judged = at_once(arm, q, qd, efforts, sides, restitution)
    after, rates, push = moved(arm, q, struck, efforts, held)
    travel = after[:, arm.sliders()]
    inside = held | ((travel > LOWER) & (travel < UPPER))
    return np.stack([after, rates], axis=1), judged & inside.all(axis=1) & (push > 0.05)


def advanced(made, q, qd, efforts, known=None):
    """q, qd (lanes, 2, joints) after an interval; ``known``: sides at which sliders are known to rest."""
    batch = rde.BatchSimulator(made, len(q))
    batch.set_state(q, qd)
    if known is not None:
        names = [n for n in batch._memory.layout.rows["state"] if n.startswith("active_stop_")]
        batch._memory.write(names, known)
    status = batch.advance(efforts)
    return np.stack([batch.q, batch.qd], axis=1), status
