"""The accuracy study: metrics with known values, the answers, the checks of its config, its files."""

from __future__ import annotations

import csv
import dataclasses
import importlib.util
import math
import re

import numpy as np
import pytest
import yaml

import redundant_envs as rde
from redundant_envs.scenes.files import config_folder
from redundant_envs_train.config import checked
from studies import accuracy, accuracy_methods, accuracy_plots, accuracy_report
from studies import accuracy_long as long
from studies import accuracy_metrics as metrics
from studies.__main__ import main
from studies.account_of_contacts import contact_motion
from studies.accuracy_config import Panel, Study, load_study
from studies.accuracy_methods import MuJoCo, Ours

e = rde.effects
STUDIES = config_folder("studies")
LAB = rde.FourR((1.0,) * 4, (0.5,) * 4)
HANGING = rde.Scene(LAB, (e.Gravity(),))
STOPS = rde.Scene(
    rde.RPRP((1.0, 2.0, 1.5, 0.5), (0.5, 0.5)), (e.Gravity(0.0), e.PrismaticStop((0.0, 0.0), (0.4, 0.4), 1.0))
)


QUICK = yaml.safe_load((STUDIES / "accuracy_quick.yaml").read_text(encoding="utf-8"))
PANEL = QUICK["panels"][0]


def smallest() -> Study:
    """The part of the quick study that is short enough for a test."""
    return checked(Study, QUICK | {"ours": {"rk4": [1, 4], "rk8": [2]}})


def test_tip_error_is_a_distance_and_infinite_where_lost():
    q = np.zeros((3, 4))
    turned = q + np.array([[0.0], [0.01], [np.nan]])  # the stretched 2 m arm turns about its base
    error = metrics.tip_error(HANGING, turned, q)
    np.testing.assert_allclose(error[:2], [0.0, 2.0 * 2.0 * np.sin(0.005)], atol=1e-15)
    assert error[2] == np.inf
    assert list(metrics.largest_error(turned, q)) == [0.0, 0.01, np.inf]


def test_quantiles_digits_and_penetrations_are_infinite_where_lost():
    errors = np.arange(1.0, 101.0)
    assert [metrics.quantile(errors, x) for x in (0.5, 0.99, 1.0)] == [50.0, 99.0, 100.0]
    errors[98:] = np.inf
    assert [metrics.quantile(errors, x) for x in (0.98, 0.99)] == [98.0, np.inf]
    assert [metrics.digits(x, 2.0) for x in (2e-12, 0.0)] == pytest.approx([12.0, 15.65], abs=0.01)
    path = np.zeros((2, 2, 4))
    path[:, :, 1] = 0.1
    path[1, 0, 3], path[0, 0, 3], path[0, 1, 1] = -0.02, 0.5, np.nan
    assert list(metrics.penetration(path, {1: (0.0, 0.4), 3: (0.0, 0.4)})) == pytest.approx([0.1, np.inf])


def test_energy_and_momentum():
    assert metrics.energy_scale(HANGING, np.zeros(4)) == pytest.approx(9.81 * 0.5 * (1 + 2 + 3 + 4))
    q, qd = np.zeros((3, 4)), np.array([[1.0] * 4, [2.0] * 4, [3.0] * 4])
    scale = 0.25 * (1 + 4 + 9 + 16)  # sum m r^2 of the stretched arm
    np.testing.assert_allclose(metrics.energy(HANGING, q, qd), 0.5 * scale * qd[:, 0] ** 2)
    faster = qd + np.array([[0.5], [0.0], [np.inf]])
    error = metrics.momentum_error(HANGING, (q, qd, 0.0 * q), (q, faster))
    np.testing.assert_allclose(error, [0.25, 0.0, np.inf], atol=1e-14)
    assert metrics.weightless(HANGING).effects == (e.Gravity(0.0),)


