"""Effects of the package and of a user follow their equations: forces, limits of efforts, and gravity."""

import functools
import math
import re

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, StiffeningSpring, advanced
from one_force import ARM, with_force

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.compiler import dialect
from redundant_envs.effects import limit_spring
from redundant_envs.language import algebra
from redundant_envs.language.algebra import PRIMITIVES, exp, physics, sincos, where
from redundant_envs.language.limits import side_beyond
from redundant_envs.model.energy import potential_energy

EVERY = pytest.mark.parametrize("robot", [RPRP, FOUR_R], ids=["RPRP", "FourR"])
Q0 = np.array([-1.2, 0.15, -0.4, 0.1])
QD0 = np.array([0.5, -0.6, 0.9, 0.8])


# ---- the accelerations that a motion begins with -----------------------------------------------------

COMMANDS, DAMPING = np.array((1.0, 2.0, -0.5, 0.3)), np.array((2.0, 7.0, 8.0, 9.0))
TIP, JOINTS = np.array((3.0, -2.0)), np.array((0.5, -0.2, 0.3, 0.1))
PHASE, PHASES, ARMS_OF_TENDON = (0.4, 1.1), (0.3, 0.9, -0.4, 1.0), np.array((0.05, -0.02, 0.03))


def rates(arm):
    return arm.motor_map.T @ QD0


def phi(arm):
    return arm.motor_map.T @ Q0


def antagonists(arm):
    """Two tendons, neither of which is slack."""
    sides = (("a", 1.0), ("b", -1.0))
    return tuple(e.Tendon(arm.joints[1:], tuple(s * ARMS_OF_TENDON), 400.0, 50.0, n) for n, s in sides)


BEGUN = {
    "efforts": (lambda arm: (), lambda arm: COMMANDS),
    "user's spring": (lambda arm: (StiffeningSpring(8.0),), lambda arm: (0, 0, 0, -8.0 * phi(arm)[3] ** 3)),
    "viscous friction": (lambda arm: (e.ViscousFriction(DAMPING),), lambda arm: -DAMPING * rates(arm)),
    "torques": (lambda arm: (e.JointTorque(step=tuple(JOINTS)),), lambda arm: JOINTS),
    "periodic torques": (
        lambda arm: (e.JointTorque(amplitude=tuple(JOINTS), frequency=3.0, phase=PHASES),),
        lambda arm: JOINTS * np.sin(PHASES),
    ),
    "antagonists, twice as stiff": (
        antagonists,
        lambda arm: -2.0 * 400.0 * phi(arm)[1:] @ ARMS_OF_TENDON * np.array((0, *ARMS_OF_TENDON)),
    ),
    "force at the tip": (
        lambda arm: (e.TipForce(step=tuple(TIP)),),
        lambda arm: np.linalg.solve(arm.motor_map, arm.jacobian(Q0).T @ TIP),
    ),
    "periodic force at the tip": (
        lambda arm: (e.TipForce(amplitude=tuple(TIP), frequency=5.0, phase=PHASE),),
        lambda arm: np.linalg.solve(arm.motor_map, arm.jacobian(Q0).T @ (TIP * np.sin(PHASE))),
    ),
}
"""Effects, and the efforts of joints that they mean."""


@EVERY
@pytest.mark.parametrize("what", BEGUN)
def test_a_motion_begins_with_the_acceleration_of_an_effect(robot, what):
    effects, means = BEGUN[what]
    made = rde.Scene(robot, (*effects(robot), e.Gravity(1.62)), "euler", control_dt=1e-3)
    batch, _ = advanced(made, Q0, QD0, COMMANDS if what == "efforts" else None)
    qdd = robot.forward_dynamics(Q0, QD0, robot.motor_map @ means(robot), 1.62)
    assert np.abs((batch.qd[0] - QD0) / 1e-3 - qdd).max() <= 1e-11 * np.abs(qdd).max()


