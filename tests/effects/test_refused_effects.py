"""What cannot act is refused when it is made or attached: one table of effects, hooks and functions of users.

A message is short, names the field or the function and its value, and says what to write instead. What holds
for every number of an effect is in ``test_contract.py``, for every function of a hook in
``test_hook_contract.py``.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, StiffeningSpring
from one_force import with_force
from refusals import short

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects.shapes import shapes_of
from redundant_envs.language.algebra import physics

NAN = math.nan

# ---- functions ----------------------------------------------------------------------------------------


def tanh_of_math(x):
    return math.tanh(x)


@physics
def with_branch(x):
    if x > 0.0:
        x = -x
    return x


def calls_one_with_a_branch(x):
    y = 2.0 * x
    return with_branch(y)


LINE = f"test_refused_effects.py:{with_branch.__code__.co_firstlineno + 2}"
TANH = "it calls tanh; write 1.0 - 2.0 / (exp(2.0 * x) + 1.0)"
AT = "effects[0] (Odd), hook 0 (Force)"


# ---- hooks --------------------------------------------------------------------------------------------

spring = physics(lambda x, k: -k * x)
energy = physics(lambda x, k: 0.5 * k * x**2)
damped = physics(lambda x, rate, k: -k * (x + rate))
slope = physics(lambda rate, k: 2.0 * k * abs(rate))
of_limit = physics(lambda rate: rate)
of_state = physics(lambda z: z)
falling, knock = physics(lambda z: -z), physics(lambda k: k)
told, of_draw = physics(lambda reading: reading), physics(lambda normal1: normal1)


def attached(*hooks, **body):
    """A scene with an effect of one number that has some hooks."""
    own = {"__annotations__": {"k": float}, "k": 1.0, "hooks": lambda self, arm: hooks, **body}
    return rde.Scene(FOUR_R, (dataclass(frozen=True)(type("Odd", (e.Effect,), own))(),))


def state(name="z", **given):
    return e.State(name, "kg", bind={"z": ".z"}, **given)


X = {"x": "phi2", "k": ".k"}
RATE = {**X, "rate": "phid2"}
OWN_JOINT = "parameters and the position and rate of its own joint"
HOOKS = {
    "no such joint": ((e.Force(4, spring, X),), "joint is 4", "0 to 3", "joint1"),
    "no such point": ((e.Impulse(e.Point(4), knock),), "give Point(0) to Point(3), the tip"),
    "no such number": ((e.Force(1, spring, {**X, "k": ".stiffness"}),), "'.stiffness'", "it has .k"),
    "a number in a bind": ((e.Force(1, spring, {"x": 2.0, "k": ".k"}),), "2.0", "quotation marks"),
    "a list as bind": ((e.Force(1, spring, ["phi2", ".k"]),), "bind", "mapping"),
    "no such end": ((e.Impact(1, ".lower", ".k", ".k"),), "lower", "'.lower'", ".k"),
    "half a potential": ((e.Force(1, damped, RATE, potential=energy),), "phid2", "conservative="),
    "a potential of rates": ((e.Force(1, spring, X, potential=damped),), "phid2; it may depend on"),
    "a stiffness of x": ((e.Force(1, spring, X, stiffness=spring),), "stiffness", "phi2", "parameters alone"),
    "one value at a point": (
        (e.Impulse(e.Point(3), knock, {"k": ".k"}),), "returns 1 values; it must return 2 at a point",
    ),
    "a damping of another joint": ((e.Force(0, damped, RATE, damping=slope),), OWN_JOINT),
    "a limit of a rate": ((e.Friction(0, of_limit, {"rate": "phid1"}),), "speed, the size of the rate"),
    "a limit of a state that flows": (
        (e.Force(0, knock, {"k": ".k"}, states=(state(derivative=falling),)), e.Friction(0, of_state)),
        "depends on the state 'z', which changes within an interval", "give the state an update",
    ),
    "the control interval": ((e.Force(0, physics(lambda T: T), {"T": "interval"}),), "called 'interval'"),
    "a mass that moves": (
        (e.PointMass(e.Point(3), ".z", (state(derivative=falling),)),),
        "the mass 'z' changes within intervals; give it an update",
    ),
    "a draw in a force": (
        (e.Force(0, of_draw),), "'normal1' is a draw; take it in update",
    ),
    "a state that begins as itself": (
        (e.Sensing(0, told, {"reading": "phi1"}, states=(state(update=falling, initial=falling),)),),
        "depends on .z; it may depend on parameters, on draws and on the motion",
    ),
    "a sensor that flows": (
        (e.Sensing(0, told, {"reading": "phi1"}, states=(state(derivative=falling),)),),
        "the state 'z' of a sensor has a derivative; give an update",
    ),
    "a unit without another": (
        (e.Actuation(0, physics(lambda command1: command1), takes="", gives="V"),),
        "it has gives without takes",
    ),
    "a number as unit": (
        (e.Actuation(0, physics(lambda command1: command1), takes=3),), "takes is 3; give a unit such as 'V'",
    ),
}  # fmt: skip
KEYS = ("my spring", "1st", "", "a..b", 3, "a-b")


def named(key, field):
    body = {"key": key, "parameters": lambda s: {field: 1.0}, "hooks": lambda s, arm: ()}
    return type("Odd", (e.Effect,), body)()


# ---- effects ------------------------------------------------------------------------------------------

SCENES = {
    "alike identifiers": (
        FOUR_R, (named("a", "b__c"), named("a.b", "c")), "'a.b__c' and 'a.b.c'", "rename one",
    ),
    "two classes of one name": (
        FOUR_R, (e.Gravity(), type("Gravity", (StiffeningSpring,), {})()),
        "second 'gravity'; combine the two, or give", "'key'",
    ),
    "two gravities": (
        FOUR_R, (e.Gravity(), e.Gravity(1.62)), "effects[1] is a second 'gravity'; combine the two",
    ),
    "one effect": (
        RPRP, e.Gravity(), "effects is the effect Gravity(", "give a sequence, effects=(Gravity(",
    ),
    "a word": (RPRP, ("gravity",), "effects[0] is 'gravity'"),
    "no hooks": (
        RPRP, (e.Effect(),), "does not say where it attaches; write a method hooks(self, arm)",
    ),
    "no slider r1": (FOUR_R, (e.LimitSpring("r1", 0.0, 0.3),), "coordinate is 'r1'"),
    "no sliders": (
        FOUR_R, (e.CentringSpring((1, 1), (0, 0), (1, 1)),),
        "CentringSpring acts on prismatic joints, and FourR has none",
    ),
    "four inertias of two links": (
        RPRP, (e.LinkInertia((0.1,) * 4),),
        "LinkInertia.inertias has 4 entries; give one, or 2 for RPRP",
    ),
    "a tendon of r1": (
        FOUR_R, (e.Tendon(("r1", "joint2"), (1.0, 1.0), 1.0),), "Tendon.joints[0] is 'r1'; FourR has joint1",
    ),
    "point 5": (
        RPRP, (e.Tether(5, (0.0, 0.0), 1.0),), "Tether.point is 5; RPRP has the points 1 to 4",
    ),
    "no joint 4": (FOUR_R, (e.MotorLoss(4, 0.1),), "MotorLoss.joint is 4; give 0 to 3 (joint1, joint2,"),
    "one stop of four": (
        FOUR_R, (e.JointStop((0.1,), (0.2,)),), "lower has 1 entries;", "has 4 joints: give an end, or None",
    ),
    "too many kept commands": (
        FOUR_R, (e.CommandDelay(0.1, 20.5),),
        "longest is 20.5 s", "1026 kept commands; at most 1024 are: give a longest below 20.48 s",
    ),
}  # fmt: skip
NUMBERS = [
    (lambda: e.Gravity(9.81, (0.0, -1.1)), "Gravity.down is (0.0, -1.1)"),
    (lambda: e.Gravity.on_plane(9.81, NAN), "tilt is nan"),
    (lambda: e.Gravity.on_plane(9.81, 0.0, "x"), "roll is 'x'"),
    (lambda: e.LimitSpring("r1", 0.3, 0.3), "LimitSpring.lower is 0.3, upper is 0.3; lower must be below"),
    (lambda: e.LimitSpring("r1", 0.0, 1e-31), "LimitSpring.lower is 0.0", "by at least 1e-30"),
    (lambda: e.CentringSpring((1.0, 2.0), (0, 2), (1, 1)), "CentringSpring.lower[1] is 2.0, upper"),
    (lambda: e.PrismaticStop((0, 0), (1, 1e308)), "PrismaticStop.upper[1] is 1e+308", "-1e+30 to 1e+30"),
    (lambda: e.PrismaticStop((0.0, 0.0), (0.3, NAN)), "PrismaticStop.upper[1] is nan", "finite"),
    (lambda: e.PrismaticStop((0.0,), (0.3, 0.3)), "PrismaticStop.lower has 1 entries", "upper 2"),
    (lambda: e.JointStop((0.3,), (0.1,)), "JointStop.lower[0]"),
    (lambda: e.JointStop((None,), (np.inf,)), "have no end of any joint; give one"),
    (lambda: e.JointStop(0.1, 0.2), "lower is 0.1; give a sequence of ends"),
    (lambda: e.Tendon("joint2", (1.0,), 1.0), "Tendon.joints is 'joint2'; give the names of two or more"),
    (lambda: e.Tendon(("r1", "r1"), (1.0, 1.0), 1.0), "each once"),
    (lambda: e.Tendon(("r1", "r2"), (1.0, 1.0, 1.0), 1.0), "Tendon.moment_arms has 3 entries; give 2"),
    (lambda: e.PickUp(1.0, 0.0), "PickUp.at is 0.0; it must be positive"),
    (
        lambda: e.MotorBrake(1, 0.1, grip=1e9),
        "MotorBrake.grip is 1000000000.0 N m or N; it must lie in 0 to 1e+06",
    ),
    (
        lambda: e.LuGre(1e5, 0.0, 0.4, 1.0, 0.5, 0.01),
        "LuGre.stiction is 0.5 and LuGre.coulomb 1.0 at joint 1",
    ),
    (lambda: e.CommandDelay(0.2, 0.1), "seconds is 0.2 s; ", "is 0.1 s: give a shorter"),
    (lambda: e.SensorBias(), "SensorBias has neither position nor rate", "give one of them"),
    (lambda: e.MotorBrake(0.5, 0.0), "MotorBrake.joint is 0.5; give a joint, counted from 0: a whole"),
    (lambda: e.TipForce(), "TipForce has no part; give one or several of step, amplitude, density"),
    (lambda: e.JointTorque(amplitude=1.0), "amplitude is given without frequency; give"),
    (lambda: e.TipForce(density=1.0, phase=1.0), "phase is 1.0 without amplitude; give ampl"),
    (lambda: e.Disc((0.1, 0.0), 0.2), "Disc.radius is 0.2 m: the disc covers the base", "smaller one"),
    (lambda: e.HalfPlane((0.0, 0.1)), "(0.0, 0.1) m with the normal (0.0, 1.0)", "another point"),
    (lambda: e.HalfPlane((0.0, -0.1), (0.0, 0.0)), "HalfPlane.normal is ", "no direction"),
]
LANES = {
    "command_delay.seconds": (0.11, "CommandDelay.seconds is"),
    "disc.radius": ([[0.1], [0.7]], "covers"),
    "joint_torque.time_constant": (-1.0, "JointTorque.time_constant is -1.0; it must lie"),
    "motor_brake.joint": ([1.0, 4.0], "MotorBrake.joint is 4; give 0 to 3"),
    "tendon.stiffness": ([1.0, -2.0], "Tendon.stiffness"),
    "tip_force.step": ((1.0, 2.0), "parameter is 'tip_force.step'; this scene has", "tip_force.den"),
}
"""Numbers that lanes cannot have."""


@functools.cache
def lanes():
    effects = (
        e.CommandDelay(0.0, 0.1), e.Disc((0.5, 0.4), 0.2), e.JointTorque(deviation=1.0, time_constant=0.1),
        e.MotorBrake(0, 0.1), e.Tendon(("joint1", "joint2"), (0.1, 0.1), 1.0), e.TipForce(density=1.0),
    )  # fmt: skip
    return rde.BatchSimulator(rde.Scene(FOUR_R, effects, "euler"), 2)


@dataclass(frozen=True)
class Drawn(e.Effect):
    def shapes(self, pose):
        return ("disc",)


REFUSED = {
    "tanh of math": (lambda: with_force(physics(tanh_of_math)), AT, "tanh_of_math (", "effects.py:", TANH),
    "a branch in a helper": (
        lambda: with_force(physics(calls_one_with_a_branch)), AT, "calls_one_with_a_branch (",
        "where(condition, a, b)", "instead of if", LINE,
    ),
    **{f"hook: {n}": (lambda h=h: attached(*h), *words) for n, (h, *words) in HOOKS.items()},
    "shapes that are none": (
        lambda: shapes_of([(Drawn(), {})], FOUR_R, np.zeros(4), {}), "Drawn.shapes gives 'disc'; give shapes",
        "redundant_envs.effects.shapes.Circle((x, y), radius)",
    ),
    "one hook": (lambda: attached(hooks=lambda s, arm: e.Force(1, spring, X)), "hooks gives", "tuple"),
    **{f"key {key!r}": (lambda key=key: attached(key=key), "has the key") for key in KEYS},
    **{f"scene: {n}": (lambda a=arm, x=x: rde.Scene(a, x), *w) for n, (arm, x, *w) in SCENES.items()},
    **{f"number: {words[0]}": (make, *words) for make, *words in NUMBERS},
    **{
        f"lane: {n}": (lambda n=n, value=value: lanes().set_parameters({n: value}), *words)
        for n, (value, *words) in LANES.items()
    },
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_act_is_refused(what):
    make, *words = REFUSED[what]
    with pytest.raises((ValueError, NotImplementedError)) as error:
        make()
    for word in words:
        assert word in str(error.value)
    assert short(str(error.value))
