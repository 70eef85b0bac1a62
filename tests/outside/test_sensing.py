"""Sensors change observations and nothing else."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from sensors import EccentricEncoders, FilteredRates

import redundant_envs as rde
from redundant_envs.algebra import physics, where
from redundant_envs.effects import Effect, Sensing


def made(env_id, *effects):
    """An environment whose scene has some effects more."""
    scene = gym.make(f"redundant_envs/{env_id}").unwrapped.scene
    scene = dataclasses.replace(scene, effects=(*scene.effects, *effects)).to_dict()
    return gym.make(f"redundant_envs/{env_id}", scene=scene)


def motion(env):
    """States, observations, rewards and information of an episode."""
    rng, core = np.random.default_rng(3), env.unwrapped
    obs, info = env.reset(seed=4)
    rows = [(core.q, core.qd, obs, 0.0, info)]
    for _ in range(30):
        obs, reward, _, _, info = env.step(rng.uniform(-1.0, 1.0, 4).astype(np.float32))
        rows.append((core.q, core.qd, obs, reward, info))
    return [list(column) for column in zip(*rows, strict=True)]


def test_motion_reward_and_info_know_the_truth():
    true = motion(made("FourRGoalReach-v0"))
    read = motion(made("FourRGoalReach-v0", EccentricEncoders(0.05), FilteredRates(0.05)))
    for k in (0, 1, 3):
        np.testing.assert_array_equal(read[k], true[k])
    # Outputs about a state may be rounded differently if observations need other numbers.
    for told, known in zip(read[4], true[4], strict=True):
        assert told == pytest.approx(known, rel=1e-13, abs=1e-15)
    told, known = (np.array([o["observation"] for o in x[2]]) for x in (read, true))
    assert np.abs(told - known).max() > 0.01


@pytest.mark.long
@pytest.mark.parametrize("env_id", ["FourRReach-v0", "RPRPReach-v0"])
def test_sensors_from_outside_show_what_an_arm_elsewhere_shows(env_id):
    q, qd, read, *_ = motion(made(env_id, EccentricEncoders(0.05), FilteredRates(0.05)))
    env = made(env_id)
    env.reset(seed=4)
    core, arm = env.unwrapped.core, env.unwrapped.scene.robot
    inverse, rates = np.linalg.inv(arm.motor_map), qd[0] @ arm.motor_map
    turns = np.array([not slides for slides in arm.prismatic])
    for k in range(len(q)):
        rate, position = qd[k] @ arm.motor_map, q[k] @ arm.motor_map
        rates = rate + (rates - rate) * np.exp(-env.unwrapped.scene.control_dt / 0.05)
        core.memory.write(arm.coordinates, (position + 0.05 * turns * np.sin(position)) @ inverse)
        core.memory.write(arm.rates, rates @ inverse)
        np.testing.assert_allclose(read[k], core.observe()[0][0], atol=4e-7)


broken_above = physics(lambda phi1, limit: where(phi1 < limit, phi1, 1e300 * phi1 * 1e300))


@dataclasses.dataclass(frozen=True)
class Broken(Effect):
    limit: float

    def hooks(self, arm):
        return (Sensing(0, broken_above, {"limit": ".limit"}),)


@pytest.mark.quick("0.31-1")
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
