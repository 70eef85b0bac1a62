"""Arms, effects, a task, an integrator and an observation from outside the package work like its own."""

import dataclasses
import json
import pickle
import subprocess
import sys
from pathlib import Path

import actuator_lag
import elbow
import gymnasium as gym
import held_command
import heun
import numpy as np
import pytest
import rrp
import three_r
import track
from arms import ADDED, ARMS, states
from gymnasium.utils.env_checker import check_env

import redundant_envs as rde
import redundant_envs.backends.torch
from redundant_envs.backends.torch import torch
from redundant_envs.lane.direct import cross_interval, fields_of
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.interval import Interval
from redundant_envs.verify import Mode, verify

e = rde.effects
FOLDER = Path(__file__).parent
IDS = [
    f"redundant_envs/{name}-v0"
    for name in ("ThreeRReach", "RRPReach", "RRPTrack", "FourRTrack", "ThreeRElbowReach")
]


# ---- compiled, on single numbers, on NumPy and on torch ------------------------------------------------

WITH_STATES = (actuator_lag.ActuatorLag(0.04), held_command.HeldCommand(), e.EffortLimits(3.0))
STEPS = {"heun": {"integrator": "heun", "substeps": 3}, "rk8": {}, "1e-6": {"tolerance": 1e-6}}


@pytest.mark.parametrize(
    ("name", "steps"),
    [
        (name, steps) if name in ADDED else pytest.param(name, steps, marks=pytest.mark.long)
        for name in ARMS
        for steps in STEPS
    ],
)
def test_evaluators_agree_after_an_interval(name, steps):
    arm = ARMS[name]
    stops = (
        (e.PrismaticStop([-0.1] * len(arm.sliders()), [0.1] * len(arm.sliders()), 0.0),)
        if arm.sliders()
        else ()
    )
    scene = rde.Scene(arm, (e.Gravity(), e.ViscousFriction(0.1), *stops, *WITH_STATES), **STEPS[steps])
    q, qd, efforts = states(arm, 12)
    batch = rde.BatchSimulator(scene, 12)
    batch.set_state(q, qd)
    batch.advance(efforts)
    q, qd, z = batch.q, batch.qd, batch.z
    batch.advance(efforts)
    compiled = np.concatenate([batch.q, batch.qd, batch.z], axis=1)
    dynamics = Dynamics(scene)
    names = (*arm.coordinates, *arm.rates, *dynamics.effect_states)
    table = np.concatenate([q, qd, z, efforts], axis=1)
    for convert in (np.ascontiguousarray, lambda x: torch.tensor(np.ascontiguousarray(x))):
        columns = map(convert, table.T)
        fields = {**fields_of(dynamics), **dict(zip((*names, *dynamics.commands), columns, strict=True))}
        fields |= {n: convert(np.zeros(12)) for n in dynamics.active}
        with np.errstate(all="ignore"):
            lane = cross_interval(Interval(dynamics), fields)
        found = np.stack([np.asarray(lane[n]) for n in names], axis=1)
        resting = batch._memory.read(dynamics.active).any(axis=1) if stops else np.zeros(12, bool)
        assert np.abs(found - compiled)[~resting].max() <= 1e-12 * np.abs(compiled).max()
    row = {
        **fields_of(dynamics),
        **dict(zip((*names, *dynamics.commands), map(np.float64, table[0]), strict=True)),
    }
    with np.errstate(all="ignore"):
        lane = cross_interval(Interval(dynamics), row)
    if not resting[0]:
        assert np.abs([lane[n] for n in names] - compiled[0]).max() <= 1e-12 * np.abs(compiled).max()


@pytest.mark.parametrize("name", ADDED)
def test_torch_steps_agree_with_compiled_ones_and_have_gradients(name):
    arm = ARMS[name]
    scene = rde.Scene(arm, (e.Gravity(), *WITH_STATES[:2]), tolerance=1e-7)
    q, qd, efforts = (torch.tensor(x) for x in states(arm, 4))
    z = torch.linspace(-1.0, 1.0, 4 * 6, dtype=torch.float64).reshape(4, 6)
    step = rde.torch_step(scene)
    moved = step(q, qd, efforts, z=z)
    batch = rde.BatchSimulator(scene, 4)
    batch.set_state(q.numpy(), qd.numpy())
    batch._memory.write(tuple(Dynamics(scene).effect_states), z.numpy())
    batch.advance(efforts.numpy())
    for found, compiled in zip(moved, (batch.q, batch.qd, batch.z), strict=True):
        assert np.abs(found.numpy() - compiled).max() < 1e-12 * max(1.0, np.abs(compiled).max())
    z.requires_grad_(True)
    step(q, qd, efforts, z=z)[1].sum().backward()
    shift = 1e-5 * torch.eye(24, dtype=torch.float64)[0].reshape(4, 6)
    with torch.no_grad():
        up, down = (step(q, qd, efforts, z=z + s)[1].sum() for s in (shift, -shift))
    assert abs(float(z.grad[0, 0]) - float((up - down) / 2e-5)) < 1e-6
    with pytest.raises(ValueError, match="z is missing"):
        step(q, qd, efforts)


