"""What users add and what cannot be right is refused when it is made, with a message that names it."""

from dataclasses import dataclass, field

import gymnasium as gym
import numpy as np
import pytest
import rrp
import three_r
from arms import ARMS, e
from humming_stop import HummingStop

import redundant_envs as rde
import redundant_envs.robots
from redundant_envs.algebra import physics
from redundant_envs.compiler.backends.torch import torch
from redundant_envs.effects import Actuation, Effect, Force, Instant, Point, State
from redundant_envs.envs.core import Core
from redundant_envs.envs.registration import IDS
from redundant_envs.robots.arm import Arm
from redundant_envs.tasks.checks import check_task

FOUR_R, RPRP = ARMS["4R"], ARMS["RPRP"]


def refused(said, function, *arguments, error=ValueError):
    with pytest.raises(error, match=said):
        function(*arguments)


# ---- arms ----------------------------------------------------------------------------------------------

FIRST = tuple(f for f in rrp.RRP.functions if f.__module__ == "rrp")
SAID = {*Arm.__annotations__} - {*rrp.RRP._derived, "kind"}
OWN = {name: value for name, value in vars(rrp.RRP).items() if name in SAID}


def arm_of(**change):
    """A class like that of RRP with something changed; None: it is left out."""
    body = {n: v for n, v in {**OWN, "functions": FIRST, **change}.items() if v is not None}
    return dataclass(frozen=True)(type("Odd", (Arm,), body))


twice = physics(gives="here here")(lambda alpha1: (alpha1, 2.0 * alpha1))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"rates": ("t1", "alphad2", "v")}, "calls a coordinate or a rate 't1'"),
        ({"rates": ("tip_x", "alphad2", "v")}, "a rate 'tip_x'; give each an identifier"),
        ({"rates": ("work", "alphad2", "v")}, "a rate 'work'; give each an identifier"),
        ({"rates": ("alphad1", "alphad2")}, "rates has 2 entries; its coordinates are 3"),
        ({"joints": ("a", "a", "b")}, "give each joint a name"),
        ({"extent": ("l1", "l9")}, "extent has 'l9'; choose high3, l1, l2"),
        ({"num_lengths": None}, "lacks num_lengths"),
        ({"functions": (*FIRST, len)}, "not marked|mark it"),
        ({"functions": (*FIRST, twice)}, "gives here twice"),
        ({"functions": tuple(f for f in FIRST if f is not rrp.points)}, "gives no x1"),
        ({"coordinates": tuple(f"c{k}" for k in range(12))}, "has 12 coordinates; give 1 to 10"),
    ],
)
def test_an_arm_that_lacks_something_or_whose_names_mean_something_else(change, said):
    refused(said, lambda: arm_of(**change))


def test_bounds_that_are_unknown_where_no_points_show_a_rate():
    @physics(gives="x1 y1 x2 y2")
    def swinging(l1, s1, c1, s2):
        return l1 * c1, l1 * s1, l1 * c1 + 0.1 * s2, l1 * s1

    kind = type("Swinging", (rde.Arm,), {"joint_types": "RR", "functions": (swinging,)})
    scene = rde.Scene(kind((1.0, 1.0), (0.5,)), (e.LimitSpring("joint1", -1.0, 1.0),), tolerance=1e-6)
    refused("Swinging has no mobility_bounds", rde.BatchSimulator, scene, 1)


# ---- effects -------------------------------------------------------------------------------------------

nothing = physics(lambda phi1: 0.0 * phi1)
upwards = physics(lambda phid1: (0.0 * phid1, 9.81))
drag = physics(lambda rate, a, b: -a * rate - b * rate * abs(rate))
of_place = physics(lambda place: 1.0 * place)
of_speed = physics(lambda tip_vx: 1.0 - tip_vx)
of_side = physics(lambda side: 0.0 * side)
of_command = physics(lambda command1: 1.0 * command1)
of_angle = physics(lambda phi1: phi1)
of_rate = physics(lambda phid1: phid1)
of_mass = physics(lambda m1: 0.0 * m1)
once_passed = physics(lambda phi1, passed: -phi1 * passed)
approached = physics(lambda phi1, phid1, elapsed: phi1 + phid1 * elapsed)


