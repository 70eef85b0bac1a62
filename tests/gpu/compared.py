"""Environments on two devices, step by step: all their results to the last bit."""

import numpy as np
import torch

import redundant_envs as rde
from redundant_envs.envs.registration import ids
from redundant_envs.scenes.scene import scene_at, scene_names

STEPS = 45
"""Of an episode: all lanes begin several."""
MODES = ("next_step", "same_step")
ACTIONS = {"decide_every": 5}, {"action": "joint_velocity"}, {"action": "tip_and_posture", "decide_every": 3}
METHODS = {"accuracy": "exact"}, {"accuracy": 1e-9}
SCENES = {
    name: (f"redundant_envs/{scene.robot.kind}Reach-v0", {"scene": name})
    for name, scene in ((name, scene_at(name, None)) for name in scene_names())
    if scene.action_units()  # else no environment can have it
} | {f"{id}{n}": (id, some) for id, several in (
    ("redundant_envs/FourRGoalReach-v0", ACTIONS), ("redundant_envs/RPRPReachLight-v0", ACTIONS + METHODS)
) for n, some in enumerate(several)}  # fmt: skip
CASES = {id: (id, {}) for id in ids()} | SCENES


def compare(make, case, mode, count, steps):
    """AssertionError unless ``make(id, count, kwargs)`` gives the bits of a CPU."""
    id, kwargs = CASES[case]
    kwargs = {"max_episode_steps": STEPS, "autoreset_mode": mode, "info_keys": "all", **kwargs}
    other, cpu = make(id, count, kwargs), rde.make_torch(id, count, device="cpu", **kwargs)
    assert_same(other.reset(seed=11), cpu.reset(seed=11))
    run(other, cpu, 0, steps)
    assert_same(other.state, cpu.state)


def leaves(results, name=""):
    """All tensors of some results by their places."""
    if isinstance(results, torch.Tensor):
        return {name: results}
    items = results.items() if isinstance(results, dict) else enumerate(results)
    return {place: x for key, value in items for place, x in leaves(value, f"{name}/{key}").items()}


def assert_same(found, wanted):
    """Results to the last bit; the rows before an autoreset are those of lanes that it began anew."""
    found, wanted = leaves(found), leaves(wanted)
    if "/4/_final_obs" not in wanted:  # nobody's episode ended
        found = {name: x for name, x in found.items() if "final_" not in name}
    assert found.keys() == wanted.keys()
    for name, x in wanted.items():
        own = slice(None) if "/final_" not in name else wanted["/4/_final_obs"]
        one, other = found[name].cpu()[own], x[own]
        assert (one.shape, one.dtype) == (other.shape, other.dtype), name
        np.testing.assert_array_equal(one.numpy(), other.numpy(), err_msg=name)
        if other.dtype.is_floating_point:
            assert torch.equal(torch.signbit(one), torch.signbit(other)), name


def actions_of(env, step):
    made = torch.rand(env.action_space.shape, generator=torch.Generator().manual_seed(step)) * 2.4 - 1.2
    made[step % env.num_envs, 0] = (np.nan, np.inf, 0.0)[step % 3]
    return made


def run(env, other, first, last):
    for step in range(first, last):
        actions = actions_of(env, step)
        assert_same(env.step(actions.to(env.device)), other.step(actions))
