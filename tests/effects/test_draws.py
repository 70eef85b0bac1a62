"""Draws of effects: their distribution, what they depend on, and the bits that they keep."""

import gymnasium as gym
import numpy as np
import pytest
from catalogue import FOUR_R, assert_same_bits, motion
from envs.faces import with_effects

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.language.algebra import physics
from redundant_envs.language.draws import MAX_DRAWS, Draw, drawn, stream_of

told, hidden = physics(lambda reading: reading), physics(lambda uniform3: uniform3)
SHAKEN = e.JointTorque(deviation=3.0, time_constant=0.05)
SCENE = rde.Scene(FOUR_R, (e.Gravity(), SHAKEN), "rk4")

DRAWS = 10_000_000
SIGMAS = 4.0
"""Standard errors by which a moment of so many draws may differ."""
MOMENTS = {"uniform": [1.0 / k for k in range(2, 10)], "normal": (0.0, 1.0, 0.0, 3.0, 0.0, 15.0, 0.0, 105.0)}
"""Means of the first eight powers."""


@pytest.mark.long
@pytest.mark.parametrize("kind", MOMENTS)
def test_the_moments_of_ten_million_draws(kind):
    lanes, exact = np.arange(1000.0), MOMENTS[kind]
    key = [lanes, 0.0 * lanes + 7.0, 0.0 * lanes, 0.0 * lanes + 2.0**32 - 1.0]
    places = [Draw(12345, kind == "normal", place) for place in range(4)]  # a whole group
    found = drawn(places, np.arange(DRAWS / 4000.0)[:, None], [k[None] for k in key])
    x = np.stack([*found.values()])
    assert x.size == DRAWS
    for k in range(4):
        error = np.sqrt((exact[2 * k + 1] - exact[k] ** 2) / x.size)
        assert abs((x ** (k + 1)).mean() - exact[k]) < SIGMAS * error, k + 1
    lanes, intervals, draws = (x[:, :, 1:], x[:, :, :-1]), (x[:, 1:], x[:, :-1]), (x[1:], x[:-1])
    for a, b in (lanes, intervals, draws):
        product = (a - exact[0]) * (b - exact[0])
        assert abs(product.mean()) < SIGMAS * (exact[1] - exact[0] ** 2) / np.sqrt(product.size)


# ---- what they depend on -----------------------------------------------------------------------------


def test_draws_do_not_depend_on_other_effects():
    more = rde.Scene(FOUR_R, (e.SensorNoise(0.01), e.LimitSpring("joint2", -0.4, 0.4), SHAKEN), "rk4")
    one, other = rde.BatchSimulator(SCENE, 3), rde.BatchSimulator(more, 3)
    for _ in range(5):
        np.testing.assert_array_equal(other.z[:, -4:], one.z)
        one.advance(), other.advance()


def test_lanes_have_draws_of_their_own_and_a_motion_has_the_same_again():
    batch = rde.BatchSimulator(SCENE, 13)
    first = batch.z, motion(batch)
    assert len(np.unique(first[0])) == first[0].size
    batch.set_state(np.zeros(4), np.zeros(4))
    assert_same_bits([batch.z], first[:1])
    assert_same_bits(motion(batch), first[1])
    assert np.intersect1d(rde.BatchSimulator(SCENE, 13, seed=1).z, first[0]).size == 0


def test_trajectories_have_draws_from_their_seed():
    q, times = np.zeros((3, 4)), np.linspace(0.0, 0.1, 8)[1:]
    one, again, other = (rde.simulate(SCENE, q, q, times, seed=seed) for seed in (0, 0, 5))
    np.testing.assert_array_equal(one.q, again.q)
    assert (one.q[-1] != other.q[-1]).all()
    assert (one.q[-1, 0] != one.q[-1, 1]).all()
    fewer = rde.simulate(SCENE, q, q, times[-1:])
    np.testing.assert_array_equal(fewer.q[-1], one.q[-1])


