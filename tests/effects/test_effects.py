"""Effects: forces from their potentials, what each does to a motion, and the energy book."""

import math
import re
from dataclasses import dataclass, replace

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs import effects
from redundant_envs.algebra import arguments_of, physics
from redundant_envs.effects import (
    CentringSpring,
    EffortLimits,
    Gravity,
    LimitSpring,
    ViscousFriction,
    limit_spring,
)
from redundant_envs.effects.hooks import Effect, Force
from redundant_envs.evaluators import source, symbols
from redundant_envs.evaluators.arrays import PRIMITIVES
from redundant_envs.evaluators.binding import bind
from redundant_envs.model.energy import potential_energy
from redundant_envs.robots.parameters import number

FOUR_R = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))
RPRP = rde.RPRP((2.3, 0.7, 1.9, 0.4), (1.1, 0.6))
ROBOTS = {"RPRP": RPRP, "FourR": FOUR_R}
EVERY = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
Q0 = np.array([-1.2, 0.15, -0.4, 0.1])
QD0 = np.array([0.5, -0.6, 0.9, 0.8])


# ---- effects of users: one class each ------------------------------------------------------------


@physics
def stiffening(position, k):
    return -k * position**3


@physics
def stiffening_energy(position, k):
    return 0.25 * k * position**4


@dataclass(frozen=True)
class StiffeningSpring(Effect):
    """A spring of the third power on joint 3."""

    k: float

    def __post_init__(self):
        object.__setattr__(self, "k", number("StiffeningSpring.k", self.k))

    def hooks(self, arm):
        bind = {"position": "phi3", "k": ".k"}
        return (Force(2, stiffening, bind, potential=stiffening_energy, conservative=stiffening),)


@physics
def drag(tip_x, tip_vx, rate, k):
    return -k * rate * (1.0 + tip_x**2 + tip_vx**2)


@dataclass(frozen=True)
class TipDrag(Effect):
    """A dissipative force on joint 4 that needs quantities of the tip."""

    k: float = 0.2

    def hooks(self, arm):
        return (Force(3, drag, {"rate": "phid4", "k": ".k"}),)


@physics
def soft(position, rate, k, c):
    return -k * position - c * rate


@physics
def soft_spring(position, k):
    return -k * position


@physics
def soft_energy(position, k):
    return 0.5 * k * position**2


@dataclass(frozen=True)
class SoftJoint(Effect):
    """Spring and damper in one force: only the spring is booked as potential."""

    k: float = 3.0
    c: float = 0.4

    def hooks(self, arm):
        bind = {"position": "phi1", "rate": "phid1", "k": ".k", "c": ".c"}
        return (Force(0, soft, bind, potential=soft_energy, conservative=soft_spring),)


def all_effects(robot):
    """Every effect of the package that fits the arm, all of them acting from Q0."""
    found = [
        Gravity.on_plane(9.81, 0.4, 0.7),
        ViscousFriction((0.3, 0.2, 0.1, 0.05)),
        EffortLimits((2.0, 1.0, 0.5, 0.25)),
    ]
    if robot.kind == "RPRP":
        found.append(CentringSpring((20.0, 30.0), (0.0, -0.1), (0.3, 0.2)))
        found.append(LimitSpring("r1", 0.0, 0.1, 400.0, 3.0))
        found.append(LimitSpring("r2", -0.1, 0.05, 500.0, 0.0))
    else:
        found.append(LimitSpring("joint2", -0.3, 0.3, 60.0, 2.0))
        found.append(LimitSpring("joint1", -0.5, 2.0, 50.0, 0.0))
    return tuple(found)


def test_every_effect_is_tested():
    """A new effect of the package must join the scene of all effects here, or have a file of its own."""
    used = {type(e).__name__ for r in ROBOTS.values() for e in all_effects(r)} | {"PrismaticStop"}
    assert used == set(effects.REGISTRY) == set(effects.__all__)


# ---- potentials ----------------------------------------------------------------------------------


def potential_hooks():
    for kind, robot in ROBOTS.items():
        for effect in (*all_effects(robot), StiffeningSpring(2.0), SoftJoint()):
            for hook in effect.hooks(robot):
                if isinstance(hook, Force) and hook.potential is not None:
                    name = f"{kind}-{effect.key}-joint{hook.joint + 1}"
                    yield pytest.param(effect, hook, id=name)


