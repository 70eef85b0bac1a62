"""Numbers are followed when they are set: what Python computed with them, and what it drew, is refused."""

import functools
from dataclasses import dataclass

import numpy as np
import pytest
from refusals import refusal, short
from sample_effects import EVERY, all_effects

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.algebra import physics
from redundant_envs.effects import (
    Actuation,
    Effect,
    Field,
    Force,
    Impact,
    Inertia,
    Link,
    Point,
    Sensing,
    State,
)
from redundant_envs.effects.captured import check_effect
from redundant_envs.tasks.checks import _check_captured

ARM = rde.RPRP((2.3, 0.7, 1.9, 0.4), (1.1, 0.6))


@physics
def damping(rate, k):
    return -k * rate


@physics
def no_force():
    return 0.0


def bound(k=".k", joint=0, **more):
    return Force(joint, damping, {"rate": f"phid{joint + 1}", "k": k}, **more)


def made_of(k):
    """A function that holds a number."""
    return physics(lambda phid1: -k * phid1)


def scene_with(hooks, value=1.5, fields=None, **body):
    """A scene with an effect whose hooks a function gives, from the effect and the arm."""
    fields = fields or {"k": float}
    body["__annotations__"] = fields
    own = type("Own", (Effect,), {"hooks": hooks, **body})
    values = value if isinstance(value, tuple) and len(fields) > 1 else (value,)
    return rde.Scene(ARM, (dataclass(frozen=True)(own)(*values),))


def nested(self, arm):
    k = self.k

    def outer():
        def inner(rate):
            return -k * rate

        return inner

    inner = outer()
    return (Force(0, physics(lambda phid1: inner(phid1))),)


def by_default(self, arm):
    def helper(rate, k=self.k):
        return -k * rate

    return (Force(0, physics(lambda phid1: helper(phid1))),)


def by_partial(self, arm):
    helper = functools.partial(lambda k, rate: -k * rate, self.k)
    return (Force(0, physics(lambda phid1: helper(phid1))),)


HELD = {}


def by_global(self, arm):
    HELD["k"] = self.k
    return (Force(0, physics(lambda phid1: -HELD["k"] * phid1)),)


def by_method(self, arm):
    return (Force(0, physics(lambda phid1: -self.k * phid1)),)


def by_branch_inside(self, arm):
    return (Force(0, physics(lambda phid1: -phid1 if self.k > 1.0 else -2.0 * phid1)),)


def by_branch_on_more(self, arm):
    return (Force(0, physics(lambda phid1: -phid1 if abs(self.k) * 2.0 + 1.0 > 7.0 else -2.0 * phid1)),)


def one_of_two_joints(self, arm):
    return (bound(joint=0 if self.k > 0.9 else 2),)


def present(self, arm):
    return (bound(),) if self.k else ()


def present_at_one_value(self, arm):
    return (bound(), bound(joint=2)) if self.k == 77.25 else (bound(),)


def ordered(self, arm):
    hooks = bound(), bound(joint=2)
    return hooks if self.k > -3.0 else hooks[::-1]


def in_the_potential(self, arm):
    k, bind = self.k, {"rate": "phi1", "k": ".k"}
    return (Force(0, damping, bind, potential=physics(lambda phi1: 0.5 * k * phi1 * phi1)),)


def in_the_damping(self, arm):
    k = self.k
    return (bound(damping=physics(lambda: k)),)


def in_the_stiffness(self, arm):
    k = self.k
    return (Force(0, damping, {"rate": "phi1", "k": ".k"}, stiffness=physics(lambda: 2.0 * k)),)


def in_the_kink(self, arm):
    k = self.k
    return (bound(kink=physics(lambda phid1: phid1 - k)),)


def in_the_conservative_part(self, arm):
    k, bind = self.k, {"phi": "phi1", "k": ".k"}
    energy = physics(lambda phi, k: 0.5 * k * phi * phi)
    part = physics(lambda phi: -k * phi)
    return (Force(0, physics(lambda phi, k: -k * phi), bind, potential=energy, conservative=part),)


def in_a_state(**more):
    def hooks(self, arm):
        k = self.k
        own = {name: what(k) for name, what in more.items()}
        given = {"unit": "", "derivative": physics(lambda z, k: -k * z), **own}
        state = State("z", bind={"k": ".k", "z": ".z"}, **given)
        return (Force(0, physics(lambda z: -z), {"z": ".z"}, states=(state,)),)

    return hooks


