"""Effects of the package and of a user in motions: accelerations, potentials, and what is booked as work."""

import math

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, SoftJoint, StiffeningSpring, advanced

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects import limit_spring
from redundant_envs.language.limits import side_beyond
from redundant_envs.model.energy import kinetic_energy, potential_energy

EVERY = pytest.mark.parametrize("robot", [RPRP, FOUR_R], ids=["RPRP", "FourR"])
Q0 = np.array([-1.2, 0.15, -0.4, 0.1])
QD0 = np.array([0.5, -0.6, 0.9, 0.8])


# ---- the accelerations that a motion begins with --------------------------------------------------------

K, LOWER, UPPER = np.array((20.0, 31.0)), np.array((0.05, -0.1)), np.array((0.3, 0.25))
PULL = K * (Q0[[1, 3]] - UPPER) + K * (Q0[[1, 3]] - LOWER)
"""k (r - r_max) + k (r - r_min) on the left-hand side of the printed H2 and H4 (report 1.3)."""
STRETCH = 0.5 * (K * (UPPER - Q0[[1, 3]]) ** 2 + K * (LOWER - Q0[[1, 3]]) ** 2).sum()
"""PE of report 1.1, J."""
RIGID = np.full(4, 1.5)
"""Equal absolute rates: 4R turns as one body, and loses power at joint 1 alone."""
EFFORTS, DAMPING = (1.0, 2.0, -0.5, 0.3), (2.0, 7.0, 8.0, 9.0)
BEGUN = {
    "gravity": (lambda arm: e.Gravity(1.62), QD0, EFFORTS, lambda arm: arm.motor_map @ EFFORTS, 1.62, None),
    "centring spring": (
        lambda arm: e.CentringSpring(K, LOWER, UPPER), QD0, None,
        lambda arm: np.array([0.0, -PULL[0], 0.0, -PULL[1]]), 0.0, lambda arm: STRETCH,
    ),
    "a user's spring": (
        lambda arm: StiffeningSpring(8.0), QD0, None,
        lambda arm: arm.motor_map @ (0.0, 0.0, 0.0, -8.0 * (arm.motor_map.T @ Q0)[3] ** 3), 0.0,
        lambda arm: 0.25 * 8.0 * (arm.motor_map.T @ Q0)[3] ** 4,
    ),
} | {
    f"friction, {what}": (
        lambda arm: e.ViscousFriction(DAMPING), qd, None,
        lambda arm, qd=qd: -arm.motor_map @ np.diag(DAMPING) @ arm.motor_map.T @ qd, 0.0, None,
    )
    for what, qd in (("rigid", RIGID), ("bent", QD0))
}  # fmt: skip
"""Effect, rates, efforts, the generalized forces that it means, g, and its potential."""


@pytest.mark.parametrize(
    ("robot", "what"),
    [(arm, what) for what in BEGUN for arm in (RPRP, FOUR_R) if arm.sliders() or what != "centring spring"],
)
def test_a_motion_begins_with_the_acceleration_of_an_effect(robot, what):
    effect, qd, efforts, forces, g, potential = BEGUN[what]
    scene = rde.Scene(robot, (effect(robot),), "euler", control_dt=1e-3)
    batch, _ = advanced(scene, Q0, qd, efforts)
    qdd = robot.forward_dynamics(Q0, qd, forces(robot), g)
    assert np.abs((batch.qd[0] - qd) / 1e-3 - qdd).max() <= 1e-11 * np.abs(qdd).max()
    if potential is not None:
        assert potential_energy(scene, Q0) == pytest.approx(potential(robot), rel=1e-14)


@EVERY
def test_effort_limits_saturate(robot):
    """Commands beyond the limit give the motion of the limit, bitwise; within it they pass."""
    commands = [[9.0, 9.0, 9.0, 9.0], [-9.0, -1.1, -0.6, -1.0], [1.9, -0.9, 0.4, 0.0], [2.0, 1.0, -3.0, 0.0]]
    meant = [[2.0, 1.0, 0.5, 0.0], [-2.0, -1.0, -0.5, 0.0], [1.9, -0.9, 0.4, 0.0], [2.0, 1.0, -0.5, 0.0]]
    limits = np.array([(2.0, 1.0, 0.5, 0.0)] * 4 + [(1e9,) * 4] * 8)
    scene = rde.Scene(robot, (e.EffortLimits(1.0),))
    efforts, change = np.array([*commands, *meant, *commands]), {"effort_limits.limits": limits}
    batch, _ = advanced(scene, [Q0] * 12, QD0, efforts, change, intervals=5)
    limited, free, unlimited = batch.qd.reshape(3, 4, 4)
    assert (limited == free).all()
    assert (np.abs(limited - unlimited).max(axis=1)[[0, 1, 3]] > 0.01).all()


