"""Effects of motors, gravity, friction and a user in a motion, and refused ones."""

import math
import re

import numpy as np
import pytest
from sample_effects import EVERY, FOUR_R, Q0, QD0, ROBOTS, RPRP, StiffeningSpring, all_effects

import redundant_envs as rde
from redundant_envs import effects
from redundant_envs.effects import CentringSpring, EffortLimits, Gravity, LimitSpring, ViscousFriction
from redundant_envs.effects.hooks import Effect
from redundant_envs.model.energy import potential_energy


def test_every_effect_is_tested():
    """A new effect of the package joins the scene of all effects, in sample_effects.py."""
    used = {type(e).__name__ for r in ROBOTS.values() for e in all_effects(r)} | {"PrismaticStop"}
    assert used == {n for n, x in effects.REGISTRY.items() if x.__module__.startswith("redundant_envs.")}
    assert used <= set(effects.__all__)


@EVERY
def test_effort_limits_saturate(robot):
    """Commands beyond the limit give the motion of the limit, bitwise; within it they pass."""
    limits = (2.0, 1.0, 0.5, 0.0)
    batch = rde.BatchSimulator(rde.Scene(robot, (EffortLimits(limits),)), 12)
    batch.set_parameters({"effort_limits.limits": 1e9}, index=np.arange(4, 12))
    commands = [[9.0, 9.0, 9.0, 9.0], [-9.0, -1.1, -0.6, -1.0], [1.9, -0.9, 0.4, 0.0], [2.0, 1.0, -3.0, 0.0]]
    meant = [[2.0, 1.0, 0.5, 0.0], [-2.0, -1.0, -0.5, 0.0], [1.9, -0.9, 0.4, 0.0], [2.0, 1.0, -0.5, 0.0]]
    batch.set_state(Q0, QD0)
    for _ in range(5):
        batch.advance(np.array([*commands, *meant, *commands]))
    limited, free, unlimited = batch.qd.reshape(3, 4, 4)
    assert (limited == free).all()
    assert (np.abs(limited - unlimited).max(axis=1)[[0, 1, 3]] > 0.01).all()
    qdd = robot.forward_dynamics(Q0, QD0, robot.motor_map @ limits, 0.0)
    batch.set_state(Q0, QD0)
    batch.advance_partly(np.array([*commands, *meant, *commands]), 1e-5)
    assert np.abs((batch.qd[0] - QD0) / 1e-5 - qdd).max() <= 1e-2 * np.abs(qdd).max()


TILTS = ((0.0, 0.0), (0.7, 0.0), (0.7, 1.9), (-1.2, -2.5), (math.pi, 0.3))


@EVERY
def test_gravity_on_any_plane(robot):
    """A tilted and rolled plane is a vertical one with g cos(tilt), seen from axes turned by roll."""
    angles = np.array([0.0 if p else 1.0 for p in robot.prismatic])
    scene = rde.Scene(robot, (Gravity(9.81),), control_dt=0.01)
    tilted = [Gravity.on_plane(9.81, tilt, roll) for tilt, roll in TILTS]
    plain = [Gravity(9.81 * math.cos(tilt)) for tilt, _ in TILTS]
    turned = np.array([roll * angles for _, roll in TILTS])
    a, b = rde.BatchSimulator(scene, 5), rde.BatchSimulator(scene, 5)
    a.set_parameters({"gravity.down": [e.down for e in tilted]})
    b.set_parameters({"gravity.g": [e.g for e in plain]})
    a.set_state(Q0 + turned, QD0)
    b.set_state(Q0, QD0)
    for _ in range(30):
        a.advance()
        b.advance()
    assert np.abs(a.q - turned - b.q).max() <= 1e-11
    assert np.abs(a.qd - b.qd).max() <= 1e-10
    assert np.abs(b.q[1:] - b.q[0]).max(axis=1)[[0, 2, 3]].min() > 0.01
    for i in range(5):
        own = potential_energy(rde.Scene(robot, (tilted[i],)), a.q[i])
        assert own == pytest.approx(robot.potential_energy(b.q[i], plain[i].g), rel=1e-10, abs=1e-10)