@pytest.mark.parametrize(("effect", "hook"), list(potential_hooks()))
def test_force_is_minus_the_slope_of_the_potential(effect, hook):
    """Symbolically, on every piece of the travel."""
    sp = pytest.importorskip("sympy", reason="sympy is in the extra 'verify'")
    names = {*arguments_of(hook.potential), *arguments_of(hook.conservative)}
    values = {a: sp.Symbol(a, real=True) for a in names}
    x = values["position"]
    own = effect.parameters()
    numbers = {
        values[a]: sp.Rational(str(own[hook.bind[a][1:]]))
        for a in values
        if hook.bind.get(a, "").startswith(".")
    }
    U, F = (
        bind(f, symbols.primitives())(*(values[a] for a in arguments_of(f)))
        for f in (hook.potential, hook.conservative)
    )
    # 0.5 and 1.0 as exact fractions
    U, F = (e.xreplace({f: sp.Rational(f) for f in e.atoms(sp.Float)}) for e in (U, F))
    slope, F = sp.diff(U, x).subs(numbers), F.subs(numbers)
    tried = [F.subs(x, sp.Rational(k, 7)) for k in (-20, -5, -1, 1, 3, 30)]
    assert any(f != 0 for f in tried)
    for k in (-20, -5, -1, 0, 1, 3, 30):
        at = sp.Rational(k, 7)
        assert slope.subs(x, at) + F.subs(x, at) == 0
    # On each piece as functions: the Piecewise of clamp resolved by where x lies.
    for low, high in ((None, -10), (-sp.Rational(1, 1000), sp.Rational(1, 1000)), (10, None)):
        inside = sp.Symbol("inside", positive=True)
        at = high - inside if low is None else low + inside if high is None else sp.Rational(1, 2000)
        assert sp.simplify((slope + F).subs(x, at)) == 0


@pytest.mark.parametrize(("effect", "hook"), list(potential_hooks()))
def test_force_is_conservative_part_plus_dissipation(effect, hook):
    """What the whole force has beyond its conservative part takes power out, at any rate."""
    own = effect.parameters()
    rng = np.random.default_rng(2)
    values = {"position": rng.uniform(-3.0, 3.0, 500), "rate": rng.uniform(-9.0, 9.0, 500)}

    def value(f):
        get = [
            own[hook.bind[a][1:]] if hook.bind.get(a, "").startswith(".") else values[a]
            for a in arguments_of(f)
        ]
        return bind(f, PRIMITIVES)(*get)

    rest = value(hook.function) - value(hook.conservative)
    assert (rest * values["rate"] <= 1e-9).all()


def spring_force(position, rate, lower=-0.2, upper=0.3, stiffness=400.0, damping=7.0):
    return bind(limit_spring.force, PRIMITIVES)(position, rate, lower, upper, stiffness, damping)


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
    assert spring_force(0.4, 0.0) == pytest.approx(-40.0, rel=1e-14)
    assert spring_force(0.4, 10.0) == pytest.approx(-47.0, rel=1e-14)
    assert spring_force(0.4, -10.0) == pytest.approx(-33.0, rel=1e-14)
    assert spring_force(0.4, -1000.0) == 0.0
    assert spring_force(-0.3, -10.0) == pytest.approx(47.0, rel=1e-14)
    assert spring_force(-0.3, 10.0) == pytest.approx(33.0, rel=1e-14)
    assert spring_force(-0.3, 1000.0) == 0.0


def test_limit_spring_limits():
    """A slider pushed outwards turns round near its limit; with the limit far away it goes on."""
    batch = rde.BatchSimulator(rde.Scene(RPRP, (LimitSpring("r1", 0.0, 0.3, 20000.0),), control_dt=0.002), 2)
    batch.set_parameters({"limit_spring.r1.upper": 1e6}, index=[1])
    batch.set_state(Q0, np.zeros(4))
    furthest = np.full(2, -np.inf)
    for _ in range(500):
        batch.advance((0.0, 30.0, 0.0, 0.0))
        furthest = np.maximum(furthest, batch.q[:, 1])
    assert 0.3 < furthest[0] < 0.34
    assert furthest[1] > 1.0


