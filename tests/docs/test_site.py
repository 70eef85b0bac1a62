"""The site: the pages that are written from the code, and a build without warnings."""

import ast
import re
import subprocess
import sys

import numpy as np
import pytest
from markdown import PAGES, ROOT

import redundant_envs as rde
import redundant_envs.control
import redundant_envs.verify
from redundant_envs.scenes.scene import scene_names
from redundant_envs.scenes.tableaus import METHODS

HERE = ROOT / "docs" / "site"


@pytest.mark.long
def test_pages_from_the_code_have_every_scene_and_name_and_their_blocks_run(monkeypatch, capsys):
    for needed in ("imageio", "matplotlib"):
        pytest.importorskip(needed)
    monkeypatch.syspath_prepend(str(HERE))
    import reference

    monkeypatch.setattr(reference, "bill_of_scene", lambda name: "")  # which takes seconds
    pages = reference.pages()
    assert {f"environments/{env_id.partition('/')[2]}.md" for env_id in reference.OWN_IDS} <= pages.keys()
    assert {f"scenes/{name}.md" for name in scene_names()} <= pages.keys()
    assert all(f"\n## {name}\n" in pages["reference/integrators.md"] for name in METHODS)
    api = "".join(text for name, text in pages.items() if name.startswith("reference/api"))
    manual = api + "".join(page.read_text(encoding="utf-8") for page in PAGES)
    trees = [ast.parse(block) for block in re.findall(r"^```python\n(.*?)^```", manual, re.S | re.M)]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    used = {node.id for node in nodes if isinstance(node, ast.Name)}
    used |= {node.attr for node in nodes if isinstance(node, ast.Attribute)}
    used |= {
        node.value for node in nodes if isinstance(node, ast.Constant)
    }  # {"type": "SensorBias"} of a scene
    for name in {*rde.__all__, *rde.effects.__all__, *rde.control.__all__, *rde.verify.__all__} - {"effects"}:
        assert f"| [`{name}`](" in api
        assert name in used, f"no example has {name}"
    figures = [
        path for path in (ROOT / "docs" / "figures").iterdir() if path.suffix in (".png", ".gif", ".svg")
    ]
    assert [path for path in figures if f"(figures/{path.name})" not in pages["gallery.md"]] == []
    for name, text in pages.items():
        for block in re.findall(r"^```python\n(.*?)^```", text, re.S | re.M):
            exec(compile(block, name, "exec"), {"__name__": "__main__"})
    assert capsys.readouterr().out == ""


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "over", "force"),
    [
        ("ViscousFriction", "rate", lambda v: -0.2 * v),
        ("CoulombFriction", "rate", lambda v: -0.6 * np.sign(v)),
        ("LimitSpring", "position", lambda x: -200.0 * (x - np.clip(x, -1.0, 1.0))),
        ("DeadZone", "command", lambda u: u - np.clip(u, -0.3, 0.3)),
        ("TorqueSpeed", "rate", lambda v: 10.0 * np.clip(1.0 - v / 8.0, 0.0, 1.0)),
    ],
)
def test_the_curve_of_an_effect_is_its_law(kind, over, force, monkeypatch):
    monkeypatch.syspath_prepend(str(HERE))
    import effect_pages

    along = np.linspace(-1.7, 1.7, 5)
    law = effect_pages.law(effect_pages.study().entries[kind], over, along)
    assert law == pytest.approx(force(along), abs=1e-6)


@pytest.mark.long
def test_the_site_is_built_without_warnings_and_its_links_lead_somewhere(tmp_path):
    pytest.importorskip("sphinx", reason="Sphinx is not installed, which make docs installs")
    command = [sys.executable, str(HERE / "make.py"), "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    pages = list((tmp_path / "html").rglob("*.html"))
    assert len(pages) > 100
    for page in pages:
        for link in re.findall(r'<[^>]+ (?:href|src)="([^"#?]+)', page.read_text(encoding="utf-8")):
            assert re.match("(https://|mailto:|data:)", link) or (page.parent / link).exists(), link
