"""What users add and what cannot be right is refused when it is made, with a message that names it."""

import copy
import dataclasses
import functools
import math
import warnings
from dataclasses import dataclass, field

import gymnasium as gym
import numpy as np
import pytest
import rrp
import three_r
from bumper import Bumper
from three_r_by_hand import ThreeRByHand, points

import redundant_envs as rde
import redundant_envs.robots
from redundant_envs.algebra import physics
from redundant_envs.backends.torch import torch
from redundant_envs.effects import Effect, Field, Force, Gap, Inertia, LimitSpring, Point, Sensing, State
from redundant_envs.effects.captured import check_effect
from redundant_envs.envs.core import Core
from redundant_envs.envs.registration import IDS
from redundant_envs.model.parameters import _check_task
from redundant_envs.robots.arm import Arm
from redundant_envs.tasks.checks import check_task

e = rde.effects
FOUR_R, RPRP = rde.FourR((1.0,) * 4, (0.5,) * 4), rde.RPRP((0.5,) * 4, (0.5, 0.5))
REACH = rde.load_scene("rprp_reach")


def refused(said, function, *arguments, error=ValueError):
    with pytest.raises(error, match=said):
        function(*arguments)


# ---- arms ----------------------------------------------------------------------------------------------


def own_of(kind):
    """What a class of an arm itself says, and its functions."""
    own = {n: v for n, v in vars(kind).items() if n in Arm.__annotations__ and n not in kind._derived}
    functions = tuple(f for f in own["functions"] if f.__module__ == kind.__module__)
    return {n: v for n, v in own.items() if n != "kind"} | {"functions": functions}


OWN = own_of(ThreeRByHand)
FIRST = OWN["functions"]


def arm_of(own=OWN, **change):
    body = {n: v for n, v in {**own, **change}.items() if v is not None}
    return dataclass(frozen=True)(type("Odd", (Arm,), body))


@physics(gives="here here")
def twice(theta1):
    return theta1, 2.0 * theta1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"rates": ("t1", "w2", "w3")}, "calls a coordinate or a rate 't1'"),
        ({"rates": ("h1", "w2", "w3")}, "'h1', a name of every arm"),
        ({"rates": ("tip_x", "w2", "w3")}, "'tip_x', a name of every arm"),
        ({"rates": ("s1", "w2", "w3")}, "'s1', a name of Odd.functions or sincos"),
        ({"rates": ("work", "w2", "w3")}, "'work', a name of the engine"),
        ({"rates": ("w1", "w1", "w3")}, "'w1', a name of another one of Odd"),
        ({"rates": ("w 1", "w2", "w3")}, "'w 1', which no equation could take"),
        ({"rates": ("w1", "w2")}, "rates has 2 entries; its coordinates are 3"),
        ({"prismatic": (False,)}, "prismatic has 1 entries"),
        ({"joints": ("a", "a", "b")}, "give each joint a name"),
        ({"prismatic": ("no", "no", "no")}, "True or False"),
        ({"extent": ("l1", "l9")}, "extent has 'l9'; choose l1, l2, l3"),
        ({"num_lengths": None}, "lacks num_lengths"),
        ({"functions": (*FIRST, len)}, "not marked|mark it"),
        ({"functions": (*FIRST, twice)}, "gives here twice"),
        ({"functions": tuple(f for f in FIRST if f is not points)}, "gives no x1"),
        ({"functions": (*FIRST, rrp.points)}, "is given by both"),
        ({"coordinates": tuple(f"c{k}" for k in range(12))}, "has 12 coordinates; give 1 to 10"),
        ({"coordinates_of_joints": None}, "no coordinates_of_joints"),
    ],
)
def test_an_arm_that_lacks_something_or_whose_names_mean_something_else(change, said):
    refused(said, lambda: arm_of(**change))


def test_a_slider_that_is_not_at_its_coordinate():
    names = ("phi1 phi2 phi3", "phid1 phid2 phid3", "Q1 Q2 Q3", "alpha1 alpha2 r")
    takes = ("alpha1 alpha2 r", "alphad1 alphad2 v", "t1 t2 t3", "phi1 phi2 phi3")
    functions = [
        physics(gives=g, takes=t)(lambda a, b, c, shift=s: (a, b, c + shift))
        for g, t, s in zip(names, takes, (-0.1, 0.0, 0.0, 0.1), strict=True)
    ]
    own = own_of(rrp.RRP)
    change = {"functions": (*own["functions"], *functions[:3]), "coordinates_of_joints": functions[3]}
    refused("the slider 'r' of Odd is not at coordinate 3, 'r'", lambda: arm_of(own, **change))


