"""Copies of environments: the same bits through resets and autoresets, independent, anywhere."""

import copy
import multiprocessing
import pickle

import cloudpickle
import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import FlattenObservation, TransformReward
from small_scenes import OWN_IDS
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.vec_env import VecNormalize

import redundant_envs as rde

WAYS = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda x: pickle.loads(pickle.dumps(x)),
    "cloudpickle": lambda x: cloudpickle.loads(cloudpickle.dumps(x)),
}
every_way = pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
every_id = pytest.mark.parametrize("env_id", OWN_IDS)
MODES = ("next_step", "same_step", "disabled")
COUNT = 11
STEPS = 6
"""Control steps of an episode."""


def flat(value):
    """All numbers in the outputs of an environment, in a fixed order."""
    if isinstance(value, dict):
        return [x for k in sorted(value) for x in flat(value[k])]
    if isinstance(value, list | tuple):
        return [x for v in value for x in flat(v)]
    if isinstance(value, np.ndarray) and value.dtype == object:
        return flat(value.tolist())
    return [] if value is None else np.asarray(value, float).ravel().tolist()


def single_motion(env, steps=2 * STEPS + 1):
    """Steps with sampled actions, and resets where episodes end."""
    rows = []
    for _ in range(steps):
        *result, info = env.step(env.action_space.sample())
        rows.append(flat([*result, info]))
        if result[2] or result[3]:
            rows.append(flat([*env.reset()]))
    return rows


def vector_motion(env, steps=2 * STEPS + 3):
    """Steps with sampled actions, and resets of those that ended where the environment does not."""
    rows = []
    for _ in range(steps):
        ended = getattr(env.unwrapped, "_ended", np.zeros(1, bool))
        if ended.any():
            rows.append(flat([*env.reset(options={"reset_mask": ended.copy()})]))
        rows.append(flat([*env.step(env.action_space.sample())]))
    return rows


def sb3_motion(env, steps=2 * STEPS + 3):
    actions = np.random.default_rng(2).uniform(-1.0, 1.0, (steps, env.num_envs, 4)).astype(np.float32)
    rows = [[*env.step(a)] for a in actions]
    for *_, infos in rows:
        for info in infos:
            info.get("episode", {}).pop("t", None)  # seconds on a clock
    return [flat(row) for row in rows] + [flat(env.reset())]


def made(env_id, **kwargs):
    env = gym.make(env_id, max_episode_steps=STEPS, **kwargs)
    env.action_space.seed(3)
    return env


def made_vector(env_id, mode):
    env = gym.make_vec(env_id, num_envs=COUNT, max_episode_steps=STEPS, autoreset_mode=mode)
    env.action_space.seed(3)
    return env


@every_way
@every_id
@pytest.mark.parametrize("steps", [0, 2, STEPS], ids=["after reset", "within an episode", "after its end"])
def test_a_copied_environment_continues_to_the_same_bits(env_id, way, steps):
    env = made(env_id)
    env.reset(seed=5, options={"parameters": {"masses": (1.0, 0.5, 0.4, 0.3)}})
    for _ in range(steps):
        env.step(env.action_space.sample())
    twin = way(env)
    expected = single_motion(env)
    assert single_motion(twin) == expected
    assert len({row[0] for row in expected}) > STEPS
    assert twin.spec == env.spec


@every_id
def test_the_generator_of_a_copied_environment_is_its_own(env_id):
    env = made(env_id)
    env.reset(seed=5)
    twin = copy.deepcopy(env)
    assert twin.unwrapped.core.generators[0] is twin.unwrapped.np_random
    assert twin.unwrapped.np_random is not env.unwrapped.np_random
    assert twin.unwrapped.np_random_seed == 5
    np.testing.assert_array_equal(flat(twin.reset()), flat(env.reset()))
    np.testing.assert_array_equal(flat(twin.reset(seed=8)), flat(env.reset(seed=8)))


@every_way
def test_a_copy_before_the_first_reset(way):
    env = made("redundant_envs/RPRPReach-v0")
    twin = way(env)
    with pytest.raises((ValueError, gym.error.ResetNeeded)):
        twin.step(np.zeros(4, np.float32))
    np.testing.assert_array_equal(flat(twin.reset(seed=1)), flat(env.reset(seed=1)))


@every_way
def test_a_copied_environment_is_independent(way):
    env = made("redundant_envs/RPRPReach-v0").unwrapped
    env.reset(seed=5)
    state = env.get_state()
    twin = way(env)
    twin.reset(seed=7, options={"parameters": {"masses": 1.0, "prismatic_stop.upper": 0.1}})
    single_motion(twin)
    now = env.get_state()
    for name in ("states", "parameters"):
        np.testing.assert_array_equal(now[name], state[name])
    expected = single_motion(env)
    twin.set_state(state)
    twin.action_space.seed(3)
    assert single_motion(twin) == expected


def test_a_shallow_copy_does_not_share_the_memory_either():
    env = made("redundant_envs/FourRReach-v0").unwrapped
    env.reset(seed=5)
    vector, sb3 = made_vector("redundant_envs/FourRReach-v0", "next_step"), rde.make_sb3("FourRReach-v0", 3)
    for one in (env, vector, sb3, env.core):
        assert copy.copy(one) is not one
        core = getattr(one, "core", one)
        assert getattr(copy.copy(one), "core", copy.copy(core)).memory is not core.memory