def in_an_update(self, arm):
    k = self.k
    state = State("z", "", update=physics(lambda phid1: k * phid1))
    return (Force(0, physics(lambda z: -z), {"z": ".z"}, states=(state,)),)


def two_states(self, arm):
    states = tuple(State(f"z[{n}]", "", update=no_force) for n in range(1 + (self.k > 0.2)))
    return (bound(states=states),)


def in_a_motor(self, arm):
    k = self.k
    return (Actuation(0, physics(lambda command1: k * command1)),)


def in_its_link(self, arm):
    return (Actuation(0, physics(lambda command1, k: k * command1), {"k": ".k"}, Link(int(self.k))),)


def in_a_field(self, arm):
    k = self.k
    return (Field(physics(lambda: (0.0, k))),)


def in_a_sensor(self, arm):
    k = self.k
    return (Sensing(0, physics(lambda phi1: phi1 + k)),)


def at_a_point(self, arm):
    return (Force(Point(int(self.k)), physics(lambda k: (k, 0.0)), {"k": ".k"}),)


def in_inertia(self, arm):
    return (Inertia((0,) if self.k < 4.0 else (2,), ".k"),)


CAPTURED = {
    f.__name__: (f, {})
    for f in (
        nested, by_default, by_partial, by_global, by_method, by_branch_inside, by_branch_on_more,
        one_of_two_joints, present, present_at_one_value, ordered, in_the_potential, in_the_damping,
        in_the_stiffness, in_the_kink, in_the_conservative_part, in_an_update, two_states, in_a_motor,
        in_its_link, in_a_field, in_a_sensor, at_a_point, in_inertia,
    )
} | {
    "in a closure": (lambda self, arm: (Force(0, made_of(self.k)),), {}),
    "in a derivative": (in_a_state(derivative=lambda held: physics(lambda z, k: -held * k * z)), {}),
    "in an initial value": (in_a_state(initial=lambda k: k), {}),
    "in the rate of a state": (in_a_state(rate=lambda k: physics(lambda: k)), {}),
    "in the unit of a state": (in_a_state(unit=lambda k: f"{k} m"), {}),
    "in the name of a state": (
        lambda self, arm: (bound(states=(State(f"z[{int(self.k > 1.0)}]", "", update=no_force),)),), {},
    ),
    "in its key": (lambda self, arm: (bound(),), {"key": property(lambda self: f"own{self.k > 1.0}")}),
    "in its travel": (
        lambda self, arm: (bound(".k[0]"), bound(".k[1]")),
        {"travel": lambda self, arm: {1: ("k[0]", "k[1]")} if self.k[1] < 0.5 else {}, "value": (0.0, 0.3)},
    ),
    "in its units": (
        lambda self, arm: (bound(),),
        {"action_units": lambda self, arm: ("k",) * 4 if self.k < 7.0 else ()},
    ),
    "in an attribute": (
        lambda self, arm: (Force(0, made_of(self.double)),),
        {"__post_init__": lambda self: object.__setattr__(self, "double", 2.0 * self.k)},
    ),
    "in one of some": (
        lambda self, arm: (bound(".k[0]"), bound(".k[1]"), Force(0, made_of(self.k[1]))),
        {"value": (1.0, 2.0)},
    ),
    "where numbers are whole": (
        lambda self, arm: (Force(0, made_of(self.k)),),
        {"__post_init__": lambda self: None if self.k % 1.0 == 0.0 else _no(self), "value": 3},
    ),
    "where numbers are close to one": (
        lambda self, arm: (Force(0, made_of(self.k)),),
        {"__post_init__": lambda self: None if 0.999 < self.k < 1.001 else _no(self), "value": 1.0},
    ),
    "where numbers have a sum": (
        lambda self, arm: (Force(0, made_of(self.k[0])), bound(".k[0]"), bound(".k[1]")),
        {"__post_init__": lambda self: None if sum(self.k) == 1.0 else _no(self), "value": (0.25, 0.75)},
    ),
    "where no other number is allowed": (
        lambda self, arm: (Force(0, made_of(self.k)),),
        {"__post_init__": lambda self: None if self.k == 2.0 else _no(self), "value": 2.0},
    ),
    "of an endless number": (lambda self, arm: (Force(0, made_of(min(self.k, 1e9))),), {"value": np.inf}),
    "in a bind": (
        lambda self, arm: (bound(f".k[{int(self.k[0] > 2.0)}]"), bound(".k[1]"), bound(".k[0]")),
        {"value": (1.0, 2.0)},
    ),
}  # fmt: skip


