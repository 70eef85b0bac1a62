"""What cannot act is refused when it is made or attached: one table of effects, hooks and functions of users.

A message is short, names the field or the function and its value, and says what to write instead.
"""

import math
from dataclasses import dataclass

import pytest
from catalogue import FOUR_R, RPRP, StiffeningSpring
from one_force import with_force
from refusals import short

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.envs.core import Core
from redundant_envs.language.algebra import physics
from redundant_envs.language.quantities import givers_of

NAN = math.nan

# ---- functions ----------------------------------------------------------------------------------------


def tanh_of_math(x):
    return math.tanh(x)


def with_default(x, k=2.0):
    return -k * x


@physics
def with_branch(x):
    if x > 0.0:
        x = -x
    return x


def calls_one_with_a_branch(x):
    y = 2.0 * x
    return with_branch(y)


def unmarked(x):
    return -x


def two_values(x):
    return x, x


LINE = f"test_refused_effects.py:{with_branch.__code__.co_firstlineno + 2}"
TANH = "it calls tanh; write 1.0 - 2.0 / (exp(2.0 * x) + 1.0)"
FUNCTIONS = {
    tanh_of_math: ("tanh_of_math (", "effects.py:", "sqrt, exp", "of redundant_envs.algebra", TANH),
    with_default: ("'k'", "bind a number of the effect"),
    with_branch: ("where(condition, a, b)", "instead of if", LINE),
    calls_one_with_a_branch: ("calls_one_with_a_branch (", "where(condition, a, b)", LINE),
    two_values: ("returns 2 values", "Force needs 1"),
}
AT = "effects[0] (Odd), hook 0 (Force)"


@physics(gives="x1 y1")
def points_of_math(l1, theta1):
    return l1 * math.cos(theta1), l1 * math.sin(theta1)


@physics(gives="near_term")
def near_term(distance):
    return max(0.0, 1.0 - distance)


class NearTask(rde.ReachTask):
    def reward_functions(self, scene):
        return (near_term,)


@physics(gives="a")
def first(x):
    return x


@physics(gives="a")
def second(x):
    return -x


# ---- hooks --------------------------------------------------------------------------------------------


spring = physics(lambda x, k: -k * x)
energy = physics(lambda x, k: 0.5 * k * x**2)
damped = physics(lambda x, rate, k: -k * (x + rate))
slope = physics(lambda rate, k: 2.0 * k * abs(rate))


@physics
def at_point(x, k):
    return -k * x, -k * x


@physics
def field_of(x):
    return 0.0 * x, 9.81


def attached(hooks, arm=FOUR_R, **body):
    """A scene with an effect of one number that has some hooks."""
    own = {"__annotations__": {"k": float}, "k": 1.0, "hooks": lambda self, arm: hooks, **body}
    return rde.Scene(arm, (dataclass(frozen=True)(type("Odd", (e.Effect,), own))(),))


X = {"x": "phi2", "k": ".k"}
RATE = {**X, "rate": "phid2"}
HOOKS = {
    "no such joint": (e.Force(4, spring, X), "joint is 4", "0 to 3", "joint1"),
    "a joint by its name": (e.Force("joint2", spring, X), "joint is 'joint2'", "0 to 3"),
    "no such number": (e.Force(1, spring, {"x": "phi2", "k": ".stiffness"}), "'.stiffness'", "it has .k"),
    "no such quantity": (e.Force(1, spring, {"x": "phi9", "k": ".k"}), "'phi9'", "phi1"),
    "an acceleration": (e.Force(1, spring, {"x": "qdd1", "k": ".k"}), "'qdd1'", "follows from the forces"),
    "a number in a bind": (e.Force(1, spring, {"x": 2.0, "k": ".k"}), "2.0", "quotation marks"),
    "a list as bind": (e.Force(1, spring, ["phi2", ".k"]), "bind", "mapping"),
    "no such end": (e.Impact(1, ".lower", ".k", ".k"), "lower", "'.lower'", ".k"),
    "half a potential": (e.Force(1, damped, RATE, potential=energy), "phid2", "conservative="),
    "no potential": (e.Force(1, spring, X, conservative=spring), "no potential", "give the potential"),
    "a potential of rates": (e.Force(1, spring, X, potential=damped), "rate"),
    "two potentials": (e.Force(1, spring, X, potential=field_of), "field_of", "one value"),
    "a stiffness of x": (e.Force(1, spring, X, stiffness=spring), "stiffness", "phi2", "parameters alone"),
    "a motor of two": (e.Actuation(1, field_of, {"x": "command2"}), "returns 2 values", "Actuation needs 1"),
    "a field of one": (e.Field(spring, X), "returns 1 values", "Field needs 2"),
    "a damping of another joint": (
        e.Force(0, damped, {**RATE, "rate": "phid2"}, damping=slope),
        "parameters and the position and rate of its own joint",
    ),
    "a damping of the tip": (
        e.Force(0, damped, {**RATE, "rate": "tip_vx"}, damping=slope),
        "parameters and the position and rate of its own joint",
    ),
    "a damping at a point": (
        e.Force(e.Point(3), at_point, {"x": "vx4", "k": ".k", "rate": "vx4"}, damping=slope),
        "it may depend on parameters alone",
    ),
}
KEYS = ("my spring", "1st", "", "a..b", 3, "a-b")


