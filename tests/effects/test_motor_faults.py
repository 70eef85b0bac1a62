"""Faults of one motor: when they begin, what they cut, and that a closed brake holds its joint exactly."""

import gymnasium as gym
import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, advanced, stops

import redundant_envs as rde
from redundant_envs import effects as e

CART = rde.Chain("P", (2.0,), ())
"""A mass of 2 kg on a rail."""
FULL = np.array([20.0, 12.0, 8.0, 4.0])
HOW = {"rk8": {}, "1e-6": {"tolerance": 1e-6}, "dop853": {"integrator": "dop853"}}
WITH = pytest.mark.parametrize("how", HOW.values(), ids=HOW)
BOTH = pytest.mark.parametrize("fault", [e.MotorBrake, e.MotorLoss])
LANES = np.arange(8)


@BOTH
@pytest.mark.parametrize(
    ("at", "control_dt", "first"),
    [(0.0, 0.02, 0), (0.1, 0.02, 5), (0.09, 0.02, 5), (0.3, 0.1, 3), (1e-6, 0.02, 1)],
)
def test_a_fault_begins_with_the_first_interval_that_begins_then_or_later(fault, at, control_dt, first):
    batch, _ = advanced(rde.Scene(CART, (fault(0, at),), control_dt=control_dt), [0.0], [0.0], intervals=0)
    active = []
    for _ in range(first + 2):
        active.append(batch.z[0, 1])
        rate = batch.qd[0, 0]
        batch.advance([[1.0]])
        assert (batch.qd[0, 0] > rate) == (active[-1] == 0.0)
    assert active == [0.0] * first + [1.0, 1.0]


@WITH
@pytest.mark.quick("4R-1e-6")
@pytest.mark.parametrize("arm", [FOUR_R, RPRP], ids=["4R", "RPRP"])
def test_a_brake_does_nothing_before_it_closes_and_then_holds_its_joint_to_the_bit(arm, how):
    """Each lane brakes a joint of its own; the angle of a joint may be a difference of coordinates, which
    are rounded. Until then there is not even another step."""
    rng, joint = np.random.default_rng(7), LANES % 4
    q, efforts = rng.uniform(-0.5, 0.5, (8, 4)), rng.choice([-1.0, 1.0], (30, 8, 4)) * FULL
    bare = e.Gravity(), e.ViscousFriction(0.5)
    free, _ = advanced(rde.Scene(arm, bare, **how), q, 0.0 * q, intervals=0)
    scene = rde.Scene(arm, (*bare, e.MotorBrake(0, 0.1)), **how)
    batch, _ = advanced(scene, q, 0.0 * q, change={"motor_brake.joint": joint}, intervals=0)
    for now in efforts[:5]:
        status, other = batch.advance(now), free.advance(now)
        np.testing.assert_array_equal(status.evaluations, other.evaluations)
    np.testing.assert_allclose(batch.q, free.q, rtol=0.0, atol=1e-10)
    assert np.abs(batch.qd @ arm.motor_map)[LANES, joint].min() > 0.0
    batch.advance(efforts[5])
    start = (batch.q @ arm.motor_map)[LANES, joint]
    for now in efforts[6:]:
        assert not batch.advance(now).numerics.any()
        rates = batch.qd @ arm.motor_map
        assert not rates[LANES, joint].any()
        moved = (batch.q @ arm.motor_map)[LANES, joint] - start
        assert (np.abs(moved) <= 4.0 * np.spacing(np.abs(batch.q).max())).all()
        assert not moved[joint == 0].any()
    assert rates.any(axis=0).all()


HARD = e.JointStop((None, -0.4, None, -0.3), (None, 0.4, None, 0.3), 0.5)


@pytest.mark.parametrize(
    ("arm", "joint", "start", "hard"),
    [
        (RPRP, 2, [-1.5, 0.1, 0.3, 0.1], stops(RPRP)), (RPRP, 1, [-1.5, 0.3, 0.3, 0.1], stops(RPRP)),
        (FOUR_R, 2, [-0.5, -0.3, -0.4, -0.2], HARD),
    ],
    ids=["RPRP", "RPRP at its stop", "4R"],
)  # fmt: skip
def test_an_impact_does_not_move_a_joint_that_a_brake_holds(arm, joint, start, hard):
    scene = rde.Scene(arm, (e.Gravity(), e.MotorBrake(joint, 0.0), hard), tolerance=1e-6)
    batch, _ = advanced(scene, start, np.zeros(4), intervals=0)
    place = (batch.q @ arm.motor_map)[0, joint]
    status = [batch.advance([[2.0, -1.0, 0.5, 1.0]]) for _ in range(40)]
    assert sum(s.events[0] for s in status) > 2
    assert not any(s.numerics[0] for s in status)
    assert (batch.qd @ arm.motor_map)[0, joint] == 0.0
    assert abs((batch.q @ arm.motor_map)[0, joint] - place) <= 4.0 * np.spacing(np.abs(batch.q).max())


