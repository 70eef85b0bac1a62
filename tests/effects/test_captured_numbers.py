"""Numbers are followed when they are set: what Python computed with them, and what it drew, is refused."""

import functools
import itertools
import os
import random
import secrets
import time
import uuid
from dataclasses import dataclass

import numpy as np
import pytest
from catalogue import RPRP
from one_force import with_force
from refusals import short

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.envs.core import Core
from redundant_envs.language.algebra import physics, where

damping = physics(lambda rate, k: -k * rate)
no_force = physics(lambda: 0.0)


def bound(k=".k", joint=0, **more):
    return e.Force(joint, damping, {"rate": f"phid{joint + 1}", "k": k}, **more)


def made_of(k):
    """A function that holds a number."""
    return physics(lambda phid1: -k * phid1)


def force_of(function):
    """A force on joint 1 by a function of its rate that is not marked."""
    return (e.Force(0, physics(lambda phid1: function(phid1))),)


def scene_with(hooks, value=1.5, fields=None, **body):
    """A scene with an effect whose hooks a function gives, from the effect and the arm."""
    fields = fields or {"k": float}
    own = type("Own", (e.Effect,), {"hooks": hooks, "__annotations__": fields, **body})
    values = value if isinstance(value, tuple) and len(fields) > 1 else (value,)
    return rde.Scene(RPRP, (dataclass(frozen=True)(own)(*values),))


NUMBERS = {}
decay = physics(lambda z, k: -k * z)
spring = physics(lambda phi, k: -k * phi)
energy = physics(lambda phi, k: 0.5 * k * phi * phi)
PHI = {"phi": "phi1", "k": ".k"}


def with_state(**given):
    """A force with a state."""
    state = e.State(**{"name": "z", "unit": "", "bind": {"k": ".k", "z": ".z"}, "derivative": decay, **given})
    return (e.Force(0, physics(lambda z: -z), {"z": ".z"}, states=(state,)),)


def _no(k):
    raise ValueError(f"k is {k}; it is not allowed")


def only(allowed):
    """A check of a class that allows some numbers alone."""
    return {"__post_init__": lambda s: None if allowed(s.k) else _no(s.k)}


