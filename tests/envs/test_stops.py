"""The RPRP environments between hard stops."""

import gymnasium as gym
import numpy as np
import pytest

import redundant_envs as rde

RESTING = ("active_stop_r1", "active_stop_r2")
ENVIRONMENT = "redundant_envs/RPRPReach-v0"


def driven(env, steps, seed=0):
    rng = np.random.default_rng(seed)
    infos = None
    for _ in range(steps):
        *_, infos = env.step(rng.uniform(-1, 1, (env.num_envs, 4)).astype(np.float32))
    return infos


@pytest.mark.parametrize("mode", ["next_step", "same_step"])
def test_sliders_stay_between_their_stops_and_impacts_are_counted(mode):
    env = gym.make_vec(ENVIRONMENT, num_envs=60, autoreset_mode=mode)
    env.reset(seed=1)
    rng = np.random.default_rng(1)
    for _ in range(130):
        *_, infos = env.step(rng.uniform(-1, 1, (60, 4)).astype(np.float32))
        q = env.unwrapped.core.memory.read(("r1", "r2"))
        assert (q >= 0.0).all()
        assert (q <= 0.25).all()
        assert not infos["numerics"].any()
    assert infos["events"].sum() > 20
    assert (infos["evaluations"] >= infos["episode_steps"]).all()


def test_a_reset_lets_go_of_sliders_that_rest():
    env = gym.make_vec(ENVIRONMENT, num_envs=8)
    env.reset(seed=2)
    driven(env, 60)
    core = env.unwrapped.core
    resting = core.memory.read(RESTING)
    assert (resting != 0.0).any()
    mask = (resting != 0.0).any(axis=1)
    env.reset(seed=2, options={"reset_mask": mask})
    assert not core.memory.read(RESTING)[mask].any()


def test_a_snapshot_continues_where_sliders_rest():
    env = gym.make_vec(ENVIRONMENT, num_envs=16)
    env.reset(seed=3)
    driven(env, 50)
    state = env.unwrapped.get_state()
    assert (env.unwrapped.core.memory.read(RESTING) != 0.0).any()
    first = driven(env, 20, seed=9)
    env.unwrapped.set_state(state)
    again = driven(env, 20, seed=9)
    np.testing.assert_array_equal(first["distance"], again["distance"])
    np.testing.assert_array_equal(first["evaluations"], again["evaluations"])


@pytest.mark.parametrize("integrator", [pytest.param("euler", marks=pytest.mark.long), "rk4"])
def test_a_lane_that_breaks_in_an_early_substep_shows_its_last_finite_state(integrator):
    data = rde.load_scene("rprp_reach").to_dict()
    data.update(integrator=integrator, substeps=20, tolerance=None)
    env = gym.make_vec(
        ENVIRONMENT, num_envs=9, scene=data, task={"speed_bound": 1e308}, autoreset_mode="disabled"
    )
    qd = np.zeros((9, 4))
    qd[4] = 1e80, 0.0, -1e80, 0.0
    env.reset(seed=0, options={"q": (0.3, 0.1, 0.5, 0.1), "qd": qd})
    core = env.unwrapped.core
    before = core.memory.read((*core.scene.robot.coordinates, *core.scene.robot.rates))
    obs, reward, terminated, _, infos = env.step(np.zeros((9, 4), np.float32))
    assert terminated.tolist() == [k == 4 for k in range(9)]
    assert np.isfinite(obs).all()
    assert np.isfinite(reward).all()
    after = core.memory.read((*core.scene.robot.coordinates, *core.scene.robot.rates))
    np.testing.assert_array_equal(after[4], before[4])
    assert infos["numerics"][4] == 1


def test_a_start_at_a_stop_is_allowed_and_one_beyond_it_is_not():
    env = gym.make(ENVIRONMENT)
    env.reset(seed=0, options={"q": (-1.5, 0.25, -1.5, 0.0)})
    for _ in range(5):
        *_, info = env.step(np.zeros(4, np.float32))
    assert info["numerics"] == 0
    with pytest.raises(ValueError, match=r"r1 is 0.2501 m; its stops are at 0 and 0.25 m"):
        env.reset(options={"q": (0.0, 0.2501, 0.0, 0.0)})
    env.reset(options={"parameters": {"prismatic_stop.upper": (0.1, 0.2), "prismatic_stop.restitution": 0.5}})
    for _ in range(50):
        env.step(env.action_space.sample())
        q = env.unwrapped.core.memory.read(("r1", "r2"))[0]
        assert 0.0 <= q[0] <= 0.1
        assert 0.0 <= q[1] <= 0.2


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_slider_that_is_pressed_onto_its_stop_at_a_reset_is_supported_when_the_other_one_strikes(
    restitution,
):
    """The same as if the other one starts a little before its stop; alone, among others, and set to a
    state."""
    scene = rde.load_scene("rprp_reach").to_dict()
    (stop,) = (x for x in scene["effects"] if x["type"] == "PrismaticStop")
    stop["restitution"] = restitution
    upper, action = stop["upper"][0], np.zeros(4, dtype=np.float32)
    env = gym.make(ENVIRONMENT, scene=scene)
    envs = gym.make_vec(ENVIRONMENT, num_envs=3, scene=scene)
    ends = []
    for gap in (0.0, 1e-15):
        options = {"q": [-1.2, upper, -0.4, upper - gap], "qd": [0.0, 0.0, 0.0, 1.0]}
        env.reset(seed=0, options=options)
        state = env.unwrapped.get_state()
        env.step(action)
        end = np.concatenate([env.unwrapped.q, env.unwrapped.qd])
        env.unwrapped.set_state(state)
        env.step(action)
        assert np.array_equal(end, np.concatenate([env.unwrapped.q, env.unwrapped.qd]))
        envs.reset(seed=0, options={name: np.tile(x, (3, 1)) for name, x in options.items()})
        envs.step(np.tile(action, (3, 1)))
        assert np.array_equal(envs.unwrapped.q, np.tile(env.unwrapped.q, (3, 1)))
        assert end[1] == upper
        ends.append(end)
    assert np.abs(np.subtract(*ends)).max() < 1e-9