def test_exponent_of_the_upright_arm():
    """Known: near upright, deviations grow as exp(t sqrt(x g / l)), x the largest zero of L_4."""
    q = np.full((2, 4), 0.5 * np.pi)
    start = q, 0.0 * q, 0.0 * q
    growth = [s * metrics.lyapunov(HANGING, start, s) for s in (1.0, 1.5)]
    np.testing.assert_allclose((growth[1] - growth[0]) / 0.5, np.sqrt(9.395070912301 * 9.81 / 0.5), rtol=1e-3)


@pytest.mark.long
def test_impacts_of_a_straight_arm():
    """The last mass flies to its stop, bounces, flies back to the other end."""
    pytest.importorskip("scipy")
    start = np.array([[0.0, 0.2, 0.0, 0.2]]), np.array([[0.0, 0.0, 0.0, 1.0]]), np.zeros((1, 4))
    scene = dataclasses.replace(STOPS, control_dt=0.3)
    (q,), (times,) = contact_motion(scene, start, 1e-12)
    np.testing.assert_allclose(times, [0.2], atol=1e-12)
    np.testing.assert_allclose(q, [0.0, 0.2 + 0.1 * 2.0 * 0.5 / 4.0, 0.0, 0.3], atol=1e-12)


@pytest.mark.long
def test_stop_metrics_of_ours():
    start = np.array([[0.3, 0.2, 0.1, 0.3]]), np.array([[0.5, 0.0, -0.5, 2.0]]), np.zeros((1, 4))
    path, ((motion, time),) = Ours("rk8", 0.02, substeps=2).path(STOPS, start, 0.1, 10)
    assert path.shape == (10, 1, 4)
    assert metrics.penetration(path, metrics.stops(STOPS)) == [0.0]
    assert (motion, time) == (0, pytest.approx(long.first_impacts(STOPS, start)[0], abs=1e-11))


@pytest.mark.long
def test_mujoco_goes_a_little_beyond_its_stops():
    pytest.importorskip("mujoco")
    start = np.array([[0.0, 0.2, 0.0, 0.3]]), np.array([[0.0, 0.0, 0.0, 1.0]]), np.zeros((1, 4))
    deepest = []
    for steps in (20, 100):
        method = MuJoCo("RK4", 0.02, steps, states=1, steps=1, stiffness=0.3)
        path, found = method.path(STOPS, start, 0.2, 200)
        assert path.shape == (200, 1, 4)
        assert found is None
        deepest.append(metrics.penetration(path, metrics.stops(STOPS))[0])
    assert 1e-5 < deepest[1] < 0.5 * deepest[0] < 0.01


def row(peer, method, ns, p99):
    return {"peer": peer, "method": method, "setting": "1 x 20 ms", "ns_best": ns, "tip_mm_p99": p99,
            "evaluations": 4.0}  # fmt: skip


ROWS = [
    row("", "rk4", 40.0, 0.5), row("", "rk8", 120.0, 1e-5), row("", "euler", 200.0, 0.9),
    row("", "lost", 1.0, math.inf),
    row("mujoco", "MuJoCo RK4", 3600.0, 0.5), row("mujoco", "MuJoCo Euler", 17000.0, 0.8),
    row("scipy", "SciPy RK45", 10.0, 1e-9),
]  # fmt: skip


def test_answers_and_their_words():
    first, second, third = accuracy.answers(ROWS, [1.0, 1e-4, 1e-8])
    assert (first.ours["method"], first.mujoco["method"], first.ratio) == ("rk4", "MuJoCo RK4", 90.0)
    assert (second.ours["method"], second.mujoco, third.ours) == ("rk8", None, None)
    assert np.isnan([second.ratio, third.ratio]).all()
    assert accuracy.cheapest(ROWS, "", 0.5) is ROWS[1]  # below, not at
    assert accuracy_report.who(first.mujoco) == ["MuJoCo RK4, 1 x 20 ms", "3.6 us", "4"]
    assert accuracy_report.who(second.mujoco)[0] == "not reached"
    for bar, words in ((None, "90 x"), (80.0, "90 x (above 80)"), (100.0, "90 x (**below** 100)")):
        assert accuracy_report.advantage(first, bar) == words
    assert accuracy_report.advantage(second, 80.0) == ""
    assert [accuracy_report.duration(x) for x in (35.17, 999.7, 1.4e6)] == ["35.2 ns", "1 us", "1.4 ms"]
    assert accuracy_report.after("1_s") == "tip after 1 s, mm"
    assert accuracy_report.after("2_lyapunov") == "tip after 2 Lyapunov times, mm"


