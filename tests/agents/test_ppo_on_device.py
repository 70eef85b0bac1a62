"""PPO that never leaves its device: python -m redundant_envs_train.ppo_on_device."""

import pytest
import torch

import redundant_envs as rde
from redundant_envs_train import ppo_on_device as ppo
from tests.gpu.emulated import Emulated

ID, KWARGS = "redundant_envs/TwoRReach-v0", {"autoreset_mode": "same_step", "max_episode_steps": 10}
SMALL = ("--env-id", ID, "--num-envs", "32", "--num-steps", "16", "--batch-size", "128")


def environments(count):
    return rde.make_torch(ID, count, device="cpu", **KWARGS)


@pytest.mark.parametrize("make", [environments, lambda count: Emulated(ID, count, "cpu", False, KWARGS)])
def test_a_rollout_replays_on_a_cpu_with_the_same_bits(make):
    torch.manual_seed(0)
    env, other = make(32), environments(32)
    rollout = ppo.Rollout(env, ppo.Agent(14, 2), 16)
    rollout.begin(5)
    state = env.get_state()
    rollout.next()
    assert rollout.ended.any()
    assert ppo.differences(rollout, state, other) == 0
    rollout.actions[3, 7, 0] += 0.01
    assert ppo.differences(rollout, state, other) > 0


def test_advantages_are_those_of_the_definition():
    """Schulman et al. 2016, eq. 16: sums of discounted temporal differences, of each episode alone."""
    torch.manual_seed(0)
    env = environments(4)
    rollout = ppo.Rollout(env, ppo.Agent(14, 2), 16)
    rollout.begin(5)
    rollout.run()
    rollout.terminated[4, 2] = rollout.ended[4, 2] = True
    advantages, returns = rollout.advantages(0.9, 0.8)
    with torch.no_grad():
        values, final = (rollout.agent.value(x)[..., 0] for x in (rollout.obs, rollout.final_obs))
    torch.testing.assert_close(returns, advantages + values[:-1])
    for lane in range(4):
        for t in range(16):
            total, factor = 0.0, 1.0
            for k in range(t, 16):
                end = rollout.ended[k, lane]
                after = (final[k, lane] if end else values[k + 1, lane]) * ~rollout.terminated[k, lane]
                total += factor * (rollout.rewards[k, lane] + 0.9 * after - values[k, lane])
                if end:
                    break
                factor *= 0.9 * 0.8
            torch.testing.assert_close(advantages[t, lane], torch.as_tensor(total))


def test_the_command_trains_replays_evaluates_and_saves(capsys, tmp_path):
    weights = tmp_path / "agent.pt"
    ppo.main(
        [*SMALL, "--total-steps", "8192", "--evaluation-episodes", "8", "--replay", "--save", str(weights)]
    )
    replayed, *progress, trained, holds = capsys.readouterr().out.splitlines()
    assert replayed == "replayed on a CPU: 0 numbers of the rollout differ"
    assert progress[-1].split()[:2] == ["8192", "steps"]
    assert trained.startswith(f"trained {ID} with seed 0 in ")
    assert holds.endswith(" % of 8 frozen goals")
    assert all(torch.isfinite(w).all() for w in torch.load(weights, weights_only=True).values())


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (("--seed", "100"), "from 0 to 99"),
        (("--batch-size", "100"), "must divide"),
        (("--num-steps", "3", "--batch-size", "96"), "even number"),
    ],
)
def test_wrong_arguments_are_refused(wrong, message, capsys):
    with pytest.raises(SystemExit):
        ppo.parse([*SMALL, *wrong])
    assert message in capsys.readouterr().err
