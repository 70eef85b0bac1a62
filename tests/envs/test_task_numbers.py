"""Numbers of the task at a reset: set, checked, kept and read as all other numbers are."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from faces import ID, every_face, single, vector

import redundant_envs as rde

GOAL_ID = "redundant_envs/RPRPGoalReach-v0"


def begin(env, options, seed=None):
    """Reset any face with options."""
    if hasattr(env, "set_options"):
        env.set_options(options)
        if seed is not None:
            env.seed(seed)
        return env.reset()
    return env.reset(seed=seed, options=options)


def of_task(env, *names):
    return env.core.memory.read(names)


@every_face
def test_goals_follow_the_annulus_given_at_the_reset_and_stay_in_it(make):
    env = make()
    begin(env, {"parameters": {"inner": 0.5, "outer": 0.55}}, seed=0)
    for _ in range(10):
        radius = np.linalg.norm(np.atleast_2d(env.goal), axis=1) / env.core.reach
        assert ((radius >= 0.5) & (radius <= 0.55)).all()
        begin(env, {})  # a reset that gives no parameters keeps them
    begin(env, {"parameters": {}})
    assert (of_task(env, "inner", "outer") == (0.1, 0.95)).all()


def held_at_the_goal(options, steps):
    """is_success of an arm that hangs at rest with its tip at the goal."""
    env = gym.make("redundant_envs/FourRReach-v0").unwrapped
    q = np.full(4, -np.pi / 2)
    env.reset(seed=0, options={"q": q, "qd": np.zeros(4), **options})
    tip = env.tip
    env.reset(seed=0, options={"q": q, "qd": np.zeros(4), "goal": tip, **options})
    return [env.step(np.zeros(4, np.float32))[-1]["is_success"] for _ in range(steps)]


def test_success_follows_the_number_of_steps():
    assert held_at_the_goal({}, 10) == [False] * 9 + [True]
    assert held_at_the_goal({"parameters": {"hold_steps": 3}}, 4) == [False, False, True, True]


def test_every_lane_of_a_vector_has_numbers_of_its_own():
    env = vector(3)
    inner = np.array([0.2, 0.4, 0.6])
    begin(env, {"parameters": {"inner": inner, "outer": inner + 0.01, "hold_steps": 5}}, seed=1)
    radius = np.linalg.norm(env.goal, axis=1) / env.core.reach
    assert ((radius >= inner) & (radius <= inner + 0.01)).all()
    begin(env, {"reset_mask": np.array([False, True, False]), "parameters": {}})
    np.testing.assert_array_equal(of_task(env, "inner")[:, 0], [0.2, 0.1, 0.6])


WRONG = {
    "goal_tolerance": (-0.1, "ReachTask.goal_tolerance is -0.1; it must be positive"),
    "hold_steps": (2.5, "ReachTask.hold_steps is 2.5; give a whole number"),
    "inner": (0.96, "inner must be below outer"),
    "speed_bound": (np.inf, "speed_bound has non-finite entries"),
    "hold_speed": ("fast", "hold_speed is 'fast'; give real numbers"),
    "goal_tolerence": (
        0.1,
        r"is 'goal_tolerence'; .*masses, lengths, .*goal_tolerance, .*hold_steps",
    ),
}


@every_face
@pytest.mark.parametrize("name", WRONG)
def test_numbers_that_the_task_cannot_have_are_refused_and_change_nothing(make, name):
    env, (value, words) = make(), WRONG[name]
    before = env.get_state()
    with pytest.raises(ValueError, match=words):
        begin(env, {"parameters": {"masses": (1, 1, 1, 1), name: value}})
    after = env.get_state()
    np.testing.assert_array_equal(before["parameters"], after["parameters"])
    np.testing.assert_array_equal(before["states"], after["states"])


def test_a_bad_number_in_one_lane_of_many_is_refused():
    with pytest.raises(ValueError, match=r"ReachTask.hold_steps is 0.0; it must be positive"):
        begin(vector(3), {"parameters": {"hold_steps": [3, 0, 5]}})


def test_goal_environments_keep_what_their_reward_depends_on():
    env = gym.make(GOAL_ID).unwrapped
    with pytest.raises(ValueError, match="goal environments keep goal_tolerance"):
        env.reset(options={"parameters": {"goal_tolerance": 0.1}})
    env.reset(seed=0, options={"parameters": {"hold_steps": 3, "inner": 0.7}})
    assert np.linalg.norm(env.goal) > 0.7 * env.core.reach
    state = env.get_state()
    other = gym.make(GOAL_ID).unwrapped
    other.set_state(state)
    assert of_task(other, "hold_steps")[0, 0] == 3.0


@every_face
def test_states_copies_and_pickles_keep_them(make):
    env = make()
    begin(env, {"parameters": {"goal_tolerance": 0.3, "outer": 0.5}}, seed=2)
    fresh = make()
    fresh.set_state(env.get_state())
    for other in (fresh, copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        begin(other, {}, seed=9)
        assert (of_task(other, "goal_tolerance", "outer") == (0.3, 0.5)).all()
    begin(env, {}, seed=9)
    np.testing.assert_array_equal(fresh.goal, env.goal)


@every_face
@pytest.mark.parametrize("name", ["hold_steps", "goal_tolerance"])
def test_a_state_with_numbers_that_the_task_cannot_have_is_refused(make, name):
    from test_tampered_states import tampered

    env = make()
    with pytest.raises(ValueError, match=f"ReachTask.{name} is -1.0; it must be positive"):
        env.set_state(tampered(env, name, -1.0))
    with pytest.raises(ValueError, match=f"{name} that is not finite"):
        env.set_state(tampered(env, name, np.nan))


def test_a_reset_with_them_gives_the_bits_of_an_environment_made_with_them():
    numbers = {"goal_tolerance": 0.1, "hold_speed": 0.5, "rate_scale": 2.0, "outer": 0.6}
    made, reset = single(task=numbers), single()
    observations = [
        env.reset(seed=4, options=options)[0]
        for env, options in ((made, {}), (reset, {"parameters": numbers}))
    ]
    np.testing.assert_array_equal(*observations)
    for _ in range(5):
        action = made.action_space.sample()
        steps = [env.step(action) for env in (made, reset)]
        np.testing.assert_array_equal(steps[0][0], steps[1][0])
        assert steps[0][1:] == steps[1][1:]


def test_pictures_show_the_tolerance_of_the_lane():
    pictures = []
    for options in ({}, {"parameters": {"goal_tolerance": 0.2}}):
        env = gym.make(ID, render_mode="rgb_array").unwrapped
        env.reset(seed=0, options=options)
        pictures.append(env.render())
    assert (pictures[0] != pictures[1]).any(axis=2).sum() > 1000


def test_a_batch_simulator_has_no_numbers_of_a_task():
    batch = rde.BatchSimulator(rde.load_scene("rprp_reach"), 2)
    with pytest.raises(ValueError, match="parameter is 'hold_steps'"):
        batch.set_parameters({"hold_steps": 3})


def test_a_task_must_not_call_its_numbers_as_those_of_arms_are_called():
    from dataclasses import dataclass

    from redundant_envs.tasks.checks import check_task

    @dataclass(frozen=True)
    class HeavyTask(rde.ReachTask):
        masses: float = 1.0

    with pytest.raises(ValueError, match=r"HeavyTask.parameters has 'masses'"):
        check_task(HeavyTask(), rde.load_scene("rprp_reach"))