def test_a_subclass_with_one_more_quantity_keeps_what_its_parent_said():
    @physics(gives="twice_x")
    def twice_x(tip_x):
        return 2.0 * tip_x

    class More(rde.RPRP):
        functions = (*rde.RPRP.functions, twice_x)

    kept = ("extent", "posture", "held_dynamics")
    assert [getattr(More, n) for n in kept] == [getattr(rde.RPRP, n) for n in kept]
    assert More.kind == "More"


def test_bounds_that_are_unknown_where_no_points_show_a_rate():
    @physics(gives="x1 y1 x2 y2")
    def swinging(l1, s1, c1, s2):
        return l1 * c1, l1 * s1, l1 * c1 + 0.1 * s2, l1 * s1

    kind = type("Swinging", (rde.Arm,), {"joint_types": "RR", "functions": (swinging,)})
    assert kind.mobility_bounds is None
    scene = rde.Scene(kind((1.0, 1.0), (0.5,)), (e.LimitSpring("joint1", -1.0, 1.0),), tolerance=1e-6)
    refused("Swinging has no mobility_bounds", rde.BatchSimulator, scene, 1)


def test_there_is_one_reach_that_of_the_extent():
    scene = rde.load_scene("four_r_reach")
    effects = (e.Gravity(), e.EffortLimits((20.0, 10.0, 4.0)))
    arm = arm_of(extent=("l1", "l2"), kind="ShortReach")((0.5,) * 3, (0.4, 0.3, 0.2))
    core = Core(dataclasses.replace(scene, robot=arm, effects=effects), 1, rde.ReachTask())
    assert core.reach == 0.4 + 0.3
    refused(r"the arm reaches 0.7 m", core.checked, {"goal": (0.8, 0.0)}, np.array([0]))


# ---- effects -------------------------------------------------------------------------------------------


@physics
def nothing(phi1):
    return 0.0 * phi1


@physics
def one():
    return 1.0


@physics
def upwards(phid1):
    return 0.0 * phid1, 9.81


@physics
def drag(rate, a, b):
    return -a * rate - b * rate * abs(rate)


def bound(self, arm):
    return (Force(0, drag, {"rate": "phid1", "a": ".a", "b": ".b"}),)


def effect_of(*hooks, decorated=True, numbers=(), **body):
    """An effect with some hooks and numbers (name, default)."""
    body = {"hooks": lambda self, arm: hooks, **body, "__annotations__": dict.fromkeys(dict(numbers), float)}
    kind = type("Mine", (Effect,), {**body, **dict(numbers)})
    return (dataclass(frozen=True)(kind) if decorated else kind)()


AB = (("a", 1.1), ("b", 0.3))


def branching(above):
    """An effect that asks for its number in Python."""
    return effect_of(numbers=AB, hooks=lambda self, arm: bound(self, arm) * (2 if above(self) else 1))


def test_an_effect_without_hooks_says_what_to_write():
    said = r"does not say where it attaches; write a method hooks\(self, arm\)"
    effect = dataclass(frozen=True)(type("Mine", (Effect,), {"hook": lambda self, arm: ()}))()
    refused(said, rde.Scene, FOUR_R, (effect,), error=NotImplementedError)


@pytest.mark.parametrize("name", ["static", "of_joints", "parameters", "travel", "key"])
def test_a_number_with_the_name_of_what_every_effect_has(name):
    body = {"__annotations__": {name: float}, name: 1.0}
    refused(f"Mine has a number '{name}', as every effect has; rename it", type, "Mine", (Effect,), body)


@dataclass(frozen=True)
class Rotor(Effect):
    inertia: tuple[float, ...]

    def hooks(self, arm):
        return tuple(Inertia((k,), f".inertia[{k}]") for k in range(len(arm.joints)))