def test_shipped_configs_ask_what_was_promised():
    studies = [load_study(STUDIES / f"{name}.yaml") for name in ("accuracy", "accuracy_quick")]
    assert {p.scene(s.control_dt).control_dt for s in studies for p in s.panels} == {0.02}
    assert studies[0].states >= 4096
    assert studies[0].thresholds_mm == (1.0, 1e-2, 1e-4, 1e-8)
    assert [p.bar for p in studies[0].panels if p.robot["type"] == "FourR"] == [80.0, 80.0]


def test_states_are_drawn_as_told():
    panel = checked(Panel, PANEL | {"low": [0, 1, 2, 3], "high": [1, 2, 3, 4]})
    q, qd, efforts = panel.states(4000, 3)
    assert (np.floor(q) == np.arange(4)).all()
    np.testing.assert_allclose(qd.std(axis=0), panel.rate_sd, rtol=0.05)
    moved = efforts.any(axis=1)
    assert abs(moved.mean() - 0.5) < 0.05
    np.testing.assert_allclose(efforts[moved].std(axis=0), panel.effort_sd, rtol=0.06)
    assert (panel.states(4000, 3)[0] == q).all()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"speed": 1}, "speed is unknown; valid: control_dt, states"),
        ({"ours": {"rk5": [1]}}, "ours.rk5 is unknown; valid: ours.euler, ours.rk4, ours.rk8"),
        ({"ours": {"rk4": [1, 2.5]}}, r"ours.rk4\[1\] is 2.5; give a whole number from 1 to 1e\+06"),
        ({"ours": {"tolerance": [0.0]}}, r"ours.tolerance\[0\] is 0.0; give a number from 1e-15"),
        ({"mujoco": {"rk4": [1]}}, "mujoco.rk4 is unknown; valid: mujoco.Euler"),
        ({"scipy": {"LSODA": [1e-3]}}, "valid: scipy.RK45, scipy.DOP853"),
        ({"control_dt": -1.0}, "control_dt is -1.0; give a number from 1e-15 to 1e"),
        ({"timing": {"rounds": 1}}, "timing.scipy_rounds is missing"),
        ({"long_runs": QUICK["long_runs"] | {"mujoco": {"RK4": [5]}}}, "RK4 has 5, which mujoco.RK4 lacks"),
        ({"reference": QUICK["reference"] | {"scene": {"integrator": "rk5"}}}, "integrator is 'rk5'"),
        ({"panels": [PANEL | {"peers": ["drake"]}]}, r"panels\[0\].peers\[0\] is 'drake'; choose 'mujoco'"),
        ({"panels": [PANEL | {"rate_sd": [1.0]}]}, r"panels\[0\].rate_sd has 1 entries; give at least 4"),
        ({"panels": [PANEL | {"effort_share": 2.0}]}, "effort_share is 2.0; give a number from 0 to 1"),
        ({"panels": [PANEL | {"effects": [{"type": "Wind"}]}]}, r"effects\[0\].type is 'Wind'; valid"),
    ],
)  # fmt: skip
def test_config_errors(change, said):
    with pytest.raises(ValueError, match=said):
        checked(Study, QUICK | change)


