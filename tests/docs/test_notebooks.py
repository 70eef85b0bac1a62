"""Notebooks: short sources without outputs; each runs on one core, without network, in at most a minute."""

import ast
import importlib.util
import json
import os
import re
import time

import pytest
import yaml
from markdown import ROOT, text

FOLDER = ROOT / "docs" / "notebooks"
NAMES = ["accuracy_and_chaos", "equations_to_environment", "learn_and_race", "redundancy"]
LONGEST_LINE, MAX_LINES = 88, 40
BLOCKED = """
import socket
connected = socket.socket.connect

def connect(self, address):
    if self.family in (socket.AF_INET, socket.AF_INET6) and address[0] not in ("127.0.0.1", "::1"):
        raise OSError(f"no network in this test: {address}")
    return connected(self, address)

def found(host, *args, **kwargs):
    raise OSError(f"no network in this test: {host}")

socket.socket.connect, socket.getaddrinfo, socket.gethostbyname = connect, found, found
"""


@pytest.fixture(scope="module")
def notebooks():
    """The module that executes notebooks and makes pages of them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "docs" / "site"))
        import notebooks

        yield notebooks


def code(notebooks, name):
    return [part for kind, part in notebooks.cells(text(FOLDER / f"{name}.md")) if kind == "code"]


def test_the_folder_has_sources_alone():
    assert sorted(path.name for path in FOLDER.iterdir()) == [f"{name}.md" for name in NAMES]


@pytest.mark.parametrize("name", NAMES)
def test_a_source_is_a_notebook_of_short_cells(notebooks, name):
    source = text(FOLDER / f"{name}.md")
    _, front, rest = source.split("---\n", 2)
    assert yaml.safe_load(front) == notebooks.KERNEL
    assert rest.startswith("\n# ")
    found = code(notebooks, name)
    assert rest.count("```") == 2 * len(found)
    for cell in found:
        lines = cell.splitlines()
        assert len(lines) <= MAX_LINES
        assert max(map(len, lines)) <= LONGEST_LINE
        last = ast.parse(cell).body[-1]  # every cell shows something
        assert isinstance(last, ast.Expr) or "print(" in ast.unparse(last)


def test_the_first_one_has_ten_cells(notebooks):
    assert len(code(notebooks, "equations_to_environment")) == 10


@pytest.mark.parametrize("name", NAMES)
def test_names_from_the_package_are_public_or_on_a_page(notebooks, name):
    import redundant_envs as rde

    public = {*rde.__all__, "make_sb3", "torch_step"}
    pages = "".join(text(page) for page in (ROOT / "docs").glob("*.md"))
    for cell in code(notebooks, name):
        for node in ast.walk(ast.parse(cell)):
            if (
                isinstance(node, ast.Attribute)
                and isinstance(node.value, ast.Name)
                and node.value.id == "rde"
            ):
                assert node.attr in public
            if isinstance(node, ast.ImportFrom) and node.module.startswith("redundant_envs."):
                assert f"from {node.module} import {node.names[0].name}" in pages


def executed(*outputs):
    cell = {"cell_type": "code", "source": ["x = 1"], "outputs": list(outputs)}
    return {"cells": [{"cell_type": "markdown", "source": "# Title\n\nText."}, cell]}


def test_a_page_shows_outputs_and_its_download(notebooks, tmp_path):
    forms = {"image/png": "iVBORw0KGgo=", "text/plain": "<Figure>"}
    made = notebooks.page(
        executed(
            {"output_type": "stream", "name": "stdout", "text": ["one\n", "two\n"]},
            {"output_type": "execute_result", "data": {"text/html": ["<b>", "3</b>"], "text/plain": "3"}},
            {"output_type": "display_data", "data": forms},
            {"output_type": "display_data", "data": {"image/png": "AAAA"}},
            {"output_type": "execute_result", "data": {"text/plain": "4"}},
        ),
        tmp_path / "place.md",
    )
    assert made.startswith('# Title\n\n<p><a href="place.ipynb" download>')
    picture, other = sorted(tmp_path.iterdir())
    for part in (
        "Text.", "```python\nx = 1\n```", "```text\none\ntwo\n```", "```{raw} html\n<b>3</b>\n```",
        f"]({picture.name})", f"]({other.name})", "```text\n4\n```",
    ):  # fmt: skip
        assert part in made
    assert picture.read_bytes() == b"\x89PNG\r\n\x1a\n"


def test_an_executed_notebook_is_kept_until_its_source_or_the_package_changes(
    notebooks, tmp_path, monkeypatch
):
    root, source = tmp_path / "root", tmp_path / "one.md"
    for name in ("redundant_envs/a.py", "agents/b.py", "configs/c.yaml", "redundant_envs/__pycache__/a.pyc"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("0", encoding="utf-8")
    source.write_text("# One\n", encoding="utf-8")
    runs = []
    monkeypatch.setattr(notebooks, "ROOT", root)
    monkeypatch.setattr(notebooks, "run", lambda source, target: runs.append(target.write_text("{}")))

    def changed(path, to):
        (root / path).write_text(to, encoding="utf-8")
        before = len(runs)
        found = notebooks.kept(source, tmp_path / "cache")
        assert [*(tmp_path / "cache").iterdir()] == [found]
        return len(runs) > before

    assert changed("redundant_envs/__pycache__/a.pyc", "0")  # for the first time
    assert not changed("redundant_envs/__pycache__/a.pyc", "1")
    assert changed("redundant_envs/a.py", "1")
    assert changed("agents/b.py", "1")
    assert changed("configs/c.yaml", "1")
    assert changed(source, "# Two\n")
    assert not changed(source, "# Two\n")
    monkeypatch.setattr(notebooks.importlib.metadata, "version", lambda name: "another one")
    assert changed(source, "# Two\n")


def test_a_download_has_no_links_that_lead_nowhere(notebooks, tmp_path, monkeypatch):
    class Pool:
        map = map

    place = tmp_path / "notebooks" / "one.md"
    place.parent.mkdir()
    place.write_text("", encoding="utf-8")
    cell = {"cell_type": "markdown", "source": "# One\n\n[a](../b.md), [c](https://c.org)"}
    (tmp_path / "kept").write_text(json.dumps({"cells": [cell]}), encoding="utf-8")
    monkeypatch.setattr(notebooks, "kept", lambda source, cache: tmp_path / "kept")
    notebooks.written(tmp_path, tmp_path, Pool)
    copy = json.loads(text(tmp_path / "_extra" / "notebooks" / "one.ipynb"))
    assert copy["cells"][0]["source"] == "# One\n\na, [c](https://c.org)"
    assert "[a](../b.md)" in text(place)


@pytest.mark.parametrize("name", NAMES)
def test_every_formula_has_an_outline_in_the_colour_of_the_text(notebooks, name):
    pytest.importorskip("matplotlib")
    from formulas import outline

    prose = [part for kind, part in notebooks.cells(text(FOLDER / f"{name}.md")) if kind == "markdown"]
    for formula in re.findall(r"\$([^$]+)\$", "\n".join(prose)):
        made = outline(formula.replace("\n", " "))
        assert 'fill="currentColor"' in made
        assert len(made) < 30_000
        width, height = (float(x) for x in re.search(r"width:([\d.]+)em;height:([\d.]+)em", made).groups())
        assert 0.3 < width < 40.0
        assert 0.3 < height < 4.0


def needs_kernel():
    for name in ("nbclient", "ipykernel"):
        if not importlib.util.find_spec(name):
            pytest.skip(f"{name} is not installed, which make docs and make test-long install")


@pytest.mark.long
@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ("raise KeyError('no such thing')", "KeyError: 'no such thing'"),
        ("import warnings\nwarnings.warn('careful', stacklevel=1)", "it writes to standard error"),
        ("open('left.txt', 'w').close()", "it leaves left.txt behind"),
    ],
)
def test_a_notebook_that_fails_says_why(notebooks, tmp_path, cell, said):
    needs_kernel()
    (tmp_path / "one.md").write_text(f"# One\n\n```{{code-cell}}\n{cell}\n```\n", encoding="utf-8")
    with pytest.raises(RuntimeError, match=r"one\.md fails") as failed:
        notebooks.run(tmp_path / "one.md", tmp_path / "one.ipynb")
    assert said in str(failed.value)
    assert not (tmp_path / "one.ipynb").exists()


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_runs_without_a_network(notebooks, name, tmp_path):
    """Its compiled programs are not yet kept. It tells its seconds of one core."""
    needs_kernel()
    resource = pytest.importorskip("resource", reason="Windows does not count the seconds of other processes")
    for extra in ("torch", "stable_baselines3", "sympy", "matplotlib"):
        pytest.importorskip(extra)
    (tmp_path / "sitecustomize.py").write_text(BLOCKED, encoding="utf-8")
    paths = os.pathsep.join([str(tmp_path), str(ROOT), str(ROOT / "agents")])
    more = {"PYTHONPATH": paths, "REDUNDANT_ENVS_CACHE": str(tmp_path / "kernels")}
    cores = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()
    if cores:
        os.sched_setaffinity(0, {sorted(cores)[os.getpid() % len(cores)]})
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    try:
        notebooks.run(FOLDER / f"{name}.md", tmp_path / "made.ipynb", more)
    finally:
        if cores:
            os.sched_setaffinity(0, cores)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
    print(f"{name}: {seconds:.0f} s of one core, {time.perf_counter() - start:.0f} s in all")
    made = json.loads(text(tmp_path / "made.ipynb"))
    assert all(cell["outputs"] for cell in made["cells"] if cell["cell_type"] == "code")
