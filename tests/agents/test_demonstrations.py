"""Demonstrations: whose episodes they are, which of them count, and their share of each sample."""

import shutil

import gymnasium as gym
import pytest
import torch
import yaml
from run_folders import RPRP, says
from short_trainings import CASES, kill, small_config

import redundant_envs as rde
from redundant_envs.envs.arguments import with_mode
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs_train.learners.build import make_model
from redundant_envs_train.run_folder import read_facts
from redundant_envs_train.shipping.dataset import spec_of, write_dataset
from redundant_envs_train.training import demonstrations
from redundant_envs_train.training.dataset_episodes import simulated
from redundant_envs_train.training.train import resume, train

SHORT = {"max_episode_steps": 60}  # too short for some goals of the expert


def env_of(config):
    return make_sb3(config.env, config.num_envs, **config.env_kwargs)


def of(**settings):
    config = small_config("sac", env_kwargs=SHORT, demonstrations={"episodes": 30, **settings})
    return config, demonstrations.of(config, config.env_kwargs, env_of(config))


@pytest.fixture(scope="module")
def shown():
    return of()


def test_transitions_are_those_of_the_episodes_that_hold_their_goal(shown):
    _, found = shown
    assert found.played == 30
    assert 0 < found.held <= 30
    rows = found.transitions
    assert len(rows.actions) == 60 * found.held
    assert all(part.dtype == torch.float32 for part in rows[:5])
    now, after = (part.reshape(found.held, 60, -1) for part in (rows.observations, rows.next_observations))
    assert torch.equal(now[:, 1:], after[:, :-1])
    assert not rows.dones.any()  # the time ends them, and values go on
    assert rows.rewards.reshape(found.held, 60)[:, -10:].min() > 0.9  # at the goal


def test_the_same_seed_gives_the_same_demonstrations_and_another_one_others(shown):
    config, found = shown
    assert demonstrations.of(config, SHORT, env_of(config)).sha256 == found.sha256
    other = config.model_copy(update={"seed": 5})
    assert demonstrations.of(other, SHORT, env_of(config)).sha256 != found.sha256


@pytest.mark.parametrize("case", ["sac", "her"])
def test_each_gradient_step_has_its_share_of_demonstrations(case, tmp_path):
    config = small_config(
        case, total_steps=3200, demonstrations={"episodes": 20, "share": 0.25},
        **{case: {**CASES[case][case], "gradient_steps": 4}},
        **({"env_kwargs": SHORT} if case == "sac" else {}),
    )  # fmt: skip
    seen = []

    class Seen(Exception):
        """The first gradient steps."""

    def data(self, batch_size, gradient_steps):
        marked = self.demonstrations._replace(rewards=torch.full_like(self.demonstrations.rewards, 7.0))
        self.demonstrations = marked
        seen.append((batch_size, plain(self, batch_size, gradient_steps)[2]))
        raise Seen

    kind = type(make_model(config, env_of(config)))
    plain = kind._data
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kind, "_data", data)
        with pytest.raises(Seen):
            train(config, tmp_path / "run")
    batch_size, rewards = seen[0]
    of_steps = (rewards == 7.0).reshape(-1, batch_size).sum(1)
    assert of_steps.tolist() == [round(0.25 * batch_size)] * 4


@pytest.mark.long
def test_a_run_tells_of_its_demonstrations_and_goes_on_with_no_others(tmp_path, call):
    folder = tmp_path / "run"
    train(small_config("demonstrated", total_steps=800), folder)
    told = read_facts(folder)
    shown = told["demonstrations"]
    assert shown["episodes"] == 20
    assert 0 < shown["seconds"] < told["train_seconds"]
    call("report", str(folder))
    assert f"25 % of each sample came from the {shown['held']} of 20 demonstrations (`expert`)" in (
        folder / "report.md"
    ).read_text(encoding="utf-8")
    kill(tmp_path / "killed", "demonstrated", checkpoint_seconds=1e-9)
    fewer = small_config("demonstrated", demonstrations={"episodes": 19, "share": 0.25})
    one_less = demonstrations.of(fewer, fewer.env_kwargs, env_of(fewer))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demonstrations, "of", lambda *_: one_less)
        with says("it was made with demonstrations.sha256: ", "make a new run"):
            resume(tmp_path / "killed")


def test_an_environment_is_the_same_whichever_way_its_arguments_say_it():
    plain = spec_of(RPRP, {"action": "joint_velocity"})
    scene = with_mode(rde.load_scene("rprp_reach"), "joint_velocity")
    others = {"scene": scene}, {"action": "joint_velocity", "on_bad_action": "terminate"}
    assert all(simulated(spec_of(RPRP, given)) == simulated(plain) for given in others)
    assert simulated(gym.spec(RPRP)) == simulated(spec_of(RPRP, {})) != simulated(plain)


