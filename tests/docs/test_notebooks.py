"""Each notebook runs on one core, without a network; one that fails says why."""

import importlib.util
import json
import os

import pytest
from markdown import ROOT, text

pytestmark = pytest.mark.long

FOLDER = ROOT / "docs" / "notebooks"
BLOCKED = """
import socket

def found(host, *args, **kwargs):
    raise OSError(f"no network in this test: {host}")

socket.getaddrinfo = socket.gethostbyname = found
"""


@pytest.fixture(scope="module")
def notebooks():
    """The module that executes notebooks and makes pages of them."""
    for name in ("nbclient", "ipykernel"):
        if not importlib.util.find_spec(name):
            pytest.skip(f"{name} is not installed, which make docs and make test-long install")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "docs" / "site"))
        import notebooks

        yield notebooks


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ("raise KeyError('no such thing')", "KeyError: 'no such thing'"),
        ("import warnings\nwarnings.warn('careful', stacklevel=1)", "it writes to standard error"),
        ("open('left.txt', 'w').close()", "it leaves left.txt behind"),
    ],
)
def test_a_notebook_that_fails_says_why(notebooks, tmp_path, cell, said):
    (tmp_path / "one.md").write_text(f"# One\n\n```{{code-cell}}\n{cell}\n```\n", encoding="utf-8")
    with pytest.raises(RuntimeError, match=r"one\.md fails") as failed:
        notebooks.run(tmp_path / "one.md", tmp_path / "one.ipynb")
    assert said in str(failed.value)
    assert not (tmp_path / "one.ipynb").exists()


@pytest.mark.parametrize("source", sorted(FOLDER.iterdir()), ids=lambda path: path.stem)
def test_a_notebook_runs_without_a_network(notebooks, source, tmp_path):
    """Its compiled programs are not yet kept."""
    for extra in ("torch", "stable_baselines3", "sympy", "matplotlib"):
        pytest.importorskip(extra)
    (tmp_path / "sitecustomize.py").write_text(BLOCKED, encoding="utf-8")
    paths = os.pathsep.join([str(tmp_path), str(ROOT), str(ROOT / "agents")])
    more = {"PYTHONPATH": paths, "REDUNDANT_ENVS_CACHE": str(tmp_path / "kernels")}
    notebooks.run(source, tmp_path / "made.ipynb", more)
    made = json.loads(text(tmp_path / "made.ipynb"))
    assert all(cell["outputs"] for cell in made["cells"] if cell["cell_type"] == "code")
