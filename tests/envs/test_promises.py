"""What every kind of environment promises: copies, seeds, resets and states go on to the same bits."""

import copy

import gymnasium as gym
import numpy as np
import pytest
from faces import FOUR_R, MODES, STEPS, actions, begin, drawing, flat, made, motion, plain, refused, running
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode

from redundant_envs.envs.face import observation_of
from redundant_envs.envs.keys import AHEAD, LARGEST_SEED, MANY, EpisodeKeys

LANES = 11
"""More than one block."""


@pytest.mark.quick("single-deepcopy-unused-redundant_envs/RPRPGoalReach-v0")
@pytest.mark.parametrize("env_id", ["redundant_envs/RPRPGoalReach-v0", FOUR_R])
@pytest.mark.parametrize("steps", [None, 2, STEPS], ids=["unused", "in an episode", "at its end"])
def test_a_copy_continues_to_the_same_bits(kind, env_id, way, steps):
    ranges = {"scene": drawing(), "observe_parameters": ["gravity.g"]} if env_id == FOUR_R else {}
    env = made(kind, env_id, LANES, max_episode_steps=STEPS, **ranges)
    if steps is None:
        twin = way(env)
        np.testing.assert_equal(begin(twin, seed=1), begin(env, seed=1))
    else:
        begin(env, {"parameters": {"masses": (1.0, 0.5, 0.4, 0.3), "hold_steps": 3}}, seed=5)
        for k, action in enumerate(actions(env, steps)):
            if kind in MODES and k == 1:  # some end earlier than others
                env.reset(options={"reset_mask": np.arange(LANES) % 2 == 0, "parameters": {"masses": 0.4}})
            env.step(action)
        twin = way(env)
        if kind == "single" and steps == STEPS:
            assert flat(twin.reset()) == flat(env.reset())
    expected = motion(env)
    assert motion(twin) == expected
    assert len({row[0] for row in expected}) > STEPS
    assert kind == "sb3" or twin.spec == env.spec


def test_a_copy_has_a_memory_and_generators_of_its_own(face, way):
    env = running(face)
    state = env.get_state()
    for twin in (way(env), copy.copy(env)):
        assert twin.core.memory is not env.core.memory
        begin(twin, {"parameters": {"masses": 1.0, "prismatic_stop.upper": 0.1}}, seed=7)
        twin.step(actions(twin, 1)[0])
        assert plain(env.get_state()) == plain(state)
        twin.set_state(state)
        if face == "single":
            assert twin.core.generators[0] is twin.np_random is not env.np_random
            assert twin.np_random_seed == 7
    assert motion(twin) == motion(env)
    assert (begin(twin, seed=8) == begin(env, seed=8)).all()
    assert copy.copy(env.core).memory is not env.core.memory


def test_a_copy_between_the_two_halves_of_an_sb3_step_and_with_seeds_waiting(way):
    env = made("sb3")
    env.seed(1)
    env.set_options([{"goal": (0.1, 0.2)}, {}, {}])
    twin = way(env)
    np.testing.assert_array_equal(twin.reset(), env.reset())
    env.step_async(np.full((3, 4), 0.5, np.float32))
    assert flat([*way(env).step_wait()]) == flat([*env.step_wait()])


@pytest.mark.parametrize("mode", MODES)
def test_a_vector_equals_gymnasiums_bitwise_with_infos_and_partial_resets(env_id, mode):
    native = made(mode, env_id, max_episode_steps=7)
    sync = gym.vector.SyncVectorEnv(
        [lambda: gym.make(env_id, max_episode_steps=7)] * 3, autoreset_mode=AutoresetMode[mode.upper()]
    )
    assert flat(native.reset(seed=3)) == flat(sync.reset(seed=3))
    rng, partial = np.random.default_rng(0), False
    for action in actions(native, 60):
        a, b = native.step(action), sync.step(action)
        assert flat(a[:4]) == flat(b[:4])
        if not partial and mode != "same_step":  # after partial resets Gymnasium's infos lack what was kept
            assert set(a[4]) == set(b[4])
            assert flat(a[4]) == flat(b[4])
        mask = (rng.uniform(size=3) < 0.1) | ((a[2] | a[3]) & (mode == "disabled"))
        partial |= mask.any()
        if mask.any():
            a, b = (env.reset(options={"reset_mask": mask.copy()})[0] for env in (native, sync))
            for lane in np.flatnonzero(mask):  # Gymnasium keeps its last row of others
                assert flat(observation_of(a, lane)) == flat(observation_of(b, lane))
    assert partial


