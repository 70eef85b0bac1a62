"""Sensors change observations and nothing else."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from sensors import Encoders, SensorBias

import redundant_envs as rde
from redundant_envs.algebra import physics, where
from redundant_envs.effects import Armature, Effect, Reading, Sensing

BIAS = (0.03, -0.02, 0.05, 0.01)
SPEEDS = (0.2, -0.1, 0.3, 0.05)


def made(env_id, *effects):
    """An environment whose scene has some effects more."""
    scene = gym.make(f"redundant_envs/{env_id}").unwrapped.scene
    scene = dataclasses.replace(scene, effects=(*scene.effects, *effects)).to_dict()
    return gym.make(f"redundant_envs/{env_id}", scene=scene)


def motion(env, **parameters):
    """States, observations, rewards and information of an episode."""
    rng, core = np.random.default_rng(3), env.unwrapped
    obs, info = env.reset(seed=4, options={"parameters": parameters})
    rows = [(core.q, core.qd, obs, 0.0, info)]
    for _ in range(30):
        obs, reward, _, _, info = env.step(rng.uniform(-1.0, 1.0, 4).astype(np.float32))
        rows.append((core.q, core.qd, obs, reward, info))
    return [list(column) for column in zip(*rows, strict=True)]


def test_motion_reward_and_info_know_the_truth():
    true = motion(made("FourRGoalReach-v0"))
    read = motion(made("FourRGoalReach-v0", SensorBias(BIAS, SPEEDS), Encoders(0.01)))
    for k in (0, 1, 3):
        np.testing.assert_array_equal(read[k], true[k])
    # Outputs about a state may be rounded differently if observations need other numbers.
    for told, known in zip(read[4], true[4], strict=True):
        assert told == pytest.approx(known, rel=1e-13, abs=1e-15)
    for place in ("achieved_goal", "desired_goal"):
        told, known = ([o[place] for o in x[2]] for x in (read, true))
        np.testing.assert_allclose(told, known, rtol=1e-13, atol=1e-15)
    told, known = (np.array([o["observation"] for o in x[2]]) for x in (read, true))
    assert np.abs(told - known).max() > 0.01


def test_a_sensor_that_an_episode_biases_shows_what_an_arm_elsewhere_shows():
    biases = {"sensor_bias.positions": BIAS, "sensor_bias.rates": SPEEDS}
    q, qd, read, *_ = motion(made("FourRReach-v0", SensorBias()), **biases)
    env = made("FourRReach-v0")
    env.reset(seed=4)
    goal, inverse = env.unwrapped.goal, np.linalg.inv(env.unwrapped.scene.robot.motor_map)
    for k in range(len(q)):
        there = {"q": q[k] + np.array(BIAS) @ inverse, "qd": qd[k] + np.array(SPEEDS) @ inverse}
        np.testing.assert_allclose(read[k], env.reset(options={**there, "goal": goal})[0], atol=3e-7)


@pytest.mark.parametrize(
    ("effects", "expected"),
    [
        ((SensorBias(0.02), Encoders(0.1)), 0.2),
        ((Encoders(0.1), SensorBias(0.02)), 0.12),
    ],
)
def test_encoders_count_in_steps_and_sensors_act_in_the_order_of_the_scene(effects, expected):
    obs, _ = made("FourRReach-v0", *effects).reset(seed=0, options={"q": [0.14] * 4, "qd": [0.0] * 4})
    assert np.arctan2(obs[0], obs[1]) == pytest.approx(expected, abs=1e-6)


@dataclasses.dataclass(frozen=True)
class Told(Effect):
    """A second sensor of a rate, which uses a quantity that follows from that rate."""

    def hooks(self, arm):
        return (Sensing(0, physics(lambda rate, T: rate + 0.0 * T), {"rate": "phid1"}, Reading.RATE),)


class EnergyTask(rde.ReachTask):
    name = "EnergyTold"
    metrics = (*rde.ReachTask.metrics, "T")


def test_a_sensor_that_asks_for_more_changes_nothing_that_is_true():
    rde.register_task(EnergyTask)
    rde.register_effect(Told)
    env = made("FourREnergyTold-v0", Armature(0.5), SensorBias(0.0, (3.0, 0.0, 0.0, 0.0)), Told()).unwrapped
    env.reset(seed=1)
    for _ in range(3):
        *_, info = env.step(np.full(4, 0.5, np.float32))
    true = env.scene.loaded_robot.kinetic_energy(env.q, env.qd)
    assert info["T"] == pytest.approx(float(true), rel=1e-12)


@physics
def broken_above(phi1, limit):
    return where(phi1 < limit, phi1, 1e300 * phi1 * 1e300)


@dataclasses.dataclass(frozen=True)
class Broken(Effect):
    limit: float

    def hooks(self, arm):
        return (Sensing(0, broken_above, {"limit": ".limit"}),)


@pytest.mark.parametrize(("limit", "fault"), [(0.31, rde.Numerics.NON_FINITE), (9.0, 0)])
def test_a_reading_that_is_no_number_is_a_fault(limit, fault):
    rde.register_effect(Broken)
    env = made("FourRReach-v0", Broken(limit))
    env.reset(seed=0, options={"q": [0.3] * 4, "qd": [2.0] * 4})
    obs, _, terminated, _, info = env.step(np.zeros(4, np.float32))
    assert terminated == bool(fault)
    _, start = env.reset(seed=0, options={"q": [0.4] * 4})
    assert (info["numerics"], start["numerics"]) == (fault, fault)
    assert env.observation_space.contains(obs)