def test_centring_spring_is_the_printed_one():
    """k (r - r_max) + k (r - r_min) on the left-hand side of the printed H2 and H4 (report 1.3)."""
    k, lower, upper = (20.0, 31.0), (0.05, -0.1), (0.3, 0.25)
    scene = rde.Scene(RPRP, (CentringSpring(k, lower, upper),), "euler", control_dt=1e-3)
    batch = rde.BatchSimulator(scene)
    batch.set_state(Q0, QD0)
    batch.advance()
    r = Q0[[1, 3]]
    printed = np.zeros(4)
    printed[[1, 3]] = [k[i] * (r[i] - upper[i]) + k[i] * (r[i] - lower[i]) for i in range(2)]
    qdd = RPRP.forward_dynamics(Q0, QD0, -printed, 0.0)
    assert np.abs((batch.qd[0] - QD0) / 1e-3 - qdd).max() <= 1e-11 * np.abs(qdd).max()
    # PE of report 1.1
    book = potential_energy(scene, Q0)
    terms = [0.5 * k[i] * (x[i] - r[i]) ** 2 for i in range(2) for x in (lower, upper)]
    assert book == pytest.approx(sum(terms), rel=1e-14)


def test_centring_spring_frequency():
    """About the middle of the travel with omega^2 = 2 k1 / (m2 + m3), the arm in line, no m4."""
    arm = rde.RPRP((2.0, 0.7, 1.9, 1e-9), (1.1, 0.6))
    scene = rde.Scene(arm, (CentringSpring((50.0, 0.0), (-0.1, -0.1), (0.3, 0.1)),), control_dt=0.002)
    times = np.linspace(0.05, 2.0, 40)
    r1 = rde.simulate(scene, (0.4, 0.15, 0.4, 0.0), np.zeros(4), times).q[:, 1]
    omega = math.sqrt(2.0 * 50.0 / (0.7 + 1.9))
    assert np.abs(r1 - (0.1 + 0.05 * np.cos(omega * times))).max() <= 1e-8


# ---- motors, gravity, friction -------------------------------------------------------------------


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


# ---- the energy book -----------------------------------------------------------------------------


USERS = (StiffeningSpring(8.0), TipDrag(0.3), SoftJoint())


ENGAGED = {
    # limits that the whole motion lies beyond: the same springs without their kinks
    "RPRP": {
        "limit_spring.r1.lower": -4.0, "limit_spring.r1.upper": -2.0,
        "limit_spring.r2.lower": 2.0, "limit_spring.r2.upper": 3.0,
        "limit_spring.r1.stiffness": 20.0, "limit_spring.r2.stiffness": 20.0,
        "limit_spring.r1.damping": 0.5,
    },
    "FourR": {
        "limit_spring.joint1.lower": -19.0, "limit_spring.joint1.upper": -9.0,
        "limit_spring.joint2.lower": 9.0, "limit_spring.joint2.upper": 19.0,
        "limit_spring.joint1.stiffness": 2.0, "limit_spring.joint2.stiffness": 2.0,
        "limit_spring.joint2.damping": 0.05,
    },
}  # fmt: skip


@EVERY
@pytest.mark.parametrize("actuation", ["joint", "generalized"])
def test_energy_book_closes(robot, actuation):
    """Kinetic + potential - work is constant with every effect and three of a user's at once.

    Lane 0 stays beyond its limits, where all is smooth; lane 1 crosses them, and each crossing
    costs the fixed step a little.
    """
    found = (*all_effects(robot), *USERS)
    scene = rde.Scene(robot, found, "rk8", control_dt=0.001, actuation=actuation)
    engaged = []
    for effect in found:
        own = {
            k.rsplit(".", 1)[1]: v
            for k, v in ENGAGED[robot.kind].items()
            if k.rsplit(".", 1)[0] == effect.key
        }
        engaged.append(replace(effect, **own))
    scenes = (replace(scene, effects=tuple(engaged)), scene)
    batch = rde.BatchSimulator(scene, 2, track_work=True)
    batch.set_parameters(ENGAGED[robot.kind], index=[0])
    batch.set_state(Q0, QD0)
    parts = []
    for k in range(1001):
        if k % 50 == 0:
            q, qd, work = batch.q, batch.qd, batch.work
            T = robot.kinetic_energy(q, qd)
            U = [potential_energy(s, q[i]) for i, s in enumerate(scenes)]
            parts.append((T, U, work))
        batch.advance((3.0, -0.7, 0.4, 0.5))
    T, U, work = (np.array(x) for x in zip(*parts, strict=True))
    scale = T.max(axis=0) + np.ptp(U, axis=0)
    drift = np.abs(T + U - work - (T + U - work)[0]).max(axis=0) / scale
    assert drift[0] <= 1e-9
    assert drift[1] <= 1e-5
    assert (np.ptp(work, axis=0) > 0.01 * scale).all()
    assert (np.ptp(U, axis=0) > 0.05 * scale).all()


