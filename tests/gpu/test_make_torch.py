"""Environments of torch tensors: on a CPU, and as they would be on a GPU."""

import copy
import pickle
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
import torch

import redundant_envs as rde
from redundant_envs.compiler.backends import cuda
from redundant_envs.envs import torch_lanes
from redundant_envs.envs.torch_env import ArmTorchVectorEnv
from redundant_envs.simulator.batch import threads
from tests.gpu.compared import actions_of, assert_same, run
from tests.gpu.emulated import ByDriver, Emulated, driver

STEPS = 20
FOUR_R, GOALS = "redundant_envs/FourRReach-v0", "redundant_envs/TwoRGoalReachAround-v0"
NEAR = {"goal_tolerance": 0.5}  # so many have a reward
SENSORS = {"scene": "cheap_sensors", "info_keys": "all", "autoreset_mode": "same_step"}
CASES = [
    (FOUR_R, {}),
    ("redundant_envs/TwoRGoalReach-v0", {"task": NEAR}),
    (GOALS, {"autoreset_mode": "same_step", "task": NEAR}),
    ("redundant_envs/RPRPReach-v0", SENSORS),
]
"""Numbers that all lanes share; goals; numbers of each lane, and resets within a step; noise and stops."""


@pytest.mark.parametrize(("id", "kwargs"), CASES)
def test_a_gpu_and_a_cpu_give_the_same_bits(id, kwargs, monkeypatch):
    for module in (threads, torch_lanes):
        monkeypatch.setattr(module, "GROUP_BITS", 2)  # lists have several parts
    kwargs = {"max_episode_steps": STEPS, **kwargs}
    cpu = rde.make_torch(id, 13, device="cpu", **kwargs)
    gpu = Emulated(id, 13, "cpu", False, kwargs)
    assert_same(gpu.reset(seed=3), cpu.reset(seed=3))
    run(gpu, cpu, 0, STEPS)  # in next_step all lanes are due to begin an episode now
    assert_same(gpu.state, cpu.state)

    there, back = (rde.make_torch(id, 13, device="cpu", **kwargs), Emulated(id, 13, "cpu", False, kwargs))
    there.set_state(gpu.get_state())
    back.set_state(there.get_state())
    for step in range(STEPS, 2 * STEPS + 5):  # until all have begun another one
        actions = actions_of(cpu, step)
        wanted = cpu.step(actions)
        assert_same(there.step(actions), wanted)
        assert_same(back.step(actions), wanted)

    mask = np.arange(13) % 3 == 0
    for again in (
        {"reset_mask": mask},
        {"reset_mask": mask, "qd": np.full(len(cpu.single_action_space.low), 0.1)},
    ):
        assert_same(back.reset(seed=99, options=again), cpu.reset(seed=99, options=again))
    copied = [copy.deepcopy(back), pickle.loads(pickle.dumps(back)), pickle.loads(pickle.dumps(cpu))]
    for one in copied:
        run(one, copy.deepcopy(cpu), 40, 43)


def test_numbers_of_each_environment_reach_a_gpu():
    cpu, gpu = rde.make_torch(FOUR_R, 5, device="cpu"), Emulated(FOUR_R, 5, "cpu", False, {})
    options = {"parameters": {"gravity.g": np.linspace(0.0, 20.0, 5)}, "goal": [0.3, 0.4]}
    states = []
    for env in (cpu, gpu):
        env.reset(seed=1)
        states.append([generator.bit_generator.state for generator in env.np_random])
    assert states[0] == states[1]
    assert_same(gpu.reset(options=options), cpu.reset(options=options))
    run(gpu, cpu, 0, 5)
    assert_same(gpu.reset(seed=2), cpu.reset(seed=2))  # numbers stay until others are given
    run(gpu, cpu, 5, 8)


def test_launches_go_to_the_driver_on_the_present_stream():
    kwargs = {"max_episode_steps": 5}
    with driver() as made:
        gpu = ByDriver("redundant_envs/TwoRReach-v0", 200, "cpu", False, kwargs)
        cpu = rde.make_torch("redundant_envs/TwoRReach-v0", 200, device="cpu", **kwargs)
        assert_same(gpu.reset(seed=3), cpu.reset(seed=3))
        run(gpu, cpu, 0, 12)
        assert {*made.launches} == {(2, 128, 77)}


