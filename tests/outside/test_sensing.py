"""Sensors change observations and nothing else."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from armature import Armature
from sensors import Encoders, SensorBias

import redundant_envs as rde
from redundant_envs.algebra import physics, where
from redundant_envs.effects import Effect, Reading, Sensing

IDS = {
    "4R": ("redundant_envs/FourRReach-v0", "four_r_reach"),
    "RPRP": ("redundant_envs/RPRPReach-v0", "rprp_reach"),
}
BIAS = (0.03, -0.02, 0.05, 0.01)
SPEEDS = (0.2, -0.1, 0.3, 0.05)


def scene_with(name, *effects):
    scene = rde.load_scene(IDS[name][1])
    return dataclasses.replace(scene, effects=(*scene.effects, *effects)).to_dict()


def motion(name, *effects, goal=False):
    """States, observations, rewards and information of an episode."""
    env = gym.make(
        IDS[name][0].replace("Reach", "GoalReach" if goal else "Reach"), scene=scene_with(name, *effects)
    )
    rng, core = np.random.default_rng(3), env.unwrapped
    obs, info = env.reset(seed=4)
    rows = [(core.q, core.qd, obs, 0.0, info)]
    for _ in range(30):
        obs, reward, _, _, info = env.step(rng.uniform(-1.0, 1.0, 4).astype(np.float32))
        rows.append((core.q, core.qd, obs, reward, info))
    return [list(column) for column in zip(*rows, strict=True)]


@pytest.mark.parametrize("goal", [False, True])
@pytest.mark.parametrize("name", [pytest.param("4R", marks=pytest.mark.long), "RPRP"])
def test_motion_reward_and_info_know_the_truth(name, goal):
    true = motion(name, goal=goal)
    read = motion(name, SensorBias(BIAS, SPEEDS), Encoders(0.01), goal=goal)
    for k in (0, 1, 3):
        np.testing.assert_array_equal(read[k], true[k])
    # Outputs about a state may be rounded differently if observations need other numbers.
    for told, known in zip(read[4], true[4], strict=True):
        assert told == pytest.approx(known, rel=1e-13, abs=1e-15)
    if goal:
        for place in ("achieved_goal", "desired_goal"):
            told, known = ([o[place] for o in x[2]] for x in (read, true))
            np.testing.assert_allclose(told, known, rtol=1e-13, atol=1e-15)
        read[2], true[2] = ([o["observation"] for o in x[2]] for x in (read, true))
    assert np.abs(np.array(read[2]) - np.array(true[2])).max() > 0.01


@pytest.mark.parametrize("name", ["4R", pytest.param("RPRP", marks=pytest.mark.long)])
def test_a_biased_sensor_shows_what_an_arm_elsewhere_shows(name):
    q, qd, read, *_ = motion(name, SensorBias(BIAS, SPEEDS))
    arm = rde.load_scene(IDS[name][1]).robot
    inverse = np.linalg.inv(arm.motor_map)
    env = gym.make(IDS[name][0], scene=scene_with(name))
    env.reset(seed=4)
    goal = env.unwrapped.goal
    compared = 0
    for k in range(len(q)):
        there = q[k] + np.array(BIAS) @ inverse
        joints = there @ arm.motor_map
        if not all(0.0 <= joints[i] <= 0.25 for i in arm.sliders()):
            continue  # an arm cannot be beyond its stops; a sensor may read so
        shown, _ = env.reset(options={"q": there, "qd": qd[k] + np.array(SPEEDS) @ inverse, "goal": goal})
        np.testing.assert_allclose(read[k], shown, atol=3e-7)
        compared += 1
    assert compared > 5


def test_encoders_count_in_steps_and_sensors_act_in_the_order_of_the_scene():
    def posture(*effects):
        env = gym.make(IDS["4R"][0], scene=scene_with("4R", *effects))
        obs, _ = env.reset(seed=0, options={"q": [0.14, 0.14, 0.14, 0.14], "qd": [0.0] * 4})
        return float(np.arctan2(obs[0], obs[1]))

    assert posture() == pytest.approx(0.14, abs=1e-6)
    assert posture(Encoders(0.1)) == pytest.approx(0.1, abs=1e-6)
    assert posture(SensorBias(0.02), Encoders(0.1)) == pytest.approx(0.2, abs=1e-6)
    assert posture(Encoders(0.1), SensorBias(0.02)) == pytest.approx(0.12, abs=1e-6)


def test_all_faces_read_the_same():
    scene = scene_with("RPRP", SensorBias(BIAS, SPEEDS), Encoders(0.005))
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3, 4)).astype(np.float32)
    vector = gym.make_vec(IDS["RPRP"][0], num_envs=3, scene=scene)
    sb3 = rde.make_sb3(IDS["RPRP"][0], 3, scene=scene)
    sb3.seed(5)
    single = gym.make(IDS["RPRP"][0], scene=scene)
    first = vector.reset(seed=[5, 6, 7])[0]
    np.testing.assert_array_equal(first, sb3.reset())
    np.testing.assert_array_equal(first[1], single.reset(seed=6)[0])
    for a in actions:
        seen = vector.step(a)[0]
        np.testing.assert_array_equal(seen, sb3.step(a)[0])
        np.testing.assert_array_equal(seen[1], single.step(a[1])[0])


def test_numbers_of_sensors_are_parameters_of_an_episode():
    env = gym.make(IDS["4R"][0], scene=scene_with("4R", SensorBias()))
    start = {"q": [0.3] * 4, "qd": [0.0] * 4, "goal": [0.5, 0.5]}
    seen = [
        env.reset(seed=0, options={**start, "parameters": {"sensor_bias.positions": bias}})[0]
        for bias in (0.0, 0.1, 0.0)
    ]
    np.testing.assert_array_equal(seen[0], seen[2])
    assert np.abs(seen[0] - seen[1]).max() > 0.05


@dataclasses.dataclass(frozen=True)
class Told(Effect):
    """A second sensor of a rate, which uses a quantity that follows from that rate."""

    def hooks(self, arm):
        return (Sensing(0, with_energy, {"rate": "phid1"}, Reading.RATE),)


@physics
def with_energy(rate, T):
    return rate + 0.0 * T


@physics(gives="energy_told")
def energy_told(T):
    return 1.0 * T


@dataclasses.dataclass(frozen=True)
class EnergyTask(rde.ReachTask):
    name = "EnergyTold"
    metrics = (*rde.ReachTask.metrics, "energy_told")

    def functions(self, scene):
        return (*super().functions(scene), energy_told)


def test_a_sensor_that_asks_for_more_changes_nothing_that_is_true():
    rde.register_task(EnergyTask)
    rde.register_effect(Told)
    scene = rde.load_scene("four_r_reach")
    effects = (*scene.effects, Armature(0.5), SensorBias(0.0, (3.0, 0.0, 0.0, 0.0)), Told())
    scene = dataclasses.replace(scene, effects=effects)
    env = gym.make("redundant_envs/FourREnergyTold-v0", scene=scene.to_dict())
    env.reset(seed=1)
    for _ in range(3):
        *_, info = env.step(np.full(4, 0.5, np.float32))
    true = scene.loaded_robot.kinetic_energy(env.unwrapped.q, env.unwrapped.qd)
    assert info["energy_told"] == pytest.approx(float(true), rel=1e-12)


@physics
def broken_above(phi1, limit):
    return where(phi1 < limit, phi1, 1e300 * phi1 * 1e300)


@dataclasses.dataclass(frozen=True)
class Broken(Effect):
    limit: float

    def hooks(self, arm):
        return (Sensing(0, broken_above, {"limit": ".limit"}),)


@pytest.mark.parametrize(("limit", "ends"), [(0.31, True), (9.0, False)])
def test_a_reading_that_is_no_number_is_a_fault(limit, ends):
    rde.register_effect(Broken)
    env = gym.make(IDS["4R"][0], scene=scene_with("4R", Broken(limit)))
    env.reset(seed=0, options={"q": [0.3] * 4, "qd": [2.0] * 4})
    obs, _, terminated, _, info = env.step(np.zeros(4, np.float32))
    assert terminated == ends
    _, start = env.reset(seed=0, options={"q": [0.4] * 4})
    assert start["numerics"] == (rde.Numerics.NON_FINITE if ends else 0)
    assert info["numerics"] == (rde.Numerics.NON_FINITE if ends else 0)
    assert env.observation_space.contains(obs)


def test_encoders_without_steps_are_refused():
    with pytest.raises(ValueError, match=r"Encoders.resolution is 0.0; it must be positive"):
        Encoders(0.0)
