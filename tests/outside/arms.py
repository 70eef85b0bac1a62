"""The arms of these tests: two of the package, and two from outside; their states, and scenes on them."""

import numpy as np
import rrp
import three_r

import redundant_envs as rde

e = rde.effects
ARMS = {
    "4R": rde.FourR(masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3, 0.5, 0.4, 0.6)),
    "RPRP": rde.RPRP(masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3, 0.5)),
    "3R": three_r.ThreeR(masses=(2.0, 1.5, 1.0), lengths=(0.3, 0.5, 0.4)),
    "RRP": rrp.RRP(masses=(2.0, 1.5, 1.0), lengths=(0.3, 0.5)),
}
ROTORS, LINKS = (0.12, 0.3, 0.05, 0.02), (0.07, 0.02, 0.11, 0.004)


def states(arm, count, spread=1.0, seed=3):
    """q, qd and efforts (count, joints); sliders are within a tenth of a metre."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-spread, spread, (count, len(arm.joints)))
    q[:, arm.sliders()] *= 0.1 / spread
    return q, 2.0 * rng.normal(size=q.shape), 4.0 * rng.normal(size=q.shape)


def inertias(arm):
    """Rotors at all joints, and links that are no points."""
    turning = arm.prismatic.count(False)
    return e.Armature(ROTORS[: len(arm.joints)]), e.LinkInertia(LINKS[:turning])


STEPS = {
    "heun": {"integrator": "heun", "substeps": 3},
    "rk4": {"integrator": "rk4", "substeps": 3},
    "rk8": {},
    "1e-6": {"tolerance": 1e-6},
    "dop853": {"integrator": "dop853"},
}
