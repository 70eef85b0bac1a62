"""Each promise about calls sees the fault that it is there for, and verify's are judged at the drawn states."""

import functools
from collections import Counter

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.envs.core import Core
from redundant_envs.envs.vector_env import ArmVectorEnv
from redundant_envs.verify import conservation

from .cases import plain
from .drawing_calls import step
from .invariants import GIVEN_UP, NAMES, OF_VERIFY, violations

pytestmark = pytest.mark.long

LANES = 10
RNG = np.random.default_rng(0)
SCENE = {**rde.load_scene("rprp_reach").to_dict(), "tolerance": 1e-7}
STARTS = {
    "q": np.tile([0.3, 0.1, -0.4, 0.2], (LANES, 1)) + 0.02 * RNG.uniform(size=(LANES, 4)),
    "qd": RNG.normal(size=(LANES, 4)),
}


def advance():
    return {"call": "advance", "rows": {"efforts": RNG.uniform(-15.0, 15.0, (LANES, 4))}}


def random_step():
    return step(RNG.uniform(-1.0, 1.0, (4, 4)))


CASE = plain({"face": "simulator", "scene": SCENE, "num_envs": LANES, "threads": 1, "calls": [
    {"call": "set_state", "rows": STARTS},
    advance(),
    {"call": "set_parameters", "parameters": {"masses": -1.0}, "refused": "masses"},
    {"call": "save"},
    advance(),
    {"call": "restore"},
    {"call": "copy"},
    advance(),
]})  # fmt: skip
EPISODES = plain({
    "face": "vector", "goal": False, "scene": SCENE, "num_envs": 4, "threads": 1, "task": {},
    "autoreset_mode": "next_step", "on_bad_action": "terminate", "max_episode_steps": 3, "calls": [
    {"call": "reset", "rows": {"seed": [5, 6, 7, 8]}},
    *(random_step() for _ in range(3)),
    {"call": "save"},
    {"call": "reset", "options": {"unknown": 1.0}, "refused": "unknown"},
    {"call": "reset"},
    step([[np.nan, 0.0, 0.0, 0.0], *[[0.1] * 4] * 3]),
    random_step(),
    random_step(),
    {"call": "restore"},
    {"call": "reset"},
    step([[0.5] * 4] * 4),
]})  # fmt: skip


def broken(case, only=()):
    return {v.invariant for v in violations(case, only=only)}


def test_the_simulator_breaks_no_promise():
    tally = Counter()
    assert violations(CASE, tally) == []
    assert (tally["intervals"], tally["refused"]) == (3 * LANES, 1)
    assert all(tally[f"{name} kept"] == 1 for name in OF_VERIFY)


@pytest.mark.parametrize("goal", [False, True])
def test_the_environments_break_no_promise(goal):
    tally = Counter()
    assert violations({**EPISODES, "goal": goal}, tally) == []
    assert tally["episodes"] >= 2
    assert tally["early_ends"] == 1


# ---- faults -----------------------------------------------------------------------------------------------


def then(change):
    """A method, and after it a change of its object and of what it returned."""

    def both(self, method, *args):
        told = method(*args)
        change(self, told)
        return told

    return both


def field(name, value, lane):
    """A number of a lane becomes another."""
    return then(lambda batch, _: batch._memory.write((name,), value, np.array([lane])))


def part(k, at, value):
    """So does one of the results of a call."""

    def change(_, found):
        found[k][at] = value

    return then(change)


def raises(self, method, *args):
    raise RuntimeError("not documented")


def changes_what_it_refuses(batch, set_parameters, *args):
    batch._memory.write(("theta1",), batch.q[:, :1] + 1e-3)
    set_parameters(*args)


def forgets_a_digit(batch, told):
    batch._memory.write((batch.scene.robot.rates[0],), np.float32(batch.qd[:, :1]))


def pays_at_an_end(env, found):
    found[1][found[2]] += 0.01


def mixes_lanes(env, found):
    if len(found[0]) > 1:
        found[0][0, 0] += 1e-6 * np.sign(found[0][1, 0])


def keeps_its_generators(core, set_state, state):
    kept = core.generators
    set_state(state)
    core._episode_keys.generators = kept


def draws_before_it_refuses(core, checked, options, lanes):
    core.waiting[lanes] = False
    core.provide_keys(lanes)
    return checked(options, lanes)


def knows_the_first(batch, told):
    if batch.scene.effects[0].key == "gravity":
        batch._memory.write(("theta1",), batch.q[:, :1] + 1e-8)


BATCH, VECTOR = rde.BatchSimulator, ArmVectorEnv
FAULTS = [
    (BATCH, "advance", raises, "only_documented_exceptions"),
    (BATCH, "set_parameters", lambda *_: None, "only_documented_exceptions"),
    (BATCH, "set_parameters", changes_what_it_refuses, "a_refused_call_changes_nothing"),
    (BATCH, "advance", field("theta2", np.nan, 2), "what_is_not_finite_is_flagged"),
    (BATCH, "advance", part(1, 4, 840_000), "the_work_of_an_interval_is_bounded"),
    (BATCH, "advance", part(4, 4, GIVEN_UP), "a_given_up_interval_leaves_its_lane"),
    (BATCH, "restore", then(forgets_a_digit), "what_is_saved_continues"),
    (BATCH, "advance_partly", then(knows_the_first), "effects_commute"),
    (VECTOR, "step", part(0, (-1, 2), np.nan), "observations_lie_in_their_space"),
    (VECTOR, "step", part(0, (-1, 2), 1.0001), "observations_lie_in_their_space"),
    (VECTOR, "step", then(pays_at_an_end), "no_early_end_pays"),
    (VECTOR, "step", part(1, 0, 1.5), "no_early_end_pays"),
    (VECTOR, "step", then(mixes_lanes), "no_lane_depends_on_others"),
    (Core, "set_state", keeps_its_generators, "what_is_saved_continues"),
    (Core, "checked", draws_before_it_refuses, "a_refused_call_changes_nothing"),
]
"""What is changed in a method of a class, and the promise that is broken then."""


@pytest.mark.parametrize(("kind", "method", "change", "name"), FAULTS)
def test_a_fault_is_seen(monkeypatch, kind, method, change, name):
    right = getattr(kind, method)
    monkeypatch.setattr(kind, method, lambda self, *args: change(self, functools.partial(right, self), *args))
    assert broken(CASE if kind is BATCH else EPISODES, (name,)) == {name}


def test_every_promise_about_calls_is_seen_broken():
    assert {name for *_, name in FAULTS} == NAMES - set(OF_VERIFY) | {"effects_commute"}


def test_verify_judges_the_states_of_a_case(monkeypatch):
    """A tip that is off only far out, where no lane of another case is, breaks its tolerance."""
    own = conservation.own_interval

    def off_at_high_rates(trial):
        end = own(trial)
        return end._replace(q=end.q + 1e-5 * (np.abs(trial.states[1]) > 50.0).any(axis=1, keepdims=True))

    monkeypatch.setattr("redundant_envs.verify.accuracy.own_interval", off_at_high_rates)
    assert broken(CASE, ("tolerance_kept",)) == set()
    fast = plain(CASE)
    fast["calls"][0]["rows"]["qd"] = (60.0 * np.array(STARTS["qd"])).tolist()
    assert broken(fast, ("tolerance_kept",)) == {"tolerance_kept"}
