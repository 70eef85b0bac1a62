"""The studies on tiny inputs: their metrics, columns, files and refusals. No speed is asserted."""

import dataclasses
import importlib.util
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from published_runs import rows

import redundant_envs as rde
from redundant_envs.control.holding import slider_travel
from redundant_envs.effects import OWN
from redundant_envs.envs import cost
from redundant_envs.scenes import config_folder
from redundant_envs.scenes.scene import scene_names
from redundant_envs_train.config import checked
from studies import (
    accuracy,
    accuracy_config,
    accuracy_methods,
    accuracy_plots,
    accuracy_report,
    effects,
    environments,
    ilqr,
    modes,
    poses,
    redundancy,
    stops,
    strength,
    throughput,
)
from studies import accuracy_metrics as metrics
from studies.__main__ import main

POLICIES = Path(__file__).parents[2] / "policies"
CASE = {"arm": "RPRP", "integrator": "rk4"}
STUDIES = config_folder("studies")
QUICK = yaml.safe_load((STUDIES / "accuracy_quick.yaml").read_text(encoding="utf-8"))
SHIPPED = yaml.safe_load((STUDIES / "effects.yaml").read_text(encoding="utf-8"))
STUDY = checked(effects.Study, SHIPPED)
UNDER_TOLERANCE = {"arm": "FourR", "integrator": "rk8", "tolerance": 1e-9}
SPEEDS = {"lanes": 64, "repeats": 3, "cases": [CASE, UNDER_TOLERANCE]}


@pytest.mark.long
def test_throughput_writes_speeds_evaluations_and_true_errors(tmp_path):
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(SPEEDS), encoding="utf-8")
    assert main(["throughput", "--config", str(tmp_path / "c.yaml"), "--out", str(tmp_path)]) == 0
    table = rows(tmp_path / "throughput.csv")
    row, other = ({c: yaml.safe_load(cell) for c, cell in cells.items()} for cells in table)
    assert tuple(row) == throughput.COLUMNS
    assert 0.0 < row["ns_per_step_best"] <= row["ns_per_step_median"]
    assert 12.0 < other["evaluations_mean"] < 50.0
    assert other["share_below_tolerance"] >= 0.98


def test_a_tolerance_of_speeds_needs_the_4r_arm():
    throughput.load_study(STUDIES / "throughput.yaml")
    with pytest.raises(ValueError, match="a tolerance needs FourR"):
        checked(throughput.Study, SPEEDS | {"cases": [CASE | {"tolerance": 1e-6}]})


@pytest.mark.long
def test_environment_columns(monkeypatch):
    # The subprocess that measures the import time takes seconds; it is left to the study.
    monkeypatch.setattr(environments, "first_step_seconds", lambda name: 0.5)
    names = *environments.IDS, "redundant_envs/TwoRTrack-v0"
    found = environments.run(names, lanes=4, rounds=1, steps=120)
    assert [row["env"] for row in found] == [*names]
    for row in found:
        assert tuple(row) == environments.COLUMNS
        numbers = ("vector_steps_per_s_best", "single_us_per_step", "cartpole_us_per_step")
        assert all(row[name] > 0 for name in numbers)


@pytest.mark.long
def test_modes_are_timed_beside_efforts():
    found = modes.run(lanes=8, rounds=1)
    rows = {name: [row["action"] for row in found if row["env"] == name] for name in environments.IDS}
    without = "redundant_envs/TwoRReach-v0"  # it has no posture beside its tip
    assert rows == {name: [*modes.MODES[: -1 if name == without else None]] for name in environments.IDS}
    for row in found:
        assert tuple(row) == modes.COLUMNS
        assert row["ns_per_step"] > 0
        assert row["evaluations"] >= 12.0
        assert (row["action"] == "effort") <= (row["times_effort"] == 1.0)


@pytest.mark.long
def test_the_study_of_stops_times_both_scenes_at_the_shares_asked_for():
    *shares, random = found = stops.run({"random": stops.random_policy(0)}, lanes=200, repeats=2)
    assert [row["touched_share"] for row in shares] == [0.01, 0.2]
    assert random["touched_share"] > 0.05
    for row in found:
        assert set(row) == set(stops.COLUMNS)
        assert row["ratio"] == pytest.approx(row["ns_with"] / row["ns_without"], rel=0.02)
        assert row["evaluations_with"] > row["evaluations_without"]


