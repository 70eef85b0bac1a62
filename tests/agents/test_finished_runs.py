"""A run is read in its own scene, from anywhere, and reading writes nothing into it."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from run_folders import assert_same_policy

from redundant_envs.scene import load_scene
from redundant_envs_train.__main__ import main
from redundant_envs_train.evidence.runs import read_groups
from redundant_envs_train.run_folder import difference, own_config
from redundant_envs_train.training import checkpoint
from redundant_envs_train.training.watch import Watch

SMALL = [
    "num_envs=32", "ppo.n_steps=16", "ppo.batch_size=256", "total_steps=1024", "curve_every=512",
    "curve_episodes=5", "evaluation_episodes=5", "telemetry=[]", "env_kwargs.max_episode_steps=10",
    "env_kwargs.scene=mine.yaml",
]  # fmt: skip
ROOT = Path(__file__).resolve().parents[2]


def write_scene_file(folder, friction):
    """mine.yaml: the reach scene with another viscous friction."""
    data = load_scene("rprp_reach").to_dict()
    (effect,) = (e for e in data["effects"] if e["type"] == "ViscousFriction")
    effect["coefficients"] = [friction] * 4
    (folder / "mine.yaml").write_text(yaml.safe_dump(data))


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A folder with mine.yaml, and a run that was trained in it."""
    folder = tmp_path_factory.mktemp("home")
    write_scene_file(folder, 0.3)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["train", "rprp_reach_ppo", *SMALL, "--out", "run"]) == 0
    return folder


@pytest.fixture
def run(trained, tmp_path, monkeypatch):
    """A copy of the run in another folder, from which commands are called; there is no mine.yaml."""
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    return Path(shutil.copytree(trained / "run", "moved"))


def kept(folder):
    """Contents and times of all files in a folder, and the folder's own time."""
    return {
        path: (path.read_bytes() if path.is_file() else b"", path.stat().st_mtime_ns)
        for path in sorted((folder, *folder.rglob("*")))
    }


def readers(folder, out):
    """Commands that read a run, and write only into ``out``."""
    return {
        "evaluate": ["evaluate", folder], "evaluate out": ["evaluate", folder, "--out", out / "a"],
        "report": ["report", folder, "--out", out / "b"],
        "play": ["play", folder, "--clip", out / "a.gif", "--episodes", 1],
        "export": ["export", folder, "--out", out / "policies"], "table": ["table", folder],
        "table out": ["table", folder, "--out", out / "a.csv"],
        "curves": ["curves", folder, "--out", out / "a.png"],
        "stops": ["study", "stops", folder, "--lanes", 8, "--out", out / "stops.csv"],
    }  # fmt: skip


def call(words):
    return main([str(word) for word in words])


# ---- the scene -----------------------------------------------------------------------------------


@pytest.mark.parametrize("changed", [False, True])
def test_an_evaluation_is_of_the_scene_of_the_run_whatever_became_of_the_file(changed, run, capsys):
    if changed:
        write_scene_file(Path(), 8.0)
    own = json.loads((run / "evaluation.json").read_text())
    capsys.readouterr()
    assert call(["evaluate", run, "--out", "again"]) == 0
    assert json.loads(Path("again/evaluation.json").read_text()) == own
    err = capsys.readouterr().err
    assert err.count("\n") == changed
    assert ("ViscousFriction.coefficients [0.3, 0.3, 0.3, 0.3], not [8.0, 8.0, 8.0, 8.0]" in err) == changed
    (run / "evaluation.json").unlink()
    (run / "report.md").unlink()
    assert call(["report", run]) == 0
    assert json.loads((run / "evaluation.json").read_text()) == own
    assert ("Simulated in the run's own scene" in (run / "report.md").read_text()) == changed


def test_the_own_scene_decides_if_it_is_another_one(run, capsys):
    """Shows that the test above can fail: friction changes the evaluation."""
    own = json.loads((run / "evaluation.json").read_text())
    write_scene_file(Path(), 8.0)
    Path("mine.yaml").rename(run / "scene.yaml")
    assert call(["evaluate", run, "--out", "again"]) == 0
    found = json.loads(Path("again/evaluation.json").read_text())
    assert found["expert_mean_return"] != own["expert_mean_return"]


def test_every_command_reads_a_run_whose_file_changed_and_says_so(run, tmp_path, capsys):
    write_scene_file(Path(), 8.0)
    for name, words in readers(run, tmp_path).items():
        if name in ("export", "report", "stops"):
            continue  # of registered environments alone; seen above; slow
        assert call(words) == 0, name
        assert "moved/scene.yaml differs from the scene 'mine.yaml'" in capsys.readouterr().err, name


@pytest.mark.parametrize("damage", [None, "robot: {type: RPRP}", "[1, 2]", "robot: [", "- \x00"])
def test_a_missing_or_damaged_scene_is_one_line(damage, run, tmp_path, capsys):
    (run / "scene.yaml").unlink()
    if damage is not None:
        (run / "scene.yaml").write_text(damage)
    for name, words in {**readers(run, tmp_path), "resume": ["resume", run]}.items():
        assert call(words) == 2, name
        err = capsys.readouterr().err
        assert "scene.yaml" in err, name
        assert err.count("\n") == 1, name


