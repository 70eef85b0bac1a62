"""The reward prefers rest at the goal to trembling there: the tip is at the goal, the efforts alternate."""

import itertools

import numpy as np
import pytest
from run_folders import POLICIES

from redundant_envs.tasks import ReachTask
from redundant_envs_train.policies import load_policy
from redundant_envs_train.rollout import expert_act, policy_act, run_episodes
from redundant_envs_train.run_folder import own_config

EPISODES, SEED = 80, 5_000_000
TASK = ReachTask()
SIZES = (0.05, 0.2, 0.6)
PATTERNS = {
    "one joint, two steps": lambda step: np.array([1.0, 0.0, 0.0, 0.0]) * (-1) ** step,
    "tip joint, two steps": lambda step: np.array([0.0, 0.0, 0.0, 1.0]) * (-1) ** step,
    "all joints, two steps": lambda step: np.array([1.0, -1.0, 1.0, -1.0]) * (-1) ** step,
    "all joints, four steps": lambda step: np.array([1.0, 1.0, -1.0, -1.0]) * (-1) ** (step // 2),
    "joints by turns": lambda step: np.eye(4)[step % 4] * (-1) ** (step // 4),
}


def trembling(act, pattern, size):
    """The actions of ``act``, and alternating efforts beside them once the tip has been held at the goal."""
    held = np.zeros(EPISODES, bool)

    def trembles(obs, core, step):
        nonlocal held
        held = held | (core.memory.read(("hold",))[:, 0] >= TASK.hold_steps)
        actions = act(obs, core, step) + held[:, None] * size * pattern(step)
        return np.clip(actions, -1.0, 1.0).astype(np.float32)

    return trembles


def movers(arm):
    """Makers of the actions of computed torque and of shipped policies that hold, by name."""
    yield "computed torque", expert_act
    for folder in (POLICIES / f"{arm}Reach-v0-{algo}" for algo in ("ppo", "sac")):
        model = load_policy(folder, own_config(folder))
        yield folder.name, lambda model=model: policy_act(model)


@pytest.mark.parametrize("arm", ["FourR", "RPRP"])
def test_an_episode_that_holds_returns_more_than_the_same_one_that_trembles_no_nearer_to_the_goal(arm):
    env_id, trembled = f"redundant_envs/{arm}Reach-v0", 0
    for name, make in movers(arm):
        calm = run_episodes(env_id, make(), EPISODES, SEED)
        assert calm.hold.mean() > 0.95
        for (pattern_name, pattern), size in itertools.product(PATTERNS.items(), SIZES):
            restless = run_episodes(env_id, trembling(make(), pattern, size), EPISODES, SEED)
            there = restless.distance <= TASK.goal_tolerance  # the reach is 1 m
            # pushed nearer to the goal the tip may earn more than trembling costs
            pairs = calm.hold & ~restless.hold & there & (restless.distance >= calm.distance)
            trembled += pairs.sum()
            worse = pairs & (calm.returns <= restless.returns)
            assert not worse.any(), (name, pattern_name, size, np.flatnonzero(worse))
    assert trembled > 400