def test_every_effect_of_the_package_has_an_entry_and_is_timed_beside_a_bare_arm():
    assert {type(entry.effect).__name__ for entry in STUDY.entries.values()} == {*OWN}
    for entry in STUDY.entries.values():
        assert all(isinstance(effect, cost.BARE) for effect in entry.arm.effects)
        assert entry.zero is None or (type(entry.zero) is type(entry.effect) and entry.zero != entry.effect)
    every = effects.pairs_of(STUDY)
    assert [*every] == ["bare FourR", "bare RPRP", *STUDY.entries, *scene_names()]
    assert every["LimitSpring"].without == rde.load_scene("four_r_reach")
    assert every["rprp_reach"] == (rde.load_scene("rprp_reach"), every["bare RPRP"].scene)
    some = effects.pairs_of(STUDY, ["Gravity", "rprp_stops"])
    assert [*some] == ["bare FourR", "Gravity", "rprp_stops"]


@pytest.mark.long
def test_the_study_of_redundancy_runs_every_controller_on_the_same_episodes():
    found = redundancy.run(4, ["ReachLight"])
    assert [tuple(row) for row in found] == [redundancy.COLUMNS] * 6
    assert [row["controller"] for row in found] == ["nearest pose", "expert"] * 3
    assert all(0.0 <= row["success"] <= 1.0 for row in found)


@pytest.mark.long
def test_the_study_of_ilqr_judges_by_the_environment_and_continues_from_stronger_motors(monkeypatch):
    monkeypatch.setattr(ilqr, "STAGES", 1)
    monkeypatch.setattr(ilqr, "ROUNDS", 3)
    strong, weak = ilqr.run(["RPRP"], 6, (0.6, 0.3))
    assert tuple(strong) == ilqr.COLUMNS
    assert strong["can_be_held"] == 1.0
    assert strong["ilqr"] == strong["ilqr_of_those"] >= 0.8 > weak["ilqr"]
    assert "| RPRP | 0.6 | 100 % | " in ilqr.ilqr_table([strong, weak])
    with pytest.raises(ValueError, match="arm is '3R'; choose 4R or RPRP"):
        ilqr.run(["3R"], 6)