HELD = {
    "in a closure": lambda s: (e.Force(0, made_of(s.k)),),
    "in a nested closure": lambda s: force_of((lambda k: lambda rate: -k * rate)(s.k)),
    "in a default": lambda s: force_of(lambda rate, k=s.k: -k * rate),
    "in a partial": lambda s: force_of(functools.partial(lambda k, rate: -k * rate, s.k)),
    "in a global": lambda s: NUMBERS.update(k=s.k) or force_of(lambda rate: -NUMBERS["k"] * rate),
    "in a method": lambda s: force_of(lambda rate: -s.k * rate),
    "in a branch inside": lambda s: force_of(lambda rate: -rate if s.k > 1.0 else -2.0 * rate),
    "in a branch far away": lambda s: force_of(lambda rate: -rate if abs(s.k) > 3.0 else -2.0 * rate),
    "in what is nearly the same": lambda s: force_of(lambda rate: -float(f"{s.k:.3g}") * rate),
    "in the joint": lambda s: (bound(joint=0 if s.k > 0.9 else 2),),
    "in whether it is there": lambda s: (bound(),) if s.k else (),
    "at one value": lambda s: (bound(), bound(joint=2)) if s.k == 77.25 else (bound(),),
    "in the order": lambda s: (bound(), bound(joint=2))[:: 1 if s.k > -3.0 else -1],
    "in the potential": lambda s: (e.Force(0, spring, PHI, potential=physics(lambda phi: s.k * phi)),),
    "in the conservative part": lambda s: (
        e.Force(0, spring, PHI, potential=energy, conservative=physics(lambda phi: -s.k * phi)),
    ),
    "in the damping": lambda s: (bound(damping=physics(lambda: s.k)),),
    "in the stiffness": lambda s: (e.Force(0, spring, PHI, stiffness=physics(lambda: 2.0 * s.k)),),
    "in the kink": lambda s: (bound(kink=made_of(s.k)),),
    "in a derivative": lambda s: with_state(derivative=physics(lambda z, k: -s.k * k * z)),
    "in an initial value": lambda s: with_state(initial=s.k),
    "in the rate of a state": lambda s: with_state(rate=physics(lambda: s.k)),
    "in the unit of a state": lambda s: with_state(unit=f"{s.k} m"),
    "in an update": lambda s: with_state(derivative=None, update=physics(lambda z, k: s.k * k * z)),
    "in the name of a state": lambda s: (
        bound(states=(e.State(f"z[{int(s.k > 1.0)}]", "", update=no_force),)),
    ),
    "in the number of states": lambda s: (
        bound(states=tuple(e.State(f"z[{n}]", "", update=no_force) for n in range(1 + (s.k > 0.2)))),
    ),
    "in a motor": lambda s: (e.Actuation(0, physics(lambda command1: s.k * command1)),),
    "in its link": lambda s: (
        e.Actuation(0, physics(lambda command1: 2.0 * command1), link=e.Link(int(s.k))),
        bound(),
    ),
    "in a field": lambda s: (e.Field(physics(lambda: (0.0, s.k))),),
    "in a sensor": lambda s: (e.Sensing(0, physics(lambda phi1: phi1 + s.k)),),
    "at a point": lambda s: (e.Force(e.Point(int(s.k)), physics(lambda k: (k, 0.0)), {"k": ".k"}),),
    "in inertia": lambda s: (e.Inertia((0,) if s.k < 4.0 else (2,), ".k"),),
    "in its key": lambda s: (bound(),),
    "in its travel": lambda s: (bound(".k[0]"), bound(".k[1]")),
    "in its units": lambda s: (bound(),),
    "in an attribute": lambda s: (e.Force(0, made_of(s.double)),),
    "in one of some": lambda s: (bound(".k[0]"), bound(".k[1]"), e.Force(0, made_of(s.k[1]))),
    "in a bind": lambda s: (bound(f".k[{int(s.k[0] > 2.0)}]"), bound(".k[1]"), bound(".k[0]")),
    "where numbers have a sum": lambda s: (e.Force(0, made_of(s.k[0])), bound(".k[0]"), bound(".k[1]")),
    "where numbers are whole": lambda s: (e.Force(0, made_of(s.k)),),
    "where numbers are close to one": lambda s: (e.Force(0, made_of(s.k)),),
    "where no other number is allowed": lambda s: (e.Force(0, made_of(s.k)),),
    "of an endless number": lambda s: (e.Force(0, made_of(min(s.k, 1e9))),),
}
"""Hooks of an effect that computes with its number ``k``, by where the number goes."""
MORE = {
    "in its key": {"key": property(lambda s: f"own{s.k > 1.0}")},
    "in its travel": {
        "travel": lambda s, arm: {1: ("k[0]", "k[1]")} if s.k[1] < 0.5 else {}, "value": (0.0, 0.3),
    },
    "in its units": {"action_units": lambda s, arm: ("k",) * 4 if s.k < 7.0 else ()},
    "in an attribute": {"__post_init__": lambda s: object.__setattr__(s, "double", 2.0 * s.k)},
    "in one of some": {"value": (1.0, 2.0)},
    "in a bind": {"value": (1.0, 2.0)},
    "where numbers have a sum": {**only(lambda k: sum(k) == 1.0), "value": (0.25, 0.75)},
    "where numbers are whole": {**only(lambda k: k % 1.0 == 0.0), "value": 3},
    "where numbers are close to one": {**only(lambda k: 0.999 < k < 1.001), "value": 1.0},
    "where no other number is allowed": {**only(lambda k: k == 2.0), "value": 2.0},
    "of an endless number": {"value": np.inf},
}  # fmt: skip
"""What else their classes have, and their numbers, by default 1.5."""


def scene_of(hooks, **body):
    return scene_with(lambda s, arm: hooks(s), **body)


@pytest.mark.parametrize("what", HELD)
def test_a_number_that_is_not_bound_is_refused(what):
    told = r"effects\[0\] \(Own\) does not follow its numbers? .*k.*: .*'static'"
    with pytest.raises(ValueError, match=told):
        scene_of(HELD[what], **MORE.get(what, {}))


@pytest.mark.parametrize(
    "what",
    ["in a nested closure", "in a branch inside", "in a motor", "in a field", "in a sensor", "in a closure"],
)
def test_a_number_that_is_static_may_be_used_in_any_way(what):
    assert "own.k" not in scene_of(HELD[what], static=("k",)).parameters()


