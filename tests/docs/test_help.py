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
    found = re.search(rf"^{name}\n-+\n(.*?)(?=^\w+\n---|\Z)", inspect.getdoc(kind), re.MULTILINE | re.DOTALL)
    assert found, f"{kind.__name__} has no section {name}"
    return found[1]


@pytest.mark.parametrize("kind", [rde.Task, rde.Arm, rde.effects.Effect])
def test_every_attribute_that_a_subclass_may_define_is_shown(kind):
    entries = re.findall(r"^(\w+(?:, \w+)*) : ", section(kind, "Attributes"), re.MULTILINE)
    fields = {f.name for f in dataclasses.fields(kind)}
    assert {*", ".join(entries).split(", ")} == {
        name for name in inspect.get_annotations(kind) if not name.startswith("_") and name not in fields
    }


@pytest.mark.long
@pytest.mark.parametrize("kind", [rde.Task, rde.effects.Effect])
def test_the_example_of_a_class_runs(kind, tmp_path):
    """In a process of its own: what it registers is taken in others by those who import it."""
    program = tmp_path / "example.py"
    program.write_text(textwrap.dedent(section(kind, "Examples").partition("::\n")[2]))
    done = subprocess.run([sys.executable, program], check=True, capture_output=True, text=True)
    assert re.search(r"\d\.\d", done.stdout)
