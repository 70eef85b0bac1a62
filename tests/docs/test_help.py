"""The example that ``help`` shows of a base class runs."""

import inspect
import re
import subprocess
import sys
import textwrap

import pytest

import redundant_envs as rde


@pytest.mark.long
@pytest.mark.parametrize("kind", [rde.Task, rde.effects.Effect])
def test_the_example_of_a_class_runs(kind, tmp_path):
    """In a process of its own: what it registers is taken in others by those who import it."""
    example = re.search(r"^Examples\n-+\n.*?::\n(.*?)(?=^\w+\n---|\Z)", inspect.getdoc(kind), re.M | re.S)
    (tmp_path / "example.py").write_text(textwrap.dedent(example[1]))
    command = [sys.executable, tmp_path / "example.py"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert re.search(r"\d\.\d", done.stdout)
