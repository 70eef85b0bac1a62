"""Additions from outside that cannot be right are refused when they are made, or found by verify."""

import copy
import dataclasses
import functools

import gymnasium as gym
import numpy as np
import pytest
import rrp
import three_r
import three_r_by_hand

import redundant_envs as rde
import redundant_envs.robots
from redundant_envs.algebra import physics
from redundant_envs.effects import Effect, Force
from redundant_envs.envs.registration import IDS
from redundant_envs.robots.arm import Arm
from redundant_envs.verify import Mode, verify

e = rde.effects
ThreeRByHand = three_r_by_hand.ThreeRByHand
OWN = {
    n: v for n, v in vars(ThreeRByHand).items() if n in Arm.__annotations__ and n not in ThreeRByHand._derived
}
FIRST = tuple(f for f in OWN["functions"] if f.__module__ == three_r_by_hand.__name__)


def arm_of(**change):
    body = {**{n: v for n, v in OWN.items() if n != "kind"}, "functions": FIRST, **change}
    return dataclasses.dataclass(frozen=True)(
        type("Odd", (Arm,), {n: v for n, v in body.items() if v is not None})
    )


# ---- arms --------------------------------------------------------------------------------------------


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
        ({"joints": ("a", "a", "b")}, "give each joint a name"),
        ({"prismatic": ("no", "no", "no")}, "True or False"),
        ({"extent": ("l1", "l9")}, "extent has 'l9'; choose l1, l2, l3"),
        ({"num_lengths": None}, "lacks num_lengths"),
        ({"functions": (*FIRST, len)}, "not marked|mark it"),
        ({"coordinates": tuple(f"c{k}" for k in range(12))}, "has 12 coordinates; give 1 to 10"),
    ],
)
def test_an_arm_whose_names_mean_something_else_is_refused(change, said):
    with pytest.raises(ValueError, match=said):
        arm_of(**change)


def test_a_name_that_one_function_gives_twice_is_refused():
    @physics(gives="here here")
    def twice(theta1):
        return theta1, 2.0 * theta1

    with pytest.raises(ValueError, match="gives here twice"):
        arm_of(functions=(*FIRST, twice))


def test_a_slider_that_is_not_at_its_coordinate_is_refused():
    @physics(gives="phi1 phi2 phi3")
    def joint_positions(alpha1, alpha2, r):
        return alpha1, alpha2, r - 0.1

    @physics(gives="phid1 phid2 phid3")
    def joint_rates(alphad1, alphad2, v):
        return alphad1, alphad2, v

    @physics(gives="Q1 Q2 Q3")
    def motor_map(t1, t2, t3):
        return t1, t2, t3

    @physics(gives="alpha1 alpha2 r")
    def back(phi1, phi2, phi3):
        return phi1, phi2, phi3 + 0.1

    body = {n: v for n, v in vars(rrp.RRP).items() if n in Arm.__annotations__ and n not in rrp.RRP._derived}
    functions = tuple(f for f in body["functions"] if f.__module__ == rrp.__name__)
    changed = {
        "functions": (*functions, joint_positions, joint_rates, motor_map),
        "coordinates_of_joints": back,
    }
    with pytest.raises(ValueError, match="the slider 'r' of Odd is not at coordinate 3, 'r'"):
        type("Odd", (Arm,), {**body, **changed, "kind": "Odd"})


def test_a_subclass_with_one_more_quantity_keeps_what_its_parent_said():
    @physics(gives="twice_x")
    def twice_x(tip_x):
        return 2.0 * tip_x

    class More(rde.RPRP):
        functions = (*rde.RPRP.functions, twice_x)

    assert More.extent == rde.RPRP.extent
    assert More.posture == rde.RPRP.posture
    assert More.held_dynamics is rde.RPRP.held_dynamics
    assert More.kind == "More"


@pytest.mark.parametrize(
    "fault", ["jacobian", "jacobian_dot_qd", "mass_matrix", "bias_forces", "joint_rates"]
)
def test_verify_finds_equations_that_contradict_the_point_masses(fault):
    right = next(f for f in FIRST if f.__name__ == fault)

    @functools.wraps(right)
    def wrong(*values):
        return tuple(2.0 * x for x in right(*values))

    wrong.physics_takes = tuple(right.__code__.co_varnames[: right.__code__.co_argcount])
    arm = arm_of(functions=tuple(wrong if f is right else f for f in FIRST))((1.0, 0.5, 0.7), (0.4, 0.3, 0.2))
    misses = verify(rde.Scene(arm, (e.Gravity(),)), 16, Mode.QUICK).misses
    assert any("contradict" in text for text in misses)


