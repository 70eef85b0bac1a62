"""Calls in any order, drawn and made small by Hypothesis, inside structures that are compiled once.

Each machine keeps a twin: what is saved, copied or pickled continues as what went on.
"""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

import redundant_envs as rde

from .played import same

RPRP = rde.load_scene("rprp_reach")
LANES = 3
EPISODE = 6
SETTINGS = settings(
    max_examples=12,
    stateful_step_count=20,
    deadline=None,
    database=None,
    phases=(Phase.generate, Phase.shrink),
    print_blob=True,
    suppress_health_check=list(HealthCheck),
)
seeds = st.integers(0, 2**31 - 1)
ordinary = st.sampled_from([-1.0, -0.5, 0.0, 0.3, 1.0, 7.0])
wild = st.sampled_from([float("nan"), float("inf"), 1e300, 5e-324])
masks = st.lists(st.booleans(), min_size=LANES, max_size=LANES).filter(any)


def rows(numbers):
    return st.lists(st.lists(numbers, min_size=4, max_size=4), min_size=LANES, max_size=LANES)


def tables(given):
    return list(given.values()) if isinstance(given, dict) else [given]


# ---- batches -------------------------------------------------------------------------------------------


class Simulator(RuleBasedStateMachine):
    """Two simulators, one of which is replaced by copies and snapshots of the other."""

    def __init__(self):
        super().__init__()
        self.batch = rde.BatchSimulator(RPRP, LANES)
        self.twin = rde.BatchSimulator(RPRP, LANES, threads=2)
        self.snapshot = self.batch.save()

    @rule(
        places=rows(st.sampled_from([0.0, 1e-12, 0.1, 0.25])), speeds=rows(st.sampled_from([0.0, -3.0, 20.0]))
    )
    def set_state(self, places, speeds):
        for batch in (self.batch, self.twin):
            batch.set_state(places, speeds)

    @rule(lane=st.integers(0, LANES - 1), mass=st.floats(0.1, 10.0))
    def set_parameters(self, lane, mass):
        for batch in (self.batch, self.twin):
            batch.set_parameters({"masses": mass, "gravity.g": 1.6}, [lane])

    @rule(efforts=rows(st.sampled_from([-30.0, 0.0, 5.0, 30.0, 5e-324])))
    def advance(self, efforts):
        one, other = (batch.advance(efforts) for batch in (self.batch, self.twin))
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b)

    @rule(bad=st.sampled_from([{"masses": -1.0}, {"unknown": 1.0}, {"masses": float("nan")}]))
    def refused_parameters(self, bad):
        with pytest.raises(ValueError, match=r"masses|unknown"):
            self.batch.set_parameters(bad)

    @rule()
    def refused_state(self):
        with pytest.raises(ValueError, match="stops"):
            self.batch.set_state([0.0, 0.3, 0.0, 0.1], np.zeros(4))

    @rule()
    def save(self):
        self.snapshot = self.batch.save()

    @rule()
    def restore(self):
        for batch in (self.batch, self.twin):
            batch.restore(self.snapshot)

    @rule(how=st.sampled_from([copy.copy, copy.deepcopy, lambda batch: pickle.loads(pickle.dumps(batch))]))
    def replace_the_twin(self, how):
        self.twin = how(self.batch)

    @invariant()
    def both_are_alike_and_between_their_stops(self):
        assert np.all(same(self.batch.q, self.twin.q))
        assert np.all(same(self.batch.qd, self.twin.qd))
        sliders = self.batch.q[:, [1, 3]]
        assert (sliders >= 0.0).all()
        assert (sliders <= 0.25).all()


# ---- environments --------------------------------------------------------------------------------------


