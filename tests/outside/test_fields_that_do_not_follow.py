"""Fields of effects and tasks that would not be what the user set: each is refused, or followed."""

import math
import warnings
from dataclasses import dataclass, field

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects import Effect, Force
from redundant_envs.effects.captured import check_effect
from redundant_envs.model.parameters import _check_task
from redundant_envs.tasks.checks import check_task

ARM = rde.RPRP((0.5,) * 4, (0.5, 0.5))
SCENE = rde.load_scene("rprp_reach")


@physics
def drag(rate, a, b):
    return -a * rate - b * rate * abs(rate)


@physics(gives="height_term")
def height_term(tip_y, weight):
    """weight times tip y"""
    return weight * tip_y


def bound(self, arm):
    return (Force(0, drag, {"rate": "phid1", "a": ".a", "b": ".b"}),)


@dataclass(frozen=True)
class Shares(Effect):
    """Numbers that its class scales to a sum of one."""

    a: float = 1.0
    b: float = 3.0

    hooks = bound

    def __post_init__(self):
        a, b = self.a, self.b
        object.__setattr__(self, "a", a / (a + b))
        object.__setattr__(self, "b", b / (a + b))


@dataclass(frozen=True)
class Derived(Effect):
    a: float = 1.0
    b: float | None = None

    hooks = bound

    def __post_init__(self):
        object.__setattr__(self, "b", 0.1 * self.a)


@dataclass(frozen=True)
class Tabled(Effect):
    """An effect with a static field that is no argument, and one that is a number of NumPy."""

    a: float = 1.0
    b: float = 2.0
    table: tuple = field(init=False, default=())
    static = ("table",)

    hooks = bound

    def __post_init__(self):
        object.__setattr__(self, "table", tuple(math.sin(k) for k in range(4)))


def batch_of(*effects):
    return rde.BatchSimulator(rde.Scene(ARM, effects), 2)


def test_numbers_that_their_class_changes_are_refused_where_they_are_set():
    batch = batch_of(Shares())
    batch.set_parameters({"shares.a": 0.4, "shares.b": 0.6})
    with pytest.raises(ValueError, match=r"shares\.a is 4\.0.* Shares makes 0\.4 of it; give numbers that"):
        batch.set_parameters({"shares.a": [[0.4], [4.0]], "shares.b": [[0.6], [6.0]]})
    batch = batch_of(Derived())
    with pytest.raises(ValueError, match=r"derived\.b is 0\.1.* Derived makes 0\.2 of it"):
        batch.set_parameters({"derived.a": 2.0})
    batch.set_parameters({"derived.a": 2.0, "derived.b": 0.2})


def test_numbers_that_differ_in_the_last_bits_are_those_that_were_set():
    third = Shares(1.0, 2.0)  # their sum is 1 but for rounding
    batch = batch_of(third)
    batch.set_parameters({"shares.a": third.a * (1 + 1e-15)})


def test_static_fields_that_are_no_arguments_leave_the_others_to_be_set():
    batch = batch_of(Tabled())
    batch.set_parameters({"tabled.a": [[1.0], [2.0]]})
    batch.set_state(np.tile((0.3, 0.1, 0.2, 0.1), (2, 1)), np.ones((2, 4)))
    batch.advance()
    assert batch.qd[1, 0] < batch.qd[0, 0]


def test_numbers_that_the_class_of_a_task_changes_are_refused():
    @dataclass(frozen=True)
    class Halved(rde.ReachTask):
        def __post_init__(self):
            super().__post_init__()
            object.__setattr__(self, "rate_scale", min(self.rate_scale, 5.0))

    numbers = {name: np.array([value]) for name, value in Halved().parameters().items()}
    _check_task(Halved(), numbers)
    with pytest.raises(ValueError, match=r"^rate_scale is 8\.0, and Halved makes 5\.0 of it"):
        _check_task(Halved(), {**numbers, "rate_scale": np.array([8.0])})


@pytest.mark.parametrize("above", [lambda a, b: a / b > 100.0, lambda a, b: a / b < 0.02])
def test_a_branch_by_a_ratio_of_numbers_is_refused(above):
    @dataclass(frozen=True)
    class Branched(Effect):
        a: float = 1.1
        b: float = 0.3

        def hooks(self, arm):
            return bound(self, arm) * (2 if above(self.a, self.b) else 1)

    with pytest.raises(ValueError, match=r"does not follow its number a"):
        rde.Scene(ARM, (Branched(),))


def test_a_class_without_its_decorator_is_refused_with_what_to_write():
    class Bare(Effect):
        a: float = 1.0
        b: float = 2.0
        hooks = bound

    with pytest.raises(ValueError, match=r"Bare has a, b .* @dataclass\(frozen=True\) above"):
        rde.Scene(ARM, (Bare(),))

    class Raise(rde.Task):
        weight: float = 1.0
        name: str = "Raise"

        def reward_functions(self, scene):
            return (height_term,)

        def observation(self, scene):
            return scene.robot.posture

    with pytest.raises(ValueError, match=r"Raise has weight .* @dataclass\(frozen=True\) above"):
        check_task(Raise(), SCENE)


def test_a_default_without_its_type_is_refused_as_python_ignores_it():
    @dataclass(frozen=True)
    class Loose(rde.ReachTask):
        hold_speed = 1.0

    with pytest.raises(ValueError, match=r"hold_speed = 1\.0.* write hold_speed: float = 1\.0"):
        check_task(Loose(), SCENE)

    @dataclass(frozen=True)
    class Strict(rde.ReachTask):
        hold_speed: float = 1.0

    check_task(Strict(), SCENE)

    class Renamed(Strict):  # adds no numbers
        name = "Renamed"

    check_task(Renamed(), SCENE)

    @dataclass(frozen=True)
    class More(Shares):
        a = 7.0

    with pytest.raises(ValueError, match=r"write a: float = 7\.0"):
        rde.Scene(ARM, (More(),))


def test_warnings_of_a_class_about_numbers_that_nobody_gave_are_not_shown():
    @dataclass(frozen=True)
    class Careful(Effect):
        a: float = 1.0
        b: float = 2.0
        hooks = bound

        def __post_init__(self):
            if self.a > 10.0:
                warnings.warn("a is large", stacklevel=2)

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rde.Scene(ARM, (Careful(),))
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        check_effect("it", Careful(), ARM)
    assert not seen


def test_a_slider_at_the_base_is_drawn():
    scene = rde.Scene(rde.Chain("P", (1.0,)))
    still = rde.simulate(scene, [0.0], [0.0], [0.0, 0.1])
    assert rde.animate(still).frame(0).shape == (480, 480, 3)