def test_an_arm_of_one_joint_moves_as_a_pendulum():
    @physics(gives="x1 y1")
    def points(l1, s1, c1):
        return l1 * s1, -l1 * c1

    @physics(gives="J11 J21")
    def jacobian(l1, s1, c1):
        return l1 * c1, l1 * s1

    @physics(gives="Jdqd1 Jdqd2")
    def jacobian_dot_qd(l1, s1, c1, omega):
        return -l1 * s1 * omega * omega, l1 * c1 * omega * omega

    @physics(gives="M11")
    def mass_matrix(m1, l1):
        return m1 * l1 * l1

    @physics(gives="h1")
    def bias_forces():
        return 0.0

    @physics(gives="G1")
    def gravity_forces(m1, l1, s1, c1, ax, ay):
        return m1 * l1 * (ax * c1 + ay * s1)

    @dataclasses.dataclass(frozen=True)
    class Pendulum(Arm):
        num_lengths = 1
        coordinates, rates, joints, prismatic = ("angle",), ("omega",), ("joint1",), (False,)
        sincos = {"angle": ("s1", "c1")}
        functions = (points, jacobian, jacobian_dot_qd, mass_matrix, bias_forces, gravity_forces)

    scene = rde.Scene(Pendulum((1.3,), (0.4,)), (e.Gravity(),), tolerance=1e-9)
    motion = rde.simulate(scene, [1e-4], [0.0], [1.0])
    assert motion.q[0, 0] == pytest.approx(1e-4 * np.cos(np.sqrt(9.81 / 0.4)), abs=1e-11)
    assert verify(scene, 16, Mode.QUICK).misses == ()


def test_there_is_one_reach_that_of_the_extent():
    from redundant_envs.envs.core import Core

    arm = arm_of(extent=("l1", "l2"), kind="ShortReach")
    scene = rde.load_scene("four_r_reach")
    effects = (e.Gravity(), e.EffortLimits((20.0, 10.0, 4.0)))
    short = dataclasses.replace(scene, robot=arm((0.5,) * 3, (0.4, 0.3, 0.2)), effects=effects)
    core = Core(short, 1, rde.ReachTask())
    assert core.reach == 0.4 + 0.3
    with pytest.raises(ValueError, match=r"the arm reaches 0.7 m"):
        core.checked({"goal": (0.8, 0.0)}, np.array([0]))


# ---- effects -----------------------------------------------------------------------------------------


def test_a_bind_that_no_function_takes_and_a_number_that_is_none_are_refused():
    @physics
    def drag(phid1):
        return -phid1

    @dataclasses.dataclass(frozen=True)
    class Drag(Effect):
        size: float = 1.0
        typo: bool = False

        static = ("typo",)

        def hooks(self, arm):
            return (Force(0, drag, {"phid_1": "phid2"} if self.typo else {}),)

    with pytest.raises(ValueError, match="bind has 'phid_1', which no function here takes; they take phid1"):
        rde.Scene(three_r.ThreeR((1.0,) * 3, (1.0,) * 3), (Drag(typo=True),))
    for size in (None, float("nan"), "1"):
        with pytest.raises(ValueError, match="size is"):
            rde.Scene(three_r.ThreeR((1.0,) * 3, (1.0,) * 3), (Drag(size),))


def test_a_state_of_an_effect_that_is_not_finite_is_told():
    @physics
    def grown(counter):
        return 1e200 * (counter + 1.0)

    @physics
    def nothing():
        return 0.0

    @dataclasses.dataclass(frozen=True)
    class Counter(Effect):
        def hooks(self, arm):
            state = e.State("counter", "", update=grown, bind={"counter": ".counter"})
            return (Force(0, nothing, states=(state,)),)

    batch = rde.BatchSimulator(rde.Scene(three_r.ThreeR((1.0,) * 3, (1.0,) * 3), (Counter(),)), 2)
    assert batch.advance().finite.all()
    status = batch.advance()
    assert np.isinf(batch.z).all()
    assert not status.finite.any()
    assert (status.numerics == rde.Numerics.NON_FINITE).all()


# ---- tasks -------------------------------------------------------------------------------------------


def made(**change):
    """An environment of the reach task with something changed."""
    fields = {n: v for n, v in change.items() if n in ("speed", "distance", "sa")}
    body = {n: v for n, v in change.items() if n not in fields}
    body["__annotations__"] = dict.fromkeys(fields, "float")
    task = dataclasses.dataclass(frozen=True)(type("OddTask", (rde.ReachTask,), {**body, **fields}))
    from redundant_envs.envs.core import Core

    return Core("four_r_reach", 1, task())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"speed": 0.3}, "parameters has 'speed'"),
        ({"distance": 0.3}, "parameters has 'distance'"),
        ({"memory": (*rde.ReachTask.memory, "tip_vx")}, "memory has 'tip_vx'"),
        ({"angles": {**rde.ReachTask.angles, "theta1": ("s1", "c1")}}, "angles has"),
        ({"updates": {"theta1": "distance"}}, "updates has 'theta1'; choose goal_x"),
        ({"moves": {"foo": "distance"}}, "moves has 'foo'"),
        ({"flags": ("foo",)}, "flags has 'foo'"),
        ({"labels": {"distance": "numerics"}}, "labels has 'numerics'"),
        ({"ranges": {"foo": (0, 1)}}, "ranges has 'foo'"),
        ({"draws": 1000}, "draws is 1000"),
        ({"observation": lambda self, scene: {}}, "observation is empty"),
        ({"reward_functions": lambda self, scene: ()}, "gives no term of its own"),
        ({"goal_conditioned": True}, "one reward term must be goal_reward"),
        ({"goal_conditioned": True, "goal_functions": ()}, "goal_functions is empty"),
    ],
)
def test_a_task_whose_names_mean_something_else_is_refused(change, said):
    with pytest.raises(ValueError, match=said):
        made(**change)