class Environment(RuleBasedStateMachine):
    """Base for all kinds: two environments, the second of which is replaced by copies of the first."""

    env_id = "redundant_envs/RPRPReach-v0"
    mode = "next_step"

    def __init__(self):
        super().__init__()
        self.ready, self.saved = False, None
        self.ended = np.zeros(LANES, bool)
        self.env, self.twin = self.made(), self.made()

    def made(self):
        return gym.make_vec(self.env_id, num_envs=LANES, max_episode_steps=EPISODE, autoreset_mode=self.mode)

    def reset_one(self, env, seed, options):
        return env.reset(seed=seed, options=options)[0]

    def step_one(self, env, actions):
        """Observations, rewards, and whether lanes ended."""
        obs, reward, terminated, truncated, _ = env.step(actions)
        return obs, reward, terminated | truncated

    def check(self, one, other):
        space = self.env.observation_space
        assert space.contains(one) or not isinstance(space, gym.Space), one
        for a, b in zip(tables(one), tables(other), strict=True):
            assert np.isfinite(a).all()
            np.testing.assert_array_equal(a, b)

    @initialize(seed=seeds, actions=rows(ordinary))
    def begin(self, seed, actions):
        for env in (self.env, self.twin):
            with pytest.raises(ResetNeeded):
                self.step_one(env, np.array(actions, np.float32))
        self.reset_all(seed)

    def reset_all(self, seed, options=None):
        found = [self.reset_one(env, seed, dict(options or {})) for env in (self.env, self.twin)]
        self.check(*found)
        self.ended[:] = False

    @rule(seed=st.none() | seeds)
    def reset(self, seed):
        self.reset_all(seed)

    @rule(seed=seeds, mass=st.floats(0.2, 5.0), speed=st.sampled_from([0.0, 10.0, 1e6, 1e100]))
    def reset_with_options(self, seed, mass, speed):
        self.reset_all(seed, {"qd": [0.0, 0.0, speed, 0.0], "parameters": {"masses": mass}})

    @rule(bad=st.sampled_from([{"unknown": 1}, {"qd": [1e200] * 4}, {"parameters": {"masses": -1.0}}]))
    def refused_reset(self, bad):
        # Gymnasium's TimeLimit starts counting again nevertheless: both are called.
        for env in (self.env, self.twin):
            with pytest.raises(ValueError, match=r"unknown|qd|masses"):
                self.reset_one(env, None, bad)

    def step_both(self, actions):
        if self.mode == "disabled" and self.ended.any():
            with pytest.raises(ValueError, match="have ended"):
                self.step_one(self.env, actions)
            return
        (obs, reward, ended), (other, other_reward, other_ended) = (
            self.step_one(env, actions) for env in (self.env, self.twin)
        )
        self.check(obs, other)
        np.testing.assert_array_equal(reward, other_reward)
        np.testing.assert_array_equal(ended, other_ended)
        assert np.isfinite(reward).all()
        assert (np.asarray(reward) <= 1.0 + 1e-9).all()
        self.ended = np.atleast_1d(ended).copy()

    @rule(actions=rows(ordinary))
    def step(self, actions):
        self.step_both(np.array(actions, np.float32))

    @rule(actions=rows(ordinary | wild))
    def step_with_numbers_of_any_kind(self, actions):
        self.step_both(np.array(actions))

    @rule()
    def refused_step(self):
        with pytest.raises(ValueError, match="shape"):
            self.step_one(self.env, np.zeros((LANES, 5), np.float32))

    @rule()
    def save(self):
        self.saved = (self.inner(self.env).get_state(), self.ended.copy(), self.count(self.env))

    @precondition(lambda self: self.saved is not None)
    @rule()
    def restore(self):
        state, ended, count = self.saved
        for env in (self.env, self.twin):
            self.inner(env).set_state(state)
            self.set_count(env, count)
        self.ended = ended.copy()

    @rule(how=st.sampled_from([copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))]))
    def replace_the_twin(self, how):
        self.twin = how(self.env)

    @rule()
    def set_another_to_the_state(self):
        """A new environment, with other generators."""
        self.twin = self.made()
        self.twin.reset()
        self.inner(self.twin).set_state(self.inner(self.env).get_state())
        self.set_count(self.twin, self.count(self.env))

    @staticmethod
    def inner(env):
        return env.unwrapped if isinstance(env, gym.Env) else env

    def count(self, env):
        """Steps of the wrapper of a single environment; others have none."""
        return None

    def set_count(self, env, count):
        pass

    @invariant()
    def sliders_are_between_their_stops(self):
        sliders = self.inner(self.env).q.reshape(-1, 4)[:, [1, 3]]
        assert ((sliders >= 0.0) & (sliders <= 0.25)).all()


class Vector(Environment):
    @rule(mask=masks, seed=st.none() | seeds)
    def partial_reset(self, mask, seed):
        options = {"reset_mask": np.array(mask)}
        found = [env.reset(seed=seed, options=dict(options))[0] for env in (self.env, self.twin)]
        self.check(*found)
        self.ended &= ~np.array(mask)


class SameStep(Vector):
    mode = "same_step"


class Disabled(Vector):
    mode = "disabled"


class Goals(Vector):
    env_id = "redundant_envs/RPRPGoalReach-v0"

    @rule(goals=st.lists(st.floats(-0.2, 0.2), min_size=2, max_size=2))
    def reset_to_a_goal(self, goals):
        self.reset_all(5, {"goal": goals})


class Single(Environment):
    def made(self):
        return gym.make(self.env_id, max_episode_steps=EPISODE, disable_env_checker=True)

    def reset_one(self, env, seed, options):
        return env.reset(seed=seed, options=options)[0]

    def step_one(self, env, actions):
        obs, reward, terminated, truncated, _ = env.step(actions[0])
        return obs, reward, terminated or truncated

    def step_both(self, actions):
        """The arm continues even after the limit of steps. After a fault it does not."""
        if self.env.unwrapped.core.memory.read(("terminated",)).any():
            for env in (self.env, self.twin):
                with pytest.raises(ResetNeeded, match="after the end"):
                    self.step_one(env, actions)
            return
        if not np.isfinite(actions[0]).all():
            with pytest.raises(ValueError, match="non-finite"):
                self.step_one(self.env, actions)
            return
        super().step_both(actions)

    def refused_step(self):
        with pytest.raises(ValueError, match="shape"):
            self.env.step(np.zeros(5, np.float32))

    def count(self, env):
        return env._elapsed_steps

    def set_count(self, env, count):
        env._elapsed_steps = count


class StableBaselines(Environment):
    def made(self):
        return rde.make_sb3(self.env_id, LANES, max_episode_steps=EPISODE)

    def reset_one(self, env, seed, options):
        if seed is not None:
            env.seed(seed)
        env.set_options(options)
        return env.reset()

    def step_one(self, env, actions):
        obs, reward, dones, infos = env.step(actions)
        for lane in np.flatnonzero(dones):
            assert np.isfinite(infos[lane]["terminal_observation"]).all()
        return obs, reward, dones

    def check(self, one, other):
        assert self.env.observation_space.shape == one.shape[1:]
        assert (np.abs(one) <= 1.0).all()
        np.testing.assert_array_equal(one, other)


for machine in (Simulator, Vector, SameStep, Disabled, Goals, Single, StableBaselines):
    machine.TestCase.settings = SETTINGS

TestSimulator = Simulator.TestCase
TestVector = Vector.TestCase
TestSameStep = SameStep.TestCase
TestDisabled = Disabled.TestCase
TestGoals = Goals.TestCase
TestSingle = Single.TestCase
TestStableBaselines = StableBaselines.TestCase
