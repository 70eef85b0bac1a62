"""Pages of effects: all have the same parts, and agree with the code."""

import dataclasses
import re

import pytest
from markdown import ROOT, blocks, text

import redundant_envs as rde
from redundant_envs.effects import OWN as KINDS
from redundant_envs.effects.hooks import snake_case
from redundant_envs.scenes.files import config_folder
from redundant_envs.support.tables import markdown
from studies.effects import load_study

FOLDER = ROOT / "docs" / "effects"
STUDY = load_study(config_folder("studies") / "effects.yaml")
SECTIONS = ("Equation", "Numbers", "Hooks", "Energy", "Cost", "Example")
EVERY = pytest.mark.parametrize("name", KINDS)


def page_of(name):
    return FOLDER / f"{snake_case(name)}.md"


def parts(name):
    """The sentence of a page, and its sections by their headings."""
    head, *sections = re.split(r"^## +", text(page_of(name)), flags=re.M)
    title, sentence = (part.strip() for part in head.strip().split("\n", 1))
    assert title == f"# {name}"
    return sentence, dict(tuple(part.split("\n", 1)) for part in sections)


def cells(section):
    """The rows of the table of a section, without its head."""
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def entries_of(name):
    return [entry for entry in STUDY.entries.values() if type(entry.effect).__name__ == name]


def shown(entry):
    """The effect of an entry as a call, with the numbers of the example."""
    fields = [f for f in dataclasses.fields(entry.effect) if getattr(entry.effect, f.name) != f.default]
    given = [f"{f.name}={getattr(entry.effect, f.name)!r}" for f in fields]
    return f"`{type(entry.effect).__name__}({', '.join(given)})`"


def costs(name):
    """The table of a page's section about costs, which has the ceilings."""
    rows = [(shown(entry), *(f"{most:g}" for _, most in entry.ceilings)) for entry in entries_of(name)]
    return markdown(("slowdown, at most", "one rk8 step", "1e-6 m"), rows, formatted=True)


def test_every_page_is_of_an_effect():
    pages = {path.stem for path in FOLDER.glob("*.md")} - {"README"}
    assert pages == {snake_case(name) for name in KINDS}


@EVERY
def test_a_page_has_one_sentence_and_then_the_same_sections_as_all(name):
    sentence, sections = parts(name)
    assert tuple(sections) == SECTIONS
    assert re.fullmatch(r"[A-Z][^\n]*[^.\n]\.", sentence), sentence
    assert ". " not in sentence
    assert all(section.strip() for section in sections.values())


@EVERY
def test_the_numbers_of_a_page_are_those_of_the_effect_with_their_units(name):
    _, sections = parts(name)
    entry = entries_of(name)[0]
    rows = {re.match(r"`(?:\w+\.)*(\w+)", row[0])[1]: row for row in cells(sections["Numbers"])}
    assert set(rows) == {field.name for field in dataclasses.fields(KINDS[name]) if field.init}
    assert all(len(row) == 3 and row[2] for row in rows.values())
    for number, unit in entry.effect.units(entry.arm.robot).items():
        assert unit in rows[number.partition("[")[0]][1], number


@EVERY
def test_the_hooks_of_a_page_are_those_of_the_effect(name):
    _, sections = parts(name)
    entries = entries_of(name)
    kinds = {type(h).__name__ for e in entries for h in e.effect.at_interval(0.02).hooks(e.arm.robot)}
    known = set(rde.effects.__all__)
    named = {word for word in re.findall(r"`(\w+)[`(]", sections["Hooks"]) if word in known - {*KINDS}}
    assert kinds <= named


@EVERY
def test_the_ceilings_of_a_page_are_those_of_the_examples(name):
    _, sections = parts(name)
    rows = "\n".join(line.replace(" --- ", "---") for line in costs(name).splitlines())
    assert rows in sections["Cost"], (
        f"the section Cost of {page_of(name).name} has another table than\n{rows}"
    )


@pytest.mark.quick("Armature")
@EVERY
def test_the_example_of_a_page_runs_and_has_the_effect(name, capsys):
    (_, _, block), *more = blocks(page_of(name), "python")
    assert not more
    assert name in block
    exec(compile(block, str(page_of(name)), "exec"), {"__name__": "__main__"})
    assert 1 <= len(capsys.readouterr().out.splitlines()) <= 30
