"""A new effect is the files that CONTRIBUTING.md names: with these, tests of all effects have it, too."""

import shutil
from pathlib import Path

import pytest

from tests.mutation.copies import outcome

pytestmark = pytest.mark.long
ROOT = Path(__file__).parents[2]
INIT, OLD, NEW = "redundant_envs/effects/__init__.py", "ViscousFriction", "TwinFriction"
ORACLE = """
import redundant_envs as rde

def test_twin_friction_slows_a_slider_down():
    scene = rde.Scene(rde.Chain("P", (2.0,), ()), (rde.effects.TwinFriction(0.5),))
    assert 0.97 < rde.simulate(scene, [0.0], [1.0], [0.1]).qd[0, 0] < 0.98
"""
OF_ALL = (
    "tests/effects", "tests/docs", "tests/studies/test_effects_study.py", "tests/test_properties.py",
    "tests/envs/test_pictures.py", "tests/fuzz/test_fuzz.py", "tests/verify/test_verified_effects.py",
)  # fmt: skip
"""Tests of all effects."""


def renamed(text):
    return text.replace(OLD, NEW).replace("viscous_friction", "twin_friction")


def test_a_new_effect_is_a_module_a_line_a_page_and_a_test(tmp_path):
    copy = tmp_path / "tree"
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".*", "runs", "__pycache__"))
    for file in ("redundant_envs/effects/viscous_friction.py", "docs/effects/viscous_friction.md"):
        text = (copy / file).read_text(encoding="utf-8")
        (copy / renamed(file)).write_text(renamed(text), encoding="utf-8")
    (copy / "tests" / "effects" / "test_twin_friction.py").write_text(ORACLE, encoding="utf-8")
    assert outcome(["tests/effects/test_effects.py"], copy).result == "red"  # nobody can name it
    init = (copy / INIT).read_text(encoding="utf-8")
    (line,) = (line for line in init.splitlines(keepends=True) if OLD in line)
    (copy / INIT).write_text(init.replace(line, renamed(line) + line), encoding="utf-8")
    named = ("-k", f"{NEW} or twin_friction or every_effect or index_of_effects")
    assert outcome([*OF_ALL, *named], copy).result == "green"