TILTS = ((0.0, 0.0), (0.7, 0.0), (0.7, 1.9), (-1.2, -2.5), (math.pi, 0.3), (math.pi / 2, 0.3))


@EVERY
def test_gravity_on_any_plane(robot):
    """A tilted and rolled plane is a vertical one with g cos(tilt), seen from axes turned by roll."""
    angles = np.array([0.0 if p else 1.0 for p in robot.prismatic])
    scene = rde.Scene(robot, (e.Gravity(9.81),), control_dt=0.01)
    tilted = [e.Gravity.on_plane(9.81, tilt, roll) for tilt, roll in TILTS]
    plain = [e.Gravity(9.81 * math.cos(tilt)) for tilt, _ in TILTS]
    turned = np.array([roll * angles for _, roll in TILTS])
    a, b = (
        advanced(scene, Q0 + turn, QD0, change=change, intervals=30)[0]
        for turn, change in (
            (turned, {"gravity.down": [x.down for x in tilted]}),
            (0.0 * turned, {"gravity.g": [x.g for x in plain]}),
        )
    )
    assert np.abs(a.q - turned - b.q).max() <= 1e-11
    assert np.abs(a.qd - b.qd).max() <= 1e-10
    assert np.abs(b.q[1:] - b.q[0]).max(axis=1)[[0, 2, 3]].min() > 0.01
    for i in range(len(TILTS)):
        own = potential_energy(rde.Scene(robot, (tilted[i],)), a.q[i])
        assert own == pytest.approx(robot.potential_energy(b.q[i], plain[i].g), rel=1e-10, abs=1e-10)


def spring_force(position, rate, lower=-0.2, upper=0.3, stiffness=400.0, damping=7.0):
    side = side_beyond(position, lower, upper)
    return limit_spring.force(position, rate, lower, upper, stiffness, damping, side)


def test_limit_spring_is_one_sided_and_continuous():
    """Nothing inside; no step at the limit at any rate; always towards the inside."""
    rates = np.linspace(-200.0, 200.0, 81)
    inside = np.linspace(-0.2, 0.3, 41)[:, None]
    assert (spring_force(inside, rates) == 0.0).all()
    for limit, side in ((-0.2, -1.0), (0.3, 1.0)):
        for depth in (1e-12, 1e-9, 1e-3, 0.5):
            force = spring_force(limit + side * depth, rates)
            assert (side * force <= 0.0).all()
            assert (np.abs(force) <= 1.01 * (400.0 + 7.0 * 200.0) * depth).all()
    # resting: the spring alone; entering: more; leaving: less, then nothing, never a pull
    for rate, force in ((0.0, -40.0), (10.0, -47.0), (-10.0, -33.0), (-1000.0, 0.0)):
        assert spring_force(0.4, rate) == pytest.approx(force, rel=1e-14)
        assert spring_force(-0.3, -rate) == pytest.approx(-force, rel=1e-14)


# ---- what counts as potential energy, and what as work --------------------------------------------------


@pytest.mark.quick("(SoftJoint(k=8.0, c=8.0),)")
@pytest.mark.parametrize(
    "effects", [(SoftJoint(8.0, 8.0),), (e.Gravity(9.81), StiffeningSpring(8.0))], ids=str
)
def test_a_force_is_booked_as_potential_as_far_as_it_is_conservative(effects):
    """The rest counts as work: a force that is entirely the slope of its potential does no work at all."""
    scene = rde.Scene(FOUR_R, effects, tolerance=1e-9)
    motion = rde.simulate(scene, Q0, QD0, np.linspace(0.0, 1.0, 21)[1:])
    start = kinetic_energy(scene, Q0, QD0) + potential_energy(scene, Q0)
    assert np.abs(motion.kinetic_energy + motion.potential_energy - motion.work - start).max() < 1e-8
    assert (motion.work < -0.1).all() if len(effects) == 1 else (motion.work == 0.0).all()
