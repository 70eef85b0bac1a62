"""The learners train as stable-baselines3 does, and what they have beside it is what it should be."""

import copy
import itertools

import numpy as np
import pytest
import torch
from sb3_contrib import TQC, CrossQ
from short_trainings import small_config
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.buffers import NStepReplayBuffer
from stable_baselines3.common.utils import set_random_seed

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs_train.learners.build import make_model
from redundant_envs_train.learners.networks import goal_mixing
from redundant_envs_train.learners.ppo import neighbouring_actions
from redundant_envs_train.learners.sampling import sample, sample_ahead

SMALL = {
    "ppo": {"n_steps": 4, "batch_size": 32, "net_arch": [16, 12]},
    "sac": {"buffer_size": 1000, "learning_starts": 0, "batch_size": 32, "net_arch": [16, 12]},
    "her": {"buffer_size": 4000, "learning_starts": 1600, "batch_size": 32, "net_arch": [16, 12]},
}


def make(algo, env="RPRPReach-v0", **settings):
    """A learner on 16 environments."""
    own = {algo: {**SMALL.get(algo, {}), **settings}}
    config = small_config(algo, env=f"redundant_envs/{env}", seed=3, total_steps=8_000_000, **own)
    env = make_sb3(config.env, config.num_envs)
    env.seed(0)
    return make_model(config, env)


# ---- without what they have beside it, the learners are those of stable-baselines3 -----------------


def trained(algo, env, steps, settings, **own):
    """Weights and replay buffer after a training from fixed states of all generators."""
    model = make(algo, env, **settings, **own)
    set_random_seed(0)
    model.action_space.seed(0)
    model.learn(steps)
    with model.averaged():
        weights = {name: tensor.clone() for name, tensor in model.policy.state_dict().items()}
    if getattr(model, "log_ent_coef", None) is not None:
        weights["log_ent_coef"] = model.log_ent_coef.detach().clone()
    return weights, getattr(model, "replay_buffer", None)


@pytest.mark.parametrize("activation", ["tanh", "silu", "relu"])
def test_ppo_without_average_and_smoothness_is_that_of_stable_baselines3(activation, monkeypatch):
    """Also where a time limit ends episodes, after 100 steps."""
    monkeypatch.setattr(np.random, "permutation", lambda count: torch.randperm(count).numpy())
    settings = {
        "n_steps": 40, "batch_size": 160, "n_epochs": 2, "net_arch": [16, 12], "activation": activation,
        "ent_coef": 0.01, "vf_coef": 0.7, "clip_range": 0.1, "gamma": 0.9, "gae_lambda": 0.8,
        "log_std_init": -0.5, "learning_rate": 1e-2, "schedule": "constant",
    }  # fmt: skip
    ours, _ = trained("ppo", "RPRPReach-v0", 16 * 160, settings, average=0.0, smoothness=0.0)
    theirs, _ = trained("plain_ppo", "RPRPReach-v0", 16 * 160, settings)
    torch.testing.assert_close(ours, theirs, rtol=0.0, atol=1e-5)


@pytest.mark.quick("auto-silu")
@pytest.mark.parametrize(("ent_coef", "activation"), [("auto", "silu"), (0.1, "tanh"), ("auto", "relu")])
def test_sac_without_average_delay_and_smoothness_is_that_of_sb3(ent_coef, activation, monkeypatch):
    plain, both = torch.randn, (64, 4)

    def randn(shape, *given, **more):
        """Ours draws at the next states and then at those before, stable-baselines3 the other way round."""
        drawn = plain(shape, *given, **more)
        return drawn.roll(32, 0) if tuple(shape) == both else drawn

    monkeypatch.setattr(torch, "randn", randn)
    settings = {
        "buffer_size": 3200, "learning_starts": 200, "batch_size": 32, "gradient_steps": 1, "tau": 0.05,
        "gamma": 0.9, "ent_coef": ent_coef, "net_arch": [16, 12], "learning_rate": 1e-3,
        "schedule": "constant", "activation": activation,
    }  # fmt: skip
    none = {"average": 0.0, "smoothness": 0.0, "policy_delay": 1}
    ours, kept = trained("sac", "FourRReach-v0", 16 * 110, settings, **none)
    theirs, expected = trained("plain_sac", "FourRReach-v0", 16 * 110, settings)
    torch.testing.assert_close(ours, theirs, rtol=0.0, atol=1e-3)
    assert expected.timeouts[:110].any()
    for name in ("observations", "next_observations", "actions", "rewards", "dones", "timeouts"):
        count = 110 if name in ("dones", "timeouts") else 95  # later, rounding has grown in the motion
        found, other = getattr(kept, name)[:count], getattr(expected, name)[:count]
        np.testing.assert_allclose(found, other, rtol=0.0, atol=1e-3, err_msg=name)