def named(key, field):
    return type(
        "Odd", (e.Effect,), {"key": key, "parameters": lambda s: {field: 1.0}, "hooks": lambda s, arm: ()}
    )()


# ---- the table ----------------------------------------------------------------------------------------

SCENES = {
    "alike identifiers": (
        FOUR_R, (named("a", "b__c"), named("a.b", "c")), "'a.b__c' and 'a.b.c'", "rename a field",
    ),
    "two classes of one name": (
        FOUR_R, (e.Gravity(), type("Gravity", (StiffeningSpring,), {})()),
        "second 'gravity'; two classes share", "'key' of its own",
    ),
    "two gravities": (
        FOUR_R, (e.Gravity(), e.Gravity(1.62)), "effects[1] is a second 'gravity'; combine the two",
    ),
    "two springs": (
        RPRP, (e.LimitSpring("r1", 0, 1), e.LimitSpring("r1", 0, 2)), "[1] is a second 'limit_spring.r1'",
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
    "inertias of sliders": (
        rde.Chain("PP", (1.0, 0.5), ()), (e.LinkInertia(0.1),),
        "LinkInertia acts on revolute joints, and Chain has none: leave it out",
    ),
    "one of two sliders": (
        RPRP, (e.CentringSpring((1,), (0,), (1,)),), "for 1 prismatic joints and RPRP has 2: give as many",
    ),
}  # fmt: skip
REFUSED = {
    **{f"function {f.__name__}": (lambda f=f: with_force(physics(f)), AT, *w) for f, w in FUNCTIONS.items()},
    "an unmarked function": (lambda: with_force(unmarked), AT, "not marked", "@physics"),
    "a number as function": (lambda: with_force(3.0), AT, "3.0", "def"),
    "cosines in an arm": (
        lambda: type("Swing", (rde.Arm,), {"joint_types": "R", "functions": (points_of_math,)}),
        "Swing.functions", "points_of_math", "it calls cos; take the sine and cosine",
    ),
    "max in a task": (
        lambda: Core("four_r_reach", 1, NearTask()), "near_term ", "it calls max; write maximum(a, b)",
    ),
    "two givers": (lambda: givers_of((first, second)), "'a' is given by both ", "first and ", "second"),
    **{f"hook: {n}": (lambda h=h: attached((h,)), *words) for n, (h, *words) in HOOKS.items()},
    "one hook": (lambda: attached(e.Force(1, spring, X)), "hooks gives", "tuple"),
    **{f"key {key!r}": (lambda key=key: attached((), key=key), "has the key") for key in KEYS},
    **{f"scene: {n}": (lambda a=arm, x=x: rde.Scene(a, x), *w) for n, (arm, x, *w) in SCENES.items()},
    **{
        f"number: {words[0]}": (lambda kind=kind, given=given: kind(*given), *words)
        for kind, given, *words in (
            (e.Gravity, (9.81, (0.0, -1.1)), "Gravity.down is (0.0, -1.1)"),
            (e.Gravity.on_plane, (9.81, NAN), "tilt is nan"),
            (e.Gravity.on_plane, (9.81, 0.0, "x"), "roll is 'x'"),
            (e.LimitSpring, ("r1", 0.3, 0.3), "LimitSpring.lower is 0.3, upper is 0.3; lower must be below"),
            (e.LimitSpring, ("r1", 0.0, 1e-31), "LimitSpring.lower is 0.0", "at least 1e-30 apart"),
            (e.LimitSpring, ("r1", -1e308, 1e308), "LimitSpring.lower is -1e+308", "-1e+30 to 1e+30"),
            (e.CentringSpring, ((1.0, 2.0), (0, 2), (1, 1)), "CentringSpring.lower[1] is 2.0, upper"),
            (e.CentringSpring, ((1.0,), (0, 0), (1, 1)), "CentringSpring.lower has 2 entries; give 1"),
            (e.CentringSpring, ((1.0, 1.0), (0, 0), (1, "b")), "CentringSpring.upper[1] is 'b'"),
            (e.PrismaticStop, ((0, 0), (1, 1e308)), "PrismaticStop.upper[1] is 1e+308", "-1e+30 to 1e+30"),
            (e.PrismaticStop, ((0, 0), (1, 5e-324)), "PrismaticStop.lower[1] is 0.0", "1e-30 apart"),
            (e.PrismaticStop, ((0.3, 0.0), (0.0, 0.3)), "PrismaticStop.lower[0] is 0.3, upper[0] is 0.0"),
            (e.PrismaticStop, ((0.0, 0.0), (0.3, NAN)), "PrismaticStop.upper[1] is nan", "finite"),
            (e.PrismaticStop, ((0.0,), (0.3, 0.3)), "PrismaticStop.lower has 1 entries", "upper 2"),
        )
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