@pytest.mark.parametrize("seed", [-1, 2**64, 1.0, None])
def test_seeds_are_whole_numbers(seed):
    with pytest.raises(ValueError, match=r"seed is .* give a whole number from 0 to 2"):
        rde.BatchSimulator(SCENE, seed=seed)


@pytest.mark.long
def test_draws_are_asked_for_where_there_are_some_and_refused_where_there_are_none():
    torch, step = pytest.importorskip("torch"), rde.torch_step(SCENE)
    state = torch.zeros(3, 4)
    with pytest.raises(ValueError, match=r"draws is None, and .* have \d+ of its numbers.*\(BatchSimulator"):
        step(state, state, torch.zeros(4), z=state)
    plain = rde.Scene(FOUR_R)
    with pytest.raises(ValueError, match="effects of the scene have 0 of its"):
        rde.torch_step(plain)(state, state, torch.zeros(4), draws=torch.zeros(3, 5))
    with pytest.raises(ValueError, match="no effect of the scene draws"):
        rde.BatchSimulator(plain, 3).set_draws(np.zeros(5))


# ---- environments ------------------------------------------------------------------------------------


def test_a_step_that_is_undone_gives_its_draws_back():
    """After a bad action a lane is where it was, and a step from there draws what it would have drawn."""
    given = {"scene": with_effects("FourRReach-v0", SHAKEN), "on_bad_action": "terminate"}
    env = gym.make_vec("redundant_envs/FourRReach-v0", 3, **given, autoreset_mode="disabled").unwrapped
    env.reset(seed=2)
    env.step(np.zeros((3, 4), np.float32))
    dynamics = env.core.simulator.dynamics
    names = [*dynamics.effect_states.updated, *dynamics.draw_fields]
    before = env.core.memory.read(names)
    actions = np.zeros((3, 4), np.float32)
    actions[1] = np.nan
    assert env.step(actions)[2].tolist() == [False, True, False]
    same = env.core.memory.read(names) == before
    assert same[1].all()
    assert not same[[0, 2], names.index("draw_interval")].any()


@pytest.mark.long
def test_every_episode_draws_anew_and_a_seed_gives_it_again():
    env = gym.make("redundant_envs/FourRReach-v0", scene=with_effects("FourRReach-v0", SHAKEN)).unwrapped
    names, seen = [*env.core.simulator.dynamics.effect_states], []
    for seed in (1, None, 1):
        env.reset(seed=seed, options={"q": np.zeros(4)})
        seen.append(env.core.memory.read(names))
    np.testing.assert_array_equal(seen[0], seen[2])
    assert (seen[0] != seen[1]).all()


# ---- what is refused ---------------------------------------------------------------------------------


def with_states(*names, update=hidden):
    """An effect whose states of some names draw."""
    states = tuple(e.State(name, "", update=update) for name in names)
    hooks = (e.Sensing(0, told, {"reading": "phi1"}, states=states),)
    return type("Odd", (e.Effect,), {"hooks": lambda self, arm: hooks})()


def test_streams_that_are_one_are_refused():
    one, other = "s3145", "s3771"
    assert stream_of("odd", one) == stream_of("odd", other)
    rde.Scene(FOUR_R, (with_states(one),))
    with pytest.raises(ValueError, match=rf"'odd\.{other}'.*'odd\.{one}'.*rename one of them"):
        rde.Scene(FOUR_R, (with_states(one, other),))


def test_streams_are_the_same_for_ever():
    assert [stream_of("sensor_noise", "position"), stream_of("odd", "s")] == [16294563, 6266370]


def test_more_draws_than_a_stream_has_are_refused():
    last = physics(lambda uniform512: uniform512)
    rde.Scene(FOUR_R, (with_states("s", update=last),))
    with pytest.raises(ValueError, match=f"'s' of 'odd' take more than {MAX_DRAWS} draws"):
        rde.Scene(FOUR_R, (with_states("s[0]", "s[1]", update=last),))
