"""The fuzzer finds planted faults, makes their cases small, and plays them again."""

import functools

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.envs.core import Core
from redundant_envs.envs.vector_env import ArmVectorEnv

from . import cases, judging, running
from .cases import plain, read
from .drawing import drawn_vector

pytestmark = pytest.mark.long

SCENE, RNG = rde.load_scene("four_r_reach"), np.random.default_rng(0)
Q = np.tile([0.3, 0.1, -0.4, 0.2], (10, 1)) + 0.02 * RNG.uniform(size=(10, 4))
CALLS = [{"call": "set_state", "rows": {"q": Q, "qd": RNG.normal(size=(10, 4))}}]
CALLS += [{"call": "advance", "rows": {"efforts": RNG.uniform(-15.0, 15.0, (10, 4))}} for _ in range(3)]
MOTION = plain({"face": "simulator", "threads": 1, "scene": SCENE.to_dict(), "num_envs": 10, "calls": CALLS})
FIXED = {"num_envs": 4, "autoreset_mode": "next_step", "max_episode_steps": 5, "goal": False}
EPISODES = plain({"threads": 1} | drawn_vector(np.random.default_rng(3), SCENE, 40, **FIXED))


def then(change):
    """A method, and after it a change of its object and of what it returned."""

    def both(self, method, *args):
        told = method(*args)
        change(self, told)
        return told

    return both


def loses_the_last(batch, told):
    batch._memory.write(("theta2",), np.nan, np.array([batch.num_envs - 1]))


def knows_the_first(batch, told):
    if batch.scene.effects[0].key == "gravity":
        batch._memory.write(("theta1",), batch.q[:, :1] + 1e-8)


def numbers_its_lanes(batch, told):
    """The last digit of a lane follows from its number, far from the first."""
    late = np.arange(1000, batch.num_envs)
    batch._memory.write(("theta1",), np.nextafter(batch.q[late, :1], 9.0), late)


def mixes_lanes(env, found):
    if len(found[0]) > 1:
        found[0][0, 0] += 1e-6 * np.sign(found[0][1, 0])


def keeps_its_generators(core, set_state, state):
    kept = core.generators[:]
    set_state(state)
    core.generators[:] = kept


def draws_before_it_refuses(core, checked, options, lanes):
    core.waiting[lanes] = False
    return checked(options, lanes)


BATCH, VECTOR = rde.BatchSimulator, ArmVectorEnv
FAULTS = [
    (BATCH, "advance", then(loses_the_last), judging.FLAGS),
    (BATCH, "advance", then(lambda _, status: status.evaluations.fill(840_000)), judging.FLAGS),
    (BATCH, "advance_partly", then(knows_the_first), "effects_commute"),
    (BATCH, "advance", then(numbers_its_lanes), "thousands_have_the_same_bits"),
    (Core, "checked", lambda core, checked, options, lanes: checked({}, lanes), "only_documented_exceptions"),
    (Core, "checked", draws_before_it_refuses, "a_refused_call_changes_nothing"),
    (Core, "set_state", keeps_its_generators, "what_is_saved_continues"),
    (judging, "torch_step", lambda _, made: lambda *x: [y + 1e-7 for y in made()(*x)], "torch_step_agrees"),
    (VECTOR, "step", then(mixes_lanes), "no_lane_depends_on_others"),
    (VECTOR, "step", then(lambda _, found: found[0][-1].fill(np.nan)), "observations_lie_in_their_space"),
]
"""What is changed in a method of a class, and the promise that is broken then."""


@pytest.mark.parametrize(("kind", "method", "change", "name"), FAULTS)
def test_a_fault_is_found_made_small_and_played_again(monkeypatch, tmp_path, kind, method, change, name):
    case, right = MOTION if kind in (BATCH, judging) else EPISODES, getattr(kind, method)
    monkeypatch.setattr(running, "drawn", lambda seed, number: case)
    monkeypatch.setattr(cases, "SECONDS", np.inf if name == judging.FLAGS else 10.0)
    with monkeypatch.context() as patch:
        patch.setattr(kind, method, lambda self, *args: change(self, functools.partial(right, self), *args))
        _, (path,) = running.run(0, [0], np.inf, tmp_path, (name,))
        assert name in {v.invariant for v in running.judged(read(path), only=(name,))}
    small = read(path)
    assert small["fails"] == name
    assert small["num_envs"] < case["num_envs"] or len(small["calls"]) < len(case["calls"])
    if name == judging.FLAGS:  # one lane, one interval and no effect are enough
        assert (small["num_envs"], len(small["calls"]), small["scene"]["effects"]) == (1, 2, [])
    assert running.judged(small, only=(name,)) == []


def test_a_fault_is_planted_for_every_promise_but_those_of_verify():
    own = {"effects_commute", "thousands_have_the_same_bits", "torch_step_agrees"}
    assert {name for *_, name in FAULTS} == running.NAMES - set(judging.OF_VERIFY) | own
