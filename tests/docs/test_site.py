"""The site: the pages that are written from the code, and a build without warnings."""

import re
import shutil
import subprocess
import sys

import pytest
from markdown import ROOT

import redundant_envs as rde
from redundant_envs.scenes.scene import scene_names
from redundant_envs.scenes.tableaus import METHODS

HERE = ROOT / "docs" / "site"


@pytest.fixture(scope="module")
def reference():
    """The module that writes pages from the code."""
    for needed in ("imageio", "matplotlib"):
        pytest.importorskip(needed)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(HERE))
        import reference

        yield reference


def test_the_index_of_effects_has_the_sentence_of_each_page_and_those_that_no_group_links(
    reference, tmp_path
):
    shutil.copytree(ROOT / "docs" / "effects", tmp_path, dirs_exist_ok=True)
    (tmp_path / "wind.md").write_text("# Wind\n\nAir that moves.\n\n## Equation\n", encoding="utf-8")
    index = reference.index_of_effects(tmp_path)
    for page in {*tmp_path.glob("*.md")} - {tmp_path / "README.md"}:
        title, sentence = page.read_text(encoding="utf-8").split("\n\n")[:2]
        assert index.count(f"\n| [`{title[2:]}`]({page.name}) | {sentence} |\n") == 1
    *_, others, _ = index.split("\n## ")
    assert others.startswith("Others\n")
    assert "](wind.md)" in others


def test_pages_from_the_code_have_every_scene_method_and_public_name_and_their_blocks_run(
    reference, monkeypatch, capsys
):
    monkeypatch.setattr(reference, "bill_of_scene", lambda name: "")  # which takes seconds
    pages = reference.pages()
    assert {f"environments/{env_id.partition('/')[2]}.md" for env_id in reference.OWN_IDS} <= pages.keys()
    assert {f"scenes/{name}.md" for name in scene_names()} <= pages.keys()
    assert all(f"\n## {name}\n" in pages["reference/integrators.md"] for name in METHODS)
    api = pages["reference/api.md"]
    assert all(f"redundant_envs.{name}\n" in api for name in rde.__all__ if name != "effects")
    assert all(f"redundant_envs.effects.{name}\n" in api for name in rde.effects.__all__)
    for name, text in pages.items():
        for block in re.findall(r"^```python\n(.*?)^```", text, re.S | re.M):
            exec(compile(block, name, "exec"), {"__name__": "__main__"})
    assert capsys.readouterr().out == ""


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
