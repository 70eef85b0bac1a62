"""Snapshots of simulators: those of the same scene are restored completely, others refused by name."""

import dataclasses
import pickle
import re

import catalogue
import gymnasium
import numpy as np
import pytest

import redundant_envs as rde

e = rde.effects
ARM = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))
STOP = e.PrismaticStop((0.0, 0.0), (0.3, 0.2), 0.4)
SCENE = rde.Scene(ARM, (e.Gravity(), STOP), tolerance=1e-6)
COUNT = 11


def started(scene=SCENE, count=COUNT, **kwargs):
    return catalogue.started(scene, count, **kwargs)


@pytest.fixture
def unchanged():
    """A simulator that the test must leave as it is."""
    batch = started()
    before = batch.save()
    yield batch
    for name, now in batch.save().items():
        np.testing.assert_array_equal(now, before[name])


def end(batch):
    """States after one more interval."""
    batch.advance()
    return np.hstack([batch.q, batch.qd])


OTHERS = {
    "tolerance is 1e-12 there and 1e-06 here": {"tolerance": 1e-12},
    "robot.masses[2] is 0.9 there and 1.0 here": {"robot": rde.RPRP((2.0, 1.5, 0.9, 0.5), (0.3, 0.5))},
    "effects[0].g is 1.6 there": {"effects": (e.Gravity(1.6), STOP)},
    "effects is ['PrismaticStop'] there and ['Gravity', 'PrismaticStop'] here": {"effects": (STOP,)},
    "integrator is dop853 there and rk8 here": {"tolerance": None, "integrator": "dop853"},
    "robot.type is FourR there and RPRP here": {"robot": rde.FourR((1.0,) * 4, (0.5,) * 4), "effects": ()},
}


@pytest.mark.long
@pytest.mark.parametrize(("words", "changes"), OTHERS.items(), ids=OTHERS)
def test_a_snapshot_of_another_scene_is_refused_by_name_and_changes_nothing(unchanged, words, changes):
    with pytest.raises(ValueError, match=f"snapshot is of another scene.*{re.escape(words)}"):
        unchanged.restore(started(dataclasses.replace(SCENE, **changes)).save())


NESTED = f'{{"num_envs":{"[" * 500}{"]" * 500}}}'
NO_SNAPSHOTS = {
    "is 0.5; use the mapping": lambda s: 0.5,
    "array.*mapping": lambda s: s["states"],
    "has the keys states, and needs simulator, states, parameters": lambda s: {"states": s["states"]},
    "has the keys .*extra": lambda s: s | {"extra": 1},
    r"\['simulator'\] is '\[\[.*must be the text": lambda s: s | {"simulator": "[" * 100_000},
    r"num_envs is \[\[\[.* there and 11 here": lambda s: s | {"simulator": NESTED},
    r"\['states'\] is 0.5; give an array": lambda s: s | {"states": 0.5},
    r"\['states'\] is an array of shape \(\d+,\)": lambda s: s | {"states": s["states"][:-8]},
    "float32": lambda s: s | {"states": s["states"].astype(np.float32)},
    r"\['parameters'\] is \[.*; give an array": lambda s: s | {"parameters": s["parameters"].tolist()},
    r"\['parameters'\] is an array of shape": lambda s: s | {"parameters": s["parameters"][:-8]},
    "not finite": lambda s: s | {"parameters": s["parameters"] * np.nan},
    "belongs to the scene": lambda s: s | {"parameters": s["parameters"] * 0.0},
}


@pytest.mark.parametrize("words", NO_SNAPSHOTS)
def test_what_is_no_snapshot_is_refused_and_changes_nothing(unchanged, words):
    with pytest.raises(ValueError, match=f"snapshot.*{words}"):
        unchanged.restore(NO_SNAPSHOTS[words](unchanged.save()))


def test_a_snapshot_of_lanes_that_share_their_parameters_is_taken_by_others_that_do_not():
    """And the other way round: the motion that follows is that of the snapshot."""
    alike, apart = started(), started()
    apart.set_parameters({"masses": np.random.default_rng(1).uniform(0.5, 2.0, (COUNT, 4))})
    snapshots = alike.save(), apart.save()
    assert snapshots[0]["parameters"].size < snapshots[1]["parameters"].size
    expected = end(alike), end(apart)
    assert (expected[0] != expected[1]).any()
    for batch, snapshot, there in zip((apart, alike), snapshots, expected, strict=True):
        batch.restore(snapshot)
        np.testing.assert_array_equal(end(batch), there)


def test_a_snapshot_is_taken_by_an_equal_simulator_through_a_file_too(tmp_path):
    batch = started()
    batch.set_parameters({"masses": np.random.default_rng(1).uniform(0.5, 2.0, (COUNT, 4))})
    snapshot = batch.save()
    np.savez(tmp_path / "snapshot.npz", **snapshot)
    expected = end(batch)
    with np.load(tmp_path / "snapshot.npz") as loaded:
        for again in (snapshot, pickle.loads(pickle.dumps(snapshot)), loaded, dict(loaded)):
            twin = rde.BatchSimulator(rde.Scene.from_dict(SCENE.to_dict()), COUNT, threads=2)
            twin.restore(again)
            np.testing.assert_array_equal(end(twin), expected)