@pytest.mark.quick("her-settings1-False")
@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize(
    ("algo", "settings"),
    [("sac", {}), *(("her", {"goal_selection_strategy": name}) for name in ("future", "final", "episode"))],
)
def test_samples_are_those_of_stable_baselines3_to_the_bit(algo, settings, full):
    model = make(algo, "FourRGoalReach-v0", buffer_size=3200, learning_starts=5000, **settings)
    model.learn(4800 if full else 2400)
    buffer = model.replay_buffer
    assert buffer.full is full
    found = []
    for draw in (lambda: sample(buffer, 700), lambda: buffer.sample(700)):
        np.random.seed(7)
        found.append([draw(), np.random.random()])  # and as many draws
    assert found[0][1] == found[1][1]
    names = ("observations", "actions", "next_observations", "dones", "rewards")
    ours, theirs = ({name: getattr(drawn, name) for name in names} for drawn, _ in found)
    torch.testing.assert_close(ours, theirs, rtol=0.0, atol=0.0)


@pytest.mark.parametrize("full", [False, True])
def test_rewards_of_several_steps_are_those_of_stable_baselines3_and_stop_at_the_end_of_an_episode(full):
    model = make("sac", buffer_size=3200, learning_starts=5000)
    model.learn(4800 if full else 2400)
    buffer, count, ahead = model.replay_buffer, 700, 3
    assert buffer.full is full
    assert buffer.dones.any()
    space = model.observation_space, model.action_space
    theirs = NStepReplayBuffer(3200, *space, device="cpu", n_envs=16, n_steps=ahead, gamma=0.9)
    vars(theirs).update(vars(buffer))
    np.random.seed(7)
    drawn, soon = sample_ahead(buffer, count, ahead, 0.9)
    np.random.seed(7)
    there, oldest = (buffer.buffer_size, buffer.pos) if full else (buffer.pos, 0)
    steps = (np.random.randint(0, there - ahead + 1, count) + oldest) % buffer.buffer_size
    same = theirs._get_samples(steps)  # draws the environments
    for name in ("observations", "actions", "next_observations", "dones", "rewards", "discounts"):
        torch.testing.assert_close(getattr(drawn, name), getattr(same, name), rtol=1e-6, atol=0.0)
    assert not torch.equal(soon, drawn.next_observations)
    one, after = sample_ahead(buffer, count, 1, 0.9)
    assert torch.equal(one.next_observations, after)


def test_with_several_rewards_actions_are_compared_with_those_at_the_very_next_state(monkeypatch):
    model = make("sac", learning_starts=5000, rewards_ahead=3, policy_delay=1)
    model.learn(2400)
    data, states = model._data(32, 1), []
    monkeypatch.setattr(model, "_data", lambda *_: data)
    monkeypatch.setattr(
        model, "_update_actor", lambda chosen, drawn, *_: states.append(drawn.outputs[-64:-32])
    )
    model.train(1, 32)
    soon, width = data[-1], data[0].shape[1] - 4
    assert not torch.equal(soon[:, :width], data[1][:, :width])
    torch.testing.assert_close(states[0], model.networks["actor"].outputs(soon[:, :width])[0])


