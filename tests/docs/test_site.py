"""The site: its sources, the pages that are written from the code, and a build without warnings."""

import html.parser
import re
import shutil
import subprocess
import sys
import time

import pytest
from markdown import ROOT

HERE = ROOT / "docs" / "site"


@pytest.fixture(scope="module")
def parts():
    """The modules of the site."""
    for needed in ("imageio", "matplotlib"):
        pytest.importorskip(needed)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(HERE))
        import contents
        import reference
        import sources

        yield sources, reference, contents


@pytest.fixture(scope="module")
def pages(parts):
    """Texts of the pages that are written from the code, but for their bills."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts[1], "bill_of_scene", lambda name: "")
        return parts[1].pages()


def test_links_out_of_the_manual_lead_to_copies_of_the_source_tree(parts, tmp_path):
    parts[0].copied(tmp_path)
    for page in tmp_path.rglob("*.md"):
        prose = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)
        for link in re.findall(r"\]\(([^)\s]+)\)", prose) + re.findall(r'(?:src|href)="([^"]+)"', prose):
            path = link.partition("#")[0]
            if path and not re.match(r"[a-z]+:", path):
                assert (page.parent / path).exists(), f"{page}: {link}"
    assert "mermaid" not in (tmp_path / "how_it_works.md").read_text(encoding="utf-8")
    assert (tmp_path / "source" / "tests" / "outside" / "three_r.py").is_file()


def test_the_index_of_effects_has_the_sentence_of_each_page_and_those_that_no_group_links(parts, tmp_path):
    shutil.copytree(ROOT / "docs" / "effects", tmp_path, dirs_exist_ok=True)
    (tmp_path / "wind.md").write_text("# Wind\n\nAir that moves.\n\n## Equation\n", encoding="utf-8")
    index = parts[1].index_of_effects(tmp_path)
    for page in {*tmp_path.glob("*.md")} - {tmp_path / "README.md"}:
        title, sentence = page.read_text(encoding="utf-8").split("\n\n")[:2]
        assert index.count(f"\n| [`{title[2:]}`]({page.name}) | {sentence} |\n") == 1
    *_, others, costs = index.split("\n## ")
    assert others.startswith("Others\n")
    assert "](wind.md)" in others
    assert costs.startswith("What they cost\n")


def test_every_block_of_the_new_pages_runs(pages, capsys):
    count = 0
    for name, text in pages.items():
        for block in re.findall(r"^```python\n(.*?)^```", text, re.S | re.M):
            exec(compile(block, name, "exec"), {"__name__": "__main__"})
            count += 1
    assert count >= 4 + 14
    assert capsys.readouterr().out == ""


@pytest.mark.long
def test_every_id_scene_and_method_has_its_page_or_line(pages, parts):
    import redundant_envs as rde
    from redundant_envs.scenes.scene import scene_names
    from redundant_envs.scenes.tableaus import METHODS

    own, api = parts[1].OWN_IDS, pages["reference/api.md"]
    program = "import redundant_envs.envs.registration as r; print(*r.ids())"  # this process has more
    told = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert own == told.stdout.split()
    assert {f"environments/{env_id.partition('/')[2]}.md" for env_id in own} <= pages.keys()
    assert {f"scenes/{name}.md" for name in scene_names()} <= pages.keys()
    methods = pages["reference/integrators.md"]
    assert all(f"\n## {name}\n" in methods for name in METHODS)
    assert "| 4 | 4 | no |" in methods
    assert methods.count("| 8 | 12 | yes |") == 2
    assert all(f"redundant_envs.{name}\n" in api for name in rde.__all__ if name != "effects")
    assert all(f"redundant_envs.effects.{name}\n" in api for name in rde.effects.__all__)
    for env_id in own:
        text = pages[f"environments/{env_id.partition('/')[2]}.md"]
        places = [
            text.index(f"\n## {part}\n")
            for part in ("Description", "Action Space", "Observation Space", "Rewards")
        ]
        assert places == sorted(places)
        assert "| Import |" in text
        assert "| Action space |" in text


def test_every_figure_is_in_the_gallery_once(pages):
    shown = re.findall(r"\]\(([^)]+)\)", pages["gallery.md"])
    figures = [p for p in (ROOT / "docs").rglob("*") if p.suffix in (".png", ".gif") or p.name == "arms.svg"]
    assert sorted(shown) == sorted(p.relative_to(ROOT / "docs").as_posix() for p in figures)


def test_every_page_has_its_place_in_the_contents(parts):
    listed = [page for pages in (*parts[2].SECTIONS.values(), parts[2].BELOW.values()) for page in pages]
    for path in (ROOT / "docs").rglob("*.md"):
        name = path.relative_to(ROOT / "docs").with_suffix("").as_posix()
        assert name in listed or f"{name.rpartition('/')[0]}/*" in listed, name


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
def test_the_site_is_built_without_warnings_and_its_links_lead_somewhere(parts, tmp_path):
    pytest.importorskip("sphinx", reason="Sphinx is not installed, which make docs installs")
    start = time.perf_counter()
    command = [sys.executable, str(HERE / "make.py"), "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    print(f"{time.perf_counter() - start:.0f} s")
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
    assert (site / "page" / "data.js").is_file()
    assert "page/index.html" in pages[site / "index.html"].links
