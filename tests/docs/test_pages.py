"""Pages: their Python blocks run alone, links lead somewhere, and the citation is that of the package."""

import importlib.util
import re
import tomllib
from pathlib import Path

import gymnasium as gym
import pytest
import yaml
from markdown import EFFECTS, MANUAL, PAGES, README, ROOT, anchors, blocks, prose, text
from words import MAX_WORDS, count_words

import redundant_envs as rde
from redundant_envs.effects import REGISTRY
from redundant_envs.envs.cost import BARE

SLOW = ("torch.optim.Adam", "model.learn(", "config.build_algo(")
"""In blocks that take seconds; beside them shorter ones use the same functions."""
BLOCKS = [
    pytest.param(
        page, line, block, id=f"{page.stem}-{line}",
        marks=pytest.mark.long if any(word in block for word in SLOW) else (),
    )
    for page in MANUAL for line, _, block in blocks(page, "python")
]  # fmt: skip
OTHERS = {name: name for name in ("torch", "torchrl", "stable_baselines3", "sympy", "mujoco")} | {
    "ray": "tree"
}
"""Packages that blocks import, and what must be there for them: Ray alone has not all that RLlib imports."""
BEHIND = {"casadi": "casadi", "RecordVideo": "moviepy", "animate(": "imageio"}
"""Packages that are not imported by a block, but needed by what it calls."""


@pytest.mark.parametrize(("page", "line", "block"), BLOCKS)
def test_block_runs_alone(page, line, block, tmp_path, monkeypatch, capsys):
    for name, needed in OTHERS.items():
        if re.search(rf"^(import|from) {name}\b", block, re.M) and not importlib.util.find_spec(needed):
            pytest.skip(f"{needed} is not installed")
    for call, name in BEHIND.items():
        if call in block:
            pytest.importorskip(name)
    monkeypatch.chdir(tmp_path)
    # Then line numbers of an error are those of the page.
    code = compile("\n" * (line - 1) + block, str(page.relative_to(ROOT)), "exec")
    known = dict(REGISTRY)
    try:
        exec(code, {"__name__": "__main__"})
    finally:  # other tests do not know its effects
        REGISTRY.clear()
        REGISTRY.update(known)
    shown = capsys.readouterr().out.splitlines()
    assert len(shown) <= 30  # an example must not flood the screen
    assert ("print(" in block) == bool(shown)
    assert "None" not in shown  # of a function that gives nothing


@pytest.mark.long
def test_the_scene_file_of_the_page_is_a_scene(tmp_path):
    scenes = []
    for *_, block in blocks(ROOT / "docs" / "scenes.md", "yaml"):
        (tmp_path / "my_scene.yaml").write_text(block, encoding="utf-8")
        scenes.append(rde.load_scene(tmp_path / "my_scene.yaml"))
        names = [type(e).__name__ for e in scenes[-1].effects]
        assert names == ["Gravity", "ViscousFriction", "EffortLimits"]
    assert [len(scene.randomize) for scene in scenes] == [0, 4]
    gym.make("redundant_envs/FourRReach-v0", scene=scenes[1].to_dict())  # a range is of the task


def test_example_scenes_have_their_effects_and_picture():
    sections = dict(
        part.split("\n", 1) for part in text(ROOT / "docs" / "example_scenes.md").split("\n## ")[1:]
    )
    assert len(sections) == 6
    for name, section in sections.items():
        effects = {type(effect) for effect in rde.load_scene(name).effects} - {*BARE}
        assert {*re.findall(r"\[`(\w+)`\]\(effects/\w+\.md\)", section)} == {e.__name__ for e in effects}
        picture = ROOT / "docs" / "figures" / f"scene_{name}.png"
        assert f"(figures/{picture.name})" in section
        assert picture.stat().st_size < 60_000