@pytest.mark.long
def test_the_study_writes_its_files(tmp_path, capsys):
    for name in ("mujoco", "scipy", "matplotlib"):
        pytest.importorskip(name)
    study = smallest()
    page, *files = accuracy_report.write(study, "a command", tmp_path)
    assert all(path.stat().st_size > 1000 for path in files)
    assert sorted(p.suffix for p in files) == [".csv", ".csv", ".png", ".png", ".svg", ".svg"]
    text = page.read_text(encoding="utf-8")
    assert "`a command`" in text
    assert "![](accuracy_work_precision.png)" in text
    # Which of them is the cheapest is a matter of time, and tests share their machine.
    assert re.search(r"\| 4R \| 1 mm \| rk[48], \d x \d+ ms \| [\d.]+ [nu]s \|", text)
    with files[0].open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 + 3 + 2
    by = {(r["method"], r["setting"]): r for r in rows}
    assert float(by["rk8", "2 x 10 ms"]["evaluations"]) == 24.0
    # The same method on the same arm makes the same error, in every implementation.
    ours, theirs = (float(by[m, "4 x 5 ms"]["tip_mm_median"]) for m in ("rk4", "MuJoCo RK4"))
    assert ours == pytest.approx(theirs, rel=1e-3)
    assert float(by["rk4", "1 x 20 ms"]["tip_mm_median"]) > 50 * ours
    assert all(float(r["ns_median"]) >= float(r["ns_best"]) > 0.0 for r in rows)
    with files[1].open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [r["method"] for r in rows] == ["rk4", "rk4", "rk8", "MuJoCo RK4"]
    assert float(rows[2]["energy_rate_median"]) < float(rows[0]["energy_rate_median"])
    assert "accuracy 1/" in capsys.readouterr().err
    again = accuracy_plots.read(study, tmp_path)
    assert len(again) == len(study.panels)
    for drawn, path in zip(again[0].rows, by.values(), strict=True):
        assert drawn["tip_mm_p99"] == float(path["tip_mm_p99"])
    for figure in (
        accuracy_plots.work_precision_figure(again, 0.02),
        accuracy_plots.energy_figure(again, 0.02, 64),
    ):
        assert {axes.get_yscale() for axes in figure.axes} == {"log"}
        assert "logarithmic" in figure.get_supylabel()
        assert "logarithmic" in figure.get_supxlabel()
    before = {path: path.read_bytes() for path in files if path.suffix == ".png"}
    assert accuracy_plots.save_figures(again, study, tmp_path)[: len(before)] == list(before)
    assert all(path.read_bytes() == old for path, old in before.items())


def test_configs_are_there_and_figures_are_drawn_again_only_from_tables_of_the_study(tmp_path, capsys):
    assert main(["accuracy", "--config", str(tmp_path / "no.yaml")]) == 2
    assert "there is no such file" in capsys.readouterr().err
    assert main(["accuracy", "--redraw", str(tmp_path)]) == 2
    assert "has no accuracy.csv" in capsys.readouterr().err
    for name in accuracy_plots.TABLES:
        (tmp_path / name).write_text("panel,peer,method,setting\nother,,rk4,1 x 20 ms\n", encoding="utf-8")
    assert main(["accuracy", "--redraw", str(tmp_path)]) == 2
    assert "has no panel '4R calm', only other" in capsys.readouterr().err
    for head, row in (
        ("setting,floor_mm", "1,x"),
        ("setting,floor_mm", "1,nan"),
        ("setting", "1"),
        ("q_p99", "1"),
    ):
        text = f"panel,peer,method,{head}\n4R calm,,rk4,{row}\n"
        (tmp_path / "accuracy.csv").write_text(text, encoding="utf-8")
        assert main(["accuracy", "--redraw", str(tmp_path)]) == 2
        assert "accuracy.csv" in capsys.readouterr().err


def test_the_study_without_peers(tmp_path, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        accuracy_methods.importlib.util, "find_spec", lambda n: None if n in ("mujoco", "scipy") else find(n)
    )
    study = smallest()
    (result,) = accuracy.run(study)
    assert {r["peer"] for r in result.rows} == {""}
    assert [a.by for a in result.agreements] == ["rk8, 64 steps"]
    text = accuracy_report.page_text(study, [result], "a command", [])
    assert "mujoco is not installed" in text
    assert "| not run |" in text


def test_the_reference_agrees_with_others():
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
