"""The arms of these tests: two of the package, and two from outside; and their states."""

import numpy as np
import rrp
import three_r

import redundant_envs as rde

ARMS = {
    "4R": rde.FourR(masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3, 0.5, 0.4, 0.6)),
    "RPRP": rde.RPRP(masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3, 0.5)),
    "3R": three_r.ThreeR(masses=(2.0, 1.5, 1.0), lengths=(0.3, 0.5, 0.4)),
    "RRP": rrp.RRP(masses=(2.0, 1.5, 1.0), lengths=(0.3, 0.5)),
}
ADDED = ("3R", "RRP")


def states(arm, count, spread=1.0):
    rng = np.random.default_rng(3)
    q = rng.uniform(-spread, spread, (count, len(arm.joints)))
    q[:, arm.sliders()] *= 0.1
    return q, 2.0 * rng.normal(size=q.shape), 4.0 * rng.normal(size=q.shape)
