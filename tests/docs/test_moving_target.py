"""The tutorial of a moving target, followed literally in an empty folder."""

from pathlib import Path

import pytest
from tutorial import run_tutorial

PAGE = Path(__file__).parents[2] / "docs" / "tutorials" / "moving_target.md"


def test_the_tutorial_without_its_training(tmp_path):
    outputs = run_tutorial(PAGE, tmp_path, without="redundant-envs-train")
    assert "the target is at [" in outputs[0]
    assert "Gymnasium finds no fault" in outputs[1]
    assert "0 missed" in outputs[2]


@pytest.mark.long
def test_the_tutorial_with_its_clip_and_training(tmp_path):
    """Under two minutes, 110 s on two cores that other work shared."""
    outputs = run_tutorial(PAGE, tmp_path)
    assert '"touch_success"' in outputs[-1]
    assert (tmp_path / "run" / "policy.zip").exists()
    assert (tmp_path / "follow.gif").stat().st_size > 10_000