def test_the_step_that_begins_an_episode_pays_nothing(goal_id):
    env = made("next_step", goal_id, 1, task={"goal_tolerance": 2.0}, max_episode_steps=2)
    env.reset(seed=0)
    assert [float(env.step(action)[1][0]) for action in actions(env, 4)] == [1.0, 1.0, 0.0, 1.0]


def test_sb3_equals_a_vector_in_the_same_step(plain_id):
    native, sb3 = (made(kind, plain_id, 4, max_episode_steps=50) for kind in ("same_step", "sb3"))
    np.testing.assert_array_equal(begin(native, seed=11), begin(sb3, seed=11))
    for action in np.clip(actions(native, 110), -1, 1):
        obs, reward, _, truncated, infos = native.step(action)
        obs3, reward3, dones, infos3 = sb3.step(action)
        np.testing.assert_array_equal(obs, obs3)
        np.testing.assert_array_equal(reward.astype(np.float32), reward3)
        np.testing.assert_array_equal(truncated, dones)
        for n in np.flatnonzero(dones):
            np.testing.assert_array_equal(infos["final_obs"][n], infos3[n]["terminal_observation"])
            assert infos3[n]["TimeLimit.truncated"] is True
            for name in ("is_success", "distance", "episode_steps"):
                assert infos3[n][name] == infos["final_info"][name][n]
        if "final_info" in infos:
            assert not infos["final_info"]["distance"][~dones].any()


def test_whole_numbers_of_any_kind_are_seeds(face):
    env = made(face)
    expected = begin(env, seed=5)
    lists = ((5, np.int32(6), 7), np.array([5, 6, 7]), range(5, 8)) if face == "next_step" else ()
    for seed in (np.int64(5), np.uint8(5), *lists):
        np.testing.assert_array_equal(begin(env, seed=seed), expected)


def test_keys_of_episodes_are_the_words_of_each_lanes_generator():
    """However many were drawn ahead, and whatever generator took the place of another meanwhile; without a
    seed each lane has words of its own."""
    env, begun = made("disabled", FOUR_R), np.array([True, True, True])
    env.reset()
    assert len({tuple(key) for key in env.core.keys.tolist()}) == 3
    env.reset(seed=20)
    generators = [np_random(20 + lane)[0] for lane in range(3)]

    def check():
        for lane in np.flatnonzero(begun):
            key = generators[lane].integers(0, 2**32, size=4, dtype=np.uint32)
            np.testing.assert_array_equal(env.core.keys[lane], key)
        for one, other in zip(copy.deepcopy(env).core.generators, copy.deepcopy(generators), strict=True):
            assert one.integers(2**62) == other.integers(2**62)

    check()
    for k in range(2 * AHEAD + 3):
        begun = np.array([True, k % 2 == 0, True])
        env.reset(options={"reset_mask": begun})
        check()
    generators[0], begun = np_random(7)[0], np.array([True, True, False])
    env.reset(seed=[7, None, None], options={"reset_mask": begun})
    check()
    generators[1] = np.random.Generator(np.random.MT19937(5))
    env.core.generators[1] = copy.deepcopy(generators[1])
    for _ in range(3):
        env.reset(options={"reset_mask": begun})
        check()


