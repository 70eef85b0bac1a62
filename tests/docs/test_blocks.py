"""Every Python block of the README and the manual runs alone, in a separate folder."""

import importlib.util
import re

import pytest
from markdown import MANUAL, ROOT, blocks

import redundant_envs as rde

SLOW = ("torch.optim.Adam", "model.learn(")
"""In blocks that take seconds; beside them shorter ones use the same functions."""
BLOCKS = [
    pytest.param(
        page, line, block, id=f"{page.stem}-{line}",
        marks=pytest.mark.long if any(word in block for word in SLOW) else (),
    )
    for page in MANUAL for line, block in blocks(page, "python")
]  # fmt: skip
OTHERS = ("torch", "torchrl", "stable_baselines3", "sympy", "mujoco")
BEHIND = {"RecordVideo": "moviepy", "animate(": "imageio"}
"""Packages that are not imported by a block, but needed by what it calls."""


@pytest.mark.parametrize(("page", "line", "block"), BLOCKS)
def test_block_runs_alone(page, line, block, tmp_path, monkeypatch, capsys):
    for name in OTHERS:
        if re.search(rf"^(import|from) {name}\b", block, re.M) and not importlib.util.find_spec(name):
            pytest.skip(f"{name} is not installed")
    for call, name in BEHIND.items():
        if call in block:
            pytest.importorskip(name)
    monkeypatch.chdir(tmp_path)
    # Then line numbers of an error are those of the page.
    code = compile("\n" * (line - 1) + block, str(page.relative_to(ROOT)), "exec")
    exec(code, {"__name__": "__main__"})
    shown = capsys.readouterr().out.splitlines()
    assert len(shown) <= 30  # an example must not flood the screen
    assert ("print(" in block) == bool(shown)


def test_the_scene_file_of_the_page_is_a_scene(tmp_path):
    ((_, text),) = blocks(ROOT / "docs" / "scenes.md", "yaml")
    path = tmp_path / "my_scene.yaml"
    path.write_text(text, encoding="utf-8")
    scene = rde.load_scene(str(path))
    assert [type(e).__name__ for e in scene.effects] == ["Gravity", "ViscousFriction", "EffortLimits"]