@dataclass(frozen=True)
class Follows(Effect):
    k: float = 1.0
    twice: float = field(init=False, default=2.0)

    def hooks(self, arm):
        return ()


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
    return rde.BatchSimulator(rde.Scene(RPRP, effects), 2)


def test_numbers_that_their_class_changes_where_they_are_set():
    batch = batch_of(Shares())
    batch.set_parameters({"shares.a": 0.4, "shares.b": 0.6})
    change = {"shares.a": [[0.4], [4.0]], "shares.b": [[0.6], [6.0]]}
    refused(r"shares\.a is 4\.0.* Shares makes 0\.4 of it; give numbers that", batch.set_parameters, change)
    batch = batch_of(Derived())
    refused(r"derived\.b is 0\.1.* Derived makes 0\.2 of it", batch.set_parameters, {"derived.a": 2.0})
    batch.set_parameters({"derived.a": 2.0, "derived.b": 0.2})
    third = Shares(1.0, 2.0)  # their sum is 1 but for rounding
    batch_of(third).set_parameters({"shares.a": third.a * (1 + 1e-15)})


def test_static_fields_that_are_no_arguments_leave_the_others_to_be_set():
    batch = batch_of(Tabled())
    batch.set_parameters({"tabled.a": [[1.0], [2.0]]})
    batch.set_state(np.tile((0.3, 0.1, 0.2, 0.1), (2, 1)), np.ones((2, 4)))
    batch.advance()
    assert batch.qd[1, 0] < batch.qd[0, 0]


def test_warnings_of_a_class_about_numbers_that_nobody_gave_are_not_shown():
    @dataclass(frozen=True)
    class Careful(Effect):
        a: float = 1.0
        b: float = 2.0
        hooks = bound

        def __post_init__(self):
            if self.a > 10.0:
                warnings.warn("a is large", stacklevel=2)

    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        rde.Scene(RPRP, (Careful(),))
        check_effect("it", Careful(), RPRP)
    assert not seen


def test_a_state_of_an_effect_that_is_not_finite_is_told():
    @physics
    def grown(counter):
        return 1e200 * (counter + 1.0)

    counter = State("counter", "", update=grown, bind={"counter": ".counter"})
    batch = batch_of(effect_of(Force(0, nothing, states=(counter,))))
    assert batch.advance().finite.all()
    status = batch.advance()
    assert np.isinf(batch.z).all()
    assert not status.finite.any()
    assert (status.numerics == rde.Numerics.NON_FINITE).all()


@dataclass(frozen=True)
class Wall(LimitSpring):
    """A limit spring that declares which of its numbers limit the travel."""

    ends: tuple = ("lower", "upper")
    static = ("coordinate", "ends")

    def travel(self, arm):
        return dict.fromkeys(super().travel(arm), self.ends)


class Slack(Wall):
    """Limits that its class does not compare."""

    def __post_init__(self):
        pass

    def hooks(self, arm):
        return tuple(h for h in super().hooks(arm) if h.switch is None)


@physics
def of_place(place):
    return 1.0 * place


@physics
def of_speed(tip_vx):
    return 1.0 - tip_vx


@physics
def of_x4(x4):
    return 1.0 * x4


@physics
def of_side(side):
    return 0.0 * side


@physics
def of_command(command1):
    return 1.0 * command1