@pytest.mark.parametrize("lasting", [False, True])
def test_a_step_leaves_the_tensors_of_the_step_before(lasting):
    env = Emulated(FOUR_R, 3, "cpu", lasting, {"max_episode_steps": 1, "autoreset_mode": "same_step"})
    env.reset(seed=0)
    observation, *_, info = env.step(torch.ones(3, 4))
    seen = observation, info["final_obs"]
    before = [x.clone() for x in seen]
    env.step(torch.ones(3, 4))
    assert all(map(torch.equal, seen, before))
    env.step(torch.ones(3, 4))
    assert [*map(torch.equal, seen, before)] == [lasting, lasting]


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (np.zeros((3, 4), np.float32), "ndarray; give a torch tensor on cpu"),
        (torch.zeros(3, 4, dtype=torch.float64), "float64; give torch.float32, as actions.float"),
        (torch.zeros(3, 3), r"shape \(3, 3\); give \(3, 4\)"),
        (torch.zeros(4, 3).T, "not contiguous"),
        (torch.zeros(3, 4, device="meta"), "on meta; give a tensor on cpu"),
    ],
)
def test_actions_of_another_kind_are_refused(actions, message):
    env = rde.make_torch(FOUR_R, 3, device="cpu")
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.step(actions)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"render_mode": "rgb_array"}, "render_mode is 'rgb_array'.*device='cpu'"),
        ({"autoreset_mode": gym.vector.AutoresetMode.DISABLED}, "autoreset_mode is"),
        ({"on_bad_action": "raise"}, "on_bad_action is 'raise'"),
        ({"threads": 2}, "threads is 2"),
    ],
)
def test_what_would_wait_for_a_gpu_is_refused(kwargs, message):
    with pytest.raises(ValueError, match=message):
        Emulated(FOUR_R, 3, "cpu", False, kwargs)


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has a GPU")
@pytest.mark.parametrize(
    ("device", "message"),
    [
        ("cuda", "torch finds no GPU"),
        ("meta", "give 'cpu' or 'cuda'"),
        ("gpu", "give 'cpu' or 'cuda'"),
        (7.5, "device is 7.5"),
    ],
)
def test_a_device_that_is_not_there_is_refused(device, message):
    with pytest.raises(ValueError, match=message):
        rde.make_torch(FOUR_R, 3, device=device)


def test_a_gpu_is_refused_or_told_of(monkeypatch):
    """By numbers that its driver would give."""
    gpu = torch.device("cuda:0")
    for name, value in {"is_available": True, "device_count": 1, "current_device": 0}.items():
        monkeypatch.setattr(torch.cuda, name, lambda value=value: value)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device: "GeForce")
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda device: (10**9, 10**10))
    monkeypatch.setattr(cuda, "slowness", lambda device: 64)
    with pytest.warns(UserWarning, match="GeForce computes with 64 bits 1/64 as fast"):
        torch_lanes.check_gpu(gpu)
    with pytest.raises(ValueError, match="machine has GPUs 0 to 0"):
        torch_lanes.check_gpu(torch.device("cuda:3"))
    with pytest.raises(
        ValueError, match=r"num_envs is 2000000; each takes 1000 bytes, all 2\.0 GB.*at most 1000000"
    ):
        torch_lanes.check_memory(gpu, 1000, 2_000_000)


def test_a_driver_that_refuses_is_quoted(monkeypatch):
    class Refusing:
        def cuCtxGetCurrent(self, context):
            return 0

        def cuModuleLoadDataEx(self, *arguments):
            return 218

        def cuGetErrorString(self, status, text):
            text._obj.value = b"a PTX JIT compilation failed"

    monkeypatch.setattr(cuda, "_driver", Refusing)
    with pytest.raises(cuda.CudaError, match=r"cuModuleLoadDataEx: a PTX JIT compilation failed \(218\)"):
        cuda.Module("nonsense", [])


def test_a_gpu_does_not_follow_a_fork(monkeypatch):
    env = Emulated(FOUR_R, 3, "cpu", False, {})
    env.reset(seed=0)
    monkeypatch.setattr(torch_lanes.os, "getpid", lambda: -1)
    for use in (lambda: env.step(torch.zeros(3, 4)), env.reset, env.get_state):
        with pytest.raises(RuntimeError, match=r"forked.*'spawn'"):
            use()


def test_a_step_comes_after_a_reset():
    for env in (rde.make_torch(FOUR_R, 3, device="cpu"), Emulated(FOUR_R, 3, "cpu", False, {})):
        with pytest.raises(gym.error.ResetNeeded):
            env.step(torch.zeros(3, 4))
        with pytest.raises(ValueError, match="first reset"):
            env.reset(options={"reset_mask": np.array([True, False, False])})


def test_only_pcg64_goes_to_a_gpu():
    cpu = rde.make_torch(FOUR_R, 1, device="cpu")
    cpu.reset(seed=0)
    state = cpu.get_state()
    state["generators"] = [np.random.Generator(np.random.MT19937(0))]
    with pytest.raises(ValueError, match="MT19937; a GPU has NumPy's PCG64"):
        Emulated(FOUR_R, 1, "cpu", False, {}).set_state(state)


def test_large_seeds_are_those_of_numpy():
    cpu, gpu = rde.make_torch(FOUR_R, 2, device="cpu"), Emulated(FOUR_R, 2, "cpu", False, {})
    assert_same(gpu.reset(seed=[2**70, 5]), cpu.reset(seed=[2**70, 5]))
    run(gpu, cpu, 0, 3)


def test_the_package_is_imported_without_torch():
    code = f"import sys, gymnasium as g, redundant_envs; g.make('{FOUR_R}'); print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
    assert isinstance(rde.make_torch(FOUR_R, device="cpu"), ArmTorchVectorEnv)