def bound(self, arm):
    return (Force(0, drag, {"rate": "phid1", "a": ".a", "b": ".b"}),)


def branching(above):
    """An effect that asks for its number in Python."""
    return effect_of(numbers=AB, hooks=lambda self, arm: bound(self, arm) * (2 if above(self) else 1))


def effect_of(*hooks, decorated=True, numbers=None, **body):
    """An effect with some hooks and numbers, by name."""
    numbers = numbers or {}
    own = {"hooks": lambda self, arm: hooks, **body, **numbers}
    own["__annotations__"] = dict.fromkeys(numbers, float)
    kind = type("Mine", (Effect,), own)
    return (dataclass(frozen=True)(kind) if decorated else kind)()


AB = {"a": 1.1, "b": 0.3}


@pytest.mark.parametrize("name", ["static", "parameters", "key"])
def test_a_number_with_the_name_of_what_every_effect_has(name):
    body = {"__annotations__": {name: float}, name: 1.0}
    refused(f"Mine has a number '{name}', as every effect has; rename it", type, "Mine", (Effect,), body)


def setting(numbers, change, **body):
    """An effect whose class sets some of its numbers."""

    def post_init(self):
        for name, value in change(self).items():
            object.__setattr__(self, name, value)

    return effect_of(numbers=numbers, hooks=bound, __post_init__=post_init, **body)


def shares(a=1.0, b=3.0):
    """Numbers that their class scales to a sum of one."""
    return setting(
        {"a": a, "b": b}, lambda self: {"a": self.a / (self.a + self.b), "b": self.b / (self.a + self.b)}
    )


DERIVED = setting({"a": 1.0, "b": None}, lambda self: {"b": 0.1 * self.a})


def batch_of(effect):
    return rde.BatchSimulator(rde.Scene(RPRP, (effect,)), 3)


def test_a_state_of_an_effect_that_is_not_finite_is_told():
    grown = physics(lambda counter: 1e200 * (counter + 1.0))
    counter = State("counter", "", update=grown, bind={"counter": ".counter"})
    batch = batch_of(effect_of(Force(0, nothing, states=(counter,))))
    assert batch.advance().finite.all()
    status = batch.advance()
    assert np.isinf(batch.z).all()
    assert not status.finite.any()
    assert (status.numerics == rde.Numerics.NON_FINITE).all()


def walled(*ends):
    """An effect that says which of its numbers limit the travel of joint 2."""
    return effect_of(numbers={"a": -1.0, "b": 1.0}, hooks=bound, travel=lambda self, arm: {1: ends})


def bumper(joint=1, **given):
    """Stops of one slider with its own restitution."""
    numbers = {"lower": 0.0, "upper": 0.2, "restitution": 0.0, **given}
    hook = e.Impact(joint, ".lower", ".upper", ".restitution")
    return effect_of(hook, numbers=numbers, key=f"bumper{joint}")


def added(hook, number=0.1):
    """An effect with a mass or an inertia."""
    return effect_of(hook, numbers={"number": number})


def rotors(self, arm):
    return tuple(e.Inertia((k,), f".k[{k}]") for k in range(len(arm.joints)))


def timed(*hooks, after=of_place):
    """An effect with an instant."""
    bind = {"place": ".number"} if after is of_place else {}
    return effect_of(Instant(after, bind), *hooks, numbers={"number": 0.01})


def reading(when="instant", **kind):
    """A force with a state that is renewed at some time."""
    return Force(0, of_angle, states=(State("read", "rad", when=when, **(kind or {"update": of_angle})),))


