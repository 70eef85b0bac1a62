"""Exported policies act like the trained ones, and their card describes them."""

import re
import runpy
import sys

import numpy as np
import pytest
import yaml
from published_runs import RESULTS, ROOT, published_run
from run_folders import REFUSALS, change, kept, says
from short_trainings import assert_same_policy

pytest.importorskip("onnx", reason="ONNX is not installed: pip install '.[onnx]'")

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs_train.evidence.runs import read_runs
from redundant_envs_train.pages import MEASURES
from redundant_envs_train.policies import load_policy
from redundant_envs_train.rollout import EVALUATION_SEED, policy_act, run_episodes
from redundant_envs_train.run_folder import read_config
from redundant_envs_train.shipping import export as shipping
from redundant_envs_train.shipping.export import export
from redundant_envs_train.shipping.layers import Layers, activated, exact_actions, layers_of

pytestmark = pytest.mark.long


@pytest.fixture
def run(tmp_path):
    """The run folder of a shipped policy."""
    return published_run("rprp_reach_sac/seed100", tmp_path / "runs" / "seed100")


@pytest.fixture(scope="module")
def published():
    """Evaluations of all published runs, by environment, learner, scene and seed."""
    tables = "runs", "baselines", "weak", "redundancy_runs"
    runs = read_runs([RESULTS / f"{table}.jsonl" for table in tables])
    return {
        (r.env, r.settings["algo"], r.settings["env_kwargs"].get("scene"), r.seed): r.evaluation for r in runs
    }


def observed(config, count):
    """Observations after some steps."""
    env = make_sb3(config.env, count, **config.env_kwargs)
    env.seed(7)
    env.reset()
    for _ in range(5):
        found = env.step(np.full((count, 4), 0.3))[0]
    return env, found


@pytest.mark.parametrize("folder", sorted((ROOT / "policies").iterdir()), ids=lambda folder: folder.name)
def test_files_of_a_shipped_policy_agree_to_1e_6_and_its_card_has_the_published_results(folder, published):
    config = read_config(folder)
    env, seen = observed(config, 200)
    policy = load_policy(folder, config)
    layers = layers_of(policy, env.observation_space)
    exact = exact_actions(policy, layers.inputs, seen)
    assert np.ptp(exact, axis=0).min() > 0.5
    by_onnx = shipping.onnx_actions(folder / "policy.onnx", layers.inputs)(seen)
    np.testing.assert_allclose(by_onnx, exact, rtol=0, atol=1e-6)
    np.testing.assert_allclose(Layers.load(folder / "policy.npz")(seen), exact, rtol=0, atol=1e-6)
    # single precision of stable-baselines3: it differs from itself by some 1e-6 between batches
    np.testing.assert_allclose(policy.predict(seen, deterministic=True)[0], exact, rtol=0, atol=2e-5)
    evaluation = published[config.env, config.algo, config.env_kwargs.get("scene"), config.seed]
    found = run_episodes(config.env, policy_act(policy), 200, EVALUATION_SEED, **config.env_kwargs).hold
    assert abs(found.mean() - evaluation["hold_success"]) < 0.04  # the first 200 of 1000 goals
    _, head, body = (folder / "README.md").read_text(encoding="utf-8").split("---\n", 2)
    for part in ("## Task", "## How it was trained", "## Results", "## Limits", "## Load it", config.env):
        assert part in body
    assert ("A touch ended" in body) == ("terminate_on_touch" in config.env_kwargs)
    assert ("best point of the learning curve" in body) == (config.keep == "best")
    assert ("At first other values held for " in body) == (config.curriculum is not None)
    data, table = yaml.safe_load(head), dict(re.findall(r"^\| ([a-z ]+) \| ([^|]+) \|", body, re.M))
    library = "sb3-contrib" if config.algo in ("tqc", "crossq") else "stable-baselines3"
    assert data["library_name"] == library
    (result,) = data["model-index"][0]["results"]
    assert result["dataset"]["type"] == config.env
    metrics = {metric["type"].replace("_", " "): metric["value"] for metric in result["metrics"]}
    assert "hold success" in metrics
    for label, key, scale, digits, unit in MEASURES:
        if label in metrics or table.get(label, "-").strip() != "-":
            assert metrics[label] == round(scale * evaluation[key], digits)
            assert f"{metrics[label]:.{digits}f}{unit}" == table[label]


