"""Calls of vectors in any order: copies and states go on, a refused call changes nothing."""

import copy
import pickle

import numpy as np
import pytest
from faces import FOUR_R, GOAL_IDS, MODES, drawing, flat, made, parts
from gymnasium.error import ResetNeeded

COUNT = 5
WRONG = ({"unknown": 1.0}, {"parameters": {"masses": -1.0}}, {"parameters": 3.0}, {"goal": (1e9, 0.0)})


def put(env, again):
    again.set_state(env.get_state())
    return again


def drawn_call(rng):
    """A call of a vector, and whether it is refused; None: it may be."""
    kind, lanes = rng.integers(10), rng.random(COUNT) < 0.4
    actions = rng.uniform(-1.2, 1.2, (COUNT, 4)).astype(np.float32)
    if kind == 0:
        return lambda env: env.step(np.zeros((COUNT, 5), np.float32)), True
    if kind == 1:
        wrong = WRONG[rng.integers(len(WRONG))]
        return lambda env: env.reset(options=wrong), True
    if kind == 2:
        actions[lanes] = np.nan
        return lambda env: env.step(actions), None  # lanes that begin anew ignore their actions
    if kind == 3:
        lanes[rng.integers(COUNT)] = True
        options = {"reset_mask": lanes, "q": rng.uniform(-0.1, 0.1, 4), "parameters": {"gravity.g": 1.6}}
        return lambda env: env.reset(options=options), None
    if kind == 4:
        seed = int(rng.integers(2**31))
        return lambda env: env.reset(seed=seed), False
    return lambda env: env.step(actions), None  # refused where episodes have ended


@pytest.mark.quick("0-next_step-terminate")
@pytest.mark.parametrize("on_bad_action", ["terminate", "raise"])
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("seed", range(2))
def test_no_order_of_calls_breaks_a_promise(seed, mode, on_bad_action):
    """Another environment takes the place of the second one before each call."""
    rng, how = np.random.default_rng(seed), {"on_bad_action": on_bad_action, "max_episode_steps": 6}
    env_id, scene = (FOUR_R, {"scene": drawing()}) if seed else (GOAL_IDS[0], {})
    env, other = (made(mode, env_id, COUNT, **how, **scene) for _ in range(2))
    ways = copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))
    for one in (env, other):
        one.reset(seed=3)
    for k in range(40):
        call, refused = drawn_call(rng)
        other = [*ways, lambda x: put(x, made(mode, env_id, COUNT, **how, **scene))][k % 3](other)
        before, found = parts(env), []
        for one in (env, other):
            try:
                found.append(flat([*call(one)]))
            except (ValueError, ResetNeeded) as error:
                found.append(type(error))
        assert found[0] == found[1], k
        if isinstance(found[0], type):
            assert refused is not False
            assert parts(env) == before
        else:
            assert refused is not True
            seen = env.core.observe()[0]
            assert np.isfinite(flat(seen)).all()


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