@pytest.mark.quick("README.md")
@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_links_lead_to_files_and_headings(page):
    for link in re.findall(r"\]\(([^)\s]+)\)", prose(page)) + re.findall(r'src="([^"]+)"', prose(page)):
        if link.startswith(("http:", "https:", "mailto:")):
            continue
        target, _, anchor = link.partition("#")
        file = page.parent / target if target else page
        assert file.exists(), link
        assert not anchor or anchor in anchors(file), f"{link}: {sorted(anchors(file))}"


def test_every_page_of_the_manual_can_be_reached_from_the_readme():
    seen, new = set(), {README}
    while new:
        page = new.pop()
        seen.add(page)
        links = re.findall(r"\]\(([^)#\s]+\.md)", prose(page))
        new |= {(page.parent / link).resolve() for link in links if "://" not in link} - seen
    assert {*MANUAL, *EFFECTS} <= seen


def test_the_readme_and_the_pages_are_short():
    assert len(text(README).split()) <= 1100
    assert sum(count_words().values()) <= MAX_WORDS


NOT_THERE = re.compile(
    r"redundant-envs\\?\[|pip install [^`\n]*\bredundant.envs|(pypi|github)\.\w+/[\w/]*redundant.envs"
)
"""What would lead to a page or a package of this name on an index, or to a repository on a host."""
READ = {".py", ".md", ".toml", ".cff", ".yaml", ".yml", ".txt", ".js", ".html"}


def test_nothing_is_said_to_come_from_a_place_where_it_is_not():
    """No index has the package: what is missing is installed in a clone, with pip install '.[extra]'."""
    assert all(
        NOT_THERE.search(x) for x in ("pip install 'redundant-envs[plot]'", "pip install redundant-envs")
    )
    folders = [
        ROOT / name
        for name in ("redundant_envs", "agents", "studies", "docs", "configs", "policies", "tests")
    ]
    files = [path for folder in folders for path in folder.rglob("*") if path.suffix in READ]
    for path in (*files, *(path for path in ROOT.iterdir() if path.suffix in READ)):
        if path != Path(__file__):
            found = NOT_THERE.search(path.read_text(encoding="utf-8"))
            assert found is None, f"{path.relative_to(ROOT)}: {found[0]}"


def test_the_citation_file_agrees_with_the_package():
    cited = yaml.safe_load(text(ROOT / "CITATION.cff"))
    project = tomllib.loads(text(ROOT / "pyproject.toml"))["project"]
    assert {"authors", "cff-version", "message", "title"} <= set(cited)
    assert (cited["cff-version"], cited["license"]) == ("1.2.0", project["license"])
    assert cited["version"] == rde.__version__
    assert cited["title"].startswith(f"{project['name']}:")
    for author in cited["authors"]:
        assert set(author) <= {"name", "website", "family-names", "given-names", "affiliation", "orcid"}


@pytest.fixture
def remake(tmp_path, monkeypatch):
    """The program that makes the pictures of the README, and its table of results, again."""
    pytest.importorskip("PIL", reason="pictures need the extra 'plot'")
    spec = importlib.util.spec_from_file_location("remake", ROOT / "docs" / "figures" / "remake.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "FIGURES", tmp_path)
    return module


def test_thumbnails_and_results_are_made_again_and_are_small(remake, tmp_path):
    from PIL import Image

    for name, (policy, seed) in list(remake.THUMBNAILS.items())[::2]:
        remake.thumbnail(name, policy, seed)
        with Image.open(tmp_path / f"{name}.png") as made:
            assert made.size == (remake.SIDE, remake.SIDE)
    for path in (ROOT / "docs" / "figures").glob("*reach*"):
        assert path.stat().st_size < (1e6 if path.suffix == ".gif" else 2e4), path.name
    page, lines = tmp_path / "README.md", text(README).splitlines(keepends=True)
    page.write_text("".join(line for line in lines if "| SAC |" not in line), encoding="utf-8")
    remake.results(page)
    assert text(page) == text(README)


@pytest.mark.long
def test_clips_are_made_again(remake, tmp_path):
    remake.clips()
    for name in remake.CLIPS:
        assert 1e5 < (tmp_path / f"{name}.gif").stat().st_size < 1e6