TURNED, LIGHTER = e.Inertia((0,), ".number"), e.PointMass(Point(1), ".number")
BELOW = "give the lower first"


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        # numbers
        (effect_of(numbers={"a": float("nan")}), "a is nan"),
        (branching(lambda self: self.a / self.b > 100.0), "does not follow its number a"),
        (branching(lambda self: 8.1 < self.a < 8.9), "does not follow its number a"),
        (branching(lambda self: self.a == 37.5), "does not follow its number a"),
        (effect_of(numbers=AB, decorated=False, hooks=bound), r"Mine has a, b .* @dataclass\(frozen=True\)"),
        (effect_of(numbers={"k": (0.1,) * 5}, hooks=rotors), r"has 5 entries; unused: k\[4\]"),
        (effect_of(numbers={"n": field(init=False, default=2.0)}), r"Mine\).n is not an argument of its"),
        (walled("b", "a"), f"'r1' is .b to .a, 1.0 to -1.0; {BELOW}"),
        # fields and forces
        (
            effect_of(e.Field(upwards)),
            "depends on phid1; it may depend on parameters and states of its effect alone",
        ),
        (effect_of(Force(0, nothing, {"phid_1": "phid2"})), "bind has 'phid_1'; its functions take phi1"),
        (effect_of(Force(0, nothing, states=State("z", ""))), r"states is State\(.*; give a tuple, such as"),
        (effect_of(Force(1, of_side, switch=(".a", ".b"))), r"switch: '\.a' is not a number of this effect"),
        (effect_of(Force(1, of_side)), "argument 'side': no quantity of RPRP is called 'side'"),
        (HummingStop(1, 0.3, 0.1, 2e3, 30.0), BELOW),
        # names that the effect and the arm have
        (
            effect_of(Force(0, of_mass), numbers={"m1": 3.0}),
            r"'m1': the effect has .*bind it to '\.m1' or 'm1'",
        ),
        (
            effect_of(Force(0, nothing, states=(State("phi1", "", of_rate),))),
            r"argument 'phi1': .*bind it to '\.phi1' or 'phi1'",
        ),
        # laws that change
        (effect_of(Actuation(0, of_command, by_side=of_side)), "it has by_side without guard"),
        (
            effect_of(Force(1, of_side, switch=(".a", ".b"), guard=of_angle), numbers=AB),
            "to a force on a joint, no guard",
        ),
        # instants
        (timed(Instant(of_place, {"place": ".number"})), "has 2 instants; give one"),
        (effect_of(Force(0, once_passed)), "takes 'passed'; add Instant"),
        (effect_of(reading()), "'read' has when='instant'; give 'interval'"),
        (timed(reading(derivative=of_rate)), "when='instant' and no update; give one"),
        (timed(after=of_angle), "phi1; it may depend on parameters alone"),
        # closed forms
        (effect_of(reading("interval", update=of_angle, closed=approached)), "has closed without derivative"),
        (effect_of(reading("interval", derivative=of_rate, closed=of_rate)), "does not take 'elapsed'"),
        (effect_of(reading("interval", derivative=of_rate, closed=approached)), "does not take '.read'"),
        # masses and inertias
        (added(e.Inertia((7,), ".number")), "joint is 7; give 0 to 3"),
        (added(e.Inertia((0, 1), ".number")), "which turn and slide"),
        (added(TURNED, -0.5), r"mine.number is -0.5; give 0 to 45000 kg m\^2, a million times"),
        (added(LIGHTER, -2.0), "masses with what effects add.*-0.5"),
        # stops and walls
        ((bumper(), bumper(3, restitution=0.5)), "stops with several restitutions"),
        ((bumper(0, upper=3.0), bumper(2, upper=3.0, restitution=0.5)), "stops of revolute joints"),
        (bumper(restitution=1.5), r"Mine\).restitution is 1.5; it must lie in 0 to 1"),
        (bumper(lower=0.3), f"travel is .lower to .upper, 0.3 to 0.2; {BELOW}"),
        (effect_of(e.Gap(of_speed, ".a"), numbers=AB), "it may depend on parameters and the pose"),
        # sensors
        (
            effect_of(e.Sensing(0, of_command)),
            r"depends on command1; it may depend on parameters, the motion",
        ),
        (effect_of(e.Sensing(0, nothing, {}, "position")), r"reading is 'position'; give Reading.POSITION"),
    ],
)
def test_an_effect_that_contradicts_itself(effects, said):
    refused(said, rde.Scene, RPRP, effects if isinstance(effects, tuple) else (effects,))