def test_runs_of_one_name_in_two_scenes_are_no_seeds_of_each_other(run, trained):
    other = Path(shutil.copytree(run, "other"))
    write_scene_file(Path(), 8.0)
    Path("mine.yaml").rename(other / "scene.yaml")
    config = yaml.safe_load((other / "config.yaml").read_text()) | {"seed": 1}
    (other / "config.yaml").write_text(yaml.safe_dump(config))
    evaluation = json.loads((other / "evaluation.json").read_text()) | {"seed": 1}
    (other / "evaluation.json").write_text(json.dumps(evaluation))
    groups = read_groups([run, other])
    assert [len(same.runs) for same in groups] == [1, 1]
    assert all("scene=" in same.learner for same in groups)


def test_a_training_goes_on_in_its_own_scene(trained, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_scene_file(tmp_path, 0.3)
    points = []

    def stop_at_first(self):
        points.append(self.num_timesteps)
        assert not (tmp_path / "run" / "evaluation.json").exists()  # an old one is of another policy
        write_scene_file(tmp_path, 8.0)  # while it runs
        if len(points) == 1:
            self.stop.set()
        return point(self)

    point = Watch.point
    monkeypatch.setattr(Watch, "point", stop_at_first)
    assert main(["train", "rprp_reach_ppo", *SMALL, "--out", "run"]) == 130
    (tmp_path / "mine.yaml").unlink()
    assert call(["report", "run"]) == 0  # of the policy so far
    assert main(["resume", "run"]) == 0
    assert_same_policy(tmp_path / "run", trained / "run")
    curves = [np.loadtxt(f / "run" / "selection.csv", delimiter=",", skiprows=1) for f in (tmp_path, trained)]
    np.testing.assert_array_equal(*(np.delete(curve, 1, axis=1) for curve in curves))  # but for the seconds
    again, own = (json.loads((f / "run" / "evaluation.json").read_text()) for f in (tmp_path, trained))
    assert again["hold_success"] == own["hold_success"]
    assert again["mean_return"] == own["mean_return"]


def test_many_seeds_do_not_go_on_in_another_scene(run, capsys):
    words = ["train", "rprp_reach_ppo", *SMALL, "--seeds", "0", "--out", "many"]
    shutil.copytree(run, "many/seed0")
    write_scene_file(Path(), 8.0)
    assert call(words) == 2
    assert "many/seed0 holds a run in another scene (many/seed0/scene.yaml differs" in capsys.readouterr().err


# ---- nothing is written --------------------------------------------------------------------------


@pytest.fixture
def plain(run):
    """The run, changed to the environment's own scene, so that it can be exported."""
    config = yaml.safe_load((run / "config.yaml").read_text())
    config["env_kwargs"] = {}
    (run / "config.yaml").write_text(yaml.safe_dump(config))
    return run


def test_reading_changes_nothing_in_a_run(plain, tmp_path):
    before = kept(plain)
    for name, words in readers(plain, tmp_path).items():
        assert call(words) == 0, name
        assert kept(plain) == before, name
    assert (tmp_path / "b" / "plots" / "learning_curve.png").is_file()


@pytest.fixture
def exported(tmp_path):
    """A copy of a shipped policy, evaluated on few goals."""
    folder = Path(shutil.copytree(ROOT / "policies" / "RPRPReach-v0-ppo", tmp_path / "shipped"))
    config = yaml.safe_load((folder / "config.yaml").read_text()) | {"evaluation_episodes": 20}
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    return folder


def test_reading_changes_nothing_in_an_exported_policy(exported, tmp_path, capsys):
    before = kept(exported)
    refused = {"export", "table", "table out", "curves"}
    for name, words in readers(exported, tmp_path).items():
        assert call(words) == (2 if name in refused else 0), name
        out, err = capsys.readouterr()
        if name in refused:
            assert "is an exported policy" in err
            assert err.count("\n") == 1
        if name.startswith("evaluate"):
            assert "hold success 100.0 % of 20" in out
        assert kept(exported) == before, name
    assert call(["report", exported]) == 2
    assert "is an exported policy; give --out FOLDER" in capsys.readouterr().err
    assert kept(exported) == before
    assert "![learning_curve]" not in (tmp_path / "b" / "report.md").read_text()


def test_what_is_there_is_replaced_only_when_asked(run, capsys):
    before = kept(run)
    for words in (["report", run], ["evaluate", run, "--out", run], ["report", run, "--out", run]):
        assert call(words) == 2
        assert "--overwrite" in capsys.readouterr().err
    assert kept(run) == before
    assert call(["evaluate", run, "--overwrite"]) == 0
    assert call(["report", run, "--overwrite"]) == 0
    after = kept(run)
    changed = {path.name for path in after if after[path][1] != before[path][1] and path.is_file()}
    assert {"evaluation.json", "episodes.csv", "report.md", "clip.gif"} <= changed
    assert not changed & {"policy.zip", "config.yaml", "scene.yaml", "training.json", "selection.csv"}


def test_an_unchanged_scene_differs_in_nothing(trained, monkeypatch):
    monkeypatch.chdir(trained)
    assert difference(Path("run")) == ""
    assert own_config(Path("run")).env_kwargs["scene"]["control_dt"] == 0.02
    assert not checkpoint.find_checkpoint(Path("run"))
