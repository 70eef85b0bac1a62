"""Scenes by name, for all tests: each arm, method and effect, alone and together, and hard numbers.

``@on("stops *")`` runs a test on the scenes whose names match; ``SCENES`` has all of them. Properties that
every scene keeps are in ``test_properties.py``, so that a test elsewhere says what is special about its own.
"""

import contextlib
import copy
import dataclasses
import functools
import pickle
from fnmatch import fnmatchcase

import cloudpickle
import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.effects.hooks import Effect, Force
from redundant_envs.effects.numbers import example_of
from redundant_envs.envs import registration
from redundant_envs.language.algebra import physics
from redundant_envs.verify import recorded_bits
from redundant_envs.verify.checks import random_states
from studies.another_account import Account
from tests.verify import aimed
from tests.verify.aimed import Lag, Play

e = rde.effects
FOUR_R, RPRP = aimed.ARMS["4R"], aimed.ARMS["RPRP"]
"""Arms with unequal masses, kg, and lengths, m: an equation that confuses two of them is seen."""
EQUAL = {"4R": rde.FourR((1.0,) * 4, (0.5,) * 4), "RPRP": rde.RPRP((1.0,) * 4, (0.5,) * 2)}
ARMS = {
    "4R": FOUR_R,
    "RPRP": RPRP,
    "2R": rde.TwoR((2.0, 1.5), (0.3, 0.5)),
    "RRR": rde.Chain("RRR", (2.0, 1.5, 1.0), (0.3, 0.5, 0.4)),
    **{kind: aimed.ARMS[kind] for kind in ("RP", "PPR", "RPPP", "PRPRP")},
}
GRAVITY, FRICTION, LIMITS = (aimed.EFFECTS[name] for name in ("gravity", "friction", "limits"))
METHODS = ("euler", "rk4", "rk8", "dop853")
IDS = [
    name
    for name, (arm, task) in registration.IDS.items()
    if not (registration.HOMES.get(("the arm", arm)) or registration.HOMES.get(("the task", task)))
]
"""Ids of this package: tests may have registered more."""
OFTEN = {"RPRPReach", "FourRReach", "RPRPGoalReach", "TwoRReachLight", "TwoRTrackAround", "TwoRReachFault"}
EACH_ID = [
    pytest.param(i, marks=() if i.partition("/")[2].removesuffix("-v0") in OFTEN else pytest.mark.long)
    for i in IDS
]
"""Rows of tests of all ids: make test runs few, with the arm that compiles in the least time."""
COPIES = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda x: pickle.loads(pickle.dumps(x)),
    "oldest pickle": lambda x: pickle.loads(pickle.dumps(x, protocol=2)),
    "cloudpickle": lambda x: cloudpickle.loads(cloudpickle.dumps(x)),
    "copy of a copy": lambda x: copy.deepcopy(pickle.loads(pickle.dumps(x))),
}
"""Every way to copy."""


def stops(arm, restitution=0.5, lower=0.0, upper=0.3):
    """Hard stops of all sliders of an arm, by default 0.3 m of travel."""
    count = len(arm.sliders())
    return e.PrismaticStop((lower,) * count, (upper,) * count, restitution)


def springs(arm):
    """Springs and dampers at the limits of the first and the last joint."""
    return tuple(e.LimitSpring(joint, -0.4, 0.4, 800.0, 10.0) for joint in (arm.joints[0], arm.joints[-1]))


stiffening = physics(lambda position, k: -k * position**3)
stiffening_energy = physics(lambda position, k: 0.25 * k * position**4)
drag = physics(lambda tip_x, tip_vx, rate, k: -k * rate * (1.0 + tip_x**2 + tip_vx**2))
soft = physics(lambda position, rate, k, c: -k * position - c * rate)
soft_spring = physics(lambda position, k: -k * position)
soft_energy = physics(lambda position, k: 0.5 * k * position**2)


