"""Tables of the README and the manual are those of the studies and runs."""

import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "docs" / "results"


def test_what_an_error_costs_is_what_the_study_wrote():
    written = (ROOT / "docs" / "results" / "accuracy" / "accuracy.md").read_text(encoding="utf-8")
    lines = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("| arm | 99 %"))
    rows = lines[start : lines.index("", start)]
    assert len(rows) >= 10
    for row in rows:
        assert row in written


@pytest.mark.parametrize(
    ("page", "folder"),
    [
        ("docs/learners.md", "runs"), ("docs/learners.md", "baselines"), ("docs/strength.md", "weak"),
    ],
)  # fmt: skip
def test_the_table_of_learners_is_made_from_the_shipped_runs(page, folder):
    from redundant_envs_train.evidence.table import table

    runs = sorted((ROOT / "docs" / "results" / folder).glob("*/*"))
    rows = [line for line in table(runs).splitlines() if line.startswith("| ")]
    assert len(rows) >= 8
    text = (ROOT / page).read_text(encoding="utf-8")
    for row in rows:
        assert row in text


def test_the_results_of_the_readme_are_those_of_the_shipped_runs():
    from redundant_envs_train.evidence.table import brief_table

    table = brief_table(sorted(RESULTS.glob("runs/*/*")))
    assert table.count("\n") >= 7
    again = "the table of results is not that of docs/results/runs; run python docs/figures/remake.py"
    assert f"-->\n{table}\n<!--" in (ROOT / "README.md").read_text(encoding="utf-8"), again


def test_the_table_of_strengths_is_what_the_study_wrote():
    from redundant_envs_train.studies.strength import learner_rows, read_rows
    from redundant_envs_train.studies.strength_run import table

    rows = read_rows(ROOT / "docs" / "results" / "strength" / "strength.csv")
    assert {(row.arm, row.factor) for row in rows} >= {
        (a, f) for a in ("4R", "RPRP") for f in (1.0, 0.5, 0.3)
    }
    assert table(rows) in (ROOT / "docs" / "strength.md").read_text(encoding="utf-8")
    places = ("runs/*_reach_sac/*", "weak/*/*", "strength/runs/*")
    kept = [run for place in places for run in sorted(RESULTS.glob(place))]  # means depend on the order
    assert sorted(map(str, learner_rows(kept))) == sorted(str(row) for row in rows if row.seeds)


def test_the_ablations_are_those_of_the_kept_runs():
    text = (ROOT / "docs" / "learners.md").read_text(encoding="utf-8")
    rows = {"": "all parts", "average=0": "without the average",
            "smoothness=0": "without the smoothness term",
            "policy_delay=1": "with an actor step for every critic step (`sac.policy_delay=1`)",
            "activation=tanh": "with tanh instead of SiLU"}  # fmt: skip
    for setting, name in rows.items():
        cells = []
        for arm in ("four_r", "rprp"):
            run = f"{arm}_sac.{setting}" if setting else f"{arm}_sac"
            path = RESULTS / "ablations" / run / "seed0" / "evaluation.json"
            found = json.loads(path.read_text(encoding="utf-8"))
            missed = round((1 - found["hold_success"]) * found["episodes"])
            there = f"{found['restless']} of {missed}" if missed else "-"
            cells += [f"{100 * found['hold_success']:.1f} %", there]
        assert f"| {name} | {' | '.join(cells)} |" in text


def test_shipped_runs_are_complete():
    folders = [path.parent for path in RESULTS.rglob("config.yaml")]
    assert len(folders) == 140 + 20 + 12 + 48 + 10  # presets, stock algorithms, weak, strengths, ablations
    for folder in folders:
        found = {path.name for path in folder.iterdir()}
        assert found | {"policy.zip"} == {
            "config.yaml", "scene.yaml", "selection.csv", "policy.zip", "training.json", "evaluation.json",
        }, folder  # fmt: skip
    for group in {f.parent for f in folders} - {RESULTS / "strength" / "runs"}:
        lowest = min(group.iterdir(), key=lambda folder: int(folder.name.removeprefix("seed")))
        assert (lowest / "policy.zip").is_file(), lowest