def walled(*ends):
    return Wall("joint2", -1.0, 1.0, ends=ends)


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        # numbers
        (effect_of(numbers=(("a", None),)), "a is None"),
        (effect_of(numbers=(("a", float("nan")),)), "a is nan"),
        (effect_of(numbers=(("a", "1"),)), "a is '1'"),
        (branching(lambda self: self.a / self.b > 100.0), "does not follow its number a"),
        (branching(lambda self: self.a / self.b < 0.02), "does not follow its number a"),
        (
            effect_of(numbers=AB, decorated=False, hooks=bound),
            r"Mine has a, b .* @dataclass\(frozen=True\) above",
        ),
        (Rotor((0.1,) * 5), r"inertia has 5 entries, of which no hook uses inertia\[4\]; give 4"),
        (Rotor([0.1, 0.1]), r"inertia is \[0.1, 0.1\]; give a number or a tuple of them"),
        (Follows(), r"Follows\).twice is not an argument of its class"),
        (walled("upper", "lower"), "'joint2' is .upper to .lower, which are 1.0 and -1.0; the first must"),
        (walled("lower", "lower"), "which are -1.0 and -1.0; the first must be below the second"),
        (
            walled("lower", "top"),
            "travel gives 'top', which is not a number of this effect; it has lower, upper",
        ),
        # fields and forces
        (effect_of(Field(upwards)), r"upwards depends on phid1; a uniform field .* parameters alone"),
        (
            effect_of(Force(0, nothing, {"phid_1": "phid2"})),
            "bind has 'phid_1', which no function here takes; they take phi1",
        ),
        (
            effect_of(Force(0, nothing, states=State("z", "", derivative=nothing))),
            r"hook 0: states is State\(.*; give a tuple, such as \(State",
        ),
        (effect_of(Force(Point(4), of_x4)), r"Point is 4; give Point\(0\) to Point\(3\), the tip"),
        (effect_of(Force(Point(True), of_x4)), "number of the Point is True"),
        (effect_of(Force(Point(3), of_x4)), "returns 1 values; a Force at a point needs 2"),
        (effect_of(Force(1, upwards)), "returns 2 values; a Force needs 1"),
        (effect_of(Force("tip", of_x4)), "joint is 'tip'; give 0 to 3"),
        (effect_of(Force(1, of_side, switch=(".a", ".b"))), r"switch: '\.a' is not a number of this effect"),
        (effect_of(Force(1, of_side, switch=".a")), r"switch is '\.a'; give the names of two numbers"),
        (effect_of(Force(1, of_side, switch=(".a",))), "give the names of two numbers"),
        (effect_of(Force(Point(3), of_side, switch=(".a", ".b"))), "the force acts at a Point"),
        (effect_of(Force(1, of_side)), "argument 'side': no quantity of RPRP is called 'side'"),
        # stops and walls
        ((Bumper(), Bumper(3, restitution=0.5)), "stops with several restitutions"),
        ((Bumper(), e.PrismaticStop((0, 0), (1, 1))), "several restitutions"),
        (Bumper(0), "'joint1' is not a slider"),
        (effect_of(Gap(of_speed, ".a"), numbers=AB), "a gap may depend on the pose"),
        (effect_of(Gap(of_place, ".a", {"place": ".b"}), numbers=AB), "a gap must move"),
        # sensors
        (effect_of(Sensing(9, nothing)), r"joint is 9; give 0 to 3"),
        (effect_of(Sensing(0, of_command)), r"of_command depends on command1; a sensor may use the motion"),
        (effect_of(Sensing(0, upwards)), r"returns 2 values; a Sensing needs 1"),
        (
            effect_of(Sensing(0, nothing, {}, "position")),
            r"reading is 'position'; choose Reading.POSITION, Reading.RATE",
        ),
        (effect_of(Sensing(0, nothing, {"phi1": ".bias"})), r"'.bias' is not a number of this effect"),
    ],
)
def test_an_effect_that_contradicts_itself(effects, said):
    refused(said, rde.Scene, RPRP, effects if isinstance(effects, tuple) else (effects,))


def test_a_travel_that_other_numbers_bring_into_the_wrong_order():
    batch = rde.BatchSimulator(rde.Scene(FOUR_R, (Slack("joint2", -1.0, 1.0),)), 2)
    said = r"travel of 'joint2' is .lower to .upper, which are 3.0 and 1.0"
    refused(said, batch.set_parameters, {"limit_spring.joint2.lower": 3.0})


def test_numbers_for_joints_may_be_lists_and_arrays():
    friction = [e.ViscousFriction(c) for c in ([0.1, 0.2, 0.3, 0.4], np.array([0.1, 0.2, 0.3, 0.4]))]
    assert rde.Scene(FOUR_R, friction[:1]) == rde.Scene(FOUR_R, friction[1:])
    assert friction[0].coefficients == (0.1, 0.2, 0.3, 0.4)


