"""The policy study: pairs, intervals, sentences that agree with its numbers, and small studies."""

import dataclasses
import shutil

import numpy as np
import pytest
import yaml
from run_folders import POLICIES, REFUSALS, ROOT, csv_rows, says

from redundant_envs.scenes.scene import load_scene
from redundant_envs_train.config import load
from redundant_envs_train.rollout import STUDY_SEED, expert_act, random_act, run_episodes
from studies.policy import episodes, words
from studies.policy.episodes import compare, evaluate_under
from studies.policy.settings import Physics, Study, load_study

PRESET = "configs/training/rprp_reach_ppo.yaml"
SHIPPED = "configs/studies/policy.yaml"
RUN = POLICIES / "RPRPReach-v0-ppo"
EULER, EXACT = Physics(integrator="euler", substeps=1), Physics(accuracy="exact")
STUDY = Study(physics={"exact": EXACT, "rk4": EULER}, arms={"A": {"preset": PRESET}}, train_seeds=0)


def test_the_shipped_study_loads_and_survives_a_round_trip(tmp_path):
    study = load_study(SHIPPED)
    assert study.episodes >= 1000
    path = tmp_path / "again.yaml"
    path.write_text(yaml.safe_dump(study.to_dict()))
    assert load_study(path) == study
    interval = 1000 * load_scene("rprp_reach").control_dt
    for name, physics in study.physics.items():
        if name.endswith("ms"):  # a name says what it is
            integrator, step, _ = name.split()
            assert (physics.integrator, interval / physics.substeps) == (integrator, float(step))


@pytest.mark.parametrize("case", REFUSALS["study"], ids=lambda case: " ".join(case["given"]))
def test_mistakes_name_the_key_and_what_is_valid(case):
    with says(*case["says"]):
        load_study(SHIPPED, case["given"])


@pytest.mark.long
def test_episodes_are_pairs_and_their_costs_are_told():
    config = load("configs/training/four_r_reach_ppo.yaml")
    euler, exact = (
        evaluate_under(config.env, expert_act(), 9, STUDY_SEED, repeats=1, **physics.env_kwargs(config))
        for physics in (EULER, EXACT)
    )
    np.testing.assert_array_equal(euler.start, exact.start)
    np.testing.assert_array_equal(euler.goal, exact.goal)
    assert (euler.returns != exact.returns).all()
    result = compare(euler, exact, 200)
    assert result["return_difference"] == pytest.approx((euler.returns - exact.returns).mean())
    assert (euler.evaluations == euler.steps).all()
    assert (exact.evaluations >= 12 * exact.steps).all()
    with says("no pairs"):
        compare(euler._replace(goal=euler.goal[::-1]), exact, 200)
    # flips are counted each way, and the same episodes are drawn for both measures
    a, b = (np.array([letter == "1" for letter in held]) for held in ("111000110", "100100100"))
    here, there = (exact._replace(hold=x, returns=10.0 * x) for x in (a, b))
    result = compare(here, there, 1000)
    assert (result["won"], result["lost"], result["sign_test_p"]) == (3, 1, 0.625)
    assert result["hold_difference"] == pytest.approx(2 / 9)
    assert result["return_difference_low"] == pytest.approx(10 * result["hold_difference_low"])


def test_episodes_that_numerics_end_are_told_and_not_held():
    config = load("configs/training/four_r_reach_ppo.yaml", ["env_kwargs.task.speed_bound=20"])
    kwargs = EULER.env_kwargs(config)
    result = evaluate_under(config.env, random_act(0), 20, STUDY_SEED, repeats=1, **kwargs)
    assert result.ended.sum() > 5
    # the replay meets the same flags, each episode's up to its end
    assert result.flags == {"SPEED_BOUND": result.ended.sum()}
    outcome = run_episodes(config.env, random_act(0), 20, STUDY_SEED, **kwargs)
    assert episodes.held(outcome._replace(hold=~outcome.hold | True)).tolist() == (~outcome.ended).tolist()


def row(physics, hold, gain, **more):
    """Differences of hold success and return from the reference: mean, low and high."""
    ends = ("", "_low", "_high")
    return {
        "physics": physics, "reference": "exact", "episodes": 1000, "hold_success": 0.98 + hold[0],
        **{f"hold_difference{end}": value for end, value in zip(ends, hold, strict=True)},
        **{f"return_difference{end}": value for end, value in zip(ends, gain, strict=True)},
        "lost": 3, "won": 1, "sign_test_p": 1e-9, "mean_return": 60.0 + gain[0], "ended": 0,
        "median_abs_return_difference": 0.02, "half_from": 100, "control_steps": 100_000, "numerics": "",
        **more,
    }  # fmt: skip