# ---- smooth actions, and averages -------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(("algo", "env"), [("sac", "FourRReach-v0"), ("her", "RPRPGoalReach-v0")])
def test_smoothness_adds_its_derivatives_to_the_actor_of_sac(algo, env):
    """The rest of its gradients is that of stable-baselines3, as the test above has it."""
    at_goal = {"smoothness_at_goal": 2.0} if algo == "her" else {}
    model = make(algo, env, smoothness=0.3, **at_goal)
    model.learn(1700 if algo == "her" else 300)
    actor, sample, found = model.networks["actor"], model.replay_buffer.sample(32), []
    now, after = model.inputs(sample.observations), model.inputs(sample.next_observations)
    model.write_networks()
    policy = copy.deepcopy(model.policy)
    model.adams["actor"].step = lambda rate: None  # look at gradients alone
    for weights in (model._smoothness(sample.rewards), torch.zeros(32, 1)):
        torch.manual_seed(1)
        with torch.no_grad():
            drawn = model._draw(torch.cat([after, now]))
            model._update_actor(torch.cat([now, drawn.actions[32:]], 1), drawn, weights, 0.0)
        found.append([w[0].clone() for w in actor._dweights[1:]])

    # the same loss through stable-baselines3's modules and torch's graph
    here, there = (
        torch.tanh(policy.actor.get_action_dist_params(seen)[0])
        for seen in (sample.observations, sample.next_observations)
    )
    weights = torch.full((32,), 0.3)
    if at_goal:
        reached = sample.rewards[:, 0] == 1.0
        assert 0 < reached.sum() < 32
        weights[reached] = 2.0
    (weights * (here - there.detach()).square().sum(1)).mean().backward()
    head = policy.actor.mu.weight.grad
    expected = [policy.actor.latent_pi[2].weight.grad, torch.cat([head, torch.zeros_like(head)])]
    added = [one - none for one, none in zip(*found, strict=True)]
    torch.testing.assert_close(added, expected, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("env", ["RPRPReach-v0", "FourRGoalReach-v0"])
def test_smoothness_adds_its_derivatives_to_the_actor_of_ppo(env):
    """The rest of its gradients is that of stable-baselines3, as the test above has it."""
    model = make("ppo", env)
    model.learn(64)
    actor, found = model.networks["actor"], []
    torch.manual_seed(1)
    sample = next(iter(model.rollout_buffer.get(64)))
    neighbours = torch.rand(2, 64, 4) * 2.0 - 1.0
    there = torch.randint(0, 2, (2, 64, 1)).float()
    with torch.no_grad():
        # so that the means of two actions lie beyond their bounds
        model.policy.action_net.bias.copy_(torch.tensor([-1.5, 0.1, -0.2, 1.5]))
        model.read_networks()
        actions = model.policy.get_distribution(sample.observations).sample()
        old = model.policy.evaluate_actions(sample.observations, actions)[1]
        columns = [c[:, None] for c in (old, sample.advantages, sample.returns)]
        both = (there * neighbours).sum(0), there.sum(0)
        for model.smoothness in (0.3, 0.0):
            model._set_gradients([model.inputs(sample.observations), actions, *columns, *both], 0.2, 0.01)
            found.append([w[0].clone() for w in actor._dweights[1:]])
    policy = copy.deepcopy(model.policy)
    means = policy.get_distribution(sample.observations).distribution.mean
    inside = means.clamp(-1.0, 1.0)
    assert 0.1 < (inside == means).float().mean() < 0.9
    apart = inside - neighbours
    squares = there * (apart.square() + 2.0 * (means - inside) * apart)  # beyond the bounds a straight line
    (0.3 * squares.sum((0, 2)).mean()).backward()
    expected = [layer.weight.grad for layer in (policy.mlp_extractor.policy_net[2], policy.action_net)]
    added = [one - none for one, none in zip(*found, strict=True)]
    torch.testing.assert_close(added, expected, rtol=1e-4, atol=1e-6)


def test_actions_are_smooth_within_episodes_and_not_from_one_to_the_next():
    means = np.random.default_rng(0).uniform(-1.0, 1.0, (32, 16, 4))
    starts = np.zeros((32, 16))
    starts[0], starts[7, ::2], starts[8, 3] = 1.0, 1.0, 1.0
    sums, numbers = neighbouring_actions(means, starts)
    for step, lane in itertools.product(range(32), range(16)):
        there = [k for k in (step - 1, step + 1) if 0 <= k < 32 and not starts[max(k, step), lane]]
        assert numbers[step, lane] == len(there)
        expected = np.sum([means[k, lane] for k in there], axis=0) if there else np.zeros(4)
        np.testing.assert_allclose(sums[step, lane], expected, atol=1e-12)


@pytest.mark.quick("0.9")
@pytest.mark.parametrize("average", [0.9, 0.0])  # without one the policy is the last actor
def test_an_average_is_the_running_mean_of_weights_and_is_there_inside_alone(average):
    model = make("sac", average=average)
    head, policies = model.policy.actor.mu.weight, []
    with model.averaged():
        mean = head.detach().double().clone()
    step = model.adams["actor"].step

    def recorded(rate):
        step(rate)
        model.networks["actor"].write()
        policies.append(head.detach().double().clone())

    model.adams["actor"].step = recorded
    model.learn(1200)
    assert len(policies) > 20
    for k, weights in enumerate(policies):
        updates = 2 * (k + 1)  # of the critics: the actor's is every second one
        mean = mean + max(1.0 - average, 10 / (10 + updates)) * (weights - mean)
    with model.averaged():
        torch.testing.assert_close(head.detach().double(), mean, rtol=1e-6, atol=1e-7)
        assert torch.equal(head.double(), policies[-1]) == (average == 0.0)
    assert torch.equal(head.double(), policies[-1])


# ---- algorithms of stable-baselines3 and sb3-contrib, for comparison -----------------------------

PLAIN = {"plain_ppo": PPO, "plain_sac": SAC, "td3": TD3, "tqc": TQC, "crossq": CrossQ}
REPLAY = {"buffer_size": 3200, "learning_starts": 77, "gradient_steps": 3}
SETTINGS = {
    "plain_ppo": {"n_steps": 16, "n_epochs": 7, "ent_coef": 0.02, "gae_lambda": 0.8},
    "plain_sac": {**REPLAY, "ent_coef": 0.3, "tau": 0.01},
    "td3": {**REPLAY, "tau": 0.01, "policy_delay": 5, "target_policy_noise": 0.3, "target_noise_clip": 0.6},
    "tqc": {**REPLAY, "ent_coef": 0.3, "tau": 0.01, "top_quantiles_to_drop_per_net": 4},
    "crossq": {**REPLAY, "ent_coef": 0.3, "policy_delay": 5},
}


@pytest.mark.parametrize("algo", PLAIN)
def test_what_is_set_reaches_the_algorithm(algo):
    given = SETTINGS[algo] | {"batch_size": 64, "gamma": 0.77}
    made = make(algo, learning_rate=3e-4, net_arch=[24, 8], activation="tanh", **given)
    for method in ("train", "collect_rollouts"):
        assert getattr(type(made), method) is getattr(PLAIN[algo], method)
    assert {name: getattr(made, name) for name in given} == given
    assert (made.lr_schedule(1.0), made.seed) == (3e-4, 3)
    shapes = [tuple(tensor.shape) for tensor in made.policy.state_dict().values()]
    assert shapes.count((8, 24)) >= 2  # of the actor and of the critics
    kinds = {type(module) for module in made.policy.modules()}
    assert kinds & {torch.nn.Tanh, torch.nn.SiLU} == {torch.nn.Tanh}
    assert algo != "td3" or make("td3", action_noise=0.4).action_noise.deviation == 0.4
    assert algo != "tqc" or make("tqc", n_quantiles=5).critic.quantiles_total == 10  # half of each critic


@pytest.mark.parametrize(("schedule", "half"), [("constant", 2e-3), ("linear", 1e-3)])
@pytest.mark.parametrize("algo", ["ppo", "td3"])
def test_the_learning_rate_follows_its_schedule(algo, schedule, half):
    model = make(algo, learning_rate=2e-3, schedule=schedule)
    assert (model.lr_schedule(1.0), model.lr_schedule(0.5)) == (2e-3, half)
    assert model.lr_schedule(-0.01) == (2e-3 if schedule == "constant" else 0.0)


@pytest.mark.long
def test_actions_drawn_together_give_the_steps_of_actions_drawn_one_step_after_the_other():
    ours, theirs = (make("sac", policy_delay=3, gradient_steps=8).learn(1600) for _ in range(2))
    before = theirs.networks["actor"].vector.clone()
    set_random_seed(2)
    ours.train(7, 32)
    set_random_seed(2)
    drawn = sample(theirs.replay_buffer, 7 * 32)
    numbers = drawn.actions, drawn.rewards, theirs.gamma * (1.0 - drawn.dones)
    rows = [part.split(32) for part in (drawn.observations, drawn.next_observations, *numbers)]
    with torch.no_grad():
        for now, after, actions, rewards, discounts in zip(*rows, strict=True):
            theirs._n_updates += 1
            last = theirs._n_updates % 3 == 0
            ahead = theirs._draw(torch.cat([after, now]) if last else after)
            chosen = [torch.cat(pair, 1) for pair in zip((after, now), ahead.actions.split(32), strict=False)]
            given = torch.cat([now, actions], 1), chosen[0], rewards, discounts, ahead.log_prob[:32]
            theirs._update_critics(*given, 6e-3)
            theirs.networks["targets"].vector.lerp_(theirs.networks["critics"].vector, theirs.tau)
            if last:
                theirs._update_actor(chosen[1], ahead, theirs._smoothness(rewards), 6e-3)
    assert ours._n_updates == theirs._n_updates
    assert not torch.equal(theirs.networks["actor"].vector, before)
    for name, networks in ours.networks.items():
        torch.testing.assert_close(networks.vector, theirs.networks[name].vector, rtol=1e-4, atol=1e-5)


@pytest.mark.long
def test_the_error_is_given_at_its_scale_and_the_goal_in_reaches():
    space = make_sb3("FourRGoalReach-v0", 1).observation_space
    achieved, desired = np.array([0.5, -0.2]), np.array([0.51, -0.2])  # the reach is 1 m
    given = goal_mixing(space, 0.05).double().numpy() @ np.concatenate([achieved, desired, np.arange(16)])
    np.testing.assert_allclose(given[:2], (desired - achieved) / 0.05, atol=1e-6)
    np.testing.assert_allclose(given[2:], [*desired, *np.arange(16)])
    assert goal_mixing(space["observation"], 0.05) is None