@pytest.mark.parametrize("seed", [7, LARGEST_SEED - 3], ids=["small", "beyond 64 bits"])
def test_lanes_that_are_seeded_together_have_the_keys_of_those_that_are_seeded_alone(seed):
    lanes = np.arange(1, MANY + 8)
    seeds = [0, 2**32 - 1, 2**32, 2**33 + 1, 2**63, *(seed + lane for lane in lanes[5:].tolist())]
    together, alone = EpisodeKeys(MANY + 10), EpisodeKeys(MANY + 10)
    together.seed(lanes, seeds)
    for lane, own in zip(lanes, seeds, strict=True):
        alone.seed(np.array([lane]), [own])
    for episode in range(2 * AHEAD + 1):
        chosen = lanes[::3] if episode % 3 else lanes
        np.testing.assert_array_equal(together.take(chosen), alone.take(chosen))
        together = copy.deepcopy(together)
    pairs = zip(together.generators, alone.generators, strict=True)
    assert all(
        (one and one.bit_generator.state) == (other and other.bit_generator.state) for one, other in pairs
    )
    assert together.seeds == alone.seeds


@pytest.mark.parametrize("seeds", [7, [3, 9, 4], [5, None, 6], np.array([1, 2, 3])], ids=str)
def test_generators_of_a_vector_are_those_of_single_environments(seeds):
    sync, native = gym.vector.SyncVectorEnv([lambda: gym.make(FOUR_R)] * 3), made("next_step", FOUR_R)
    for env in (sync, native):
        env.reset(seed=11)
        env.reset(seed=[*seeds] if env is sync and isinstance(seeds, np.ndarray) else seeds)
        env.reset()  # goes on with the same generators
    assert native.np_random_seed == sync.np_random_seed
    assert [one.random() for one in native.np_random] == [one.random() for one in sync.np_random]
    np.testing.assert_array_equal(native.reset()[0], sync.reset()[0])  # whoever draws from them


@pytest.mark.parametrize("kind", [*MODES, "sb3"])
def test_the_state_of_one_environment_goes_on_in_lanes_of_a_vector_and_leaves_the_others(kind):
    data = drawing()
    data["effects"] = [*data["effects"], {"type": "CommandDelay", "seconds": 0.05, "longest": 0.1}]
    one, env, plain = (made(k, FOUR_R, scene=data) for k in ("single", kind, kind))
    table = actions(one, 8)
    begin(one, seed=5)
    for action in table[:4]:
        one.step(action)
    for vector in (env, plain):
        begin(vector, seed=9)
        vector.step(actions(env, 1)[0])
    state = one.get_state()
    env.set_state(state, [2, 0])
    for action in table[4:]:
        obs, reward, *_ = one.step(action)
        many = np.tile(action, (3, 1))
        result, other = env.step(many), plain.step(many)
        np.testing.assert_array_equal(result[0], [obs, other[0][1], obs])
        np.testing.assert_array_equal(result[1][[0, 2]], np.full(2, reward, result[1].dtype))
    begin(plain)
    np.testing.assert_array_equal(begin(env), plain.core.observe()[0])  # generators are the vector's own
    refused(env, lambda env: env.set_state(plain.get_state(), [1]), "keys .*ended|num_envs is 3 there")
    refused(env, lambda env: env.set_state(state, [3]), "lanes are 0..2")


@pytest.mark.long
def test_environments_of_many_groups_of_lanes_are_those_of_few():
    count, last = 512 + 21, 512 - 64  # few are in one group, many are not
    many, few = (made("next_step", FOUR_R, n, max_episode_steps=20) for n in (count, count - last))
    np.testing.assert_array_equal(many.reset(seed=3)[0][last:], few.reset(seed=3 + last)[0])
    rng = np.random.default_rng(6)
    for _ in range(45):
        actions = rng.uniform(-1, 1, (count, 4)).astype(np.float32)
        for found, expected in zip(many.step(actions)[:4], few.step(actions[last:])[:4], strict=True):
            np.testing.assert_array_equal(found[last:], expected)
