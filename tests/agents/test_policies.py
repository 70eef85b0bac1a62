"""policy.zip: stable-baselines3 alone loads it, a stranger's runs no code, and trainings start from it."""

import base64
import functools
import hashlib
import io
import json
import pickle
import shutil
import sys
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from run_folders import POLICIES, REFUSALS, Evil, members, write_members, write_scene
from short_trainings import TINY, assert_same_policy, small_config

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs_train.__main__ import main
from redundant_envs_train.config import load
from redundant_envs_train.learners.build import ALGORITHM_CLASSES, make_model
from redundant_envs_train.policies import load_policy, read_weights, save_policy, start_from
from redundant_envs_train.report import evaluate
from redundant_envs_train.run_folder import read_config
from redundant_envs_train.training.pool import Stopped
from redundant_envs_train.training.train import resume, train
from redundant_envs_train.training.watch import Watch

SMALL = {"batch_size": 64, "n_steps": 4, "net_arch": [16, 8]}
KINDS = {
    "ppo": {"ppo": SMALL, "env_kwargs": {"max_episode_steps": 20}},
    "goal": {"ppo": SMALL, "env": "redundant_envs/RPRPGoalReach-v0"}, "sac": {}, "her": {},
    "plain_ppo": {}, "td3": {}, "tqc": {}, "crossq": {},
}  # fmt: skip


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Kind -> run folder of a hardly trained policy, its configuration, and the learner."""

    @functools.cache
    def run(kind):
        config = small_config(kind.replace("goal", "ppo"), **KINDS[kind])
        model = make_model(config, make_sb3(config.env, 16)).learn(128)
        folder = tmp_path_factory.mktemp(kind)
        (folder / "config.yaml").write_text(yaml.safe_dump(config.to_dict()))
        write_scene(folder)
        save_policy(model, folder / "policy.zip")
        return folder, config, model

    return run


@pytest.fixture
def damaged(runs, tmp_path):
    """A copy of the PPO run to damage."""
    return Path(shutil.copytree(runs("ppo")[0], tmp_path / "run"))


def pickles(path):
    """The pickled objects in the description of a policy.zip."""
    about = json.loads(members(path)["data"]).values()
    found = [base64.b64decode(value[":serialized:"]) for value in about if ":serialized:" in str(value)]
    assert len(found) > 2
    return found


@pytest.mark.quick("ppo")
@pytest.mark.parametrize("kind", KINDS)
def test_a_policy_loads_without_this_package_and_acts_the_same_however_it_is_read(kind, runs, monkeypatch):
    folder, config, model = runs(kind)
    rate, env = config.settings, make_sb3(config.env, 64)
    env.seed(7)
    obs = env.reset()
    with monkeypatch.context() as patch, warnings.catch_warnings(action="error"):
        for name in [name for name in sys.modules if name.startswith("redundant_envs")]:
            patch.setitem(sys.modules, name, None)
        theirs = ALGORITHM_CLASSES[config.algo].load(folder / "policy.zip", device="cpu")
    assert (theirs.learning_rate, theirs.lr_schedule(0.5)) == (rate.learning_rate, rate.learning_rate)
    expected = theirs.predict(obs, deterministic=True)[0]
    assert np.ptp(expected) > 1e-3
    for policy in (load_policy(folder, config), load_policy(folder, config, trust=True)):
        np.testing.assert_array_equal(policy.predict(obs, deterministic=True)[0], expected)
    assert b"redundant_envs" not in members(folder / "policy.zip")["data"]
    for part in pickles(folder / "policy.zip"):  # nothing of this package, or that NumPy 2 has moved
        assert not {name for name in (b"redundant_envs", b"numpy.") if name in part}
    # saving leaves the schedule of the learner alone
    assert model.lr_schedule(0.5) == rate.learning_rate * (0.5 if rate.schedule == "linear" else 1.0)


@pytest.mark.parametrize("folder", sorted(POLICIES.iterdir()), ids=lambda folder: folder.name)
def test_a_shipped_policy_names_no_module_that_only_one_version_of_numpy_has(folder):
    assert not [part for part in pickles(folder / "policy.zip") if b"numpy." in part]


def saved(weights):
    memory = io.BytesIO()
    torch.save(weights, memory)
    return memory.getvalue()


def of_table(data, pickled):
    """A file of torch whose table of tensors is another pickle."""
    memory = io.BytesIO()
    parts = members(io.BytesIO(data))
    changed = {name: pickled if name.endswith("data.pkl") else part for name, part in parts.items()}
    write_members(memory, changed, zipfile.ZIP_STORED)
    return memory.getvalue()


def test_objects_beside_the_weights_are_not_unpickled_without_trust(damaged, tmp_path):
    path, made = damaged / "policy.zip", tmp_path / "made"
    data = json.loads(members(path)["data"])
    data["policy_kwargs"][":serialized:"] = base64.b64encode(pickle.dumps(Evil(made))).decode()
    write_members(path, members(path) | {"data": json.dumps(data).encode()})
    for command in (["evaluate"], ["play", "--clip", str(tmp_path / "a.gif"), "--episodes", "1"]):
        assert main([command[0], str(damaged), *command[1:]]) == 0
    assert not made.exists()
    assert main(["evaluate", str(damaged), "--trust"]) == 2  # it is no policy, but its code has run
    assert made.exists()


LAYER = "mlp_extractor.policy_net.0.weight"
BYTEARRAY = b"\x80\x02}X\x01\x00\x00\x00ac__builtin__\nbytearray\nJ\xff\xff\xff\x7f\x85Rs."
"""A pickle that allocates 2 GiB."""
WEIGHTS = [  # of policy.pth: words of the message, and the bytes instead of those of weights w
    ("is not a plain table of float32", lambda w: saved(w)[:-100]),
    ("lacks weights 'log_std'", lambda w: saved({k: v for k, v in w.items() if k != "log_std"})),
    ("has weights 'more'", lambda w: saved({**w, "more": torch.zeros(1)})),
    ("shape (3, 16), config.yaml asks for (16, 18)", lambda w: saved({**w, LAYER: torch.zeros(3, 16)})),
    ("that are not finite", lambda w: saved({**w, LAYER: w[LAYER] * float("nan")})),
    ("of torch.int64; give torch.float32", lambda w: saved({**w, LAYER: w[LAYER].long()})),
    ("torch DoubleStorage", lambda w: saved({**w, LAYER: w[LAYER].double()})),
    ("no names of tensors", lambda w: saved([w[LAYER]])),
    ("claims 1000000000000 numbers", lambda w: saved({**w, "x": torch.zeros(1).expand(10**6, 10**6)})),
    ("__builtin__ bytearray", lambda w: of_table(saved(w), BYTEARRAY)),
    ("has no 'policy.pth'", lambda w: None),
]
ABOUT = [  # the same of its description
    ("has no 'data'", lambda data: None),
    ("damaged member 'data'", lambda data: b"[" * 100_000),
    ("ReLU", lambda data: data.replace(b"activation.SiLU", b"activation.ReLU")),
]  # fmt: skip


@pytest.mark.parametrize(
    ("member", "words", "change"),
    [*(("policy.pth", *row) for row in WEIGHTS), *(("data", *row) for row in ABOUT)],
)
def test_other_bytes_than_weights_and_a_description_are_one_error(member, words, change, damaged, refused):
    path = damaged / "policy.zip"
    given = members(path)["data"] if member == "data" else read_weights(path, "silu")[0]
    write_members(path, members(path) | {member: change(given)})
    refused(["evaluate", damaged], str(path), words)


def test_weights_with_code_in_them_are_not_unpickled(damaged, tmp_path, refused):
    path, made = damaged / "policy.zip", tmp_path / "made"
    in_table = of_table(saved({}), pickle.dumps(Evil(made), 2))
    start = ["train", "rprp_reach_ppo", *TINY, f"start_from={damaged}", "ppo.net_arch=[16, 8]"]
    readers = [["report"], ["play", "--clip", tmp_path / "a.gif"], ["study", "stops"]]
    for data in (pickle.dumps(Evil(made)), saved(Evil(made)), in_table):
        write_members(path, members(path) | {"policy.pth": data})
        refused(["evaluate", damaged], "add --trust")
    for words in (*([*reader, damaged] for reader in readers), [*start, "--out", tmp_path / "new"]):
        refused(words, "add --trust")
    assert not made.exists()


@pytest.mark.parametrize(
    ("preset", "policy"),
    [
        ("rprp_reach_ppo", "RPRPReach-v0-ppo"),
        ("four_r_goal_reach_her", "FourRGoalReach-v0-her"),
        pytest.param("rprp_reach_sac", "RPRPReach-v0-plain_sac", marks=pytest.mark.long),
        pytest.param("baselines/rprp_reach_td3", "RPRPReach-v0-td3", marks=pytest.mark.long),
        pytest.param("baselines/rprp_reach_crossq", "RPRPReach-v0-crossq", marks=pytest.mark.long),
    ],
)
def test_a_learner_its_average_and_its_targets_begin_at_the_policy(preset, policy, tmp_path):
    few = ["num_envs=32", *(["ppo.batch_size=512"] if preset.endswith("ppo") else [])]
    config = load(preset, [*few, f"start_from={POLICIES / policy}"])
    env = make_sb3(config.env, 32)
    model = make_model(config, env)
    first = {name: tensor.clone() for name, tensor in model.policy.state_dict().items()}
    start_from(model, config, env)
    there = load_policy(POLICIES / policy, read_config(POLICIES / policy))
    torch.testing.assert_close(model.policy.state_dict(), there.state_dict(), rtol=1e-5, atol=1e-5)
    assert any((first[name] != tensor).any() for name, tensor in there.state_dict().items())
    save_policy(model, tmp_path / "policy.zip")  # its average
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


@pytest.mark.long
def test_a_training_records_what_it_started_from_and_goes_on(tmp_path, monkeypatch, refused):
    monkeypatch.chdir(tmp_path)
    start = Path(shutil.copytree(POLICIES / "RPRPReach-v0-ppo", "start"))
    config = load("rprp_reach_ppo", [*TINY, "ppo.learning_rate=1e-9", "start_from=start"])
    train(config, Path("whole"))
    recorded = yaml.safe_load(Path("whole/config.yaml").read_text())
    digest = hashlib.sha256((start / "policy.zip").read_bytes()).hexdigest()
    assert (recorded["start_from"], recorded["start_from_sha256"]) == ("start", digest)
    assert evaluate(Path("whole")).result["hold_success"] == 1.0
    point = Watch.point
    with monkeypatch.context() as patch:
        patch.setattr(Watch, "point", lambda self: (self.stop.set(), point(self))[1])
        with pytest.raises(Stopped):
            train(config, Path("stopped"))
    shutil.rmtree(start)  # the checkpoint has all
    resume(Path("stopped"))
    assert_same_policy(Path("whole"), Path("stopped"))
    shutil.copytree(POLICIES / "RPRPReach-v0-plain_ppo", "start")
    words = ["train", "whole/config.yaml", "--out", "again"]
    refused(words, f"start_from_sha256 is {digest}; give that file")


@pytest.mark.parametrize(("policy", "settings"), REFUSALS["starts"])
def test_a_policy_that_does_not_fit_is_one_line(policy, settings, tmp_path, refused):
    small = ["num_envs=16"] if "algo=sac" in settings else TINY
    lonely = shutil.copy(POLICIES / policy / "policy.zip", tmp_path)  # without a folder that describes it
    for start in (POLICIES / policy, lonely):
        words = ["train", "rprp_reach_ppo", *small, *settings, f"start_from={start}"]
        refused([*words, "--out", tmp_path / "run"], "start_from does not fit: ", "give a policy of the same")
    assert not (tmp_path / "run").exists()


@pytest.mark.long
def test_the_expert_of_an_evaluation_gives_efforts_in_any_mode_of_actions(tmp_path):
    folder = Path(shutil.copytree(POLICIES / "RPRPReach-v0-ppo", tmp_path / "policy"))
    config = yaml.safe_load((folder / "config.yaml").read_text())
    modes = {"action": "joint_velocity", "decide_every": 2}
    config |= {"env_kwargs": config["env_kwargs"] | modes, "evaluation_episodes": 20}
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    result = evaluate(folder).result
    assert result["hold_success"] < 0.5  # it learned efforts
    assert result["expert_hold_success"] == 1.0
