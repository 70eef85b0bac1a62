"""Datasets: each episode is replayed to the last bit from its seed and its actions; refused commands."""

import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from run_folders import FOUR_R, POLICIES, RPRP

from redundant_envs.compiler.backends import llvm
from redundant_envs.scenes.scene import load_scene
from redundant_envs_train.shipping import dataset
from redundant_envs_train.shipping.dataset import spec_of, write_dataset

pytestmark = pytest.mark.long

minari = pytest.importorskip("minari", reason="datasets need the extra 'datasets'")


def load(folder):
    return minari.MinariDataset(folder / "data")


def equal(found, expected):
    """Whether arrays, or dictionaries of arrays, have the same types and bits."""
    if isinstance(expected, dict):
        return found.keys() == expected.keys() and all(equal(found[k], expected[k]) for k in expected)
    return (found.dtype, found.shape, found.tobytes()) == (expected.dtype, expected.shape, expected.tobytes())


def replayed(env, seed, actions):
    """Arrays of an episode, in the order of a dataset's: observations, what a step gives, and infos."""
    obs, info = env.reset(seed=seed)
    seen, told, steps = [obs], [(env.unwrapped.tip, info["is_success"])], []
    for action in actions:
        obs, *step, info = env.step(action)
        seen.append(obs)
        steps.append(step)
        told.append((env.unwrapped.tip, info["is_success"]))
    assert steps[-1][1] or steps[-1][2]
    whole = {k: np.stack([o[k] for o in seen]) for k in obs} if isinstance(obs, dict) else np.stack(seen)
    return whole, *map(np.array, zip(*steps, strict=True)), *map(np.array, zip(*told, strict=True))


def assert_replayed(folder, first, count):
    """The environment of a dataset replays each episode to the last bit, from its seed."""
    found = load(folder)
    env = found.recover_environment()
    assert (env.observation_space, env.action_space) == (found.observation_space, found.action_space)
    seeds = [one["seed"] for one in found.storage.get_episode_metadata(found.episode_indices)]
    assert seeds == [*range(first, first + count)]
    for seed, episode in zip(seeds, found, strict=True):
        steps = episode.rewards, episode.terminations, episode.truncations
        told = episode.infos["tip"], episode.infos["is_success"]
        again = replayed(env, seed, episode.actions)
        assert all(map(equal, again, (episode.observations, *steps, *told))), seed
        squares = np.square(episode.actions.astype(float)).mean(axis=1)
        assert equal(episode.infos["effort"], np.array([0.0, *squares]))


CASES = {
    "computed torque": (20, ["expert", "--env", "RPRPReach-v0"]),
    "random": (20, ["random", "--env", FOUR_R]),
    "SAC": (20, [POLICIES / "RPRPReach-v0-sac"]),
    "HER": (8, [POLICIES / "RPRPGoalReach-v0-her"]),
}


@pytest.mark.parametrize(("count", "words"), CASES.values(), ids=CASES)
def test_every_episode_is_replayed_to_the_last_bit(count, words, call, tmp_path, monkeypatch):
    monkeypatch.setattr(dataset, "LANES", -(-count // 2))  # two batches
    out, _ = call("dataset", *words, "--episodes", count, "--seed", 3, "--out", tmp_path / "made-v1")
    found = load(tmp_path / "made-v1")
    assert (found.total_episodes, found.id) == (count, "made-v1")
    assert f"{count} episodes of {found.total_steps} steps in all" in out
    assert any(episode.infos["is_success"][-1] for episode in found) == (words[0] != "random")
    assert_replayed(tmp_path / "made-v1", 3, count)


def test_a_dataset_has_the_scene_of_a_run_whose_file_is_gone(run, call):
    call("dataset", run, "--episodes", 9, "--out", "../mine")
    env = load(Path("../mine")).recover_environment()
    assert env.spec.max_episode_steps == 20
    (friction,) = (e for e in env.spec.kwargs["scene"]["effects"] if e["type"] == "ViscousFriction")
    assert friction["coefficients"] == [0.3] * 4
    assert_replayed(Path("../mine"), 0, 9)


SENSORS = {**load_scene("cheap_sensors").to_dict(), "randomize": {"gravity.g": {"uniform": [8, 11]}}}
OTHERS = {
    "noise, ranges, shown numbers": {"scene": SENSORS, "observe_parameters": ["gravity.g"]},
    "faults": {"scene": load_scene("rprp_reach").to_dict(), "task": {"speed_bound": 6.0}},
}


@pytest.mark.parametrize("kwargs", OTHERS.values(), ids=OTHERS)
def test_arguments_of_environments_are_kept(kwargs, tmp_path, monkeypatch):
    monkeypatch.setattr(llvm, "EFFORT", 0)
    monkeypatch.setattr(dataset, "LANES", 4)  # up to four environments share one program with one
    monkeypatch.setattr(dataset, "spec_of", lambda env_id, given: spec_of(env_id, kwargs))
    write_dataset("random", RPRP, 8, 0, tmp_path / "made")
    assert_replayed(tmp_path / "made", 0, 8)
    assert [episode.terminations[-1] for episode in load(tmp_path / "made")] == [("task" in kwargs)] * 8
    if "observe_parameters" in kwargs:
        shown = {episode.observations[0, -1] for episode in load(tmp_path / "made")}
        assert len(shown) == 8
        assert min(shown) >= 8


def test_a_recovered_environment_imports_the_modules_of_the_command(tmp_path, monkeypatch):
    (tmp_path / "of_a_user.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("redundant_envs_train.shipping.dataset.IMPORTED", ["of_a_user"])
    write_dataset("random", RPRP, 2, 0, tmp_path / "made")
    sys.modules.pop("of_a_user", None)
    assert_replayed(tmp_path / "made", 0, 2)
    assert sys.modules.pop("of_a_user")


@pytest.mark.parametrize(("end", "status"), [(KeyboardInterrupt(), 130), (OSError("the disk is broken"), 2)])
def test_a_dataset_that_was_not_finished_leaves_nothing(end, status, call, tmp_path, monkeypatch):
    made, batches = gym.make_vec, []

    def make_vec(*given, **more):
        (part,) = tmp_path.iterdir()
        batches.append([path.stat().st_size for path in part.rglob("main_data.hdf5")])
        if len(batches) > 1:
            raise end
        return made(*given, **more)

    monkeypatch.setattr(dataset, "LANES", 10)
    monkeypatch.setattr(gym, "make_vec", make_vec)
    words = ["--env", RPRP, "--episodes", 20, "--out", tmp_path / "new" / "made"]
    _, error = call("dataset", "random", *words, status=status)
    assert error.splitlines()[-1] in ("stopped", "error: the disk is broken")
    assert batches[1][0] > 1e5  # the first batch was written
    assert not [*tmp_path.iterdir()]


def test_a_disk_without_room_is_told_before_anything_is_played(refused, tmp_path, monkeypatch):
    monkeypatch.setattr(dataset, "free_bytes", lambda path: 10**6)
    words = ["dataset", "random", "--env", RPRP, "--episodes", 21, "--out", tmp_path / "new" / "made"]
    refused(words, "out is on a disk with 1 MB left; choose another, or fewer --episodes")
    assert not [*tmp_path.iterdir()]
