"""The README: its links lead somewhere, its programs run."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=[p.name for p in PAGES])
def test_links_lead_to_files(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target


def test_programs_run(capsys):
    namespace = {}
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.S)
    assert len(blocks) == 3
    for block in blocks:
        exec(compile(block, "README.md", "exec"), namespace)
    assert "def four_r__forward_dynamics" in capsys.readouterr().out


@pytest.mark.parametrize("page", ["README.md", "docs/accuracy.md"])
def test_what_an_error_costs_is_what_the_study_wrote(page):
    written = (ROOT / "docs" / "results" / "accuracy" / "accuracy.md").read_text(encoding="utf-8")
    lines = (ROOT / page).read_text(encoding="utf-8").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("| arm | 99 %"))
    rows = lines[start : lines.index("", start)]
    assert len(rows) >= 10
    for row in rows:
        assert row in written


@pytest.mark.parametrize(
    ("page", "folder"),
    [
        ("README.md", "runs"), ("docs/learners.md", "runs"), ("docs/learners.md", "baselines"),
        ("docs/strength.md", "weak"),
    ],
)  # fmt: skip
def test_the_table_of_learners_is_made_from_the_shipped_runs(page, folder):
    from agents.evidence.table import table

    runs = sorted((ROOT / "docs" / "results" / folder).glob("*/*"))
    rows = [line for line in table(runs).splitlines() if line.startswith("| ")]
    assert len(rows) >= 8
    text = (ROOT / page).read_text(encoding="utf-8")
    for row in rows:
        assert row in text


def test_the_table_of_strengths_is_what_the_study_wrote():
    from agents.studies.strength import read_rows
    from agents.studies.strength_run import table

    rows = read_rows(ROOT / "docs" / "results" / "strength" / "strength.csv")
    assert {(row.arm, row.factor) for row in rows} >= {
        (a, f) for a in ("4R", "RPRP") for f in (1.0, 0.5, 0.3)
    }
    assert table(rows) in (ROOT / "docs" / "strength.md").read_text(encoding="utf-8")


def test_shipped_runs_are_complete():
    results = ROOT / "docs" / "results"
    folders = [run for kind in ("runs", "baselines", "weak") for run in (results / kind).glob("*/*")]
    assert len(folders) > 60
    for folder in folders:
        found = {path.name for path in folder.iterdir()}
        assert found == {
            "config.yaml", "scene.yaml", "selection.csv", "policy.zip", "training.json", "evaluation.json",
        }, folder  # fmt: skip