def test_a_number_with_a_name_that_means_something_in_other_functions_needs_no_bind():
    force = Force(0, physics(lambda speed, elapsed, uniform1: -speed * elapsed * uniform1))
    rde.Scene(RPRP, (effect_of(force, numbers={"speed": 1.0, "elapsed": 1.0, "uniform1": 0.5}),))
    own = e.Friction(0, physics(lambda speed: 1.0 + speed))
    refused("'speed': the effect has", rde.Scene, RPRP, (effect_of(own, numbers={"speed": 1.0}),))


@pytest.mark.parametrize("source", [".m1", "m1"])
def test_a_name_of_the_effect_and_of_the_arm_is_allowed_where_it_is_bound(source):
    (attached,) = rde.Scene(
        RPRP, (effect_of(Force(0, of_mass, {"m1": source}), numbers={"m1": 3.0}),)
    ).attached
    assert attached.functions["function"].names == ({".m1": "mine.m1"}.get(source, source),)


@pytest.mark.parametrize(
    ("effect", "change", "said"),
    [
        (walled("a", "b"), {"mine.a": 3.0}, f"travel of 'r1' .* 3.0 to 1.0; {BELOW}"),
        (HummingStop(1, 0.1, 0.2, 2e3, 30.0), {"humming_stop.lower": [0.0, 0.2]}, BELOW),
        (bumper(), {"bumper1.restitution": -0.1}, "bumper1.restitution is -0.1; it must lie in 0 to 1"),
        (added(TURNED), {"mine.number": 1e6}, r"is 1e\+06; give 0 to 45000 kg m\^2.* hide the arm"),
        (added(TURNED), {"masses": [2.0, 1.5, 1.0, 5e-7]}, r"mine.number is 0.1; give 0 to 0.045 kg m\^2"),
        (added(LIGHTER, -1.0), {"mine.number": [-1.0, -2.0]}, "m2 with mine.number has the entry -0.5"),
        (shares(), {"mine.a": [0.4, 4.0], "mine.b": [0.6, 6.0]}, "mine.a is 4.0.* Mine makes 0.4 of it"),
        (DERIVED, {"mine.a": 2.0}, "mine.b is 0.1.* Mine makes 0.2 of it; give numbers that it keeps"),
    ],
)
def test_numbers_of_a_lane_that_contradict_each_other(effect, change, said):
    batch = batch_of(effect)
    before = batch.save()["parameters"]
    refused(said, batch.set_parameters, change, [0, 2])
    np.testing.assert_array_equal(batch.save()["parameters"], before)


def test_numbers_that_their_class_changes_may_be_set_where_it_keeps_them():
    batch_of(shares()).set_parameters({"mine.a": 0.4, "mine.b": 0.6})
    batch_of(DERIVED).set_parameters({"mine.a": 2.0, "mine.b": 0.2})
    third = shares(1.0, 2.0)  # their sum is 1 but for rounding
    batch_of(third).set_parameters({"mine.a": third.a * (1 + 1e-15)})


def test_a_torch_step_takes_constant_updates_and_refuses_what_is_no_real_number():
    latch = effect_of(Force(0, nothing, states=(State("z", "", update=physics(lambda: 1.0)),)))
    q = torch.zeros((2, 4), dtype=torch.float64)
    step = rde.torch_step(rde.Scene(FOUR_R, (latch,), "rk4"))
    assert step(q, q, q, z=torch.zeros((2, 1)))[2].tolist() == [[1.0], [1.0]]
    refused("z is None, and effects of the scene have", step, q, q, q)
    plain = rde.torch_step(rde.Scene(FOUR_R, (), "rk4"))
    refused(r"efforts is .*complex128.*; give a tensor of real numbers", plain, q, q, q.to(torch.complex128))


@pytest.mark.parametrize(
    "call", [rde.BatchSimulator, rde.bill, rde.listing, rde.torch_step], ids=lambda call: call.__name__
)
def test_the_name_of_a_scene_in_place_of_the_scene(call):
    refused(r"scene is 'four_r_free'; give a Scene, such as rde.load_scene makes", call, "four_r_free")


# ---- tasks ---------------------------------------------------------------------------------------------