def test_sb3_environments_need_no_success():
    @physics(gives="near_only")
    def near_only(distance):
        """1 - distance"""
        return 1.0 - distance

    @dataclasses.dataclass(frozen=True)
    class Bare(rde.ReachTask):
        name = "BareReach"
        metrics = ("distance",)
        flags, labels, held_outputs = (), {}, ()

        def reward_functions(self, scene):
            return (near_only,)

    rde.register_task(Bare)
    env = rde.make_sb3("FourRBareReach-v0", 3)
    env.reset()
    infos = env.step(np.zeros((3, 4), np.float32))[3]
    assert infos == [{"TimeLimit.truncated": False}] * 3
    page = type(gym.make("redundant_envs/FourRBareReach-v0").unwrapped).__doc__
    assert "| near_only | `1 - distance` | `return_near_only` |" in page


# ---- registration ------------------------------------------------------------------------------------


def test_ids_that_clash_and_scenes_that_make_no_environment_are_refused():
    before = dict(IDS), dict(rde.robots.REGISTRY)
    clashing = dataclasses.dataclass(frozen=True)(type("RPRPGoal", (rde.FourR,), {"kind": "RPRPGoal"}))
    scene = rde.load_scene("four_r_reach").to_dict()
    with pytest.raises(ValueError, match="RPRPGoalReach-v0 is the id of"):
        rde.register_arm(clashing, {**scene, "robot": {**scene["robot"], "type": "RPRPGoal"}})
    other = arm_of(kind="OddArm")
    bare = {"robot": {"type": "OddArm", "masses": [1, 1, 1], "lengths": [1, 1, 1]}}
    with pytest.raises(ValueError, match="no EffortLimits"):
        rde.register_arm(other, bare)
    assert (dict(IDS), dict(rde.robots.REGISTRY)) == before
    with pytest.raises(ValueError, match="does not end with Vector or Env"):
        rde.register_task(type("T", (rde.ReachTask,), {"name": "ReachVector"}))
    with pytest.raises(ValueError, match="base of all effects"):
        rde.register_effect(Effect)


def test_a_task_whose_ids_clash_is_refused_and_the_next_one_is_registered():
    scene = rde.load_scene("four_r_reach").to_dict()
    arm = type("FourRNew", (rde.FourR,), {"kind": "FourRNew"})
    rde.register_arm(arm, {**scene, "robot": {**scene["robot"], "type": "FourRNew"}})
    before = dict(IDS), dict(rde.tasks.REGISTRY)
    with pytest.raises(
        ValueError, match="FourRNewReach-v0 is the id of the arm FourRNew with the task Reach"
    ):
        rde.register_task(type("NewReach", (rde.ReachTask,), {"name": "NewReach"}))
    assert (dict(IDS), dict(rde.tasks.REGISTRY)) == before
    rde.register_task(type("NextReach", (rde.ReachTask,), {"name": "NextReach"}))
    assert "redundant_envs/FourRNewNextReach-v0" in IDS


def test_another_scene_of_a_registered_arm_takes_its_place_and_is_a_copy():
    try:
        changed = copy.deepcopy(three_r.SCENE)
        changed["robot"]["lengths"] = [0.5, 0.35, 0.25]
        rde.register_arm(three_r.ThreeR, changed)
        changed["robot"]["lengths"][0] = 9.0
        assert gym.make("redundant_envs/ThreeRReach-v0").unwrapped.core.scene.robot.lengths[0] == 0.5
    finally:
        rde.register_arm(three_r.ThreeR, three_r.SCENE)
    assert gym.make("redundant_envs/ThreeRReach-v0").unwrapped.core.scene.robot.lengths[0] == 0.4


def test_sb3_environments_import_the_module_that_registers_them():
    assert rde.make_sb3("three_r:ThreeRReach-v0", 2).num_envs == 2
    with pytest.raises(ModuleNotFoundError, match="no_such_module"):
        rde.make_sb3("no_such_module:ThreeRReach-v0")


def test_numbers_for_joints_may_be_lists_and_arrays():
    arm = three_r.ThreeR((1.0,) * 3, (1.0,) * 3)
    scenes = [rde.Scene(arm, (e.ViscousFriction(c),)) for c in ([0.1, 0.2, 0.3], np.array([0.1, 0.2, 0.3]))]
    assert scenes[0] == scenes[1]
    assert scenes[0].effects[0].coefficients == (0.1, 0.2, 0.3)
