"""policy.zip: stable-baselines3 alone loads it, and a stranger's file runs no code here."""

from __future__ import annotations

import io
import json
import pickle
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from run_folders import write_scene
from stable_baselines3 import PPO, SAC

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs_train import policies
from redundant_envs_train.__main__ import main
from redundant_envs_train.config import Config, checked
from redundant_envs_train.learners.build import make_model
from redundant_envs_train.policies import load_policy, save_policy

KINDS = {
    "ppo": {"env": "redundant_envs/RPRPReach-v0", "ppo": {"batch_size": 64, "net_arch": [16, 8]}},
    "sac": {"env": "redundant_envs/RPRPReach-v0", "algo": "sac", "sac": {"net_arch": [8, 8]}},
    "goal": {"env": "redundant_envs/RPRPGoalReach-v0", "ppo": {"batch_size": 64}},
}
ALONE = """
import sys, warnings

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("redundant_envs", "redundant_envs_train"):
            raise ModuleNotFoundError(f"{name} is blocked", name=name)

sys.meta_path.insert(0, Blocked())
warnings.simplefilter("error")
import pickle
import stable_baselines3

model = getattr(stable_baselines3, sys.argv[1]).load("policy.zip", device="cpu")
with open("observations.pkl", "rb") as file:
    observations = pickle.load(file)
actions = model.predict(observations, deterministic=True)[0]
with open("actions.pkl", "wb") as file:
    pickle.dump(actions, file)
assert not any(name.partition(".")[0] in ("redundant_envs", "redundant_envs_train") for name in sys.modules)
print(model.learning_rate, model.lr_schedule(0.5))
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Kind -> run folder of a hardly trained policy, its configuration, and the learner."""
    found = {}
    for kind, data in KINDS.items():
        config = checked(Config, {"config_version": 2, **data, "num_envs": 4, "evaluation_episodes": 4})
        model = make_model(config, make_sb3(config.env, 4)).learn(128)
        folder = tmp_path_factory.mktemp(kind)
        (folder / "config.yaml").write_text(yaml.safe_dump(config.to_dict()))
        write_scene(folder)
        save_policy(model, folder / "policy.zip")
        found[kind] = folder, config, model
    return found


@pytest.fixture
def run(runs, tmp_path):
    """A copy of the PPO run to damage, and its configuration."""
    folder, config, _ = runs["ppo"]
    shutil.copytree(folder, tmp_path / "run")
    return tmp_path / "run", config


def observations(config):
    env = make_sb3(config.env, 64)
    env.seed(7)
    return env.reset()


@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=pytest.mark.long) if k != "ppo" else k for k in KINDS]
)
def test_a_policy_loads_without_this_package(kind, runs, tmp_path):
    folder, config, model = runs[kind]
    obs = observations(config)
    shutil.copy(folder / "policy.zip", tmp_path)
    (tmp_path / "observations.pkl").write_bytes(pickle.dumps(obs))
    command = [sys.executable, "-I", "-c", ALONE, config.algo.upper()]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    expected = model.predict(obs, deterministic=True)[0]
    np.testing.assert_array_equal(pickle.loads((tmp_path / "actions.pkl").read_bytes()), expected)
    rate = getattr(config, config.algo).learning_rate
    assert done.stdout.split() == [str(rate), str(rate)]


@pytest.mark.parametrize("kind", KINDS)
def test_policies_act_the_same_however_they_are_read(kind, runs):
    folder, config, model = runs[kind]
    obs = observations(config)
    expected = model.predict(obs, deterministic=True)[0]
    theirs = {"ppo": PPO, "sac": SAC}[config.algo].load(folder / "policy.zip", device="cpu")
    for policy in (load_policy(folder, config), load_policy(folder, config, trust=True), theirs):
        np.testing.assert_array_equal(policy.predict(obs, deterministic=True)[0], expected)


def test_saving_leaves_the_schedules_of_a_learner_alone(runs, tmp_path):
    model = runs["ppo"][2]
    before = model.learning_rate, model.clip_range
    save_policy(model, tmp_path / "policy.zip")
    assert (model.learning_rate, model.clip_range) == before
    assert model.lr_schedule(0.5) == 0.5 * model.lr_schedule(1.0)


# ---- files of strangers --------------------------------------------------------------------------


