"""What every function of every hook promises, by rows: it is checked, follows its numbers, and draws nothing.

A number is followed when it is set: what Python computed with it, and what it drew while it was traced, would
stay for ever, and is refused.
"""

import itertools
import os
import random
import time
from dataclasses import dataclass

import numpy as np
import pytest
from catalogue import RPRP
from one_force import with_force
from refusals import short

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects.validate_hooks import function_fields, rule_of
from redundant_envs.envs.core import Core
from redundant_envs.language.algebra import physics, where


def scene_with(hooks, value=1.5, fields=None, **body):
    """A scene with an effect whose hooks a function gives, from the effect and the arm."""
    fields = fields or {"k": float}
    own = type("Own", (e.Effect,), {"hooks": hooks, "__annotations__": fields, **body})
    values = value if isinstance(value, tuple) and len(fields) > 1 else (value,)
    return rde.Scene(RPRP, (dataclass(frozen=True)(own)(*values),))


# ---- every function of every hook --------------------------------------------------------------------

FIXED = {
    e.Force: {"joint": 0}, e.Impulse: {"joint": 0}, e.Actuation: {"joint": 0}, e.Friction: {"joint": 0},
    e.Sensing: {"joint": 0}, e.Gap: {"restitution": ".k"}, e.State: {"name": "z", "unit": ""},
}  # fmt: skip
NEEDS = {
    "kink": ("function",), "guard": ("function",), "potential": ("function",), "stiffness": ("function",),
    "conservative": ("function", "potential"), "damping": ("function",), "by_side": ("function", "guard"),
    "initial": ("update",), "rate": ("derivative",), "lock": ("limit",),
}  # fmt: skip
"""Functions without which a hook or a state cannot have another one."""
KINDS = e.Field, e.Force, e.Impulse, e.Actuation, e.Friction, e.Gap, e.Sensing, e.Instant, e.State
PARTS = [(kind, field) for kind in KINDS for field in function_fields(kind) if field != "closed"]
"""All functions but closed forms, which have rules of their own: ``tests/lane/test_states_of_effects.py``."""
EVERY = pytest.mark.parametrize(("kind", "field"), PARTS, ids=lambda x: getattr(x, "__name__", x))


def law(kind, field, factor=lambda: 1.0):
    """A function that returns as many values as it should, of a number k, times a factor."""
    if kind is e.Gap:
        return physics(lambda tip_x, k: factor() * k * tip_x)
    if rule_of(kind, field).values == 2 and field == "function":
        return physics(lambda k: (factor() * k, 0.0))
    return physics(lambda k: factor() * k)


def hooks_with(kind, field, function):
    """A hook that has a function, and those that it needs beside it."""
    others = {name: law(kind, name) for name in NEEDS.get(field, ())}
    part = kind(**FIXED.get(kind, {}), **others, **{field: function}, bind={"k": ".k"})
    return (e.Force(0, physics(lambda z: -z), {"z": ".z"}, states=(part,)),) if kind is e.State else (part,)


@EVERY
def test_a_function_that_follows_its_number_is_allowed(kind, field):
    scene = scene_with(lambda s, arm: hooks_with(kind, field, law(kind, field)))
    assert scene.parameters()["own.k"] == 1.5


@EVERY
def test_a_function_that_holds_a_number_is_refused(kind, field):
    def hooks(s, arm):
        return hooks_with(kind, field, law(kind, field, lambda: s.k))

    with pytest.raises(ValueError, match=r"effects\[0\] \(Own\) does not follow its number k .*: .*'static'"):
        scene_with(hooks)


DRAWN_ONCE = "draws a random number, or asks for the time, a counter or the like: it is run only once"


@EVERY
def test_a_function_that_cannot_act_is_refused(kind, field):
    for function, words in (
        (lambda k: k, "not marked; write @physics"),
        (physics(lambda k: k if k > 1.0 else -k), r"where\(condition, a, b\)"),
        (physics(lambda k, phi9: k * phi9), "'phi9'"),
        (physics(lambda k, qdd1: k * qdd1), "'qdd1'.* follows from the forces"),
        (physics(lambda k, stiffness=2.0: k), "'stiffness'"),
        (physics(lambda k: (k,) * 99), "returns 99 values"),
        (law(kind, field, random.random), DRAWN_ONCE),
    ):
        with pytest.raises(ValueError, match=words) as error:
            scene_with(lambda s, arm, function=function: hooks_with(kind, field, function))
        assert short(str(error.value))


