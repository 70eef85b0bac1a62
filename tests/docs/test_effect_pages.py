"""Pages of effects: their tables have the numbers of the code, and their examples run."""

import dataclasses
import re

import pytest
from markdown import ROOT, blocks, text

from redundant_envs.effects import OWN as KINDS
from redundant_envs.effects.hooks import snake_case
from redundant_envs.scenes.files import config_folder
from studies.effects import load_study

FOLDER = ROOT / "docs" / "effects"
STUDY = load_study(config_folder("studies") / "effects.yaml")
EVERY = pytest.mark.parametrize("name", KINDS)


def page_of(name):
    return FOLDER / f"{snake_case(name)}.md"


def test_every_page_is_of_an_effect():
    pages = {path.stem for path in FOLDER.glob("*.md")} - {"README"}
    assert pages == {snake_case(name) for name in KINDS}


@EVERY
def test_the_numbers_of_a_page_are_those_of_the_effect_with_their_units(name):
    section = text(page_of(name)).partition("\n## Numbers\n")[2].partition("\n## ")[0]
    rows = [line.split("|")[1:3] for line in section.splitlines() if line.startswith("| `")]
    units = {re.match(r" `(?:\w+\.)*(\w+)", number)[1]: unit for number, unit in rows}
    assert set(units) == {field.name for field in dataclasses.fields(KINDS[name]) if field.init}
    entry = STUDY.entries[name]
    for number, unit in entry.effect.units(entry.arm.robot).items():
        assert unit in units[number.partition("[")[0]], number


@pytest.mark.quick("Armature")
@EVERY
def test_the_example_of_a_page_runs_and_has_the_effect(name, capsys):
    ((_, _, block),) = blocks(page_of(name), "python")
    assert name in block
    exec(compile(block, str(page_of(name)), "exec"), {"__name__": "__main__"})
    assert 1 <= len(capsys.readouterr().out.splitlines()) <= 30