def test_a_torch_step_takes_constant_updates_and_refuses_what_is_no_real_number():
    latch = effect_of(Force(0, nothing, states=(State("z", "", update=one),)))
    q = torch.zeros((2, 4), dtype=torch.float64)
    step = rde.torch_step(rde.Scene(FOUR_R, (latch,), "rk4"))
    assert step(q, q, q, z=torch.zeros((2, 1)))[2].tolist() == [[1.0], [1.0]]
    plain = rde.torch_step(rde.Scene(FOUR_R, (), "rk4"))
    masses = {"masses": torch.tensor(2.0)}
    refused(r"masses has shape \(\); the last axis must have 4", plain, q, q, q, masses)
    refused(r"is of torch\.complex128; give real numbers", plain, q, q, q.to(torch.complex128))


@pytest.mark.parametrize(
    "call",
    [
        lambda scene: rde.simulate(scene, np.zeros(4), np.zeros(4), [1.0]),
        rde.BatchSimulator, rde.bill, rde.listing, rde.torch_step,
    ],
    ids=["simulate", "BatchSimulator", "bill", "listing", "torch_step"],
)  # fmt: skip
def test_the_name_of_a_scene_in_place_of_the_scene(call):
    refused(r"scene is 'four_r_free'; give a Scene, such as rde.load_scene makes", call, "four_r_free")


@pytest.mark.parametrize(
    ("q", "qd", "times", "said"),
    [
        ((0, 0, 0), (0,) * 4, [1.0], r"q has shape \(3,\); the last axis must have 4"),
        ((0,) * 4, (0,) * 5, [1.0], r"qd has shape \(5,\); the last axis must have 4"),
        (np.zeros((2, 4)), np.zeros((3, 4)), [1.0], r"q and qd have shapes \(2, 4\) and \(3, 4\), .* equal"),
        ((0,) * 4, (0,) * 4, [1.0, 0.5], r"times must be .* increasing; they are \[1.0, 0.5\]"),
    ],
)
def test_shapes_and_times_of_a_simulation(q, qd, times, said):
    refused(said, rde.simulate, rde.Scene(FOUR_R, ()), q, qd, times)


def test_a_slider_at_the_base_is_drawn():
    still = rde.simulate(rde.Scene(rde.Chain("P", (1.0,))), [0.0], [0.0], [0.0, 0.1])
    assert rde.animate(still).frame(0).shape == (480, 480, 3)


# ---- tasks ---------------------------------------------------------------------------------------------


def task_of(width=1.0, base=rde.ReachTask, **body):
    """The reach task with something changed; ``width`` is a number of its own."""
    body = {"__annotations__": {"width": float}, "width": 1.0, **body}
    return dataclass(frozen=True)(type("Held", (base,), body))(width=width)


def numbered(name):
    return dataclasses.make_dataclass("Odd", [(name, float, 0.3)], bases=(rde.ReachTask,), frozen=True)()


@pytest.mark.parametrize(
    ("task", "said"),
    [
        (numbered("speed"), "parameters has 'speed'"),
        (numbered("distance"), "parameters has 'distance'"),
        (task_of(memory=(*rde.ReachTask.memory, "tip_vx")), "memory has 'tip_vx'"),
        (task_of(angles={**rde.ReachTask.angles, "theta1": ("s1", "c1")}), "angles has"),
        (task_of(updates={"theta1": "distance"}), "updates has 'theta1'; choose goal_x"),
        (task_of(moves={"foo": "distance"}), "moves has 'foo'"),
        (task_of(flags=("foo",)), "flags has 'foo'"),
        (task_of(labels={"distance": "numerics"}), "labels has 'numerics'"),
        (task_of(ranges={"foo": (0, 1)}), "ranges has 'foo'"),
        (task_of(draws=1000), "draws is 1000"),
        (task_of(observation=lambda self, scene: {}), "observation is empty"),
        (task_of(reward_functions=lambda self, scene: ()), "gives no term of its own"),
        (task_of(goal_conditioned=True), "one reward term must be goal_reward"),
        (task_of(goal_conditioned=True, goal_functions=()), "goal_functions is empty"),
        (task_of(units={"perod": "s"}), r"Held\.units has 'perod'; choose start_angle, speed_bound"),
        (task_of(static=("speed_bound",)), r"Held.static has 'speed_bound'; choose"),
    ],
)
def test_a_task_whose_names_mean_something_else(task, said):
    refused(said, Core, "four_r_reach", 1, task)


rewards = rde.ReachTask.reward_functions


