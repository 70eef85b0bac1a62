"""One implementation, four kinds of environments: the same seed gives the same bits in all of them."""

import gymnasium as gym
import numpy as np
import pytest
from small_scenes import OWN_IDS

import redundant_envs as rde

every_id = pytest.mark.parametrize("env_id", OWN_IDS)
plain_id = pytest.mark.parametrize("env_id", [i for i in OWN_IDS if "Goal" not in i])


def flat(obs):
    if isinstance(obs, dict):
        return np.concatenate([np.asarray(obs[k], float) for k in sorted(obs)], axis=-1)
    return np.asarray(obs, float)


def actions(steps, n):
    return np.random.default_rng(5).uniform(-1.2, 1.2, (steps, n, 4)).astype(np.float32)


def trajectory(env, table, seed=7):
    obs, _ = env.reset(seed=seed)
    rows = [(flat(obs),)]
    for action in table:
        obs, reward, terminated, truncated, info = env.step(action)
        rows.append((flat(obs), reward, terminated, truncated, info))
    return rows


@every_id
def test_native_equals_sync_bitwise_with_infos(env_id):
    table = actions(230, 3)
    native = trajectory(gym.make_vec(env_id, num_envs=3), table)
    sync = trajectory(gym.make_vec(env_id, num_envs=3, vectorization_mode="sync"), table)
    for a, b in zip(native, sync, strict=True):
        for x, y in zip(a[:4], b[:4], strict=True):
            np.testing.assert_array_equal(x, y)
        if len(a) == 5:
            assert set(a[4]) == set(b[4])
            for key, value in a[4].items():
                np.testing.assert_array_equal(value, b[4][key], err_msg=key)


@every_id
def test_single_equals_lane_of_vector(env_id):
    table = actions(60, 5)
    vector = trajectory(gym.make_vec(env_id, num_envs=5), table)
    for lane in range(5):
        single = trajectory(gym.make(env_id), table[:, lane], seed=7 + lane)
        for a, b in zip(vector, single, strict=True):
            np.testing.assert_array_equal(a[0][lane], b[0])
            if len(a) == 5:
                assert a[1][lane] == b[1]


@plain_id
def test_lane_does_not_depend_on_the_number_of_environments(env_id):
    table = actions(120, 40)
    few = trajectory(gym.make_vec(env_id, num_envs=3), table[:, :3])
    many = trajectory(gym.make_vec(env_id, num_envs=40), table)
    for a, b in zip(few, many, strict=True):
        np.testing.assert_array_equal(a[0], b[0][:3])


@every_id
def test_autoreset_modes_follow_the_same_episodes(env_id):
    table = actions(99, 3)
    envs = [
        gym.make_vec(env_id, num_envs=3, autoreset_mode=m) for m in ("next_step", "same_step", "disabled")
    ]
    rows = [trajectory(env, table) for env in envs]
    for a, b, c in zip(*rows, strict=True):
        np.testing.assert_array_equal(a[0], b[0])
        np.testing.assert_array_equal(a[0], c[0])
    # the last step of the first episode, then the first observation of the second one
    last = actions(1, 3)[0]
    ends = [env.step(last) for env in envs]
    for end in ends:
        assert end[3].all()
        np.testing.assert_array_equal(end[1], ends[0][1])
    np.testing.assert_array_equal(flat(ends[1][4]["final_obs"][1]), flat(ends[0][0])[1])
    second = flat(envs[0].step(last)[0])
    np.testing.assert_array_equal(second, flat(ends[1][0]))
    np.testing.assert_array_equal(second, flat(envs[2].reset(options={"reset_mask": np.ones(3, bool)})[0]))


@plain_id
def test_sb3_equals_native_same_step(env_id):
    table = np.clip(actions(150, 4), -1, 1)
    native = gym.make_vec(env_id, num_envs=4, autoreset_mode="same_step")
    sb3 = rde.make_sb3(env_id, 4)
    sb3.seed(11)
    np.testing.assert_array_equal(native.reset(seed=11)[0], sb3.reset())
    for action in table:
        obs, reward, _, truncated, infos = native.step(action)
        obs3, reward3, dones, infos3 = sb3.step(action)
        np.testing.assert_array_equal(obs, obs3)
        np.testing.assert_array_equal(reward.astype(np.float32), reward3)
        np.testing.assert_array_equal(truncated, dones)
        for n in np.flatnonzero(dones):
            np.testing.assert_array_equal(infos["final_obs"][n], infos3[n]["terminal_observation"])
            assert infos3[n]["TimeLimit.truncated"] is True
            assert infos3[n]["is_success"] == infos["final_info"]["is_success"][n]


@every_id
def test_neighbour_with_a_bad_action_changes_nothing(env_id):
    table = actions(30, 6)
    clean = trajectory(gym.make_vec(env_id, num_envs=6), table)
    table[10, 2] = np.nan
    dirty = trajectory(gym.make_vec(env_id, num_envs=6), table)
    others = [0, 1, 3, 4, 5]
    for a, b in zip(clean, dirty, strict=True):
        np.testing.assert_array_equal(a[0][others], b[0][others])
    assert dirty[11][2][2]
    assert dirty[11][4]["numerics"][2] == rde.Numerics.BAD_ACTION
    assert np.isfinite(dirty[11][0]).all()


@every_id
def test_snapshot_continues_to_the_last_bit(env_id):
    env = gym.make_vec(env_id, num_envs=4)
    env.reset(seed=3)
    table = actions(160, 4)
    for action in table[:50]:
        env.step(action)
    state = env.get_state()
    one = [flat(env.step(a)[0]) for a in table[50:]]
    env.set_state(state)
    two = [flat(env.step(a)[0]) for a in table[50:]]
    np.testing.assert_array_equal(one, two)