@pytest.mark.long
def test_the_study_writes_its_files_and_judges_its_ceilings(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(effects, "OWN", {"ViscousFriction": rde.effects.ViscousFriction})
    monkeypatch.setattr(effects, "ceilings_of", lambda kind: [effects.Ceilings(step=1e6, tolerance=1e-6)])
    config = tmp_path / "config.yaml"
    config.write_text(yaml.safe_dump({**SHIPPED, "lanes": 16, "turns": 2, "scenes": {}}), encoding="utf-8")
    words = ["effects", "ViscousFriction", "--config", str(config), "--out", str(tmp_path)]
    assert main(words) == 0
    assert "1 of 2 ceilings hold; not ViscousFriction at 1e-6 m (" in capsys.readouterr().out
    assert [(r["at"], r["of"], r["ceiling"], r["held"]) for r in rows(tmp_path / "effects.csv")] == [
        ("one rk8 step", "bare FourR", "", ""),
        ("one rk8 step", "ViscousFriction", "1000000.0", "True"),
        ("1e-6 m", "bare FourR", "", ""),
        ("1e-6 m", "ViscousFriction", "1e-06", "False"),
    ]


def smallest():
    """The part of the quick study that is short enough for a test."""
    return checked(accuracy_config.Study, QUICK | {"ours": {"rk4": [1, 4], "rk8": [2]}})


def test_errors_are_distances_and_infinite_where_a_motion_is_lost():
    q = np.zeros((3, 4))
    turned = q + np.array([[0.0], [0.01], [np.nan]])  # the stretched 2 m arm turns about its base
    error = metrics.tip_error(rde.Scene(rde.FourR((1.0,) * 4, (0.5,) * 4)), turned, q)
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
def test_a_wrong_config_of_accuracy_is_refused(change, said):
    accuracy_config.load_study(STUDIES / "accuracy.yaml")
    with pytest.raises(ValueError, match=said):
        checked(accuracy_config.Study, QUICK | change)


@pytest.mark.long
def test_the_study_of_accuracy_writes_its_files_and_draws_its_figures_again(tmp_path):
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


def test_titles_state_what_the_numbers_say():
    held = {"computed torque": (1.0, 0.2), "PPO": (0.9, 0.5), "SAC": (0.8, 0.6)}
    table = [
        strength.Row("4R", factor, who, rate, 0.0, 1.0, None, 0, 10)
        for who, rates in held.items()
        for factor, rate in zip((1.0, 0.3), rates, strict=True)
    ]
    assert strength.finding(table) == ": at 0.3 of the strength SAC\nholds 60 %, computed torque 20 %"
    assert strength.finding(table[:2]) == ""
    bought = {("Track", "4R", "expert"): 99.0, ("Track", "4R", "nearest pose"): 98.0}
    bought |= {("ReachLight", "2R", "expert"): 30.0, ("ReachLight", "2R", "nearest pose"): 20.0}
    said = "In ReachLight 2R succeeds in 30 % by its null space, in 20 % from the nearest pose"
    assert redundancy.finding(bought) == said
    cheap, dear = ({"ns_best": ns, "tip_mm_p99": 1e-3, "energy_rate_median": ns} for ns in (2.0, 84.0))
    lines = [{**cheap, "peer": ""}, {**dear, "peer": "mujoco"}]
    panels = [accuracy.PanelResult(None, rows, rows, 0.0) for rows in (lines, [*lines, lines[1]])]
    said = "Within the error of an encoder this package is 42 times as fast as MuJoCo"
    assert accuracy_plots.advantages(panels[:1]) == said
    assert accuracy_plots.advantages([accuracy.PanelResult(None, lines[:1], [], 0.0)]) == ""
    assert accuracy_plots.drifts(panels).endswith(
        "lose 2e+00 of the energy per second at most, MuJoCo's 8e+01"
    )


def test_the_study_of_accuracy_runs_without_peers(monkeypatch):
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


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("accuracy --config nowhere.yaml", "nowhere.yaml"),
        ("accuracy --redraw empty", "has no accuracy.csv"),
        ("throughput --out broken/a", "is broken/a, which is below the broken link"),
        ("throughput --config c.csv --out c.csv --force", "c.csv would be replaced"),
        ("environments --lanes 0", "lanes is 0"),
        ("environments Nowhere-v0", "the id is 'redundant_envs/Nowhere-v0'; choose "),
        ("effects Wind", "effect is 'Wind'; choose Armature, "),
        ("intervals --intervals 0", "intervals is 0; give at least 1"),
        ("stops --lanes 7", "lanes is 7; give at least 8"),
        ("nothing", "invalid choice: 'nothing'"),
        ("", "required: study"),
    ],
)
def test_mistakes_exit_with_2(words, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken").symlink_to("nowhere")
    (tmp_path / "empty").mkdir()
    shutil.copy(STUDIES / "throughput.yaml", "c.csv")
    assert main(words.split()) == 2
    out, err = capsys.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)
    assert said in err


def test_a_pose_and_its_mirror_image_are_of_different_classes_and_so_are_sliders_in_and_out():
    four_r, rprp = rde.load_scene("four_r_reach"), rde.load_scene("rprp_reach")
    bent = np.array([[0.3, 0.8, 1.1, 1.2], [-0.3, -0.8, -1.1, -1.2]])  # mirrored in the x axis
    assert {*poses.pose_class(four_r, bent).tolist()} == {0, 1}
    middle = [0.5 * sum(ends) for ends in slider_travel(rprp).values()]
    phi = np.array([[0.3, middle[0] + d, 0.8, middle[1] + e] for d in (-0.01, 0.01) for e in (-0.01, 0.01)])
    assert len({*poses.pose_class(rprp, phi @ np.linalg.inv(rprp.robot.motor_map)).tolist()}) == 4


def test_the_study_of_poses_compares_policy_and_expert_on_the_same_goals():
    (row,) = poses.run([POLICIES / "FourRReach-v0-sac"], 6)
    assert tuple(row) == poses.COLUMNS
    assert (row["held"], row["expert_held"]) == (1.0, 1.0)
    assert 0.0 <= row["like_expert_where_held"] <= 1.0