ZERO = (0.0, 0.0, 0.0)
REFERENCE = row("exact", ZERO, ZERO)
SAME = row("rk8", (-0.002, -0.006, 0.002), (0.01, -0.02, 0.04))
WORSE_BOTH = (-0.3, -0.33, -0.27), (-20.0, -22.0, -18.0)
WORSE = row("euler", *WORSE_BOTH, ended=250, numerics="SPEED_BOUND 250")
FEW = row("rk4", (-0.005, -0.01, -0.001), ZERO, sign_test_p=0.0625)
TOLD = [
    (SAME, "none", "-0.2 (-0.6 to +0.2)", "none"), (WORSE, "large", "-30 (-33 to -27)", "large"),
    (FEW, "none", "-0.5 (-1 to -0.1)", "none"),
    (row("rk4", (-0.003, -0.005, -0.001), ZERO), "small", "-0.3 (-0.5 to -0.1)", "none"),
    (row("rk4", (0.005, -0.01, 0.02), (2.0, 0.9, 3.1)), "open", "+0.5 (-1 to +2)", "large"),
    (row("rk8", ZERO, (0.02, 0.01, 0.06), half_from=3), "none", "0 (0 to 0)", "none"),
    (row("rk8", ZERO, (0.02, 0.01, 0.06)), "none", "0 (0 to 0)", "small"),
]  # fmt: skip


@pytest.mark.parametrize(("here", "verdict", "text", "of_returns"), TOLD)
def test_a_verdict_is_about_the_interval_its_margin_and_how_few_decide(here, verdict, text, of_returns):
    found = words.hold_difference(here, STUDY)
    assert (found.verdict, found.text) == (verdict, text)
    assert words.return_difference(here, STUDY, REFERENCE).verdict == of_returns


def small(folder, arm, **more):
    """The command of a small study, which writes into ``folder``/out."""
    physics = {
        "euler 20 ms": {"integrator": "euler", "substeps": 1}, "standard": {"accuracy": "standard"},
        "exact": {"accuracy": "exact"},
    }  # fmt: skip
    arms = {"RPRP": {"preset": PRESET, **arm}}
    data = {"episodes": 20, "resamples": 200, "physics": physics, "arms": arms, "train_seeds": 0, **more}
    (folder / "study.yaml").write_text(yaml.safe_dump(data, sort_keys=False))
    return ["study", "policy", "--config", folder / "study.yaml", "--out", folder / "out"]


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([SAME], "no physics makes a difference beyond the margins to exact"),
        ([SAME, WORSE], "euler makes a difference to exact"),
        ([WORSE, row("rk2", *WORSE_BOTH), row("rk4", (0.0, -0.02, 0.02), ZERO)],
         "euler, rk2 make a difference and rk4 may make a difference to exact"),
    ],
)  # fmt: skip
def test_a_title_names_the_physics_that_make_a_difference(rows, said):
    assert words.finding([*rows, REFERENCE], STUDY) == said


def test_the_report_of_the_docs_is_made_again_from_its_tables(tmp_path, call, refused):
    (copy := tmp_path / "policy").mkdir()
    for file in (ROOT / "docs" / "results" / "policy").glob("*.*"):
        shutil.copy(file, copy)
    (copy / "report.md").unlink()
    call("study", "policy", "--redraw", copy)
    written = (copy / "report.md").read_text()
    assert written == (ROOT / "docs" / "results" / "policy" / "report.md").read_text()
    assert written.split("\n\n")[1].startswith(
        "**Verdict.** RPRP: euler 20 ms makes a difference to exact. 4R: "
    )
    assert (copy / "figures" / "rprp.png").stat().st_size > 1000
    for damage in ("arm,env\nRPRP,a\n", ""):
        (copy / "physics.csv").write_text(damage)
        refused(["study", "policy", "--redraw", copy], "is missing or damaged", "the policy study wrote")


@pytest.mark.long
def test_a_study_explains_itself(tmp_path, call):
    out = tmp_path / "out"
    shown, _ = call(*small(tmp_path, {"run": str(RUN)}))
    report = (out / "report.md").read_text()
    assert report in shown
    for text in ("# What the physics costs a policy", "20 episodes", "euler 20 ms", "machine", "llvmlite"):
        assert text in report
    for name in ("figures/rprp.png", "figures/rprp.svg", "scenes/rprp_euler_20_ms.yaml", "study.yaml"):
        assert (out / name).stat().st_size > 100
    own, scene = load_scene("rprp_reach"), load_scene(out / "scenes" / "rprp_euler_20_ms.yaml")
    assert (scene.integrator, scene.substeps, scene.tolerance) == ("euler", 1, None)
    stepping = {name: getattr(own, name) for name in ("integrator", "substeps", "tolerance")}
    assert dataclasses.replace(scene, **stepping) == own  # nothing else changes
    table = csv_rows(out / "physics.csv")
    assert [r["physics"] for r in table] == ["euler 20 ms", "standard", "exact"]
    assert float(table[2]["hold_difference"]) == float(table[2]["return_difference"]) == 0.0
    found = csv_rows(out / "episodes_rprp.csv")
    assert [int(e["seed"]) for e in found] == list(range(STUDY_SEED, STUDY_SEED + 20))
    mean = np.mean([float(e["standard_return"]) for e in found])
    assert mean == pytest.approx(float(table[1]["mean_return"]), abs=1e-6)
    assert not (out / "training.csv").exists()
    assert str(tmp_path) not in report


@pytest.mark.parametrize(
    ("arm", "word"),
    [
        ({"run": "nowhere"}, "config.yaml"), ({"preset": "nowhere.yaml"}, "nowhere.yaml"),
        ({"run": str(RUN), "preset": "four_r_reach_ppo"}, "was trained on redundant_envs/RPRPReach"),
    ],
)  # fmt: skip
def test_an_arm_that_cannot_be_taken_is_one_line(arm, word, tmp_path, refused):
    refused(small(tmp_path, arm), word)
