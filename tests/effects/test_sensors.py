"""Sensors of the package: what observations show, and that nothing else knows it."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from catalogue import FOUR_R
from envs.faces import with_effects

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects.sensor_delay import steps_back
from redundant_envs.language.algebra import physics, where

IDS = pytest.mark.parametrize("env_id", ["FourRReach-v0", "RPRPReach-v0"])
STEPS = 30
BIAS, SPEEDS = (0.03, -0.02, 0.05, 0.01), (0.2, -0.1, 0.3, 0.05)
WIDTHS = np.array((0.02, 0.05, 0.01, 0.03))


def made(env_id, *effects):
    """An environment whose scene has some effects more."""
    return gym.make(f"redundant_envs/{env_id}", scene=with_effects(env_id, *effects))


def many(env_id, *effects, count=4096):
    """Such a vector, after a reset, and how to read its states of sensors."""
    env = gym.make_vec(f"redundant_envs/{env_id}", count, scene=with_effects(env_id, *effects))
    env.reset(seed=0)
    core = env.unwrapped.core
    return env, lambda: core.memory.read([*core.simulator.dynamics.effect_states])


def motion(env):
    """An episode under random actions, by steps: true positions and rates of joints, states of sensors, and
    observations."""
    rng, core, rows = np.random.default_rng(3), env.unwrapped.core, []
    joints, names = env.unwrapped.scene.robot.motor_map, [*core.simulator.dynamics.effect_states]

    def record(obs):
        true = np.concatenate([env.unwrapped.q @ joints, env.unwrapped.qd @ joints])
        rows.append((true, core.memory.read(names)[0], obs))

    record(env.reset(seed=4, options={"q": [0.1, 0.2, -0.2, 0.15]})[0])
    for _ in range(STEPS):
        record(env.step(rng.uniform(-1.0, 1.0, 4).astype(np.float32))[0])
    return map(np.array, zip(*rows, strict=True))


def late(true, steps):
    """Readings of some steps before, on the line between two."""
    back = np.maximum(np.arange(STEPS + 1) - steps, 0.0)
    before, share = np.floor(back).astype(int), (back % 1.0)[:, None]
    return true[before] + share * (true[np.minimum(before + 1, STEPS)] - true[before])


def in_steps(true):
    return np.concatenate([WIDTHS * np.round(true[:, :4] / WIDTHS), true[:, 4:]], axis=1)


SHOWS = {
    "bias": (e.SensorBias(BIAS, SPEEDS), lambda true, states: true + np.array((*BIAS, *SPEEDS))),
    "steps": (e.Quantisation(tuple(WIDTHS)), lambda true, states: in_steps(true)),
    "noise": (e.SensorNoise((0.01, 0.02, 0.005, 0.01), 0.05), lambda true, states: true + states),
    "drops": (e.DroppedSamples((0.4, 0.0, 1.0, 0.5)), lambda true, states: states),
    **{
        f"delay {seconds}": (e.SensorDelay(seconds, 0.1), lambda true, states, k=k: late(true, k))
        for seconds, k in ((0.0, 0.0), (0.06, 3.0), (0.05, 2.5), (0.013, 0.65))
    },
}
"""Sensors, and the positions and rates of joints that they show, from true ones and states of the sensor."""


@pytest.mark.quick("FourRReach-v0-bias")
@pytest.mark.parametrize("what", SHOWS)
@IDS
def test_observations_are_those_of_an_arm_whose_joints_are_where_a_sensor_shows_them(env_id, what):
    effect, shows = SHOWS[what]
    env, plain = made(env_id, effect), made(env_id)
    true, states, observations = motion(env)
    shown, back = shows(true, states), np.linalg.inv(env.unwrapped.scene.robot.motor_map)
    plain.reset(seed=4)
    task, arm = plain.unwrapped.core, env.unwrapped.scene.robot
    for k, obs in enumerate(observations):
        task.memory.write(arm.coordinates, shown[k, :4] @ back)
        task.memory.write(arm.rates, shown[k, 4:] @ back)
        task.memory.write(task.goal_fields, env.unwrapped.goal)
        np.testing.assert_allclose(obs, task.observe()[0][0], atol=4e-7, err_msg=str(k))


@pytest.mark.long
@pytest.mark.parametrize(
    ("effects", "expected"),
    [((e.SensorBias(0.02), e.Quantisation(0.1)), 0.2), ((e.Quantisation(0.1), e.SensorBias(0.02)), 0.12)],
)
def test_sensors_act_in_the_order_of_the_scene(effects, expected):
    obs, _ = made("FourRReach-v0", *effects).reset(seed=0, options={"q": [0.14] * 4, "qd": [0.0] * 4})
    assert np.arctan2(obs[0], obs[1]) == pytest.approx(expected, abs=1e-6)


@pytest.mark.long
def test_the_noise_of_many_lanes_has_its_deviation_and_is_independent():
    deviations = np.array((0.01, 0.02, 0.005, 0.0, 0.3, 0.2, 0.1, 0.05))
    env, states = many("FourRReach-v0", e.SensorNoise(tuple(deviations[:4]), tuple(deviations[4:])))
    found = []
    for _ in range(20):
        found.append(states())
        env.step(np.zeros((4096, 4), np.float32))
    x = np.array(found)
    assert (x[..., 3] == 0.0).all()
    x = (np.delete(x, 3, axis=2) / np.delete(deviations, 3)).reshape(-1, 7)
    assert np.abs(x.mean(axis=0)).max() < 4.0 / np.sqrt(len(x))
    assert np.abs(x.T @ x / len(x) - np.eye(7)).max() < 4.0 * np.sqrt(2.0 / len(x))


def test_a_delay_within_rounding_of_whole_steps_is_these():
    """0.3 s are three steps of 0.1 s, though 0.3 / 0.1 is less than 3."""
    assert 0.3 / 0.1 < 3.0
    assert [float(steps_back(k * 0.1, 0.1)) for k in range(30)] == list(range(30))
    assert steps_back(0.25, 0.1) == 2.5
    for longest, control_dt, kept in ((0.3, 0.1, 4), (0.0, 0.1, 1), (1.023, 0.001, 1024)):
        scene = rde.Scene(FOUR_R, (e.SensorDelay(0.0, longest),), control_dt=control_dt)
        assert scene.effects[0].kept == kept


def test_lanes_have_delays_of_their_own():
    env, _ = many("FourRReach-v0", e.SensorDelay(0.0, 0.1), count=3)
    given = {"sensor_delay.seconds": np.array([0.0, 0.04, 0.1])}
    env.reset(seed=0, options={"parameters": given, "q": [0.1] * 4, "qd": [0.0] * 4})
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (9, 4)).astype(np.float32)
    rows = np.array([env.step(np.tile(a, (3, 1)))[0][:, :8] for a in actions])  # readings alone
    np.testing.assert_array_equal(rows[2:, 1], rows[:-2, 0])
    np.testing.assert_array_equal(rows[5:, 2], rows[:-5, 0])
    with pytest.raises(ValueError, match=r"SensorDelay.seconds is 0.11 s; it must lie in 0 to longest"):
        env.reset(options={"parameters": {"sensor_delay.seconds": np.array([0.0, 0.11, 0.1])}})


@pytest.mark.long
@IDS
def test_a_dropped_sample_is_the_last_one_that_arrived(env_id):
    true, shown, _ = motion(made(env_id, SHOWS["drops"][0]))
    arrived = np.isclose(shown, true, rtol=1e-13, atol=1e-15)
    assert arrived[0].all()
    assert arrived[:, [1, 5]].all()
    assert not arrived[1:, [2, 6]].any()
    for k in range(1, STEPS + 1):
        np.testing.assert_array_equal(shown[k, ~arrived[k]], shown[k - 1, ~arrived[k]])
    assert (arrived[:, 0] != arrived[:, 4]).any()


@pytest.mark.long
def test_samples_are_dropped_as_often_as_they_should():
    env, states = many("FourRReach-v0", e.DroppedSamples(0.3))
    before = states()
    env.step(np.ones((4096, 4), np.float32))
    same = states() == before
    assert abs(same.mean() - 0.3) < 4.0 * np.sqrt(0.21 / same.size)
    assert np.abs(np.corrcoef(same.T) - np.eye(8)).max() < 4.0 / 64.0


def test_motion_reward_and_info_know_the_truth():
    rows = []
    for effects in ((), (e.SensorBias(0.05), e.SensorDelay(0.05, 0.1))):
        env = made("FourRGoalReach-v0", *effects)
        obs, info = env.reset(seed=4)
        rows.append([(env.unwrapped.q, obs, 0.0, info)])
        for action in np.random.default_rng(3).uniform(-1.0, 1.0, (STEPS, 4)).astype(np.float32):
            obs, reward, _, _, info = env.step(action)
            rows[-1].append((env.unwrapped.q, obs, reward, info))
    for (q, one, reward, info), (other_q, other, other_reward, told) in zip(*rows, strict=True):
        np.testing.assert_array_equal(other_q, q)
        assert other_reward == reward
        assert told == pytest.approx(info, rel=1e-13, abs=1e-15)  # may be rounded differently
        assert np.abs(one["observation"] - other["observation"]).max() > 0.01


broken_above = physics(lambda phi1, limit: where(phi1 < limit, phi1, 1e300 * phi1 * 1e300))


@dataclasses.dataclass(frozen=True)
class Broken(e.Effect):
    limit: float

    def hooks(self, arm):
        return (e.Sensing(0, broken_above, {"limit": ".limit"}),)


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