@dataclasses.dataclass(frozen=True)
class StiffeningSpring(Effect):
    """A user's spring of the third power on the last joint, k in N m / rad^3 or N / m^3."""

    k: float = 3.0

    def hooks(self, arm):
        bind, energy = {"position": f"phi{len(arm.joints)}", "k": ".k"}, stiffening_energy
        return (Force(len(arm.joints) - 1, stiffening, bind, potential=energy, conservative=stiffening),)


@dataclasses.dataclass(frozen=True)
class TipDrag(Effect):
    """A user's dissipative force on the first joint that needs quantities of the tip."""

    k: float = 0.2

    def hooks(self, arm):
        return (Force(0, drag, {"rate": "phid1", "k": ".k"}),)


@dataclasses.dataclass(frozen=True)
class SoftJoint(Effect):
    """A user's spring and damper in one force on the first joint: only the spring is booked as potential."""

    k: float = 3.0
    c: float = 0.4

    def hooks(self, arm):
        bind = {"position": "phi1", "rate": "phid1", "k": ".k", "c": ".c"}
        return (Force(0, soft, bind, potential=soft_energy, conservative=soft_spring),)


USERS = {
    "stiffening": (StiffeningSpring(),),
    "drag": (TipDrag(),),
    "soft": (SoftJoint(),),
    "lag": (Lag(0.01),),
    "play": (Play(0.02, 3.0),),
    "all": (StiffeningSpring(), TipDrag(), SoftJoint(), Lag(0.01), Play(0.02, 3.0)),
}
"""Effects as users write them, by what they add: a potential, a dissipation, a state, a kink."""


def every_effect(arm):
    """Every effect of the package that fits an arm."""
    joints, sliders = len(arm.joints), len(arm.sliders())
    centring = e.CentringSpring((80.0,) * sliders, (-0.1,) * sliders, (0.2,) * sliders)
    own = (centring, stops(arm, 0.5, -0.2, 0.2)) if sliders else ()
    return (
        e.Gravity.on_plane(9.81, 0.4, 0.7), e.ViscousFriction((0.1,) * joints), *springs(arm), *own,
        e.EffortLimits((4.0,) * joints),
    )  # fmt: skip


def disturbed(arm):
    """Sensors with every fault, and forces that nobody controls."""
    pair = {"amplitude": (1.0, -2.0), "frequency": 7.0, "phase": (0.3, 1.0)}
    return (
        e.SensorBias(0.01, -0.02), e.SensorNoise(0.01, 0.02), e.Quantisation(0.01, 0.02),
        e.SensorDelay(0.01, 0.025), e.DroppedSamples(0.2),
        e.TipForce(step=(1.0, 2.0), start=0.015, **pair, density=0.1, deviation=2.0, time_constant=0.05),
        e.JointTorque(step=0.3, amplitude=0.5, frequency=9.0, density=0.02, deviation=0.3, time_constant=0.1),
    )  # fmt: skip


MOTORS = (
    e.Armature(0.02), e.Play(0.4), e.DeadZone(0.2), e.DCMotor(2.0, 0.004, 0.3, 1.5), e.Lag(0.01),
    e.TorqueSpeed(4.0, 20.0), e.QuadraticFriction(0.02), e.SmoothCoulombFriction(0.05, 0.5),
    e.LuGre(30.0, 0.2, 0.05, 0.1, 0.15, 0.5),
)  # fmt: skip
"""Motors that take a voltage, and joints with friction."""
GEARS = (e.GearBacklash(0.02, 60.0, 0.05, 2.0),)
"""Motors behind gears with backlash."""
DELAYS = (e.CommandDelay(0.025, 0.05),)
"""Commands that arrive two intervals and a half later."""
DRY_FRICTION = (e.CoulombFriction((0.4, 0.3, 0.2, 0.1)),)
"""Joints that stick and slip."""
OBSTACLES = (
    e.Disc((0.6, 0.5), 0.3, 800.0, 0.2, 0.4, 0.1, along_links=True),
    e.Disc((-0.9, 0.2), 0.3, 500.0, name="left"),
    e.HalfPlane((0.0, -0.4), (0.2, 1.0), 600.0, 0.1, 0.3),
    e.HalfPlane((-1.0, 0.0), (1.0, 0.0), 400.0, along_links=True, name="wall"),
)
"""A disc that links touch, and a floor and a wall for the tip and for all points."""