# ---- numbers that are held elsewhere -----------------------------------------------------------------

damping = physics(lambda rate, k: -k * rate)
no_force = physics(lambda: 0.0)
NUMBERS = {}


def bound(k=".k", joint=0, **more):
    return e.Force(joint, damping, {"rate": f"phid{joint + 1}", "k": k}, **more)


def force_of(function):
    """A force on joint 1 by a function of its rate that is not marked."""
    return (e.Force(0, physics(lambda phid1: function(phid1))),)


def _no(k):
    raise ValueError(f"k is {k}; it is not allowed")


def only(allowed):
    """A check of a class that allows some numbers alone."""
    return {"__post_init__": lambda s: None if allowed(s.k) else _no(s.k)}


HELD = {
    "in a default": (lambda s: force_of(lambda rate, k=s.k: -k * rate), {}),
    "in a global": (lambda s: NUMBERS.update(k=s.k) or force_of(lambda rate: -NUMBERS["k"] * rate), {}),
    "in a branch": (lambda s: force_of(lambda rate: -rate if abs(s.k) > 3.0 else -2.0 * rate), {}),
    "in what is nearly the same": (lambda s: force_of(lambda rate: -float(f"{s.k:.3g}") * rate), {}),
    "in the joint": (lambda s: (bound(joint=0 if s.k > 0.9 else 2),), {}),
    "in whether it is there": (lambda s: (bound(),) if s.k else (), {}),
    "in the order": (lambda s: (bound(), bound(joint=2))[:: 1 if s.k > -3.0 else -1], {}),
    "in the unit of a state": (lambda s: (bound(states=(e.State("z", f"{s.k} m", update=no_force),)),), {}),
    "in the number of states": (
        lambda s: (bound(states=tuple(e.State(f"z[{n}]", "", None, no_force) for n in range(int(s.k)))),), {},
    ),
    "in a link": (
        lambda s: (e.Actuation(0, physics(lambda command1: command1), link=e.Link(int(s.k))), bound()), {},
    ),
    "in the point": (lambda s: (e.PointMass(e.Point(int(s.k)), ".k"),), {}),
    "in inertia": (lambda s: (e.Inertia((0,) if s.k < 4.0 else (2,), ".k"),), {}),
    "in its key": (lambda s: (bound(),), {"key": property(lambda s: f"own{s.k > 1.0}")}),
    "in its units": (lambda s: (bound(),), {"action_units": lambda s, arm: ("k",) * 4 if s.k < 7 else ()}),
    "in an attribute": (
        lambda s: force_of(lambda rate: -s.double * rate),
        {"__post_init__": lambda s: object.__setattr__(s, "double", 2.0 * s.k)},
    ),
    "in a bind": (
        lambda s: (bound(f".k[{int(s.k[0] > 2.0)}]"), bound(".k[1]"), bound(".k[0]")), {"value": (1.0, 2.0)},
    ),
    "where numbers have a sum": (
        lambda s: (*force_of(lambda rate: -s.k[0] * rate), bound(".k[0]"), bound(".k[1]")),
        {**only(lambda k: sum(k) == 1.0), "value": (0.25, 0.75)},
    ),
    "where no other number is allowed": (
        lambda s: force_of(lambda rate: -s.k * rate), {**only(lambda k: k == 2.0), "value": 2.0},
    ),
}  # fmt: skip
"""Hooks of an effect that computes with its number ``k``, by where the number goes; what its class has."""


@pytest.mark.parametrize("what", HELD)
def test_a_number_that_is_not_bound_is_refused(what):
    hooks, body = HELD[what]
    told = r"effects\[0\] \(Own\) does not follow its numbers? .*k.*: .*'static'"
    with pytest.raises(ValueError, match=told):
        scene_with(lambda s, arm: hooks(s), **body)


def test_a_number_that_is_static_may_be_used_in_any_way():
    scene = scene_with(lambda s, arm: HELD["in a default"][0](s), static=("k",))
    assert "own.k" not in scene.parameters()