class Evil:
    """Makes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = str(path)

    def __reduce__(self):
        return Path.touch, (Path(self.path),)


def replace(path: Path, **members: bytes | None) -> None:
    """Replace the bytes of members of a zip file; None removes a member."""
    with zipfile.ZipFile(path) as archive:
        kept = {name: archive.read(name) for name in archive.namelist()}
    kept |= {name.replace("_pth", ".pth"): data for name, data in members.items()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in kept.items():
            if data is not None:
                archive.writestr(name, data)


def saved(weights: object) -> bytes:
    memory = io.BytesIO()
    torch.save(weights, memory)
    return memory.getvalue()


def inner(data: bytes, change, compression=zipfile.ZIP_STORED) -> bytes:
    """A file of torch with its table of tensors changed."""
    memory = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(memory, "w", compression) as new:
        for name in old.namelist():
            new.writestr(name, change(old.read(name)) if name.endswith("data.pkl") else old.read(name))
    return memory.getvalue()


def with_pickle_in_data(folder: Path, evil: Evil) -> None:
    import base64

    with zipfile.ZipFile(folder / "policy.zip") as archive:
        data = json.loads(archive.read("data"))
    data["policy_kwargs"][":serialized:"] = base64.b64encode(pickle.dumps(evil)).decode()
    replace(folder / "policy.zip", data=json.dumps(data).encode())


def test_objects_beside_the_weights_are_not_unpickled_without_trust(run, tmp_path, capsys):
    folder, config = run
    made = tmp_path / "made"
    with_pickle_in_data(folder, Evil(made))
    load_policy(folder, config)
    for command in (["evaluate", str(folder)], ["play", str(folder), "--clip", str(tmp_path / "a.gif"),
                                                "--episodes", "1"]):  # fmt: skip
        assert main(command) == 0
    assert not made.exists()
    assert main(["evaluate", str(folder), "--trust"]) == 2  # it is no policy, but its code has run
    assert made.exists()


LAYER = "mlp_extractor.policy_net.0.weight"
BYTEARRAY = b"\x80\x02}X\x01\x00\x00\x00ac__builtin__\nbytearray\nJ\xff\xff\xff\x7f\x85Rs."
"""A pickle that allocates 2 GiB."""
DAMAGES = {
    "is not a plain table": lambda w: b"nothing",
    "is not a plain table of float32": lambda w: saved(w)[:-100],
    "lacks weights 'log_std'": lambda w: saved({k: v for k, v in w.items() if k != "log_std"}),
    "has weights 'more'": lambda w: saved({**w, "more": torch.zeros(1)}),
    "of shape (3, 16), config.yaml asks for (16, 18)": lambda w: saved({**w, LAYER: torch.zeros(3, 16)}),
    "that are not finite": lambda w: saved({**w, LAYER: w[LAYER] * float("nan")}),
    "of torch.int64; give torch.float32": lambda w: saved({**w, LAYER: w[LAYER].long()}),
    "claims 100000000 numbers": lambda w: saved({**w, "x": torch.zeros(1, dtype=torch.int64).expand(10**8)}),
    "torch DoubleStorage": lambda w: saved({**w, LAYER: w[LAYER].double()}),
    "no names of tensors": lambda w: saved([w[LAYER]]),
    "'deep' is not a float32": lambda w: saved({**w, "deep": {"a": w[LAYER]}}),
    "claims 1000000000000 numbers": lambda w: saved({**w, "x": torch.zeros(1).expand(10**6, 10**6)}),
    "__builtin__ bytearray": lambda w: inner(saved(w), lambda _: BYTEARRAY),
    "compressed": lambda w: inner(saved(w), lambda data: data, zipfile.ZIP_DEFLATED),
    "record size": lambda w: inner(saved(w), larger_storage),
}  # fmt: skip


def larger_storage(data: bytes) -> bytes:
    """A table of tensors whose first storage claims 2**30 numbers."""
    assert b"M\x20\x01tq" in data  # 16 x 18
    return data.replace(b"M\x20\x01tq", b"J\x00\x00\x00\x40tq")


@pytest.mark.parametrize("damage", DAMAGES)
def test_other_bytes_than_fitting_weights_are_one_error(damage, run, capsys):
    folder, _ = run
    weights, _ = policies.read_weights(folder / "policy.zip", "silu")
    replace(folder / "policy.zip", policy_pth=DAMAGES[damage](weights))
    assert main(["evaluate", str(folder)]) == 2
    error = capsys.readouterr().err
    assert str(folder / "policy.zip") in error
    assert damage in error
    assert error.count("\n") == 1


def test_weights_with_code_in_them_are_not_unpickled(run, tmp_path, capsys):
    folder, _ = run
    made = tmp_path / "made"
    in_table = inner(saved({}), lambda _: pickle.dumps(Evil(made), 2))
    for data in (pickle.dumps(Evil(made)), saved(Evil(made)), in_table):
        replace(folder / "policy.zip", policy_pth=data)
        for command in (["evaluate"], ["report"], ["play"], ["study", "stops"]):
            clip = ["--clip", str(tmp_path / "a.gif")] if command == ["play"] else []
            assert main([*command, str(folder), *clip]) == 2
            assert "add --trust" in capsys.readouterr().err
        assert not made.exists()


@pytest.mark.parametrize(
    ("members", "word"),
    [
        ({"policy_pth": None}, "has no 'policy.pth'"),
        ({"data": None}, "has no 'data'"),
        ({"data": b"{"}, "damaged member 'data'"),
        ({"data": b"[" * 100_000}, "damaged member 'data'"),
        ({"data": b"{}"}, "damaged member 'data'"),
        ({"policy_pth": bytes(70 * 2**20)}, "more than 67108864 bytes"),
        ({"data": bytes(70 * 2**20)}, "more than 67108864 bytes"),
    ],
)
def test_members_that_are_missing_or_too_large_are_named(members, word, run):
    folder, config = run
    replace(folder / "policy.zip", **members)
    with pytest.raises(ValueError, match=word):
        load_policy(folder, config)


def test_other_activations_are_refused(run):
    folder, config = run
    with zipfile.ZipFile(folder / "policy.zip") as archive:
        data = archive.read("data")
    replace(folder / "policy.zip", data=data.replace(b"activation.SiLU", b"activation.ReLU"))
    with pytest.raises(ValueError, match="ReLU"):
        load_policy(folder, config)


@pytest.mark.parametrize("trust", [False, True])
def test_a_file_cut_short_is_one_error(trust, run):
    folder, config = run
    data = (folder / "policy.zip").read_bytes()
    for end in (0, 10, len(data) // 2, len(data) - 1):
        (folder / "policy.zip").write_bytes(data[:end])
        with pytest.raises(ValueError, match=r"policy\.zip"):
            load_policy(folder, config, trust)


def test_a_configuration_that_asks_for_all_memory_is_refused(run):
    folder, _ = run
    config = checked(
        Config,
        {
            "config_version": 2,
            **KINDS["ppo"],
            "num_envs": 4,
            "ppo": {"batch_size": 64, "net_arch": [2048] * 2},
        },
    )
    with pytest.raises(ValueError, match="net_arch"):
        load_policy(folder, config)