@EVERY
def test_no_motion_in_a_horizontal_plane(robot):
    """From rest at tilt = pi/2; and falling at tilt = 0."""
    batch = rde.BatchSimulator(rde.Scene(robot, (Gravity(9.81),), control_dt=0.01), 2)
    down = [Gravity.on_plane(9.81, tilt, 0.3).down for tilt in (math.pi / 2, 0.0)]
    batch.set_parameters({"gravity.down": down})
    batch.set_state(Q0, np.zeros(4))
    for _ in range(50):
        batch.advance()
    assert np.abs(batch.q[0] - Q0).max() <= 1e-14
    assert np.abs(batch.q[1] - Q0).max() > 0.05


@EVERY
def test_gravity_field_in_the_kernel(robot):
    """The first acceleration in a field along -y is that of forward_dynamics with the same g."""
    scene = rde.Scene(robot, (Gravity(1.62),), "euler", control_dt=1e-3)
    batch = rde.BatchSimulator(scene)
    batch.set_state(Q0, QD0)
    batch.advance((1.0, 2.0, -0.5, 0.3))
    qdd = robot.forward_dynamics(Q0, QD0, robot.motor_map @ (1.0, 2.0, -0.5, 0.3), 1.62)
    assert np.abs((batch.qd[0] - QD0) / 1e-3 - qdd).max() <= 1e-11 * np.abs(qdd).max()


@EVERY
def test_friction_acts_on_joint_rates(robot):
    """Q = -B D B^T qd; 4R turning as one body (equal absolute rates) loses power at joint 1 alone."""
    dt = 1e-3
    rows = np.array([[0.0, 7.0, 8.0, 9.0], [2.0, 7.0, 8.0, 9.0], [2.0, 7.0, 8.0, 9.0]])
    rigid = np.full(4, 1.5)
    qd = np.array([rigid, rigid, QD0])
    batch = rde.BatchSimulator(rde.Scene(robot, (ViscousFriction(1.0),), "euler", control_dt=dt), 3)
    batch.set_parameters({"viscous_friction.coefficients": rows})
    batch.set_state(Q0, qd)
    batch.advance()
    found = (batch.qd - qd) / dt
    B = robot.motor_map
    for k in range(3):
        expected = robot.forward_dynamics(Q0, qd[k], -B @ np.diag(rows[k]) @ B.T @ qd[k], 0.0)
        assert np.abs(found[k] - expected).max() <= 1e-11 * np.abs(expected).max()
    if robot.kind == "FourR":
        free = robot.forward_dynamics(Q0, rigid, np.zeros(4), 0.0)
        first = robot.forward_dynamics(Q0, rigid, [-3.0, 0.0, 0.0, 0.0], 0.0)
        assert np.abs(found[0] - free).max() <= 1e-11 * np.abs(free).max()
        assert np.abs(found[1] - first).max() <= 1e-11 * np.abs(first).max()
        assert np.abs(first - free).max() > 0.1


def test_a_users_effect_acts():
    """One class: its force is in the motion, its potential in the balance, its number a parameter."""
    scene = rde.Scene(FOUR_R, (StiffeningSpring(8.0),), "euler", control_dt=1e-3)
    assert scene.parameters()["stiffening_spring.k"] == 8.0
    phi3 = Q0[2] - Q0[1]
    assert potential_energy(scene, Q0) == pytest.approx(0.25 * 8.0 * phi3**4, rel=1e-14)
    batch = rde.BatchSimulator(scene, 2)
    batch.set_state(Q0, QD0)
    batch.set_parameters({"stiffening_spring.k": 0.0}, index=[1])
    batch.advance()
    for lane, k in ((0, 8.0), (1, 0.0)):
        t = np.array([0.0, 0.0, -k * phi3**3, 0.0])
        qdd = FOUR_R.forward_dynamics(Q0, QD0, FOUR_R.motor_map @ t, 0.0)
        assert np.abs((batch.qd[lane] - QD0) / 1e-3 - qdd).max() <= 1e-11 * np.abs(qdd).max()


# ---- refusals ------------------------------------------------------------------------------------

