"""Tables of the README and the manual are those of the studies and runs."""

import re
import shlex

import pytest
from published_runs import RESULTS, ROOT

from redundant_envs_train.config import WITHOUT_EFFECT
from redundant_envs_train.evidence.runs import read_groups, read_runs
from redundant_envs_train.evidence.table import brief_table, table
from redundant_envs_train.run_folder import read_config, read_scene
from redundant_envs_train.studies import strength as strength_run
from redundant_envs_train.studies.strength import ARMS, FACTORS, learner_rows, read_rows


def test_what_an_error_costs_is_what_the_study_wrote():
    written = (RESULTS / "accuracy" / "accuracy.md").read_text(encoding="utf-8")
    lines = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("| arm | 99 %"))
    rows = lines[start : lines.index("", start)]
    assert len(rows) >= 10
    for row in rows:
        assert row in written


@pytest.mark.parametrize(
    ("page", "name"),
    [("docs/learners.md", "runs"), ("docs/learners.md", "baselines"), ("docs/strength.md", "weak")],
)
def test_the_table_of_learners_is_made_from_the_table_of_runs(page, name):
    rows = [line for line in table([RESULTS / f"{name}.csv"]).splitlines() if line.startswith("| ")]
    assert len(rows) >= 8
    text = (ROOT / page).read_text(encoding="utf-8")
    for row in rows:
        assert row in text


def test_the_results_of_the_readme_are_those_of_the_table_of_runs():
    brief = brief_table([RESULTS / "runs.csv"])
    assert brief.count("\n") >= 7
    again = "the table of results is not that of docs/results/runs.csv; run python docs/figures/remake.py"
    assert f"-->\n{brief}\n<!--" in (ROOT / "README.md").read_text(encoding="utf-8"), again


def test_the_table_of_strengths_is_what_the_study_wrote():
    rows = read_rows(RESULTS / "strength" / "strength.csv")
    assert {(row.arm, row.factor) for row in rows} >= {(a, f) for a in ARMS for f in FACTORS}
    page = (ROOT / "docs" / "strength.md").read_text(encoding="utf-8")
    assert strength_run.table(rows) in page
    (command,) = re.findall("^python -m agents study strength --seeds none --runs .*", page, re.M)
    kept = [ROOT / place for place in shlex.split(command) if "docs/results" in place]
    assert sorted(map(str, learner_rows(kept))) == sorted(str(row) for row in rows if row.seeds)


def test_the_ablations_are_those_of_the_table_of_runs():
    text = (ROOT / "docs" / "learners.md").read_text(encoding="utf-8")
    rows = {"": "all parts", "average=0": "without the average",
            "smoothness=0": "without the smoothness term",
            "policy_delay=1": "with an actor step for every critic step (`sac.policy_delay=1`)",
            "activation=tanh": "with tanh instead of SiLU"}  # fmt: skip
    for setting, name in rows.items():
        cells = []
        for arm in ("four_r", "rprp"):
            run = f"{arm}_sac.{setting}" if setting else f"{arm}_sac"
            found = read_runs([RESULTS / "ablations.csv" / run / "seed0"])[0].evaluation
            missed = round((1 - found["hold_success"]) * found["episodes"])
            there = f"{found['restless']} of {missed}" if missed else "-"
            cells += [f"{100 * found['hold_success']:.1f} %", there]
        assert f"| {name} | {' | '.join(cells)} |" in text


@pytest.mark.parametrize(("name", "runs", "policies"), [("ablations", 10, 10), ("strength/runs", 48, 16)])
def test_a_row_of_a_study_has_the_policy_of_its_lowest_seed(name, runs, policies):
    groups = read_groups([RESULTS / f"{name}.csv"])
    assert sum(len(same.runs) for same in groups) == runs
    first = [same.runs[0] for same in groups if len(same.runs) < 10]  # PPO of full strength has none
    lowest = {RESULTS / name / run.folder.relative_to(RESULTS / f"{name}.csv"): run for run in first}
    assert {path.parent for path in (RESULTS / name).rglob("policy.zip")} == lowest.keys()
    assert len(lowest) == policies
    for folder, run in lowest.items():
        config = {k: v for k, v in read_config(folder).to_dict().items() if k not in WITHOUT_EFFECT}
        assert config == {**run.settings, "seed": run.seed}
        assert read_scene(folder).to_dict() == run.scene


def test_results_stay_small():
    sizes = [path.stat().st_size for path in RESULTS.rglob("*") if path.is_file()]
    assert (len(sizes) <= 150, sum(sizes) <= 6_000_000) == (True, True)
