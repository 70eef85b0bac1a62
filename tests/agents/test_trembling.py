"""The reward prefers rest at the goal to trembling there: the tip is at the goal, the efforts alternate."""

import numpy as np
import pytest
from run_folders import POLICIES

from redundant_envs.tasks import ReachTask
from redundant_envs_train.policies import load_policy
from redundant_envs_train.rollout import expert_act, policy_act, run_episodes
from redundant_envs_train.run_folder import own_config

pytestmark = pytest.mark.long

EPISODES, SEED = 80, 5_000_000
TASK = ReachTask()
PATTERNS = [  # size, and shape over the steps
    (0.6, lambda step: np.array([1.0, 0.0, 0.0, 0.0]) * (-1) ** step),
    (0.6, lambda step: np.array([0.0, 0.0, 0.0, 1.0]) * (-1) ** step),
    (0.2, lambda step: np.array([1.0, -1.0, 1.0, -1.0]) * (-1) ** step),
    (0.2, lambda step: np.array([1.0, 1.0, -1.0, -1.0]) * (-1) ** (step // 2)),
    (0.2, lambda step: np.eye(4)[step % 4] * (-1) ** (step // 4)),
    (0.05, lambda step: np.array([1.0, 1.0, -1.0, -1.0]) * (-1) ** (step // 2)),
]


def trembling(act, size, pattern):
    """The actions of ``act``, and alternating efforts beside them once the tip has been held at the goal."""
    held = np.zeros(EPISODES, bool)

    def trembles(obs, core, step):
        nonlocal held
        held = held | (core.memory.read(("hold",))[:, 0] >= TASK.hold_steps)
        actions = act(obs, core, step) + held[:, None] * size * pattern(step)
        return np.clip(actions, -1.0, 1.0).astype(np.float32)

    return trembles


@pytest.mark.parametrize("arm", ["FourR", "RPRP"])
@pytest.mark.parametrize("who", ["computed torque", "ppo", pytest.param("sac", marks=pytest.mark.long)])
def test_an_episode_that_holds_returns_more_than_the_same_one_that_trembles_no_nearer_to_the_goal(arm, who):
    env_id, trembled, folder = f"redundant_envs/{arm}Reach-v0", 0, POLICIES / f"{arm}Reach-v0-{who}"
    model = None if who == "computed torque" else load_policy(folder, own_config(folder))
    calm = run_episodes(env_id, policy_act(model) if model else expert_act(), EPISODES, SEED)
    assert calm.hold.mean() > 0.95
    for size, pattern in PATTERNS:
        act = trembling(policy_act(model) if model else expert_act(), size, pattern)
        restless = run_episodes(env_id, act, EPISODES, SEED)
        there = restless.distance <= TASK.goal_tolerance  # the reach is 1 m
        # pushed nearer to the goal the tip may earn more than trembling costs
        pairs = calm.hold & ~restless.hold & there & (restless.distance >= calm.distance)
        trembled += pairs.sum()
        worse = pairs & (calm.returns <= restless.returns)
        assert not worse.any(), (size, np.flatnonzero(worse))
    assert trembled > 50
