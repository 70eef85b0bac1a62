"""Topics of the API, in the order in which users meet them: names, and an example that uses each of them."""

from __future__ import annotations

from typing import NamedTuple

import redundant_envs as rde
from redundant_envs import control, verify


class Topic(NamedTuple):
    """A page: title, what it is about, an example that runs, and names by the modules that have them."""

    title: str
    about: str
    example: str
    names: dict[str, tuple[str, ...]]


RDE, EFFECTS, CONTROL = "redundant_envs", "redundant_envs.effects", "redundant_envs.control"
HOOKS = tuple(
    name for name in rde.effects.__all__ if getattr(rde.effects, name) not in rde.effects.OWN.values()
)
"""What effects are made of: all that is no effect of the package."""
EVENTS = ("Friction", "Gap", "Impact", "Impulse", "Instant", "Obstacle")
MOTORS = ("Actuation", "Link", "InnerControl", "Sensing", "Reading")
CONTROLLERS = ("ComputedTorque", "OperationalSpace", "ResolvedMotion", "HoldingLQR", "ReachCost", "ilqr_plan")
TOPICS = {
    "environments": Topic(
        "Environments",
        "What `gym.make` gives; its keyword arguments are those of the class.",
        """
import gymnasium as gym
import redundant_envs as rde
from redundant_envs.envs.env import ArmEnv

env: ArmEnv = gym.make("redundant_envs/TwoRReach-v0", accuracy="exact").unwrapped
observation, info = env.reset(seed=0, options={"goal": (0.3, 0.4)})
assert rde.Numerics(info["numerics"]) == rde.Numerics(0)  # no fault
""",
        {"redundant_envs.envs.env": ("ArmEnv",), RDE: ("Numerics",)},
    ),
    "vectors": Topic(
        "Vectors of environments", "What `gym.make_vec` gives, and the same for stable-baselines3 and torch.",
        """
import gymnasium as gym
import redundant_envs as rde
from redundant_envs.envs.sb3 import SB3VecEnv, make_sb3
from redundant_envs.envs.torch_env import ArmTorchVectorEnv, make_torch
from redundant_envs.envs.vector_env import ArmVectorEnv

envs: ArmVectorEnv = gym.make_vec("redundant_envs/TwoRReach-v0", num_envs=8)
rde.check_vec_env(envs)
for_stable_baselines3: SB3VecEnv = make_sb3("redundant_envs/TwoRReach-v0", 8)
of_tensors: ArmTorchVectorEnv = make_torch("redundant_envs/TwoRReach-v0", 8, device="cpu")
""",
        {
            "redundant_envs.envs.vector_env": ("ArmVectorEnv",), RDE: ("check_vec_env",),
            "redundant_envs.envs.sb3": ("make_sb3", "SB3VecEnv"),
            "redundant_envs.envs.torch_env": ("make_torch", "ArmTorchVectorEnv"),
        },
    ),
    "scenes": Topic(
        "Scenes", "A scene is an arm and the effects that act on it; environments and simulations take one.",
        """
import redundant_envs as rde

scene = rde.load_scene("four_r_reach")
plain = rde.Scene(scene.robot, effects=(rde.effects.Gravity(),), tolerance=1e-9)
assert rde.load_scene(plain.to_dict()) == plain
""",
        {RDE: ("load_scene", "Scene")},
    ),
    "effects": Topic(
        "Effects", "A scene names the effects that it has; each has a page.",
        """
from redundant_envs import RPRP, Scene
from redundant_envs.effects import Gravity, PrismaticStop

stop = PrismaticStop(lower=(0.0, 0.0), upper=(0.25, 0.25), restitution=0.5)
scene = Scene(RPRP((0.5,) * 4, (0.25, 0.25)), effects=(Gravity(), stop))
""",
        {EFFECTS: tuple(name for name in rde.effects.__all__ if name not in HOOKS)},
    ),
    "arms": Topic(
        "Arms", "[Their methods](arm.md) take states of any leading shape and give the report's quantities.",
        """
import redundant_envs as rde

arm = rde.RPRP(masses=(0.5, 0.5, 0.5, 0.5), lengths=(0.25, 0.25))
q, qd = (0.3, 0.1, -0.4, 0.2), (1.0, 0.0, 0.0, 0.5)
J, M = arm.jacobian(q), arm.mass_matrix(q)
energy = arm.kinetic_energy(q, qd) + arm.potential_energy(q)
others = rde.FourR((0.5,) * 4, (0.25,) * 4), rde.TwoR((1.0, 1.0), (0.5, 0.5))
chain = rde.Chain("RRR", (0.5,) * 3, (0.25,) * 3)
assert all(isinstance(one, rde.Arm) for one in (arm, *others, chain))
""",
        {RDE: ("RPRP", "FourR", "TwoR", "Chain")},
    ),
    "arm": Topic(
        "What arms can do", "The base of all [arms](arms.md), and of your own.",
        """
import redundant_envs as rde

arm: rde.Arm = rde.FourR((0.5,) * 4, (0.25,) * 4)
tip = arm.forward_kinematics((0.1, 0.2, 0.3, 0.4))
""",
        {RDE: ("Arm",)},
    ),
    "simulate": Topic(
        "Simulate", "A motion of a scene from a state, without an environment, and its picture.",
        """
import redundant_envs as rde
from redundant_envs.model.trajectory import Trajectory

scene = rde.load_scene("rprp_stops")
motion: Trajectory = rde.simulate(scene, q=(0.3, 0.2, -0.4, 0.1), qd=(0, 0, 0, 0), times=[0.0, 0.5, 1.0])
assert all(isinstance(event, rde.Event) for event in motion.events)
frame = rde.animate(motion).frame(-1)
""",
        {RDE: ("simulate", "Event", "animate"), "redundant_envs.model.trajectory": ("Trajectory",)},
    ),
    "batch": Topic(
        "Batches", "Many copies of a scene at once, without a task.",
        """
import numpy as np
import redundant_envs as rde

batch = rde.BatchSimulator(rde.load_scene("four_r_reach"), num_envs=512)
batch.set_state(np.zeros((512, 4)), np.zeros((512, 4)))
batch.advance(np.zeros((512, 4)))
""",
        {RDE: ("BatchSimulator",)},
    ),
    "costs": Topic(
        "What a scene costs", "The program of a scene, and its operations by what needs them.",
        """
import redundant_envs as rde

scene = rde.load_scene("worn_joints")
operations = rde.bill(scene)["coulomb_friction"]
program = rde.listing(scene)
""",
        {RDE: ("bill", "listing")},
    ),
    "verify": Topic(
        "Verify", "Is a scene simulated right? [Accuracy](../../accuracy.md) says what is compared.",
        """
import redundant_envs as rde
from redundant_envs.verify import Mode, Report, Subject, Verdict, subject_from, subjects_of, verify

scene = rde.load_scene("four_r_free")
report: Report = verify(scene, states=2, mode=Mode.QUICK)
assert report.good and all(outcome.verdict is not Verdict.MISSED for outcome in report.outcomes)
subject: Subject = subject_from("my scene", scene)
others = subjects_of(["rprp_reach", "redundant_envs/FourRReach-v0"])
""",
        {"redundant_envs.verify": tuple(verify.__all__)},
    ),
    "control": Topic(
        "Controllers", "The page on [control](../../control.md) compares them.",
        """
import numpy as np
import redundant_envs as rde
from redundant_envs.control import (
    ComputedTorque, HoldingLQR, OperationalSpace, ReachCost, ResolvedMotion, ilqr_plan,
)

scene = rde.load_scene("four_r_reach")
q, qd, goals = np.full((1, 4), 0.3), np.zeros((1, 4)), np.array([[0.3, 0.4]])
controller = ComputedTorque(scene)
controller.begin(q, goals)
action = controller.action(0.0, q, qd)
holding, operational, resolved = HoldingLQR(scene, q), OperationalSpace(scene), ResolvedMotion(scene)
plan = ilqr_plan(scene, ReachCost(scene.robot, goals, hold=15), q, qd, np.zeros((30, 1, 4)), rounds=1)
""",
        {CONTROL: CONTROLLERS},
    ),
    "poses": Topic(
        "Poses, loads and null spaces", "What [controllers](control.md) are made of, for many poses at once.",
        """
import numpy as np
import redundant_envs as rde
from redundant_envs import control

scene, goals = rde.load_scene("four_r_reach"), np.array([[0.3, 0.4]])
arm, start = scene.robot, np.zeros((1, 4))
near, light = control.pose_at(scene, start, goals), control.lightest_pose(scene, start, goals)
load = control.holding_load(scene, goals)  # the least of control.holding_poses
efforts, leaning = control.static_efforts(scene, near), control.motor_efforts(scene, near)
J, A = arm.jacobian(near), control.kinematic_mobility(arm)
N = control.null_projector(J, A)
basis = control.null_basis(J, A, control.posture_row(arm))
sliding = rde.load_scene("rprp_reach")
gradients = (
    control.load_gradient(scene), control.manipulability_gradient(scene), control.centring_gradient(sliding),
)
""",
        {CONTROL: tuple(name for name in control.__all__ if name not in CONTROLLERS)},
    ),
    "tasks": Topic(
        "Tasks", "[The protocol](../../tasks/Task.md) of goals, rewards and observations has its own page.",
        """
import redundant_envs as rde

scene, task = rde.load_scene("four_r_reach"), rde.ReachTask(goal_tolerance=0.01)
assert isinstance(task, rde.Task) and issubclass(rde.GoalReachTask, rde.ReachTask)
meaning = task.observation(scene)
""",
        {RDE: ("Task", "ReachTask", "GoalReachTask")},
    ),
    "extend": Topic(
        "Register your own", "[Extending](../../extending.md) shows a file of each kind.",
        """
import redundant_envs as rde

heun = rde.Tableau("heun_of_the_manual", order=2, a=((), (1.0,)), b=(0.5, 0.5), c=(0.0, 1.0))
rde.register_integrator(heun)
""",
        {RDE: ("register_arm", "register_effect", "register_task", "register_integrator", "Tableau")},
    ),
    "hooks": Topic(
        "Effects of your own", "An effect gives hooks; [extending](../../extending.md#effects) makes one.",
        """
from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects import Effect, Field, Force, Friction, Inertia, Point, PointMass, State


@physics
def drag(rate, damping):
    return -damping * rate


@physics
def warming(rate, damping):
    return damping * rate * rate


@physics
def shaken(shake):
    return shake, 0.0


@physics
def dry(grip):
    return grip


@dataclass(frozen=True)
class Workshop(Effect):
    damping: float = 0.1  # N m s
    shake: float = 0.5  # m/s^2
    grip: float = 0.05  # N m
    rotor: float = 0.01  # kg m^2
    load: float = 0.2  # kg

    def hooks(self, arm):
        heat = State("heat", "J", derivative=warming)
        return (
            Force(0, drag, states=(heat,)), Field(shaken), Friction(1, dry), Inertia((2,), ".rotor"),
            PointMass(Point(3), ".load"),
        )


scene = rde.Scene(rde.FourR((0.5,) * 4, (0.25,) * 4), effects=(Workshop(),), tolerance=1e-6)
motion = rde.simulate(scene, q=(0.1, 0.2, 0.3, 0.4), qd=(1.0, 0.0, 0.0, 0.0), times=[0.1])
""",
        {EFFECTS: tuple(name for name in HOOKS if name not in (*EVENTS, *MOTORS))},
    ),
    "events": Topic(
        "Dry friction, impacts and instants of your own",
        "[Hooks](hooks.md) of what happens at a time within an interval.",
        """
from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import minimum, physics
from redundant_envs.effects import Effect, Gap, Impact, Impulse, Instant, Obstacle, Point


@physics
def above(tip_y, floor):
    return tip_y - floor


@physics
def kick(blow):
    return blow, 0.0


@physics
def moment(delay):
    return delay


@physics
def over_a_line(ya, yb, floor):
    return minimum(ya, yb) - floor


@dataclass(frozen=True)
class Room(Effect):
    floor: float = -0.9  # m
    bounce: float = 0.5
    blow: float = 0.1  # N s
    delay: float = 0.005  # s

    def hooks(self, arm):
        return (
            Gap(above, ".bounce"), Impulse(Point(3), kick, when="instant"), Instant(moment),
            Obstacle(over_a_line),
        )


@dataclass(frozen=True)
class Ends(Effect):
    lower: float = 0.0  # m
    upper: float = 0.3  # m
    bounce: float = 0.0

    def hooks(self, arm):
        return tuple(Impact(joint, ".lower", ".upper", ".bounce") for joint in arm.sliders())


scene = rde.Scene(rde.RPRP((0.5,) * 4, (0.25, 0.25)), effects=(Room(), Ends()), tolerance=1e-6)
motion = rde.simulate(scene, q=(0.1, 0.1, 0.3, 0.2), qd=(1.0, 0.0, 0.0, 0.0), times=[0.1])
""",
        {EFFECTS: EVENTS},
    ),
    "motors": Topic(
        "Motors and sensors of your own", "[Hooks](hooks.md) from commands to motors, and of observations.",
        """
from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects import Actuation, Effect, InnerControl, Link, Reading, Sensing


@physics
def worn(command, efficiency):
    return efficiency * command


@physics
def shifted(reading, shift):
    return reading + shift


@dataclass(frozen=True)
class WornMotors(Effect):
    efficiency: float = 0.9
    shift: float = 0.01  # rad/s

    def hooks(self, arm):
        joints = range(len(arm.joints))
        motors = tuple(Actuation(k, worn, link=Link.GEAR) for k in joints)
        return (*motors, *(Sensing(k, shifted, reading=Reading.RATE) for k in joints))


effects = rde.effects.Gravity(), rde.effects.EffortLimits((20.0, 12.0, 8.0, 4.0)), WornMotors()
scene = rde.Scene(rde.FourR((0.5,) * 4, (0.25,) * 4), effects=effects, tolerance=1e-6)
motion = rde.simulate(scene, q=(0.1,) * 4, qd=(0.0,) * 4, times=[0.1], efforts=(1.0, 0.0, 0.0, 0.0))
assert issubclass(rde.effects.JointVelocity, InnerControl)  # a mode of actions of your own says what it wants
""",
        {EFFECTS: MOTORS},
    ),
}  # fmt: skip
