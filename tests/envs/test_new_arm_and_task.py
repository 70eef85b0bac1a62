"""A new arm and a new task are the files and lines that CONTRIBUTING.md names: tests of all ids have them."""

import shutil
from pathlib import Path

import pytest

from tests.mutation.copies import outcome

pytestmark = pytest.mark.long
ROOT = Path(__file__).parents[2]
NEW = {
    "redundant_envs/robots/four_r.py": "redundant_envs/robots/twin_r.py",
    "configs/scenes/four_r_reach.yaml": "configs/scenes/twin_r_reach.yaml",
}
"""Files of an arm, and those of another with its equations."""
TASK = '''"""The reach task with another name."""

from redundant_envs.tasks.reach import ReachTask


class TwinReachTask(ReachTask):
    """The reach task."""

    name = "TwinReach"
'''
LINES = {
    "robots/__init__.py": [
        ("from redundant_envs.robots.rprp", "from redundant_envs.robots.twin_r import TwinR\n"),
        ('REGISTRY: dict[str, type[Arm]] = {"RPRP": RPRP, ', '"TwinR": TwinR, '),
    ],
    "tasks/__init__.py": [
        ("from redundant_envs.tasks.reach", "from redundant_envs.tasks.twin import TwinReachTask\n"),
        ("for task in (ReachTask, ", "TwinReachTask, "),
    ],
    "envs/registration.py": [
        ('SCENES: dict[str, Any] = {"RPRP": "rprp_reach", ', '"TwinR": "twin_r_reach", '),
        ('TASKS = ["Reach", ', '"TwinReach", '),
    ],
}
"""Additions: before the line that begins so, or after a text within a line."""


def test_a_new_arm_and_a_new_task_have_environments_that_the_tests_of_all_ids_find_sound(tmp_path):
    tree = tmp_path / "tree"
    shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(".*", "runs", "__pycache__"))
    for old, new in NEW.items():
        text = (tree / old).read_text(encoding="utf-8")
        (tree / new).write_text(text.replace("FourR", "TwinR"), encoding="utf-8")
    (tree / "redundant_envs" / "tasks" / "twin.py").write_text(TASK, encoding="utf-8")
    for file, additions in LINES.items():
        path = tree / "redundant_envs" / file
        text = path.read_text(encoding="utf-8")
        for place, added in additions:
            assert text.count(place) == 1, place
            text = text.replace(place, added + place if added.endswith("\n") else place + added)
        path.write_text(text, encoding="utf-8")
    of_all_ids = ["tests/envs/test_registry.py", "tests/envs/test_promises.py", "-k", "Twin"]
    assert outcome(of_all_ids, tree).result == "green"