def task_of(width=1.0, base=rde.ReachTask, **body):
    """The reach task with something changed; ``width`` is a number of its own."""
    body = {"__annotations__": {"width": float}, "width": 1.0, **body}
    return dataclass(frozen=True)(type("Held", (base,), body))(width=width)


def places(takes):
    """Gravity that the task sets to a quantity of these."""
    heavier = physics(gives="g_new", takes=takes)(lambda *values: 9.0 + values[0])
    later = physics(gives="rest_x", takes="gravity_g")(lambda g: 2.0 * g)
    return {
        "placements": lambda self, scene: {"gravity.g": "g_new"},
        "begin_functions": lambda self, scene: (
            *rde.ReachTask.begin_functions(self, scene), heavier, later,
        ),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("task", "said"),
    [
        (task_of(memory=(*rde.ReachTask.memory, "tip_vx")), "memory has 'tip_vx'"),
        (task_of(angles={**rde.ReachTask.angles, "theta1": ("s1", "c1")}), "angles has"),
        (task_of(updates={"theta1": "distance"}), "updates has 'theta1'; choose goal_x"),
        (task_of(labels={"distance": "numerics"}), "labels has 'numerics'"),
        (task_of(unused=("innner",)), "unused has 'innner'; choose "),
        (task_of(observation=lambda self, scene: {}), "observation is empty"),
        (task_of(reward_functions=lambda self, scene: ()), "gives no term of its own"),
        (task_of(goal_conditioned=True), "give one reward term, a function of goal_reward"),
        (task_of(units={"perod": "s"}), r"Held\.units has 'perod'; choose start_angle, speed_bound"),
        (task_of(static=("speed_bound",)), r"Held.static has 'speed_bound'; choose"),
        (task_of(**places("gravity_g")), r"Held\.placements gives 'g_new', which takes gravity\.g: that of"),
        (task_of(**places("goal_x rest_x")), r"Held\.placements gives 'g_new', which takes gravity\.g: that"),
    ],
)
def test_a_task_whose_names_mean_something_else(task, said):
    refused(said, Core, "four_r_reach", 1, task)


def pays(held):
    """A reward of a closure that holds a number."""

    def near(held):
        return physics(gives="near_term")(lambda distance: held / (1.0 + distance))

    return {"reward_functions": lambda self, scene: (near(held(self, scene)),)}


A_CLOSURE = pays(lambda task, scene: task.width)
HELD = {
    "a closure": ("width", A_CLOSURE),
    "the arm's": (r"masses\[0\] of the arm", pays(lambda task, scene: scene.robot.masses[0])),
    "an effect's": (
        r"limits\[1\] of the effect effort_limits",
        pays(lambda task, scene: scene.parameters()["effort_limits.limits[1]"]),
    ),
    "a start": (
        "start_angle", {"start_range": lambda self, *_: (f"-{self.start_angle}", f"{self.start_angle}")},
    ),
}  # fmt: skip


@pytest.mark.parametrize(("name", "body"), HELD.values(), ids=HELD)
def test_a_number_that_a_function_of_a_task_holds(name, body):
    said = rf"Held does not follow its number {name} .*take it as the argument"
    refused(said, Core, "rprp_reach", 1, task_of(**body))


def test_a_static_number_may_be_held_and_is_no_argument_and_others_are_arguments():
    scene, held = rde.load_scene("four_r_reach"), task_of(2.0, static=("width",), **A_CLOSURE)
    check_task(held, scene)
    assert "width" not in held.parameters()

    @physics(gives="near_term")
    def term(distance, width, m1, effort_limits_limits_1):
        return width * m1 / (1.0 + distance) / effort_limits_limits_1

    check_task(task_of(reward_functions=lambda self, scene: (term,)), scene)


def test_a_class_without_its_decorator_or_a_default_without_its_type():
    reach = rde.load_scene("rprp_reach")
    bare = type("Raise", (rde.ReachTask,), {"__annotations__": {"weight": float}, "weight": 1.0})
    refused(r"Raise has weight .* @dataclass\(frozen=True\) above", check_task, bare(), reach)
    loose = dataclass(frozen=True)(type("Loose", (rde.ReachTask,), {"hold_speed": 1.0}))
    refused(r"hold_speed = 1\.0.* write hold_speed: float = 1\.0", check_task, loose(), reach)
    check_task(type("Renamed", (rde.ReachTask,), {"name": "Renamed"})(), reach)  # adds no numbers
    more = dataclass(frozen=True)(type("More", (type(shares()),), {"a": 7.0}))
    refused(r"write a: float = 7\.0", rde.Scene, RPRP, (more(),))