@pytest.mark.long
def test_an_environment_with_stops_that_are_open_on_some_sides_takes_its_state_and_its_numbers_again():
    open_stop = e.PrismaticStop((None, None), (0.3, None), 0.4)
    springs = tuple(e.LimitSpring(slider, 0.0, 0.3) for slider in ("r1", "r2"))  # a task needs some limits
    scene = dataclasses.replace(SCENE, effects=(e.Gravity(), e.EffortLimits(10.0), open_stop, *springs))
    env = gymnasium.make("redundant_envs/RPRPReach-v0", scene=scene.to_dict()).unwrapped
    env.reset(seed=0)
    own = {name: number.value for name, number in env.parameters.items()}
    env.reset(seed=0, options={"parameters": own | {"prismatic_stop.restitution": 0.3}})
    with pytest.raises(ValueError, match=r"prismatic_stop\.upper has non-finite"):
        env.reset(options={"parameters": {"prismatic_stop.upper": [np.inf, np.inf]}})
    state, action = env.get_state(), env.action_space.sample()
    first = env.step(action)
    env.set_state(state)
    np.testing.assert_array_equal(env.step(action)[0], first[0])


@pytest.mark.parametrize(
    ("index", "words"),
    [
        ([[0, 1]], "whole numbers"), ([0.5], "whole numbers"), ("1", "whole numbers"),
        ([1, 2, 1], "every lane once"), ([-1], r"lanes are 0\.\.10"), ([11], r"lanes are 0\.\.10"),
        ([True, False], "a mask of"), (True, "a mask of"),
    ],
)  # fmt: skip
def test_an_index_that_names_no_lanes_is_refused(unchanged, index, words):
    with pytest.raises(ValueError, match=f"index.*{words}"):
        unchanged.set_state(np.zeros(4), np.zeros(4), index)
    with pytest.raises(ValueError, match=f"index.*{words}"):
        unchanged.set_parameters({"masses": 1.0}, index)


def test_an_index_may_be_one_number_unsigned_empty_or_a_mask(unchanged):
    batch = started()
    for index in (3, np.int8(4), np.array([1, 5], np.uint8), np.arange(COUNT) == 2):
        batch.set_state((0.5, 0.1, 0.5, 0.1), np.zeros(4), index)
    assert (batch.q[:, 0] == 0.5).nonzero()[0].tolist() == [1, 2, 3, 4, 5]
    numbers = {"masses": (1, 1, 1, 1), "lengths": 0.4, "gravity.g": 3.0, "prismatic_stop.upper": (0.5, 0.5)}
    for index in ([], np.zeros(COUNT, bool)):
        unchanged.set_state(np.zeros(4), np.zeros(4), index)
        unchanged.set_parameters(numbers, index)


Z, STOPS_AT = np.zeros, "prismatic_stop.upper"
BAD_TIMES = np.nan, -0.01, 0.0, "a", None, 10**400
REFUSED = [
    (lambda b: b.set_state(Z(3), Z(4)), r"q has shape \(3,\)"),
    (lambda b: b.set_state(Z(4), Z((5, 4))), r"qd has shape \(5, 4\)"),
    (lambda b: b.set_state((0.0, 0.1, 0.0, 9.0), Z(4), [2]), "r2 is 9 m; its stops"),
    (lambda b: b.set_state("zero", Z(4)), "q is 'zero'; give"),
    (lambda b: b.set_parameters({"masses": 2.0, "payload.mass": 1.0}), "'payload.mass'.*masses.*gravity.g"),
    (lambda b: b.set_parameters({"masses": (1, 2, -1, 1)}), "masses .*-1"),
    (lambda b: b.set_parameters({"masses": 2.0, "gravity.g": np.nan}), "gravity.g .*finite"),
    (lambda b: b.set_parameters({"masses": 2.0, STOPS_AT: (-1.0, 0.2)}, [1]), "PrismaticStop|prismatic_stop"),
    (lambda b: b.set_parameters({STOPS_AT: (1e-3, 1e-3)}), "its stops are at 0 and 0.001 m"),
    (lambda b: b.set_parameters(3), "parameters is 3; give a mapping"),
    (lambda b: b.set_parameters({"masses": 1.0, "m1": 2.0}), "set m1 twice, by 'masses' and 'm1'; leave"),
    (lambda b: b.advance(Z((COUNT, 3))), rf"efforts has shape \({COUNT}, 3\)"),
    (lambda b: b.advance([["x"] * 4] * COUNT), "efforts is .*give real numbers"),
    *((lambda b, t=t: b.advance_partly(None, t), "^duration is .* finite and positive") for t in BAD_TIMES),
    (lambda b: b.restore(started(count=5).save()), "num_envs is 5 there and 11 here"),
    (lambda b: b.restore(started(track_work=True).save()), "track_work"),
    (lambda b: b.work, "track_work"),
]


@pytest.mark.parametrize(("call", "said"), REFUSED)
def test_a_refused_call_names_the_field_and_changes_nothing(unchanged, call, said):
    with pytest.raises(ValueError, match=said):
        call(unchanged)


def test_a_lane_without_a_finite_state_is_kept_as_it_is():
    batch = started()
    batch.set_state(np.full(4, np.nan), np.zeros(4), index=[3])
    snapshot = batch.save()
    batch.set_state(np.zeros(4), np.zeros(4), index=[3])
    batch.restore(snapshot)
    assert np.isnan(batch.q[3]).all()


def test_an_arm_without_lengths_takes_masses_and_snapshots_of_others():
    scene = rde.Scene(rde.Chain("PP", masses=(1.0, 2.0), lengths=()))
    one, other = started(scene, 2), started(scene, 2)
    one.set_parameters({"masses": [[1.0, 2.0], [3.0, 2.0]]})
    other.restore(one.save())
    for name, now in other.save().items():
        np.testing.assert_array_equal(now, one.save()[name])
