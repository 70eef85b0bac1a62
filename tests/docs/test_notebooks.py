"""Each notebook runs."""

import json
import os

import pytest
from markdown import ROOT, text

pytestmark = pytest.mark.long

FOLDER = ROOT / "docs" / "notebooks"


@pytest.mark.parametrize("source", sorted(FOLDER.iterdir()), ids=lambda path: path.stem)
def test_a_notebook_runs_and_each_cell_shows_something(source, tmp_path, monkeypatch):
    """Its compiled programs are not yet kept. A cell that writes to standard error or leaves a file fails."""
    for extra in ("nbclient", "ipykernel", "torch", "stable_baselines3", "sympy", "matplotlib"):
        pytest.importorskip(extra)
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    import notebooks

    paths = os.pathsep.join([str(ROOT), str(ROOT / "agents")])
    more = {"PYTHONPATH": paths, "REDUNDANT_ENVS_CACHE": str(tmp_path / "kernels")}
    notebooks.run(source, tmp_path / "made.ipynb", more)
    made = json.loads(text(tmp_path / "made.ipynb"))
    assert all(cell["outputs"] for cell in made["cells"] if cell["cell_type"] == "code")