# ---- registration --------------------------------------------------------------------------------------

GOAL = rde.load_scene("four_r_reach").to_dict()
GOAL["robot"]["type"] = "RPRPGoal"
FOUR = "four_r_reach"
ODD = {**GOAL, "robot": {**GOAL["robot"], "type": "Odd"}}
BARE = {"robot": {"type": "OddArm", "masses": [1, 1, 1], "lengths": [1, 1]}}


def four_r(kind):
    return dataclass(frozen=True)(type(kind, (rde.FourR,), {"kind": kind}))


def task_named(name, **body):
    return type(f"{name}Task", (rde.ReachTask,), {"name": name, **body})


@pytest.mark.parametrize(
    ("said", "register", "arguments"),
    [
        ("RPRPGoalReach-v0 is the id of", rde.register_arm, (four_r("RPRPGoal"), GOAL)),
        ("no EffortLimits", rde.register_arm, (arm_of(kind="OddArm"), BARE)),
        ("'ThreeR' is taken", rde.register_arm, (four_r("ThreeR"),)),
        ("one with a robot of type ThreeR", rde.register_arm, (three_r.ThreeR, "rprp_reach")),
        ("scenes is given", rde.register_arm, (arm_of(kind="OddArm"), None, {"Reach": BARE})),
        (r"scenes\['Reach'\] has the arm FourR", rde.register_arm, (four_r("Odd"), ODD, {"Reach": FOUR})),
        ("scenes has a task 'No'; choose from Reach", rde.register_arm, (four_r("Odd"), ODD, {"No": ODD})),
        ("scenes has an arm 'Odd'; choose from RPRP", rde.register_task, (task_named("A"), {"Odd": ODD})),
        (r"scenes\['RPRP'\] has the arm FourR", rde.register_task, (task_named("A"), {"RPRP": FOUR})),
        ("scenes is 'four_r_reach'; give a mapping", rde.register_task, (task_named("A"), FOUR)),
        ("ATask.steps is 0; give a whole number", rde.register_task, (task_named("A", steps=0),)),
        ("does not end with Vector or Env", rde.register_task, (task_named("ReachVector"),)),
        (r"derived from redundant_envs\.Task", rde.register_task, (three_r.ThreeR,)),
    ],
)
def test_ids_that_clash_and_scenes_that_make_no_environment(said, register, arguments):
    before = dict(IDS), dict(rde.robots.REGISTRY), dict(rde.tasks.REGISTRY)
    refused(said, register, *arguments)
    assert (dict(IDS), dict(rde.robots.REGISTRY), dict(rde.tasks.REGISTRY)) == before


def test_a_task_whose_ids_clash_is_refused_and_the_next_one_is_registered():
    robot = {**GOAL["robot"], "type": "FourRNew", "masses": np.array(GOAL["robot"]["masses"])}
    rde.register_arm(four_r("FourRNew"), {**GOAL, "robot": robot})
    assert '"masses": [' in gym.spec("redundant_envs/FourRNewReach-v0").to_json()
    before = dict(IDS), dict(rde.tasks.REGISTRY)
    said = "FourRNewReach-v0 is the id of the arm FourRNew with the task Reach"
    refused(said, rde.register_task, task_named("NewReach"))
    assert (dict(IDS), dict(rde.tasks.REGISTRY)) == before
    rde.register_task(task_named("NextReach"))
    assert "redundant_envs/FourRNewNextReach-v0" in IDS


def test_sb3_environments_import_the_module_that_registers_them():
    assert rde.make_sb3("three_r:ThreeRReach-v0", 2).num_envs == 2
    refused("no_such_module", rde.make_sb3, "no_such_module:ThreeRReach-v0", 2, error=ModuleNotFoundError)