def _no(self):
    raise ValueError(f"k is {self.k}; it is not allowed")


@pytest.mark.parametrize("what", CAPTURED)
def test_a_number_that_is_not_bound_is_refused(what):
    hooks, body = CAPTURED[what]
    value = body.get("value", 1.5)
    rest = {name: v for name, v in body.items() if name != "value"}
    with pytest.raises(
        ValueError, match=r"effects\[0\] \(Own\) does not follow its numbers? .*k.*: .*'static'"
    ):
        scene_with(hooks, value, **rest)


@pytest.mark.parametrize(
    "what", ["nested", "by_branch_inside", "in_a_motor", "in_a_field", "in_a_sensor", "in a closure"]
)
def test_a_number_that_is_static_may_be_used_in_any_way(what):
    hooks, _ = CAPTURED[what]
    assert "own.k" not in scene_with(hooks, static=("k",)).parameters()


def test_the_message_says_where_and_what_to_write():
    with pytest.raises(ValueError) as error:
        scene_with(lambda self, arm: (bound(), Force(0, made_of(self.k))))
    assert "effects[0] (Own) does not follow its number k when it is set: hook 1 (Force), function" in str(
        error.value
    )
    assert "bind={'k': '.k'}, or name 'k' in 'static'" in str(error.value)
    with pytest.raises(ValueError, match=r"the number of hooks is 1 at 1\.5 and 0 at 0; "):
        scene_with(present)


def test_numbers_of_the_arm_are_followed_too():
    for hooks, name, argument in (
        (lambda self, arm: (Force(0, made_of(sum(arm.masses))),), r"masses\[0\]", "m1"),
        (lambda self, arm: (Force(0, made_of(arm.lengths[1])),), r"lengths\[1\]", "l2"),
        (lambda self, arm: (bound(),) if arm.masses[3] < 0.5 else (), r"masses\[3\]", "m4"),
    ):
        with pytest.raises(ValueError, match=rf"number {name} of the arm .* the argument {argument} of"):
            scene_with(hooks)