@EVERY
def test_energy_is_kept_without_dissipation(robot):
    """Gravity, springs and no work: the book has no entry for work at all."""
    springs = (Gravity(9.81), StiffeningSpring(8.0))
    found = rde.simulate(rde.Scene(robot, springs, control_dt=0.002), Q0, QD0, np.linspace(0, 1, 6))
    energy = found.kinetic_energy + found.potential_energy
    assert (found.work == 0.0).all()
    assert np.abs(energy - energy[0]).max() <= 1e-11 * np.abs(found.kinetic_energy).max()


def test_a_users_effect_acts():
    """One class: its force is in the motion, its potential in the book, its number a parameter."""
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


@EVERY
def test_an_absent_effect_leaves_no_text(robot):
    """Neither its functions nor its numbers are in the assembled module."""
    everything = (*all_effects(robot), StiffeningSpring(2.0))
    full = source(rde.Scene(robot, everything))
    for effect in everything:
        rest = tuple(e for e in everything if type(e) is not type(effect))
        without = source(rde.Scene(robot, rest))
        for hook in effect.hooks(robot):
            module = hook.function.__module__.rsplit(".", 1)[-1]
            words = [f"{module}__{hook.function.__name__}", effect.key.replace(".", "_")]
            for word in words:
                assert re.search(rf"\b{word}", full), word
                assert not re.search(rf"\b{word}", without), word
    bare = source(rde.Scene(robot))
    for word in ("gravity", "friction", "spring", "effort_limits", "clamp", "force0", "motor1"):
        assert word not in bare, word
    assert "motor_map" in bare
    assert "motor_map" not in source(rde.Scene(robot, actuation="generalized"))


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
    (lambda: ViscousFriction(-0.1), "ViscousFriction.coefficients[0] is -0.1"),
    (lambda: ViscousFriction((0.1, 0.1, NAN, 0.1)), "ViscousFriction.coefficients[2] is nan"),
    (lambda: ViscousFriction((0.1, 0.1)), "ViscousFriction.coefficients has 2 entries"),
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
    (lambda: CentringSpring((1.0,), (0, 0), (1, 1)), "CentringSpring.stiffness has 1 entries"),
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
        (FOUR_R, (CentringSpring((1, 1), (0, 0), (1, 1)),), "FourR has 0"),
        (RPRP, (Gravity(), Gravity(1.62)), "effects[1] is a second 'gravity'"),
        (
            RPRP,
            (LimitSpring("r1", 0, 1), LimitSpring("r1", 0, 2)),
            "effects[1] is a second 'limit_spring.r1'",
        ),
        (RPRP, ("gravity",), "effects[0] is 'gravity'"),
        (RPRP, (Effect(),), "does not say where it attaches"),
    ],
    ids=["no such joint", "no sliders", "two gravities", "two stops", "not an effect", "no hooks"],
)
def test_effects_that_do_not_fit(robot, found, message):
    """A scene refuses what cannot act, and says why."""
    with pytest.raises((ValueError, NotImplementedError), match=re.escape(message)):
        rde.Scene(robot, found)


@physics
def _pull_to_zero(position):
    return -position


@physics
def _pull_energy(position):
    return 0.5 * position**2


@physics
def _pull_and_drag(gap, rate):
    return -gap - rate


@dataclass(frozen=True)
class OwnNames(Effect):
    """Its conservative part needs a quantity that the force itself does not ask for."""

    def hooks(self, arm):
        bind = {"gap": "theta32", "rate": "phid3", "position": "phi3"}
        return (Force(2, _pull_and_drag, bind, _pull_energy, _pull_to_zero),)


def test_the_conservative_part_may_need_quantities_of_its_own():
    scene = rde.Scene(rde.FourR((2, 1.5, 1, 0.5), (1, 0.8, 0.6, 0.4)), (OwnNames(),))
    motion = rde.simulate(scene, (0.1, 0.2, 0.5, 0.4), (0, 0, 0, 0), np.linspace(0, 1, 11))
    book = motion.kinetic_energy + motion.potential_energy - motion.work
    np.testing.assert_allclose(book, book[0], atol=1e-9)