@pytest.mark.long
def test_an_expert_that_knows_no_such_actions_is_refused():
    with says("demonstrations.source is expert", "the expert knows efforts and joint velocities", "dataset"):
        config = small_config(
            "sac", env_kwargs={**SHORT, "action": "tip_velocity"}, demonstrations={"episodes": 2}
        )
        demonstrations.of(config, config.env_kwargs, env_of(config))


def test_episodes_that_hold_nothing_are_refused():
    config = small_config("sac", env_kwargs={"max_episode_steps": 12}, demonstrations={"episodes": 2})
    with says("none of its 2 episodes holds its goal"):
        demonstrations.of(config, config.env_kwargs, env_of(config))


@pytest.mark.long
def test_a_dataset_gives_what_the_expert_gives_and_is_of_the_same_environment(shown, tmp_path):
    pytest.importorskip("minari", reason="datasets need the extra 'datasets'")
    config, found = shown
    folder, first = tmp_path / "expert", config.seed * 10_000
    file = tmp_path / "short.yaml"
    file.write_text(yaml.safe_dump(config.to_dict()))
    write_dataset("expert", str(file), 30, first, folder)
    read = config.model_copy(
        update={"demonstrations": config.demonstrations.model_copy(update={"source": str(folder)})}
    )
    assert demonstrations.of(read, SHORT, env_of(read)).sha256 == found.sha256
    with says("demonstrations.source is", "recorded with max_episode_steps 60, and the training has 50"):
        demonstrations.of(read, {"max_episode_steps": 50}, env_of(read))
    with says("which is no sound Minari dataset", "give expert"):
        lost = config.demonstrations.model_copy(update={"source": str(tmp_path / "nowhere")})
        demonstrations.of(config.model_copy(update={"demonstrations": lost}), SHORT, env_of(config))


@pytest.mark.long
def test_a_dataset_of_an_action_mode_serves_a_run_whose_scene_has_the_mode(tmp_path):
    pytest.importorskip("minari", reason="datasets need the extra 'datasets'")
    config = small_config("demonstrated")
    file, folder = tmp_path / "mode.yaml", tmp_path / "dataset"
    file.write_text(yaml.safe_dump(config.to_dict()))
    write_dataset("expert", str(file), 10, 40_000, folder)
    read = small_config("demonstrated", demonstrations={"source": str(folder), "episodes": 10})
    env = env_of(read)
    held = {**read.env_kwargs, "scene": env.core.scene.to_dict()}  # as a run folder keeps it
    found = [demonstrations.of(read, kwargs, env) for kwargs in (read.env_kwargs, held)]
    assert found[0].sha256 == found[1].sha256
    slower = {**held, "scene": {**held["scene"], "control_dt": 0.01}}
    with says("recorded with scene.control_dt 0.02, and the training has 0.01"):
        demonstrations.of(read, slower, env)


@pytest.mark.long
def test_damaged_episodes_and_those_with_goals_of_evaluations_are_refused(tmp_path):
    pytest.importorskip("minari", reason="datasets need the extra 'datasets'")
    import h5py

    def of_source(source):
        given = {"source": str(tmp_path / source), "episodes": 3}
        read = small_config("sac", env_kwargs={}, demonstrations=given)
        return demonstrations.of(read, {}, env_of(read))

    write_dataset("expert", RPRP, 3, 0, tmp_path / "sound")
    assert of_source("sound").held == 3
    for k, (name, value, words) in enumerate((
        ("observations", float("nan"), "whose episode 1 has numbers that are not finite"),
        ("actions", 50.0, "whose episode 1 has actions of another shape, or outside -1 to 1"),
        ("rewards", None, "whose episode 1 has 100 actions and other numbers of rewards"),
        ("infos/is_success", None, "whose episode 1 lacks is_success"),
    )):  # fmt: skip
        shutil.copytree(tmp_path / "sound", tmp_path / f"broken{k}")
        with h5py.File(tmp_path / f"broken{k}" / "data" / "main_data.hdf5", "r+") as data:
            part = data[f"episode_1/{name}"]
            if value is None:
                short = part[:-1]
                del data[f"episode_1/{name}"]
                data[f"episode_1/{name}"] = short
            else:
                part[3] = value
        with says("demonstrations.source is", words):
            of_source(f"broken{k}")
    write_dataset("expert", RPRP, 2, 1_000_000, tmp_path / "goals")
    with says("with the seed 1000000, whose goals evaluate policies"):
        of_source("goals")