def bodies(arm):
    """Loads, links with inertia, springs between parts of the arm, a base that shakes, an object to grasp."""
    first, second, *_, last = arm.joints
    return (
        e.Payload(0.4), e.LinkInertia(0.03), e.Tether(2, (0.2, 0.1), 40.0, 0.5),
        e.Tendon((first, second), (0.04, -0.05), 3e3, 4.0), e.TwoStageSpring(last, -0.2, 0.3, 5.0, 60.0),
        e.MovingBase((0.01, -0.02), 9.0), e.PickUp(0.3, 0.05),
    )  # fmt: skip


def joint_stops(arm):
    """Hard stops at joints that turn and slide, one of them on one side alone."""
    lower = (0.05 if slides else -1.0 for slides in arm.prismatic)
    upper = (0.3 if slides else 1.0 for slides in arm.prismatic)
    return (e.JointStop((*lower,), (None, *[*upper][1:]), 0.5),)


GROUPS = {
    "motors": lambda arm: MOTORS,
    "gears": lambda arm: GEARS,
    "delays": lambda arm: DELAYS,
    "stiction": lambda arm: DRY_FRICTION,
    "disturbed": disturbed,
    "bodies": bodies,
    "obstacles": lambda arm: OBSTACLES,
    "joint stops": joint_stops,
}
"""Groups of effects that ``every_effect`` does not have: functions of an arm."""


def with_example(kind, arm):
    """The example of an effect, if it fits an arm."""
    effect = kind(**example_of(kind).numbers)
    with contextlib.suppress(ValueError):
        return rde.Scene(arm, (effect,)).effects
    return ()


GROUPED = {type(x) for group in (every_effect, *GROUPS.values()) for a in (FOUR_R, RPRP) for x in group(a)}
NEW = {name: kind for name, kind in e.OWN.items() if kind not in GROUPED}
GROUPS |= {name: functools.partial(with_example, kind) for name, kind in NEW.items()}
"""A new effect is a group of its own, until another one takes it."""


def _scenes():
    yield from recorded_bits.SCENES.items()
    for kind, arm in ARMS.items():
        yield f"{kind} every effect rk8", rde.Scene(arm, every_effect(arm), "rk8", 0.01)
        yield f"{kind} every effect 1e-6", rde.Scene(arm, every_effect(arm), tolerance=1e-6)
    for name, group in GROUPS.items():
        yield f"4R {name} rk8", rde.Scene(FOUR_R, (GRAVITY, *group(FOUR_R)), "rk8", 0.01)
        yield f"RPRP {name} 1e-6", rde.Scene(RPRP, (GRAVITY, *group(RPRP)), tolerance=1e-6)
    for kind in ("4R", "RPRP"):
        for name, effects in USERS.items():
            yield f"{kind} users' {name} 1e-6", rde.Scene(ARMS[kind], (GRAVITY, *effects), tolerance=1e-6)
        yield f"{kind} users' all rk4", rde.Scene(ARMS[kind], (GRAVITY, *USERS["all"]), "rk4", 0.005)
    one_sided = e.PrismaticStop((0.5, None), (None, -0.5), 0.8)
    yield "RPRP stops on one side, far away, 1e-6", rde.Scene(RPRP, (GRAVITY, one_sided), tolerance=1e-6)
    for kind in ("RP", "RPPP", "PRPRP"):
        arm = ARMS[kind]
        yield f"{kind} stops rk4", rde.Scene(arm, (GRAVITY, stops(arm, 0.0)), "rk4", 0.01)
        yield f"{kind} stops 1e-9", rde.Scene(arm, (GRAVITY, stops(arm, 0.8)), tolerance=1e-9)
    for kind in ("4R", "RPRP"):
        arm = ARMS[kind]
        for name, what, k in (
            ("light", "masses", 1e-4), ("heavy", "masses", 1e4), ("short", "lengths", 1e-2),
            ("long", "lengths", 1e2),
        ):  # fmt: skip
            one = dataclasses.replace(arm, **{what: tuple(k * x for x in getattr(arm, what))})
            yield f"hard: {kind} {name}", rde.Scene(one, (GRAVITY,), tolerance=1e-6)
        uneven = dataclasses.replace(arm, masses=(1e3, 1e-3, 10.0, 1.0))
        yield f"hard: {kind} uneven", rde.Scene(uneven, (GRAVITY,), tolerance=1e-6)
        yield f"hard: {kind} short intervals", rde.Scene(arm, (GRAVITY,), control_dt=1e-5, tolerance=1e-9)
        yield f"hard: {kind} long intervals", rde.Scene(arm, (GRAVITY,), control_dt=0.2, tolerance=1e-9)


