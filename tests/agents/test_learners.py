"""The learners' written-out gradients against torch's own, and their averages."""

import copy
import itertools

import numpy as np
import pytest
import torch
from sb3_contrib import TQC, CrossQ
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.callbacks import ConvertCallback
from stable_baselines3.common.vec_env import VecNormalize
from torch.nn import functional

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs_train.config import Config, checked
from redundant_envs_train.learners.build import NormalNoise, make_model
from redundant_envs_train.learners.networks import ACTIVATIONS, Adam, Networks, goal_mixing, linear_layers
from redundant_envs_train.learners.ppo import neighbouring_actions
from redundant_envs_train.learners.sac import AveragedSAC
from redundant_envs_train.learners.sampling import sample

SMALL = {
    "ppo": {"n_steps": 4, "batch_size": 32, "net_arch": [16, 12]},
    "sac": {"buffer_size": 1000, "learning_starts": 0, "batch_size": 32, "net_arch": [16, 12]},
    "her": {"buffer_size": 4000, "learning_starts": 1600, "batch_size": 32, "net_arch": [16, 12]},
}


def make(algo, env="RPRPReach-v0", **settings):
    config = checked(
        Config,
        {"config_version": 2, "env": f"redundant_envs/{env}", "algo": algo, "num_envs": 16, "seed": 3,
         algo: {**SMALL.get(algo, {}), **settings}},
    )  # fmt: skip
    env = make_sb3(config.env, config.num_envs)
    env.seed(0)
    return make_model(config, env)


def layers(*sizes):
    return torch.nn.Sequential(*(torch.nn.Linear(a, b) for a, b in itertools.pairwise(sizes)))