def test_centring_springs_are_those_of_the_report():
    """k (r - r_max) + k (r - r_min) on the left-hand side of H2 and H4 (1.3), and PE of 1.1, J."""
    k, lower, upper = np.array((20.0, 31.0)), np.array((0.05, -0.1)), np.array((0.3, 0.25))
    scene = rde.Scene(RPRP, (e.CentringSpring(k, lower, upper),), "euler", control_dt=1e-3)
    r, batch = Q0[[1, 3]], advanced(scene, Q0, QD0)[0]
    first, second = k * (r - upper) + k * (r - lower)
    qdd = RPRP.forward_dynamics(Q0, QD0, np.array([0.0, -first, 0.0, -second]), 0.0)
    assert np.abs((batch.qd[0] - QD0) / 1e-3 - qdd).max() <= 1e-11 * np.abs(qdd).max()
    stretched = 0.5 * (k * (upper - r) ** 2 + k * (lower - r) ** 2).sum()
    assert potential_energy(scene, Q0) == pytest.approx(stretched, rel=1e-14)


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


@EVERY
def test_gravity_on_any_plane(robot):
    """A tilted and rolled plane is a vertical one with g cos(tilt), seen from axes turned by roll."""
    tilts = ((0.0, 0.0), (0.7, 0.0), (0.7, 1.9), (-1.2, -2.5), (math.pi, 0.3), (math.pi / 2, 0.3))
    angles = np.array([0.0 if p else 1.0 for p in robot.prismatic])
    scene = rde.Scene(robot, (e.Gravity(9.81),), control_dt=0.01)
    tilted = [e.Gravity.on_plane(9.81, tilt, roll) for tilt, roll in tilts]
    plain = [e.Gravity(9.81 * math.cos(tilt)) for tilt, _ in tilts]
    turned = np.array([roll * angles for _, roll in tilts])
    down, g = {"gravity.down": [x.down for x in tilted]}, {"gravity.g": [x.g for x in plain]}
    a, _ = advanced(scene, Q0 + turned, QD0, change=down, intervals=30)
    b, _ = advanced(scene, [Q0] * len(tilts), QD0, change=g, intervals=30)
    assert np.abs(a.q - turned - b.q).max() <= 1e-11
    assert np.abs(a.qd - b.qd).max() <= 1e-10
    assert np.abs(b.q[1:] - b.q[0]).max(axis=1)[[0, 2, 3]].min() > 0.01
    for i in range(len(tilts)):
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


# ---- functions of users, also defined again, and what a message says to write instead ----------------

Q1, QD1 = np.array([-1.2, 0.4, -0.4, 0.9]), np.array([0.5, -0.6, 0.9, 0.8])
PHI2 = Q1[1] - Q1[0]
KS = np.array([3.0, 5.0])


def acts_as(function, force_on_joint_2, bind=None):
    """Whether a function, as the force on joint 2, begins a motion with the acceleration of a force."""
    effects = with_force(function, bind).effects
    begun, _ = advanced(rde.Scene(ARM, effects, "euler", control_dt=1e-3), Q1, QD1)
    qdd = ARM.forward_dynamics(Q1, QD1, ARM.motor_map @ (0.0, force_on_joint_2, 0.0, 0.0), 0.0)
    return np.abs((begun.qd[0] - QD1) / 1e-3 - qdd).max() <= 1e-11 * np.abs(qdd).max()


def in_other_words(x):
    """Loops and branches on plain numbers, assignments, lists."""
    total = 0.0
    for k in range(4):
        if k % 2:
            total += [x, -x][0] * k
    return total


class Holder:
    k = 7.0

    @physics
    def method(self, x):
        return -self.k * x

    def __call__(self, x):
        return -self.k * x


def twice(x, k=2.0):
    return -k * x


