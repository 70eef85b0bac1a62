"""The accuracy study: its metrics have known values, its config is checked, its files are written."""

from __future__ import annotations

import dataclasses
import importlib.util
import re

import numpy as np
import pytest
import yaml
from published_runs import rows

import redundant_envs as rde
from redundant_envs.scenes.files import config_folder
from redundant_envs_train.config import checked
from studies import accuracy, accuracy_methods, accuracy_plots, accuracy_report
from studies import accuracy_metrics as metrics
from studies.accuracy_config import Study, load_study

STUDIES = config_folder("studies")
HANGING = rde.Scene(rde.FourR((1.0,) * 4, (0.5,) * 4), (rde.effects.Gravity(),))
QUICK = yaml.safe_load((STUDIES / "accuracy_quick.yaml").read_text(encoding="utf-8"))


def smallest() -> Study:
    """The part of the quick study that is short enough for a test."""
    return checked(Study, QUICK | {"ours": {"rk4": [1, 4], "rk8": [2]}})


def test_errors_are_distances_and_infinite_where_a_motion_is_lost():
    q = np.zeros((3, 4))
    turned = q + np.array([[0.0], [0.01], [np.nan]])  # the stretched 2 m arm turns about its base
    error = metrics.tip_error(HANGING, turned, q)
    np.testing.assert_allclose(error, [0.0, 2.0 * 2.0 * np.sin(0.005), np.inf], atol=1e-15)
    assert list(metrics.largest_error(turned, q)) == [0.0, 0.01, np.inf]
    errors = np.arange(1.0, 101.0)
    errors[98:] = np.inf
    assert [metrics.quantile(errors, x) for x in (0.5, 0.98, 0.99)] == [50.0, 98.0, np.inf]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"long_runs": QUICK["long_runs"] | {"mujoco": {"RK4": [5]}}}, "RK4 has 5, which mujoco.RK4 lacks"),
        ({"reference": QUICK["reference"] | {"scene": {"integrator": "rk5"}}}, "integrator is 'rk5'"),
    ],
)
def test_a_wrong_config_is_refused(change, said):
    load_study(STUDIES / "accuracy.yaml")
    with pytest.raises(ValueError, match=said):
        checked(Study, QUICK | change)


@pytest.mark.long
def test_the_study_writes_its_files_and_draws_its_figures_again(tmp_path):
    for name in ("mujoco", "scipy", "matplotlib"):
        pytest.importorskip(name)
    study = smallest()
    page, *files = accuracy_report.write(study, "a command", tmp_path)
    assert sorted(p.suffix for p in files) == [".csv", ".csv", ".png", ".png", ".svg", ".svg"]
    # Which of them is the cheapest is a matter of time, and tests share their machine.
    text = page.read_text(encoding="utf-8")
    assert re.search(r"\| 4R \| 1 mm \| rk[48], \d x \d+ ms \| [\d.]+ [nu]s \|", text)
    by = {(r["method"], r["setting"]): r for r in rows(files[0])}
    assert len(by) == 3 + 3 + 2
    assert float(by["rk8", "2 x 10 ms"]["evaluations"]) == 24.0
    # The same method on the same arm makes the same error, in every implementation.
    ours, theirs = (float(by[m, "4 x 5 ms"]["tip_mm_median"]) for m in ("rk4", "MuJoCo RK4"))
    assert ours == pytest.approx(theirs, rel=1e-3)
    assert float(by["rk4", "1 x 20 ms"]["tip_mm_median"]) > 50 * ours
    runs = rows(files[1])
    assert [r["method"] for r in runs] == ["rk4", "rk4", "rk8", "MuJoCo RK4"]
    assert float(runs[2]["energy_rate_median"]) < float(runs[0]["energy_rate_median"])
    before = {path: path.read_bytes() for path in files if path.suffix == ".png"}
    accuracy_plots.save_figures(accuracy_plots.read(study, tmp_path), study, tmp_path)
    assert {path: path.read_bytes() for path in before} == before


def test_the_study_runs_without_peers(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        accuracy_methods.importlib.util, "find_spec", lambda n: None if n in ("mujoco", "scipy") else find(n)
    )
    study = smallest()
    (result,) = accuracy.run(study)
    assert {r["peer"] for r in result.rows} == {""}
    text = accuracy_report.page_text(study, [result], "a command", [])
    assert "mujoco is not installed" in text


def test_the_reference_agrees_with_others_and_a_coarse_one_does_not():
    for name in ("mujoco", "scipy"):
        pytest.importorskip(name)
    study = smallest()
    (panel,) = study.panels
    scene = panel.scene(study.control_dt, **study.reference.scene)
    start = panel.states(study.states, 0)
    found = accuracy.check_reference(study, panel, scene, start, metrics.end(scene, start, 0.02)[0])
    assert [a.states for a in found] == [64, 4, 4]
    assert min(a.digits for a in found) > 12.0
    coarse = dataclasses.replace(scene, integrator="rk4", substeps=1)
    wrong = accuracy.check_reference(study, panel, scene, start, metrics.end(coarse, start, 0.02)[0])
    assert max(a.digits for a in wrong) < 8.0