def pays(held):
    """A reward of a closure that holds a number."""

    def near(held):
        return physics(gives="near_term")(lambda distance: held / (1.0 + distance))

    return {"reward_functions": lambda self, scene: (near(held(self, scene)),)}


def with_double(self):
    rde.ReachTask.__post_init__(self)
    object.__setattr__(self, "double", 2.0 * self.width)


def fewer(self, scene):
    return dict(list(rde.ReachTask.observation(self, scene).items())[: 3 if self.width > 1.2 else 5])


HELD = {
    "a closure": ("width", pays(lambda task, scene: task.width)),
    "a number of the base": ("goal_tolerance", pays(lambda task, scene: task.goal_tolerance)),
    "a branch": (
        "hold_steps",
        {"reward_functions": lambda self, scene: rewards(self, scene)[: 3 if self.hold_steps > 12 else 4]},
    ),
    "a partial": ("width", pays(lambda task, scene: functools.partial(max, task.width)(0.1))),
    "an attribute": ("width", {"__post_init__": with_double, **pays(lambda task, scene: task.double)}),
    "the arm's": (r"masses\[0\] of the arm", pays(lambda task, scene: scene.robot.masses[0])),
    "an effect's": (
        r"limits\[1\] of the effect effort_limits",
        pays(lambda task, scene: scene.parameters()["effort_limits.limits[1]"]),
    ),
    "a start": (
        "start_angle", {"start_range": lambda self, *_: (f"-{self.start_angle}", f"{self.start_angle}")},
    ),
    "a metric": (
        "width", {"metrics": property(lambda self: rde.ReachTask.metrics[: 4 if self.width > 0.7 else 3])},
    ),
    "an observation": ("width", {"observation": fewer}),
}  # fmt: skip


@pytest.mark.parametrize("what", HELD)
@pytest.mark.parametrize("scene", ["rprp_reach", "four_r_reach"])
def test_a_number_that_a_function_of_a_task_holds(scene, what):
    name, body = HELD[what]
    said = rf"Held does not follow its number {name} .*take it as the argument"
    refused(said, Core, scene, 1, task_of(**body))


def test_a_static_number_may_be_held_and_is_no_argument_and_others_are_arguments():
    held = task_of(2.0, static=("width",), **HELD["a closure"][1])
    assert "width" not in {*held.parameters(), *Core("four_r_reach", 1, held).task.parameters()}

    @physics(gives="near_term")
    def term(distance, width, m1, effort_limits_limits_1):
        return width * m1 / (1.0 + distance) / effort_limits_limits_1

    Core("four_r_reach", 1, task_of(reward_functions=lambda self, scene: (term,)))


def test_numbers_that_the_class_of_a_task_changes():
    @dataclass(frozen=True)
    class Halved(rde.ReachTask):
        def __post_init__(self):
            super().__post_init__()
            object.__setattr__(self, "rate_scale", min(self.rate_scale, 5.0))

    numbers = {name: np.array([value]) for name, value in Halved().parameters().items()}
    _check_task(Halved(), numbers)
    changed = {**numbers, "rate_scale": np.array([8.0])}
    refused(r"^rate_scale is 8\.0, and Halved makes 5\.0 of it", _check_task, Halved(), changed)


@physics(gives="height_term")
def height_term(tip_y, weight):
    """weight times tip y"""
    return weight * tip_y


def test_a_class_without_its_decorator_or_a_default_without_its_type():
    class Raise(rde.Task):
        weight: float = 1.0
        name: str = "Raise"

        def reward_functions(self, scene):
            return (height_term,)

        def observation(self, scene):
            return scene.robot.posture

    refused(r"Raise has weight .* @dataclass\(frozen=True\) above", check_task, Raise(), REACH)
    loose = dataclass(frozen=True)(type("Loose", (rde.ReachTask,), {"hold_speed": 1.0}))
    refused(r"hold_speed = 1\.0.* write hold_speed: float = 1\.0", check_task, loose(), REACH)
    body = {"__annotations__": {"hold_speed": float}, "hold_speed": 1.0}
    strict = dataclass(frozen=True)(type("Strict", (rde.ReachTask,), body))
    check_task(strict(), REACH)
    check_task(type("Renamed", (strict,), {"name": "Renamed"})(), REACH)  # adds no numbers
    more = dataclass(frozen=True)(type("More", (Shares,), {"a": 7.0}))
    refused(r"write a: float = 7\.0", rde.Scene, RPRP, (more(),))