# ---- environments --------------------------------------------------------------------------------------


@pytest.mark.parametrize("env_id", [*(pytest.param(x, marks=pytest.mark.long) for x in IDS[:2]), *IDS[2:]])
def test_single_vector_and_sb3_environments_are_sound_and_have_the_same_bits(env_id):
    single, vector = gym.make(env_id), gym.make_vec(env_id, num_envs=11)
    sb3 = rde.make_sb3(env_id, 11)
    check_env(single.unwrapped, skip_render_check=True)
    rde.check_vec_env(gym.make_vec(env_id, num_envs=3))
    rde.check_vec_env(rde.make_sb3(env_id, 3))
    obs, _ = vector.reset(seed=4)
    sb3.seed(4)
    assert np.array_equal(obs, sb3.reset())
    assert np.array_equal(obs[2], single.reset(seed=6)[0])
    rng = np.random.default_rng(0)
    for _ in range(20):
        actions = rng.uniform(-1.0, 1.0, vector.action_space.shape).astype(np.float32)
        obs, reward, *_, info = vector.step(actions)
        same, same_reward, *_ = sb3.step(actions)
        one, one_reward, *_, one_info = single.step(actions[2])
        assert np.array_equal(obs, same)
        assert np.array_equal(reward.astype(np.float32), same_reward)
        assert np.array_equal(obs[2], one)
        assert reward[2] == one_reward
        assert info["distance"][2] == one_info["distance"]
    assert (
        len(set(map(len, (single.unwrapped.core.task.observation(single.unwrapped.core.scene), obs[0])))) == 1
    )