def test_silu_does_not_overflow():
    x = np.array([-1e4, -50.0, 0.0, 2.0, 1e4])
    np.testing.assert_allclose(activated("silu", x), [0, 0, 0, 2 / (1 + np.exp(-2.0)), 1e4], atol=1e-15)


@pytest.mark.parametrize(
    ("file", "value"), [("policy.onnx", 1e-3), ("policy.onnx", np.nan), ("policy.npz", 1e-3)]
)
def test_a_file_that_acts_otherwise_is_refused_and_leaves_nothing(run, file, value, tmp_path, monkeypatch):
    owner, name = (shipping, "onnx_actions") if file == "policy.onnx" else (Layers, "load")
    read = getattr(owner, name)

    def read_wrong(*given):
        act = read(*given)
        return lambda observations: act(observations) + value

    monkeypatch.setattr(owner, name, read_wrong)
    with says(f"{file} acts otherwise ", " at most 1e-06"):
        export(run, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["runs"]


def test_export_writes_a_policy_once_and_numpy_alone_acts(run, tmp_path, monkeypatch, capsys, call, refused):
    folder = tmp_path / "RPRPReach-v0-sac"
    bad = {"machine": "<img src=x onerror=alert(1)> `rm` | [a](b)", "versions": {"<b>": "*"}}
    change(run / "evaluation.json", **bad)
    before = kept(run)
    out, _ = call("export", run, "--out", tmp_path)
    assert out.split() == [str(folder)]
    assert kept(run) == before
    assert [part for part in ("<", "`rm`") if part in (folder / "README.md").read_text()] == []
    refused(["export", run, "--out", tmp_path], "exists; delete it or choose another --out")
    files = {"README.md", "config.yaml", "policy.npz", "policy.onnx", "policy.zip", "scene.yaml"}
    assert {p.name for p in folder.iterdir()} == files
    act = policy_act(load_policy(run, read_config(run)))
    held = run_episodes("redundant_envs/RPRPReach-v0", act, 100, EVALUATION_SEED).hold
    for name in ("torch", "stable_baselines3", "onnxruntime", "scipy"):
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr(sys, "argv", ["play_with_numpy.py", str(folder), "--episodes", "100"])
    runpy.run_path(str(ROOT / "docs" / "examples" / "play_with_numpy.py"), run_name="__main__")
    assert f"{100 * held.mean():.1f} % of 100 goals are held" in capsys.readouterr().out


def without_differences(card):
    """A card without the last paragraph's three numbers, which depend on the processor."""
    text, last = card.rsplit("Both compute in double precision.", 1)
    return text + re.sub(r"[\d.]+e-\d+", "?", last)


@pytest.mark.parametrize(
    ("name", "table"),
    [("four_r_goal_reach_her/seed110", "runs"), ("four_r_reach_around_sac/seed352", "redundancy_runs")],
)
def test_an_export_of_a_shipped_run_is_what_is_shipped(name, table, tmp_path):
    run = published_run(name, tmp_path / "run", table)
    folder = export(run, tmp_path)
    shipped = ROOT / "policies" / folder.name
    cards = [without_differences((place / "README.md").read_text()) for place in (folder, shipped)]
    assert cards[0] == cards[1]
    with np.load(folder / "policy.npz") as found, np.load(shipped / "policy.npz") as expected:
        np.testing.assert_equal({**found}, {**expected})
    assert_same_policy(run, folder)


@pytest.mark.parametrize(("file", "entries", "word"), REFUSALS["exports"])
def test_a_run_that_cannot_be_exported_says_why(run, file, entries, word, tmp_path, refused):
    if entries is None:
        (run / file).unlink()
    else:
        change(run / file, **entries)
    refused(["export", run, "--out", tmp_path / "out"], word)
    assert not (tmp_path / "out").exists()