ALLOWED = {
    "array": (lambda x: x * KS[1] - KS[0] * x, 2.0 * PHI2),
    "default of a helper": (lambda x: twice(x), -2.0 * PHI2),
    "python": (in_other_words, 4.0 * PHI2),
    "closure": ((lambda k: lambda x: -k * x)(5.0), -5.0 * PHI2),
    "object": (Holder(), -7.0 * PHI2),
    "partial": (functools.partial(lambda k, x: k * x, 6.0), 6.0 * PHI2),
    "whole number": (lambda x: 3, 3.0),
    "tanh": (lambda x: 1.0 - 2.0 / (exp(2.0 * x) + 1.0), np.tanh(PHI2)),
    "sine": (lambda x: sincos(x)[0] * where(x > 0.0, 2.0, 3.0), 2.0 * np.sin(PHI2)),
}


@pytest.mark.parametrize("what", ["method", *ALLOWED])
def test_a_function_does_what_its_code_says(what):
    function, force = ALLOWED.get(what, (None, -7.0 * PHI2))
    function = Holder().method if function is None else physics(function)
    assert acts_as(function, force)
    assert function(PHI2) == pytest.approx(force)


class Callable:
    """What a tool that reloads modules keeps, while it replaces the method of the class."""

    def __call__(self, x):
        return x


def wrapped():
    """A function of another one, whose arguments it shows."""
    function = functools.wraps(lambda x: x)(lambda *given: function.__wrapped__(*given))
    return function


REPLACED = {
    "code": (lambda: lambda x: x, lambda f, new, method: setattr(f, "__code__", new.__code__)),
    "call": (Callable, lambda f, new, method: setattr(Callable, "__call__", method)),
    "wrapped": (wrapped, lambda f, new, method: setattr(f, "__wrapped__", new)),
}


@pytest.mark.parametrize(("made", "replace"), REPLACED.values(), ids=REPLACED)
def test_a_function_whose_code_is_replaced_is_the_new_one(made, replace, monkeypatch):
    """Tools that reload modules keep the function and replace its code, and its arguments."""
    monkeypatch.setattr(Callable, "__call__", Callable.__call__)  # to be as it was
    shape = physics(made())
    assert acts_as(shape, PHI2)
    for new, method, bind, force in (
        (lambda x: 7.0 * x, lambda self, x: 7.0 * x, {"x": "phi2"}, 7.0 * PHI2),
        (
            lambda rate, x: rate - x, lambda self, rate, x: rate - x, {"x": "phi2", "rate": "phid2"},
            QD1[1] - QD1[0] - PHI2,
        ),
    ):  # fmt: skip
        replace(shape, new, method)
        assert acts_as(shape, force, bind)


NAMES = {name: getattr(algebra, name) for name in (*PRIMITIVES, "clamp", "squash", "sincos", "logical_not")}
INSTEAD = {
    "tanh": np.tanh, "sign": np.sign, "ceil": np.ceil, "int": np.trunc, "square": np.square,
    "round": lambda x: np.floor(x + 0.5), "fabs": np.abs,
    "mod": np.mod, "hypot": np.hypot, "max": np.maximum, "min": np.minimum,
}  # fmt: skip


@pytest.mark.parametrize("name", INSTEAD)
def test_what_is_written_instead_is_the_same_function(name):
    written = re.match(r"write (.*?)(, (or|which) .*| with .*)?$", dialect._INSTEAD[name])[1]
    names = [n for n in "abxy" if re.search(rf"\b{n}\b", written)]
    function = physics(eval(f"lambda {', '.join(names)}: {written}", {**NAMES, "__name__": "prompt"}))
    dialect.check(function)
    values = [[-3.7, -1.0, -0.4, 0.3, 0.5, 2.0, 6.2], [2.0, -0.7, -0.4, 3.0, 1.0, 2.0, -5.0]]
    given = np.array(values[: len(names)])
    np.testing.assert_allclose(function(*given), INSTEAD[name](*given), rtol=1e-13, atol=1e-15)
    assert isinstance(function(*(0.3, 0.7)[: len(names)]), float)
