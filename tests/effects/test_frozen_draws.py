"""What is drawn, timed or counted while a function is traced would stay for ever: it is refused."""

import itertools
import os
import random
import secrets
import time
import uuid
from dataclasses import dataclass

import numpy as np
import pytest
from notebooks import ARM, with_force
from refusals import refusal, short

import redundant_envs as rde
from redundant_envs.algebra import physics, where
from redundant_envs.effects import Actuation, Effect, Force, Sensing, State
from redundant_envs.envs.core import Core

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


def effect_with(hooks):
    """An effect of one number with hooks that a function gives."""
    body = {"__annotations__": {"k": float}, "k": 1.0, "hooks": lambda self, arm: hooks()}
    return dataclass(frozen=True)(type("Drawn", (Effect,), body))()


@pytest.mark.parametrize("what", DRAWS)
def test_a_draw_in_a_function_is_refused(what):
    draw = DRAWS[what]
    with pytest.raises(ValueError, match=DRAWN_ONCE) as error:
        with_force(physics(lambda x: -x * (1.0 + draw())))
    for words in ("effects[0] (Odd), hook 0 (Force)", "give what you drew as a number", "State"):
        assert words in str(error.value)
    assert short(str(error.value))


@pytest.mark.parametrize("what", [w for w in DRAWS if not w.startswith("one percent of")])
def test_a_draw_where_hooks_are_made_is_refused(what):
    """The function itself then is the same at every call."""
    draw = DRAWS[what]

    def hooks():
        held = float(draw())
        return (Force(0, physics(lambda phid1, k: -k * held * phid1), {"k": ".k"}),)

    with pytest.raises(ValueError, match=rf"effects\[0\] \(Drawn\).* {DRAWN_ONCE}"):
        rde.Scene(ARM, (effect_with(hooks),))


NOISE = physics(lambda phid1: random.random() * phid1)
NONE = physics(lambda phid1: -phid1)
NUMBER = physics(lambda: random.random())
OF_STATE = {"bind": {"phid1": "phid1"}, "unit": ""}


@pytest.mark.parametrize(
    "hook",
    [
        Force(0, NOISE), Force(0, NONE, damping=NUMBER), Force(0, NONE, stiffness=NUMBER),
        Force(0, NONE, kink=NOISE), Force(0, NONE, states=(State("z", derivative=NOISE, **OF_STATE),)),
        Force(0, physics(lambda phi1: -phi1), potential=physics(lambda phi1: random.random() * phi1)),
        Force(0, NONE, states=(State("z", update=NOISE, **OF_STATE),)),
        Actuation(0, physics(lambda command1: command1 + random.random())),
        Sensing(0, physics(lambda phi1: phi1 + np.random.randn())),
    ],
)  # fmt: skip
def test_a_draw_in_any_function_of_a_hook_is_refused(hook):
    with pytest.raises(ValueError, match=DRAWN_ONCE):
        rde.Scene(ARM, (effect_with(lambda: (hook,)),))


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


def function_of(way, draw):
    return physics(lambda x: way(x, draw) - x)


def test_a_seeded_search_refuses_all_draws_wherever_they_are():
    """In one function of several, in helpers, in branches of plain numbers, in parts that nearly cancel."""
    choose = np.random.default_rng(4)
    names = [name for name in DRAWS if name not in ("coin", "choice")]
    ways = (
        lambda x, draw: x * draw(), lambda x, draw: where(x > draw(), x, 1.0),
        lambda x, draw: sum(x + 1e-12 * draw() for _ in range(2)),
        lambda x, draw: x if draw() > 1e300 else x + draw(),
    )  # fmt: skip
    for _ in range(100):
        draw = DRAWS[names[choose.integers(len(names))]] if choose.integers(2) else None
        way, place = ways[choose.integers(4)], int(choose.integers(3))
        functions = [physics(lambda x: -x), physics(lambda x: 2.0 * x), physics(lambda x: x * x)]
        functions[place] = function_of((lambda x, draw: 1.5 * x) if draw is None else way, draw)
        hooks = tuple(Force(k, f, {"x": f"phi{k + 1}"}) for k, f in enumerate(functions))
        message = refusal(lambda hooks=hooks: rde.Scene(ARM, (effect_with(lambda: hooks),)))
        assert (message is not None) == (draw is not None), (way, place)
        assert message is None or DRAWN_ONCE in message