@pytest.mark.parametrize(
    ("hooks", "words"),
    [
        (
            lambda s, arm: (bound(), e.Force(0, made_of(s.k))),
            r"effects\[0\] \(Own\) does not follow its number k when it is set: hook 1 \(Force\), function"
            r".* bind=\{'k': '\.k'\}, or name 'k' in 'static'",
        ),
        (lambda s, arm: (bound(),) if s.k else (), r"the number of hooks is 1 at 1\.5 and 0 at 0; "),
        (
            lambda s, arm: (e.Force(0, made_of(sum(arm.masses))),),
            r"number masses\[0\] of the arm .* the argument m1 of",
        ),
        (
            lambda s, arm: (e.Force(0, made_of(arm.lengths[1])),),
            r"number lengths\[1\] of the arm .* the argument l2 of",
        ),
    ],
)
def test_the_message_says_where_and_what_to_write(hooks, words):
    with pytest.raises(ValueError, match=words):
        scene_with(hooks)


@pytest.mark.parametrize(
    "hooks",
    [
        lambda s, arm: (bound(),),
        lambda s, arm: (bound(), bound())[: 1 + len(arm.joints) // 4],
        lambda s, arm: (bound(),) if s.k > 0.0 else _no(s.k),  # a check that refuses is none of these
        lambda s, arm: (bound(),) if s.k < arm.masses[0] else _no(s.k),
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


# ---- what is drawn, timed or counted while a function is traced would stay for ever -----------------------

GENERATOR, OWN, COUNTER = np.random.default_rng(1), random.Random(2), itertools.count()
SEEN = []


def grown():
    SEEN.append(0.0)
    return float(len(SEEN))


DRAWS = {
    "random": random.random, "gauss": lambda: random.gauss(0.0, 1.0), "coin": lambda: random.randint(0, 1),
    "choice": lambda: random.choice([1.0, 2.0]), "one percent": lambda: 1.0 + (random.random() < 0.01),
    "one percent of numpy": lambda: 1.0 + (np.random.rand() < 0.01), "numpy": np.random.randn,
    "normal": lambda: np.random.normal(0.0, 0.1), "uniform": lambda: float(np.random.uniform(0.0, 1.0)),
    "generator": lambda: GENERATOR.normal(), "own generator": OWN.random,
    "new generator": lambda: np.random.default_rng().random(),
    "time": time.time, "clock": time.perf_counter, "nanoseconds": lambda: time.time_ns() * 1e-9,
    "uuid": lambda: uuid.uuid4().int * 1e-38, "urandom": lambda: os.urandom(4)[0] * 1.0,
    "secrets": lambda: secrets.randbelow(1000) * 1.0, "counter": lambda: next(COUNTER) * 1.0,
    "list that grows": grown,
}  # fmt: skip
DRAWN_ONCE = "draws a random number, or asks for the time, a counter or the like: it is run only once"


@pytest.mark.parametrize("what", DRAWS)
def test_a_draw_in_a_function_is_refused(what):
    draw = DRAWS[what]
    with pytest.raises(ValueError, match=DRAWN_ONCE) as error:
        with_force(physics(lambda x: -x * (1.0 + draw())))
    for words in ("effects[0] (Odd), hook 0 (Force)", "give what you drew as a number", "State"):
        assert words in str(error.value)
    assert short(str(error.value))

    def hooks():  # their functions are the same at every call
        held = float(draw())
        return (e.Force(0, physics(lambda phid1, k: -k * held * phid1), {"k": ".k"}),)

    if not what.startswith("one percent of"):
        with pytest.raises(ValueError, match=rf"effects\[0\] \(Own\).* {DRAWN_ONCE}"):
            scene_of(lambda s: hooks())


def test_a_draw_of_an_arm_or_a_task_is_refused():
    @physics(gives="x1 y1")
    def points(l1, s1, c1):
        return l1 * c1 * random.random(), l1 * s1

    with pytest.raises(ValueError, match=rf"Loose.functions: .*points {DRAWN_ONCE}"):
        type("Loose", (rde.Arm,), {"joint_types": "R", "functions": (points,)})

    noise = physics(gives="noise")(lambda: GENERATOR.normal())
    held = type("Held", (rde.ReachTask,), {"functions": lambda self, scene: (*full(self, scene), noise)})
    full = rde.ReachTask.functions
    with pytest.raises(ValueError, match=DRAWN_ONCE):
        Core("four_r_reach", 1, held())

    def functions(self, scene):
        shift = random.random()
        return (*full(self, scene), physics(gives="noise")(lambda tip_x: tip_x + shift))

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
