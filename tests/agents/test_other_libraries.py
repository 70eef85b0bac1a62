"""docs/other_libraries.md: its programs run where the library is installed."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "other_libraries.md"


@pytest.mark.skipif(importlib.util.find_spec("torchrl") is None, reason="torchrl is not installed")
def test_the_program_for_torchrl_prints_what_its_comments_say():
    programs = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    (program,) = (program for program in programs if "torchrl" in program)
    command = [sys.executable, "-W", "error", "-c", program]
    done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    shown = [line for line in done.stdout.splitlines() if line.startswith("torch.")]
    assert shown == ["torch.Size([100])", "torch.Size([64, 250]) torch.Size([128])", "torch.float64"]


def test_the_page_names_files_and_arguments_that_exist():
    text = PAGE.read_text(encoding="utf-8")
    for name in re.findall(r"(?:configs/zoo|docs/examples|agents/redundant_envs_train)/\w+\.\w+", text):
        assert (ROOT / name).exists(), name
    assert len(re.findall(r"configs/zoo/\w+\.yml", text)) >= 2
