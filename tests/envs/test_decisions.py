"""``action=`` and ``decide_every=``: every kind of environment, ends within a decision, and refusals."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from faces import begin, made
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

import redundant_envs as rde

MODES = {"joint_velocity": 4, "joint_position": 4, "tip_velocity": 2, "tip_and_posture": 4}
ARMS = {"RPRP": "rprp_reach", "FourR": "four_r_reach"}
LIMIT = 7
"""Control steps of an episode: no whole number of decisions."""


DECIDED = ("FourR", "effort"), ("FourR", "tip_and_posture"), ("RPRP", "tip_velocity")
FOUR_R = "redundant_envs/FourRReach-v0"


def stepped(arm):
    """The data of the scene of an arm with one fixed step: quick to compile."""
    return {**rde.load_scene(ARMS[arm]).to_dict(), "integrator": "rk4", "tolerance": None}


def table(count, width, steps=4):
    return np.random.default_rng(0).uniform(-1.2, 1.2, (steps, count, width)).astype(np.float32)


@pytest.mark.quick("FourR-tip_and_posture")
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("arm", ARMS)
def test_all_kinds_of_environments_agree_in_a_mode(arm, mode):
    name, own = f"redundant_envs/{arm}Reach-v0", {"scene": stepped(arm), "action": mode, "decide_every": 3}
    single, vector, sb3 = (made(kind, name, count=9, **own) for kind in ("single", "next_step", "sb3"))
    width = MODES[mode]
    assert single.action_space.shape == vector.single_action_space.shape == sb3.action_space.shape == (width,)
    first, *others = (begin(env, seed=4) for env in (single, vector, sb3))
    assert all(np.array_equal(first, other[0]) for other in others)
    for actions in table(9, width):
        obs, reward, _, _, info = single.step(actions[0])
        vector_obs, vector_reward, _, _, infos = vector.step(actions)
        sb3_obs, sb3_reward, _, _ = sb3.step(actions)
        assert np.array_equal(obs, vector_obs[0])
        assert np.array_equal(vector_obs, sb3_obs)
        assert reward == vector_reward[0]
        assert np.float32(reward) == sb3_reward[0]
        assert info["episode_steps"] == infos["episode_steps"][0]
        single = pickle.loads(pickle.dumps(single))
    state = single.get_state()
    after = single.step(actions[0])[0]
    single.set_state(state)
    assert np.array_equal(single.step(actions[0])[0], after)
    vector.set_state(state, [2])
    assert np.array_equal(vector.step(actions[[0] * 9])[0][2], after)
    assert gym.spec(name).make(**own).spec.to_json()


@pytest.mark.quick("FourR-tip_and_posture")
@pytest.mark.parametrize(
    ("arm", "mode"), [("FourR", "effort"), ("FourR", "tip_and_posture"), ("RPRP", "tip_velocity")]
)
def test_a_decision_is_so_many_control_steps_and_ends_where_the_episode_does(arm, mode):
    own = {
        "scene": stepped(arm),
        "action": mode,
        "max_episode_steps": LIMIT,
        "env_id": f"redundant_envs/{arm}Reach-v0",
    }
    own["task"] = {"speed_bound": 6.0}
    one, many = (made("disabled", count=40, decide_every=k, **own) for k in (1, 3))
    assert np.array_equal(begin(one, seed=3), begin(many, seed=3))
    gone = np.zeros(40, bool)
    for actions in table(40, many.single_action_space.shape[0], 3):
        over, total, last, ends = gone.copy(), np.zeros(40), None, np.zeros((2, 40), bool)
        seen, steps, faults = np.zeros((40, many.core.obs_size), np.float32), np.zeros(40), np.zeros(40, int)
        for _ in range(3):
            one.core.ended[:] = False  # the test goes on with the others
            obs, reward, *last, info = one.step(actions)
            now = ~over
            total[now] += reward[now]
            seen[now], steps[now], ends[:, now] = obs[now], info["episode_steps"][now], np.array(last)[:, now]
            faults[now] |= info["numerics"][now]
            over |= last[0] | last[1]
        many.core.ended[:] = False
        obs, reward, *last, info = many.step(actions)
        live = ~gone
        pairs = [(obs, seen), (reward, total), (info["episode_steps"], steps), (info["numerics"], faults)]
        for found, expected in (*pairs, *zip(last, ends, strict=True)):
            assert np.array_equal(found[live], expected[live])
        gone |= ends.any(axis=0)
    assert gone.all()


def test_an_action_counts_once_and_a_bad_one_ends_its_lane_at_once():
    env = made(
        "same_step",
        FOUR_R,
        scene=stepped("FourR"),
        decide_every=3,
        max_episode_steps=LIMIT,
    )
    begin(env, seed=1)
    *_, info = env.step(np.full((3, 4), 2.0, np.float32))
    assert info["saturated_actions"].tolist() == [4, 4, 4]
    assert info["episode_steps"].tolist() == [3] * 3
    bad = np.zeros((3, 4), np.float32)
    bad[1, 2] = np.nan
    _, _, terminated, _, info = env.step(bad)
    assert terminated.tolist() == [False, True, False]
    assert info["episode_steps"].tolist() == [6, 0, 6]
    assert info["final_info"]["numerics"][1] == 2
    assert info["final_info"]["episode_steps"][1] == 4
    *_, truncated, info = env.step(np.zeros((3, 4), np.float32))
    assert truncated.tolist() == [True, False, True]
    assert info["final_info"]["episode_steps"][0] == LIMIT


def test_the_fault_of_any_control_step_is_seen_and_a_goal_is_rewarded_at_the_end():
    name = "redundant_envs/FourRGoalReach-v0"  # a velocity beyond the bound ends no episode of it
    own = {"scene": stepped("FourR"), "count": 40, "task": {"speed_bound": 6.0, "goal_tolerance": 0.8}}
    one, many = (made("disabled", name, decide_every=k, **own) for k in (1, 3))
    assert [begin(env, seed=0).keys() for env in (one, many)]
    earlier, returned = np.zeros(40, bool), np.zeros(40)
    for actions in table(40, 4, 12):
        steps = [one.step(actions) for _ in range(3)]
        faults = [info["numerics"] for *_, info in steps]
        _, reward, *_, info = many.step(actions)
        assert np.array_equal(info["numerics"], faults[0] | faults[1] | faults[2])
        assert np.array_equal(reward, steps[-1][1])
        returned += reward
        assert np.array_equal(many.core.memory.read(many.core.episode.returns)[:, 0], returned)
        earlier |= (info["numerics"] == 4) & (faults[2] == 0)
    assert earlier.any()
    assert len({*returned}) > 1


def test_a_single_environment_ends_after_the_control_steps_of_its_id():
    env = gym.make(FOUR_R, scene=stepped("FourR"), decide_every=40)
    env.reset(seed=0)
    ends = [env.step(np.zeros(4, np.float32))[2:] for _ in range(3)]
    assert [truncated for _, truncated, _ in ends] == [False, False, True]
    assert ends[-1][2]["episode_steps"] == 100
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(4, np.float32))
    assert env.metadata["render_fps"] == pytest.approx(1.0 / (40 * 0.02))


@pytest.mark.long
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("arm", ARMS)
def test_checkers_accept_modes_and_decisions(arm, mode):
    own, count = {"scene": stepped(arm), "action": mode, "decide_every": 4}, {"num_envs": 3}
    for task in ("Reach", "GoalReach"):
        name = f"redundant_envs/{arm}{task}-v0"
        check_env(gym.make(name, **own).unwrapped, skip_render_check=True)
        check_env_of_sb3(gym.make(name, **own).unwrapped)
        rde.check_vec_env(gym.make_vec(name, **count, **own))
        rde.check_vec_env(rde.make_sb3(name, 3, **own))


def test_pictures_and_rewards_count_the_efforts_of_a_mode():
    env = made(
        "next_step",
        FOUR_R,
        scene=stepped("FourR"),
        action="tip_velocity",
        info_keys="all",
    )
    begin(env, seed=1)
    *_, info = env.step(np.zeros((3, 2), np.float32))
    shares = env.core.memory.read(env.core.episode.efforts)
    assert shares.shape == (3, 4)
    assert (np.abs(shares) < 1.0).all()
    assert (np.abs(shares) > 1e-6).any()
    assert np.allclose(info["return_effort"], 0.01 * (4.0 - (shares**2).sum(axis=1)))
    assert not set(env.core.episode.efforts) & set(env.core.actions)


TIP = {**stepped("FourR"), "effects": [*stepped("FourR")["effects"], {
    "type": "TipVelocity", "gain": 20.0, "limits": 9.0, "speeds": 2.0, "tip_speeds": 0.5, "damping": 0.1,
}]}  # fmt: skip


def test_a_scene_that_has_a_mode_needs_no_argument():
    for action in (None, "tip_velocity"):
        env = made("next_step", FOUR_R, scene=TIP, action=action)
        assert env.single_action_space.shape == (2,)
        assert env.scene.parameters()["tip_velocity.gain"] == 20.0


def test_a_decision_sums_the_costs_of_its_control_steps():
    single, several = (
        gym.make_vec("redundant_envs/FourRReachAround-v0", num_envs=32, decide_every=k) for k in (1, 5)
    )
    for env in (single, several):
        env.reset(seed=4)
    rng, costs = np.random.default_rng(1), np.zeros((2, 32))
    for _ in range(25):
        action = rng.uniform(-0.5, 0.5, (32, 4)).astype(np.float32)
        costs[1] += several.step(action)[-1]["cost"]
        costs[0] += sum(single.step(action)[-1]["cost"] for _ in range(5))
    assert costs[0].max() > 5.0
    np.testing.assert_array_equal(*costs)
