"""Modes of actions: the rates that they want, by another account, and the efforts that they ask for."""

import dataclasses

import numpy as np
import pytest
from catalogue import ARMS, GRAVITY

import redundant_envs as rde
from redundant_envs.effects.inner_control import bend
from redundant_envs.language.algebra import identity
from redundant_envs.robots.derived import coordinate_rates, joint_rates

e = rde.effects
DT = 1e-7
"""s: so short that accelerations are differences of rates, to six digits."""
FAR = 1e9
"""N m, N: limits that no effort nears."""
DAMPING, STIFFNESS, GAIN = 0.3, 4.0, 20.0
X = {"4R": (0.3, -0.7, 0.6, -0.2), "RPRP": (0.1, 1.0, 0.0, -0.4)}


def speeds(arm):
    return tuple(1.0 + 0.5 * k for k in range(len(arm.joints)))


def modes(name, limits=FAR):
    """All modes of an arm, and the number of commands of each."""
    arm = ARMS[name]
    n, own = len(arm.joints), (GAIN, limits)
    return {
        "joint_velocity": (e.JointVelocity(*own, speeds(arm)), n),
        "joint_position": (e.JointPosition(*own, 0.1, 2.0, STIFFNESS, speeds(arm)), n),
        "tip_velocity": (e.TipVelocity(*own, speeds(arm), 1.0, DAMPING), 2),
        "tip_and_posture": (e.TipAndPosture(*own, speeds(arm), 1.0, DAMPING, 1.0, X.get(name)), n),
    }


def wanted(name, mode, q, commands):
    """Rates of the joints (n,) that a mode wants."""
    arm, n = ARMS[name], len(commands)
    W = np.diag(speeds(arm))
    if mode == "joint_velocity":
        return commands
    if mode == "joint_position":
        rate = STIFFNESS * (0.1 + commands - q @ arm.motor_map)
        return rate / np.sqrt(1.0 + (rate / np.diag(W)) ** 2)
    A = arm.jacobian(q) @ coordinate_rates(arm) @ W
    matrix, posture = A @ A.T + DAMPING**2 * np.eye(2), np.zeros(len(W))
    if n > 2:
        rows = [] if name == "RRR" else [np.array(X[name])]
        across = [np.linalg.det([axis, *rows, *A]) for axis in np.eye(n)]
        posture = commands[-1] * np.array(across) / np.sqrt(np.linalg.det(matrix))
        posture += commands[2] * rows[0] if rows else 0.0
        assert np.allclose(A @ across, 0.0)
    s = posture + A.T @ np.linalg.solve(matrix, commands[:2] - A @ posture)
    length = np.linalg.norm(s)
    return W @ s / np.sqrt(1.0 + 4.0 * length**6 / (1.0 + 2.0 * length**2) ** 2)


@pytest.mark.quick(*(f"{name}-{mode}" for name in ("4R", "RRR") for mode in modes(name)))
@pytest.mark.parametrize("mode", modes("4R"))
@pytest.mark.parametrize("name", ["4R", "RPRP", "RRR"])
def test_rates_of_joints_approach_those_that_a_mode_wants_with_its_gain(name, mode):
    effect, count = modes(name)[mode]
    arm, rng = ARMS[name], np.random.default_rng(0)
    scene = rde.Scene(arm, (GRAVITY, e.CommandDelay(0.0, 0.0), effect), "rk4", DT)
    assert len(scene.command_units()) == count == len(scene.action_units())
    batch, joints = rde.BatchSimulator(scene, 5), joint_rates(arm)
    q, qd = rng.normal(0.0, 1.0, (2, 5, len(arm.joints)))
    commands = rng.normal(0.0, 0.7, (5, count))
    batch.set_state(q, qd)
    batch.advance(commands)
    found = (batch.qd - qd) @ joints.T / DT
    want = np.array([wanted(name, mode, one, c) for one, c in zip(q, commands, strict=True)])
    assert np.allclose(found, GAIN * (want - qd @ joints.T), rtol=2e-5, atol=2e-4)


