"""No episode gains by ending early, and the reward of goal environments depends on the two goals alone."""

import itertools

import gymnasium as gym
import numpy as np
import pytest
from small_scenes import OWN_IDS

import redundant_envs as rde
from redundant_envs_train.rollout import expert_act

LANES = 128
every_id = pytest.mark.parametrize("env_id", OWN_IDS)
goal_ids = pytest.mark.parametrize("env_id", [i for i in OWN_IDS if "Goal" in i])
SIGNS = np.array(list(itertools.product((-1.0, 1.0), repeat=4)), np.float32)


def episodes(env_id, act, **kwargs):
    """Returns, and whether each episode ended early, of one episode per lane."""
    env = rde.make_sb3(env_id, LANES, **kwargs)
    env.seed(100)
    obs = env.reset()
    running, returns, early = np.ones(LANES, bool), np.zeros(LANES), np.zeros(LANES, bool)
    step = 0
    while running.any():
        obs, reward, done, infos = env.step(act(obs, env.core, step))
        returns += reward * running
        for lane in np.flatnonzero(done & running):
            early[lane] = not infos[lane]["TimeLimit.truncated"]
        running &= ~done
        step += 1
    return returns, early


def scene(env_id, masses=None, strength=1.0):
    data = rde.load_scene("rprp_reach" if "RPRP" in env_id else "four_r_reach").to_dict()
    data["robot"]["masses"] = masses or data["robot"]["masses"]
    for effect in data["effects"]:
        if effect["type"] == "EffortLimits":
            effect["limits"] = [strength * limit for limit in effect["limits"]]
    return data


def check(env_id, policies, **kwargs):
    """No early end returns more than the expert on its goal, or than a whole episode of its policy."""
    expert, ended = episodes(env_id, expert_act(), **kwargs)
    assert not ended.any()
    ends = 0
    for act in policies:
        returns, early = episodes(env_id, act, **kwargs)
        ends += early.sum()
        assert (returns[early] <= expert[early]).all()
        if early.any() and not early.all():
            assert returns[early].max() <= returns[~early].min()
    return ends


@pytest.mark.parametrize(
    "env_id", [i if "RPRP" in i else pytest.param(i, marks=pytest.mark.long) for i in OWN_IDS]
)
def test_constant_full_efforts_gain_nothing_by_ending_early(env_id):
    policies = [lambda obs, core, step, a=a: np.tile(a, (LANES, 1)) for a in SIGNS]
    ends = check(env_id, policies)
    assert (ends > 0) == ("Goal" not in env_id)


@every_id
@pytest.mark.parametrize("case", ["as it is", "light tip", "strong motors", "low speed bound"])
def test_bang_bang_search_finds_no_gain_in_ending_early(env_id, case):
    kwargs = {
        "as it is": {},
        "light tip": {"scene": scene(env_id, masses=[0.5, 0.5, 0.5, 0.05])},
        "strong motors": {"scene": scene(env_id, strength=5.0)},
        "low speed bound": {"task": {"speed_bound": 8.0}},
    }[case]
    policies = []
    for seed, period in enumerate((1, 3, 8, 25)):
        table = np.random.default_rng(seed).choice([-1.0, 1.0], (101, LANES, 4)).astype(np.float32)
        policies.append(lambda obs, core, step, t=table, p=period: t[step // p])
    ends = check(env_id, policies, **kwargs)
    assert ends == 0 or "Goal" not in env_id
    assert ends > 0 or "Goal" in env_id or case == "as it is"


@pytest.mark.parametrize("env_id", [i for i in OWN_IDS if "Goal" not in i])
def test_an_early_end_takes_back_what_was_paid_and_says_so(env_id):
    env = gym.make(env_id)
    env.reset(seed=0)
    rewards = [env.step(np.zeros(4, np.float32))[1] for _ in range(5)]
    assert min(rewards) > 0.0
    state = env.unwrapped.get_state()
    core = env.unwrapped.core
    core.memory.write((core.scene.robot.rates[0],), 150.0)
    _, reward, terminated, _, info = env.step(np.zeros(4, np.float32))
    assert terminated
    assert sum(rewards) + reward == pytest.approx(0.0, abs=1e-12)
    paid = sum(v for k, v in info.items() if k.startswith("return_") and k != "return_end")
    assert info["return_end"] == pytest.approx(-paid, abs=1e-12)
    env.unwrapped.set_state(state)
    *_, terminated, _, info = env.step(np.zeros(4, np.float32))
    assert not terminated
    assert info["return_end"] == 0.0


@pytest.mark.parametrize("env_id", [i for i in OWN_IDS if "Goal" not in i])
def test_every_reward_term_lies_between_nothing_and_its_weight(env_id):
    env = gym.make_vec(env_id, num_envs=64)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(60):
        speeds = 10.0 ** rng.uniform(-2, 1.5, (64, 4))
        env.reset(options={"qd": speeds})
        *_, infos = env.step(rng.choice([-1.0, 1.0], (64, 4)).astype(np.float32))
        going = infos["numerics"] == 0
        terms = {k: v[going] for k, v in infos.items() if k.startswith("return_") and k != "return_end"}
        assert all((v >= 0.0).all() for v in terms.values())
        assert (sum(terms.values()) <= 1.0).all()


@goal_ids
def test_an_arm_beyond_the_speed_bound_goes_on_in_a_goal_environment(env_id):
    env = gym.make(env_id)
    env.reset(seed=0)
    env.reset(options={"qd": (150.0, 0.0, 0.0, 0.0)})
    obs, _, terminated, _, info = env.step(np.zeros(4, np.float32))
    assert not terminated
    assert info["numerics"] == rde.Numerics.SPEED_BOUND
    assert env.observation_space.contains(obs)
    again, *_ = env.step(np.zeros(4, np.float32))
    assert (again["achieved_goal"] != obs["achieved_goal"]).any()


@goal_ids
def test_the_observation_of_a_goal_environment_holds_nothing_of_the_goal(env_id):
    env = gym.make(env_id)
    rows = []
    for goal in ((0.3, 0.2), (-0.5, 0.1)):
        obs, _ = env.reset(seed=3, options={"goal": goal})
        row = [obs]
        for action in np.random.default_rng(0).uniform(-1, 1, (20, 4)).astype(np.float32):
            row.append(env.step(action)[0])
        rows.append(row)
    for one, other in zip(*rows, strict=True):
        np.testing.assert_array_equal(one["observation"], other["observation"])
        np.testing.assert_array_equal(one["achieved_goal"], other["achieved_goal"])
        assert (one["desired_goal"] != other["desired_goal"]).any()


@goal_ids
def test_goal_environments_pay_one_at_the_goal_and_nothing_elsewhere(env_id):
    env = gym.make(env_id)
    obs, _ = env.reset(seed=0)
    tip = obs["achieved_goal"]
    total = 0.0
    env.reset(seed=0, options={"goal": tip})
    for _ in range(100):
        obs, reward, _, _, info = env.step(np.zeros(4, np.float32))
        near = np.linalg.norm(obs["achieved_goal"] - obs["desired_goal"]) <= 0.02 * env.unwrapped.core.reach
        assert reward == (1.0 if near else 0.0)
        assert reward == env.unwrapped.compute_reward(obs["achieved_goal"], obs["desired_goal"], info)
        total += reward
    assert [k for k in info if k.startswith("return_")] == ["return_reached"]
    assert info["return_reached"] == total
