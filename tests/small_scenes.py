"""Two arms, a scene of each with every method of equal steps, and their motions."""

import numpy as np

import redundant_envs as rde

e = rde.effects
FOUR_R = rde.FourR(masses=(2, 1.5, 1, 0.5), lengths=(0.3, 0.5, 0.4, 0.6))
RPRP = rde.RPRP(masses=(2, 1.5, 1, 0.5), lengths=(0.3, 0.5))
SCENES = {
    f"{arm.kind}-{method}": rde.Scene(
        arm,
        (
            e.Gravity(),
            e.ViscousFriction((0.1, 0.2, 0.3, 0.05)),
            e.LimitSpring(arm.joints[1], -0.4, 0.4, 800.0, 100.0),
            e.EffortLimits((5.0, 4.0, 3.0, 2.0)),
        ),
        integrator=method,
        control_dt=0.01,
        substeps=2,
    )
    for arm in (FOUR_R, RPRP)
    for method in ("euler", "rk4", "rk8")
}


def states(n, seed=0):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-0.4, 0.4, (n, 4))
    return q, rng.normal(0, 2, (n, 4)), rng.uniform(-6, 6, (n, 4))


def run(scene, q, qd, u, steps=5, **kwargs):
    """States after some intervals, and the status of the last."""
    batch = rde.BatchSimulator(scene, len(q), **kwargs)
    batch.set_state(q, qd)
    for _ in range(steps):
        status = batch.advance(u)
    return np.concatenate([batch.q, batch.qd], axis=1), status


OWN_IDS = [f"redundant_envs/{arm}{task}-v0" for arm in ("RPRP", "FourR") for task in ("Reach", "GoalReach")]
"""Ids of this package: tests may have registered more."""