@pytest.mark.quick("4R")
@pytest.mark.parametrize(
    ("arm", "types", "start", "hard"),
    [(FOUR_R, "RRR", [-0.5, -0.3, -0.4, -0.2], HARD), (RPRP, "PRP", [-1.5, 0.1, 0.3, 0.1], stops(RPRP))],
    ids=["4R", "RPRP"],
)
def test_an_arm_whose_first_joint_is_braked_is_one_with_a_joint_less_impacts_included(
    arm, types, start, hard
):
    """Its axes are turned so that +x is along the first link."""
    less, turn = rde.Chain(types, arm.masses[1:], arm.lengths[1:]), start[0]
    ends = e.JointStop(HARD.lower[1:], HARD.upper[1:], 0.5) if arm is FOUR_R else stops(less)
    gravity = e.Gravity(down=(-np.sin(turn), -np.cos(turn)))
    angles = turn * np.array([name.startswith("theta") for name in less.coordinates])
    braked, _ = advanced(
        rde.Scene(arm, (e.Gravity(), e.MotorBrake(0, 0.0), hard), tolerance=1e-9), start, [0.0] * 4
    )
    other, _ = advanced(rde.Scene(less, (gravity, ends), tolerance=1e-9), start[1:] - angles, [0.0] * 3)
    impacts = 0
    for efforts in np.random.default_rng(5).uniform(-0.2, 0.2, (30, 4)) * FULL:
        status = braked.advance(efforts[None]), other.advance(efforts[None, 1:])
        assert not any(s.numerics[0] for s in status)
        impacts += status[0].events[0]
        np.testing.assert_allclose(braked.q[0, 1:] - angles, other.q[0], rtol=0.0, atol=1e-12)
    assert impacts > 5


@pytest.mark.quick("1e-6")
@WITH
def test_impacts_beside_a_brake_come_to_an_end(how):
    """One slider strikes and pushes the other off its stop, and so on."""
    arm = rde.RPRP((0.5,) * 4, (0.25,) * 2)
    scene = rde.Scene(arm, (e.Gravity(), stops(arm, 0.0, 0.0, 0.25), e.MotorBrake(0, 0.0)), **how)
    motion = (0.726, 0.0, -0.707, 0.249), (0.0, 0.0, -3.249, 1.271), (1.3, -31.9, -3.7, -2.3)
    batch, status = advanced(scene, *motion)
    assert not status.numerics.any()
    assert status.events[0] > 2
    assert batch.qd[0, 0] == 0.0


CHAINS = {
    "nothing": (),
    "lag and delay": (e.CommandDelay(0.03, 0.1), e.Lag(0.05)),
    "a motor with a coil": (e.DCMotor(2.0, 0.05, 0.3, 1.5),),
    "a gear": (e.GearBacklash(0.0, 500.0, 0.02, 10.0),),
}


@pytest.mark.quick("lag and delay-last", "a gear-first")
@pytest.mark.parametrize("behind", [False, True], ids=["last", "first"])
@pytest.mark.parametrize("chain", CHAINS.values(), ids=CHAINS)
def test_a_lost_motor_gives_no_effort_whatever_is_before_it_in_its_chain(chain, behind):
    loss = e.MotorLoss(0, 0.1)
    scene = rde.Scene(CART, (loss, *chain) if behind else (*chain, loss), tolerance=1e-9)
    batch, _ = advanced(scene, [0.0], [0.0], [[3.0]], intervals=5)
    rate = batch.qd[0, 0]
    assert rate != 0.0
    for _ in range(5):
        batch.advance([[3.0]])
        assert batch.qd[0, 0] == rate


@WITH
def test_a_lost_motor_is_one_without_command(how):
    rng, joint = np.random.default_rng(2), LANES % 4
    q, efforts = rng.uniform(-1.0, 1.0, (8, 4)), rng.uniform(-1.0, 1.0, (8, 4)) * FULL
    change = {"motor_loss.joint": joint, "motor_loss.at": 0.02 * (LANES % 3)}
    scene = rde.Scene(FOUR_R, (e.Gravity(), e.MotorLoss(0, 0.0)), **how)
    batch, _ = advanced(scene, q, 0.0 * q, change=change, intervals=0)
    other = rde.BatchSimulator(scene, 8)
    other.set_parameters({"motor_loss.at": 1e9})
    other.set_state(q, 0.0 * q)
    for k in range(5):
        batch.advance(efforts)
        other.advance(np.where((joint[:, None] == np.arange(4)) & (LANES[:, None] % 3 <= k), 0.0, efforts))
    np.testing.assert_array_equal(batch.q, other.q)


RANGES = {"motor_brake.joint": {"choice": [0, 1, 2, 3]}, "motor_brake.at": {"uniform": [0.0, 0.1]}}


def test_every_episode_draws_joint_and_time():
    scene = rde.load_scene("four_r_reach").to_dict()
    brakes = [{"type": "MotorBrake", "joint": 0, "at": 0.0}, {"type": "MotorLoss", "joint": 3, "at": 0.02}]
    scene |= {"effects": scene["effects"] + brakes, "randomize": RANGES}
    envs = gym.make_vec("redundant_envs/FourRReach-v0", num_envs=16, scene=scene)
    for seed in (1, 2):
        envs.reset(seed=seed)
        joint = envs.unwrapped.parameters["motor_brake.joint"].value
        for _ in range(8):
            envs.step(np.ones((16, 4), np.float32))
        rates = np.abs(envs.unwrapped.qd @ FOUR_R.motor_map)
        assert set(joint) == {0.0, 1.0, 2.0, 3.0}
        assert not rates[np.arange(16), joint.astype(int)].any()