@pytest.mark.parametrize(
    ("hooks", "words"),
    [
        (
            lambda s, arm: (bound(), *force_of(lambda rate: -s.k * rate)),
            r"effects\[0\] \(Own\) does not follow its number k when it is set: hook 1 \(Force\), function"
            r".* bind=\{'k': '\.k'\}, or name 'k' in 'static'",
        ),
        (lambda s, arm: (bound(),) if s.k else (), r"the number of hooks is 1 at 1\.5 and 0 at 0; "),
        (
            lambda s, arm: force_of(lambda rate: -sum(arm.masses) * rate),
            r"number masses\[0\] of the arm .* the argument m1 of",
        ),
    ],
)
def test_the_message_says_where_and_what_to_write(hooks, words):
    with pytest.raises(ValueError, match=words):
        scene_with(hooks)


@pytest.mark.parametrize(
    "hooks",
    [
        lambda s, arm: (bound(), bound())[: 1 + len(arm.joints) // 4],
        lambda s, arm: (bound(),) if s.k > 0.0 else _no(s.k),  # a check that refuses is none of these
        lambda s, arm: tuple(bound(joint=n) for n in arm.sliders()),
    ],
)
def test_what_only_binds_is_allowed(hooks):
    assert scene_with(hooks).parameters()["own.k"] == 1.5


@pytest.mark.parametrize("numbers", [(-np.inf, 0.5, 0.5), (0.0, 0.5, 1.0)])
def test_an_effect_of_two_stops_may_leave_an_end_out(numbers):
    """Whether an end is infinite says only from where starts are drawn."""
    fields = {"low": float, "high": float, "e": float}
    scene_with(lambda s, arm: (e.Impact(1, ".low", ".high", ".e"),), numbers, fields)


# ---- what is drawn, timed or counted -----------------------------------------------------------------

GENERATOR, COUNTER, SEEN = np.random.default_rng(1), itertools.count(), []
DRAWS = {
    "random": random.random, "one percent": lambda: 1.0 + (random.random() < 0.01),
    "numpy": np.random.randn, "generator": lambda: GENERATOR.normal(),
    "new generator": lambda: np.random.default_rng().random(), "time": time.time,
    "urandom": lambda: os.urandom(4)[0] * 1.0, "counter": lambda: next(COUNTER) * 1.0,
    "list that grows": lambda: SEEN.append(0.0) or float(len(SEEN)),
}  # fmt: skip


@pytest.mark.parametrize("what", DRAWS)
def test_a_draw_in_a_function_is_refused(what):
    draw = DRAWS[what]
    with pytest.raises(ValueError, match=DRAWN_ONCE) as error:
        with_force(physics(lambda x: -x * (1.0 + draw())))
    for words in ("effects[0] (Odd), hook 0 (Force)", "give what you drew as a number", "State"):
        assert words in str(error.value)

    def hooks(s, arm):  # their functions are the same at every call
        held = float(draw())
        return (e.Force(0, physics(lambda phid1, k: -k * held * phid1), {"k": ".k"}),)

    with pytest.raises(ValueError, match=rf"effects\[0\] \(Own\).* {DRAWN_ONCE}"):
        scene_with(hooks)


def test_a_draw_of_an_arm_or_a_task_is_refused():
    @physics(gives="x1 y1")
    def points(l1, s1, c1):
        return l1 * c1 * random.random(), l1 * s1

    with pytest.raises(ValueError, match=rf"Loose.functions: .*points {DRAWN_ONCE}"):
        type("Loose", (rde.Arm,), {"joint_types": "R", "functions": (points,)})

    def functions(self, scene):
        shift = random.random()
        own = physics(gives="noise")(lambda tip_x: tip_x + shift)
        return (*rde.ReachTask.functions(self, scene), own)

    with pytest.raises(ValueError, match=rf"Shifted: the function of noise {DRAWN_ONCE}"):
        Core("four_r_reach", 1, type("Shifted", (rde.ReachTask,), {"functions": functions})())


@pytest.mark.parametrize(
    "constant",
    [lambda: 2.0, lambda: float(np.random.default_rng(7).normal()), lambda: random.Random(3).random()],
    ids=["constant", "seeded generator", "seeded Random"],
)
def test_what_is_the_same_each_time_is_a_constant(constant):
    """A random table that a seed fixes, say."""
    held = [constant() for _ in range(3)]
    with_force(physics(lambda x: -x * (constant() + sum(held))))


def test_a_scene_leaves_the_random_numbers_of_others_alone():
    random.seed(5)
    np.random.seed(5)
    before = random.getstate(), np.random.get_state()[2:]
    with_force(physics(lambda x: where(x > 0.0, -x, 2.0)))
    assert (random.getstate(), np.random.get_state()[2:]) == before
