"""The tutorial of a third arm, followed literally in an empty folder."""

from pathlib import Path

import pytest
from tutorial import run_tutorial

PAGE = Path(__file__).parents[2] / "docs" / "tutorials" / "third_arm.md"


def test_the_tutorial_without_its_training(tmp_path):
    outputs = run_tutorial(PAGE, tmp_path, without="redundant-envs-train")
    assert "M11 =" in outputs[0]
    assert "'lower impact'" in outputs[1] or "'upper impact'" in outputs[1]
    assert "0 missed" in outputs[2]
    assert "rewards of 1000 arms (1000,)" in outputs[3]


@pytest.mark.long
def test_the_tutorial_with_its_training(tmp_path):
    """Some 25 s, of which training and its report are two thirds."""
    outputs = run_tutorial(PAGE, tmp_path)
    assert '"hold_success"' in outputs[-1]
    assert (tmp_path / "run" / "policy.zip").exists()
