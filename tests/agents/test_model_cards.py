"""Front matter of the cards of shipped policies: that of Hugging Face, with the results of the tables."""

import re

import pytest
import yaml
from published_runs import RESULTS, ROOT

pytest.importorskip("onnx", reason="ONNX is not installed: pip install '.[onnx]'")

from redundant_envs_train.evidence.runs import read_runs
from redundant_envs_train.pages import MEASURES
from redundant_envs_train.run_folder import read_config

pytestmark = pytest.mark.long

FOLDERS = sorted((ROOT / "policies").iterdir())


@pytest.fixture(scope="module")
def rows():
    """Evaluations of all published runs, by environment, learner, scene and seed."""
    runs = [run for table in ("runs", "baselines", "weak") for run in read_runs([RESULTS / f"{table}.csv"])]
    scenes = [(run.settings.get("env_kwargs") or {}).get("scene") for run in runs]
    return {
        (run.env, run.settings["algo"], scene, run.evaluation["seed"]): run.evaluation
        for run, scene in zip(runs, scenes, strict=True)
    }


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_results_of_a_card_are_those_of_its_table_and_of_the_published_runs(folder, rows):
    _, head, body = (folder / "README.md").read_text(encoding="utf-8").split("---\n", 2)
    data, config = yaml.safe_load(head), read_config(folder)
    table = dict(re.findall(r"^\| ([a-z ]+) \| ([^|]+) \|", body, re.M))
    (model,) = data["model-index"]
    (result,) = model["results"]
    evaluation = rows[config.env, config.algo, config.env_kwargs.get("scene"), config.seed]
    measures = {label: (key, scale, digits, unit) for label, key, scale, digits, unit in MEASURES}
    found = {metric["type"].replace("_", " "): metric for metric in result["metrics"]}
    assert found.keys() == {label for label in measures if table.get(label, "-").strip() != "-"}
    for label, metric in found.items():
        key, scale, digits, unit = measures[label]
        assert f"{metric['value']:.{digits}f}{unit}" == table[label]
        assert metric["name"] == f"{label} [{unit.strip()}]"
        assert metric["value"] == round(scale * evaluation[key], digits)
    assert result["dataset"]["type"] == config.env
    assert result["task"]["type"] == "reinforcement-learning"
    assert data["library_name"] == (
        "sb3-contrib" if config.algo in ("tqc", "crossq") else "stable-baselines3"
    )
    assert data["license"] == "mit"