NAN = float("nan")
BAD = [
    (lambda: Gravity("9.81"), "Gravity.g is '9.81'"),
    (lambda: Gravity(NAN), "Gravity.g is nan"),
    (lambda: Gravity(9.81, (0.0, -1.1)), "Gravity.down is (0.0, -1.1)"),
    (lambda: Gravity(9.81, (0.0,)), "Gravity.down has 1 entries"),
    (lambda: Gravity(9.81, (0.0, NAN)), "Gravity.down[1] is nan"),
    (lambda: Gravity.on_plane(9.81, NAN), "tilt is nan"),
    (lambda: Gravity.on_plane(9.81, 0.0, "x"), "roll is 'x'"),
    (lambda: ViscousFriction(-0.1), "ViscousFriction.coefficients is -0.1"),
    (lambda: ViscousFriction((0.1, 0.1, NAN, 0.1)), "ViscousFriction.coefficients[2] is nan"),
    (lambda: EffortLimits((1.0, 1.0, 1.0, -1.0)), "EffortLimits.limits[3] is -1.0"),
    (lambda: EffortLimits("9"), "EffortLimits.limits"),
    (lambda: EffortLimits(None), "EffortLimits.limits is None"),
    (lambda: LimitSpring("r1", 0.3, 0.3), "LimitSpring.lower is 0.3"),
    (lambda: LimitSpring("r1", 0.4, 0.3), "LimitSpring.lower is 0.4"),
    (lambda: LimitSpring("r1", NAN, 0.3), "LimitSpring.lower is nan"),
    (lambda: LimitSpring("r1", 0.0, True), "LimitSpring.upper is True"),
    (lambda: LimitSpring("r1", 0.0, 0.3, 0.0), "LimitSpring.stiffness is 0.0"),
    (lambda: LimitSpring("r1", 0.0, 0.3, -5.0), "LimitSpring.stiffness is -5.0"),
    (lambda: LimitSpring("r1", 0.0, 0.3, 5.0, -1.0), "LimitSpring.damping is -1.0"),
    (lambda: CentringSpring((1.0, -2.0), (0, 0), (1, 1)), "CentringSpring.stiffness[1] is -2.0"),
    (lambda: CentringSpring((1.0, 2.0), (0, 2), (1, 1)), "CentringSpring.lower[1] is 2.0"),
    (lambda: CentringSpring((1.0,), (0, 0), (1, 1)), "CentringSpring.lower has 2 entries; give 1"),
    (lambda: CentringSpring((1.0, 1.0), (0, 0), (1, "b")), "CentringSpring.upper[1] is 'b'"),
    (lambda: StiffeningSpring("k"), "StiffeningSpring.k is 'k'"),
]


@pytest.mark.parametrize(("make", "message"), BAD, ids=[m for _, m in BAD])
def test_bad_numbers(make, message):
    """The message names the field and its value."""
    with pytest.raises(ValueError, match=re.escape(message)):
        make()


@pytest.mark.parametrize(
    ("robot", "found", "message"),
    [
        (FOUR_R, (LimitSpring("r1", 0.0, 0.3),), "coordinate is 'r1'"),
        (FOUR_R, (CentringSpring((1, 1), (0, 0), (1, 1)),), "FourR has none"),
        (RPRP, (CentringSpring((1,), (0,), (1,)),), "for 1 prismatic joints and RPRP has 2: give as many"),
        (
            RPRP,
            (ViscousFriction((0.1, 0.1)),),
            "ViscousFriction.coefficients has 2 entries; RPRP has 4 joints",
        ),
        (RPRP, (Gravity(), Gravity(1.62)), "effects[1] is a second 'gravity'"),
        (
            RPRP,
            (LimitSpring("r1", 0, 1), LimitSpring("r1", 0, 2)),
            "effects[1] is a second 'limit_spring.r1'",
        ),
        (RPRP, ("gravity",), "effects[0] is 'gravity'"),
        (RPRP, (Effect(),), "does not say where it attaches"),
    ],
    ids=[
        "no such joint",
        "no sliders",
        "one of two sliders",
        "two of four joints",
        "two gravities",
        "two stops",
        "not an effect",
        "no hooks",
    ],
)
def test_effects_that_do_not_fit(robot, found, message):
    """A scene refuses what cannot act, and says why."""
    with pytest.raises((ValueError, NotImplementedError), match=re.escape(message)):
        rde.Scene(robot, found)