@pytest.mark.parametrize("env_id", IDS[1:3])
def test_environments_copy_render_and_tell_of_themselves(env_id):
    env = gym.make(env_id, render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(3):
        env.step(env.action_space.sample())
    picture = env.render()
    assert picture.shape == (480, 480, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
    json.dumps(dataclasses.asdict(env.spec)["kwargs"])
    page = type(env.unwrapped).__doc__
    assert "effort at r / 16 N" in page
    twin = pickle.loads(pickle.dumps(env.unwrapped))
    action = np.full(3, 0.3, np.float32)
    assert np.array_equal(env.unwrapped.step(action)[0], twin.step(action)[0])


def test_a_target_moves_before_it_is_measured_and_observed():
    env = gym.make("redundant_envs/RPRPTrack-v0", task={"period": 2.0}).unwrapped
    env.reset(seed=0, options={"goal": (0.6, 0.0)})
    for k in range(1, 6):
        _, _, _, _, info = env.step(np.zeros(4, np.float32))
        angle = 2.0 * np.pi * 0.02 * k / 2.0
        assert np.allclose(env.goal, 0.6 * np.array([np.cos(angle), np.sin(angle)]), atol=1e-14)
        assert info["distance"] == pytest.approx(np.linalg.norm(env.goal - env.tip), abs=1e-14)


def test_a_target_stays_while_a_fault_holds_its_lane():
    env = gym.make("redundant_envs/RPRPTrack-v0", on_bad_action="terminate").unwrapped
    env.reset(seed=0)
    goal = env.goal
    _, _, terminated, *_ = env.step(np.full(4, np.nan, np.float32))
    assert terminated
    assert np.array_equal(env.goal, goal)


def test_effects_with_states_begin_anew_with_each_episode():
    scene = {**three_r.SCENE}
    scene["effects"] = [*scene["effects"], {"type": "ActuatorLag", "time_constant": 0.1}]
    env = gym.make_vec("redundant_envs/ThreeRReach-v0", num_envs=9, scene=scene, max_episode_steps=5)
    env.reset(seed=0)
    memory = env.unwrapped.core.memory
    names = tuple(env.unwrapped.core.simulator.dynamics.effect_states)
    for _ in range(5):
        env.step(np.ones((9, 3), np.float32))
        assert memory.read(names).min() > 0.1
    env.step(np.ones((9, 3), np.float32))
    assert not memory.read(names).any()
    restored = env.unwrapped.get_state()
    first = env.step(np.ones((9, 3), np.float32))[0]
    env.unwrapped.set_state(restored)
    assert np.array_equal(env.step(np.ones((9, 3), np.float32))[0], first)


def test_a_method_added_from_outside_converges_with_its_order():
    arm, errors = ARMS["4R"], []
    q, qd, efforts = states(arm, 1)
    exact = rde.BatchSimulator(rde.Scene(arm, (e.Gravity(),), tolerance=1e-12))
    exact.set_state(q, qd)
    exact.advance(efforts)
    for steps in (8, 16, 32):
        batch = rde.BatchSimulator(rde.Scene(arm, (e.Gravity(),), integrator="heun", substeps=steps))
        batch.set_state(q, qd)
        batch.advance(efforts)
        errors.append(np.abs(batch.q - exact.q).max())
    assert np.allclose(np.log2(np.divide(errors[:-1], errors[1:])), heun.HEUN.order, atol=0.15)


def test_one_more_observation_has_its_value():
    env = gym.make("redundant_envs/FourRElbowReach-v0").unwrapped
    obs, _ = env.reset(seed=3)
    height, reach = env.core.scene.robot.points(env.q)[1, 1], env.core.reach
    assert obs[-1] == np.float32(height / np.sqrt(reach**2 + height**2))
    assert len(obs) % 2 == 1
    assert elbow.ElbowReachTask.name == "ElbowReach"


@pytest.mark.parametrize("data", [pytest.param(three_r.SCENE, marks=pytest.mark.long), rrp.SCENE], ids=ADDED)
def test_verify_finds_scenes_of_added_arms_and_effects_right(data):
    lag = {"type": "ActuatorLag", "time_constant": 0.05}
    found = verify(rde.load_scene({**data, "effects": [*data["effects"], lag]}), 64, Mode.QUICK)
    assert found.misses == ()
    assert found.of("tolerance kept").finding.found == 0.0


# ---- registration --------------------------------------------------------------------------------------


def test_registering_again_does_nothing_and_other_things_of_the_name_are_refused():
    rde.register_arm(three_r.ThreeR, three_r.SCENE)
    rde.register_task(track.TrackTask)
    rde.register_integrator(heun.HEUN)
    other = type("ThreeR", (rde.FourR,), {"kind": "ThreeR"})
    with pytest.raises(ValueError, match="'ThreeR' is taken"):
        rde.register_arm(other)
    with pytest.raises(ValueError, match="'rk4' is taken"):
        rde.register_integrator(dataclasses.replace(heun.HEUN, name="rk4"))
    with pytest.raises(ValueError, match="weights of the tableau"):
        rde.register_integrator(dataclasses.replace(heun.HEUN, name="wrong", b=(0.5, 0.6)))
    with pytest.raises(ValueError, match=r"derived from redundant_envs\.Task"):
        rde.register_task(three_r.ThreeR)
    with pytest.raises(ValueError, match="one with a robot of type ThreeR"):
        rde.register_arm(three_r.ThreeR, "rprp_reach")


def test_scenes_of_an_arm_from_outside_are_plain_data():
    scene = rde.load_scene(rrp.SCENE)
    assert rde.Scene.from_dict(json.loads(json.dumps(scene.to_dict()))) == scene
    with pytest.raises(ValueError, match="RRP"):
        gym.make("redundant_envs/ThreeRReach-v0", scene=rrp.SCENE)


def test_spawned_processes_import_the_module_of_an_environment():
    spec = gym.spec("redundant_envs/ThreeRTrack-v0")
    assert spec.entry_point == "redundant_envs.envs.named:three_r/track/ThreeRTrackEnv"
    assert gym.spec("redundant_envs/FourRReach-v0").entry_point == "redundant_envs.envs.named:FourRReachEnv"
    program = (
        "import sys; sys.path.insert(0, sys.argv[1]); import gymnasium as gym;"
        "from gymnasium.envs.registration import EnvSpec;"
        "env = gym.make(EnvSpec.from_json(sys.argv[2])); print(env.reset(seed=0)[0].shape)"
    )
    command = [sys.executable, "-c", program, str(FOLDER), spec.to_json()]
    assert subprocess.run(command, check=True, capture_output=True, text=True).stdout.startswith("(")


def test_without_its_module_an_environment_from_outside_says_what_is_missing():
    code = (
        "import redundant_envs, gymnasium as gym\n"
        "try: gym.make('redundant_envs/ThreeRReach-v0')\n"
        "except gym.error.Error as error: print(type(error).__name__)\n"
        "from redundant_envs.scene import load_scene\n"
        "try: load_scene({'robot': {'type': 'ThreeR'}})\n"
        "except ValueError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "robot.type is 'ThreeR'; valid: Chain, FourR, RPRP" in done.stdout
    make = "import gymnasium; gymnasium.make('three_r:redundant_envs/ThreeRReach-v0').reset()"
    told = subprocess.run(
        [sys.executable, "-c", make], capture_output=True, text=True, cwd=FOLDER, check=False
    )
    assert told.returncode == 0, told.stderr
