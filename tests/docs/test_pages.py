"""Pages: their Python blocks run alone, links lead somewhere, pictures and tables are made again.

Pages of effects have the numbers of the code, and their examples run.
"""

import dataclasses
import importlib.util
import re
import runpy
import tomllib
import unittest.mock

import gymnasium as gym
import pytest
import yaml
from markdown import MANUAL, PAGES, README, ROOT, anchors, blocks, prose, text
from words import MAX_WORDS, count_words

import redundant_envs as rde
from redundant_envs.effects import OWN, REGISTRY
from redundant_envs.effects.hooks import snake_case
from redundant_envs.scenes import config_folder
from studies.effects import load_study

SLOW = ("torch.optim.Adam", "model.learn(", "config.build_algo(")
"""In blocks that take seconds; beside them shorter ones use the same functions."""
BLOCKS = [
    pytest.param(
        page, line, block, id=f"{page.stem}-{line}",
        marks=pytest.mark.long if any(word in block for word in SLOW) else (),
    )
    for page in MANUAL for line, _, block in blocks(page, "python")
]  # fmt: skip
OTHERS = {n: n for n in ("torch", "torchrl", "skrl", "jax", "stable_baselines3", "sympy", "mujoco")}
OTHERS["ray"] = "tree"
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
    with unittest.mock.patch.dict(REGISTRY):  # other tests do not know its effects
        exec(code, {"__name__": "__main__"})
    shown = capsys.readouterr().out.splitlines()
    assert len(shown) <= 30  # an example must not flood the screen
    assert ("print(" in block) == bool(shown)
    assert "None" not in shown  # of a function that gives nothing


@pytest.mark.long
def test_the_scene_files_of_the_page_are_scenes(tmp_path):
    for *_, block in blocks(ROOT / "docs" / "scenes.md", "yaml"):
        (tmp_path / "my_scene.yaml").write_text(block, encoding="utf-8")
        gym.make("redundant_envs/FourRReach-v0", scene=str(tmp_path / "my_scene.yaml"))


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


def test_the_path_of_one_number_has_functions_of_the_package():
    way = text(ROOT / "docs" / "how_it_works.md").partition("## The path of one number")[2].split("```")[1]
    listed = re.findall(r"(\S+\.py): (\S+)", way)
    assert listed
    for file, function in listed:
        value = importlib.import_module(f"redundant_envs.{file.removesuffix('.py').replace('/', '.')}")
        for name in function.split("."):
            value = getattr(value, name)


def test_the_readme_and_the_pages_are_short():
    assert len(text(README).split()) <= 1100
    assert sum(count_words().values()) <= MAX_WORDS


def test_the_citation_has_the_version_and_the_licence_of_the_package():
    cited = yaml.safe_load(text(ROOT / "CITATION.cff"))
    project = tomllib.loads(text(ROOT / "pyproject.toml"))["project"]
    assert (cited["version"], cited["license"]) == (rde.__version__, project["license"])


def test_the_results_of_the_readme_and_thumbnails_are_made_again(tmp_path):
    pytest.importorskip("PIL", reason="pictures need the extra 'plot'")
    remake = runpy.run_path(str(ROOT / "docs" / "figures" / "remake.py"))
    remake["thumbnail"].__globals__["FIGURES"] = tmp_path
    name, parts = next(iter(remake["THUMBNAILS"].items()))
    remake["thumbnail"](name, parts)
    assert (tmp_path / f"{name}.png").stat().st_size < 2e4
    page, lines = tmp_path / "README.md", text(README).splitlines(keepends=True)
    page.write_text("".join(line for line in lines if "| SAC |" not in line), encoding="utf-8")
    remake["results"](page)
    assert text(page) == text(README), "run python docs/figures/remake.py"


# ---- pages of effects ----------------------------------------------------------------------------------

EFFECT_PAGES = ROOT / "docs" / "effects"
STUDY = load_study(config_folder("studies") / "effects.yaml")
EVERY = pytest.mark.parametrize("name", OWN)


def page_of(name):
    return EFFECT_PAGES / f"{snake_case(name)}.md"


def test_every_page_is_of_an_effect():
    pages = {path.stem for path in EFFECT_PAGES.glob("*.md")} - {"README"}
    assert pages == {snake_case(name) for name in OWN}


@EVERY
def test_a_class_describes_every_number_of_its_effect_with_its_units(name, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    from described import described

    words, entry = described(OWN[name]), STUDY.entries[name]
    assert {field.name for field in dataclasses.fields(OWN[name]) if field.init} <= words.keys()
    for number, unit in entry.effect.units(entry.arm.robot).items():
        for one in unit.split(" or ") if unit != "1" else ():
            assert re.search(rf"(^|\W){re.escape(one)}(\W|$)", words[number.partition("[")[0]]), number


@pytest.mark.quick("Armature")
@EVERY
def test_the_example_of_a_page_runs_and_has_the_effect(name, capsys):
    ((_, _, block),) = blocks(page_of(name), "python")
    assert name in block
    exec(compile(block, str(page_of(name)), "exec"), {"__name__": "__main__"})
    assert 1 <= len(capsys.readouterr().out.splitlines()) <= 30
