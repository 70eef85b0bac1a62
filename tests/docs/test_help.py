"""What ``help`` shows of a base class: each attribute that a user may define, and an example that runs."""

import dataclasses
import inspect
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import redundant_envs as rde

ROOT = Path(__file__).parents[2]
BASES = (rde.Task, rde.Arm, rde.effects.Effect)


def section(kind, name):
    text = inspect.getdoc(kind)
    found = re.search(rf"^{name}\n-+\n(.*?)(?=^\w+\n---|\Z)", text, re.MULTILINE | re.DOTALL)
    assert found, f"{kind.__name__} has no section {name}"
    return found.group(1)


def entries(text):
    """Names -> the type and default, of a section in the style of numpydoc."""
    found = {}
    for names, kind in re.findall(r"^(\w+(?:, \w+)*) : (.*)\n    \S", text, re.MULTILINE):
        found |= dict.fromkeys(names.split(", "), kind)
    return found


def attributes(kind):
    fields = {f.name for f in dataclasses.fields(kind)}
    return {name for name in inspect.get_annotations(kind) if not name.startswith("_")} - fields


@pytest.mark.parametrize("kind", BASES)
def test_every_attribute_that_a_subclass_may_define_is_shown_once(kind):
    shown = entries(section(kind, "Attributes"))
    assert set(shown) == attributes(kind)
    source = inspect.getsource(kind)
    assert not re.search(r'ClassVar[^\n]*\n    """', source), "help() does not show a text below an attribute"


@pytest.mark.parametrize("kind", BASES)
def test_defaults_are_those_of_the_class(kind):
    for name, text in entries(section(kind, "Attributes")).items():
        found = re.search(r'default (\(\)|\{\}|-?\d+|True|False|".*")$', text)
        if found:
            assert str(getattr(kind, name)) == found.group(1).strip('"')


@pytest.mark.parametrize("kind", [rde.Task, rde.effects.Effect])
def test_the_example_of_a_class_runs(kind):
    code = textwrap.dedent(section(kind, "Examples").partition("::\n")[2])
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(r"\d\.\d", done.stdout)


@pytest.mark.parametrize(
    "kind",
    [getattr(rde.effects, name) for name in ("Force", "Field", "Actuation", "Impact", "State", "Sensing")],
)
def test_every_field_of_a_hook_is_named_in_its_docstring(kind):
    text = inspect.getdoc(kind)
    assert [f.name for f in dataclasses.fields(kind) if not re.search(rf"\b{f.name}\b", text)] == []


def test_methods_that_a_task_may_write_have_docstrings():
    for name, method in vars(rde.Task).items():
        if not name.startswith("_") and callable(method) and name in dir(rde.Task):
            assert inspect.getdoc(method), name