def close(found, expected):
    """Whether tensors agree, pair by pair, to single precision."""
    for one, other in zip(found, expected, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("activation", list(ACTIVATIONS))
@pytest.mark.parametrize(("sizes", "count"), [((5, 7, 3), 1), ((5, 8, 6, 4, 2), 2), ((4, 1), 2)])
def test_gradients_of_networks_are_those_of_torch(activation, sizes, count):
    torch.manual_seed(0)
    modules = [layers(*sizes) for _ in range(count)]
    networks = Networks([linear_layers(m) for m in modules], activation)
    x = torch.randn(9, sizes[0], requires_grad=True)
    weights = torch.randn(count, 9, sizes[-1])

    def plain(module):
        *hidden, last = module
        value = x
        for layer in hidden:
            value = ACTIVATIONS[activation].module()(layer(value))
        return last(value)

    expected = torch.stack([plain(m) for m in modules])
    (expected * weights).sum().backward()
    with torch.no_grad():
        outputs, tape = networks.forward(x.detach())
        networks.backward(tape, weights)
        to_inputs = networks.to_inputs(tape, weights, slice(1, None))
    torch.testing.assert_close(outputs, expected.detach())
    torch.testing.assert_close(to_inputs, x.grad[:, 1:])
    for layer, k in itertools.product(range(len(sizes) - 1), range(count)):
        torch.testing.assert_close(networks._dweights[layer][k], modules[k][layer].weight.grad)
        torch.testing.assert_close(networks._dbiases[layer][k, 0], modules[k][layer].bias.grad)


def test_adam_takes_the_steps_of_torch():
    torch.manual_seed(0)
    module = layers(3, 4, 2)
    networks = Networks([linear_layers(module)], "silu")
    parameter = torch.nn.Parameter(networks.vector.clone())
    adam, theirs = Adam(networks, 1e-8), torch.optim.Adam([parameter], lr=0.01)
    for _ in range(50):
        networks.gradient.copy_(torch.randn_like(networks.vector))
        parameter.grad = networks.gradient.clone()
        adam.step(0.01)
        theirs.step()
    torch.testing.assert_close(networks.vector, parameter.detach(), rtol=1e-5, atol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize(("algo", "env"), [("sac", "FourRReach-v0"), ("her", "RPRPGoalReach-v0")])
def test_the_actor_and_critic_steps_of_sac_follow_the_derivatives_of_their_losses(algo, env):
    at_goal = {"smoothness_at_goal": 2.0} if algo == "her" else {}
    model = make(algo, env, policy_delay=1, smoothness=0.3, ent_coef=0.05, **at_goal)
    model.learn(1700 if algo == "her" else 300)
    actor, critics = model.networks["actor"], model.networks["critics"]
    sample = model.replay_buffer.sample(32)
    now, after = model.inputs(sample.observations), model.inputs(sample.next_observations)
    before = {name: n.vector.clone() for name, n in model.networks.items()}
    steps = []
    for name in ("actor", "critics"):
        model.adams[name].step = lambda rate, name=name: steps.append(name)  # look at gradients alone
    with torch.no_grad():
        drawn = model._draw(torch.cat([after, now]))
        discounts = model.gamma * (1.0 - sample.dones)
        chosen = torch.cat([torch.cat([after, now]), drawn.actions], 1)
        model._update_critics(
            torch.cat([now, sample.actions], 1), chosen[:32], sample.rewards, discounts, drawn.log_prob[:32],
            0.0,
        )  # fmt: skip
        found_critics = critics.gradient.clone()
        model._update_actor(chosen[32:], drawn, model._smoothness(sample.rewards), 0.0)
    assert steps == ["critics", "actor"]

    # the same losses through stable-baselines3's modules and torch's graph
    model.write_networks()
    policy = copy.deepcopy(model.policy)
    raw, raw_after = sample.observations, sample.next_observations
    mean, log_std, _ = policy.actor.get_action_dist_params(raw)
    noise = drawn.noise[32:] / drawn.outputs[32:, 4:].clamp(-20, 2).exp()
    u = mean + log_std.exp() * noise
    log_prob = torch.distributions.Normal(mean, log_std.exp()).log_prob(u).sum(1)
    log_prob = log_prob - torch.log1p(-torch.tanh(u).double().square()).sum(1).float()
    with torch.no_grad():
        mean_after = policy.actor.get_action_dist_params(raw_after)[0]
        ahead = torch.min(*policy.critic_target(raw_after, drawn.actions[:32]))[:, 0]
        goals = sample.rewards[:, 0] + discounts[:, 0] * (ahead - 0.05 * drawn.log_prob[:32, 0])
    values = policy.critic(raw, torch.tanh(u))
    near = (torch.tanh(mean) - torch.tanh(mean_after)).square().sum(1)
    weights = torch.full((32,), 0.3)
    if at_goal:
        reached = sample.rewards[:, 0] == 1.0
        assert 0 < reached.sum() < 32
        weights[reached] = 2.0
    (0.05 * log_prob - torch.min(*values)[:, 0] + weights * near).mean().backward()
    head = torch.cat([policy.actor.mu.weight.grad, policy.actor.log_std.weight.grad])
    close((w[0] for w in actor._dweights[1:]), (policy.actor.latent_pi[2].weight.grad, head))
    policy.critic.zero_grad()
    sum(0.5 * functional.mse_loss(q[:, 0], goals) for q in policy.critic(raw, sample.actions)).backward()
    weights = critics._parts(found_critics)[0]
    for k, q in enumerate(policy.critic.q_networks):
        close((weights[1][k], weights[2][k]), (q[2].weight.grad, q[4].weight.grad))
    for name, vector in before.items():
        assert torch.equal(model.networks[name].vector, vector)


@pytest.mark.parametrize("env", ["RPRPReach-v0", "FourRGoalReach-v0"])
def test_the_steps_of_ppo_follow_the_derivatives_of_its_losses(env):
    model = make("ppo", env, ent_coef=0.01, vf_coef=0.7, smoothness=0.3)
    model.learn(64)
    actor, critic = model.networks["actor"], model.networks["values"]
    torch.manual_seed(1)
    buffer = model.rollout_buffer
    sample = next(iter(buffer.get(64)))
    neighbours = torch.rand(2, 64, 4) * 2.0 - 1.0
    there = torch.randint(0, 2, (2, 64, 1)).float()
    with torch.no_grad():
        # so that the means of two actions lie beyond their bounds
        model.policy.action_net.bias.copy_(torch.tensor([-1.5, 0.1, -0.2, 1.5]))
        model.read_networks()
        actions = model.policy.get_distribution(sample.observations).sample()
        old = model.policy.evaluate_actions(sample.observations, actions)[1]
        old += 0.3 * torch.randn(64)  # so that some ratios are clipped
        columns = [c[:, None] for c in (old, sample.advantages, sample.returns)]
        given = model.inputs(sample.observations), actions
        both = (there * neighbours).sum(0), there.sum(0)
        model._set_gradients([*given, *columns, *both], 0.2, 0.01)
    policy = copy.deepcopy(model.policy)
    values, log_prob, entropy = policy.evaluate_actions(sample.observations, actions)
    means = policy.get_distribution(sample.observations).distribution.mean
    inside = means.clamp(-1.0, 1.0)
    assert 0.1 < (inside == means).float().mean() < 0.9
    apart = inside - neighbours
    squares = there * (apart.square() + 2.0 * (means - inside) * apart)  # beyond the bounds a straight line
    advantages = sample.advantages
    advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
    ratio = (log_prob - old).exp()
    surrogate = torch.min(advantages * ratio, advantages * ratio.clamp(0.8, 1.2)).mean()
    value_loss = functional.mse_loss(sample.returns, values.flatten())
    smoothness = 0.3 * squares.sum((0, 2)).mean()
    (-surrogate - 0.01 * entropy.mean() + 0.7 * value_loss + smoothness).backward()
    nets = policy.mlp_extractor
    close(
        [actor.dextra, *(w[0] for w in actor._dweights[1:]),
         critic._dweights[2][0], critic._dbiases[0][0, 0]],
        [policy.log_std.grad, *(layer.weight.grad for layer in (nets.policy_net[2], policy.action_net)),
         policy.value_net.weight.grad, nets.value_net[0].bias.grad],
    )  # fmt: skip


def test_actions_are_smooth_within_episodes_and_not_from_one_to_the_next():
    model = make("ppo", n_steps=32)
    kept = []
    collect = model.collect_rollouts

    def collect_and_keep(*args, **kwargs):
        found = collect(*args, **kwargs)
        with torch.no_grad():  # before the policy learns from this rollout
            seen = torch.from_numpy(model.rollout_buffer.observations)
            kept.append(model.policy.get_distribution(seen.flatten(0, 1)).distribution.mean.clamp(-1.0, 1.0))
        return found

    model.collect_rollouts = collect_and_keep
    model.learn(16 * 32 * 4)
    starts, means = model.rollout_buffer.episode_starts, model.mean_actions
    assert 0 < starts[1:].sum() < starts[1:].size
    np.testing.assert_allclose(means.reshape(-1, 4), kept[-1].numpy(), atol=1e-5)
    sums, numbers = neighbouring_actions(means, starts)
    for step, lane in itertools.product(range(32), range(16)):
        there = [k for k in (step - 1, step + 1) if 0 <= k < 32 and not starts[max(k, step), lane]]
        assert numbers[step, lane] == len(there)
        expected = np.sum([means[k, lane] for k in there], axis=0) if there else np.zeros(4)
        np.testing.assert_allclose(sums[step, lane], expected, atol=1e-6)


@pytest.mark.quick("0.9")
@pytest.mark.parametrize("average", [0.9, 0.0])  # without one the policy is the last actor
def test_an_average_is_the_running_mean_of_weights_and_is_there_inside_alone(average):
    model = make("sac", average=average)
    networks = model.networks["actor"]
    weights, mean = [], networks.vector.clone()
    step = model.adams["actor"].step
    model.adams["actor"].step = lambda rate: (step(rate), weights.append(networks.vector.clone()))
    model.learn(1200)
    assert len(weights) > 20
    for k, vector in enumerate(weights):
        updates = 2 * (k + 1)  # of the critics: the actor's is every second one
        mean = mean + max(1.0 - average, 10 / (10 + updates)) * (vector - mean)
    torch.testing.assert_close(model.means["actor"], mean, rtol=1e-6, atol=1e-7)
    head = model.policy.actor.mu.weight
    present = head.clone()
    assert torch.equal(
        present, networks._parts(networks.vector)[0][2][0, :4]
    )  # outside, the policy is the last
    with model.averaged():
        inside = head.clone()
    assert torch.equal(head, present)
    assert torch.equal(inside, present) == (average == 0.0)
    torch.testing.assert_close(inside, networks._parts(mean)[0][2][0, :4], rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize(("starts", "tolerance"), [(1000, 0.0), (0, 1e-6)])  # random, of the networks
def test_actions_are_those_of_stable_baselines3(starts, tolerance):
    model = make("sac", "FourRReach-v0")
    model.learn(320)
    taken = []
    for act in (model._sample_action, lambda *given: SAC._sample_action(model, *given)):
        torch.manual_seed(5)
        model.action_space.seed(5)
        taken.append([*act(starts, None, 16), *act(starts, None, 16)])
    for ours, theirs in zip(*taken, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=10.0 * tolerance, atol=tolerance)
        assert ours.dtype == theirs.dtype


@pytest.mark.quick("plain")
@pytest.mark.parametrize("case", ["plain", "time limits as ends", "normalized"])
def test_transitions_are_stored_as_by_stable_baselines3(case):
    # episodes end within 150 steps, and the buffer of 160 begins anew
    kept = []
    for algorithm in (AveragedSAC, SAC):
        env = make_sb3("RPRPReach-v0", 5)
        env.seed(0)
        given = {"handle_timeout_termination": case != "time limits as ends"}
        model = algorithm(
            "MlpPolicy", VecNormalize(env) if case == "normalized" else env, buffer_size=800, seed=1,
            learning_starts=10**6, replay_buffer_kwargs=given, device="cpu",
        ).learn(5 * 320)  # fmt: skip
        kept.append(model.replay_buffer)
    ours, theirs = kept
    assert ours.full
    assert ours.dones.any()
    assert ours.timeouts.any() == (case != "time limits as ends")
    names = {name for name, value in vars(theirs).items() if isinstance(value, np.ndarray | int)}
    assert {"pos", "full", "observations", "rewards", "dones", "timeouts"} <= names
    for name in names:
        mine, other = getattr(ours, name), getattr(theirs, name)
        assert type(mine) is type(other), name
        assert np.array_equal(mine, other), name


@pytest.mark.quick("sac-RPRPReach-v0-settings0-False")
@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize(
    ("algo", "env", "settings"),
    [
        ("sac", "RPRPReach-v0", {}),
        ("sac", "RPRPGoalReach-v0", {}),
        ("her", "FourRGoalReach-v0", {"goal_selection_strategy": "future"}),
        ("her", "FourRGoalReach-v0", {"goal_selection_strategy": "final"}),
        ("her", "FourRGoalReach-v0", {"goal_selection_strategy": "episode"}),
    ],
)
def test_samples_are_those_of_stable_baselines3_to_the_bit(algo, env, settings, full):
    model = make(algo, env, buffer_size=3200, learning_starts=5000, **settings)
    model.learn(4800 if full else 2400)
    buffer = model.replay_buffer
    assert buffer.full is full
    found = []
    for draw in (lambda: sample(buffer, 700), lambda: buffer.sample(700)):
        np.random.seed(7)
        found.append([draw(), np.random.random()])  # and as many draws
    assert found[0][1] == found[1][1]
    for name in ("observations", "actions", "next_observations", "dones", "rewards"):
        ours, theirs = (getattr(drawn, name) for drawn, _ in found)
        pairs = [(ours[k], theirs[k]) for k in theirs] if isinstance(theirs, dict) else [(ours, theirs)]
        for mine, other in pairs:
            assert mine.dtype == other.dtype
            assert torch.equal(mine, other), name


@pytest.mark.long
def test_actions_drawn_together_give_the_steps_of_actions_drawn_one_step_after_the_other():
    ours, theirs = (make("sac", policy_delay=3, gradient_steps=8).learn(1600) for _ in range(2))
    before = theirs.networks["actor"].vector.clone()
    torch.manual_seed(2)
    np.random.seed(2)
    ours.train(7, 32)
    torch.manual_seed(2)
    np.random.seed(2)
    drawn = sample(theirs.replay_buffer, 7 * 32)
    numbers = drawn.actions, drawn.rewards, theirs.gamma * (1.0 - drawn.dones)
    rows = [part.split(32) for part in (drawn.observations, drawn.next_observations, *numbers)]
    with torch.no_grad():
        for now, after, actions, rewards, discounts in zip(*rows, strict=True):
            theirs._n_updates += 1
            last = theirs._n_updates % 3 == 0
            ahead = theirs._draw(torch.cat([after, now]) if last else after)
            chosen = [torch.cat(pair, 1) for pair in zip((after, now), ahead.actions.split(32), strict=False)]
            theirs._update_critics(
                torch.cat([now, actions], 1), chosen[0], rewards, discounts, ahead.log_prob[:32], 6e-3
            )
            theirs.networks["targets"].vector.lerp_(theirs.networks["critics"].vector, theirs.tau)
            if last:
                theirs._update_actor(chosen[1], ahead, theirs._smoothness(rewards), 6e-3)
    assert ours._n_updates == theirs._n_updates
    assert not torch.equal(theirs.networks["actor"].vector, before)
    for name, networks in ours.networks.items():
        torch.testing.assert_close(networks.vector, theirs.networks[name].vector, rtol=1e-4, atol=1e-5)


@pytest.mark.long
def test_smoothness_at_the_goal_weighs_steps_that_reach_it_whatever_the_two_rewards_are():
    model = make("her", "RPRPGoalReach-v0", smoothness=0.25, smoothness_at_goal=2.0)
    for missed, reached in ((0.0, 1.0), (-1.0, 0.0)):
        weights = model._smoothness(torch.tensor([[missed], [reached], [missed], [missed]]))
        assert weights.tolist() == [[0.25], [2.0], [0.25], [0.25]]
    for one in (-1.0, 0.0, 1.0):
        assert model._smoothness(torch.full((3, 1), one)).tolist() == [[0.25]] * 3
    assert make("sac", smoothness=0.25)._smoothness(torch.tensor([[0.0], [1.0]])).tolist() == [[0.25]] * 2


@pytest.mark.long
def test_the_error_is_given_at_its_scale_and_the_goal_in_reaches():
    space = make_sb3("FourRGoalReach-v0", 1).observation_space
    achieved, desired = np.array([0.5, -0.2]), np.array([0.51, -0.2])  # the reach is 1 m
    raw = np.concatenate([achieved, desired, np.arange(16)])
    given = goal_mixing(space, 0.05).double().numpy() @ raw
    np.testing.assert_allclose(given[:2], (desired - achieved) / 0.05, atol=1e-6)
    np.testing.assert_allclose(given[2:], [*desired, *np.arange(16)])
    assert goal_mixing(space["observation"], 0.05) is None


@pytest.mark.parametrize("env", ["RPRPReach-v0", "FourRGoalReach-v0"])
def test_a_rollout_of_ppo_holds_what_stable_baselines3_would_compute(env):
    model = make("ppo", env, n_steps=30)
    model.learn(16 * 90)  # three rollouts, without an end of an episode
    policy = copy.deepcopy(model.policy)
    starts, before = model._last_episode_starts.copy(), model.num_timesteps
    ends, given = [], []

    def note(local, _):
        ends.extend((model.num_timesteps, i) for i in np.flatnonzero(local["dones"]))
        seen_last = [info.get("terminal_observation") for info in local["infos"]]
        given.append((local["rewards"].copy(), seen_last))
        return True

    callback = ConvertCallback(note)
    callback.init_callback(model)
    buffer = model.rollout_buffer
    assert model.collect_rollouts(model.env, callback, buffer, 30)
    assert len(ends) == 16  # every episode ended by its time limit, and none before
    step = (ends[0][0] - before) // 16 - 1
    seen = buffer.observations
    parts = seen if isinstance(seen, dict) else {"all": seen}
    flat = {k: v.reshape(480, -1) for k, v in parts.items()}
    tensors = policy.obs_to_tensor(flat.get("all", flat))[0]
    with torch.no_grad():
        actions = torch.from_numpy(buffer.actions.reshape(480, 4))
        values, log_prob, _ = policy.evaluate_actions(tensors, actions)
        last = policy.predict_values(policy.obs_to_tensor(model._last_obs)[0])
    np.testing.assert_allclose(buffer.values.ravel(), values[:, 0], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(buffer.log_probs.ravel(), log_prob, rtol=1e-5, atol=2e-5)
    np.testing.assert_array_equal(buffer.episode_starts[0], starts)
    np.testing.assert_array_equal(buffer.episode_starts[step + 1], np.ones(16))
    # a reward is the environment's, and after the time limit also the value of what is seen there
    rewards, cut_off = given[step]
    unseen = (
        {k: np.stack([o[k] for o in cut_off]) for k in cut_off[0]} if seen is parts else np.stack(cut_off)
    )
    beyond = policy.predict_values(policy.obs_to_tensor(unseen)[0]).detach().numpy()[:, 0]
    np.testing.assert_allclose(buffer.rewards[step], rewards + 0.97 * beyond, rtol=1e-5, atol=1e-5)
    np.testing.assert_array_equal(buffer.rewards[step - 1], given[step - 1][0])
    again = copy.deepcopy(buffer)
    again.compute_returns_and_advantage(last, np.zeros(16))  # no episode ends at the last step
    np.testing.assert_allclose(buffer.advantages, again.advantages, rtol=1e-5, atol=1e-5)


@pytest.mark.long
def test_every_gradient_step_has_its_share_of_asked_for_goals(monkeypatch):
    model = make("her", "RPRPGoalReach-v0", batch_size=100, gradient_steps=8)
    model.learn(1600)
    seen, asked = [], []
    update = model._update_critics
    model._update_critics = lambda pairs, *rest: (seen.append(pairs.clone()), update(pairs, *rest))[1]

    def marked(buffer, count):
        found = sample(buffer, count)
        real = count - int(buffer.her_ratio * count)
        found.actions[:real], found.actions[real:] = 1.0, -1.0  # asked-for goals come first
        asked.append(real / count)
        return found

    monkeypatch.setattr("redundant_envs_train.learners.sac.sample", marked)
    model.train(8, 100)
    shares = [float((pairs[:, -1] > 0).float().mean()) for pairs in seen]
    assert np.mean(shares) == pytest.approx(asked[0])
    assert max(0.0, asked[0] - 0.2) < min(shares) <= max(shares) < asked[0] + 0.2


# ---- algorithms of stable-baselines3 and sb3-contrib, for comparison -----------------------------

PLAIN = {"plain_ppo": PPO, "plain_sac": SAC, "td3": TD3, "tqc": TQC, "crossq": CrossQ}


@pytest.mark.parametrize("algo", PLAIN)
def test_what_is_set_reaches_the_algorithm(algo):
    replay = {"buffer_size": 3200, "learning_starts": 77, "gradient_steps": 3}
    more = {
        "plain_ppo": {"n_steps": 16, "n_epochs": 7, "ent_coef": 0.02, "gae_lambda": 0.8},
        "plain_sac": {**replay, "ent_coef": 0.3, "tau": 0.01},
        "td3": {**replay, "tau": 0.01, "policy_delay": 5, "target_policy_noise": 0.3,
                "target_noise_clip": 0.6},
        "tqc": {**replay, "ent_coef": 0.3, "tau": 0.01, "top_quantiles_to_drop_per_net": 4},
        "crossq": {**replay, "ent_coef": 0.3, "policy_delay": 5},
    }[algo] | {"batch_size": 64, "gamma": 0.77}  # fmt: skip
    made = make(algo, learning_rate=3e-4, net_arch=[24, 8], activation="tanh", **more)
    for method in ("train", "collect_rollouts"):
        assert getattr(type(made), method) is getattr(PLAIN[algo], method)
    assert {name: getattr(made, name) for name in more} == more
    assert (made.lr_schedule(1.0), made.seed) == (3e-4, 3)
    shapes = [tuple(tensor.shape) for tensor in made.policy.state_dict().values()]
    assert shapes.count((8, 24)) >= 2  # of the actor and of the critics
    kinds = {type(module) for module in made.policy.modules()}
    assert kinds & {torch.nn.Tanh, torch.nn.SiLU} == {torch.nn.Tanh}
    assert algo != "tqc" or make("tqc", n_quantiles=5).critic.quantiles_total == 10  # half of each critic


def test_noise_of_td3_is_normal_and_drawn_for_all_environments_at_once():
    np.random.seed(0)
    drawn = NormalNoise((20_000, 4), 0.3)()
    assert drawn.shape == (20_000, 4)
    np.testing.assert_allclose(drawn.mean(axis=0), 0.0, atol=0.01)
    np.testing.assert_allclose(drawn.std(axis=0), 0.3, rtol=0.02)
    assert np.abs(np.corrcoef(drawn.T) - np.eye(4)).max() < 0.05
    noise = make("td3", action_noise=0.4).action_noise
    assert (noise.shape, noise.deviation) == ((16, 4), 0.4)


@pytest.mark.parametrize(("schedule", "half"), [("constant", 2e-3), ("linear", 1e-3)])
@pytest.mark.parametrize("algo", ["ppo", "td3"])
def test_the_learning_rate_follows_its_schedule(algo, schedule, half):
    model = make(algo, learning_rate=2e-3, schedule=schedule)
    assert (model.lr_schedule(1.0), model.lr_schedule(0.5)) == (2e-3, half)
    assert model.lr_schedule(-0.01) == (2e-3 if schedule == "constant" else 0.0)