@pytest.mark.parametrize(
    "hooks",
    [
        lambda self, arm: (bound(),),
        lambda self, arm: (bound(), bound())[: 1 + len(arm.joints) // 4],
        lambda self, arm: (bound(),) if self.k > 0.0 else _no(self),  # a check that refuses is none of these
        lambda self, arm: (bound(),) if self.k < arm.masses[0] else _no(self),
        lambda self, arm: tuple(bound(joint=n) for n in arm.sliders()),
    ],
)  # fmt: skip
def test_what_only_binds_is_allowed(hooks):
    scene = scene_with(hooks)
    assert scene.parameters()["own.k"] == 1.5


def test_bound_numbers_are_what_set_parameters_changes():
    """The fix that the message names, to the bit."""
    batch = rde.BatchSimulator(scene_with(lambda self, arm: (bound(),)), 2)
    batch.set_parameters({"own.k": [[1.5], [4.0]]})
    other = rde.BatchSimulator(scene_with(lambda self, arm: (bound(),), 4.0), 1)
    for b in (batch, other):
        b.set_state(np.tile((0.3, 0.1, 0.2, 0.1), (b.num_envs, 1)), np.ones((b.num_envs, 4)))
        b.advance()
    np.testing.assert_array_equal(batch.q[1], other.q[0])
    assert not (batch.q[0] == batch.q[1]).all()


def test_an_effect_of_two_stops_may_leave_an_end_out():
    """Whether an end is infinite says only from where starts are drawn."""

    def hooks(self, arm):
        return (Impact(1, ".low", ".high", ".e"),)

    scene_with(hooks, (-np.inf, 0.5, 0.5), {"low": float, "high": float, "e": float})
    scene_with(hooks, (0.0, 0.5, 1.0), {"low": float, "high": float, "e": float})


# ---- a search ------------------------------------------------------------------------------------------

HOLDING = (
    lambda v: v, lambda v: 2.0 * v + 1.0, lambda v: v * v - v, lambda v: 1.0 / (1.0 + abs(v)),
    lambda v: max(v, -5.0), lambda v: float(v > 2.25), lambda v: float(f"{v:.3g}"), lambda v: np.tanh(v),
    lambda v: 1.0 if 0.0 < v < 4.0 else 0.5, lambda v: 3.0 if v == -8.5 else 0.0, lambda v: sum([v, 1.0]),
    lambda v: float(np.array([v]) @ np.array([2.0])), lambda v: float(bool(v)), lambda v: abs(v - 1.0),
)  # fmt: skip
"""What may be done with a number before it is held: smooth, by steps, at one value only."""
CHECKS = (None, lambda v: v > 0.0, lambda v: 0.0 <= v <= 10.0, lambda v: v != 3.0, lambda v: v % 0.25 == 0.0)


def drawn_effect(draw):
    """An effect of some numbers, of which one may be held in a hook or in whether there is one, and whether
    that makes a difference at any value that is allowed."""
    count, one = int(draw.integers(1, 4)), bool(draw.integers(2))
    values = tuple(float(draw.integers(1, 20)) / 4.0 for _ in range(count))
    check = CHECKS[draw.integers(len(CHECKS))]
    if check is not None and not all(map(check, values)):
        check = None
    held = int(draw.integers(count)) if draw.integers(2) else None
    how, where = HOLDING[draw.integers(len(HOLDING))], int(draw.integers(5))

    def own(self, n):
        return getattr(self, f"k{n}") if one else self.k[n]

    def hooks(self, arm):
        made = [bound(f".k{n}" if one else f".k[{n}]", n % 4) for n in range(count)]
        if held is not None:
            number = how(own(self, held))
            state = State("z", "", update=physics(lambda phid1: number * phid1))
            made += [
                [Force(0, made_of(number))],
                [bound(made[0].bind["k"], damping=physics(lambda: number))],
                [bound(made[0].bind["k"], states=(state,))],
                [Actuation(1, physics(lambda command2: command2 * number), link=Link.LAG)],
                made[:1] * int(10.0 * abs(number)),
            ][where]
        return tuple(made)

    body = {"hooks": hooks}
    if check is not None:

        def checked(self):
            if not all(check(own(self, n)) for n in range(count)):
                raise ValueError("a number is not allowed")

        body["__post_init__"] = checked
    names = {f"k{n}": float for n in range(count)} if one else {"k": tuple}
    body["__annotations__"] = names
    kind = dataclass(frozen=True)(type("Drawn", (Effect,), body))
    matters = False
    if held is not None:
        used = (lambda v: int(10.0 * abs(how(v)))) if where == 4 else how
        others = [v for v in np.arange(-20.0, 20.01, 0.25).tolist() if check is None or check(v)]
        matters = any(used(v) != used(values[held]) for v in others)
    return kind(*values) if one else kind(values), matters


def test_a_seeded_search_refuses_all_numbers_that_are_held_and_no_others():
    draw = np.random.default_rng(3)
    refused = 0
    for case in range(150):
        effect, matters = drawn_effect(draw)
        message = refusal(lambda effect=effect: rde.Scene(ARM, (effect,)))
        if not matters:
            assert message is None, (case, message)
        else:
            assert message is not None, (case, effect)
            assert "does not follow its number" in message, (case, message)
            assert short(message)
            refused += 1
    assert 50 < refused < 100


# ---- the package's own --------------------------------------------------------------------------------


@EVERY
def test_effects_of_the_package_follow_their_numbers(robot):
    stops = [e.PrismaticStop((0.0, None), (0.3, 0.2), 0.5)] if robot.sliders() else []
    for effect in (*all_effects(robot), *stops):
        check_effect("here", effect.fitted(robot), robot)


@pytest.mark.parametrize("name", ["rprp_reach", "four_r_reach"])
@pytest.mark.parametrize("task", [rde.ReachTask(), rde.GoalReachTask()], ids=["reach", "goal reach"])
def test_tasks_of_the_package_follow_their_numbers(name, task):
    _check_captured(task, rde.load_scene(name))