def test_sb3_environments_need_no_success():
    @physics(gives="near_only")
    def near_only(distance):
        """1 - distance"""
        return 1.0 - distance

    @dataclass(frozen=True)
    class Bare(rde.ReachTask):
        name = "BareReach"
        metrics = ("distance",)
        flags, labels, held_outputs = (), {}, ()

        def reward_functions(self, scene):
            return (near_only,)

    rde.register_task(Bare)
    env = rde.make_sb3("FourRBareReach-v0", 3)
    env.reset()
    assert env.step(np.zeros((3, 4), np.float32))[3] == [{"TimeLimit.truncated": False}] * 3
    page = type(gym.make("redundant_envs/FourRBareReach-v0").unwrapped).__doc__
    assert "| near_only | `1 - distance` | `return_near_only` |" in page


# ---- registration --------------------------------------------------------------------------------------


GOAL = rde.load_scene("four_r_reach").to_dict()
GOAL["robot"]["type"] = "RPRPGoal"
BARE = {"robot": {"type": "OddArm", "masses": [1, 1, 1], "lengths": [1, 1, 1]}}


def four_r(kind):
    return dataclass(frozen=True)(type(kind, (rde.FourR,), {"kind": kind}))


@pytest.mark.parametrize(
    ("said", "register", "arguments"),
    [
        ("RPRPGoalReach-v0 is the id of", rde.register_arm, (four_r("RPRPGoal"), GOAL)),
        ("no EffortLimits", rde.register_arm, (arm_of(kind="OddArm"), BARE)),
        ("'ThreeR' is taken", rde.register_arm, (four_r("ThreeR"),)),
        ("one with a robot of type ThreeR", rde.register_arm, (three_r.ThreeR, "rprp_reach")),
        (
            "does not end with Vector or Env",
            rde.register_task, (type("T", (rde.ReachTask,), {"name": "ReachVector"}),),
        ),
        (r"derived from redundant_envs\.Task", rde.register_task, (three_r.ThreeR,)),
        ("base of all effects", rde.register_effect, (Effect,)),
    ],
)  # fmt: skip
def test_ids_that_clash_and_scenes_that_make_no_environment(said, register, arguments):
    before = dict(IDS), dict(rde.robots.REGISTRY), dict(rde.tasks.REGISTRY)
    refused(said, register, *arguments)
    assert (dict(IDS), dict(rde.robots.REGISTRY), dict(rde.tasks.REGISTRY)) == before


def test_a_task_whose_ids_clash_is_refused_and_the_next_one_is_registered():
    rde.register_arm(four_r("FourRNew"), {**GOAL, "robot": {**GOAL["robot"], "type": "FourRNew"}})
    before = dict(IDS), dict(rde.tasks.REGISTRY)
    clashing, free = (type(name, (rde.ReachTask,), {"name": name}) for name in ("NewReach", "NextReach"))
    said = "FourRNewReach-v0 is the id of the arm FourRNew with the task Reach"
    refused(said, rde.register_task, clashing)
    assert (dict(IDS), dict(rde.tasks.REGISTRY)) == before
    rde.register_task(free)
    assert "redundant_envs/FourRNewNextReach-v0" in IDS


def test_another_scene_of_a_registered_arm_takes_its_place_and_is_a_copy():
    def length():
        return gym.make("redundant_envs/ThreeRReach-v0").unwrapped.core.scene.robot.lengths[0]

    try:
        changed = copy.deepcopy(three_r.SCENE)
        changed["robot"]["lengths"] = [0.5, 0.35, 0.25]
        rde.register_arm(three_r.ThreeR, changed)
        changed["robot"]["lengths"][0] = 9.0
        assert length() == 0.5
    finally:
        rde.register_arm(three_r.ThreeR, three_r.SCENE)
    assert length() == 0.4


def test_sb3_environments_import_the_module_that_registers_them():
    assert rde.make_sb3("three_r:ThreeRReach-v0", 2).num_envs == 2
    refused("no_such_module", rde.make_sb3, "no_such_module:ThreeRReach-v0", 2, error=ModuleNotFoundError)
