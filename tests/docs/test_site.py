"""The site: the pages that are written from the code, and a build without warnings."""

import html.parser
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


class Page(html.parser.HTMLParser):
    """Links of a page, and what they may lead to in it."""

    def __init__(self, text):
        super().__init__()
        self.links, self.names = [], {""}
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self.links += [found[name] for name in ("href", "src") if found.get(name)]
        self.names |= {found.get("id"), found.get("name")}


@pytest.mark.long
def test_the_site_is_built_without_warnings_and_its_links_lead_somewhere(tmp_path):
    pytest.importorskip("sphinx", reason="Sphinx is not installed, which make docs installs")
    command = [sys.executable, str(HERE / "make.py"), "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    site = tmp_path / "html"
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    assert len(pages) > 100
    for path, page in pages.items():
        for link in page.links:
            target, _, anchor = link.partition("#")
            if re.match(r"[a-z]+:", target):
                assert target.startswith(("https://", "mailto:", "data:")), link
                continue
            file = (path.parent / target.partition("?")[0]).resolve() if target else path
            assert file.exists(), f"{path}: {link}"
            if anchor and file in pages and file.name != "genindex.html":
                assert anchor in pages[file].names, f"{path}: {link}"
    assert "page/index.html" in pages[site / "index.html"].links
