"""Notebooks run; tutorials are followed literally in an empty folder, and fail where a reader would fail.

A block whose first line is a comment with nothing but a file name (``# third_arm.py``) is saved under that
name. Of the others, ``python`` blocks run as scripts, ``console`` blocks as the commands behind ``$ `` (the
other lines show output), and ``shell`` blocks as a whole; ``text`` blocks are only read.
"""

import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from markdown import ROOT, blocks, text

pytestmark = pytest.mark.long

DOCS = ROOT / "docs"
PATHS = os.pathsep.join((str(ROOT), str(ROOT / "agents")))
BASH = ["bash", "-e", "-o", "pipefail", "-c"]


def run_tutorial(page: Path, folder: Path) -> list[str]:
    """Follow a page; return what each block printed, errors included. A block that nothing runs, or that ends
    with a status other than 0, is a failure."""
    outputs = []
    found = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    environment = {**os.environ, "PATH": found, "PYTHONPATH": PATHS, "MPLBACKEND": "Agg"}
    for line, language, block in blocks(page):
        if language in ("", "text"):
            continue
        if saved := re.match(r"# ([\w./-]+\.\w+)\n", block):
            (folder / saved[1]).parent.mkdir(parents=True, exist_ok=True)
            (folder / saved[1]).write_text(block, encoding="utf-8")
            continue
        commands = "\n".join(line[2:] for line in block.splitlines() if line.startswith("$ "))
        command = {
            "python": [sys.executable, "-c", block],
            "console": [*BASH, commands or "exit 1"],
            "shell": [*BASH, block],
        }[language]
        done = subprocess.run(
            command, cwd=folder, env=environment, text=True, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        assert done.returncode == 0, f"{page.name}, line {line}: {language}\n{block}\n{done.stdout}"
        outputs.append(done.stdout)
    return outputs


@pytest.mark.parametrize(("page", "result"), [("third_arm.md", "hold"), ("moving_target.md", "touch")])
def test_a_tutorial_is_followed_to_its_trained_policy(page, result, tmp_path):
    """Some 25 and 110 s on two cores that other work shared."""
    outputs = run_tutorial(DOCS / "tutorials" / page, tmp_path)
    assert any("0 missed" in output for output in outputs)  # by verify
    assert f'"{result}_success"' in outputs[-1]
    assert (tmp_path / "run" / "policy.zip").exists()


def test_the_tutorial_of_an_obstacle_is_followed_to_its_check(tmp_path):
    outputs = run_tutorial(DOCS / "tutorials" / "obstacle.md", tmp_path)
    assert "0 missed" in outputs[-1]
    assert (tmp_path / "behind.gif").exists()


@pytest.mark.parametrize("source", sorted((DOCS / "notebooks").iterdir()), ids=lambda path: path.stem)
def test_a_notebook_runs_and_each_cell_shows_something(source, tmp_path, monkeypatch):
    """Its compiled programs are not yet kept. A cell that writes to standard error or leaves a file fails."""
    for extra in ("nbclient", "ipykernel", "torch", "stable_baselines3", "sympy", "matplotlib"):
        pytest.importorskip(extra)
    monkeypatch.syspath_prepend(str(DOCS / "site"))
    import notebooks

    more = {"PYTHONPATH": PATHS, "REDUNDANT_ENVS_CACHE": str(tmp_path / "kernels")}
    notebooks.run(source, tmp_path / "made.ipynb", more)
    made = json.loads(text(tmp_path / "made.ipynb"))
    assert all(cell["outputs"] for cell in made["cells"] if cell["cell_type"] == "code")


def test_curves_of_notebooks_have_the_colours_of_the_figures(tmp_path, monkeypatch):
    for extra in ("nbclient", "ipykernel", "matplotlib"):
        pytest.importorskip(extra)
    monkeypatch.syspath_prepend(str(DOCS / "site"))
    import notebooks

    code = 'import matplotlib\nmatplotlib.rcParams["axes.prop_cycle"].by_key()["color"]'
    (tmp_path / "made.md").write_text(f"```{{code-cell}}\n{code}\n```\n")
    notebooks.run(tmp_path / "made.md", tmp_path / "made.ipynb")
    (cell,) = json.loads(text(tmp_path / "made.ipynb"))["cells"]
    shown = ast.literal_eval("".join(cell["outputs"][0]["data"]["text/plain"]))
    assert shown == [*notebooks.COLOURS_OF_CURVES]
