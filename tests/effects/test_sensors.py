"""Sensors of the package: what observations show, and what stays true."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

from redundant_envs import effects as e
from redundant_envs.effects.sensor_delay import steps_back

IDS = pytest.mark.parametrize("env_id", ["FourRReach-v0", "RPRPReach-v0"])
STEPS = 30
BIAS = (0.03, -0.02, 0.05, 0.01)
SPEEDS = (0.2, -0.1, 0.3, 0.05)


def made(env_id, *effects, **changes):
    """An environment whose scene has some effects more."""
    scene = gym.make(f"redundant_envs/{env_id}").unwrapped.scene
    scene = dataclasses.replace(scene, effects=(*scene.effects, *effects), **changes).to_dict()
    return gym.make(f"redundant_envs/{env_id}", scene=scene)


def states_of(env, key):
    """States of an effect by the last part of their names, of a single environment."""
    core = env.unwrapped.core
    names = [n for n in core.simulator.dynamics.effect_states if n.startswith(f"{key}.")]
    return dict(zip((n.partition(".")[2] for n in names), core.memory.read(names)[0], strict=True))


@dataclasses.dataclass
class Motion:
    """An episode under random actions: what is true, what is observed, states of an effect, row by row."""

    q: list
    qd: list
    obs: list
    rewards: list
    infos: list
    states: list


def motion(env, key="", steps=STEPS, **options):
    rng, core, found = np.random.default_rng(3), env.unwrapped, Motion([], [], [], [], [], [])

    def record(obs, reward, info):
        row = (core.q, core.qd, obs, reward, info, states_of(env, key))
        for field, value in zip(dataclasses.fields(found), row, strict=True):
            getattr(found, field.name).append(value)

    obs, info = env.reset(seed=4, options=options)
    record(obs, 0.0, info)
    for _ in range(steps):
        obs, reward, _, _, info = env.step(rng.uniform(-1.0, 1.0, 4).astype(np.float32))
        record(obs, reward, info)
    return found


def joints_of(scene, *rows):
    """Positions or rates of joints from coordinates or velocities."""
    return [np.array(row) @ scene.robot.motor_map for row in rows]


def assert_shows(env_id, env, found, positions, rates, rows=None):
    """Observations are those of an arm whose joints have some positions and rates."""
    plain, scene = made(env_id), env.unwrapped.scene
    plain.reset(seed=4)
    goal, back = env.unwrapped.goal, np.linalg.inv(scene.robot.motor_map)
    task = plain.unwrapped.core
    for k in range(len(found.q)) if rows is None else rows:
        task.memory.write(scene.robot.coordinates, positions[k] @ back)
        task.memory.write(scene.robot.rates, rates[k] @ back)
        task.memory.write(task.goal_fields, goal)
        shown, _ = task.observe()
        np.testing.assert_allclose(found.obs[k], shown[0], atol=4e-7, err_msg=str(k))


SENSORS = {
    "bias": (e.SensorBias(BIAS, SPEEDS),),
    "steps": (e.Quantisation(0.02, 0.1),),
    "noise": (e.SensorNoise(0.01, 0.05),),
    "delay": (e.SensorDelay(0.03, 0.1),),
    "drops": (e.DroppedSamples(0.3),),
    "all": (
        e.SensorBias(BIAS, SPEEDS), e.SensorNoise(0.01, 0.05), e.Quantisation(0.02, 0.1),
        e.SensorDelay(0.03, 0.1), e.DroppedSamples(0.3),
    ),
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize(
    ("what", "env_id"),
    [*zip(SENSORS, ["FourRReach-v0", "RPRPReach-v0"] * 3, strict=True), ("all", "FourRReach-v0")],
)
def test_motion_reward_and_info_know_the_truth(env_id, what):
    """Each sensor on one of the arms, all of them on both."""
    true, read = motion(made(env_id)), motion(made(env_id, *SENSORS[what]))
    for name in ("q", "qd", "rewards"):
        np.testing.assert_array_equal(getattr(read, name), getattr(true, name))
    # Outputs about a state may be rounded differently if observations need other numbers.
    for told, known in zip(read.infos, true.infos, strict=True):
        assert dict(told) == pytest.approx(dict(known), rel=1e-13, abs=1e-15)
    assert np.abs(np.array(read.obs) - np.array(true.obs)).max() > 0.003


@pytest.mark.quick("FourRReach-v0")
@IDS
def test_a_bias_that_an_episode_sets_shows_an_arm_elsewhere(env_id):
    env = made(env_id, e.SensorBias(0.0, 0.0))
    given = {"sensor_bias.position": BIAS, "sensor_bias.rate": SPEEDS}
    found = motion(env, parameters=given)
    positions, rates = joints_of(env.unwrapped.scene, found.q, found.qd)
    assert_shows(env_id, env, found, positions + BIAS, rates + SPEEDS)


@pytest.mark.long
@IDS
def test_steps_are_whole_and_the_nearest_ones(env_id):
    env = made(env_id, e.Quantisation((0.02, 0.05, 0.01, 0.03)))
    found, steps = motion(env), np.array((0.02, 0.05, 0.01, 0.03))
    positions, rates = joints_of(env.unwrapped.scene, found.q, found.qd)
    assert_shows(env_id, env, found, steps * np.round(positions / steps), rates)


@pytest.mark.long
@pytest.mark.parametrize(
    ("effects", "expected"),
    [
        ((e.SensorBias(0.02), e.Quantisation(0.1)), 0.2),
        ((e.Quantisation(0.1), e.SensorBias(0.02)), 0.12),
    ],
)
def test_sensors_act_in_the_order_of_the_scene(effects, expected):
    obs, _ = made("FourRReach-v0", *effects).reset(seed=0, options={"q": [0.14] * 4, "qd": [0.0] * 4})
    assert np.arctan2(obs[0], obs[1]) == pytest.approx(expected, abs=1e-6)


# ---- noise -----------------------------------------------------------------------------------------------


@pytest.mark.long
@IDS
def test_noise_is_added_to_each_reading_also_at_the_start(env_id):
    env = made(env_id, e.SensorNoise((0.01, 0.02, 0.005, 0.01), 0.05))
    found = motion(env, "sensor_noise", q=[0.1, 0.2, -0.2, 0.15])
    errors = np.array([list(row.values()) for row in found.states])
    assert len(np.unique(errors)) == errors.size == 8 * (STEPS + 1)
    positions, rates = joints_of(env.unwrapped.scene, found.q, found.qd)
    assert_shows(env_id, env, found, positions + errors[:, :4], rates + errors[:, 4:])


@pytest.mark.long
def test_the_noise_of_many_lanes_has_its_deviation_and_is_independent():
    deviations = np.array((0.01, 0.02, 0.005, 0.0, 0.3, 0.2, 0.1, 0.05))
    scene = made("FourRReach-v0", e.SensorNoise(tuple(deviations[:4]), tuple(deviations[4:]))).unwrapped.scene
    env = gym.make_vec("redundant_envs/FourRReach-v0", 4096, scene=scene.to_dict())
    env.reset(seed=0)
    core, found = env.unwrapped.core, []
    names = [*core.simulator.dynamics.effect_states]
    for _ in range(20):
        found.append(core.memory.read(names))
        env.step(np.zeros((4096, 4), np.float32))
    x = np.array(found)
    assert (x[..., 3] == 0.0).all()
    x = np.delete(x, 3, axis=2) / np.delete(deviations, 3)
    count = x.shape[0] * x.shape[1]
    assert np.abs(x.mean(axis=(0, 1))).max() < 4.0 / np.sqrt(count)
    assert np.abs(x.var(axis=(0, 1)) - 1.0).max() < 4.0 * np.sqrt(2.0 / count)
    flat = x.reshape(-1, 7)
    assert np.abs(flat.T @ flat / count - np.eye(7)).max() < 4.0 * np.sqrt(2.0 / count)
    for a, b in ((x[1:], x[:-1]), (x[:, 1:], x[:, :-1])):
        assert np.abs((a * b).mean(axis=(0, 1))).max() < 4.0 / np.sqrt(a.size / 7)


# ---- delay -----------------------------------------------------------------------------------------------

DELAYS = {0.0: 0.0, 0.02: 1.0, 0.06: 3.0, 0.05: 2.5, 0.07: 3.5, 0.1: 5.0, 0.013: 0.65}
"""Delays, s, and as many control steps of 0.02 s."""


@pytest.mark.long
@IDS
@pytest.mark.parametrize("seconds", DELAYS)
def test_a_delay_shows_what_was_on_the_line_between_readings(env_id, seconds):
    env = made(env_id, e.SensorDelay(0.0, 0.1))
    given = {"parameters": {"sensor_delay.seconds": seconds}, "q": [0.1, 0.2, -0.2, 0.15], "qd": [0.3] * 4}
    found = motion(env, **given)
    back = np.maximum(np.arange(STEPS + 1) - DELAYS[seconds], 0.0)
    before, share = np.floor(back).astype(int), (back % 1.0)[:, None]
    shown = []
    for x in joints_of(env.unwrapped.scene, found.q, found.qd):
        shown.append(x[before] + share * (x[np.minimum(before + 1, STEPS)] - x[before]))
    assert_shows(env_id, env, found, *shown)


@pytest.mark.long
def test_whole_steps_show_kept_readings_bit_for_bit():
    """0.3 s are three steps of 0.1 s, though 0.3 / 0.1 is less than 3."""
    assert 0.3 / 0.1 < 3.0
    assert [float(steps_back(k * 0.1, 0.1)) for k in range(30)] == list(range(30))
    assert steps_back(0.25, 0.1) == 2.5
    env = made("FourRReach-v0", e.SensorDelay(0.3, 0.3), control_dt=0.1)
    plain = made("FourRReach-v0", e.SensorDelay(0.0, 0.0), control_dt=0.1)
    late, prompt = (motion(x, steps=8, qd=[0.0] * 4) for x in (env, plain))
    own = [n for n in range(env.unwrapped.core.obs_size) if not np.array_equal(late.obs[3], prompt.obs[3])]
    assert own
    kept = [env.unwrapped.scene.effects[-1].kept, plain.unwrapped.scene.effects[-1].kept]
    assert kept == [4, 1]
    of_arm = slice(0, 8)  # sines and cosines of the readings
    np.testing.assert_array_equal(np.array(late.obs)[3:, of_arm], np.array(prompt.obs)[:-3, of_arm])


def test_lanes_have_delays_of_their_own():
    scene = made("FourRReach-v0", e.SensorDelay(0.0, 0.1)).unwrapped.scene.to_dict()
    env = gym.make_vec("redundant_envs/FourRReach-v0", 3, scene=scene)
    seconds = np.array([0.0, 0.04, 0.1])
    options = {"parameters": {"sensor_delay.seconds": seconds}, "q": [0.1] * 4, "qd": [0.0] * 4}
    env.reset(seed=0, options=options)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (9, 4)).astype(np.float32)
    rows = np.array([env.step(np.tile(a, (3, 1)))[0][:, :8] for a in actions])
    np.testing.assert_array_equal(rows[2:, 1], rows[:-2, 0])
    np.testing.assert_array_equal(rows[5:, 2], rows[:-5, 0])
    options["parameters"]["sensor_delay.seconds"] = np.array([0.0, 0.11, 0.1])
    with pytest.raises(ValueError, match=r"SensorDelay.seconds is 0.11 s; it must lie in 0 to longest"):
        env.reset(options=options)


# ---- dropped samples -------------------------------------------------------------------------------------


@pytest.mark.long
@IDS
def test_a_dropped_sample_shows_the_last_one_that_arrived(env_id):
    env = made(env_id, e.DroppedSamples((0.4, 0.0, 1.0, 0.5)))
    found = motion(env, "dropped_samples", q=[0.1, 0.2, -0.2, 0.15])
    shown = np.array([list(row.values()) for row in found.states])
    true = np.concatenate(joints_of(env.unwrapped.scene, found.q, found.qd), axis=1)
    arrived = np.isclose(shown, true, rtol=1e-13, atol=1e-15)
    assert arrived[0].all()
    assert arrived[:, [1, 5]].all()
    assert not arrived[1:, [2, 6]].any()
    for k in range(1, STEPS + 1):
        np.testing.assert_array_equal(shown[k, ~arrived[k]], shown[k - 1, ~arrived[k]])
    assert 0 < arrived[1:, 0].sum() < STEPS
    assert (arrived[:, 0] != arrived[:, 4]).any()
    assert_shows(env_id, env, found, shown[:, :4], shown[:, 4:])


@pytest.mark.long
def test_samples_are_dropped_as_often_as_they_should():
    scene = made("FourRReach-v0", e.DroppedSamples(0.3)).unwrapped.scene.to_dict()
    env = gym.make_vec("redundant_envs/FourRReach-v0", 4096, scene=scene)
    env.reset(seed=0)
    core = env.unwrapped.core
    names = [*core.simulator.dynamics.effect_states]
    before = core.memory.read(names)
    env.step(np.ones((4096, 4), np.float32))
    same = core.memory.read(names) == before
    assert abs(same.mean() - 0.3) < 4.0 * np.sqrt(0.21 / same.size)
    assert np.abs(np.corrcoef(same.T) - np.eye(8)).max() < 4.0 / 64.0


# ---- what they cost, and what is refused -------------------------------------------------------------------

NOTHING = {
    "noise": (e.SensorNoise(0.0, 0.0),),
    "delay": (e.SensorDelay(0.0, 0.1),),
    "drops": (e.DroppedSamples(0.0),),
}


@pytest.mark.quick("noise-FourRReach-v0")
@IDS
@pytest.mark.parametrize("what", NOTHING)
def test_sensors_without_an_error_show_the_bits_of_good_ones(env_id, what):
    """Of ones that add nothing: the observation then is computed from readings in both."""
    good, other = (motion(made(env_id, *x)) for x in ((e.SensorBias(0.0, 0.0),), NOTHING[what]))
    np.testing.assert_array_equal(good.obs, other.obs)