def test_efforts_bend_smoothly_below_their_limits():
    efforts = np.linspace(-50.0, 50.0, 4001)
    bent = np.array([bend(x, 3.0) for x in efforts.tolist()])
    assert (np.diff(bent) > 0.0).all()
    assert np.abs(bent).max() < 3.0
    assert np.abs(bent / 3.0 - efforts / 3.0)[np.abs(efforts) <= 1.0].max() < 0.001


def test_friction_that_is_known_does_not_slow_the_joints_down():
    arm, effect = ARMS["4R"], e.JointVelocity(GAIN, FAR, 1.0, friction=0.7)
    scene = rde.Scene(arm, (GRAVITY, e.ViscousFriction(0.7), effect), "rk4", 0.01)
    motion = rde.simulate(scene, (0.3, 0.2, -0.4, 0.1), (0.0,) * 4, [1.5], (0.4, -0.3, 0.2, 0.1))
    assert np.allclose(motion.qd[-1] @ joint_rates(arm).T, (0.4, -0.3, 0.2, 0.1), atol=1e-6)


@pytest.mark.parametrize("mode", ["tip_velocity", "joint_velocity"])
def test_links_in_front_of_shared_commands_act_on_them(mode):
    arm, (mode, count) = ARMS["4R"], modes("4R")[mode]
    late, prompt = (
        rde.BatchSimulator(rde.Scene(arm, (GRAVITY, *delay, mode), "rk4", 0.01), 1)
        for delay in ((e.CommandDelay(0.01, 0.01),), ())
    )
    assert len(late.scene.states()) == 2 * count  # the commands of the present interval and the one before
    given, acting = np.random.default_rng(0).normal(0.0, 0.3, (3, count)), np.zeros(count)
    for command in given:
        late.advance(command[None])
        prompt.advance(acting[None])
        assert np.array_equal(late.q, prompt.q)
        acting = command


TIP = modes("4R")["tip_velocity"][0]


class TooMany(e.TipVelocity):
    def shared_commands(self, arm):
        return ("m/s",) * 5


@dataclasses.dataclass(frozen=True)
class Feeding(e.Effect):
    """A force that follows the command of the third motor."""

    def hooks(self, arm):
        return (e.Force(0, identity("command3")),)


@pytest.mark.parametrize(
    ("arm", "effects", "said"),
    [
        ("4R", (TIP, modes("4R")["tip_and_posture"][0]), "'tip_velocity' and 'tip_and_posture' both share"),
        ("4R", (TooMany(GAIN, FAR, 1.0, 1.0, 0.1),), "shares 5 commands .*; give it .* at most 4 commands"),
        ("4R", (TIP, Feeding()), "'feeding' takes command3, and there are 2 commands"),
        ("4R", (TIP, modes("4R")["joint_velocity"][0]), "'tip_velocity' and 'joint_velocity' both share"),
        (
            "PRPRP",
            (modes("PRPRP")["tip_and_posture"][0],),
            "is for an arm of three or four joints; .* has 5",
        ),
        ("RRR", (modes("4R")["tip_and_posture"][0],), "entries|direction"),
    ],
)
def test_modes_that_do_not_fit_are_refused(arm, effects, said):
    with pytest.raises(ValueError, match=said):
        rde.Scene(ARMS[arm], effects)


def test_an_effort_of_another_unit_needs_a_factor_and_its_name():
    with pytest.raises(ValueError, match=r"JointVelocity\.per_effort is 2\.0 without gives"):
        e.JointVelocity(GAIN, FAR, 1.0, per_effort=2.0)
    motors = rde.load_scene("slow_motors")
    mode = e.TipVelocity.for_scene(motors)
    assert (mode.gives, mode.limits) == ("V", (24.0,) * 4)
    assert mode.per_effort == pytest.approx([2.0 / 2.5, 2.5 / 2.0, 3.0 / 1.5, 4.0 / 1.0])
