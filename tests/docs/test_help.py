"""What ``help`` shows of a base class: each attribute that a user may define, and an example that runs."""

import dataclasses
import inspect
import re
import subprocess
import sys
import textwrap

import pytest

import redundant_envs as rde


def section(kind, name):
    text = inspect.getdoc(kind)
    found = re.search(rf"^{name}\n-+\n(.*?)(?=^\w+\n---|\Z)", text, re.MULTILINE | re.DOTALL)
    assert found, f"{kind.__name__} has no section {name}"
    return found[1]


@pytest.mark.parametrize("kind", [rde.Task, rde.Arm, rde.effects.Effect])
def test_every_attribute_that_a_subclass_may_define_is_shown_once_with_its_default(kind):
    entries = re.findall(r"^(\w+(?:, \w+)*) : (.*)\n    \S", section(kind, "Attributes"), re.MULTILINE)
    shown = {name: text for names, text in entries for name in names.split(", ")}
    fields = {f.name for f in dataclasses.fields(kind)}
    assert set(shown) == {n for n in inspect.get_annotations(kind) if not n.startswith("_")} - fields
    source = inspect.getsource(kind)
    assert not re.search(r'ClassVar[^\n]*\n    """', source), "help() does not show a text below an attribute"
    for name, text in shown.items():
        if found := re.search(r'default (\(\)|\{\}|-?\d+|True|False|".*")$', text):
            assert str(getattr(kind, name)) == found[1].strip('"')


@pytest.mark.long
@pytest.mark.parametrize("kind", [rde.Task, rde.effects.Effect])
def test_the_example_of_a_class_runs(kind, tmp_path):
    """In a process of its own: what it registers is taken in others by those who import it."""
    program = tmp_path / "example.py"
    program.write_text(textwrap.dedent(section(kind, "Examples").partition("::\n")[2]))
    done = subprocess.run([sys.executable, program], check=True, capture_output=True, text=True)
    assert re.search(r"\d\.\d", done.stdout)


def test_every_field_of_a_hook_and_every_method_of_a_task_is_explained():
    for name in ("Force", "Field", "Actuation", "Impact", "State", "Sensing"):
        kind = getattr(rde.effects, name)
        text = inspect.getdoc(kind)
        assert [f.name for f in dataclasses.fields(kind) if not re.search(rf"\b{f.name}\b", text)] == []
    methods = {n: m for n, m in vars(rde.Task).items() if not n.startswith("_") and callable(m)}
    assert methods
    assert [name for name, method in methods.items() if not inspect.getdoc(method)] == []
