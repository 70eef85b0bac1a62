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

FOLDER = ROOT / "docs" / "tutorials"
BASH = ["bash", "-e", "-o", "pipefail", "-c"]
TRAINING = "redundant-envs-train"


def file_of(block: str) -> str | None:
    """The name under which a block is saved."""
    named = re.match(r"# ([\w./-]+\.\w+)\n", block)
    return named and named[1]


def run_tutorial(page: Path, folder: Path, without: str | None = None) -> list[str]:
    """Follow a page; return what each block printed, errors included.

    Blocks that say ``without``, such as the command of a training, are not run. A block that nothing runs, or
    that ends with a status other than 0, raises an AssertionError with its position, its text and its output.
    """
    outputs = []
    paths = os.pathsep.join((str(ROOT), str(ROOT / "agents")))
    found = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    environment = {**os.environ, "PATH": found, "PYTHONPATH": paths, "MPLBACKEND": "Agg"}
    for line, language, block in blocks(page):
        if language in ("", "text") or (without is not None and without in block):
            continue
        if name := file_of(block):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(block, encoding="utf-8")
            continue
        commands = "\n".join(line[2:] for line in block.splitlines() if line.startswith("$ "))
        programs = {"python": [sys.executable, "-c", block], "console": [*BASH, commands or "exit 1"]}
        command = programs.get(language, [*BASH, block] if language in ("shell", "sh", "bash") else ["false"])
        done = subprocess.run(
            command, cwd=folder, env=environment, text=True, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        if done.returncode:
            raise AssertionError(f"{page.name}, line {line}: {language}\n{block}\n{done.stdout}")
        outputs.append(done.stdout)
    return outputs


SAID = {
    "third_arm.md": ("M11 =", r"'(lower|upper) impact'", "0 missed", r"rewards of 1000 arms \(1000,\)"),
    "moving_target.md": (r"the target is at \[", "Gymnasium finds no fault", "0 missed"),
}
"""What the blocks before the training print."""


LONG = "moving_target.md"
"""The other one has the commands of both."""


@pytest.mark.long
@pytest.mark.parametrize("page", [pytest.param(p, marks=[pytest.mark.long] * (p == LONG)) for p in SAID])
def test_a_tutorial_without_its_training(page, tmp_path):
    outputs = run_tutorial(FOLDER / page, tmp_path, without=TRAINING)
    for words, output in zip(SAID[page], outputs, strict=False):
        assert re.search(words, output)
    assert len(outputs) >= len(SAID[page])


@pytest.mark.long
@pytest.mark.parametrize(("page", "result"), [("third_arm.md", "hold"), ("moving_target.md", "touch")])
def test_a_tutorial_with_its_training(page, result, tmp_path):
    """Some 25 and 110 s on two cores that other work shared."""
    assert f'"{result}_success"' in run_tutorial(FOLDER / page, tmp_path)[-1]
    assert (tmp_path / "run" / "policy.zip").exists()
    if page == "moving_target.md":
        assert (tmp_path / "follow.gif").stat().st_size > 10_000


@pytest.mark.parametrize(("page", "most"), [("third_arm.md", 25), ("moving_target.md", 40)])
def test_what_a_reader_saves_is_short(page, most):
    saved = [block for _, _, block in blocks(FOLDER / page) if file_of(block)]
    lines = [line for block in saved for line in block.splitlines() if line.strip() and line[0] != "#"]
    assert 0 < len(lines) <= most


def test_a_block_that_fails_or_that_nothing_runs_is_told(tmp_path):
    page = tmp_path / "page.md"
    for language, block, said in (
        ("python", "print('before')\nraise SystemExit(2)", "before\n"),
        ("console", "$ echo before\n$ false\n$ echo after", "before\n"),
        ("shell", "echo before\nfalse | cat\necho after", "before\n"),
        ("yaml", "a: 1", ""),
    ):
        page.write_text(f"```{language}\n{block}\n```\n", encoding="utf-8")
        with pytest.raises(AssertionError, match=f"(?s)^page.md, line 2: {language}\n.*\n{said}$"):
            run_tutorial(page, tmp_path)