SCENES = dict(_scenes())
"""All scenes by name."""


def names(*patterns):
    """The names that match one of some patterns, as of files; a pattern that matches none is an error."""
    found = {p: [n for n in SCENES if fnmatchcase(n, p)] for p in patterns}
    missing = [p for p, some in found.items() if not some]
    assert not missing, f"no scene is called {', '.join(missing)}"
    return list(dict.fromkeys(n for some in found.values() for n in some))


def on(*patterns):
    """Run a test on the scenes that match; it takes ``scene``."""
    chosen = names(*patterns)
    return pytest.mark.parametrize("scene", [SCENES[n] for n in chosen], ids=chosen)


def started(scene, count=21, seed=0, varied=False, **kwargs):
    """A simulator of a scene in the middle of a motion; ``varied``: lanes have masses of their own.

    ``kwargs`` are those of ``BatchSimulator``.
    """
    q, qd, efforts = random_states(scene, count, seed)
    batch = rde.BatchSimulator(scene, count, **kwargs)
    batch.set_state(q, qd)
    if varied:
        masses = np.random.default_rng(seed).uniform(0.5, 2.0, (count, scene.robot.num_masses))
        batch.set_parameters({"masses": masses * scene.robot.masses})
    batch.advance(efforts)
    return batch


def by_another_account(scene, q, qd, efforts):
    """q, qd (lanes, 2, joints) after an interval with contacts, by the account of the studies."""
    numbers = {name: np.array([value]) for name, value in scene.parameters().items()}
    accounts = (Account(scene, numbers, efforts[[k]]) for k in range(len(q)))
    return np.array([one.motion_after(q[[k]], qd[[k]], {}, 1e-13) for k, one in enumerate(accounts)])


def advanced(scene, q, qd, efforts=None, change=None, intervals=1, **kwargs):
    """A simulator after some intervals, and the status of the last, if any; ``change`` sets parameters
    before. ``kwargs`` are those of ``BatchSimulator``."""
    q, status = np.atleast_2d(q), None
    batch = rde.BatchSimulator(scene, len(q), **kwargs)
    batch.set_parameters(change or {})
    batch.set_state(q, qd)
    for _ in range(intervals):
        status = batch.advance(efforts)
    return batch, status


def tips_after(scene, *start):
    """Tips (lanes, 2) [m] after an interval, and its status."""
    batch, status = advanced(scene, *start)
    return scene.robot.forward_kinematics(batch.q), status


def motion(batch, intervals=5, seed=1):
    """What a simulator tells of some intervals with random efforts: states and status, rows of arrays."""
    _, _, efforts = random_states(batch.scene, batch.num_envs, seed)
    rows = []
    for _ in range(intervals):
        status = batch.advance(efforts)
        rows += [batch.q, batch.qd, *(np.asarray(x, float) for x in status)]
    return rows


def assert_same_bits(some, others):
    """Arrays that are equal to the last bit; NaN equals NaN."""
    for one, other in zip(some, others, strict=True):
        np.testing.assert_array_equal(one, other)