@every_way
@every_id
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("steps", [0, 2, STEPS], ids=["after reset", "within an episode", "after its end"])
def test_a_copied_vector_continues_to_the_same_bits(env_id, way, mode, steps):
    env = made_vector(env_id, mode)
    env.reset(seed=5)
    if steps == STEPS:  # some end earlier than others
        env.step(env.action_space.sample())
        env.reset(options={"reset_mask": np.arange(COUNT) % 2 == 0, "parameters": {"masses": 0.4}})
        steps -= 1
    for _ in range(steps):
        env.step(env.action_space.sample())
    twin = way(env)
    expected = vector_motion(env)
    assert vector_motion(twin) == expected
    assert flat(twin.reset()) == flat(env.reset())


@every_way
@every_id
@pytest.mark.parametrize("steps", [0, 2, STEPS], ids=["after reset", "within an episode", "after its end"])
def test_a_copied_sb3_vector_continues_to_the_same_bits(env_id, way, steps):
    env = rde.make_sb3(env_id, COUNT, max_episode_steps=STEPS)
    env.seed(4)
    env.reset()
    for action in np.random.default_rng(0).uniform(-1.0, 1.0, (steps, COUNT, 4)):
        env.step(action)
    twin = way(env)
    expected = sb3_motion(env)
    assert sb3_motion(twin) == expected


@every_way
def test_a_copy_between_the_two_halves_of_an_sb3_step_and_with_seeds_waiting(way):
    env = rde.make_sb3("RPRPReach-v0", 3)
    env.seed(1)
    env.set_options([{"goal": (0.1, 0.2)}, {}, {}])
    twin = way(env)
    np.testing.assert_array_equal(twin.reset(), env.reset())
    env.step_async(np.full((3, 4), 0.5, np.float32))
    twin = way(env)
    assert flat([*twin.step_wait()]) == flat([*env.step_wait()])


def test_renderers_are_made_anew():
    env = made("redundant_envs/RPRPReach-v0", render_mode="rgb_array")
    env.reset(seed=0)
    env.render()
    for way in WAYS.values():
        twin = way(env)
        twin.step(twin.action_space.sample())
        assert (twin.render() != env.render()).any()
    vector = gym.make_vec("redundant_envs/RPRPReach-v0", num_envs=2, render_mode="rgb_array")
    vector.reset(seed=0)
    sb3 = rde.make_sb3("RPRPReach-v0", 2, render_mode="rgb_array")
    sb3.reset()
    for env, draw in ((vector, lambda v: v.render()), (sb3, lambda v: v.get_images())):
        draw(env)
        for way in WAYS.values():
            twin = way(env)
            twin.step(np.ones((2, 4), np.float32))
            assert (draw(twin)[0] != draw(env)[0]).any()


@pytest.mark.parametrize("way", [WAYS["deepcopy"], WAYS["cloudpickle"]], ids=["deepcopy", "cloudpickle"])
def test_copies_of_wrapped_environments(way):
    """Wrappers that hold lambdas have no pickle, whatever they wrap."""
    env = TransformReward(FlattenObservation(made("redundant_envs/RPRPGoalReach-v0")), lambda r: 2.0 * r)
    env.reset(seed=1)
    assert single_motion(way(env)) == single_motion(env)
    sync = gym.vector.SyncVectorEnv([lambda: made("redundant_envs/FourRReach-v0")] * 2)
    sync.reset(seed=1)
    sync.action_space.seed(1)
    assert vector_motion(way(sync)) == vector_motion(sync)


def test_copies_within_what_stable_baselines3_copies():
    """VecNormalize leaves its environment out of pickles; VecMonitor has no copy of any environment."""
    env = VecNormalize(rde.make_sb3("FourRReach-v0", 3, max_episode_steps=STEPS))
    env.seed(0)
    env.reset()
    twin = copy.deepcopy(env)
    twin.set_venv(copy.deepcopy(env.venv))
    assert sb3_motion(twin) == sb3_motion(env)
    callback = EvalCallback(rde.make_sb3("FourRReach-v0", 2), verbose=0)
    twin = copy.deepcopy(callback).eval_env
    assert flat(twin.reset()) != flat(callback.eval_env.reset())  # each draws seeds of its own


def child(connection, data):
    env = cloudpickle.loads(data)
    rows = vector_motion(env)
    try:
        env.reset(seed=1, options={"goal": (9.0, 9.0)})
    except ValueError as error:
        connection.send((rows, error))


@pytest.mark.parametrize("mode", [MODES[0], *(pytest.param(m, marks=pytest.mark.long) for m in MODES[1:])])
def test_a_copy_in_a_spawned_process_continues_to_the_same_bits(mode):
    env = made_vector("redundant_envs/RPRPReach-v0", mode)
    env.reset(seed=5)
    for _ in range(STEPS):
        env.step(env.action_space.sample())
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=child, args=(sender, cloudpickle.dumps(env)))
    process.start()
    sender.close()
    assert receiver.poll(120)
    rows, error = receiver.recv()
    process.join(60)
    assert rows == vector_motion(env)
    assert "options['goal']" in str(error)


def test_environments_in_spawned_workers_equal_those_here():
    def make():
        import redundant_envs  # noqa: F401  # a worker knows the ids only then

        return gym.make("redundant_envs/FourRReach-v0", max_episode_steps=STEPS)

    worker = gym.vector.AsyncVectorEnv([make] * 2, context="spawn")
    here = gym.vector.SyncVectorEnv([make] * 2)
    try:
        assert flat([*worker.reset(seed=2)]) == flat([*here.reset(seed=2)])
        for env in (worker, here):
            env.action_space.seed(0)
        for _ in range(STEPS + 2):
            actions = here.action_space.sample()
            assert flat([*worker.step(actions)][:4]) == flat([*here.step(actions)][:4])
    finally:
        worker.close()
