"""A training that starts from a policy acts like it at first; policies that do not fit are refused."""

import hashlib
import json
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
import yaml
from run_folders import assert_same_policy

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs_train.__main__ import main
from redundant_envs_train.config import load
from redundant_envs_train.learners.build import make_model
from redundant_envs_train.policies import load_policy, save_policy, start_from
from redundant_envs_train.run_folder import read_config
from redundant_envs_train.training.watch import Watch

POLICIES = Path(__file__).resolve().parents[2] / "policies"
PPO = POLICIES / "RPRPReach-v0-ppo"
SMALL = [
    "num_envs=32", "ppo.n_steps=16", "ppo.batch_size=256", "total_steps=1024", "curve_every=512",
    "curve_episodes=10", "evaluation_episodes=10", "telemetry=[]",
]  # fmt: skip


@pytest.mark.parametrize(
    ("preset", "policy"),
    [
        ("rprp_reach_ppo", "RPRPReach-v0-ppo"),
        ("rprp_reach_sac", "RPRPReach-v0-plain_sac"),
        ("four_r_goal_reach_her", "FourRGoalReach-v0-her"),
        ("baselines/rprp_reach_td3", "RPRPReach-v0-td3"),
        pytest.param("baselines/rprp_reach_tqc", "RPRPReach-v0-tqc", marks=pytest.mark.long),
        pytest.param("baselines/rprp_reach_crossq", "RPRPReach-v0-crossq", marks=pytest.mark.long),
    ],
)
def test_a_learner_its_average_and_its_targets_begin_at_the_policy(preset, policy, tmp_path):
    n = 32
    few = [f"num_envs={n}", *([f"ppo.batch_size={16 * n}"] if preset.endswith("ppo") else [])]
    config = load(preset, [*few, f"start_from={POLICIES / policy}"])
    env = make_sb3(config.env, n)
    model = make_model(config, env)
    first = {name: tensor.clone() for name, tensor in model.policy.state_dict().items()}
    start_from(model, config, env)
    there = load_policy(POLICIES / policy, read_config(POLICIES / policy))
    for name, tensor in there.state_dict().items():
        np.testing.assert_allclose(model.policy.state_dict()[name], tensor, rtol=1e-5, atol=1e-5)
    assert any((first[name] != tensor).any() for name, tensor in there.state_dict().items())
    save_policy(model, tmp_path / "policy.zip")  # its average
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config.to_dict()))
    env.seed(5)
    seen = env.reset()
    expected = there.predict(seen, deterministic=True)[0]
    found = load_policy(tmp_path, config).predict(seen, deterministic=True)[0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4)
    if "networks" in vars(model):  # what trains: not the modules, but the vectors
        given = model.inputs(model.policy.obs_to_tensor(seen)[0])
        means = model.networks["actor"].forward(given)[0][0].detach().numpy()[:, :4]
        squashed = np.tanh(means) if "ppo" not in preset else np.clip(means, -1, 1)
        np.testing.assert_allclose(squashed, expected, rtol=0, atol=1e-4)


def test_a_training_records_what_it_started_from_and_goes_on(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    start = Path(shutil.copytree(PPO, "start"))
    words = ["train", "rprp_reach_ppo", *SMALL, "ppo.learning_rate=1e-9", "start_from=start"]
    assert main([*words, "--out", "whole"]) == 0
    recorded = yaml.safe_load(Path("whole/config.yaml").read_text())
    digest = hashlib.sha256((start / "policy.zip").read_bytes()).hexdigest()
    assert (recorded["start_from"], recorded["start_from_sha256"]) == ("start", digest)
    assert json.loads(Path("whole/evaluation.json").read_text())["hold_success"] == 1.0
    point = Watch.point

    def stop(self):
        self.stop.set()
        return point(self)

    with monkeypatch.context() as patch:
        patch.setattr(Watch, "point", stop)
        assert main([*words, "--out", "stopped"]) == 130
    shutil.rmtree(start)  # the checkpoint has all
    assert main(["resume", "stopped"]) == 0
    assert_same_policy(Path("whole"), Path("stopped"))
    shutil.copytree(POLICIES / "RPRPReach-v0-plain_ppo", "start")
    capsys.readouterr()
    assert main(["train", "whole/config.yaml", "--out", "again"]) == 2
    assert f"start_from_sha256 is {digest}; give that file" in capsys.readouterr().err


def alone(policy, folder):
    """A policy.zip without a folder that describes it."""
    folder.mkdir()
    return shutil.copy(POLICIES / policy / "policy.zip", folder)


@pytest.mark.parametrize("lonely", [False, True])
@pytest.mark.parametrize(
    ("policy", "settings", "words"),
    [
        ("FourRReach-v0-ppo", [], ["observation", "18", "20"]),
        ("RPRPGoalReach-v0-her", ["algo=sac"], ["policy"]),
        ("RPRPReach-v0-sac", [], ["sac", "ppo"]),
        ("RPRPReach-v0-ppo", ["algo=sac"], ["ppo", "sac"]),
        ("RPRPReach-v0-ppo", ["ppo.net_arch=[32]"], ["32", "64"]),
        ("RPRPReach-v0-ppo", ["ppo.activation=tanh"], ["tanh", "i"]),
    ],
)
def test_what_does_not_fit_is_one_line(lonely, policy, settings, words, tmp_path, capsys):
    start = alone(policy, tmp_path / "alone") if lonely else POLICIES / policy
    small = [] if "algo=sac" in settings else SMALL
    command = ["train", "rprp_reach_ppo", *small, *settings, f"start_from={start}"]
    assert main([*command, "--out", str(tmp_path / "run")]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "start_from" in err or "was saved with the activation" in err
    for word in words:
        assert word in err.lower()
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("start", "word"),
    [
        ("nowhere", "there is no nowhere"),
        ("configs", "there is no configs/policy.zip"),
        ("3", "start_from is 3"),
    ],
)
def test_what_is_no_policy_is_named(start, word, tmp_path, capsys):
    assert main(["train", "rprp_reach_ppo", f"start_from={start}", "--out", str(tmp_path / "run")]) == 2
    assert word in capsys.readouterr().err


def test_a_damaged_policy_is_one_line_and_nothing_is_unpickled(tmp_path, capsys):
    for name, change in (("cut", lambda data: data[:1000]), ("text", lambda data: b"text")):
        (tmp_path / name).write_bytes(change((PPO / "policy.zip").read_bytes()))
    with zipfile.ZipFile(PPO / "policy.zip") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    members["policy.pth"] = b"cos\nsystem\n(S'touch made'\ntR."
    with zipfile.ZipFile(tmp_path / "evil", "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    for name in ("cut", "text", "evil"):
        command = ["train", "rprp_reach_ppo", *SMALL, f"start_from={tmp_path / name}"]
        assert main([*command, "--out", str(tmp_path / "run")]) == 2
        err = capsys.readouterr().err
        assert str(tmp_path / name) in err
        assert err.count("\n") == 1


def test_a_hash_without_a_file_is_refused(capsys):
    assert main(["train", "rprp_reach_ppo", "start_from_sha256=abc"]) == 2
    assert "and start_from is null" in capsys.readouterr().err
