"""Fixtures shared by tests of the application."""

import pytest


@pytest.fixture(autouse=True)
def short_clips(monkeypatch):
    """Reports of tests show one episode, not four: the clips take most of their time."""
    from redundant_envs_train import report

    monkeypatch.setattr(report, "CLIP_EPISODES", 1)