@every_id
def test_snapshot_of_a_single_environment(env_id):
    env = gym.make(env_id).unwrapped
    env.reset(seed=3)
    state = env.get_state()
    one = [flat(env.step(a)[0]) for a in actions(20, 1)[:, 0]] + [flat(env.reset()[0])]
    env.set_state(state)
    two = [flat(env.step(a)[0]) for a in actions(20, 1)[:, 0]] + [flat(env.reset()[0])]
    np.testing.assert_array_equal(one, two)


@every_id
def test_reset_without_a_seed_goes_on_and_with_one_starts_again(env_id):
    env = gym.make(env_id)
    first = flat(env.reset(seed=9)[0])
    assert (flat(env.reset()[0]) != first).any()
    np.testing.assert_array_equal(flat(env.reset(seed=9)[0]), first)


@every_id
@pytest.mark.parametrize("mode", ["next_step", "same_step"])
def test_partial_resets_equal_sync_bitwise_in_every_autoreset_mode(env_id, mode):
    from gymnasium.vector import AutoresetMode

    native = gym.make_vec(env_id, num_envs=3, autoreset_mode=mode, max_episode_steps=7)
    sync = gym.vector.SyncVectorEnv(
        [lambda: gym.make(env_id, max_episode_steps=7)] * 3,
        autoreset_mode=AutoresetMode[mode.upper()],
    )
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(flat(native.reset(seed=3)[0]), flat(sync.reset(seed=3)[0]))
    for action in actions(60, 3):
        a, b = native.step(action), sync.step(action)
        for x, y in zip((flat(a[0]), *a[1:4]), (flat(b[0]), *b[1:4]), strict=True):
            np.testing.assert_array_equal(x, y)
        if rng.uniform() < 0.2:
            mask = rng.uniform(size=3) < 0.5
            if mask.any():
                a, b = (env.reset(options={"reset_mask": mask.copy()}) for env in (native, sync))
                # Sync keeps its last row of an environment it did not reset
                np.testing.assert_array_equal(flat(a[0])[mask], flat(b[0])[mask])


@every_id
def test_final_info_of_lanes_that_did_not_end_is_zero(env_id):
    env = gym.make_vec(env_id, num_envs=16, autoreset_mode="same_step", max_episode_steps=6)
    env.reset(seed=0)
    for _ in range(3):
        env.step(env.action_space.sample())
    env.reset(options={"reset_mask": np.arange(16) % 2 == 0})
    for _ in range(3):
        *_, infos = env.step(env.action_space.sample())
    assert infos["_final_info"].sum() == 8
    assert (infos["final_info"]["distance"][::2] == 0.0).all()
    assert (infos["final_info"]["distance"][1::2] > 0.0).all()


@every_id
def test_equal_seed_and_options_give_equal_episodes(env_id):
    env = gym.make(env_id)
    options = {"parameters": {"masses": (1, 2, 3, 4), "gravity.g": 1.6}}
    first = flat(env.reset(seed=0)[0])
    rows = []
    for _ in range(2):
        obs, _ = env.reset(seed=0, options=options)
        rows.append([flat(obs), *(flat(env.step(np.ones(4, np.float32))[0]) for _ in range(5))])
    np.testing.assert_array_equal(rows[0], rows[1])
    obs, _ = env.reset(seed=0)  # parameters stay ...
    np.testing.assert_array_equal([flat(obs), flat(env.step(np.ones(4, np.float32))[0])], rows[0][:2])
    env.reset(seed=0, options={"parameters": {}})  # ... until given again
    plain = gym.make(env_id)
    np.testing.assert_array_equal(flat(plain.reset(seed=0)[0]), first)
    action = np.ones(4, np.float32)
    np.testing.assert_array_equal(flat(env.step(action)[0]), flat(plain.step(action)[0]))


@every_id
def test_a_refused_reset_changes_nothing(env_id):
    env, other = gym.make(env_id).unwrapped, gym.make(env_id).unwrapped
    env.reset(seed=0)
    other.reset(seed=0)
    for bad in ({"goal": (9, 9)}, {"parameters": {"masses": (1, 1, 1, -1)}}, {"reset_mask": 1}):
        with pytest.raises(ValueError, match=r"is|has|belongs"):
            env.reset(options=bad)
    action = np.full(4, 0.3, np.float32)
    np.testing.assert_array_equal(flat(env.step(action)[0]), flat(other.step(action)[0]))
    np.testing.assert_array_equal(flat(env.reset()[0]), flat(other.reset()[0]))


def test_the_key_of_an_episode_is_128_bits_of_the_generator():
    core = gym.make_vec("redundant_envs/FourRReach-v0", num_envs=3).unwrapped.core
    for lane in range(3):
        core.seed(lane, 20 + lane)
    core.provide_keys(np.array([0, 2]))
    for lane in (0, 2):
        generator, _ = gym.utils.seeding.np_random(20 + lane)
        expected = generator.integers(0, 2**32, size=4, dtype=np.uint32)
        np.testing.assert_array_equal(core.keys[lane], expected)
        assert core.generators[lane].integers(2**32) == generator.integers(2**32)  # both go on alike
    assert core.waiting.tolist() == [True, False, True]
    core.generators[1] = np.random.Generator(np.random.MT19937(5))
    core.provide_keys(np.array([1]))
    expected = np.random.Generator(np.random.MT19937(5)).integers(0, 2**32, size=4, dtype=np.uint32)
    np.testing.assert_array_equal(core.keys[1], expected)
