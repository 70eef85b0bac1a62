"""A file of a user, who writes lists and arrays where the package keeps tuples: it runs and has its types."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

FILE, ROOT = Path(__file__).with_name("users_file.py"), Path(__file__).parents[2]
SILENT = ["--strict", "--ignore-missing-imports", "--follow-imports=silent", "--config-file="]
CHECKERS = {"it runs": [], "mypy": ["-m", "mypy", *SILENT], "pyright": ["-m", "pyright"]}


@pytest.mark.parametrize("checker", CHECKERS.values(), ids=CHECKERS)
def test_a_users_file_runs_and_has_no_errors_of_types(checker, tmp_path):
    if checker and not find_spec(checker[1]):
        pytest.skip(f"{checker[1]} is not installed")
    copy = tmp_path / FILE.name
    copy.write_bytes(FILE.read_bytes())
    paths = {"PYTHONPATH": str(ROOT), "MYPYPATH": str(ROOT)}
    command = [sys.executable, *checker, copy]
    done = subprocess.run(command, cwd=tmp_path, env=os.environ | paths, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
