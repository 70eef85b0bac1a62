"""Tutorials are followed literally in an empty folder, and fail where a reader would fail.

A block whose first line is a comment with nothing but a file name (``# third_arm.py``) is saved under that
name. Of the others, ``python`` blocks run as scripts, ``console`` blocks as the commands behind ``$ `` (the
other lines show output), and ``shell`` blocks as a whole; ``text`` blocks are only read.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from markdown import ROOT, blocks

pytestmark = pytest.mark.long

FOLDER = ROOT / "docs" / "tutorials"
BASH = ["bash", "-e", "-o", "pipefail", "-c"]


def run_tutorial(page: Path, folder: Path) -> list[str]:
    """Follow a page; return what each block printed, errors included. A block that nothing runs, or that ends
    with a status other than 0, is a failure."""
    outputs = []
    paths = os.pathsep.join((str(ROOT), str(ROOT / "agents")))
    found = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    environment = {**os.environ, "PATH": found, "PYTHONPATH": paths, "MPLBACKEND": "Agg"}
    for line, language, block in blocks(page):
        if language in ("", "text"):
            continue
        if saved := re.match(r"# ([\w./-]+\.\w+)\n", block):
            (folder / saved[1]).parent.mkdir(parents=True, exist_ok=True)
            (folder / saved[1]).write_text(block, encoding="utf-8")
            continue
        commands = "\n".join(line[2:] for line in block.splitlines() if line.startswith("$ "))
        command = {
            "python": [sys.executable, "-c", block],
            "console": [*BASH, commands or "exit 1"],
            "shell": [*BASH, block],
        }[language]
        done = subprocess.run(
            command, cwd=folder, env=environment, text=True, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        assert done.returncode == 0, f"{page.name}, line {line}: {language}\n{block}\n{done.stdout}"
        outputs.append(done.stdout)
    return outputs


@pytest.mark.parametrize(("page", "result"), [("third_arm.md", "hold"), ("moving_target.md", "touch")])
def test_a_tutorial_is_followed_to_its_trained_policy(page, result, tmp_path):
    """Some 25 and 110 s on two cores that other work shared."""
    outputs = run_tutorial(FOLDER / page, tmp_path)
    assert any("0 missed" in output for output in outputs)  # by verify
    assert f'"{result}_success"' in outputs[-1]
    assert (tmp_path / "run" / "policy.zip").exists()
